"""Surfaces of primitives: how far a point is from one, and its normal where a ray meets it."""

from __future__ import annotations

import math

from numba import njit
from numpy.typing import NDArray

from mbpam_ros.vision.solid_fit.outline import CAPSULE, POST, ROD, SPHERE


@njit(nogil=True)
def distance(form: int, p: NDArray, support: float, x: float, y: float, z: float) -> float:
    """How far a point is from the primitive's surface [m]; negative inside."""
    dx, dy = x - p[0], y - p[1]
    if form == SPHERE:
        dz = z - (support - p[2])
        return math.sqrt(dx * dx + dy * dy + dz * dz) - p[2]
    if form == POST:
        return _outside(math.hypot(dx, dy) - p[2], abs(z - (support - 0.5 * p[3])) - 0.5 * p[3], -1.0)
    c, s = math.cos(p[2]), math.sin(p[2])
    across, along = dx * c + dy * s, -dx * s + dy * c
    if form == ROD:
        return _outside(math.hypot(across, z - (support - p[3])) - p[3], abs(along) - 0.5 * p[4], -1.0)
    if form == CAPSULE:
        beyond = max(abs(along) - max(0.5 * p[4] - p[3], 0.0), 0.0)
        dz = z - (support - p[3])
        return math.sqrt(across * across + dz * dz + beyond * beyond) - p[3]
    return _outside(abs(across) - 0.5 * p[3], abs(along) - 0.5 * p[4], abs(z - (support - 0.5 * p[5])) - 0.5 * p[5])


@njit(nogil=True)
def _outside(a: float, b: float, c: float) -> float:
    """Distance from what is bounded by three perpendicular faces, at signed distances a, b and c beyond them."""
    u, v, w = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    out = math.sqrt(u * u + v * v + w * w)
    return out if out > 0.0 else max(a, b, c if c > -1.0 else a)


@njit(nogil=True)
def normal_at(
    form: int, p: NDArray, support: float, eye: NDArray, dx: float, dy: float, dz: float, normal: NDArray
) -> bool:
    """Put the outward normal where a ray meets a primitive into ``normal``; return whether it does.

    Sphere tracing: a step as long as the distance to the solid cannot pass it.
    """
    h, t, near = 1e-5, 0.0, 1.0
    for _ in range(40):
        near = distance(form, p, support, eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz)
        if near < 1e-4 or t > 3.0:
            break
        t += near
    if near >= 5e-4:
        return False
    x, y, z = eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz
    gx = distance(form, p, support, x + h, y, z) - distance(form, p, support, x - h, y, z)
    gy = distance(form, p, support, x, y + h, z) - distance(form, p, support, x, y - h, z)
    gz = distance(form, p, support, x, y, z + h) - distance(form, p, support, x, y, z - h)
    norm = max(math.sqrt(gx * gx + gy * gy + gz * gz), 1e-12)
    normal[0], normal[1], normal[2] = gx / norm, gy / norm, gz / norm
    return True
