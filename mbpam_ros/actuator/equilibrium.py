"""Gravity on a muscle of constant curvature, and the bend at which it comes to rest.

A muscle hangs from its clamp, gravity along +z of the muscle frame. With theta = |bend|, L the active length, l the
length of a straight end and w the weight per length, the potential energy of gravity, zero when straight, is

    V(theta) = w [L^2 (1/2 - A) + l L (1 - D) + l^2/2 (1 - cos theta)],
    A = (1 - cos theta) / theta^2,  D = sin theta / theta.

Virtual work over the active length, where the bending moment is B theta / L - M0, gives the generalised balance
(B / L) bend + dV/dbend = M0. The bend lies along M0, so one scalar equation is left.

In any other posture, with gravity's components g across z and the one along it in the place of 9.81,

    V(bend) = V(theta) - m' (g . bend) S(theta),   S = L^2 C + l L A + l^2 D / 2,   C = (1 - D) / theta^2,

m' being the mass per length and S bend the integral of the muscle's sideways position over its length; the balance has
two components then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.design import MuscleGeometry

GRAVITY_M_S2 = 9.81

_SMALLEST_ANGLE_RAD = 1e-3
"""Below it the even quotients are evaluated here: off by 1e-7 of their value, less than rounding would cost."""
_LAST_STEP_RAD = 1e-5
"""Newton's error after a step this small is below 1e-10 rad."""
_MOST_ITERATIONS = 50
_LONGEST_STEP_RAD = 0.5


def gravity_energy_j(
    bend_rad: ArrayLike, geometry: MuscleGeometry, gravity_m_s2: float = GRAVITY_M_S2
) -> NDArray[np.float64]:
    """Return the potential energy V [J] of hanging muscles bent by ``bend_rad`` (..., 2), zero when straight."""
    angle = _magnitude(np.asarray(bend_rad, dtype=float))
    active, end = geometry.active_length_m, geometry.end_length_m
    shape = 0.5 * active**2 * (1.0 - np.sinc(0.5 * angle / np.pi) ** 2)
    shape += end * active * (1.0 - np.sinc(angle / np.pi)) + 0.5 * end**2 * (1.0 - np.cos(angle))
    return geometry.mass_per_length_kg_m * gravity_m_s2 * shape


def gravity_gradient_n_m(
    bend_rad: ArrayLike, geometry: MuscleGeometry, gravity_m_s2: float = GRAVITY_M_S2
) -> NDArray[np.float64]:
    """Return dV/dbend [N m], shape (..., 2), for bends of shape (..., 2): what gravity asks of the muscle."""
    bend = np.asarray(bend_rad, dtype=float)
    secant, _ = gravity_stiffness_n_m(_magnitude(bend), geometry, gravity_m_s2)
    asked: NDArray[np.float64] = secant[..., None] * bend
    return asked


