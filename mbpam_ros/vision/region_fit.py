"""The primitives that may explain one region of an image, and how well each does.

Every first guess (:func:`~mbpam_ros.vision.primitives.first_guesses`: all forms, several heights) is fitted to the
region's contour and, with a depth image, to the points of its surface; of each form the best goes on to the edges of
the full image. What then speaks for and against it is a row of figures, from which
:mod:`~mbpam_ros.vision.confidence` makes the probability that it is right.

Shading is judged by the nine spherical harmonics of up to second order of the normals: they hold 98 % of what any
number of distant lamps makes of a matt surface (Basri and Jacobs, IEEE Trans. PAMI 25, 2003). What it says is one
figure among others and bounded: it cannot overrule edges that agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics
from mbpam_ros.vision.primitives import first_guesses, height, lies, sizes
from mbpam_ros.vision.segmentation import Region
from mbpam_ros.vision.solid_fit_kernel import (
    BOX,
    CAPSULE,
    MOST_VERTICES,
    ROD,
    clipped,
    convex_hull,
    fit_edges,
    fit_solid,
    project_outline,
    shading_left,
)

COARSE = 2
"""Regions are masks of every second pixel."""

_CONTOUR_POINTS = 64
_LEAST_CONTOUR = 12
_CONTOUR_SIGMA_PX = 1.2
_WORST_CONTOUR_PX = 12.0
_SURFACE_POINTS = 80
_STEPS = 18
_REACHES = np.array([8, 5, 3, 3], dtype=np.int64)
_SHADING_SAMPLES = 220
_DOWNWARD = 0.05
_MOST_BOXES = 3
_NO_POINTS = np.empty((0, 3))
_WIDE = 13  # px: an end this near to a finger or to the image's border may be its end


@dataclass(frozen=True, eq=False)
class Surface:
    """What a depth image adds.

    Args:
        points_m: (h, w, 3) in ``gripper_base``, at every second pixel.
        height_m: (h, w), above the support; NaN where nothing is known.
        noise_m: standard deviation.
    """

    points_m: NDArray[np.float32]
    height_m: NDArray[np.float32]
    noise_m: float


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A primitive that may explain a region.

    Args:
        form: a form of :mod:`~mbpam_ros.vision.primitives`.
        parameters: its parameters.
        sigma: standard deviations of these, from the scatter of edges, contour and points.
        outline_px: (m, 2), the silhouette.
        figures: what speaks for and against it, see :data:`FIGURES`.
        ends_seen: whether each end along the length is seen: that at -y, that at +y of its own frame.
        confidence: probability that it is right; set later.
    """

    form: int
    parameters: NDArray[np.float64]
    sigma: NDArray[np.float64]
    outline_px: NDArray[np.float64]
    figures: dict[str, float]
    ends_seen: tuple[bool, bool] = (True, True)
    confidence: float = 0.0


@dataclass(frozen=True, eq=False)
class _Start:
    """What a first guess has become on the contour: root mean squares there, and what is lost in all."""

    form: int
    parameters: NDArray[np.float64]
    contour_px: float
    gap_m: float
    cost: float


