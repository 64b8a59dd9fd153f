"""Least-squares fit of a primitive to what an image shows of it.

Two stages, both damped Gauss-Newton with Jacobians from finite differences of the projected vertices:

1. *contour*: the distances of a mask's contour points to the model's convex silhouette go to zero. Coarse, but works
   from far away.
2. *edges*: along the normals of the model's silhouette (and of a box's visible creases) the strongest step of colour
   is sought in the full image, to a fraction of a pixel (RAPiD: Harris and Stennett, BMVC 1990).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.solids import Shape
from mbpam_ros.vision.camera import Camera
from mbpam_ros.vision.primitives import FIRST_SIZE, YAW_INDEX, box_creases, parameter_count, vertices

_CONTOUR_STEPS = 8
_SEARCH_REACH_PX = (8, 5, 3, 3)
_SPACING_PX = 4.0
_MOST_POINTS = 200
_SMALLEST_SIZE_M = 0.004
_LARGEST_SIZE_M = 0.60
_NEAREST_M = 0.004
_DAMPING = 1e-3
_UNOBSERVED = 3e-5  # keeps what the image does not show (a box's height from straight above) from running away
_WARY_PX = 13  # edges this near to a finger are fitted, but do not make a size certain
_CONVERGED_M = 5e-4  # of the contour fit; the edges do the rest


class FitError(MbpamError, ValueError):
    """A hypothesis has left what can be seen: behind the camera, or a degenerate silhouette."""


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """How a primitive's edges agree with the image's.

    Args:
        shape: of the primitive.
        parameters: see :mod:`mbpam_ros.vision.primitives`.
        size_sigma_m: largest standard deviation of any size or of the position, from the edges' scatter.
        coverage: share of the silhouette's visible control points at which an edge was found.
        visible: share of the silhouette that lies in the image and is not hidden by a finger.
        misfit_px2: mean squared distance of edges from the model, capped where there is none.
    """

    shape: Shape
    parameters: NDArray[np.float64]
    size_sigma_m: float
    coverage: float
    visible: float
    misfit_px2: float


class SilhouetteFit:
    """Fits primitives that stand on the plane z = ``support_depth_m`` of ``gripper_base``.

    Args:
        camera: whose image.
        support_depth_m: z of the support.
        image: (H, W, c) float32 levels, lightly smoothed.
        hidden: (H, W) uint8, not 0 where a finger may hide what is behind.
        edge_levels: least step of colour that counts as an edge [levels per px].
    """

    def __init__(
        self,
        camera: Camera,
        support_depth_m: float,
        image: NDArray[np.float32],
        hidden: NDArray[np.uint8],
        edge_levels: float,
    ) -> None:
        self._camera = camera
        self._support_depth_m = support_depth_m
        self._image = image
        self._hidden = hidden
        self._wary = cv2.dilate(hidden, np.ones((_WARY_PX, _WARY_PX), np.uint8))
        self._edge_levels = edge_levels

    def outline(self, shape: Shape, parameters: NDArray) -> NDArray[np.float64]:
        """The silhouette's corners, (m, 2) px, in order.

        Raises:
            FitError: see there.
        """
        points = self._project(shape, parameters[None])[0]
        return points[_hull(points)]

    def fit_contour(
        self, shape: Shape, guess: NDArray, contour_px: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Stage 1: parameters, and the root mean square distance [px] of the contour from the silhouette.

        Raises:
            FitError: see there.
        """
        parameters, damping = np.array(guess, dtype=float), _DAMPING
        distances, edges = self._distances(shape, parameters, contour_px)
        for _ in range(_CONTOUR_STEPS):
            # At a fixed edge the derivative of the distance is that to the line through its moved ends.
            steps = _steps(shape)
            batch = self._project(shape, parameters + np.diag(steps))
            moved = _line_distance(contour_px, batch[:, edges[0]], batch[:, edges[1]])
            jacobian = (moved - distances).T / steps
            scale = max(1.0, 1.4826 * float(np.median(np.abs(distances))))
            weights = 1.0 / (1.0 + (distances / (2.0 * scale)) ** 2)
            trial = _bounded(shape, parameters, _solve(jacobian, distances, weights, damping), self._reach_m())
            try:
                new_distances, new_edges = self._distances(shape, trial, contour_px)
            except FitError:
                damping *= 10.0
                continue
            old, new = (float((weights * d**2).sum()) for d in (distances, new_distances))
            if new > old:
                damping *= 10.0
                continue
            converged = np.abs(trial - parameters).max() < _CONVERGED_M
            parameters, distances, edges, damping = trial, new_distances, new_edges, max(0.2 * damping, 1e-6)
            if converged:
                break
        return parameters, float(np.sqrt(np.mean(np.minimum(np.abs(distances), 20.0) ** 2)))

    def fit_edges(self, shape: Shape, parameters: NDArray) -> EdgeFit:
        """Stage 2, from the parameters of stage 1.

        Raises:
            FitError: see there.
        """
        for reach in _SEARCH_REACH_PX:
            controls = self._controls(shape, parameters)
            offsets, strengths = self._search(controls, reach)
            found = strengths > 0.0
            jacobian = self._jacobian(shape, parameters, controls)
            if found.sum() <= parameter_count(shape):
                raise FitError("too few edges")
            scale = max(0.3, 1.4826 * float(np.median(np.abs(offsets[found]))))
            weights = np.where(found, 1.0 / (1.0 + (offsets / (2.0 * scale)) ** 2) ** 2, 0.0)
            step = _solve(jacobian, -offsets, weights, 1e-5)
            parameters = _bounded(shape, parameters, step, self._reach_m())
        return self.judge(shape, parameters)

    def judge(self, shape: Shape, parameters: NDArray, others: Iterable[NDArray] = ()) -> EdgeFit:
        """How the parameters agree with the image's edges.

        Without edges within or on the outlines ``others``, which may hide the primitive.

        Raises:
            FitError: too little is visible.
        """
        reach = _SEARCH_REACH_PX[-1]
        controls = self._controls(shape, parameters)
        for outline in others:
            polygon = outline.astype(np.float32)
            inner = [cv2.pointPolygonTest(polygon, (float(u), float(v)), True) for u, v in controls.points]
            controls.visible[np.array(inner) > -float(reach)] = False
        offsets, strengths = self._search(controls, reach)
        found = strengths > 0.0
        squares = np.where(found, np.minimum(offsets**2, reach**2), float(reach**2))
        visible = controls.visible
        if visible.sum() <= parameter_count(shape):
            raise FitError("hidden")
        misfit = float(squares[visible].mean())
        good = found & (np.abs(offsets) < 1.5)
        column, row = controls.points.round().astype(int).T
        sure = good.copy()
        sure[good] = self._wary[row[good], column[good]] == 0
        jacobian = self._jacobian(shape, parameters, controls)[sure]
        # Neighbouring control points share their error: count the points as one in four.
        variance = 4.0 * max(float(np.mean(offsets[good] ** 2)) if good.any() else reach**2, 0.08**2)
        information = jacobian.T @ jacobian + 1e-3 * np.eye(len(parameters))
        sigma = np.sqrt(variance * np.diag(np.linalg.inv(information)))
        sigma[FIRST_SIZE[shape] :] *= 2.0 if shape == "sphere" else 1.0
        lengths = np.delete(sigma, YAW_INDEX) if shape != "sphere" else sigma
        return EdgeFit(
            shape,
            parameters,
            float(lengths.max()),
            float(good[visible].mean()),
            float(visible.mean()),
            misfit,
        )

    # -- projection ---------------------------------------------------------------------------------------------

    def _reach_m(self) -> float:
        return self._support_depth_m - float(self._camera.position_m[2])

    def _project(self, shape: Shape, batch: NDArray) -> NDArray[np.float64]:
        points = vertices(shape, batch, self._support_depth_m, self._camera.position_m)
        optical = (points - self._camera.position_m) @ self._camera.rotation
        if not (optical[..., 2] > _NEAREST_M).all():
            raise FitError("behind the camera")
        k = self._camera.intrinsics
        return optical[..., :2] / optical[..., 2:] * (k.fx, k.fy) + (k.cx, k.cy)

    def _distances(
        self, shape: Shape, parameters: NDArray, points: NDArray
    ) -> tuple[NDArray[np.float64], tuple[NDArray, NDArray]]:
        """Signed distance of points to the silhouette (outside > 0), and the vertices of the nearest edge."""
        projected = self._project(shape, parameters[None])[0]
        start = _hull(projected)
        end = np.roll(start, -1)
        all_distances = _line_distance(points[:, None], projected[None, start], projected[None, end])
        nearest = all_distances.argmax(axis=1)
        return all_distances[np.arange(len(points)), nearest], (start[nearest], end[nearest])

    # -- edges --------------------------------------------------------------------------------------------------

    def _controls(self, shape: Shape, parameters: NDArray) -> _Controls:
        projected = self._project(shape, parameters[None])[0]
        start = _hull(projected)
        pairs = np.column_stack([start, np.roll(start, -1)])
        if shape == "box":
            pairs = np.concatenate([pairs, box_creases(parameters, self._support_depth_m, self._camera.position_m)])
        lengths = np.linalg.norm(projected[pairs[:, 1]] - projected[pairs[:, 0]], axis=1)
        spacing = max(_SPACING_PX, float(lengths.sum()) / _MOST_POINTS)
        counts = np.maximum((lengths / spacing).round().astype(int), 1)
        owner = np.repeat(np.arange(len(pairs)), counts)
        rank = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        fraction = (rank + 0.5) / counts[owner]
        a, b = projected[pairs[owner, 0]], projected[pairs[owner, 1]]
        points = a + fraction[:, None] * (b - a)
        tangent = (b - a) / np.maximum(lengths[owner, None], 1e-9)
        normals = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        height, width = self._hidden.shape
        column, row = (points[:, i].round().astype(int) for i in (0, 1))
        inside = (column >= 2) & (column < width - 2) & (row >= 2) & (row < height - 2)
        visible = inside.copy()
        visible[inside] = self._hidden[row[inside], column[inside]] == 0
        return _Controls(points, normals, pairs[owner, 0], pairs[owner, 1], fraction, visible)

    def _jacobian(self, shape: Shape, parameters: NDArray, controls: _Controls) -> NDArray[np.float64]:
        """Derivative, (n, p), of the control points along their normals."""
        steps = _steps(shape)
        batch = self._project(shape, parameters + np.diag(steps))
        f = controls.fraction[:, None]
        moved = (1.0 - f) * batch[:, controls.start] + f * batch[:, controls.end]
        return np.einsum("kni,ni->nk", moved - controls.points, controls.normals) / steps

    def _search(self, controls: _Controls, reach: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Offset [px] of the strongest edge along each normal, and its strength (0 where there is none)."""
        stations = np.arange(-reach - 1, reach + 2, dtype=np.float64)
        samples = controls.points[:, None] + stations[:, None] * controls.normals[:, None]
        u, v = samples.astype(np.float32)[..., 0], samples.astype(np.float32)[..., 1]
        profile = cv2.remap(self._image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        step = np.diff(profile.reshape(*u.shape, -1), axis=1)
        strength = np.sqrt((step**2).mean(axis=2))
        middle = 0.5 * (stations[1:] + stations[:-1])
        strength[strength < self._edge_levels] = 0.0
        preferred = strength * np.exp(-0.5 * (middle / (0.6 * reach)) ** 2)
        peak = preferred.argmax(axis=1)
        around = np.clip(peak[:, None] + np.arange(-2, 3), 0, len(middle) - 1)
        rows = np.arange(len(peak))[:, None]
        # Only the step itself counts; the slope of the shading beside it would draw the edge inward.
        share = np.maximum(strength[rows, around] - 0.4 * strength[rows, peak[:, None]], 0.0)
        total = share.sum(axis=1)
        offset = (share * middle[around]).sum(axis=1) / np.maximum(total, 1e-9)
        best = np.where(controls.visible, strength[rows[:, 0], peak], 0.0)
        return np.where(best > 0.0, offset, 0.0), best


@dataclass(frozen=True, eq=False)
class _Controls:
    """Points on the model's edges: places, normals [px], the edge's vertices and the fraction between them."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    start: NDArray[np.intp]
    end: NDArray[np.intp]
    fraction: NDArray[np.float64]
    visible: NDArray[np.bool_]


def _hull(points: NDArray) -> NDArray[np.intp]:
    """Indices of the convex hull's corners, in an order that keeps the inside to the left of :func:`_line_distance`."""
    order = cv2.convexHull(points.astype(np.float32), clockwise=False, returnPoints=False).ravel().astype(np.intp)
    if len(order) < 3:
        raise FitError("degenerate silhouette")
    x, y = points[order].T
    area = float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return order if area > 0.0 else order[::-1]


def _line_distance(points: NDArray, start: NDArray, end: NDArray) -> NDArray[np.float64]:
    """Signed distance of points to the lines from ``start`` to ``end``, > 0 outside a hull of :func:`_hull`."""
    along = end - start
    relative = points - start
    cross = along[..., 1] * relative[..., 0] - along[..., 0] * relative[..., 1]
    return cross / np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)


