r"""The muscle at rest as a spatial rod that bends, stretches and twists, under gravity and loads on its tip.

Clamped at the origin of the muscle frame, z along the straight muscle; an end of length d, straight and rigid but
where another one is asked for, an active part of unstretched length L, another end. With s the unstretched length from
the clamp, l = L + 2 d, R(s) the rotation of the section (third column t: the axis), n and m the force and moment that
what lies beyond exerts, and w the weight per length as a vector,

    R' = R [u]x,   u = (-b_y, b_x, tau),   r' = (1 + epsilon) t + gamma,
    n = F + w (l - s),   m' = -r' x n,   m(l) = T t,

where b are the curvature's bend components. F is a dead force at the centre of the tip's end face, T a torque about
the tip's current axis. From the law (:mod:`~mbpam_ros.actuator.rod_law`), with N = n . t and (m_1, m_2, m_3) = R^T m,

    B b = M0 + N c + (m_2, -m_1),   epsilon = epsilon_0 + c . b + N / EA,   tau = m_3 / GJ,   gamma = (n - N t) / GA,

so no unknown is left inside. It is a Kirchhoff rod, gamma = 0, but where the section says how it is sheared. A strain
that is left out is 0, and N c with the stretch. Where the law's curve is asked for instead of its line, the right
side's component e along M0 and the one across it give

    b_along = 2 e / (K + sqrt(K^2 + 4 Q e)),   K = B - Q kappa_free,   b_across = e_across / (B + S).

n is known beforehand. What is not is the tip's rotation: marched from an assumed one (classical Runge-Kutta on unit
quaternions, fourth order), the clamp's must come out as none. Newton's method in these three unknowns, slopes by
differences; without loads the clamp turns exactly as the tip does. Marching is explicit, accurate for steps far below
the length on which loads bend the rod, sqrt(B / F) and (B / w)^(1/3), some 0.1 m against 0.004 m: the tip is
off by 5e-7 of L at 100 kPa under a force of 0.06 N, a torque of 2 N mm and tilted gravity.

Where an end meets the waves, a joint may stand for what the end does to them (:mod:`~mbpam_ros.actuator.end_law`): at
the clamp's end, from the end on, a length along the end's axis, a turn, then a shift across the waves' axis; at the
tip's the mirror image, in reverse order.

Where several equilibria exist, the one returned is that which the unloaded muscle comes to when its weight is raised
first and the loads on its tip after it. Each level is reached with Newton steps that turn the tip by no more than
0.5 rad together, or is halved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import RodSolutionError
from mbpam_ros.actuator.rod_law import RodLaw, StrainLaw
from mbpam_ros.actuator.strains import STRAINS, check_strains
from mbpam_ros.geometry import rotations

Array = NDArray[np.float64]
Quaternion = rotations.Quaternion

BENDINGS = ("line", "curve")
"""How the bending moment follows the curvature: as the plant's, or as the unit cell's within 1 % of M0."""

STEPS = 24
"""Of the march along the active part."""

END_STEPS = 1
"""Of the march along each end: a rigid one is marched without error, and one of silicone bends by a few degrees."""

FREE_STEPS = 12
"""Of rods without loads on their tips, which are solved at 100 Hz: the tip is within 1e-5 of L."""

HANGING = (0.0, 0.0, GRAVITY_M_S2)
"""Gravity of a muscle that hangs from its clamp, in the muscle frame [m/s2]."""

_JOINT_PASSES = 3
"""What is left of a joint's turn is its cube's part: below 1e-6 rad."""
_NUDGE_RAD = 1e-6
_LAST_TURN_RAD = 1e-6
"""Newton's error after a turn this small is below 1e-10 rad."""
_MOST_ITERATIONS = 8
_LARGEST_TURN_RAD = 0.5
_FIRST_LEVEL = 0.25
_LEAST_LEVEL = 1e-4


