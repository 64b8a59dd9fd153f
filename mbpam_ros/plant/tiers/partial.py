"""Any tier with some of the muscles left out: these hang straight, and nothing touches them."""

from __future__ import annotations

import dataclasses

import numpy as np

from mbpam_ros.plant.tiers.base import (
    CENTRELINE_POINTS,
    Actuation,
    Array,
    PlantDivergedError,
    Tier,
    TierSetup,
    TierState,
)
from mbpam_ros.plant.tiers.registry import build_tier

_NO_MOMENT_N_M = 1e-6
"""Bends a muscle by less than 0.01 deg."""


class SomeFingers(Tier):
    """The tier ``name`` for the muscles ``setup.moving_fingers``.

    Raises:
        TierError: no such tier, or it cannot compute what the setup holds.
    """

    def __init__(self, name: str, setup: TierSetup) -> None:
        self._moving = np.array(setup.moving_fingers) - 1
        self._still = np.setdiff1d(np.arange(len(setup.finger_base_m)), self._moving)
        bases = setup.finger_base_m[self._moving]
        self._inner = build_tier(name, dataclasses.replace(setup, finger_base_m=bases, moving_fingers=None))
        down = np.linspace(0.0, setup.geometry.length_m, CENTRELINE_POINTS)[:, None] * (0.0, 0.0, 1.0)
        self._straight_m = setup.finger_base_m[:, None, :] + down
        self._last: tuple[Actuation, Actuation] | None = None

    def reset(self) -> None:
        self._inner.reset()

    def step(self, before: Actuation, after: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        # A tier may know its last actuation again by its identity.
        first = self._last[1] if self._last is not None and self._last[0] is before else self._of_moving(before)
        second = self._of_moving(after)
        self._inner.step(first, second, hand_height_m, hand_velocity_m_s)
        self._last = after, second

    def state(self) -> TierState:
        found = self._inner.state()
        return dataclasses.replace(
            found,
            bend_rad=self._among_all(found.bend_rad, 0.0),
            bend_rate_rad_s=self._among_all(found.bend_rate_rad_s, 0.0),
            centreline_m=self._among_all(found.centreline_m, self._straight_m),
            finger_force_n=self._among_all(found.finger_force_n, 0.0),
            between_fingers_force_n=self._among_all(found.between_fingers_force_n, 0.0),
        )

    def _of_moving(self, actuation: Actuation) -> Actuation:
        filled = np.abs(actuation.moment_n_m[self._still]) > _NO_MOMENT_N_M
        if filled.any():
            finger = self._still[filled.any(axis=1)][0] + 1
            raise PlantDivergedError(
                f"the chambers of finger {finger} are filled, and it is not among the scene's moving_fingers = "
                f"{', '.join(map(str, self._moving + 1))}: add it there"
            )
        return Actuation(actuation.moment_n_m[self._moving], actuation.stiffness_n_m2[self._moving])

    def _among_all(self, values: Array, still: Array | float) -> Array:
        """Return the values of all muscles, (4, ...), from those of the moving ones."""
        everyone = np.empty((len(self._straight_m), *values.shape[1:]))
        everyone[:] = still
        everyone[self._moving] = values
        return everyone
