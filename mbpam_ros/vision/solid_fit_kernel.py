"""Compiled fit of primitives to a contour, to edges of an image and to points of a depth camera.

Damped Gauss-Newton (Levenberg and Marquardt) on robust residuals (Cauchy), with finite differences of the projected
vertices as Jacobian; a step that does not lower the cost is not taken, so the fit cannot diverge.

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
_HALF_RING = 20
MOST_VERTICES = 2 * RING
_ROUND = 1.0 + (math.pi / RING) ** 2 / 4.0
"""A ring of corners is drawn this much larger, so that it runs half inside and half outside of the circle."""


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
    for i in range(count):
        angle = 2.0 * math.pi * i / count
        c, s = ring * math.cos(angle), ring * math.sin(angle)
        points[first + i, 0] = x - back * vx + c * ax + s * bx
        points[first + i, 1] = y - back * vy + c * ay + s * by
        points[first + i, 2] = z - back * vz + c * az + s * bz


@njit(nogil=True)
def outline_points(form: int, p: NDArray, support: float, eye: NDArray, points: NDArray) -> int:
    """Put points whose convex hull has the silhouette into ``points``, (MOST_VERTICES, 3); return how many."""
    if form == SPHERE:
        _tangent_circle(p[0], p[1], support - p[2], p[2], eye, points, 0, 2 * _HALF_RING)
        return 2 * _HALF_RING
    if form == POST:
        for end in range(2):
            z = support - end * p[3]
            for i in range(RING):
                angle = 2.0 * math.pi * i / RING
                row = end * RING + i
                points[row, 0] = p[0] + _ROUND * p[2] * math.cos(angle)
                points[row, 1] = p[1] + _ROUND * p[2] * math.sin(angle)
                points[row, 2] = z
        return 2 * RING
    c, s = math.cos(p[2]), math.sin(p[2])
    if form == ROD:
        for end in range(2):
            half = (end - 0.5) * p[4]
            for i in range(RING):
                angle = 2.0 * math.pi * i / RING
                across, down = _ROUND * p[3] * math.cos(angle), _ROUND * p[3] * math.sin(angle)
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
                p[0] - along * s, p[1] + along * c, support - p[3], p[3], eye, points, end * _HALF_RING, _HALF_RING
            )
        return 2 * _HALF_RING
    for i in range(8):
        across = 0.5 * p[3] * (2 * (i & 1) - 1)
        along = 0.5 * p[4] * (2 * ((i >> 1) & 1) - 1)
        points[i, 0] = p[0] + across * c - along * s
        points[i, 1] = p[1] + across * s + along * c
        points[i, 2] = support - 0.5 * p[5] * (1 - (2 * (i >> 2) - 1))
    return 8


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def convex_hull(uv: NDArray, count: int, hull: NDArray) -> int:
    """Put the corners of the convex hull of ``uv``, (count, 2), into ``hull``; return how many.

    Andrew's monotone chain, in an order that :func:`mbpam_ros.vision.solid_fit_kernel.line_distance` is positive
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


@njit(cache=True, nogil=True)
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


# -- the fit ------------------------------------------------------------------------------------------------------

MOST_PARAMETERS = 6
_MOST_PAIRS = 2 * MOST_VERTICES + 2 * RING
_COUNTS = (3, 5, 4, 6, 5)
_DIFFERENCE = 2e-5
_LARGEST_M = 0.60
_SMALLEST_M = 0.004
_CONVERGED_M = 2e-4
_COARSE_FACTOR = 5.0
_UNOBSERVED = 3e-5  # of the largest curvature: keeps what is not seen (a box's height from above) from running away


@njit(nogil=True)
def _has_yaw(form: int) -> bool:
    return form != SPHERE and form != POST


