"""Tiers ``arc`` and ``rod``: muscles with inertia, and objects that they touch anywhere along them.

Gravity, bending, Kelvin-Voigt damping and the exact velocity terms of the muscles' distributed mass. The two differ in
how many modes of curvature a muscle has: ``arc`` has one, so its curvature is constant, ``rod`` has more, so it sags
under its weight and wraps around what it touches. Fingers touch each other if the setup says so.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from mbpam_ros.actuator.rod_law import StrainLaw
from mbpam_ros.geometry.solids import principal_inertia
from mbpam_ros.geometry.surfaces import SHAPE_CODES
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.mechanics.composition import Composition
from mbpam_ros.plant.mechanics.contact_config import ContactKind, law_table
from mbpam_ros.plant.mechanics.contact_law import contact_table
from mbpam_ros.plant.mechanics.contact_search import BALLS, Surroundings, contact_limit
from mbpam_ros.plant.mechanics.parts import Drive, System, assemble, new_state
from mbpam_ros.plant.mechanics.rod import LARGEST_STRETCH, Motion, build_rod, coordinates_of, position_weights
from mbpam_ros.plant.mechanics.step import (
    LARGEST_BEND_RAD,
    NOT_FINITE,
    NOT_SOLVED,
    OK,
    TOO_BENT,
    TOO_DEEP,
    TOO_FAST,
    TOO_LONG,
    advance,
    bind,
    forget,
)
from mbpam_ros.plant.tiers.base import (
    CENTRELINE_POINTS,
    Actuation,
    Array,
    BodyForces,
    BodyState,
    PlantDivergedError,
    Tier,
    TierError,
    TierSetup,
    TierState,
)

MOST_MODES = 6
"""More are not resolved: a mode of higher degree bends less than the law of the rod is known."""

_NO_STEP = np.zeros(1)
"""Of the hand's motion: its start only."""

_DAMPED_S, _UNDAMPED_SWEEPS = 1e-3, 30
_FEWEST_SEGMENTS = 4
_REASONS = {
    NOT_FINITE: "a velocity is no longer finite",
    TOO_FAST: "something moves faster than 5000 rad/s or 50 m/s",
    TOO_BENT: f"a bend is beyond {np.degrees(LARGEST_BEND_RAD):.0f} deg",
    TOO_LONG: f"a muscle is longer or shorter by more than {LARGEST_STRETCH:.0%}",
    NOT_SOLVED: "the contact equations were not solved",
    TOO_DEEP: "something is pushed into something else by more than 10 mm, or two objects by more than their edges are "
    "rounded, and would come out behind it",
}
_REMEDY = "use a smaller sub_step_s, a smaller contact stiffness, or a larger retardation_time_s or damping."
_SOFT = "use a smaller sub_step_s, a greater contact stiffness, or less mass, speed or pressure."