class RodSection(NamedTuple):
    """The law of a rod at fixed pressures, per unstretched length.

    Args:
        moment_x_n_m, moment_y_n_m: M0 in bend components.
        stiffness_n_m2: B.
        free_stretch: epsilon_0.
        slope_x_m, slope_y_m: c in bend components.
        axial_compliance_per_n: 1 / EA; 0: it cannot be pulled longer.
        torsion_compliance_per_n_m2: 1 / GJ; 0: it cannot twist.
        stiffening_n_m3, side_n_m2: Q and S; 0: the bending moment is a line.
        shear_compliance_per_n: 1 / GA, the same all around; 0: sections stay across the axis.
    """

    moment_x_n_m: float
    moment_y_n_m: float
    stiffness_n_m2: float
    free_stretch: float = 0.0
    slope_x_m: float = 0.0
    slope_y_m: float = 0.0
    axial_compliance_per_n: float = 0.0
    torsion_compliance_per_n_m2: float = 0.0
    stiffening_n_m3: float = 0.0
    side_n_m2: float = 0.0
    shear_compliance_per_n: float = 0.0


RIGID = RodSection(0.0, 0.0, math.inf)
"""A section that does nothing."""


class EndJoint(NamedTuple):
    """What an end adds to the rod where it meets the active part; alike at both ends.

    Args:
        turn_x_rad, turn_y_rad: of the axis, in bend components.
        length_m: of the axis.
        shift_x_m, shift_y_m: of the active part's axis from the end's, in the directions of the bend components.
        compliance_per_n_m: what a bending moment adds to the turn [rad/(N m)]; below 0 where the end is stiffer than
            its section says.
    """

    turn_x_rad: float = 0.0
    turn_y_rad: float = 0.0
    length_m: float = 0.0
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0
    compliance_per_n_m: float = 0.0


NO_JOINT = EndJoint()
"""The active part goes on into the ends."""


@dataclass(frozen=True)
class RodLoads:
    """What acts on a muscle from outside, in the muscle frame.

    Args:
        tip_force_n: dead force at the centre of the tip's end face, (3,).
        tip_torque_n_m: torque about the tip's current axis, right-handed about its direction.
        gravity_m_s2: acceleration as a vector, (3,).

    Raises:
        ValueError: a vector is not three finite numbers, or the torque is not finite.
    """

    tip_force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_torque_n_m: float = 0.0
    gravity_m_s2: tuple[float, float, float] = HANGING

    def __post_init__(self) -> None:
        for name in ("tip_force_n", "gravity_m_s2"):
            if len(getattr(self, name)) != 3 or not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} must be three finite numbers, found {getattr(self, name)}")
        if not math.isfinite(self.tip_torque_n_m):
            raise ValueError(f"tip_torque_n_m must be finite, found {self.tip_torque_n_m}")


@dataclass(frozen=True, eq=False)
class RodAtRest:
    """The rod in equilibrium, in the muscle frame.

    Args:
        tip_position_m: centre of the tip's end face, shape (3,).
        tip_orientation_xyzw: unit quaternion of the tip's section, shape (4,).
        bend_rad: integral of the curvature's bend components over the length, shape (2,).
        centreline_m: the axis from clamp to tip, shape (steps + 2 END_STEPS + 1, 3).
    """

    tip_position_m: Array
    tip_orientation_xyzw: Array
    bend_rad: Array
    centreline_m: Array

    @property
    def tip_direction(self) -> Array:
        """Unit vector along the axis at the tip, shape (3,)."""
        return rotations.rotation_matrix(self.tip_orientation_xyzw)[:, 2]

    @property
    def tip_roll_rad(self) -> float:
        """Turn of the tip's section about its axis beside that of the shortest turn from z, -pi to pi.

        The twist of the swing and twist into which its rotation is cut, R = R_turn(z to t) R_z(roll).
        """
        _, _, z, w = self.tip_orientation_xyzw
        return math.remainder(2.0 * math.atan2(z, w), 2.0 * math.pi)

    @property
    def tip_angle_rad(self) -> float:
        """Angle between z and the tip's direction; beyond a half turn that of all 2 pi k + or - it next to the bend."""
        angle = math.acos(max(-1.0, min(1.0, float(self.tip_direction[2]))))
        turned = math.hypot(*self.bend_rad)
        turns = round(turned / (2.0 * math.pi))
        return min((abs(2.0 * math.pi * turns + sign * angle) for sign in (1.0, -1.0)), key=lambda x: abs(x - turned))


