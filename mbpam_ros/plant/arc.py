"""Tier ``arc``: constant-curvature muscles with inertia, and an object that they touch at one point each.

Gravity, bending, Kelvin-Voigt damping and the exact velocity terms of the muscles' point masses; the turning inertia of
their cross-sections is neglected (1 % of the tip's inertia). Fingers do not touch each other.
"""

from __future__ import annotations

import numpy as np

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.plant import multibody
from mbpam_ros.plant.finger import mass_nodes
from mbpam_ros.plant.shapes import SHAPE_CODES
from mbpam_ros.plant.solids import principal_inertia
from mbpam_ros.plant.tiers import Actuation, Array, BodyState, PlantDivergedError, Tier, TierSetup, TierState

_BENDS = 2 * FINGER_COUNT
_REASONS = {
    multibody.NOT_FINITE: "a velocity is no longer finite",
    multibody.ABSURD: "a bend is beyond 340 deg, or something moves faster than 500 rad/s or 50 m/s",
    multibody.NOT_SOLVED: "the contact equations were not solved",
}


class ArcTier(Tier):
    """Eight bend components and one rigid body, advanced by :mod:`~mbpam_ros.plant.multibody`."""

    def __init__(self, setup: TierSetup) -> None:
        self._setup = setup
        geometry, config, body = setup.geometry, setup.config, setup.body
        muscle = np.array([geometry.end_length_m, geometry.active_length_m, geometry.outer_radius_m])
        table_m = setup.planes_m[-1, 0] if len(setup.planes_m) else np.inf
        kinds = (config.finger_object, config.object_support, config.finger_support, config.object_support)
        laws = np.array([kind.law() for kind in kinds])
        solid = (-1, np.zeros(3), 0.0, np.zeros(3))
        if body is not None:
            inertia = principal_inertia(body.shape, body.size_m, body.mass_kg)
            solid = (SHAPE_CODES[body.shape], 0.5 * np.array(body.size_m), body.mass_kg, inertia)
        self._muscles = (setup.sub_step_s, np.ascontiguousarray(setup.finger_base_m), muscle, mass_nodes(geometry))
        self._material = (config.retardation_time_s, setup.gravity_m_s2)
        # A table out of reach of a muscle that hangs straight is out of reach of all.
        reaches_table = bool(table_m < geometry.length_m)
        self._surroundings = (*solid, np.ascontiguousarray(setup.planes_m, dtype=float), reaches_table, laws)
        self.reset()
        nothing = Actuation(np.zeros((FINGER_COUNT, 2)), np.ones(FINGER_COUNT))
        self.step(nothing, nothing, np.zeros(1), np.zeros(1))  # no sub-step: compiles now, not in the first tick

    def reset(self) -> None:  # noqa: D102
        body = self._setup.body
        self._bend = np.zeros(_BENDS)
        self._velocity = np.zeros(_BENDS)
        if body is not None:
            self._velocity = np.concatenate([self._velocity, body.velocity_m_s, body.angular_velocity_rad_s])
        self._position = np.zeros(3) if body is None else np.array(body.position_m, dtype=float)
        self._orientation = np.zeros(4) if body is None else np.array(body.orientation_xyzw, dtype=float)
        self._finger_force = np.zeros((FINGER_COUNT, 3))
        self._support_force, self._palm_force = np.zeros(3), np.zeros(3)
        self.iterations = 0

    def step(  # noqa: D102
        self, before: Actuation, after: Actuation, hand_height_m: Array, hand_velocity_m_s: Array
    ) -> None:
        state = tuple(part.copy() for part in (self._bend, self._velocity, self._position, self._orientation))
        answer, self.iterations = multibody.advance(
            *state,
            np.stack([before.moment_n_m, after.moment_n_m]),
            np.stack([before.stiffness_n_m2, after.stiffness_n_m2]),
            hand_height_m,
            hand_velocity_m_s,
            *self._muscles,
            *self._material,
            *self._surroundings,
            self._finger_force,
            self._support_force,
            self._palm_force,
        )
        if answer != multibody.OK:
            raise PlantDivergedError(
                f"tier 'arc' at a sub-step of {self._setup.sub_step_s:g} s: {_REASONS[answer]}. Use a smaller "
                "sub_step_s, a smaller contact stiffness, or a larger retardation_time_s or damping."
            )
        self._bend, self._velocity, self._position, self._orientation = state

    def state(self) -> TierState:  # noqa: D102
        rates = self._velocity[:_BENDS].reshape(FINGER_COUNT, 2)
        body = None
        if self._setup.body is not None:
            body = BodyState(
                self._position.copy(), self._orientation.copy(), self._velocity[8:11].copy(), self._velocity[11:].copy()
            )
        return TierState(
            self._bend.reshape(FINGER_COUNT, 2).copy(),
            rates.copy(),
            body,
            self._finger_force.copy(),
            self._support_force.copy(),
            self._palm_force.copy(),
        )
