"""From one image of a calibrated camera to the shapes, sizes and places of the objects on the support plane.

Segmentation from the table (its colour learnt from the image) gives regions; every region is fitted by a sphere, a
lying cylinder and a box through the pinhole model (:mod:`mbpam_ros.vision.silhouette_fit`), with the height of the
object over the support as part of the fit; the shape is the one whose edges and whose shading agree best.

Taken for granted: objects stand on the plane z = ``support_depth_m`` of ``gripper_base``, cylinders lie, boxes stand
on a face, and the light comes from far away. A stand whose hue differs from the floor's and on which nothing stands
is taken for a box. The height of a box is seen only where the camera sees one of its side faces.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.configuration import load_config, require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.solids import SHAPES, Shape
from mbpam_ros.gripper import Gripper
from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics
from mbpam_ros.vision.primitives import (
    Footprint,
    canonical,
    first_guesses,
    orientation_xyzw,
    sizes,
    to_body,
)
from mbpam_ros.vision.raycast import chords, hit_body, hit_capsule, surface_normals
from mbpam_ros.vision.segmentation import (
    SegmentationConfig,
    connected_regions,
    foreground,
    split_by_edges,
    split_by_hue,
)
from mbpam_ros.vision.silhouette_fit import EdgeFit, FitError, SilhouetteFit

Encoding = Literal["rgb8", "bgr8", "mono8"]
ENCODINGS: tuple[Encoding, ...] = ("rgb8", "bgr8", "mono8")
LABELS: dict[str, str] = {"sphere": "sphere", "cylinder": "rod", "box": "box"}

_COARSE = 2  # segmentation works on every second pixel
_CONTOUR_POINTS = 90
_WORST_CONTOUR_PX = 14.0
_CONTOUR_TIE_PX = 3.0
_GOOD_CONTOUR_PX = 1.0
_SHADING_SAMPLES = 500
_SHADING_WEIGHT_PX2 = 6.0
_GOOD_COST_PX2 = 1.0
_LEAST_OVERLAP = 0.6
_SAG_M = 5e-4  # of the fingers' chords, well within the margin of their mask
_MOST_PIECES = 4


class ImageError(MbpamError, ValueError):
    """An image that cannot be used: encoding, type or size are not what they are said to be."""


@dataclass(frozen=True)
class DetectorConfig:
    """What ``config/detector.yaml`` says.

    Args:
        segmentation: thresholds of the foreground.
        edge_levels: least step of brightness that counts as an edge [8 bit levels per px].
        finger_margin_m: fingers are masked this much thicker than they are.
        accepted_size_sigma_m: confidence halves at this standard deviation of a size or of the position.
        min_confidence: less certain detections are dropped.
        min_object_size_m: what is smaller in any extent is dropped.
    """

    segmentation: SegmentationConfig
    edge_levels: float
    finger_margin_m: float
    accepted_size_sigma_m: float
    min_confidence: float
    min_object_size_m: float

    def __post_init__(self) -> None:
        require_positive(self, "edge_levels", "accepted_size_sigma_m", "min_object_size_m")
        if self.finger_margin_m < 0.0 or not 0.0 <= self.min_confidence <= 1.0:
            raise ValueError("finger_margin_m must not be negative, min_confidence must lie in 0..1")


def load_detector_config(name: str | Path = "detector.yaml") -> DetectorConfig:
    """Read the detector file ``name``.

    Raises:
        ConfigError: wrong keys or values.
    """
    return load_config(DetectorConfig, name)


@dataclass(frozen=True, eq=False)
class Detection:
    """One object, in ``gripper_base``. Sizes as in ``visualization_msgs/Marker``.

    Args:
        shape: sphere, cylinder (axis along body z) or box (body x = width, y = length >= width, z = height).
        size_m: (3,).
        position_m: (3,), centre.
        orientation_xyzw: (4,); at identity the box's length, at yaw 0 the cylinder's axis lie along y. Yaw lies in
            (-90, 90] deg, as neither has a front.
        confidence: 0 to 1: share of the silhouette's visible edge that was found, times how well the edges agree,
            times how sure they make the size. Low where the image's border or a finger hides an end of the object.
        label: what to call it.
        contour_px: (m, 2), the model's outline in the image as it was given.
    """

    shape: Shape
    size_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    orientation_xyzw: NDArray[np.float64]
    confidence: float
    label: str
    contour_px: NDArray[np.float64]

    @property
    def yaw_rad(self) -> float:
        """Angle from gripper y to the object's length, about z; 0 for a sphere."""
        x, y, z, w = self.orientation_xyzw
        if self.shape == "sphere":
            return 0.0
        # Image of the body axis that carries the length: z of a cylinder, y of a box.
        if self.shape == "cylinder":
            along = (2.0 * (x * z + y * w), 2.0 * (y * z - x * w))
        else:
            along = (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z))
        return math.atan2(-along[0], along[1])


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    fit: EdgeFit
    cost_px2: float
    overlap: float
    outline: NDArray[np.float64]
    holes: bool


