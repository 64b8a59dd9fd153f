"""Where a muscle of constant curvature lies: its centre line and the pose of its tip.

A muscle is a straight end, an active part that bends by |bend| along a circular arc, and another straight end. The
bend vector (x, y) [rad] points toward where the tip moves. Every expression is a sinc of the bend times the bend
vector, so straight is a regular point and bends beyond a full turn need no case of their own.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.design import MuscleGeometry


def centreline(bend_rad: ArrayLike, geometry: MuscleGeometry, arc_length_m: ArrayLike) -> NDArray[np.float64]:
    """Return points of the centre line in the muscle frame (origin at the clamp, z along the straight muscle).

    With sigma the arc length inside the active part of length L, phi = |bend| sigma / L and tau the arc length in the
    tip's straight end: lateral = (sigma^2 / L (1 - cos phi) / phi^2 + tau sin|bend| / |bend|) bend and
    z = sigma sin(phi) / phi + tau cos|bend| beyond the clamp's end.

    Args:
        bend_rad: bend vectors, shape (..., 2).
        geometry: of the muscle.
        arc_length_m: distances from the clamp along the muscle, 0 to ``geometry.length_m``, shape (n,).

    Returns:
        Points [m], shape (..., n, 3).
    """
    bend = np.asarray(bend_rad, dtype=float)
    along = np.asarray(arc_length_m, dtype=float)
    active = geometry.active_length_m
    sigma = np.clip(along - geometry.end_length_m, 0.0, active)
    tau = np.maximum(along - geometry.end_length_m - active, 0.0)
    angle = np.hypot(bend[..., 0], bend[..., 1])[..., None]
    phi = angle * (sigma / active)
    lateral = (0.5 / active) * (sigma * _sinc(0.5 * phi)) ** 2 + tau * _sinc(angle)
    points = np.empty((*lateral.shape, 3))
    points[..., :2] = lateral[..., None] * bend[..., None, :]
    points[..., 2] = np.minimum(along, geometry.end_length_m) + sigma * _sinc(phi) + tau * np.cos(angle)
    return points


def tip_pose(bend_rad: ArrayLike, geometry: MuscleGeometry) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pose of the tip in the muscle frame.

    The tip's frame is the clamp's, turned by |bend| about z x bend / |bend| (no twist).

    Args:
        bend_rad: bend vectors, shape (..., 2).
        geometry: of the muscle.

    Returns:
        Position [m], shape (..., 3), and orientation as a unit quaternion (x, y, z, w), shape (..., 4).
    """
    bend = np.asarray(bend_rad, dtype=float)
    active, end = geometry.active_length_m, geometry.end_length_m
    angle = np.hypot(bend[..., 0], bend[..., 1])
    sinc, half_sinc = _sinc(angle), _sinc(0.5 * angle)
    position = np.empty((*angle.shape, 3))
    position[..., :2] = (0.5 * active * half_sinc**2 + end * sinc)[..., None] * bend
    position[..., 2] = end + active * sinc + end * np.cos(angle)
    orientation = np.empty((*angle.shape, 4))
    orientation[..., 0] = -0.5 * half_sinc * bend[..., 1]
    orientation[..., 1] = 0.5 * half_sinc * bend[..., 0]
    orientation[..., 2] = 0.0 * angle  # no twist; NaN where the bend is
    orientation[..., 3] = np.cos(0.5 * angle)
    return position, orientation


def _sinc(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """sin(x) / x, 1 at zero. No series is needed: the quotient of two nearly equal numbers loses nothing."""
    return np.sinc(angle_rad / math.pi)