def rod_section(
    law: RodLaw, pressure_gauge_pa: ArrayLike, strains: Sequence[str] = STRAINS, bending: str = "line"
) -> RodSection:
    """Return what the pressures (4,) of chambers 1 to 4 make of a rod that can do ``strains``.

    Args:
        law: of the muscle.
        pressure_gauge_pa: shape (4,).
        strains: of :data:`STRAINS`.
        bending: of :data:`BENDINGS`.

    Raises:
        ValueError: an unknown strain or bending, ``bend`` is missing, or not four pressures.
        StrainLawError: the law says nothing of a strain or of its curve.
    """
    if bending not in BENDINGS:
        raise ValueError(f"unknown bending {bending!r}; known: {', '.join(BENDINGS)}")
    moment, stiffness = law.moment_and_stiffness(pressure_gauge_pa)
    of = _known_strains(law, pressure_gauge_pa, strains)
    section = RodSection(*_section_rows(moment, stiffness, of, strains).tolist())
    if bending == "line":
        return section
    curve, size = law.bend_curve(pressure_gauge_pa), float(np.hypot(*moment))
    along = float(curve.stiffening_n_m3 @ moment) / size if size > 0.0 else 0.0
    return section._replace(stiffening_n_m3=along, side_n_m2=float(curve.side_n_m2))


def _known_strains(law: RodLaw, pressure_gauge_pa: ArrayLike, strains: Sequence[str]) -> StrainLaw | None:
    check_strains(strains)
    return law.strain_law(pressure_gauge_pa) if len(strains) > 1 else None


def _section_rows(moment_n_m: Array, stiffness_n_m2: Array, of: StrainLaw | None, strains: Sequence[str]) -> Array:
    """Fields of :class:`RodSection` in the last axis, shape (..., 11): a line, and 0 for what ``strains`` leave out."""
    rows = np.zeros((*stiffness_n_m2.shape, len(RodSection._fields)))
    rows[..., :2], rows[..., 2] = moment_n_m, stiffness_n_m2
    if of is not None and "stretch" in strains:
        rows[..., 3], rows[..., 4:6] = of.free_stretch, of.stretch_per_curvature_m
        rows[..., 6] = 1.0 / of.axial_stiffness_n
    if of is not None and "twist" in strains:
        rows[..., 7] = 1.0 / of.torsion_stiffness_n_m2
    return rows


def solid_end(shear_modulus_pa: float, geometry: MuscleGeometry) -> RodSection:
    """Return the section of an end that is a solid cylinder of incompressible material: E = 3 G, GJ = G pi R^4 / 2."""
    area, second_moment = math.pi * geometry.outer_radius_m**2, 0.25 * math.pi * geometry.outer_radius_m**4
    return RodSection(
        0.0,
        0.0,
        3.0 * shear_modulus_pa * second_moment,
        axial_compliance_per_n=1.0 / (3.0 * shear_modulus_pa * area),
        torsion_compliance_per_n_m2=1.0 / (2.0 * shear_modulus_pa * second_moment),
    )


