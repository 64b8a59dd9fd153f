"""Solids, compiled: signed distance, and the points on which they rest.

Body frame: that of :mod:`~mbpam_ros.geometry.solids`. Functions take a shape code and the half sizes (3,) [m].
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPHERE, CYLINDER, BOX, PLANE = 0, 1, 2, 3
SHAPE_CODES = {"sphere": SPHERE, "cylinder": CYLINDER, "box": BOX}

REST_POINTS = 8
"""Numbers that the points have on which one solid may rest on one plane."""

_PROJECTIONS, _EDGE_M = 20, 1e-5
"""Rounds in which a point is moved back over a footprint, and how far beside it one may be that is over it."""

_UPRIGHT = 0.1
"""Sine of a cylinder's tilt from which it stands on the lowest point of its rim alone."""


@njit
def signed_distance(shape: int, half: Array, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the distance to the surface (negative inside) and its gradient: four numbers, body frame."""
    if shape == PLANE:  # the solid is below, toward +z
        return -z, 0.0, 0.0, -1.0
    if shape == SPHERE:
        radius = math.sqrt(x * x + y * y + z * z)
        if radius < 1e-12:
            return -half[0], 0.0, 0.0, -1.0
        return radius - half[0], x / radius, y / radius, z / radius
    if shape == CYLINDER:
        across = math.sqrt(x * x + y * y)
        radial, axial = across - half[0], abs(z) - half[2]
        ux, uy = (x / across, y / across) if across > 1e-12 else (1.0, 0.0)
        uz = 1.0 if z >= 0.0 else -1.0
        if radial > 0.0 and axial > 0.0:
            distance = math.sqrt(radial * radial + axial * axial)
            return distance, ux * radial / distance, uy * radial / distance, uz * axial / distance
        if radial > axial:
            return radial, ux, uy, 0.0
        return axial, 0.0, 0.0, uz
    dx, dy, dz = abs(x) - half[0], abs(y) - half[1], abs(z) - half[2]
    ux, uy, uz = (1.0 if x >= 0.0 else -1.0), (1.0 if y >= 0.0 else -1.0), (1.0 if z >= 0.0 else -1.0)
    if dx > 0.0 or dy > 0.0 or dz > 0.0:
        ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
        distance = math.sqrt(ox * ox + oy * oy + oz * oz)
        return distance, ux * ox / distance, uy * oy / distance, uz * oz / distance
    if dx >= dy and dx >= dz:
        return dx, ux, 0.0, 0.0
    if dy >= dz:
        return dy, 0.0, uy, 0.0
    return dz, 0.0, 0.0, uz


@njit
def rest_points(
    shape: int, half: Array, centre: Array, rotation: Array, foot_x: float, foot_y: float, points: Array
) -> int:
    """Write the lowest points over the footprint |x| <= foot_x, |y| <= foot_y into ``points``; return how many.

    World frame, z down. A row of ``points`` (8, 5) has place, number and share of the stiffness of one; the number is
    that of the same place on the solid as long as it is among them, rising from row to row. Sphere: one. Cylinder: the
    two ends of its lowest line, and, the more upright it stands, four points of its lower rim instead: forces are
    continuous in its pose. Box: the corners of its lower face. What overhangs is moved back over the footprint.
    """
    if shape == SPHERE:
        if abs(centre[0]) > foot_x or abs(centre[1]) > foot_y:
            return 0
        points[0, 0], points[0, 1], points[0, 2] = centre[0], centre[1], centre[2] + half[0]
        points[0, 3], points[0, 4] = 0.0, 1.0
        return 1
    if shape == CYLINDER:
        return _cylinder_rest_points(half, centre, rotation, foot_x, foot_y, points)
    return _box_rest_points(half, centre, rotation, foot_x, foot_y, points)


@njit
def _cylinder_rest_points(
    half: Array, centre: Array, rotation: Array, foot_x: float, foot_y: float, points: Array
) -> int:
    ax, ay, az = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    level, count = math.sqrt(max(1.0 - az * az, 0.0)), 0
    tilted = min(level / _UPRIGHT, 1.0)
    tilted *= tilted * (3.0 - 2.0 * tilted)
    if tilted < 1.0:
        end = half[2] if az >= 0.0 else -half[2]
        determinant = rotation[0, 0] * rotation[1, 1] - rotation[0, 1] * rotation[1, 0]
        fx, fy, fz = centre[0] + ax * end, centre[1] + ay * end, centre[2] + az * end
        for k in range(4):
            a = half[0] if k == 0 else (-half[0] if k == 1 else 0.0)
            b = half[0] if k == 2 else (-half[0] if k == 3 else 0.0)
            for _ in range(_PROJECTIONS):  # alternate between end and footprint: ends in both if they overlap there
                x = min(max(fx + a * rotation[0, 0] + b * rotation[0, 1], -foot_x), foot_x) - fx
                y = min(max(fy + a * rotation[1, 0] + b * rotation[1, 1], -foot_y), foot_y) - fy
                a = (x * rotation[1, 1] - y * rotation[0, 1]) / determinant
                b = (y * rotation[0, 0] - x * rotation[1, 0]) / determinant
                inside = min(1.0, half[0] / max(math.sqrt(a * a + b * b), 1e-12))
                a, b = inside * a, inside * b
            x = fx + a * rotation[0, 0] + b * rotation[0, 1]
            y = fy + a * rotation[1, 0] + b * rotation[1, 1]
            if abs(x) <= foot_x + _EDGE_M and abs(y) <= foot_y + _EDGE_M:
                points[count, 0], points[count, 1] = x, y
                points[count, 2] = fz + a * rotation[2, 0] + b * rotation[2, 1]
                points[count, 3], points[count, 4] = k, 1.0 - tilted
                count += 1
    if tilted <= 0.0:
        return count
    # Lowest line: centre + radius * (z - (z.a) a) / |..| + t a, cut to the footprint.
    x0 = centre[0] - half[0] * az * ax / level
    y0 = centre[1] - half[0] * az * ay / level
    z0 = centre[2] + half[0] * level
    low, high = -half[2], half[2]
    for position, direction, foot in ((x0, ax, foot_x), (y0, ay, foot_y)):
        if abs(direction) < 1e-9:
            if abs(position) > foot:
                return count
        else:
            first, second = (-foot - position) / direction, (foot - position) / direction
            low, high = max(low, min(first, second)), min(high, max(first, second))
    if low > high:
        return count
    for k in range(2):
        t = low if k == 0 else high
        points[count, 0], points[count, 1], points[count, 2] = x0 + t * ax, y0 + t * ay, z0 + t * az
        points[count, 3], points[count, 4] = 4 + k, tilted
        count += 1
    return count


@njit
def _box_rest_points(half: Array, centre: Array, rotation: Array, foot_x: float, foot_y: float, points: Array) -> int:
    w = 0  # axis of the lower face: the one most upright
    for k in range(1, 3):
        if abs(rotation[2, k]) > abs(rotation[2, w]):
            w = k
    u, v = (w + 1) % 3, (w + 2) % 3
    end = half[w] if rotation[2, w] >= 0.0 else -half[w]
    determinant = rotation[0, u] * rotation[1, v] - rotation[0, v] * rotation[1, u]
    fx, fy = centre[0] + end * rotation[0, w], centre[1] + end * rotation[1, w]
    fz = centre[2] + end * rotation[2, w]
    count, first, second = 0, 1 << min(u, v), 1 << max(u, v)
    for corner in range(4):  # the corner's number: a bit for each axis along which it is on the far side
        number = ((1 << w) if end > 0.0 else 0) + first * (corner % 2) + second * (corner // 2)
        a = half[u] if number & (1 << u) else -half[u]
        b = half[v] if number & (1 << v) else -half[v]
        for _ in range(_PROJECTIONS):  # alternate between face and footprint: ends in both if they overlap there
            x = min(max(fx + a * rotation[0, u] + b * rotation[0, v], -foot_x), foot_x) - fx
            y = min(max(fy + a * rotation[1, u] + b * rotation[1, v], -foot_y), foot_y) - fy
            a = min(max((x * rotation[1, v] - y * rotation[0, v]) / determinant, -half[u]), half[u])
            b = min(max((y * rotation[0, u] - x * rotation[1, u]) / determinant, -half[v]), half[v])
        x = fx + a * rotation[0, u] + b * rotation[0, v]
        y = fy + a * rotation[1, u] + b * rotation[1, v]
        if abs(x) <= foot_x + _EDGE_M and abs(y) <= foot_y + _EDGE_M:
            points[count, 0], points[count, 1] = x, y
            points[count, 2] = fz + a * rotation[2, u] + b * rotation[2, v]
            points[count, 3], points[count, 4] = number, 1.0
            count += 1
    return count