class RodTier(Tier):
    """Muscles in modes of curvature and rigid objects, advanced by :mod:`~mbpam_ros.plant.mechanics.step`.

    Raises:
        TierError: a number of modes that cannot be.
    """

    def __init__(self, setup: TierSetup, fidelity: Fidelity) -> None:
        self._setup, self._fidelity, modes = setup, fidelity, fidelity.modes
        if not 1 <= modes <= MOST_MODES:
            raise TierError(f"tier 'rod' has 1 to {MOST_MODES} modes a plane, found modes = {modes}")
        twist_modes, stretch_modes = fidelity.twist_modes, fidelity.stretch_modes
        if max(twist_modes, stretch_modes) > MOST_MODES:
            raise TierError(
                f"tier 'rod' has up to {MOST_MODES} modes of a strain, found twist_modes = {twist_modes}, "
                f"stretch_modes = {stretch_modes}"
            )
        config, bodies = setup.config, setup.bodies
        planes = np.ascontiguousarray(setup.planes_m, dtype=float)
        # A table out of reach of a muscle that hangs straight is out of reach of all.
        table_in_reach = bool(len(planes) and planes[-1, 0] < setup.geometry.length_m)
        segments = max(_FEWEST_SEGMENTS, modes + 2)
        stretching = stretch_modes > 0
        kinds = {
            ContactKind.FINGER_OBJECT: config.finger_object,
            ContactKind.OBJECT_SUPPORT: config.object_support,
            ContactKind.FINGER_SUPPORT: config.finger_support,
            ContactKind.OBJECT_PALM: config.object_support,
            ContactKind.FINGER_FINGER: config.finger_finger,
            ContactKind.OBJECT_OBJECT: config.object_support,
        }
        halves, inertia = np.zeros((len(bodies), 3)), np.zeros((len(bodies), 3))
        for k, body in enumerate(bodies):
            halves[k] = 0.5 * np.array(body.size_m)
            inertia[k] = principal_inertia(body.shape, body.size_m, body.mass_kg)
        shapes = np.array([SHAPE_CODES[body.shape] for body in bodies], np.int64)
        system = System(
            step_s=fidelity.sub_step_s,
            sweeps=2 if config.retardation_time_s >= _DAMPED_S else _UNDAMPED_SWEEPS,
            gravity=setup.gravity_vector_m_s2,
            bases=np.ascontiguousarray(setup.finger_base_m),
            rod=build_rod(setup.geometry, modes, segments, BALLS, twist_modes, stretch_modes),
            retardation=config.retardation_time_s,
            masses=np.array([body.mass_kg for body in bodies], dtype=float),
            inertia=inertia,
            surroundings=Surroundings(shapes, halves, planes, table_in_reach, setup.fingers_touch),
            laws=law_table(kinds),
        )
        self._fingers = len(setup.finger_base_m)
        columns = coordinates_of(system.rod)
        self._coordinates = self._fingers * columns
        count = len(bodies)
        rates = self._coordinates + 6 * count
        self._memory = np.zeros(self._coordinates + rates + 7 * count)
        table = contact_table(
            contact_limit(self._fingers, len(planes), setup.fingers_touch, count), columns, self._fingers, count
        )
        shape, velocity, position, orientation = np.split(
            self._memory, np.cumsum([self._coordinates, rates, 3 * count])
        )
        state = new_state(table, shape, velocity, position.reshape(count, 3), orientation.reshape(count, 4))
        self._parts = assemble(state, system, table)
        drive = self._parts.drive
        self._start, self._now = (_acting(Drive(*(part[end] for part in drive))) for end in (0, 1))
        damped = config.retardation_time_s > 0.0
        self._advance = partial(advance, bind(self._parts)) if damped else Composition(self._parts).advance
        along = np.linspace(0.0, setup.geometry.length_m, CENTRELINE_POINTS)
        self._line_weights = position_weights(setup.geometry, segments, along, stretching)

    def reset(self, actuation: Actuation) -> None:
        if self.has_strain and actuation.strain is None:
            raise TierError("muscles that stretch or twist need an actuation that says how: give it a strain law")
        state = self._parts.state
        self._memory[:] = 0.0
        state.held[0] = 0
        self._act(actuation)
        for k, body in enumerate(self._setup.bodies):
            first = self._coordinates + 6 * k
            state.velocity[first : first + 6] = *body.velocity_m_s, *body.angular_velocity_rad_s
            state.position[k], state.orientation[k] = body.position_m, body.orientation_xyzw
        for force in self._parts.forces:
            force[:] = 0.0
        self.iterations = 0
        self._begin()

    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        _write(self._now, actuation)
        answer, self.iterations = self._advance(hand_height_m, hand_velocity_m_s)
        self._shown = False
        if answer != OK:
            _write(self._now, self._start)
            self._show()
            remedy = (_REMEDY if answer != TOO_DEEP else _SOFT).capitalize()
            bend = np.hypot(*actuation.moment_n_m.T) * self._setup.geometry.active_length_m / actuation.stiffness_n_m2
            if answer == TOO_BENT and bend.max() > 0.5 * LARGEST_BEND_RAD:  # swings go twice as far
                remedy = (
                    f"The air alone bends one by {np.degrees(bend.max()):.0f} deg: lower its pressure. Or {_REMEDY}"
                )
            where = f"tier {self._fidelity.tier!r} at a sub-step of {self._fidelity.sub_step_s:g} s"
            raise PlantDivergedError(f"{where}: {_REASONS[answer]}. {remedy}")

    @property
    def modes(self) -> int:
        """Modes of curvature a plane."""
        return self._fidelity.modes

    @property
    def has_strain(self) -> bool:
        return self._fidelity.twist_modes + self._fidelity.stretch_modes > 0

    def set_gravity(self, gravity_m_s2: Array) -> None:
        self._parts.system.gravity[:] = gravity_m_s2
        self._begin()

    def take_over(self, other: RodTier) -> None:
        """Go on with the muscles of another tier, and what acts on them: modes it does not have are zero, more dropped.

        The objects stay as they are here.
        """
        self._act(other._now)
        for own, theirs in zip(self._parts.state[:2], other._parts.state[:2], strict=True):
            own[: self._coordinates] = 0.0
            rows, there = (
                tier.by_strain(values[: tier._coordinates]) for tier, values in ((self, own), (other, theirs))
            )
            for strain, values in zip(rows, there, strict=True):
                common = min(strain.shape[1], values.shape[1])
                strain[:, :common] = values[:, :common]
        self._begin()

    def by_strain(self, values: Array) -> list[Array]:
        """Return what there is for each coordinate of the muscles as views, shapes (4, 2 m), (4, m_c), (4, m_e)."""
        bends = 2 * self.modes
        return np.split(values.reshape(self._fingers, -1), [bends, bends + self._fidelity.twist_modes], axis=1)

    def largest_rate_rad_s(self) -> float:
        """Return the largest sum of a muscle's rates, which no section of it exceeds in turning."""
        rates = self._parts.state.velocity[: self._coordinates].reshape(self._fingers, -1)
        return float(np.abs(rates).sum(axis=1).max())

    def centreline_m(self) -> Array:
        """Return points of the centre lines as in :class:`~mbpam_ros.plant.tiers.base.TierState`."""
        directors = np.moveaxis(self._motion.tangent[..., : self._fingers], -1, 0)
        return self._line_weights @ directors + self._setup.finger_base_m[:, None, :]

    def body_states(self) -> tuple[BodyState, ...]:
        """Return copies of where the objects are and how they move."""
        state, rates = self._parts.state, self._parts.state.velocity[self._coordinates :].reshape(-1, 6)
        return tuple(
            BodyState(place.copy(), turn.copy(), rate[:3].copy(), rate[3:].copy())
            for place, turn, rate in zip(state.position, state.orientation, rates, strict=True)
        )

    def body_forces(self) -> tuple[BodyForces, ...]:
        """Return copies of the forces on each object."""
        forces = self._parts.forces
        return tuple(
            BodyForces(*(part.copy() for part in parts))
            for parts in zip(forces.finger, forces.support, forces.palm, forces.object, strict=True)
        )

    def state(self) -> TierState:
        shape, velocity, fingers = self._parts.state.shape, self._parts.state.velocity, self._coordinates
        rates = velocity[:fingers].reshape(self._fingers, -1)
        tip, slope = (part[-1, ..., : self._fingers] for part in (self._motion.tangent, self._motion.slope))
        tip_rate = np.einsum("ijf,fj->fi", slope, rates)
        bend, bend_rate = tip_bend(tip.T, tip_rate, shape.reshape(self._fingers, -1)[:, :2])
        return TierState(
            bend_rad=bend,
            bend_rate_rad_s=bend_rate,
            centreline_m=self.centreline_m(),
            bodies=self.body_states(),
            body_forces=self.body_forces(),
            between_fingers_force_n=self._parts.forces.between.copy(),
        )

    def _act(self, actuation: Actuation) -> None:
        """Let the actuation be the one that acts already."""
        _write(self._start, actuation)
        _write(self._now, actuation)

    def _begin(self) -> None:
        """Go on from a state that no step has led to. The first time this compiles, before the first tick."""
        forget(self._parts.work)
        self._show()

    def _show(self) -> None:
        self._advance(_NO_STEP, _NO_STEP)
        self._shown = True

    @property
    def _motion(self) -> Motion:
        """That of the state; it is computed when asked for."""
        if not self._shown:
            self._show()
        return self._parts.motion


