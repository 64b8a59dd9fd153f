"""The muscle as a planar Kirchhoff rod in the posture of the paper's tests.

Clamped at the base, tip up, weight on. The active part obeys B kappa = M0 + (moment of the forces beyond), the ends
are straight and rigid. With r the unstretched distance from the tip along the rod, w the weight per length, theta the
angle from the vertical, s the axis's stretch and a horizontal push N and an upright force T from a plate on the tip,

    d theta / dr = -kappa,   kappa = (m + A s1) / B,   s = s0 + s1 kappa + A / EA,
    A = -N sin(theta) + (T - w r) cos(theta),
    d m / dr = s (w r sin(theta) - N cos(theta) - T sin(theta)),   d(x, z)/dr = s (sin(theta), cos(theta)),

to theta = 0 at r = l + L. The plate is parallel to the clamped axis and touches the rim of the tip, of radius R: at
r = l (the straight tip) theta = theta_tip and

    m = M0 + R (N sin(theta) - T cos(theta)) - l (N cos(theta) + T sin(theta)) + w l^2 / 2 sin(theta).

Marched with the classical fourth-order Runge-Kutta scheme: explicit, accurate for steps far below the length on which
the weight bends the rod, (B / w)^(1/3) = 0.1 m against steps of 0.008 m; halving them changes angle and force by 1e-5.

Solutions are followed from the weightless rod by raising gravity (Newton's method at each level): the branch a
muscle is on that was inflated upright. Branches on which a heavy column lies buckled the other way need a weight
w (L + 2 l)^3 / B above 7.84 (uniform column, no pressure); the initial design has 3.0, the softest of the domain 6.7.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import newton

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.errors import MbpamError

_STEPS = 12
_NOWHERE = np.empty((0, 2))
_GRAVITY_LEVELS = (0.25, 0.5, 0.75, 1.0)
_AXIS_POINTS = 51


class RodSolutionError(MbpamError, RuntimeError):
    """No equilibrium was found for the rod."""


class AxisStretch(NamedTuple):
    """Stretch of the axis, s = ``straight`` + ``per_curvature_m`` kappa + ``compliance_per_n`` A, A the axial force.

    By default it keeps its length. An axis that is stretched by bending bends when it is pulled, by A s1: both come
    from one energy (:mod:`~mbpam_ros.actuator.rod_law`).
    """

    straight: float = 1.0
    per_curvature_m: float = 0.0
    compliance_per_n: float = 0.0


INEXTENSIBLE = AxisStretch()


class Shot(NamedTuple):
    """What marching from an assumed tip gave: angle at the clamp [rad] (0 in equilibrium), place of the tip's rim [m].

    ``rim_x_m`` counts from where the straight rod's rim is, ``rim_z_m`` from the clamp.
    """

    clamp_angle_rad: float
    rim_x_m: float
    rim_z_m: float


def rod_tip_angle(
    moment_n_m: float,
    stiffness_n_m2: float,
    geometry: MuscleGeometry,
    gravity_m_s2: float = GRAVITY_M_S2,
    stretch: AxisStretch = INEXTENSIBLE,
) -> float:
    """Return the tip angle [rad] of the free upright rod with intrinsic moment M0 and stiffness B.

    Raises:
        RodSolutionError: no equilibrium was found.
    """

    def clamp_angle(tip_angle_rad: float, weight_n_m: float) -> float:
        return shoot(tip_angle_rad, moment_n_m, 1.0 / stiffness_n_m2, geometry, weight_n_m, stretch).clamp_angle_rad

    return _follow(clamp_angle, moment_n_m * geometry.active_length_m / stiffness_n_m2, geometry, gravity_m_s2)


def stiffness_for_tip_angle(
    tip_angle_rad: float,
    moment_n_m: float,
    geometry: MuscleGeometry,
    gravity_m_s2: float = GRAVITY_M_S2,
    stretch: AxisStretch = INEXTENSIBLE,
) -> float:
    """Return the stiffness B [N m2] with which the free upright rod of intrinsic moment M0 has that tip angle.

    Raises:
        RodSolutionError: no such stiffness was found.
    """

    def clamp_angle(compliance: float, weight_n_m: float) -> float:
        return shoot(tip_angle_rad, moment_n_m, compliance, geometry, weight_n_m, stretch).clamp_angle_rad

    weightless = tip_angle_rad / (moment_n_m * geometry.active_length_m)
    return 1.0 / _follow(clamp_angle, weightless, geometry, gravity_m_s2)


def blocked_tip_force_per_moment(geometry: MuscleGeometry) -> float:
    """Return tip force over intrinsic moment [1/m] of the straight rod, its tip held by a prop.

    With x the distance from the tip, the prop's moment F x undoes the deflection that M0 makes there:
    F = M0 int(x) / int(x^2), integrals over the active part. Small deflection; no friction, no gravity, no stretch:
    the limit that :mod:`~mbpam_ros.actuator.blocked_rod` tends to.
    """
    near, far = geometry.end_length_m, geometry.end_length_m + geometry.active_length_m
    return (far**2 - near**2) / 2.0 / ((far**3 - near**3) / 3.0)


def shoot(
    tip_angle_rad: float,
    moment_n_m: float,
    compliance: float,
    geometry: MuscleGeometry,
    weight_n_m: float,
    stretch: AxisStretch = INEXTENSIBLE,
    push_n: float = 0.0,
    upright_n: float = 0.0,
    marched_m: NDArray[np.float64] = _NOWHERE,
) -> Shot:
    """March from an assumed tip to the clamp.

    Args:
        tip_angle_rad: theta_tip.
        moment_n_m, compliance: M0 and 1 / B [1/(N m2)].
        geometry: of the muscle.
        weight_n_m: w [N/m].
        stretch: of the axis.
        push_n, upright_n: N and T.
        marched_m: (_STEPS + 1, 2), filled with the places passed from the tip on; or empty.
    """
    clamp_angle, rim_x, rim_z = _march(
        tip_angle_rad,
        moment_n_m,
        compliance,
        geometry.outer_radius_m,
        geometry.end_length_m,
        geometry.active_length_m,
        weight_n_m,
        stretch,
        push_n,
        upright_n,
        marched_m,
    )
    return Shot(clamp_angle, rim_x, rim_z)


def upright_axis_m(
    tip_angle_rad: float,
    moment_n_m: float,
    stiffness_n_m2: float,
    geometry: MuscleGeometry,
    stretch: AxisStretch = INEXTENSIBLE,
    push_n: float = 0.0,
    upright_n: float = 0.0,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> NDArray[np.float64]:
    """Return points (x, z) of the axis from clamp to tip, shape (51, 2) [m]; the arguments are a solution's."""
    marched = np.empty((_STEPS + 1, 2))
    weight = geometry.mass_per_length_kg_m * gravity_m_s2
    end = geometry.end_length_m
    shoot(tip_angle_rad, moment_n_m, 1.0 / stiffness_n_m2, geometry, weight, stretch, push_n, upright_n, marched)
    marched = (0.0, end) + (marched[-1] - marched[::-1])
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(marched, axis=0).T)))
    tip = np.array([math.sin(tip_angle_rad), math.cos(tip_angle_rad)])
    active_axis = CubicSpline(way, marched, bc_type=((1, np.array([0.0, 1.0])), (1, tip)))
    between = active_axis(np.linspace(0.0, way[-1], _AXIS_POINTS - 2))
    axis: NDArray[np.float64] = np.concatenate([[[0.0, 0.0]], between, [between[-1] + end * tip]])
    return axis