@njit(nogil=True)
def _bound(form: int, p: NDArray, reach: float) -> None:
    """Keep sizes within what can stand below the eye and be an object."""
    first = 3 if _has_yaw(form) else 2
    for i in range(first, _COUNTS[form]):
        p[i] = min(max(p[i], 0.5 * _SMALLEST_M), _LARGEST_M)
    tallest = 0.95 * reach
    if form == BOX:
        p[5] = min(p[5], tallest)
    elif form == POST:
        p[3] = min(p[3], tallest)
    else:
        p[first] = min(p[first], 0.5 * tallest)
    if form == CAPSULE:
        p[4] = max(p[4], 2.0 * p[3] + 1e-4)


@njit(nogil=True)
def line_distance(u: float, v: float, uv: NDArray, a: int, b: int) -> float:
    """Signed distance of a point from the line through two vertices, positive outside of a hull."""
    du, dv = uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1]
    cross = dv * (u - uv[a, 0]) - du * (v - uv[a, 1])
    return cross / max(math.sqrt(du * du + dv * dv), 1e-9)


@njit(nogil=True)
def _contour_distances(
    uv: NDArray, hull: NDArray, corners: int, contour: NDArray, distances: NDArray, edges: NDArray
) -> None:
    lines = np.empty((corners, 3))  # each edge's normal, and its distance from the origin
    for h in range(corners):
        a, b = hull[h], hull[h + 1 if h + 1 < corners else 0]
        du, dv = uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1]
        length = max(math.sqrt(du * du + dv * dv), 1e-9)
        lines[h, 0], lines[h, 1] = dv / length, -du / length
        lines[h, 2] = (dv * uv[a, 0] - du * uv[a, 1]) / length
    for k in range(len(contour)):
        best, at = -1e9, 0
        for h in range(corners):
            d = lines[h, 0] * contour[k, 0] + lines[h, 1] * contour[k, 1] - lines[h, 2]
            if d > best:
                best, at = d, h
        distances[k] = best
        edges[k, 0] = hull[at]
        edges[k, 1] = hull[at + 1 if at + 1 < corners else 0]


@njit(nogil=True)
def _solve(normal: NDArray, right: NDArray, count: int, damping: float, floor: float, step: NDArray) -> None:
    """Solve the damped normal equations by Cholesky; ``floor`` leaves alone what is not observed."""
    largest = 1e-12
    for i in range(count):
        largest = max(largest, normal[i, i])
    factor = np.zeros((MOST_PARAMETERS, MOST_PARAMETERS))
    for i in range(count):
        for j in range(i + 1):
            value = normal[i, j]
            if i == j:
                value += damping * normal[i, i] + floor * largest
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                factor[i, i] = math.sqrt(max(value, 1e-12 * largest))
            else:
                factor[i, j] = value / factor[j, j]
    _substitute(factor, right, count, step)


@njit(nogil=True)
def _substitute(factor: NDArray, right: NDArray, count: int, solution: NDArray) -> None:
    """Solve L L^T x = right for a lower factor L; ``solution`` may be ``right``."""
    for i in range(count):
        value = right[i]
        for k in range(i):
            value -= factor[i, k] * solution[k]
        solution[i] = value / factor[i, i]
    for i in range(count - 1, -1, -1):
        value = solution[i]
        for k in range(i + 1, count):
            value -= factor[k, i] * solution[k]
        solution[i] = value / factor[i, i]


@njit(nogil=True)
def _add(normal: NDArray, right: NDArray, row: NDArray, residual: float, weight: float, count: int) -> None:
    for i in range(count):
        wr = weight * row[i]
        right[i] -= wr * residual
        for j in range(i + 1):
            normal[i, j] += wr * row[j]