class ObjectDetector:
    """Finds the objects in a stream of images; keeps what depends on the camera alone.

    Args:
        config: thresholds.
        pose: of the camera's optical frame in ``gripper_base``.
        gripper: whose open fingers may hide parts of the scene; ``None`` for a camera without fingers in view.
    """

    def __init__(self, config: DetectorConfig, pose: CameraPose, gripper: Gripper | None = None) -> None:
        self._config = config
        self._pose = pose
        self._finger_radius_m = gripper.geometry.outer_radius_m if gripper else 0.0
        self._open_fingers = _straight_fingers(gripper) if gripper else None
        self._views: dict[Intrinsics, _View] = {}

    def detect(
        self,
        image: NDArray[np.uint8],
        encoding: str,
        intrinsics: Intrinsics,
        distortion: ArrayLike | None,
        support_depth_m: float,
        finger_centrelines_m: NDArray[np.float64] | None = None,
    ) -> list[Detection]:
        """Objects in ``image``, the surest first; an empty list if there are none.

        Args:
            image: (H, W, 3), or (H, W) for mono8, uint8.
            encoding: rgb8, bgr8 or mono8.
            intrinsics: of the image's CameraInfo.
            distortion: D of the CameraInfo, up to 8 coefficients of plumb_bob or rational_polynomial; None or zeros
                for none.
            support_depth_m: z of the plane the objects stand on, from the palm.
            finger_centrelines_m: (4, n, 3), where the fingers are if they are not open.

        Raises:
            ImageError: type, encoding, size, depth or centrelines do not fit.
        """
        grey_or_rgb = _checked(image, encoding, intrinsics)
        if not math.isfinite(support_depth_m) or support_depth_m <= self._pose.position_m[2]:
            raise ImageError(f"support_depth_m must lie below the camera, found {support_depth_m}")
        lens = _lens(distortion)
        if lens is not None:
            grey_or_rgb = cv2.undistort(grey_or_rgb, intrinsics.matrix, lens).astype(np.uint8, copy=False)
        view = self._view(intrinsics)
        fingers = self._open_fingers
        if finger_centrelines_m is not None:
            fingers = np.asarray(finger_centrelines_m, dtype=float)
            if fingers.ndim != 3 or fingers.shape[1] < 2 or fingers.shape[2] != 3 or not np.isfinite(fingers).all():
                raise ImageError(f"finger_centrelines_m must be finite and (4, n >= 2, 3), found {fingers.shape}")
        hidden = view.hidden_by(fingers, self._finger_radius_m + self._config.finger_margin_m)
        found = _Search(self._config, view.camera, support_depth_m, grey_or_rgb, hidden).run()
        return [self._detection(item, view.camera, lens, support_depth_m) for item in found]

    def _view(self, intrinsics: Intrinsics) -> _View:
        if intrinsics not in self._views:
            self._views = {intrinsics: _View(Camera(intrinsics, self._pose))}
        return self._views[intrinsics]

    def _detection(self, found: _Hypothesis, camera: Camera, lens: NDArray | None, support_depth_m: float) -> Detection:
        shape = found.fit.shape
        parameters = canonical(shape, found.fit.parameters)
        body = to_body(shape, parameters, support_depth_m)
        outline = found.outline if lens is None else _distorted(found.outline, camera.intrinsics, lens)
        return Detection(
            shape,
            sizes(shape, parameters),
            np.array(body.centre),
            orientation_xyzw(body),
            _confidence(found, self._config),
            LABELS[shape],
            outline,
        )


