"""The tiers by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from mbpam_ros.plant.tiers.base import Tier, TierError, TierSetup

_TIERS = {
    "static": ("mbpam_ros.plant.tiers.static", "StaticTier"),
    "arc": ("mbpam_ros.plant.tiers.rod", "ArcTier"),
    "rod": ("mbpam_ros.plant.tiers.rod", "RodTier"),
}
"""Modules are imported when asked for: a tier that is not used is neither loaded nor compiled."""

_ADAPTIVE = ("mbpam_ros.plant.tiers.adaptive", "AdaptiveTier")


def tier_names() -> tuple[str, ...]:
    """Return the names of all tiers, cheapest first."""
    return tuple(_TIERS)


def build_tier(name: str, setup: TierSetup) -> Tier:
    """Return the tier ``name``.

    Raises:
        TierError: no such tier, or it cannot compute what the setup holds.
    """
    if name not in _TIERS:
        raise TierError(f"no tier {name!r}; known: {', '.join(_TIERS)}")
    if setup.modes is not None and name != "rod":
        raise TierError(f"tier {name!r} takes no modes, found {setup.modes}: use tier 'rod', or leave modes out")
    if setup.air_modes is not None and (name != "rod" or setup.body is None):
        raise TierError(f"air_modes are for the tier 'rod' with an object, found tier {name!r}: leave them out")
    if not setup.contact:
        free: Tier = importlib.import_module("mbpam_ros.plant.tiers.no_contact").NoContact(name, setup)
        return free
    if setup.moving_fingers is not None:
        some: Tier = importlib.import_module("mbpam_ros.plant.tiers.partial").SomeFingers(name, setup)
        return some
    module, tier = _TIERS[name] if setup.air_modes is None else _ADAPTIVE
    build: Callable[[TierSetup], Tier] = getattr(importlib.import_module(module), tier)
    return build(setup)