@njit(cache=True, nogil=True)
def fit_solid(
    form: int,
    guess: NDArray,
    support: float,
    eye: NDArray,
    rotation: NDArray,
    lens: NDArray,
    contour: NDArray,
    contour_sigma_px: float,
    points: NDArray,
    point_sigma_m: float,
    most_steps: int,
) -> tuple[NDArray, float, float]:
    """Fit one primitive to contour points and to points of its surface.

    Minimises sum 4 log(1 + r^2 / 4) over r = d / sigma, with d the distance of a contour point from the silhouette
    [px] and of a surface point from the solid [m]. Either set may be empty.

    Args:
        form: of the primitive.
        guess: (n,), its parameters to start from.
        support: z of the plane it stands on.
        eye, rotation, lens: the camera, as for :func:`project_outline`.
        contour: (k, 2) px.
        contour_sigma_px: standard deviation of theirs.
        points: (m, 3).
        point_sigma_m: standard deviation of theirs.
        most_steps: of the iteration.

    Returns:
        Parameters; root mean square of the contour's distances [px], each counted as 20 at most; root mean square of
        the points' [m], each counted as 20 mm at most. (guess, inf, inf) where the guess cannot be projected.
    """
    count = _COUNTS[form]
    p = guess.copy()
    reach = support - eye[2]
    _bound(form, p, reach)
    k, m = len(contour), len(points)
    space = np.empty((MOST_VERTICES, 3))
    uv, moved = np.empty((MOST_VERTICES, 2)), np.empty((count, MOST_VERTICES, 2))
    hull = np.empty(2 * MOST_VERTICES, np.int64)
    distances, trial_distances = np.empty(k), np.empty(k)
    edges, trial_edges = np.empty((k, 2), np.int64), np.empty((k, 2), np.int64)
    gaps, trial_gaps = np.empty(m), np.empty(m)
    row, step = np.zeros(MOST_PARAMETERS), np.zeros(MOST_PARAMETERS)
    n = project_outline(form, p, support, eye, rotation, lens, space, uv)
    if n == 0:
        return p, math.inf, math.inf
    if k:
        _contour_distances(uv, hull, convex_hull(uv, n, hull), contour, distances, edges)
    for i in range(m):
        gaps[i] = distance(form, p, support, points[i, 0], points[i, 1], points[i, 2])
    # From far away first: what is far off counts nearly as its square, then as little as its logarithm.
    final_px, final_m, coarse = contour_sigma_px, point_sigma_m, True
    contour_sigma_px, point_sigma_m = _COARSE_FACTOR * final_px, _COARSE_FACTOR * final_m
    cost = _robust_cost(distances, contour_sigma_px) + _robust_cost(gaps, point_sigma_m)
    damping = 1e-3
    for turn in range(most_steps):
        normal, right = np.zeros((MOST_PARAMETERS, MOST_PARAMETERS)), np.zeros(MOST_PARAMETERS)
        varied = p.copy()
        usable = True
        for j in range(count):
            varied[j] = p[j] + _DIFFERENCE
            if project_outline(form, varied, support, eye, rotation, lens, space, moved[j]) == 0:
                usable = False
            varied[j] = p[j]
        if not usable:
            break
        for i in range(k):
            for j in range(count):
                d = line_distance(contour[i, 0], contour[i, 1], moved[j], edges[i, 0], edges[i, 1])
                row[j] = (d - distances[i]) / _DIFFERENCE / contour_sigma_px
            r = distances[i] / contour_sigma_px
            _add(normal, right, row, r, 1.0 / (1.0 + 0.25 * r * r), count)
        for i in range(m):
            for j in range(count):
                varied[j] = p[j] + _DIFFERENCE
                d = distance(form, varied, support, points[i, 0], points[i, 1], points[i, 2])
                row[j] = (d - gaps[i]) / _DIFFERENCE / point_sigma_m
                varied[j] = p[j]
            r = gaps[i] / point_sigma_m
            _add(normal, right, row, r, 1.0 / (1.0 + 0.25 * r * r), count)
        _solve(normal, right, count, damping, _UNOBSERVED, step)
        trial = p.copy()
        for j in range(count):
            most = 0.3 if j == 2 and _has_yaw(form) else 0.03
            trial[j] += min(max(step[j], -most), most)
        _bound(form, trial, reach)
        n = project_outline(form, trial, support, eye, rotation, lens, space, uv)
        trial_cost = math.inf
        if n:
            if k:
                _contour_distances(uv, hull, convex_hull(uv, n, hull), contour, trial_distances, trial_edges)
            for i in range(m):
                trial_gaps[i] = distance(form, trial, support, points[i, 0], points[i, 1], points[i, 2])
            trial_cost = _robust_cost(trial_distances, contour_sigma_px) + _robust_cost(trial_gaps, point_sigma_m)
        if trial_cost >= cost:
            damping *= 8.0
            done = damping > 1e2
        else:
            done = np.abs(trial - p).max() < _CONVERGED_M and damping < 0.1
            p, cost, damping = trial, trial_cost, max(0.2 * damping, 1e-6)
            distances, trial_distances = trial_distances, distances
            edges, trial_edges = trial_edges, edges
            gaps, trial_gaps = trial_gaps, gaps
        if coarse and (done or turn >= most_steps // 2):
            contour_sigma_px, point_sigma_m, coarse, damping = final_px, final_m, False, 1e-3
            cost = _robust_cost(distances, contour_sigma_px) + _robust_cost(gaps, point_sigma_m)
        elif done:
            break
    return p, _root_mean_square(distances, 20.0), _root_mean_square(gaps, 0.02)


@njit(nogil=True)
def _robust_cost(values: NDArray, sigma: float) -> float:
    total = 0.0
    for value in values:
        total += 4.0 * math.log1p(0.25 * (value / sigma) ** 2)
    return total


@njit(nogil=True)
def _root_mean_square(values: NDArray, most: float) -> float:
    if len(values) == 0:
        return 0.0
    total = 0.0
    for value in values:
        total += min(abs(value), most) ** 2
    return math.sqrt(total / len(values))


# -- edges --------------------------------------------------------------------------------------------------------

_SPACING_PX = 4.0
_MOST_CONTROLS = 200
_WIDEST_SEARCH = 12


@njit(nogil=True)
def _controls(
    form: int,
    p: NDArray,
    support: float,
    eye: NDArray,
    uv: NDArray,
    hull: NDArray,
    corners: int,
    hidden: NDArray,
    pairs: NDArray,
    controls: NDArray,
) -> tuple[int, int]:
    """Lay control points along the outline, then along the creases.

    Args:
        pairs: (:data:`_MOST_PAIRS`, 2), filled.
        controls: (n, 8), filled: u, v, normal (2), the vertices, fraction between them, whether visible.

    Returns:
        How many, and how many of these on the outline.
    """
    total = 0.0
    for h in range(corners):
        pairs[h, 0], pairs[h, 1] = hull[h], hull[h + 1 if h + 1 < corners else 0]
    lines = corners + creases(form, p, support, eye, pairs[corners:])
    for i in range(lines):
        a, b = pairs[i, 0], pairs[i, 1]
        total += math.hypot(uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1])
    spacing = max(_SPACING_PX, total / (0.75 * _MOST_CONTROLS))
    height, width = hidden.shape
    count, outline, carry = 0, 0, 0.5 * spacing
    for i in range(lines):
        if i == corners:
            outline, carry = count, 0.5 * spacing
        a, b = pairs[i, 0], pairs[i, 1]
        du, dv = uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1]
        length = math.hypot(du, dv)
        station = carry
        while station < length and count < len(controls):
            f = station / length
            u, v = uv[a, 0] + f * du, uv[a, 1] + f * dv
            controls[count, 0], controls[count, 1] = u, v
            controls[count, 2], controls[count, 3] = dv / length, -du / length
            controls[count, 4], controls[count, 5], controls[count, 6] = a, b, f
            inside = 2.0 <= u < width - 3.0 and 2.0 <= v < height - 3.0
            controls[count, 7] = 1.0 if inside and hidden[int(v + 0.5), int(u + 0.5)] == 0 else 0.0
            count += 1
            station += spacing
        carry = station - length
    if lines == corners:
        outline = count
    return count, outline


