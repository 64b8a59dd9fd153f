"""Fit of a primitive to points of its contour and of its surface.

Damped Gauss-Newton (Levenberg and Marquardt) on robust residuals (Cauchy), with finite differences of the projected
vertices as Jacobian; a step that does not lower the cost is not taken, so the fit cannot diverge.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
from mbpam_ros.vision.solid_fit.outline import MOST_VERTICES, convex_hull, line_distance, project_outline
from mbpam_ros.vision.solid_fit.surface import distance

_CONVERGED_M = 2e-4
_COARSE_FACTOR = 5.0


@njit(nogil=True)
def contour_distances(
    uv: NDArray, hull: NDArray, corners: int, contour: NDArray, distances: NDArray, edges: NDArray
) -> None:
    """Put the signed distance of each contour point from a hull, positive outside, and its nearest edge into arrays."""
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
def fit_contour(
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
    count = COUNTS[form]
    p = guess.copy()
    reach = support - eye[2]
    keep_possible(form, p, reach)
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
        contour_distances(uv, hull, convex_hull(uv, n, hull), contour, distances, edges)
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
            varied[j] = p[j] + DIFFERENCE
            if project_outline(form, varied, support, eye, rotation, lens, space, moved[j]) == 0:
                usable = False
            varied[j] = p[j]
        if not usable:
            break
        for i in range(k):
            for j in range(count):
                d = line_distance(contour[i, 0], contour[i, 1], moved[j], edges[i, 0], edges[i, 1])
                row[j] = (d - distances[i]) / DIFFERENCE / contour_sigma_px
            r = distances[i] / contour_sigma_px
            add(normal, right, row, r, 1.0 / (1.0 + 0.25 * r * r), count)
        for i in range(m):
            for j in range(count):
                varied[j] = p[j] + DIFFERENCE
                d = distance(form, varied, support, points[i, 0], points[i, 1], points[i, 2])
                row[j] = (d - gaps[i]) / DIFFERENCE / point_sigma_m
                varied[j] = p[j]
            r = gaps[i] / point_sigma_m
            add(normal, right, row, r, 1.0 / (1.0 + 0.25 * r * r), count)
        solve(normal, right, count, damping, UNOBSERVED, step)
        trial = p.copy()
        for j in range(count):
            most = 0.3 if j == 2 and has_yaw(form) else 0.03
            trial[j] += min(max(step[j], -most), most)
        keep_possible(form, trial, reach)
        n = project_outline(form, trial, support, eye, rotation, lens, space, uv)
        trial_cost = math.inf
        if n:
            if k:
                contour_distances(uv, hull, convex_hull(uv, n, hull), contour, trial_distances, trial_edges)
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