def rod_at_rest(
    section: RodSection,
    geometry: MuscleGeometry,
    loads: RodLoads | None = None,
    steps: int = STEPS,
    ends: RodSection = RIGID,
    joint: EndJoint = NO_JOINT,
) -> RodAtRest:
    """Return the equilibrium that the unloaded rod comes to as ``loads`` (default: hanging) are raised.

    Args:
        section: the law at fixed pressures.
        geometry: of the muscle; its mass per length is per unstretched length.
        loads: on it.
        steps: along the active part.
        ends: section of the two ends.
        joint: between each of them and the active part.

    Raises:
        RodSolutionError: the equilibrium was lost on the way; the message says where.
    """
    of = loads if loads is not None else RodLoads()
    sections = _Sections(RodSection(*map(float, section)), RodSection(*map(float, ends)), EndJoint(*map(float, joint)))
    shape, points = _shape(geometry), np.empty((steps + 2 * END_STEPS + 1, 3))
    tip, nothing = _unloaded_tip(section, shape, joint), np.zeros(7)
    weight, everything = (_packed(of, geometry, share) for share in (0.0, 1.0))
    for name, before, after in (("weight", nothing, weight), ("loads on its tip", weight, everything)):
        reached, tip = _followed(tip, sections, before, after, shape, points)
        if reached < 1.0:
            raise RodSolutionError(f"no equilibrium of the rod was found beyond {reached:.0%} of the {name}")
    bend = _march(tip, sections, everything, shape, points)[4:]
    return RodAtRest(points[-1].copy(), np.array(tip), np.array(bend), points)


@dataclass(frozen=True, eq=False)
class RodsAtRest:
    """Several rods in equilibrium, in their muscle frames; NaN where one is not known.

    Args:
        tip_position_m: centres of the tips' end faces, shape (n, 3).
        tip_orientation_xyzw: unit quaternions of the tips' sections, shape (n, 4).
        centreline_m: the axes from clamp to tip, shape (n, points, 3).
        arc_length_m: unstretched distance of their points from the clamp, shape (points,).
    """

    tip_position_m: Array
    tip_orientation_xyzw: Array
    centreline_m: Array
    arc_length_m: Array


class FreeRods:
    """Rods with nothing on their tips, solved from a good guess: for what runs at 100 Hz.

    The same equilibria as :func:`rod_at_rest`'s: where Newton's method does not find one from the guess, the loads are
    raised as there.

    Args:
        law: of the muscles.
        geometry: of the muscles.
        strains: what they may do.

    Raises:
        ValueError: unknown strains.
    """

    def __init__(self, law: RodLaw, geometry: MuscleGeometry, strains: Sequence[str] = STRAINS) -> None:
        check_strains(strains)
        self._law, self._geometry, self._strains, self._shape = law, geometry, tuple(strains), _shape(geometry)
        end, active = geometry.end_length_m, geometry.active_length_m
        self._arc_length = np.concatenate(
            [
                np.linspace(0.0, end, END_STEPS, endpoint=False),
                np.linspace(end, end + active, FREE_STEPS, endpoint=False),
                np.linspace(end + active, geometry.length_m, END_STEPS + 1),
            ]
        )

    def at_rest(
        self,
        moment_n_m: Array,
        pressure_gauge_pa: Array,
        gravity_m_s2: Sequence[float],
        near_bend_rad: Array,
    ) -> RodsAtRest:
        """Return the rods with intrinsic moments (n, 2), stiffnesses and strains of pressures (n, 4).

        Args:
            moment_n_m: M0, which need not be that of the pressures.
            pressure_gauge_pa: of chambers 1 to 4.
            gravity_m_s2: acceleration in the muscle frames, (3,).
            near_bend_rad: constant curvatures whose tips point nearly as the rods', (n, 2).

        Raises:
            StrainLawError: the law says nothing of a strain.
        """
        stiffness = self._law.moment_and_stiffness(pressure_gauge_pa)[1]
        of = _known_strains(self._law, pressure_gauge_pa, self._strains)
        rows = _section_rows(moment_n_m, stiffness, of, self._strains)
        loads = _packed(RodLoads(gravity_m_s2=_three(gravity_m_s2)), self._geometry, 0.0)
        tips, points = _solved_near(rows, loads, self._shape, near_bend_rad, RIGID, self._arc_length.size)
        return RodsAtRest(points[:, -1], tips, points, self._arc_length)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