@njit(cache=True)
def _march(
    tip_angle: float,
    intrinsic: float,
    compliance: float,
    radius: float,
    end: float,
    active: float,
    weight: float,
    stretch: AxisStretch,
    push: float,
    upright: float,
    passed: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Angle at the clamp and place of the rim (x, z); SI units. Fills ``passed`` with each step's way from the rim."""
    straight, slope, yielding = stretch
    step = active / _STEPS
    half = 0.5 * step
    angle = tip_angle
    s, c = math.sin(angle), math.cos(angle)
    moment = intrinsic + radius * (push * s - upright * c)
    moment += -end * (push * c + upright * s) + 0.5 * weight * end**2 * s
    x, z = end * s + radius * (c - 1.0), end * (1.0 + c) - radius * s
    for index in range(_STEPS):
        if passed.shape[0] > 0:
            passed[index, 0], passed[index, 1] = x, z
        load = weight * (end + index * step) - upright
        middle, there = load + weight * half, load + weight * step
        a1, m1, x1, z1 = _slopes(load, angle, moment, intrinsic, compliance, push, straight, slope, yielding)
        a2, m2, x2, z2 = _slopes(
            middle, angle + half * a1, moment + half * m1, intrinsic, compliance, push, straight, slope, yielding
        )
        a3, m3, x3, z3 = _slopes(
            middle, angle + half * a2, moment + half * m2, intrinsic, compliance, push, straight, slope, yielding
        )
        a4, m4, x4, z4 = _slopes(
            there, angle + step * a3, moment + step * m3, intrinsic, compliance, push, straight, slope, yielding
        )
        angle += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        moment += step / 6.0 * (m1 + 2.0 * m2 + 2.0 * m3 + m4)
        x += step / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4)
        z += step / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
    if passed.shape[0] > 0:
        passed[_STEPS, 0], passed[_STEPS, 1] = x, z
    return angle, x, z


@njit(cache=True)
def _slopes(
    load: float,
    angle: float,
    moment: float,
    intrinsic: float,
    compliance: float,
    push: float,
    straight: float,
    slope: float,
    yielding: float,
) -> tuple[float, float, float, float]:
    """Slopes of angle, moment and place over the way from the tip."""
    s, c = math.sin(angle), math.cos(angle)
    axial = -push * s - load * c
    curvature = compliance * (moment + axial * slope)
    stretched = straight + slope * curvature + yielding * axial
    across, along = stretched * s, stretched * c
    return -curvature, load * across - push * along, across, along


def _follow(
    residual: Callable[[float, float], float], weightless: float, geometry: MuscleGeometry, gravity_m_s2: float
) -> float:
    """Follow the root of ``residual(x, weight per length)`` from ``weightless`` to full gravity."""
    root = weightless
    for level in _GRAVITY_LEVELS:
        weight = level * geometry.mass_per_length_kg_m * gravity_m_s2
        try:
            root = float(newton(residual, root, args=(weight,), x1=root * 1.001 + 1e-9, tol=1e-11 * (1.0 + abs(root))))
        except RuntimeError as error:
            raise RodSolutionError(f"no equilibrium of the upright rod at {level:.0%} of gravity: {error}") from error
    if root < -1e-9:
        raise RodSolutionError(f"the upright rod's equilibrium left the branch of the weightless one (found {root:g})")
    return root