@njit(nogil=True)
def _edge_offset(image: NDArray, u: float, v: float, nu: float, nv: float, reach: int, level: float) -> tuple:
    """Offset [px] along the normal of the step of colour that is strongest near by, and its strength; 0 if none is."""
    height, width, channels = image.shape
    last = np.zeros(3)
    strengths = np.zeros(2 * _WIDEST_SEARCH + 3)
    best, at = 0.0, -1
    number = 2 * reach + 2
    for i in range(number + 1):
        s = i - reach - 1
        x, y = min(max(u + s * nu, 0.0), width - 1.001), min(max(v + s * nv, 0.0), height - 1.001)
        ix, iy = int(x), int(y)
        fx, fy = x - ix, y - iy
        total = 0.0
        for c in range(channels):
            top = (1.0 - fx) * image[iy, ix, c] + fx * image[iy, ix + 1, c]
            low = (1.0 - fx) * image[iy + 1, ix, c] + fx * image[iy + 1, ix + 1, c]
            value = (1.0 - fy) * top + fy * low
            if i:
                total += (value - last[c]) ** 2
            last[c] = value
        if i:
            strength = math.sqrt(total / channels)
            strengths[i - 1] = strength
            middle = i - reach - 1.5
            preferred = strength * math.exp(-0.5 * (middle / (0.6 * reach)) ** 2)
            if strength >= level and preferred > best:
                best, at = preferred, i - 1
    if at < 0:
        return 0.0, 0.0
    # Only the step itself counts; the slope of the shading beside it would draw the edge inward.
    weight, moment = 0.0, 0.0
    for i in range(max(at - 2, 0), min(at + 3, number)):
        share = max(strengths[i] - 0.4 * strengths[at], 0.0)
        weight += share
        moment += share * (i - reach - 0.5)
    return moment / max(weight, 1e-9), strengths[at]