def _checked(image: NDArray, encoding: str, intrinsics: Intrinsics) -> NDArray[np.uint8]:
    """The image as rgb (H, W, 3) or grey (H, W), after all checks."""
    if encoding not in ENCODINGS:
        raise ImageError(f"encoding {encoding!r} is not one of {', '.join(ENCODINGS)}")
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        raise ImageError(f"the image must be a uint8 array, found {getattr(image, 'dtype', type(image).__name__)}")
    expected: tuple[int, ...] = (intrinsics.height_px, intrinsics.width_px)
    if encoding != "mono8":
        expected = (*expected, 3)
    if image.shape != expected:
        raise ImageError(f"image of shape {image.shape} does not fit {encoding} and its CameraInfo: {expected}")
    return image[..., ::-1] if encoding == "bgr8" else image


def _lens(distortion: ArrayLike | None) -> NDArray[np.float64] | None:
    if distortion is None:
        return None
    d = np.asarray(distortion, dtype=float).ravel()
    if d.size not in (0, 4, 5, 8) or not np.isfinite(d).all():
        raise ImageError(f"D must hold 0, 4, 5 or 8 finite coefficients, found {d}")
    return d if d.any() else None


def _distorted(pixels: NDArray, intrinsics: Intrinsics, lens: NDArray) -> NDArray[np.float64]:
    k = intrinsics
    rays = np.column_stack([(pixels - (k.cx, k.cy)) / (k.fx, k.fy), np.ones(len(pixels))])
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), k.matrix, lens)
    return seen.reshape(-1, 2).astype(np.float64, copy=False)


def _straight_fingers(gripper: Gripper) -> NDArray[np.float64]:
    base = gripper.finger_base_m
    return np.stack([base, base + (0.0, 0.0, gripper.geometry.length_m)], axis=1)


def _confidence(found: _Hypothesis, config: DetectorConfig) -> float:
    fit = found.fit
    certainty = 1.0 / (1.0 + (fit.size_sigma_m / config.accepted_size_sigma_m) ** 2)
    agreement = math.exp(-0.25 * found.cost_px2)
    return float(np.clip(fit.coverage * found.overlap * agreement * certainty, 0.0, 1.0))