class RegionFit:
    """Explains regions of one image.

    Args:
        camera: whose image.
        support_depth_m: z of what objects stand on.
        image: (H, W, c) uint8, lightly smoothed.
        level: (h, w) uint8, brightness at every second pixel.
        hidden: (h, w) uint8, not 0 where a finger may hide what is behind.
        edge_levels: least step of colour that counts as an edge [levels per px].
        surface: of a depth image.
    """

    def __init__(
        self,
        camera: Camera,
        support_depth_m: float,
        image: NDArray[np.uint8],
        level: NDArray[np.uint8],
        hidden: NDArray[np.uint8],
        edge_levels: float,
        surface: Surface | None = None,
    ) -> None:
        k = camera.intrinsics
        self._camera, self._support = camera, support_depth_m
        self._image, self._level, self._edge_levels = image, level, edge_levels
        self.surface = surface
        self._eye = np.ascontiguousarray(camera.position_m, dtype=float)
        self._rotation = np.ascontiguousarray(camera.rotation, dtype=float)
        self._lens = np.array([k.fx, k.fy, k.cx, k.cy])
        self.hidden = hidden
        self.looked_at = 0
        # An edge near a finger may be the finger's: keep off by more than the search reaches in the end.
        near = cv2.dilate(hidden, np.ones((5, 5), np.uint8))
        self._hidden_full = cv2.resize(near, (k.width_px, k.height_px), interpolation=cv2.INTER_NEAREST)
        # Contour pixels beside a finger or at the image's border are not the object's outline.
        self._unsure = near.copy()
        self._unsure[:2], self._unsure[-2:], self._unsure[:, :2], self._unsure[:, -2:] = 1, 1, 1, 1
        self._wide = cv2.dilate(self._unsure, np.ones((_WIDE // COARSE, _WIDE // COARSE), np.uint8))

    def explanations(self, region: Region) -> list[Hypothesis]:
        """Return the best primitive of each family for a region, in no order."""
        self.looked_at += 1
        contour = self._contour(region)
        if len(contour) < _LEAST_CONTOUR:
            return []
        rays = self._camera.rays(contour)
        downward = rays[:, 2] > _DOWNWARD
        if downward.mean() < 0.7:
            return []
        contour, rays = contour[downward], rays[downward]
        inner = cv2.erode(region.mask.view(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
        points, sigma_m = self._surface_points(region, inner)
        samples = self._samples(region, inner)
        starts: list[_Start] = []
        for form, guess in first_guesses(rays, self._support, self._eye):
            parameters, rms, gap = fit_solid(
                form,
                guess,
                self._support,
                self._eye,
                self._rotation,
                self._lens,
                contour,
                _CONTOUR_SIGMA_PX,
                points,
                sigma_m,
                _STEPS,
            )
            if rms < _WORST_CONTOUR_PX:
                starts.append(_Start(form, parameters, rms, gap, rms**2 + (gap / sigma_m) ** 2))
        found = []
        for start in _worth_refining(starts):
            hypothesis = self._refined(start, region, contour, points, sigma_m, samples)
            if hypothesis is not None:
                found.append(hypothesis)
        return _compared(_best_of_families(found))

    # -- what is seen -------------------------------------------------------------------------------------------

    def _contour(self, region: Region) -> NDArray[np.float64]:
        """Points, (n, 2) px of the full image, of the region's outline where nothing hides it."""
        # In the full image, so that the outline runs half a pixel inside, not a whole one.
        full = cv2.resize(region.mask.astype(np.uint8), None, fx=COARSE, fy=COARSE, interpolation=cv2.INTER_NEAREST)
        outlines, _ = cv2.findContours(full, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        if not outlines:
            return np.empty((0, 2))
        points = np.concatenate([outline[:, 0] for outline in outlines])
        points = points + COARSE * np.array([region.left, region.top])
        unsure = self._unsure
        v = np.minimum(points[:, 1] // COARSE, unsure.shape[0] - 1)
        u = np.minimum(points[:, 0] // COARSE, unsure.shape[1] - 1)
        points = points[unsure[v, u] == 0]
        stride = max(len(points) // _CONTOUR_POINTS, 1)
        return np.ascontiguousarray(points[::stride], dtype=float)

    def _surface_points(self, region: Region, inner: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
        if self.surface is None:
            return _NO_POINTS, 1.0
        with np.errstate(invalid="ignore"):
            inner = inner & (self.surface.height_m[region.window] > 2.0 * self.surface.noise_m)
        points = self.surface.points_m[region.window][inner]
        stride = max(len(points) // _SURFACE_POINTS, 1)
        sigma = max(1.5 * self.surface.noise_m, 0.0012)
        return np.ascontiguousarray(points[::stride], dtype=float), sigma

    def _samples(self, region: Region, inner: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels, (n, 2) of the full image, inside of the region, and their brightness, (n,)."""
        rows, columns = np.nonzero(inner)
        stride = max(len(rows) // _SHADING_SAMPLES, 1)
        rows, columns = rows[::stride] + region.top, columns[::stride] + region.left
        pixels = np.column_stack([columns, rows]).astype(np.float64) * COARSE + 0.5 * (COARSE - 1)
        return pixels, self._level[rows, columns].astype(np.float64)

    # -- how well a form agrees ---------------------------------------------------------------------------------

    def _refined(
        self,
        start: _Start,
        region: Region,
        contour: NDArray[np.float64],
        points: NDArray[np.float64],
        sigma_m: float,
        samples: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Hypothesis | None:
        form, rms, gap = start.form, start.contour_px, start.gap_m
        parameters, sigma, quality = fit_edges(
            form,
            start.parameters,
            self._support,
            self._eye,
            self._rotation,
            self._lens,
            self._image,
            self._hidden_full,
            self._edge_levels,
            contour,
            _CONTOUR_SIGMA_PX,
            points,
            sigma_m,
            _REACHES,
        )
        outline = self._outline(form, parameters)
        if outline is None or quality[0] == 0.0:
            return None
        overlap, beyond = self._overlap(outline, region)
        size = sizes(form, parameters)
        size_sigma = sizes(form, np.where(np.isfinite(sigma), sigma, 1.0))
        sharpest = float(np.sort(size)[1])
        figures = {
            "contour_px": rms,
            "gap_sigmas": gap / sigma_m if len(points) else 0.0,
            "visible": float(quality[0]),
            "coverage": float(quality[1]),
            "misfit_px2": float(quality[2]),
            "crease_coverage": float(quality[3]),
            "crease_misfit_px2": float(quality[4]),
            "overlap": overlap,
            "beyond": beyond,
            "shading": shading_left(form, parameters, self._support, self._eye, self._rotation, self._lens, *samples),
            "size_sigma_m": float(size_sigma.max()),
            "width_sigma_m": float(size_sigma.min()),
            "height_m": height(form, parameters),
            "slim": float(min(size.min() / max(sharpest, 1e-6), 1.0)),
        }
        return Hypothesis(form, parameters, sigma, outline, figures, self._ends_seen(form, parameters))

    def _outline(self, form: int, parameters: NDArray) -> NDArray[np.float64] | None:
        space, uv = np.empty((MOST_VERTICES, 3)), np.empty((MOST_VERTICES, 2))
        count = project_outline(form, parameters, self._support, self._eye, self._rotation, self._lens, space, uv)
        if count == 0:
            return None
        hull = np.empty(2 * MOST_VERTICES, np.int64)
        corners = convex_hull(uv, count, hull)
        return uv[hull[:corners]].copy() if corners >= 3 else None

    def _overlap(self, outline: NDArray[np.float64], region: Region) -> tuple[float, float]:
        """Shared area over joint area, and the share of the silhouette that is not of the region."""
        local = (outline - 0.5 * (COARSE - 1)) / COARSE - (region.left, region.top)
        corners = np.clip(np.round(local * 16.0), -(2**20), 2**20).astype(np.int32)
        model = np.zeros(region.mask.shape, np.uint8)
        cv2.fillConvexPoly(model, corners, 1, shift=4)
        # What lies beyond the window shares nothing with the region, and is hidden or not as what lies within.
        drawn = float(np.count_nonzero(model))
        outside = self._area_in_image(outline) / COARSE**2 - drawn
        open_view = self.hidden[region.window] == 0
        seen = model.astype(bool) & open_view
        shared = float(np.count_nonzero(seen & region.mask))
        area = float(np.count_nonzero(seen)) + max(outside, 0.0)
        joint = area + float(np.count_nonzero(region.mask & open_view)) - shared
        return shared / max(joint, 1.0), 1.0 - shared / max(area, 1.0)

    def _area_in_image(self, outline: NDArray[np.float64]) -> float:
        k = self._camera.intrinsics
        frame = np.array([[0, 0], [k.width_px, 0], [k.width_px, k.height_px], [0, k.height_px]], float)
        if (outline.min(axis=0) >= 0.0).all() and (outline.max(axis=0) <= frame[2]).all():
            return float(cv2.contourArea(outline.astype(np.float32)))
        turned = outline if cv2.contourArea(outline.astype(np.float32), oriented=True) > 0.0 else outline[::-1]
        part = clipped(np.ascontiguousarray(turned), frame)
        return float(cv2.contourArea(part.astype(np.float32))) if len(part) >= 3 else 0.0

    def _ends_seen(self, form: int, parameters: NDArray) -> tuple[bool, bool]:
        """Whether the ends of a form with a length lie in the image, away from its border and from fingers."""
        if not lies(form):
            return True, True
        p = parameters
        along = np.array([-np.sin(p[2]), np.cos(p[2]), 0.0])
        tall = height(form, p)
        seen = []
        for sign in (-1.0, 1.0):
            end = np.array([p[0], p[1], self._support - 0.5 * tall]) + sign * 0.5 * p[4] * along
            # Its top is nearer to the camera and leaves the image first.
            seen.append(self._in_open_view(end) and self._in_open_view(end - (0.0, 0.0, 0.5 * tall)))
        return seen[0], seen[1]

    def _in_open_view(self, point_m: NDArray[np.float64]) -> bool:
        """Whether a point lies in the image, away from its border and from fingers."""
        optical = (point_m - self._eye) @ self._rotation
        if optical[2] < 1e-3:
            return False
        u = (optical[0] / optical[2] * self._lens[0] + self._lens[2]) / COARSE
        v = (optical[1] / optical[2] * self._lens[1] + self._lens[3]) / COARSE
        inside = 0 <= u < self._wide.shape[1] and 0 <= v < self._wide.shape[0]
        return bool(inside and self._wide[int(v), int(u)] == 0)


@lru_cache(maxsize=1)
def load_kernels() -> None:
    """Call what is compiled once, with and without points: the first frame then waits for no compiler and no cache."""
    pose = CameraPose(np.eye(3), np.zeros(3))
    camera = Camera(Intrinsics(160, 120, 150.0, 150.0, 79.5, 59.5), pose)
    level = np.full((60, 80), 60, np.uint8)
    mask = np.zeros(level.shape, bool)
    mask[20:40, 30:50] = True
    image = np.full((120, 160, 3), 60, np.uint8)
    image[40:80, 60:100] = 200
    hidden = np.zeros(level.shape, np.uint8)
    v, u = np.mgrid[0:60, 0:80].astype(np.float32)
    points = np.stack([(2.0 * u - 79.5) / 500.0, (2.0 * v - 59.5) / 500.0, np.full_like(u, 0.27)], axis=-1)
    for surface in (None, Surface(points, np.full(level.shape, 0.03, np.float32), 0.001)):
        RegionFit(camera, 0.3, image, level, hidden, 4.0, surface).explanations(Region(0, 0, mask))


def _worth_refining(starts: list[_Start]) -> list[_Start]:
    """The best of each form, and boxes of other heights that do about as well: the edges decide between these."""
    closest = min((start.cost for start in starts), default=0.0)
    kept: list[_Start] = []
    for start in sorted(starts, key=lambda item: item.cost):
        same = [other for other in kept if other.form == start.form]
        if start.cost > max(9.0, 6.0 * closest) or len(same) >= (_MOST_BOXES if start.form == BOX else 1):
            continue
        if all(abs(np.log(height(BOX, start.parameters) / height(BOX, other.parameters))) > 0.2 for other in same):
            if not same or start.cost < 2.0 * same[0].cost + 1.0:
                kept.append(start)
    return kept


def _best_of_families(found: list[Hypothesis]) -> list[Hypothesis]:
    """One of each family: a rod with flat or with round ends is one answer, as are boxes of several heights."""
    best: dict[int, Hypothesis] = {}
    for item in found:
        size = sizes(item.form, item.parameters)
        if item.form == CAPSULE and size[2] < 1.25 * size[0]:
            continue  # a ball
        family = ROD if item.form == CAPSULE else item.form
        if family not in best or _disagreement(item) < _disagreement(best[family]):
            best[family] = item
    return list(best.values())


def _disagreement(item: Hypothesis) -> float:
    figures = item.figures
    outline = figures["misfit_px2"] + min(figures["contour_px"], 4.0) + figures["gap_sigmas"] ** 2
    return outline + 0.5 * figures["crease_misfit_px2"] + 3.0 * figures["shading"]


def _compared(found: list[Hypothesis]) -> list[Hypothesis]:
    """Add how each compares with the best of the others."""
    result = []
    for item in found:
        others = [other.figures for other in found if other is not item]
        relative = {
            f"{name}_lead": min((other[name] for other in others), default=cap) - item.figures[name]
            for name, cap in (("contour_px", 4.0), ("misfit_px2", 9.0), ("shading", 1.0), ("gap_sigmas", 4.0))
        }
        result.append(replace(item, figures={**item.figures, **relative}))
    return result


def same_place(first: Hypothesis, second: Hypothesis) -> bool:
    """Whether more than a fifth of the smaller outline lies in the other: two readings of one object."""
    a, b = (item.outline_px.astype(np.float32) for item in (first, second))
    shared, _ = cv2.intersectConvexConvex(a, b)
    return bool(shared > 0.2 * min(cv2.contourArea(a), cv2.contourArea(b)))