@njit(cache=True, nogil=True)
def fit_edges(
    form: int,
    start: NDArray,
    support: float,
    eye: NDArray,
    rotation: NDArray,
    lens: NDArray,
    image: NDArray,
    hidden: NDArray,
    level: float,
    contour: NDArray,
    contour_sigma_px: float,
    points: NDArray,
    point_sigma_m: float,
    reaches: NDArray,
) -> tuple[NDArray, NDArray, NDArray]:
    """Move a primitive onto the image's edges (RAPiD), and say how well they agree.

    The contour and the points of :func:`fit_solid` go on to hold what no edge shows.

    Args:
        image: (H, W, c) uint8 levels.
        hidden: (H, W) uint8, not 0 where a finger may hide what is behind.
        level: least step of colour that counts as an edge [levels per px].
        reaches: (n,) int64, how far edges are sought in each pass [px]; the last one judges only.

    Returns:
        Parameters; standard deviation of each, from the edges' scatter; and of the outline's control points the share
        that is visible, of these the share at an edge and their mean squared distance [px^2], the same two of the
        creases' control points (1 and 0 if none is visible), how many creases are visible, how many outline points.
    """
    count = _COUNTS[form]
    p = start.copy()
    reach_m = support - eye[2]
    space = np.empty((MOST_VERTICES, 3))
    uv, moved = np.empty((MOST_VERTICES, 2)), np.empty((count, MOST_VERTICES, 2))
    hull = np.empty(2 * MOST_VERTICES, np.int64)
    pairs = np.empty((_MOST_PAIRS, 2), np.int64)
    controls = np.empty((_MOST_CONTROLS, 8))
    row, step = np.zeros(MOST_PARAMETERS), np.zeros(MOST_PARAMETERS)
    contour_at, edges_at = np.empty(len(contour)), np.empty((len(contour), 2), np.int64)
    sigma = np.full(count, math.inf)
    quality = np.zeros(7)
    passes = len(reaches)
    for turn in range(passes):
        reach = reaches[turn]
        n = project_outline(form, p, support, eye, rotation, lens, space, uv)
        if n == 0:
            return p, sigma, quality
        corners = convex_hull(uv, n, hull)
        if corners < 3:
            return p, sigma, quality
        number, outline = _controls(form, p, support, eye, uv, hull, corners, hidden, pairs, controls)
        varied = p.copy()
        for j in range(count):
            varied[j] = p[j] + _DIFFERENCE
            if project_outline(form, varied, support, eye, rotation, lens, space, moved[j]) == 0:
                return p, sigma, quality
            varied[j] = p[j]
        normal, right = np.zeros((MOST_PARAMETERS, MOST_PARAMETERS)), np.zeros(MOST_PARAMETERS)
        visible, found, squares = 0, 0, 0.0
        crease_visible, crease_found, crease_squares, scatter = 0, 0, 0.0, 0.0
        scale = max(0.35 * reach, 0.7)
        for i in range(number):
            if controls[i, 7] == 0.0:
                continue
            nu, nv = controls[i, 2], controls[i, 3]
            offset, strength = _edge_offset(image, controls[i, 0], controls[i, 1], nu, nv, reach, level)
            capped = min(offset * offset, float(reach * reach)) if strength > 0.0 else float(reach * reach)
            good = strength > 0.0 and abs(offset) < 1.5
            if i < outline:
                visible += 1
                squares += capped
                found += 1 if good else 0
            else:
                crease_visible += 1
                crease_squares += capped
                crease_found += 1 if good else 0
            if strength == 0.0:
                continue
            a, b, f = int(controls[i, 4]), int(controls[i, 5]), controls[i, 6]
            for j in range(count):
                du = (1.0 - f) * moved[j, a, 0] + f * moved[j, b, 0] - controls[i, 0]
                dv = (1.0 - f) * moved[j, a, 1] + f * moved[j, b, 1] - controls[i, 1]
                row[j] = (du * nu + dv * nv) / _DIFFERENCE
            if turn < passes - 1:
                r = offset / scale
                _add(normal, right, row, -offset, 1.0 / (1.0 + 0.25 * r * r) ** 2, count)
            elif good:
                scatter += offset * offset
                _add(normal, right, row, 0.0, 1.0, count)
        if turn == passes - 1:
            quality[0] = visible / max(outline, 1)
            quality[1] = found / max(visible, 1)
            quality[2] = squares / max(visible, 1)
            quality[3] = crease_found / crease_visible if crease_visible else 1.0
            quality[4] = crease_squares / crease_visible if crease_visible else 0.0
            quality[5], quality[6] = crease_visible, outline
            # Neighbouring control points share their error: count the points as one in four.
            variance = 4.0 * max(scatter / max(found + crease_found, 1), 0.08**2)
        else:
            variance = 1.0
        # What the contour and the points know counts in the same unit, 1 px of an edge.
        if len(contour):
            _contour_distances(uv, hull, corners, contour, contour_at, edges_at)
            for i in range(len(contour)):
                for j in range(count):
                    d = line_distance(contour[i, 0], contour[i, 1], moved[j], edges_at[i, 0], edges_at[i, 1])
                    row[j] = (d - contour_at[i]) / _DIFFERENCE
                r = contour_at[i] / contour_sigma_px
                weight = 0.3 / contour_sigma_px**2 / (1.0 + 0.25 * r * r)
                _add(normal, right, row, contour_at[i], weight * (variance if turn == passes - 1 else 1.0), count)
        if len(points):
            per_pixel = 1.0 / (point_sigma_m * point_sigma_m)
            for i in range(len(points)):
                gap = distance(form, p, support, points[i, 0], points[i, 1], points[i, 2])
                for j in range(count):
                    varied[j] = p[j] + _DIFFERENCE
                    d = distance(form, varied, support, points[i, 0], points[i, 1], points[i, 2])
                    row[j] = (d - gap) / _DIFFERENCE
                    varied[j] = p[j]
                r = gap / point_sigma_m
                weight = 0.3 * per_pixel / (1.0 + 0.25 * r * r)
                _add(normal, right, row, gap, weight * (variance if turn == passes - 1 else 1.0), count)
        if turn < passes - 1:
            _solve(normal, right, count, 1e-5, _UNOBSERVED, step)
            for j in range(count):
                most = 0.3 if j == 2 and _has_yaw(form) else 0.03
                p[j] += min(max(step[j], -most), most)
            _bound(form, p, reach_m)
        else:
            for i in range(count):
                normal[i, i] += 1e-3
            for i in range(count):
                unit, column = np.zeros(MOST_PARAMETERS), np.zeros(MOST_PARAMETERS)
                unit[i] = 1.0
                _solve(normal, unit, count, 0.0, 1e-9, column)
                sigma[i] = math.sqrt(variance * max(column[i], 0.0))
    return p, sigma, quality