class _Sections(NamedTuple):
    """Of the active part and of the ends, and what is between them."""

    active: RodSection
    ends: RodSection
    joint: EndJoint


class _Shape(NamedTuple):
    """Active length and length of an end [m]."""

    active_m: float
    end_m: float


def _shape(geometry: MuscleGeometry) -> _Shape:
    return _Shape(geometry.active_length_m, geometry.end_length_m)


def _packed(loads: RodLoads, geometry: MuscleGeometry, tip_share: float) -> Array:
    """Weight per length (3) [N/m], tip force (3) [N], torque [N m]; the last four times ``tip_share``."""
    packed = np.empty(7)
    packed[:3] = geometry.mass_per_length_kg_m * np.array(loads.gravity_m_s2)
    packed[3:6] = tip_share * np.array(loads.tip_force_n)
    packed[6] = tip_share * loads.tip_torque_n_m
    return packed


def _unloaded_tip(section: RodSection, shape: _Shape, joint: EndJoint) -> Quaternion:
    turned = shape.active_m / section.stiffness_n_m2
    bent = _turn(-turned * section.moment_y_n_m, turned * section.moment_x_n_m, 0.0)
    at_end = _turn(-joint.turn_y_rad, joint.turn_x_rad, 0.0)
    tip: Quaternion = _product(_product(at_end, bent), at_end)
    return tip


_product = njit(cache=True)(rotations.product)


@njit(cache=True)
def _turn(x: float, y: float, z: float) -> Quaternion:
    """Quaternion of the rotation vector (x, y, z) [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    size = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return size * x, size * y, size * z, math.cos(0.5 * angle)


@njit(cache=True, error_model="numpy")
def _bend(load_x: float, load_y: float, section: RodSection) -> tuple[float, float]:
    """Curvature's bend components under M0 and what else bends [N m]; NaN where the curve has none."""
    size = math.sqrt(section.moment_x_n_m**2 + section.moment_y_n_m**2)
    if size == 0.0 or (section.stiffening_n_m3 == 0.0 and section.side_n_m2 == 0.0):
        return load_x / section.stiffness_n_m2, load_y / section.stiffness_n_m2
    x, y = section.moment_x_n_m / size, section.moment_y_n_m / size
    along, across = load_x * x + load_y * y, load_y * x - load_x * y
    start = section.stiffness_n_m2 - section.stiffening_n_m3 * size / section.stiffness_n_m2
    along *= 2.0 / (start + math.sqrt(start**2 + 4.0 * section.stiffening_n_m3 * along))
    across /= section.stiffness_n_m2 + section.side_n_m2
    return along * x - across * y, along * y + across * x


@njit(cache=True, error_model="numpy")
def _slopes(state: Array, beyond_m: float, section: RodSection, loads: Array, slopes: Array) -> None:
    """Slopes of rotation (4), moment (3), position (3) and bend (2) over s, ``beyond_m`` before the tip's end face."""
    x, y, z, w = state[0], state[1], state[2], state[3]
    # Columns of R: the section's axes, the third along the rod.
    a0, a1, a2 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)
    b0, b1, b2 = 2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)
    t0, t1, t2 = 2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)
    n0 = loads[3] + beyond_m * loads[0]
    n1 = loads[4] + beyond_m * loads[1]
    n2 = loads[5] + beyond_m * loads[2]
    pull = n0 * t0 + n1 * t1 + n2 * t2
    first = a0 * state[4] + a1 * state[5] + a2 * state[6]
    second = b0 * state[4] + b1 * state[5] + b2 * state[6]
    third = t0 * state[4] + t1 * state[5] + t2 * state[6]
    bend_x, bend_y = _bend(
        section.moment_x_n_m + pull * section.slope_x_m + second,
        section.moment_y_n_m + pull * section.slope_y_m - first,
        section,
    )
    twist = third * section.torsion_compliance_per_n_m2
    stretch = 1.0 + section.free_stretch + section.slope_x_m * bend_x + section.slope_y_m * bend_y
    stretch += pull * section.axial_compliance_per_n
    slopes[0] = 0.5 * (-w * bend_y + y * twist - z * bend_x)
    slopes[1] = 0.5 * (w * bend_x - z * bend_y - x * twist)
    slopes[2] = 0.5 * (w * twist + x * bend_x + y * bend_y)
    slopes[3] = 0.5 * (x * bend_y - y * bend_x - z * twist)
    shear = section.shear_compliance_per_n
    along = stretch - shear * pull
    slopes[7], slopes[8], slopes[9] = along * t0 + shear * n0, along * t1 + shear * n1, along * t2 + shear * n2
    slopes[4] = -along * (t1 * n2 - t2 * n1)  # what shears is along n
    slopes[5] = -along * (t2 * n0 - t0 * n2)
    slopes[6] = -along * (t0 * n1 - t1 * n0)
    slopes[10], slopes[11] = bend_x, bend_y


