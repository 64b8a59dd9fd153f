"""The tiers by name, each built with what it wraps."""

from __future__ import annotations

import dataclasses

import numpy as np

from mbpam_ros.plant.fidelity import ALL_FINGERS, Fidelity
from mbpam_ros.plant.tiers.base import Tier, TierError, TierSetup

# Tiers are imported where they are built: one that is not used is neither loaded nor compiled.

_NAMES = ("static", "arc", "rod")


def tier_names() -> tuple[str, ...]:
    """Return the names of all tiers, cheapest first."""
    return _NAMES


def build_tier(setup: TierSetup, fidelity: Fidelity) -> Tier:
    """Return what computes a setup in this way, to be reset before all else.

    Raises:
        TierError: no such tier, or it cannot compute what the setup holds.
    """
    name = fidelity.tier
    if name not in _NAMES:
        raise TierError(f"no tier {name!r}; known: {', '.join(_NAMES)}")
    if fidelity.modes != 1 and name != "rod":
        raise TierError(f"tier {name!r} takes no modes, found {fidelity.modes}: use tier 'rod', or leave modes out")
    if fidelity.twist_modes + fidelity.stretch_modes > 0 and name != "rod":
        raise TierError(f"tier {name!r} neither twists nor stretches: use tier 'rod', or leave strains at [bend]")
    if fidelity.air_modes is not None and (name != "rod" or setup.body is None):
        raise TierError(f"air_modes are for the tier 'rod' with an object, found tier {name!r}: leave them out")
    if not fidelity.contact:
        from mbpam_ros.plant.tiers.partial import NoContact

        return NoContact(_fingers(*_in_the_air(setup, fidelity)), setup.bodies)
    return _fingers(setup, fidelity)


def _in_the_air(setup: TierSetup, fidelity: Fidelity) -> tuple[TierSetup, Fidelity]:
    """Return what there is to compute, and how, if nothing touches."""
    alone = dataclasses.replace(setup, body=None, others=(), planes_m=np.empty((0, 3)), fingers_touch=False)
    return alone, dataclasses.replace(fidelity, modes=fidelity.air_modes or fidelity.modes, air_modes=None)


def _fingers(setup: TierSetup, fidelity: Fidelity) -> Tier:
    """Return the tier of the fingers that move, and of the others."""
    if set(fidelity.moving_fingers) == set(ALL_FINGERS):
        return _muscles(setup, fidelity)
    from mbpam_ros.plant.tiers.partial import SomeFingers

    moving = np.array(fidelity.moving_fingers) - 1
    inner = _muscles(dataclasses.replace(setup, finger_base_m=setup.finger_base_m[moving]), fidelity)
    return SomeFingers(inner, moving, setup.finger_base_m, setup.geometry.length_m)


def _muscles(setup: TierSetup, fidelity: Fidelity) -> Tier:
    """Return the tier of all muscles of the setup, and of all that they touch."""
    if fidelity.tier == "static":
        from mbpam_ros.plant.tiers.static import StaticTier

        return StaticTier(setup, fidelity)
    from mbpam_ros.plant.tiers.rod import RodTier

    if fidelity.air_modes is None:
        return RodTier(setup, fidelity)
    from mbpam_ros.plant.tiers.adaptive import AdaptiveTier

    air = RodTier(
        dataclasses.replace(setup, body=None, others=()), dataclasses.replace(fidelity, modes=fidelity.air_modes)
    )
    return AdaptiveTier(air, RodTier(setup, fidelity), setup, fidelity)
