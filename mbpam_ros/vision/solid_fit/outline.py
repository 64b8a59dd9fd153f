"""Outlines of primitives: their vertices, how these project, and the convex hull that is the silhouette.

Forms and their parameters [m, rad] are those of :mod:`mbpam_ros.vision.primitives`. All stand on the plane z =
``support`` of ``gripper_base``; z points down.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

SPHERE, ROD, POST, BOX, CAPSULE = range(5)
RING = 24
HALF_RING = 20
MOST_VERTICES = 2 * RING
_ROUND = 1.0 + (math.pi / RING) ** 2 / 4.0
"""A ring of corners is drawn this much larger, so that it runs half inside and half outside of the circle."""
_ANGLES = 2.0 * np.pi * np.arange(RING) / RING
_RING_COS, _RING_SIN = _ROUND * np.cos(_ANGLES), _ROUND * np.sin(_ANGLES)
_TANGENT_ANGLES = np.pi * np.arange(2 * HALF_RING) / HALF_RING
_TANGENT_COS, _TANGENT_SIN = np.cos(_TANGENT_ANGLES), np.sin(_TANGENT_ANGLES)


@njit(nogil=True)
def _tangent_circle(
    x: float, y: float, z: float, radius: float, eye: NDArray, points: NDArray, first: int, count: int
) -> None:
    """Put the circle in which the cone of tangents from the eye touches a sphere into ``points``."""
    vx, vy, vz = x - eye[0], y - eye[1], z - eye[2]
    distance = math.sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx / distance, vy / distance, vz / distance
    # Two directions across the view.
    if abs(vy) < 0.9:
        ax, ay, az = -vz, 0.0, vx
    else:
        ax, ay, az = 0.0, vz, -vy
    norm = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / norm, ay / norm, az / norm
    bx, by, bz = vy * az - vz * ay, vz * ax - vx * az, vx * ay - vy * ax
    sine = min(radius / distance, 0.999)
    back = radius * sine
    ring = _ROUND * radius * math.sqrt(1.0 - sine * sine)
    stride = 2 * HALF_RING // count
    for i in range(count):
        c, s = ring * _TANGENT_COS[stride * i], ring * _TANGENT_SIN[stride * i]
        points[first + i, 0] = x - back * vx + c * ax + s * bx
        points[first + i, 1] = y - back * vy + c * ay + s * by
        points[first + i, 2] = z - back * vz + c * az + s * bz


@njit(nogil=True)
def outline_points(form: int, p: NDArray, support: float, eye: NDArray, points: NDArray) -> int:
    """Put points whose convex hull has the silhouette into ``points``, (MOST_VERTICES, 3); return how many."""
    if form == SPHERE:
        _tangent_circle(p[0], p[1], support - p[2], p[2], eye, points, 0, 2 * HALF_RING)
        return 2 * HALF_RING
    if form == POST:
        for end in range(2):
            z = support - end * p[3]
            for i in range(RING):
                row = end * RING + i
                points[row, 0] = p[0] + p[2] * _RING_COS[i]
                points[row, 1] = p[1] + p[2] * _RING_SIN[i]
                points[row, 2] = z
        return 2 * RING
    c, s = math.cos(p[2]), math.sin(p[2])
    if form == ROD:
        for end in range(2):
            half = (end - 0.5) * p[4]
            for i in range(RING):
                across, down = p[3] * _RING_COS[i], p[3] * _RING_SIN[i]
                row = end * RING + i
                points[row, 0] = p[0] + across * c - half * s
                points[row, 1] = p[1] + across * s + half * c
                points[row, 2] = support - p[3] + down
        return 2 * RING
    if form == CAPSULE:
        half = max(0.5 * p[4] - p[3], 0.0)
        for end in range(2):
            along = (2 * end - 1) * half
            _tangent_circle(
                p[0] - along * s, p[1] + along * c, support - p[3], p[3], eye, points, end * HALF_RING, HALF_RING
            )
        return 2 * HALF_RING
    for i in range(8):
        across = 0.5 * p[3] * (2 * (i & 1) - 1)
        along = 0.5 * p[4] * (2 * ((i >> 1) & 1) - 1)
        points[i, 0] = p[0] + across * c - along * s
        points[i, 1] = p[1] + across * s + along * c
        points[i, 2] = support - 0.5 * p[5] * (1 - (2 * (i >> 2) - 1))
    return 8


@njit(nogil=True)
def project_outline(
    form: int, p: NDArray, support: float, eye: NDArray, rotation: NDArray, lens: NDArray, points: NDArray, uv: NDArray
) -> int:
    """Put the projected outline points into ``uv``, (MOST_VERTICES, 2) px; return how many, 0 if one is not in front.

    Args:
        rotation: (3, 3), of the optical frame in ``gripper_base``.
        lens: fx, fy, cx, cy [px].
        points: (:data:`MOST_VERTICES`, 3), filled.
    """
    count = outline_points(form, p, support, eye, points)
    for i in range(count):
        x, y, z = points[i, 0] - eye[0], points[i, 1] - eye[1], points[i, 2] - eye[2]
        depth = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
        if depth < 0.004:
            return 0
        uv[i, 0] = (rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z) / depth * lens[0] + lens[2]
        uv[i, 1] = (rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z) / depth * lens[1] + lens[3]
    return count


@njit(nogil=True)
def convex_hull(uv: NDArray, count: int, hull: NDArray) -> int:
    """Put the corners of the convex hull of ``uv``, (count, 2), into ``hull``; return how many.

    Andrew's monotone chain, in an order that :func:`line_distance` is positive
    outside of.
    """
    order = np.argsort(uv[:count, 0] + 1e-7 * uv[:count, 1])
    size = 0
    for i in order:
        while size >= 2 and _turn(uv, hull[size - 2], hull[size - 1], i) <= 0.0:
            size -= 1
        hull[size] = i
        size += 1
    lower = size + 1
    for k in range(count - 2, -1, -1):
        i = order[k]
        while size >= lower and _turn(uv, hull[size - 2], hull[size - 1], i) <= 0.0:
            size -= 1
        hull[size] = i
        size += 1
    return size - 1


@njit(nogil=True)
def _turn(uv: NDArray, a: int, b: int, c: int) -> float:
    return (uv[b, 0] - uv[a, 0]) * (uv[c, 1] - uv[a, 1]) - (uv[b, 1] - uv[a, 1]) * (uv[c, 0] - uv[a, 0])


@njit(nogil=True)
def line_distance(u: float, v: float, uv: NDArray, a: int, b: int) -> float:
    """Signed distance of a point from the line through two vertices, positive outside of a hull."""
    du, dv = uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1]
    cross = dv * (u - uv[a, 0]) - du * (v - uv[a, 1])
    return cross / max(math.sqrt(du * du + dv * dv), 1e-9)


@njit(nogil=True)
def clipped(subject: NDArray, window: NDArray) -> NDArray:
    """The part of a convex polygon, (n, 2), that lies in another, (m, 2) (Sutherland and Hodgman).

    Both run in the same sense, with positive area; OpenCV's intersectConvexConvex loses some nested ones.
    """
    polygon = subject.copy()
    for w in range(len(window)):
        ax, ay = window[w]
        bx, by = window[(w + 1) % len(window)]
        n = len(polygon)
        kept = np.empty((n + 2, 2))
        count = 0
        for i in range(n):
            px, py = polygon[i]
            qx, qy = polygon[(i + 1) % n]
            p_side = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
            q_side = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
            if p_side >= 0.0 and count < n + 2:
                kept[count, 0], kept[count, 1] = px, py
                count += 1
            if p_side * q_side < 0.0 and count < n + 2:
                f = p_side / (p_side - q_side)
                kept[count, 0], kept[count, 1] = px + f * (qx - px), py + f * (qy - py)
                count += 1
        polygon = kept[:count].copy()
        if count < 3:
            break
    return polygon


@njit(nogil=True)
def creases(form: int, p: NDArray, support: float, eye: NDArray, pairs: NDArray) -> int:
    """Put the vertex pairs of edges between two faces that the eye sees into ``pairs``, (n, 2); return how many."""
    count = 0
    if form == BOX:
        c, s = math.cos(p[2]), math.sin(p[2])
        x, y, z = eye[0] - p[0], eye[1] - p[1], eye[2] - (support - 0.5 * p[5])
        local = (x * c + y * s, -x * s + y * c, z)
        half = (0.5 * p[3], 0.5 * p[4], 0.5 * p[5])
        for axis in range(3):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            for corner in range(8):
                if (corner >> axis) & 1:
                    continue
                side1 = 2 * ((corner >> first) & 1) - 1
                side2 = 2 * ((corner >> second) & 1) - 1
                if side1 * local[first] > half[first] and side2 * local[second] > half[second]:
                    pairs[count, 0], pairs[count, 1] = corner, corner | (1 << axis)
                    count += 1
    elif form == POST and eye[2] < support - p[3]:
        for i in range(RING):  # the rim of the top, of which the far side lies on the outline
            pairs[count, 0], pairs[count, 1] = RING + i, RING + (i + 1) % RING
            count += 1
    elif form == ROD:
        along = -(eye[0] - p[0]) * math.sin(p[2]) + (eye[1] - p[1]) * math.cos(p[2])
        for end in range(2):
            if (2 * end - 1) * along > 0.5 * p[4]:
                for i in range(RING):
                    pairs[count, 0], pairs[count, 1] = end * RING + i, end * RING + (i + 1) % RING
                    count += 1
    return count
