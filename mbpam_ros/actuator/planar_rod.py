"""The muscle as a planar, inextensible Kirchhoff rod in the posture of the paper's tests.

Clamped at the base, tip up, weight on. The active part obeys B kappa = M0 + (moment of the weight beyond), the ends
are straight and rigid. With r the distance from the tip along the rod and w the weight per length,

    d theta / dr = -m / B,   d m / dr = w r sin(theta),

from theta = theta_tip, m = M0 + w l^2 / 2 sin(theta_tip) at r = l (the straight tip), to theta = 0 at r = l + L.
Marched with the classical fourth-order Runge-Kutta scheme: explicit, accurate for steps far below the length on which
the weight bends the rod, (B / w)^(1/3) = 0.1 m against steps of 0.002 m; halving them changes the angle by 1e-8.

Solutions are followed from the weightless rod by raising gravity (Newton's method at each level): the branch a
muscle is on that was inflated upright. Branches on which a heavy column lies buckled the other way need a weight
w (L + 2 l)^3 / B above 7.84 (uniform column, no pressure); the initial design has 3.2, the softest one sampled 7.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from scipy.optimize import newton

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2

_STEPS = 50
_GRAVITY_LEVELS = (0.25, 0.5, 0.75, 1.0)


class RodSolutionError(RuntimeError):
    """No equilibrium was found for the rod."""


def rod_tip_angle(
    moment_n_m: float, stiffness_n_m2: float, geometry: MuscleGeometry, gravity_m_s2: float = GRAVITY_M_S2
) -> float:
    """Return the tip angle [rad] of the upright rod with intrinsic moment M0 and stiffness B.

    Raises:
        RodSolutionError: no equilibrium was found.
    """

    def clamp_angle(tip_angle_rad: float, weight_n_m: float) -> float:
        return _clamp_angle(tip_angle_rad, moment_n_m, 1.0 / stiffness_n_m2, geometry, weight_n_m)

    return _follow(clamp_angle, moment_n_m * geometry.active_length_m / stiffness_n_m2, geometry, gravity_m_s2)


def stiffness_for_tip_angle(
    tip_angle_rad: float, moment_n_m: float, geometry: MuscleGeometry, gravity_m_s2: float = GRAVITY_M_S2
) -> float:
    """Return the stiffness B [N m2] with which the upright rod of intrinsic moment M0 has that tip angle.

    Raises:
        RodSolutionError: no such stiffness was found.
    """

    def clamp_angle(compliance: float, weight_n_m: float) -> float:
        return _clamp_angle(tip_angle_rad, moment_n_m, compliance, geometry, weight_n_m)

    weightless = tip_angle_rad / (moment_n_m * geometry.active_length_m)
    return 1.0 / _follow(clamp_angle, weightless, geometry, gravity_m_s2)


def blocked_tip_force_per_moment(geometry: MuscleGeometry) -> float:
    """Return tip force over intrinsic moment [1/m] of the straight rod, its tip held by a prop.

    With x the distance from the tip, the prop's moment F x undoes the deflection that M0 makes there:
    F = M0 int(x) / int(x^2), integrals over the active part. Small deflection; no friction, no gravity.
    """
    near, far = geometry.end_length_m, geometry.end_length_m + geometry.active_length_m
    return (far**2 - near**2) / 2.0 / ((far**3 - near**3) / 3.0)


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


def _clamp_angle(
    tip_angle_rad: float, moment_n_m: float, compliance: float, geometry: MuscleGeometry, weight_n_m: float
) -> float:
    """Return theta at the clamped end of the active part when marching from the tip; 0 in equilibrium."""
    near, sine = geometry.end_length_m, math.sin
    step = geometry.active_length_m / _STEPS
    angle = tip_angle_rad
    moment = moment_n_m + 0.5 * weight_n_m * near**2 * sine(tip_angle_rad)
    for index in range(_STEPS):
        here = near + index * step
        middle, there = weight_n_m * (here + 0.5 * step), weight_n_m * (here + step)
        a1, m1 = -compliance * moment, weight_n_m * here * sine(angle)
        a2, m2 = -compliance * (moment + 0.5 * step * m1), middle * sine(angle + 0.5 * step * a1)
        a3, m3 = -compliance * (moment + 0.5 * step * m2), middle * sine(angle + 0.5 * step * a2)
        a4, m4 = -compliance * (moment + step * m3), there * sine(angle + step * a3)
        angle += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        moment += step / 6.0 * (m1 + 2.0 * m2 + 2.0 * m3 + m4)
    return angle
