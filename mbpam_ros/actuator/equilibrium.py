"""Gravity on a hanging muscle of constant curvature, and the bend at which it comes to rest.

The muscle hangs from its clamp, gravity along +z of the muscle frame. With theta = |bend|, L the active length, l the
length of a straight end and w the weight per length, the potential energy of gravity, zero when straight, is

    V(theta) = w [L^2 (1/2 - A) + l L (1 - D) + l^2/2 (1 - cos theta)],
    A = (1 - cos theta) / theta^2,  D = sin theta / theta.

Virtual work over the active length, where the bending moment is B theta / L - M0, gives the generalised balance
(B / L) bend + dV/dbend = M0. The bend lies along M0, so one scalar equation is left.
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


class _Gravity(NamedTuple):
    """w L^2, w l L and w l^2 / 2 [N m]."""

    active2: float
    mixed: float
    end2: float


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


def _magnitude(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(vector[..., 0], vector[..., 1])