def _steps(shape: Shape) -> NDArray[np.float64]:
    steps = np.full(parameter_count(shape), 2e-5)
    if shape != "sphere":
        steps[YAW_INDEX] = 2e-4
    return steps


def _solve(jacobian: NDArray, residuals: NDArray, weights: NDArray, damping: float) -> NDArray[np.float64]:
    """Step that reduces ``residuals`` (Marquardt's scaling keeps unobserved parameters where they are)."""
    weighted = jacobian * weights[:, None]
    normal = weighted.T @ jacobian
    diagonal = np.diag(normal)
    normal = normal + np.diag(damping * diagonal + _UNOBSERVED * diagonal.max() + 1e-12)
    return -np.linalg.solve(normal, weighted.T @ residuals)


def _bounded(shape: Shape, parameters: NDArray, step: NDArray, reach_m: float) -> NDArray[np.float64]:
    first = FIRST_SIZE[shape]
    moved = parameters + np.clip(step, -0.03, 0.03)
    if shape != "sphere":
        moved[YAW_INDEX] = parameters[YAW_INDEX] + np.clip(step[YAW_INDEX], -0.3, 0.3)
    moved[first:] = np.clip(moved[first:], 0.5 * _SMALLEST_SIZE_M, _LARGEST_SIZE_M)
    tallest = 0.95 * reach_m
    if shape == "box":
        moved[-1] = min(moved[-1], tallest)
    else:
        moved[first] = min(moved[first], 0.5 * tallest)
    return moved
