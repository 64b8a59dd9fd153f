"""The tiers by name, each built with what it wraps."""

from __future__ import annotations

import dataclasses

import numpy as np

from mbpam_ros.plant.tiers.base import Tier, TierError, TierSetup

# Tiers are imported where they are built: one that is not used is neither loaded nor compiled.

_NAMES = ("static", "arc", "rod")


def tier_names() -> tuple[str, ...]:
    """Return the names of all tiers, cheapest first."""
    return _NAMES


def build_tier(name: str, setup: TierSetup) -> Tier:
    """Return the tier ``name``, to be reset before all else.

    Raises:
        TierError: no such tier, or it cannot compute what the setup holds.
    """
    if name not in _NAMES:
        raise TierError(f"no tier {name!r}; known: {', '.join(_NAMES)}")
    if setup.modes is not None and name != "rod":
        raise TierError(f"tier {name!r} takes no modes, found {setup.modes}: use tier 'rod', or leave modes out")
    if setup.air_modes is not None and (name != "rod" or setup.body is None):
        raise TierError(f"air_modes are for the tier 'rod' with an object, found tier {name!r}: leave them out")
    computed = setup if setup.contact else _without_contact(setup)
    if setup.moving_fingers is None:
        tier = _muscles(name, computed)
    else:
        from mbpam_ros.plant.tiers.partial import SomeFingers

        moving = np.array(setup.moving_fingers) - 1
        inner = _muscles(name, dataclasses.replace(computed, finger_base_m=setup.finger_base_m[moving]))
        tier = SomeFingers(inner, moving, setup.finger_base_m, setup.geometry.length_m)
    if setup.contact:
        return tier
    from mbpam_ros.plant.tiers.partial import NoContact

    return NoContact(tier, setup.body)


def _without_contact(setup: TierSetup) -> TierSetup:
    """Return what is left of a setup if nothing touches; the muscles are in the air throughout."""
    return dataclasses.replace(
        setup,
        body=None,
        planes_m=np.empty((0, 3)),
        fingers_touch=False,
        air_modes=None,
        modes=setup.air_modes or setup.modes,
    )


def _muscles(name: str, setup: TierSetup) -> Tier:
    """Return the tier that computes all muscles of the setup, and all that they touch."""
    if name == "static":
        from mbpam_ros.plant.tiers.static import StaticTier

        return StaticTier(setup)
    from mbpam_ros.plant.tiers.rod import ArcTier, RodTier

    if setup.air_modes is None:
        return ArcTier(setup) if name == "arc" else RodTier(setup)
    from mbpam_ros.plant.tiers.adaptive import AdaptiveTier

    in_the_air = RodTier(dataclasses.replace(setup, body=None, modes=setup.air_modes))
    return AdaptiveTier(in_the_air, RodTier(setup), setup)