@njit(cache=True)
def _pass_joint(state: Array, beyond_m: float, joint: EndJoint, loads: Array, is_tip: bool) -> None:
    """Step over a joint toward the clamp, ``beyond_m`` before the tip's end face."""
    force = (loads[3] + beyond_m * loads[0], loads[4] + beyond_m * loads[1], loads[5] + beyond_m * loads[2])
    if is_tip:
        _step_back(state, (0.0, 0.0, joint.length_m), force)
        _turn_back(state, joint)
        _step_back(state, (-joint.shift_x_m, -joint.shift_y_m, 0.0), force)
    else:
        _step_back(state, (joint.shift_x_m, joint.shift_y_m, 0.0), force)
        _turn_back(state, joint)
        _step_back(state, (0.0, 0.0, joint.length_m), force)


@njit(cache=True)
def _step_back(state: Array, way: tuple[float, float, float], force: tuple[float, float, float]) -> None:
    """Step over a rigid way in the section's axes, on which ``force`` acts from beyond."""
    x, y, z, w = state[0], state[1], state[2], state[3]
    u, v, t = way
    way_0 = (1.0 - 2.0 * (y * y + z * z)) * u + 2.0 * (x * y - z * w) * v + 2.0 * (x * z + y * w) * t
    way_1 = 2.0 * (x * y + z * w) * u + (1.0 - 2.0 * (x * x + z * z)) * v + 2.0 * (y * z - x * w) * t
    way_2 = 2.0 * (x * z - y * w) * u + 2.0 * (y * z + x * w) * v + (1.0 - 2.0 * (x * x + y * y)) * t
    state[4] += way_1 * force[2] - way_2 * force[1]
    state[5] += way_2 * force[0] - way_0 * force[2]
    state[6] += way_0 * force[1] - way_1 * force[0]
    state[7] -= way_0
    state[8] -= way_1
    state[9] -= way_2


@njit(cache=True)
def _turn_back(state: Array, joint: EndJoint) -> None:
    """Undo a joint's turn. Its energy has as its slope the moment in the section half way through it."""
    tip = (state[0], state[1], state[2], state[3])
    turn_x, turn_y = joint.turn_x_rad, joint.turn_y_rad
    for _ in range(_JOINT_PASSES):
        x, y, z, w = _product(tip, _turn(0.5 * turn_y, -0.5 * turn_x, 0.0))
        first = (1.0 - 2.0 * (y * y + z * z)) * state[4] + 2.0 * (x * y + z * w) * state[5]
        first += 2.0 * (x * z - y * w) * state[6]
        second = 2.0 * (x * y - z * w) * state[4] + (1.0 - 2.0 * (x * x + z * z)) * state[5]
        second += 2.0 * (y * z + x * w) * state[6]
        turn_x = joint.turn_x_rad + joint.compliance_per_n_m * second
        turn_y = joint.turn_y_rad - joint.compliance_per_n_m * first
    state[0], state[1], state[2], state[3] = _product(tip, _turn(turn_y, -turn_x, 0.0))
    state[10] -= turn_x
    state[11] -= turn_y