def gravity_stiffness_n_m(
    angle_rad: ArrayLike, geometry: MuscleGeometry, gravity_m_s2: float = GRAVITY_M_S2
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the secant V'/theta and the tangent V'' [N m/rad] of gravity at theta = ``angle_rad`` >= 0, any shape."""
    return _gravity_stiffness(np.asarray(angle_rad, dtype=float), _gravity(geometry, gravity_m_s2))


def hanging_bend(
    moment_n_m: ArrayLike,
    stiffness_n_m2: ArrayLike,
    geometry: MuscleGeometry,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> NDArray[np.float64]:
    """Return the bend at which hanging muscles rest.

    Newton's method on g(theta) = (B / L) theta + V'(theta) - |M0|, kept inside a bracket that shrinks with every sign
    of g and halves when Newton would leave it. g rises monotonically wherever B / L exceeds the steepest fall of V'
    (0.0014 N m/rad for the default geometry, against B / L above 0.0045 in the sampled domain), so there is one
    solution.

    Args:
        moment_n_m: intrinsic moments M0 in bend components, shape (..., 2).
        stiffness_n_m2: bending stiffness B > 0, shape (...).
        geometry: of the muscle.
        gravity_m_s2: acceleration along +z of the muscle frame; 0 switches it off.

    Returns:
        Bend [rad], shape (..., 2); NaN where the moment or the stiffness is NaN.
    """
    moment = np.asarray(moment_n_m, dtype=float)
    spring = np.asarray(stiffness_n_m2, dtype=float) / geometry.active_length_m
    shape = spring.shape
    if moment.shape[:-1] != shape:
        shape = np.broadcast_shapes(moment.shape[:-1], shape)
        moment, spring = np.broadcast_to(moment, (*shape, 2)), np.broadcast_to(spring, shape)
    loads, springs = moment.reshape(-1, 2), spring.reshape(-1)
    gravity = _gravity(geometry, gravity_m_s2)
    reach = geometry.mass_per_length_kg_m * abs(gravity_m_s2) * geometry.length_m**2
    return _rest(loads, springs, gravity, reach).reshape(*shape, 2)


def resting_bend(
    moment_n_m: ArrayLike, stiffness_n_m2: ArrayLike, geometry: MuscleGeometry, gravity_m_s2: ArrayLike
) -> NDArray[np.float64]:
    """Return the bend at which muscles rest under gravity of any direction.

    :func:`hanging_bend` for its component along z; then, if there is one across, Newton's method in both components.
    V is least where a muscle points down; while B / L exceeds the steepest fall of its slope (0.0023 N m/rad, upright
    and straight, for the default geometry) there is one solution.

    Args:
        moment_n_m: intrinsic moments M0 in bend components, shape (..., 2).
        stiffness_n_m2: bending stiffness B > 0, shape (...).
        geometry: of the muscle.
        gravity_m_s2: acceleration in the muscle frame, shape (3,).

    Returns:
        Bend [rad], shape (..., 2); NaN where the moment or the stiffness is NaN.
    """
    gravity = np.asarray(gravity_m_s2, dtype=float)
    bend = hanging_bend(moment_n_m, stiffness_n_m2, geometry, float(gravity[2]))
    if gravity[0] == 0.0 and gravity[1] == 0.0:
        return bend
    moment = np.broadcast_to(moment_n_m, bend.shape).reshape(-1, 2)
    spring = np.broadcast_to(stiffness_n_m2, bend.shape[:-1]).reshape(-1) / geometry.active_length_m
    along, across = _gravity(geometry, float(gravity[2])), _across(geometry, gravity)
    return _tilted(bend.reshape(-1, 2), moment, spring, along, across).reshape(bend.shape)


def holding_moment_n_m(
    bend_rad: ArrayLike, stiffness_n_m2: ArrayLike, geometry: MuscleGeometry, gravity_m_s2: ArrayLike
) -> NDArray[np.float64]:
    """Return the intrinsic moments (n, 2) [N m] with which muscles would rest in the bends (n, 2).

    The balance (B / L) bend + dV/dbend = M0 read the other way: the inverse of :func:`resting_bend`. NaN where the bend
    or the stiffness (n,) is.
    """
    gravity = np.asarray(gravity_m_s2, dtype=float)
    spring = np.asarray(stiffness_n_m2, dtype=float) / geometry.active_length_m
    return _held(
        np.asarray(bend_rad, dtype=float), spring, _gravity(geometry, float(gravity[2])), _across(geometry, gravity)
    )


class _Gravity(NamedTuple):
    """w L^2, w l L and w l^2 / 2 [N m]."""

    active2: float
    mixed: float
    end2: float


class _Across(NamedTuple):
    """Of gravity across z: its components times w L^2, w l L and w l^2 / 2, over g [N m]."""

    x_active2: float
    x_mixed: float
    x_end2: float
    y_active2: float
    y_mixed: float
    y_end2: float


def _across(geometry: MuscleGeometry, gravity_m_s2: NDArray[np.float64]) -> _Across:
    return _Across(*_gravity(geometry, float(gravity_m_s2[0])), *_gravity(geometry, float(gravity_m_s2[1])))


def _gravity(geometry: MuscleGeometry, gravity_m_s2: float) -> _Gravity:
    active, end = geometry.active_length_m, geometry.end_length_m
    weight = geometry.mass_per_length_kg_m * gravity_m_s2
    return _Gravity(weight * active**2, weight * end * active, 0.5 * weight * end**2)


def _gravity_stiffness(angle_rad: ArrayLike, gravity: _Gravity) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Secant and tangent of V; plain where arrays come, compiled where single numbers do."""
    angle = np.maximum(angle_rad, _SMALLEST_ANGLE_RAD)
    cosine = np.cos(angle)
    d = np.sin(angle) / angle
    square = angle * angle
    a = 2.0 * np.sin(0.5 * angle) ** 2 / square  # 1 - cos theta without its cancellation
    # From theta D = sin theta and theta^2 A = 1 - cos theta, differentiated twice.
    d_slope_over_angle = (cosine - d) / square
    a_slope_over_angle = (d - 2.0 * a) / square
    d_curve = -d - 2.0 * d_slope_over_angle
    a_curve = (cosine - 2.0 * a) / square - 4.0 * a_slope_over_angle
    secant = gravity.end2 * d - gravity.active2 * a_slope_over_angle - gravity.mixed * d_slope_over_angle
    tangent = gravity.end2 * cosine - gravity.active2 * a_curve - gravity.mixed * d_curve
    return secant, tangent


_gravity_stiffness_of_one = njit(cache=True)(_gravity_stiffness)


@njit(cache=True)
def _rest(
    moment: NDArray[np.float64], spring: NDArray[np.float64], gravity: _Gravity, reach: float
) -> NDArray[np.float64]:
    """Bends at rest (n, 2) for moments (n, 2) and B / L (n,); ``reach`` [N m] bounds |V'|."""
    bend = np.empty(moment.shape)
    for i in range(spring.shape[0]):
        load = np.hypot(moment[i, 0], moment[i, 1])
        angle = load / spring[i]
        low, high = 0.0, angle + reach / spring[i]
        for _ in range(_MOST_ITERATIONS):
            secant, tangent = _gravity_stiffness_of_one(angle, gravity)
            excess = (spring[i] + secant) * angle - load
            if excess > 0.0:
                high = angle
            else:
                low = angle
            moved = angle - excess / (spring[i] + tangent)
            if moved < low or moved > high:
                moved = 0.5 * (low + high)
            is_moving = abs(moved - angle) > _LAST_STEP_RAD  # false for NaN: it is passed on, not waited for
            angle = moved
            if not is_moving:
                break
        secant, _ = _gravity_stiffness_of_one(angle, gravity)
        bend[i, 0], bend[i, 1] = moment[i, 0] / (spring[i] + secant), moment[i, 1] / (spring[i] + secant)
    return bend


@njit(cache=True)
def _pull_across(bend_x: float, bend_y: float, across: _Across) -> tuple[float, float, float, float, float]:
    """Gradient (x, y) and Hessian (xx, xy, yy) of -m' (g . bend) S, from the even functions' slopes over theta."""
    angle = max(np.hypot(bend_x, bend_y), _SMALLEST_ANGLE_RAD)
    square = angle * angle
    d0 = np.sin(angle) / angle
    a0 = 2.0 * np.sin(0.5 * angle) ** 2 / square
    c0 = (1.0 - d0) / square
    # f1 = f' / theta and f2 = f1' / theta.
    d1, a1 = (np.cos(angle) - d0) / square, (d0 - 2.0 * a0) / square
    c1 = -(d1 + 2.0 * c0) / square
    d2, a2 = -(d0 + 3.0 * d1) / square, (d1 - 4.0 * a1) / square
    c2 = -(d2 + 4.0 * c1) / square
    x0 = across.x_active2 * c0 + across.x_mixed * a0 + across.x_end2 * d0
    y0 = across.y_active2 * c0 + across.y_mixed * a0 + across.y_end2 * d0
    x1 = across.x_active2 * c1 + across.x_mixed * a1 + across.x_end2 * d1
    y1 = across.y_active2 * c1 + across.y_mixed * a1 + across.y_end2 * d1
    x2 = across.x_active2 * c2 + across.x_mixed * a2 + across.x_end2 * d2
    y2 = across.y_active2 * c2 + across.y_mixed * a2 + across.y_end2 * d2
    first, second = x1 * bend_x + y1 * bend_y, x2 * bend_x + y2 * bend_y
    return (
        -(x0 + first * bend_x),
        -(y0 + first * bend_y),
        -(2.0 * x1 * bend_x + first + second * bend_x * bend_x),
        -(x1 * bend_y + y1 * bend_x + second * bend_x * bend_y),
        -(2.0 * y1 * bend_y + first + second * bend_y * bend_y),
    )


@njit(cache=True)
def _held(
    bend: NDArray[np.float64], spring: NDArray[np.float64], gravity: _Gravity, across: _Across
) -> NDArray[np.float64]:
    """Moments (n, 2) that balance bends (n, 2)."""
    moment = np.empty(bend.shape)
    for i in range(spring.shape[0]):
        secant, _ = _gravity_stiffness_of_one(np.hypot(bend[i, 0], bend[i, 1]), gravity)
        pull_x, pull_y, _, _, _ = _pull_across(bend[i, 0], bend[i, 1], across)
        moment[i, 0] = (spring[i] + secant) * bend[i, 0] + pull_x
        moment[i, 1] = (spring[i] + secant) * bend[i, 1] + pull_y
    return moment


@njit(cache=True)
def _tilted(
    start: NDArray[np.float64],
    moment: NDArray[np.float64],
    spring: NDArray[np.float64],
    gravity: _Gravity,
    across: _Across,
) -> NDArray[np.float64]:
    """Bends (n, 2) at rest, from those at rest under gravity along z: Newton's method, its steps limited."""
    bend = np.empty(start.shape)
    for i in range(spring.shape[0]):
        x, y = start[i, 0], start[i, 1]
        for _ in range(_MOST_ITERATIONS):
            angle = np.hypot(x, y)
            secant, tangent = _gravity_stiffness_of_one(angle, gravity)
            rise = (tangent - secant) / max(angle, _SMALLEST_ANGLE_RAD) ** 2
            pull_x, pull_y, xx, xy, yy = _pull_across(x, y, across)
            left_x = (spring[i] + secant) * x + pull_x - moment[i, 0]
            left_y = (spring[i] + secant) * y + pull_y - moment[i, 1]
            xx += spring[i] + secant + rise * x * x
            yy += spring[i] + secant + rise * y * y
            xy += rise * x * y
            determinant = xx * yy - xy * xy
            step_x = -(yy * left_x - xy * left_y) / determinant
            step_y = -(xx * left_y - xy * left_x) / determinant
            size = np.hypot(step_x, step_y)
            share = min(1.0, _LONGEST_STEP_RAD / max(size, 1e-300))
            x, y = x + share * step_x, y + share * step_y
            if not size > _LAST_STEP_RAD:  # true for NaN: it is passed on, not waited for
                break
        bend[i, 0], bend[i, 1] = x, y
    return bend


def _magnitude(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(vector[..., 0], vector[..., 1])
