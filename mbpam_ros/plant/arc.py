"""Tier ``arc``: constant-curvature muscles with inertia, and an object that they touch anywhere along them.

Gravity, bending, Kelvin-Voigt damping and the exact velocity terms of the muscles' point masses; the turning inertia of
their cross-sections is neglected (1 % of the tip's inertia). Fingers do not touch each other.
"""

from __future__ import annotations

import numpy as np

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.plant import multibody
from mbpam_ros.plant.contact import contact_table
from mbpam_ros.plant.contact_search import Surroundings, contact_limit
from mbpam_ros.plant.finger import Muscle, mass_nodes
from mbpam_ros.plant.multibody import Drive, Forces, State, System
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
        muscle = Muscle(geometry.end_length_m, geometry.active_length_m, geometry.outer_radius_m)
        planes = np.ascontiguousarray(setup.planes_m, dtype=float)
        # A table out of reach of a muscle that hangs straight is out of reach of all.
        table_in_reach = bool(len(planes) and planes[-1, 0] < geometry.length_m)
        kinds = (config.finger_object, config.object_support, config.finger_support, config.object_support)
        shape, half, mass, inertia = -1, np.zeros(3), 0.0, np.zeros(3)
        if body is not None:
            shape, half, mass = SHAPE_CODES[body.shape], 0.5 * np.array(body.size_m), body.mass_kg
            inertia = principal_inertia(body.shape, body.size_m, body.mass_kg)
        self._system = System(
            step_s=setup.sub_step_s,
            gravity=setup.gravity_m_s2,
            bases=np.ascontiguousarray(setup.finger_base_m),
            muscle=muscle,
            nodes=mass_nodes(geometry),
            retardation=config.retardation_time_s,
            mass=mass,
            inertia=inertia,
            surroundings=Surroundings(shape, half, planes, table_in_reach),
            laws=np.array([kind.law() for kind in kinds]),
        )
        self._contacts = contact_table(contact_limit(FINGER_COUNT, len(planes)))
        self.reset()
        nothing = Actuation(np.zeros((FINGER_COUNT, 2)), np.ones(FINGER_COUNT))
        self.step(nothing, nothing, np.zeros(1), np.zeros(1))  # no sub-step: compiles now, not in the first tick

    def reset(self) -> None:  # noqa: D102
        body = self._setup.body
        velocity, position, orientation = np.zeros(_BENDS), np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        if body is not None:
            velocity = np.concatenate([velocity, body.velocity_m_s, body.angular_velocity_rad_s])
            position, orientation = np.array(body.position_m, float), np.array(body.orientation_xyzw, float)
        self._state = State(np.zeros(_BENDS), velocity, position, orientation)
        self._forces = Forces(np.zeros((FINGER_COUNT, 3)), np.zeros(3), np.zeros(3))
        self.iterations = 0

    def step(  # noqa: D102
        self, before: Actuation, after: Actuation, hand_height_m: Array, hand_velocity_m_s: Array
    ) -> None:
        state = State(*(part.copy() for part in self._state))
        drive = Drive(
            np.stack([before.moment_n_m, after.moment_n_m]),
            np.stack([before.stiffness_n_m2, after.stiffness_n_m2]),
            hand_height_m,
            hand_velocity_m_s,
        )
        answer, self.iterations = multibody.advance(state, drive, self._system, self._contacts, self._forces)
        if answer != multibody.OK:
            raise PlantDivergedError(
                f"tier 'arc' at a sub-step of {self._setup.sub_step_s:g} s: {_REASONS[answer]}. Use a smaller "
                "sub_step_s, a smaller contact stiffness, or a larger retardation_time_s or damping."
            )
        self._state = state

    def state(self) -> TierState:  # noqa: D102
        bend, velocity, position, orientation = (part.copy() for part in self._state)
        body = None
        if self._setup.body is not None:
            body = BodyState(position, orientation, velocity[8:11], velocity[11:])
        rates = velocity[:_BENDS].reshape(FINGER_COUNT, 2)
        return TierState(bend.reshape(FINGER_COUNT, 2), rates, body, *(force.copy() for force in self._forces))
