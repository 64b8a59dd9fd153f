"""Any tier with contact left out: nothing touches, and the object stays where it starts."""

from __future__ import annotations

import dataclasses

import numpy as np

from mbpam_ros.plant.tiers.base import Actuation, Array, BodyState, Tier, TierSetup, TierState
from mbpam_ros.plant.tiers.registry import build_tier


class NoContact(Tier):
    """The tier ``name`` without what fingers could touch; the object is only there to be seen.

    Raises:
        TierError: no such tier, or it cannot compute what the setup holds.
    """

    def __init__(self, name: str, setup: TierSetup) -> None:
        alone = dataclasses.replace(
            setup,
            body=None,
            planes_m=np.empty((0, 3)),
            fingers_touch=False,
            air_modes=None,
            modes=setup.air_modes or setup.modes,
            contact=True,
        )
        self._inner = build_tier(name, alone)
        body = setup.body
        self._body: BodyState | None = None
        if body is not None:
            self._body = BodyState(
                np.array(body.position_m, float), np.array(body.orientation_xyzw, float), np.zeros(3), np.zeros(3)
            )

    def reset(self) -> None:
        self._inner.reset()

    def step(self, before: Actuation, after: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        self._inner.step(before, after, hand_height_m, hand_velocity_m_s)

    def state(self) -> TierState:
        return dataclasses.replace(self._inner.state(), body=self._body)
