"""Tiers with a part of the scene left out: some of the muscles, or all that could touch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.rod_law import StrainLaw
from mbpam_ros.plant.tiers.base import (
    CENTRELINE_POINTS,
    Actuation,
    Array,
    BodyForces,
    BodyState,
    PlantDivergedError,
    RigidBody,
    Tier,
    TierState,
)

_NO_MOMENT_N_M = 1e-6
"""Bends a muscle by less than 0.01 deg."""


class SomeFingers(Tier):
    """Muscles of which ``inner`` computes some; the others hang straight, and nothing touches them.

    Args:
        inner: the tier of those muscles.
        moving: their places among all, counted from 0.
        finger_base_m: clamp points of all, shape (4, 3).
        length_m: of a muscle.
    """

    def __init__(self, inner: Tier, moving: NDArray[np.intp], finger_base_m: Array, length_m: float) -> None:
        self._inner, self._moving = inner, moving
        self._still = np.setdiff1d(np.arange(len(finger_base_m)), moving)
        down = np.linspace(0.0, length_m, CENTRELINE_POINTS)[:, None] * (0.0, 0.0, 1.0)
        self._straight_m = finger_base_m[:, None, :] + down

    def reset(self, actuation: Actuation) -> None:
        self._inner.reset(self._of_moving(actuation))

    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        self._inner.step(self._of_moving(actuation), hand_height_m, hand_velocity_m_s)

    def state(self) -> TierState:
        found = self._inner.state()
        return dataclasses.replace(
            found,
            bend_rad=self._among_all(found.bend_rad, 0.0),
            bend_rate_rad_s=self._among_all(found.bend_rate_rad_s, 0.0),
            centreline_m=self._among_all(found.centreline_m, self._straight_m),
            body_forces=tuple(
                dataclasses.replace(each, finger_n=self._among_all(each.finger_n, 0.0)) for each in found.body_forces
            ),
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
        strain = actuation.strain
        return Actuation(
            actuation.moment_n_m[self._moving],
            actuation.stiffness_n_m2[self._moving],
            None if strain is None else StrainLaw(*(values[self._moving] for values in strain)),
        )

    @property
    def has_strain(self) -> bool:
        return self._inner.has_strain

    def set_gravity(self, gravity_m_s2: Array) -> None:
        self._inner.set_gravity(gravity_m_s2)

    def _among_all(self, values: Array, still: Array | float) -> Array:
        """Return the values of all muscles, (4, ...), from those of the moving ones."""
        everyone = np.empty((len(self._straight_m), *values.shape[1:]))
        everyone[:] = still
        everyone[self._moving] = values
        return everyone


class NoContact(Tier):
    """Muscles that ``inner`` computes in the air; the objects stay where they start, to be seen only."""

    def __init__(self, inner: Tier, bodies: Sequence[RigidBody]) -> None:
        self._inner = inner
        self._bodies = tuple(
            BodyState(
                np.array(body.position_m, float), np.array(body.orientation_xyzw, float), np.zeros(3), np.zeros(3)
            )
            for body in bodies
        )

    def reset(self, actuation: Actuation) -> None:
        self._inner.reset(actuation)

    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        self._inner.step(actuation, hand_height_m, hand_velocity_m_s)

    def state(self) -> TierState:
        found = self._inner.state()
        forces = (BodyForces.none(len(found.bend_rad)),) * len(self._bodies)
        return dataclasses.replace(found, bodies=self._bodies, body_forces=forces)

    @property
    def has_strain(self) -> bool:
        return self._inner.has_strain

    def set_gravity(self, gravity_m_s2: Array) -> None:
        self._inner.set_gravity(gravity_m_s2)