_TERMS = 9
_MATT_RIDGE = 1e-3
_SENSOR_VARIANCE = 6.0  # levels^2: variation at the level of noise says nothing


@njit(nogil=True)
def _normal_at(
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


@njit(cache=True, nogil=True)
def shading_left(
    form: int,
    p: NDArray,
    support: float,
    eye: NDArray,
    rotation: NDArray,
    lens: NDArray,
    pixels: NDArray,
    levels: NDArray,
) -> float:
    """Return the share of the brightness' variation that a matt primitive's normals leave unexplained, 0 to 1.

    Weighted least squares of the nine spherical harmonics of up to second order, twice, so that what is printed on an
    object and highlights count less. 1 where the primitive is not what the pixels show.

    Args:
        pixels: (n, 2) u, v.
        levels: (n,), their brightness.
    """
    terms, found = np.empty((len(pixels), _TERMS)), np.empty(len(pixels))
    normal = np.empty(3)
    count = 0
    for i in range(len(pixels)):
        a, b = (pixels[i, 0] - lens[2]) / lens[0], (pixels[i, 1] - lens[3]) / lens[1]
        norm = math.sqrt(a * a + b * b + 1.0)
        dx = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]) / norm
        dy = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]) / norm
        dz = (rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]) / norm
        if _normal_at(form, p, support, eye, dx, dy, dz, normal):
            x, y, z = normal
            row = terms[count]
            row[0], row[1], row[2], row[3] = 1.0, x, y, z
            row[4], row[5], row[6], row[7], row[8] = x * y, x * z, y * z, x * x - y * y, 3.0 * z * z - 1.0
            found[count] = levels[i]
            count += 1
    if count < 30 or count < 0.6 * len(pixels):
        return 1.0
    weights, rest = np.ones(count), np.empty(count)
    factor, right = np.empty((_TERMS, _TERMS)), np.empty(_TERMS)
    for _ in range(3):
        for i in range(_TERMS):
            right[i] = 0.0
            for j in range(i + 1):
                factor[i, j] = 0.0
        total = 0.0
        for k in range(count):
            total += weights[k]
            for i in range(_TERMS):
                wt = weights[k] * terms[k, i]
                right[i] += wt * found[k]
                for j in range(i + 1):
                    factor[i, j] += wt * terms[k, j]
        for i in range(_TERMS):
            factor[i, i] += _MATT_RIDGE * total
            for j in range(i + 1):
                value = factor[i, j]
                for k in range(j):
                    value -= factor[i, k] * factor[j, k]
                factor[i, j] = math.sqrt(max(value, 1e-12)) if i == j else value / factor[j, j]
        _substitute(factor, right, _TERMS, right)
        for k in range(count):
            value = found[k]
            for i in range(_TERMS):
                value -= terms[k, i] * right[i]
            rest[k] = value
        scale = max(1.4826 * np.median(np.abs(rest)), 1.0)
        for k in range(count):
            weights[k] = 1.0 / (1.0 + (rest[k] / (2.5 * scale)) ** 2)
    mean, total, left, variation = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        mean += weights[k] * found[k]
        total += weights[k]
    mean /= total
    for k in range(count):
        left += weights[k] * rest[k] ** 2
        variation += weights[k] * (found[k] - mean) ** 2
    return min(left / (variation + _SENSOR_VARIANCE * total), 1.0)