@njit(cache=True, error_model="numpy")
def _march(
    tip: Quaternion, sections: _Sections, loads: Array, shape: _Shape, points: Array
) -> tuple[float, float, float, float, float, float]:
    """March from the tip's rotation to the clamp; return the rotation there and the bend. Fills ``points``."""
    state, ahead, slopes = np.zeros(12), np.empty(12), np.empty((4, 12))
    x, y, z, w = tip
    state[0], state[1], state[2], state[3] = x, y, z, w
    state[4] = loads[6] * 2.0 * (x * z + y * w)
    state[5] = loads[6] * 2.0 * (y * z - x * w)
    state[6] = loads[6] * (1.0 - 2.0 * (x * x + y * y))
    last = points.shape[0] - 1
    points[last] = 0.0
    beyond = 0.0
    for index in range(last):
        is_end = index < END_STEPS or index >= last - END_STEPS
        if index == END_STEPS:
            _pass_joint(state, beyond, sections.joint, loads, True)
        elif index == last - END_STEPS:
            _pass_joint(state, beyond, sections.joint, loads, False)
        section = sections.ends if is_end else sections.active
        step = shape.end_m / END_STEPS if is_end else shape.active_m / (last - 2 * END_STEPS)
        _slopes(state, beyond, section, loads, slopes[0])
        for i in range(12):
            ahead[i] = state[i] - 0.5 * step * slopes[0, i]
        _slopes(ahead, beyond + 0.5 * step, section, loads, slopes[1])
        for i in range(12):
            ahead[i] = state[i] - 0.5 * step * slopes[1, i]
        _slopes(ahead, beyond + 0.5 * step, section, loads, slopes[2])
        for i in range(12):
            ahead[i] = state[i] - step * slopes[2, i]
        beyond += step
        _slopes(ahead, beyond, section, loads, slopes[3])
        for i in range(12):
            rise = slopes[0, i] + 2.0 * (slopes[1, i] + slopes[2, i]) + slopes[3, i]
            state[i] -= step / 6.0 * rise
        size = math.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
        for i in range(4):
            state[i] /= size
        for i in range(3):
            points[last - 1 - index, i] = state[7 + i]
    for i in range(3):
        for place in range(last + 1):
            points[place, i] -= state[7 + i]
    return state[0], state[1], state[2], state[3], -state[10], -state[11]


@njit(cache=True)
def _clamp_turn(
    tip: Quaternion, sections: _Sections, loads: Array, shape: _Shape, points: Array
) -> tuple[float, float, float]:
    """Rotation vector [rad] of the clamp after a march from ``tip``: 0 in equilibrium."""
    x, y, z, w, _, _ = _march(tip, sections, loads, shape, points)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    per = 2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, w) / sine
    return per * x, per * y, per * z