def _acting(end: Drive) -> Actuation:
    """Return one end of a drive as an actuation whose arrays are the drive's."""
    strain = StrainLaw(end.free_stretches, end.couplings, end.axials, end.torsions)
    return Actuation(end.moments, end.stiffnesses, strain)


def _write(there: Actuation, actuation: Actuation) -> None:
    """Copy the values; in this way it takes half as long as to assign to slices or rows."""
    there.moment_n_m[...] = actuation.moment_n_m
    there.stiffness_n_m2[...] = actuation.stiffness_n_m2
    if actuation.strain is not None and there.strain is not None:
        for own, values in zip(there.strain, actuation.strain, strict=True):
            own[...] = values


def tip_bend(tangent: Array, rate: Array, added_up_rad: Array) -> tuple[Array, Array]:
    """Return bend and bend rate, each (n, 2), of tips with these tangents (n, 3) and tangents' rates (n, 3).

    t = (sin|b| b / |b|, cos|b|) has the solutions b = (angle + 2 pi k) n with n the direction of t across z; taken is
    the one nearest to ``added_up_rad``, the curvature added up along the muscle, shape (n, 2). Where n is not defined,
    straight up or down, the bend is along ``added_up_rad``, and its rate that of t.
    """
    across = np.hypot(tangent[:, 0], tangent[:, 1])
    defined = across > 1e-9
    size = np.where(defined, across, 1.0)[:, None]
    along_sum = np.hypot(added_up_rad[:, 0], added_up_rad[:, 1])[:, None]
    fallback = np.where(along_sum > 0.0, added_up_rad / np.where(along_sum > 0.0, along_sum, 1.0), (1.0, 0.0))
    direction = np.where(defined[:, None], tangent[:, :2] / size, fallback)
    angle = np.arctan2(across, tangent[:, 2])
    sought = np.einsum("ni,ni->n", direction, added_up_rad)
    angle += 2.0 * np.pi * np.round((sought - angle) / (2.0 * np.pi))
    swing = np.einsum("ni,ni->n", direction, rate[:, :2])
    angle_rate = swing * tangent[:, 2] - rate[:, 2] * across
    # What is left turns the direction, at the rate aside / sin|b|.
    aside = rate[:, :2] - swing[:, None] * direction
    stretch = np.where(defined, angle / np.where(defined, across, 1.0), 1.0)
    return angle[:, None] * direction, angle_rate[:, None] * direction + stretch[:, None] * aside