class _View:
    """The camera's rays at the coarse pixels, and the mask of the fingers last seen."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        k = camera.intrinsics
        v, u = np.mgrid[0 : k.height_px : _COARSE, 0 : k.width_px : _COARSE]
        rays = camera.rays(np.stack([u, v], axis=-1) + 0.5 * (_COARSE - 1)).astype(np.float32)
        x, y, z = (np.ascontiguousarray(rays[..., i]) for i in range(3))
        self._rays = x, y, z
        self._fingers: NDArray[np.float64] | None = None
        self._hidden = np.zeros(self._rays[0].shape, dtype=np.uint8)

    def hidden_by(self, fingers_m: NDArray[np.float64] | None, radius_m: float) -> NDArray[np.uint8]:
        """Coarse mask, (h, w) uint8, of what fingers (4, n, 3) may hide."""
        if fingers_m is None:
            return np.zeros_like(self._hidden)
        if self._fingers is None or not np.array_equal(fingers_m, self._fingers):
            hidden = np.zeros(self._hidden.shape, dtype=bool)
            for line in (chords(line, _SAG_M) for line in fingers_m):
                for start, end in zip(line[:-1], line[1:], strict=True):
                    x, y, z = (self.camera.position_m - start).astype(np.float32)
                    hidden |= np.isfinite(
                        hit_capsule((x, y, z), self._rays, (end - start).astype(np.float32), radius_m)
                    )
            self._fingers, self._hidden = np.array(fingers_m), hidden.astype(np.uint8)
        return self._hidden


class _Search:
    """The objects of one image."""

    def __init__(
        self, config: DetectorConfig, camera: Camera, support_depth_m: float, image: NDArray, hidden: NDArray
    ) -> None:
        self._config = config
        self._camera = camera
        self._support_depth_m = support_depth_m
        k = camera.intrinsics
        self._hidden = hidden
        coarse_size = (hidden.shape[1], hidden.shape[0])
        coarse = cv2.resize(image, coarse_size, interpolation=cv2.INTER_AREA).astype(np.float32)
        self._coarse = coarse.reshape(*hidden.shape, -1)
        # An edge near a finger may be the finger's: keep off by more than the search reaches in the end.
        wide = cv2.dilate(hidden, np.ones((5, 5), np.uint8))
        full_hidden = cv2.resize(wide, (k.width_px, k.height_px), interpolation=cv2.INTER_NEAREST)
        smooth = cv2.GaussianBlur(image, (3, 3), 0.8).astype(np.float32)
        self._fit = SilhouetteFit(
            camera, support_depth_m, smooth, full_hidden.astype(np.uint8, copy=False), config.edge_levels
        )
        self._min_area = config.segmentation.min_area_px / _COARSE**2
        # Contour pixels beside a finger or at the image's border are not the object's outline.
        self._unsure = cv2.dilate(hidden, np.ones((5, 5), np.uint8))
        self._unsure[:2], self._unsure[-2:], self._unsure[:, :2], self._unsure[:, -2:] = 1, 1, 1, 1

    def run(self) -> list[_Hypothesis]:
        """The best hypotheses that do not overlap each other, the surest first."""
        mask = foreground(self._coarse, self._hidden == 0, self._config.segmentation)
        regions = connected_regions(mask, self._min_area)
        hypotheses = [item for group in self._groups(regions) for item in self._explain(group)]
        hypotheses = [h for h in hypotheses if self._acceptable(h)]
        hypotheses.sort(key=lambda h: -_confidence(h, self._config))
        chosen: list[_Hypothesis] = []
        for candidate in hypotheses:
            if not any(self._collide(candidate, other) for other in chosen) and self._stands_beside(candidate, chosen):
                chosen.append(candidate)
        return chosen

    def _stands_beside(self, candidate: _Hypothesis, chosen: list[_Hypothesis]) -> bool:
        """Whether the candidate's own edges suffice, without those it shares with surer objects.

        What is left of a stand behind the object that stands on it has an outline, but not one of its own.
        """
        fit = candidate.fit
        try:
            alone = self._fit.judge(fit.shape, fit.parameters, [other.outline for other in chosen])
        except FitError:
            return False
        return self._acceptable(replace(candidate, fit=alone))

    def _groups(self, regions: list[NDArray[np.bool_]]) -> Iterator[NDArray[np.bool_]]:
        """The regions, and the unions of regions that one finger may have cut apart."""
        yield from regions
        if len(regions) < 2:
            return
        count, fingers = cv2.connectedComponents(self._hidden)
        severed: list[set[int]] = []
        for finger in range(1, count):
            near = cv2.dilate((fingers == finger).astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
            touching = {i for i, region in enumerate(regions) if (region & near).any()}
            if len(touching) > 1:
                severed.append(touching)
        if len(severed) > 1:
            severed.append(set().union(*severed))
        for group in severed:
            if len(group) <= _MOST_PIECES:
                yield np.logical_or.reduce([regions[i] for i in group])

    def _explain(self, region: NDArray[np.bool_]) -> list[_Hypothesis]:
        """The best primitive for the region as a whole or, if none is good, also those for its parts."""
        whole = self._best(region)
        if whole is not None and whole.cost_px2 < _GOOD_COST_PX2 and whole.overlap > 0.93:
            return [whole]
        parts = split_by_hue(self._coarse, region, self._min_area)
        parts = parts or split_by_edges(self._coarse, region, self._min_area)
        found: Iterable[_Hypothesis | None] = (whole, *(self._best(part) for part in parts))
        return [item for item in found if item is not None]

    def _best(self, region: NDArray[np.bool_]) -> _Hypothesis | None:
        """The primitive that explains the region at the least cost."""
        contour = self._contour(region)
        if len(contour) < 12:
            return None
        starts = []
        for shape in SHAPES:
            start = self._start(shape, contour)
            if start is not None:
                starts.append((start[1], shape, start[0]))
        if not starts:
            return None
        closest = min(start[0] for start in starts)
        hypotheses = []
        for rms, shape, parameters in starts:
            if rms > max(_CONTOUR_TIE_PX, 2.5 * closest):
                continue
            try:
                fit = self._fit.fit_edges(shape, parameters)
                hypotheses.append(self._hypothesis(fit, region))
            except FitError:
                continue
        return min(hypotheses, key=lambda h: h.cost_px2 + 4.0 * (1.0 - h.overlap), default=None)

    def _contour(self, region: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Points, (n, 2) px of the full image, of the region's outline where nothing hides it."""
        outlines, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        points = np.concatenate([outline[:, 0] for outline in outlines])
        points = points[self._unsure[points[:, 1], points[:, 0]] == 0]
        stride = max(len(points) // _CONTOUR_POINTS, 1)
        return _COARSE * points[::stride] + 0.5 * (_COARSE - 1)

    def _start(self, shape: Shape, contour: NDArray) -> tuple[NDArray, float] | None:
        rays = self._camera.rays(contour)
        downward = rays[:, 2] > 0.1
        if downward.sum() < 8:
            return None
        rays = rays[downward]
        footprint = _footprint(self._camera.unproject(contour[downward], self._support_depth_m)[:, :2])
        best: tuple[NDArray, float] | None = None
        for guess in first_guesses(shape, footprint, rays, self._support_depth_m, self._camera.position_m):
            try:
                parameters, rms = self._fit.fit_contour(shape, guess, contour)
            except FitError:
                continue
            if best is None or rms < best[1]:
                best = (parameters, rms)
            if rms < _GOOD_CONTOUR_PX:
                break
        return best if best is not None and best[1] < _WORST_CONTOUR_PX else None

    def _hypothesis(self, fit: EdgeFit, region: NDArray[np.bool_]) -> _Hypothesis:
        outline = self._fit.outline(fit.shape, fit.parameters)
        model = np.zeros(region.shape, dtype=np.uint8)
        corners = np.round(((outline - 0.5 * (_COARSE - 1)) / _COARSE) * 16.0).astype(np.int32)
        cv2.fillConvexPoly(model, corners, 1, shift=4)
        seen = model.astype(bool) & (self._hidden == 0)
        overlap = float((seen & region).sum()) / max(float((seen | region).sum()), 1.0)
        holes = float((seen & ~region).sum()) > 0.25 * float(seen.sum())
        cost = fit.misfit_px2 + _SHADING_WEIGHT_PX2 * self._shading_misfit(fit, seen & region)
        return _Hypothesis(fit, cost, overlap, outline, holes)

    def _shading_misfit(self, fit: EdgeFit, region: NDArray[np.bool_]) -> float:
        """Share of the brightness' variation that Lambert's law with the model's normals leaves unexplained.

        Under one distant lamp and an ambient light the brightness is a + b . normal wherever the lamp shines.
        """
        rows, columns = np.nonzero(cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)))
        if len(rows) < 30:
            return 0.0
        pick = slice(None, None, max(len(rows) // _SHADING_SAMPLES, 1))
        rows, columns = rows[pick], columns[pick]
        body = to_body(fit.shape, fit.parameters, self._support_depth_m)
        rays = self._camera.rays(_COARSE * np.column_stack([columns, rows]) + 0.5 * (_COARSE - 1))
        direction = tuple(rays.astype(np.float32).T)
        eye = self._camera.position_m.astype(np.float32)
        t = hit_body(body, tuple(eye), direction)
        hit = np.isfinite(t)
        if hit.sum() < 30:
            return 1.0
        points = tuple(e + t[hit] * d[hit] for e, d in zip(eye, direction, strict=True))
        normals = np.column_stack([np.ones(int(hit.sum())), *surface_normals(body, points)])
        level = self._coarse[rows[hit], columns[hit]].mean(axis=1)
        law = np.linalg.lstsq(normals, level, rcond=1e-4)[0]
        rest = level - normals @ law
        # Variation at the level of noise and quantisation says nothing.
        return float(np.var(rest) / (np.var(level) + 6.0))

    def _acceptable(self, hypothesis: _Hypothesis) -> bool:
        fit = hypothesis.fit
        size = sizes(fit.shape, fit.parameters)
        return (
            not hypothesis.holes
            and hypothesis.overlap > _LEAST_OVERLAP
            and size.min() >= self._config.min_object_size_m
            and _confidence(hypothesis, self._config) >= self._config.min_confidence
        )

    def _collide(self, first: _Hypothesis, second: _Hypothesis) -> bool:
        """Whether more than a fifth of the smaller outline lies in the other: two readings of one object."""
        a, b = (h.outline.astype(np.float32) for h in (first, second))
        shared, _ = cv2.intersectConvexConvex(a, b)
        return shared > 0.2 * min(cv2.contourArea(a), cv2.contourArea(b))


def _footprint(points: NDArray[np.float64]) -> Footprint:
    """The smallest rectangle around points, (n, 2) [m], of the support plane."""
    (x, y), (first, second), degrees = cv2.minAreaRect((1000.0 * points).astype(np.float32))
    yaw = math.radians(degrees)  # of the side ``first``
    if first > second:
        first, second, yaw = second, first, yaw + 0.5 * math.pi
    return Footprint(x / 1000.0, y / 1000.0, yaw, first / 1000.0, second / 1000.0)
