"""Fit of a primitive to the edges of an image (RAPiD: Harris and Stennett, BMVC 1990), and how well they agree."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.vision.solid_fit.contour import contour_distances
from mbpam_ros.vision.solid_fit.normal_equations import (
    COUNTS,
    DIFFERENCE,
    MOST_PARAMETERS,
    UNOBSERVED,
    add,
    has_yaw,
    keep_possible,
    solve,
)
from mbpam_ros.vision.solid_fit.outline import MOST_VERTICES, RING, convex_hull, creases, line_distance, project_outline
from mbpam_ros.vision.solid_fit.surface import distance

_MOST_PAIRS = 2 * MOST_VERTICES + 2 * RING
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


@njit(nogil=True)
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

    The contour and the points of :func:`~mbpam_ros.vision.solid_fit.contour.fit_contour` hold what no edge shows.

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
    count = COUNTS[form]
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
            varied[j] = p[j] + DIFFERENCE
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
                row[j] = (du * nu + dv * nv) / DIFFERENCE
            if turn < passes - 1:
                r = offset / scale
                add(normal, right, row, -offset, 1.0 / (1.0 + 0.25 * r * r) ** 2, count)
            elif good:
                scatter += offset * offset
                add(normal, right, row, 0.0, 1.0, count)
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
            contour_distances(uv, hull, corners, contour, contour_at, edges_at)
            for i in range(len(contour)):
                for j in range(count):
                    d = line_distance(contour[i, 0], contour[i, 1], moved[j], edges_at[i, 0], edges_at[i, 1])
                    row[j] = (d - contour_at[i]) / DIFFERENCE
                r = contour_at[i] / contour_sigma_px
                weight = 0.3 / contour_sigma_px**2 / (1.0 + 0.25 * r * r)
                add(normal, right, row, contour_at[i], weight * (variance if turn == passes - 1 else 1.0), count)
        if len(points):
            per_pixel = 1.0 / (point_sigma_m * point_sigma_m)
            for i in range(len(points)):
                gap = distance(form, p, support, points[i, 0], points[i, 1], points[i, 2])
                for j in range(count):
                    varied[j] = p[j] + DIFFERENCE
                    d = distance(form, varied, support, points[i, 0], points[i, 1], points[i, 2])
                    row[j] = (d - gap) / DIFFERENCE
                    varied[j] = p[j]
                r = gap / point_sigma_m
                weight = 0.3 * per_pixel / (1.0 + 0.25 * r * r)
                add(normal, right, row, gap, weight * (variance if turn == passes - 1 else 1.0), count)
        if turn < passes - 1:
            solve(normal, right, count, 1e-5, UNOBSERVED, step)
            for j in range(count):
                most = 0.3 if j == 2 and has_yaw(form) else 0.03
                p[j] += min(max(step[j], -most), most)
            keep_possible(form, p, reach_m)
        else:
            for i in range(count):
                normal[i, i] += 1e-3
            for i in range(count):
                unit, column = np.zeros(MOST_PARAMETERS), np.zeros(MOST_PARAMETERS)
                unit[i] = 1.0
                solve(normal, unit, count, 0.0, 1e-9, column)
                sigma[i] = math.sqrt(variance * max(column[i], 0.0))
    return p, sigma, quality