@njit(cache=True, error_model="numpy")
def _solved(
    tip: Quaternion, sections: _Sections, loads: Array, shape: _Shape, points: Array
) -> tuple[bool, Quaternion]:
    """Newton's method from ``tip``: whether an equilibrium was found near it, and the tip there."""
    turned = 0.0
    for _ in range(_MOST_ITERATIONS):
        r0, r1, r2 = _clamp_turn(tip, sections, loads, shape, points)
        if not abs(r0) + abs(r1) + abs(r2) < 1e3:
            return False, tip
        x0, x1, x2 = _clamp_turn(_product(_turn(_NUDGE_RAD, 0.0, 0.0), tip), sections, loads, shape, points)
        y0, y1, y2 = _clamp_turn(_product(_turn(0.0, _NUDGE_RAD, 0.0), tip), sections, loads, shape, points)
        z0, z1, z2 = _clamp_turn(_product(_turn(0.0, 0.0, _NUDGE_RAD), tip), sections, loads, shape, points)
        x0, x1, x2 = (x0 - r0) / _NUDGE_RAD, (x1 - r1) / _NUDGE_RAD, (x2 - r2) / _NUDGE_RAD
        y0, y1, y2 = (y0 - r0) / _NUDGE_RAD, (y1 - r1) / _NUDGE_RAD, (y2 - r2) / _NUDGE_RAD
        z0, z1, z2 = (z0 - r0) / _NUDGE_RAD, (z1 - r1) / _NUDGE_RAD, (z2 - r2) / _NUDGE_RAD
        # Cramer's rule: columns x, y, z.
        p0, p1, p2 = y1 * z2 - y2 * z1, y2 * z0 - y0 * z2, y0 * z1 - y1 * z0
        determinant = x0 * p0 + x1 * p1 + x2 * p2
        if abs(determinant) < 1e-12:
            return False, tip
        along_x = -(r0 * p0 + r1 * p1 + r2 * p2) / determinant
        q0, q1, q2 = r1 * z2 - r2 * z1, r2 * z0 - r0 * z2, r0 * z1 - r1 * z0
        along_y = -(x0 * q0 + x1 * q1 + x2 * q2) / determinant
        s0, s1, s2 = y1 * r2 - y2 * r1, y2 * r0 - y0 * r2, y0 * r1 - y1 * r0
        along_z = -(x0 * s0 + x1 * s1 + x2 * s2) / determinant
        turned += abs(along_x) + abs(along_y) + abs(along_z)
        if turned > _LARGEST_TURN_RAD:
            return False, tip
        tip = _product(_turn(along_x, along_y, along_z), tip)
        if abs(along_x) + abs(along_y) + abs(along_z) < _LAST_TURN_RAD:
            return True, tip
    return False, tip


@njit(cache=True)
def _followed(
    tip: Quaternion, sections: _Sections, start: Array, end: Array, shape: _Shape, points: Array
) -> tuple[float, Quaternion]:
    """Follow the equilibrium from loads ``start`` to ``end``; return how far it was found, up to 1, and the tip."""
    reached, level = 1.0 if (start == end).all() else 0.0, _FIRST_LEVEL
    while reached < 1.0:
        level = min(level, 1.0 - reached)
        found, there = _solved(tip, sections, start + (reached + level) * (end - start), shape, points)
        if found:
            tip, reached, level = there, reached + level, 1.5 * level
            if reached > 1.0 - 1e-12:
                reached = 1.0
        else:
            level *= 0.5
            if level < _LEAST_LEVEL:
                break
    return reached, tip


@njit(cache=True)
def _solved_near(
    rows: Array, loads: Array, shape: _Shape, near_bend_rad: Array, ends: RodSection, count: int
) -> tuple[Array, Array]:
    """Rotations of the tips (n, 4) and ``count`` points from clamp to tip (n, count, 3)."""
    tips, lines = np.full((rows.shape[0], 4), np.nan), np.full((rows.shape[0], count, 3), np.nan)
    points, nothing = np.empty((count, 3)), np.zeros(7)
    for i in range(rows.shape[0]):
        if np.isnan(rows[i]).any() or np.isnan(near_bend_rad[i]).any():
            continue
        of = rows[i]
        section = RodSection(of[0], of[1], of[2], of[3], of[4], of[5], of[6], of[7], of[8], of[9], of[10])
        sections = _Sections(section, ends, NO_JOINT)
        found, tip = _solved(_turn(-near_bend_rad[i, 1], near_bend_rad[i, 0], 0.0), sections, loads, shape, points)
        if not found:
            turned = shape.active_m / section.stiffness_n_m2
            start = _turn(-turned * section.moment_y_n_m, turned * section.moment_x_n_m, 0.0)
            reached, tip = _followed(start, sections, nothing, loads, shape, points)
            if reached < 1.0:
                continue
        _march(tip, sections, loads, shape, points)
        tips[i, 0], tips[i, 1], tips[i, 2], tips[i, 3] = tip
        lines[i] = points
    return tips, lines
