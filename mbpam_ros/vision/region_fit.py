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

import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics
from mbpam_ros.vision.primitives import at_height, canonical, first_guesses, height, lies, sizes
from mbpam_ros.vision.segmentation import Region
from mbpam_ros.vision.solid_fit.compiled import clipped, fit_contour, fit_edges, silhouette, unexplained_shading
from mbpam_ros.vision.solid_fit.outline import BOX, CAPSULE, ROD

COARSE = 2
"""Regions are masks of every second pixel."""

LONGEST_M = 0.3
"""By how much a length may be longer that runs out of the image."""

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
_STATION_M = 0.003
_STATIONS_M = 0.002 + _STATION_M * np.arange(100)  # beyond an end that may not be its end
_ACROSS = np.linspace(-0.8, 0.8, 7)
_ENOUGH = 2  # of these places show that the object is there, or that it is not
_UNSEEN_SIGMA_M = 0.015
_LIKELY_HEIGHTS = (0.5, 1.6)  # over the height at which a box is as high as it is wide
_NEAR_M = 0.05  # beside the palm's axis
_NARROW_M = 0.012
"""A length that is known to half of this is known."""


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
        height_range_m: least and greatest height of a box of which the top alone is seen, so that its other sizes are
            those at each height; None where the height is seen.
        hidden_m: how much farther the length may reach behind a finger or out of the image: at the end at -y, at that
            at +y of its own frame; 0 where the end is seen.
        confidence: probability that it is right; set later.
    """

    form: int
    parameters: NDArray[np.float64]
    sigma: NDArray[np.float64]
    outline_px: NDArray[np.float64]
    figures: dict[str, float]
    hidden_m: tuple[float, float] = (0.0, 0.0)
    height_range_m: tuple[float, float] | None = None
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
        foreground: (h, w) bool, where objects are.
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
        foreground: NDArray[np.bool_],
        edge_levels: float,
        surface: Surface | None = None,
    ) -> None:
        k = camera.intrinsics
        self._camera, self._support = camera, support_depth_m
        self._image, self._level, self._edge_levels = image, level, edge_levels
        self.surface = surface
        self._foreground = foreground
        self._eye = np.ascontiguousarray(camera.position_m, dtype=float)
        self._rotation = np.ascontiguousarray(camera.rotation, dtype=float)
        self._lens = np.array([k.fx, k.fy, k.cx, k.cy])
        self.hidden = hidden
        self._open = (hidden == 0).view(np.uint8)
        self.looked_at = 0
        # An edge near a finger may be the finger's: keep off by more than the search reaches in the end.
        near = cv2.dilate(hidden, np.ones((5, 5), np.uint8))
        self._hidden_full = cv2.resize(near, (k.width_px, k.height_px), interpolation=cv2.INTER_NEAREST)
        # Contour pixels beside a finger or at the image's border are not the object's outline.
        self._unsure = near.copy()
        self._unsure[:2], self._unsure[-2:], self._unsure[:, :2], self._unsure[:, -2:] = 1, 1, 1, 1

    def with_foreground(self, foreground: NDArray[np.bool_]) -> RegionFit:
        """Return one that takes other places, (h, w), for those where objects are."""
        other = copy.copy(self)
        other._foreground = foreground
        return other

    def is_aside(self, region: Region) -> bool:
        """Whether a region lies so far beside the palm's axis that what it shows cannot be grasped as it lies."""
        return not bool((self._under_hand[region.window] & region.mask).any())

    @cached_property
    def _under_hand(self) -> NDArray[np.bool_]:
        """Which pixels, (h, w), lie near the palm's axis on the support."""
        height, width = self._level.shape
        near = np.zeros((height, width), bool)
        optical = (np.array([0.0, 0.0, self._support]) - self._eye) @ self._rotation
        if optical[2] >= 1e-3:
            u, v = (optical[:2] / optical[2] * self._lens[:2] + self._lens[2:]) / COARSE
            near_px = _NEAR_M * self._lens[0] / optical[2] / COARSE
            near = (np.arange(width) - u) ** 2 + (np.arange(height)[:, None] - v) ** 2 <= near_px**2
        return near

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
            parameters, rms, gap = fit_contour(
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
        return _compared([self._with_unseen_ends(item) for item in _best_of_families(found)])

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
        parameters, height_range_m = canonical(form, parameters), None
        if form == BOX and sigma[5] > _UNSEEN_SIGMA_M:
            parameters, height_range_m = self._of_likely_height(parameters)
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
            "shading": unexplained_shading(
                form, parameters, self._support, self._eye, self._rotation, self._lens, *samples
            ),
            "size_sigma_m": float(size_sigma.max()),
            "width_sigma_m": float(size_sigma.min()),
            "height_m": height(form, parameters),
            "shadowy": 1.0 - float(np.count_nonzero(region.mask & self._foreground[region.window])) / region.area,
            "slim": float(min(size.min() / max(sharpest, 1e-6), 1.0)),
        }
        return Hypothesis(form, parameters, sigma, outline, figures, height_range_m=height_range_m)

    def _of_likely_height(self, parameters: NDArray) -> tuple[NDArray[np.float64], tuple[float, float]]:
        """A box of which the top alone is seen, as high as it is wide, and the range of heights that are likely.

        All boxes that stand below the same cone of rays look the same: seen against the table the top is w0 wide, so
        w(h) = w0 (1 - h / D), D being the eye's height; w(h) = h at h = w0 / (1 + w0 / D).
        """
        eye_height = self._support - float(self._eye[2])
        against_table = parameters[3] / (1.0 - parameters[5] / eye_height)
        likely = against_table / (1.0 + against_table / eye_height)
        least, most = (share * likely for share in _LIKELY_HEIGHTS)
        return at_height(parameters, likely, self._support, self._eye), (least, most)

    def _outline(self, form: int, parameters: NDArray) -> NDArray[np.float64] | None:
        corners = silhouette(form, parameters, self._support, self._eye, self._rotation, self._lens)
        return corners if len(corners) >= 3 else None

    def _overlap(self, outline: NDArray[np.float64], region: Region) -> tuple[float, float]:
        """Shared area over joint area, and the share of the silhouette that is not of the region."""
        local = (outline - 0.5 * (COARSE - 1)) / COARSE - (region.left, region.top)
        corners = np.clip(np.round(local * 16.0), -(2**20), 2**20).astype(np.int32)
        model = np.zeros(region.mask.shape, np.uint8)
        cv2.fillConvexPoly(model, corners, 1, shift=4)
        # What lies beyond the window shares nothing with the region, and is hidden or not as what lies within.
        drawn = float(cv2.countNonZero(model))
        outside = self._area_in_image(outline) / COARSE**2 - drawn
        seen = cv2.bitwise_and(model, self._open[region.window])
        mask = region.mask.view(np.uint8)
        shared = float(cv2.countNonZero(cv2.bitwise_and(seen, mask)))
        area = float(cv2.countNonZero(seen)) + max(outside, 0.0)
        joint = area + float(cv2.countNonZero(cv2.bitwise_and(mask, self._open[region.window]))) - shared
        return shared / max(joint, 1.0), 1.0 - shared / max(area, 1.0)

    def _area_in_image(self, outline: NDArray[np.float64]) -> float:
        k = self._camera.intrinsics
        frame = np.array([[0, 0], [k.width_px, 0], [k.width_px, k.height_px], [0, k.height_px]], float)
        if (outline.min(axis=0) >= 0.0).all() and (outline.max(axis=0) <= frame[2]).all():
            return float(cv2.contourArea(outline.astype(np.float32)))
        turned = outline if cv2.contourArea(outline.astype(np.float32), oriented=True) > 0.0 else outline[::-1]
        part = clipped(np.ascontiguousarray(turned), frame)
        return float(cv2.contourArea(part.astype(np.float32))) if len(part) >= 3 else 0.0

    def _with_unseen_ends(self, found: Hypothesis) -> Hypothesis:
        """The hypothesis with what is known of ends that a finger or the image's border may hide."""
        rows, columns = self._unsure.shape
        left, top = np.maximum(found.outline_px.min(axis=0) / COARSE - 2.0, 0.0).astype(int)
        right, bottom = np.minimum(found.outline_px.max(axis=0) / COARSE + 3.0, (columns, rows)).astype(int)
        if not lies(found.form) or not self._unsure[top:bottom, left:right].any():
            return found
        parameters, hidden_m = self._unseen_ends(found.form, found.parameters)
        outline = self._outline(found.form, parameters)
        if outline is None:
            return found
        return replace(found, parameters=parameters, outline_px=outline, hidden_m=hidden_m)

    def _unseen_ends(self, form: int, parameters: NDArray) -> tuple[NDArray[np.float64], tuple[float, float]]:
        """The parameters with what is seen of the object beyond a finger, and how much farther each end may reach [m].

        From each end on along the axis, until the table is seen where the object would be.
        """
        p = parameters
        along = np.array([-np.sin(p[2]), np.cos(p[2]), 0.0])
        across = np.array([np.cos(p[2]), np.sin(p[2]), 0.0]) * p[3] * (0.5 if form == BOX else 1.0)
        middle = np.array([p[0], p[1], self._support - 0.5 * height(form, p)])
        longer, hidden = [], []
        for sign in (-1.0, 1.0):
            beyond = middle + np.outer(sign * (0.5 * p[4] + _STATIONS_M), along)
            seen, of_object = self._in_open_view(beyond + _ACROSS[:, None, None] * across)
            ended = (seen & ~of_object).sum(axis=0) >= _ENOUGH
            count = int(ended.argmax()) if ended.any() else len(_STATIONS_M)
            again = np.flatnonzero((seen & of_object).sum(axis=0)[:count] >= _ENOUGH)
            # Only what lies beyond something hidden is the object again.
            more = int(again[-1]) + 1 if len(again) and seen[:, 0].sum() < _ENOUGH else 0
            longer.append(_STATION_M * more)
            hidden.append(_STATION_M * (count - more) if ended.any() else LONGEST_M)
        back, forth = hidden
        if 0.0 < back + forth < _NARROW_M:  # as good as seen
            longer, back, forth = [longer[0] + 0.5 * back, longer[1] + 0.5 * forth], 0.0, 0.0
        return _lengthened(p, *longer), (back, forth)

    def _in_open_view(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether points, (..., 3), lie in the image, away from its border and from fingers; and in the foreground."""
        optical = (points_m - self._eye) @ self._rotation
        depth = np.maximum(optical[..., 2], 1e-3)
        u = (optical[..., 0] / depth * self._lens[0] + self._lens[2]) / COARSE
        v = (optical[..., 1] / depth * self._lens[1] + self._lens[3]) / COARSE
        rows, columns = self._unsure.shape
        inside = (optical[..., 2] > 1e-3) & (u >= 0.0) & (u < columns) & (v >= 0.0) & (v < rows)
        row, column = (np.where(inside, value, 0.0).astype(int) for value in (v, u))
        seen = inside & (self._unsure[row, column] == 0)
        return seen, seen & self._foreground[row, column]


def _lengthened(parameters: NDArray[np.float64], back_m: float, forth_m: float) -> NDArray[np.float64]:
    """The same form, longer at the end at -y and at that at +y of its own frame."""
    p = parameters.copy()
    shift = 0.5 * (forth_m - back_m)
    p[0] -= shift * np.sin(p[2])
    p[1] += shift * np.cos(p[2])
    p[4] += back_m + forth_m
    return p


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
        RegionFit(camera, 0.3, image, level, hidden, mask, 4.0, surface).explanations(Region(0, 0, mask))


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
    # The rim of a rod's end is often faint, and round ends have none: it does not tell these two apart.
    creases = 0.0 if item.form in (ROD, CAPSULE) else 0.5 * figures["crease_misfit_px2"]
    return outline + creases + 3.0 * figures["shading"]


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
