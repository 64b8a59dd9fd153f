"""From what a calibrated camera sees to the shapes, sizes and places of the objects on the support plane.

The best source at hand says where objects are: a depth image (what stands above the plane it finds), else an image of
the empty table (what differs), else the image alone (what has no colour and no texture of the table). Every region is
fitted by balls, lying and upright cylinders, capsules and boxes of several heights through the pinhole model
(:mod:`mbpam_ros.vision.region_fit`); each fit gets a probability that it is right, and the likeliest is answered.

Taken for granted: objects stand on one plane (without a depth image: on z = ``support_depth_m`` of ``gripper_base``),
cylinders lie or stand upright, boxes stand on a face. The height of a box is seen only where the camera sees one of
its side faces, or has depth.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.configuration import load_config, require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.solids import Shape
from mbpam_ros.gripper import Gripper
from mbpam_ros.vision.background import Background, Masks
from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics
from mbpam_ros.vision.confidence import FEATURES, probabilities
from mbpam_ros.vision.depth import DepthError, DepthImage, Table, aligned, find_table
from mbpam_ros.vision.finger_mask import FingerMask
from mbpam_ros.vision.primitives import SHAPE_OF, at_height, place, sizes
from mbpam_ros.vision.region_fit import COARSE, LONGEST_M, Hypothesis, RegionFit, Surface, load_kernels, same_place
from mbpam_ros.vision.segmentation import (
    Region,
    SegmentationConfig,
    connected_regions,
    foreground,
    split_by_depth,
    split_by_edges,
    split_by_hue,
    union,
    without_shadows,
)

Encoding = Literal["rgb8", "bgr8", "mono8"]
ENCODINGS: tuple[Encoding, ...] = ("rgb8", "bgr8", "mono8")
Source = Literal["image", "background", "depth"]
SOURCES: tuple[Source, ...] = ("image", "background", "depth")
LABELS: dict[str, str] = {"sphere": "sphere", "cylinder": "rod", "box": "box"}

_MOST_PIECES = 4
_LEAST_HEIGHT_M = 0.006  # above the plane of a depth image
_HEIGHT_SIGMAS = 4.0
_GOOD_CONFIDENCE = 0.8  # a region explained so well is looked at no more
_LEAST_SOLIDITY = 0.5  # what fills less of its hull is no solid, but may hold some
_ALIKE = 0.85  # regions that share so much of their area are one


class ImageError(MbpamError, ValueError):
    """An image that cannot be used: encoding, type or size are not what they are said to be."""


@dataclass(frozen=True)
class DetectorConfig:
    """What ``config/detector.yaml`` says.

    Args:
        segmentation: thresholds of the foreground.
        edge_levels: least step of brightness that counts as an edge [8 bit levels per px].
        finger_margin_m: fingers are masked this much thicker than they are.
        finger_bend_margin: and up to this share of their bend farther than they are told to be bent.
        min_confidence: less certain detections are dropped.
        min_object_size_m: what is smaller in any extent is dropped.
        budget_s: processor time after which no further region is looked at [s].
        confidence: for each source the weights of :mod:`~mbpam_ros.vision.confidence`.
    """

    segmentation: SegmentationConfig
    edge_levels: float
    finger_margin_m: float
    finger_bend_margin: float
    min_confidence: float
    min_object_size_m: float
    budget_s: float
    confidence: dict[str, dict[str, float]]

    def __post_init__(self) -> None:
        require_positive(self, "edge_levels", "min_object_size_m", "budget_s")
        if min(self.finger_margin_m, self.finger_bend_margin) < 0.0 or not 0.0 <= self.min_confidence <= 1.0:
            raise ValueError("the margins of fingers must not be negative, min_confidence must lie in 0..1")
        if set(self.confidence) != set(SOURCES):
            raise ValueError(f"confidence must have weights for {', '.join(SOURCES)}")
        unknown = {name for weights in self.confidence.values() for name in weights} - set(FEATURES)
        if unknown:
            raise ValueError(f"confidence: {', '.join(sorted(unknown))} is none of {', '.join(FEATURES)}")


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
        orientation_xyzw: (4,); at identity the box's length lies along y. Yaw lies in (-90, 90] deg, as neither box
            nor cylinder has a front.
        confidence: probability that shape and size are right within 8 mm, 0 to 1; of an object seen in part, that
            its shape and width are, and that it is no shorter than is said.
        label: what to call it.
        contour_px: (m, 2), the model's outline in the image as it was given.
        source: what the object was told from: image, background (with an image of the empty table) or depth.
        bound: what is known of a length that is seen in part, in words; empty where all of it is seen.
        hidden_m: how much farther that length may reach: at the end at negative, at that at positive z of a cylinder
            or y of a box.
        size_range_m: (2, 3), the least and the greatest sizes that it may have by what is seen; None where all is.
    """

    shape: Shape
    size_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    orientation_xyzw: NDArray[np.float64]
    confidence: float
    label: str
    contour_px: NDArray[np.float64]
    source: Source = "image"
    bound: str = ""
    hidden_m: tuple[float, float] = (0.0, 0.0)
    size_range_m: NDArray[np.float64] | None = None

    @property
    def stands(self) -> bool:
        """Whether it is a cylinder whose axis is upright."""
        x, y, _, _ = self.orientation_xyzw
        return self.shape == "cylinder" and 1.0 - 2.0 * (x * x + y * y) > 0.7

    @property
    def yaw_rad(self) -> float:
        """Angle from gripper y to the object's length, about z; 0 for a sphere and for a cylinder that stands."""
        x, y, z, w = self.orientation_xyzw
        if self.shape == "sphere" or self.stands:
            return 0.0
        # Image of the body axis that carries the length: z of a cylinder, y of a box.
        if self.shape == "cylinder":
            along = (2.0 * (x * z + y * w), 2.0 * (y * z - x * w))
        else:
            along = (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z))
        return math.atan2(-along[0], along[1])


@dataclass(frozen=True, eq=False)
class Sighting:
    """What was seen in one frame.

    Args:
        detections: the objects, the surest first.
        source: what they were told from.
        support_depth_m: z of the plane they stand on, below the palm; measured where there is depth.
        tilt_deg: by how much the depth image finds the camera tilted against its pose; None without depth.
        passed_over: regions that were not looked at because the time was over; the smallest are left out.
        cpu_s: processor time it took.
        camera: the camera, turned as the depth image says.
        readings: all hypotheses that were weighed, answered or not, by region; their confidences are fitted to whether
            they are right.
        remark: why a better source was not used; empty if nothing is to be said.
    """

    detections: list[Detection]
    source: Source
    support_depth_m: float
    tilt_deg: float | None
    passed_over: int
    cpu_s: float
    camera: Camera
    readings: tuple[tuple[Hypothesis, ...], ...]
    remark: str = ""


class ObjectDetector:
    """Finds the objects in a stream of images; keeps what depends on the camera alone, and the empty table.

    Args:
        config: thresholds.
        pose: of the camera's optical frame in ``gripper_base``.
        gripper: whose open fingers may hide parts of the scene; ``None`` for a camera without fingers in view.
    """

    def __init__(self, config: DetectorConfig, pose: CameraPose, gripper: Gripper | None = None) -> None:
        self._config = config
        self._pose = pose
        self._finger_radius_m = gripper.geometry.outer_radius_m if gripper else 0.0
        self._open_fingers = open_fingers(gripper) if gripper else None
        self._views: dict[Intrinsics, _View] = {}
        self.background: Background | None = None
        load_kernels()

    def detect(
        self,
        image: NDArray[np.uint8],
        encoding: str,
        intrinsics: Intrinsics,
        distortion: ArrayLike | None,
        support_depth_m: float,
        finger_centrelines_m: NDArray[np.float64] | None = None,
        depth: DepthImage | None = None,
    ) -> list[Detection]:
        """Return the detections of :meth:`look`."""
        return self.look(
            image, encoding, intrinsics, distortion, support_depth_m, finger_centrelines_m, depth
        ).detections

    def look(
        self,
        image: NDArray[np.uint8],
        encoding: str,
        intrinsics: Intrinsics,
        distortion: ArrayLike | None,
        support_depth_m: float,
        finger_centrelines_m: NDArray[np.float64] | None = None,
        depth: DepthImage | None = None,
        patience: float = 1.0,
    ) -> Sighting:
        """Find the objects in ``image``.

        Args:
            image: (H, W, 3), or (H, W) for mono8, uint8.
            encoding: rgb8, bgr8 or mono8.
            intrinsics: of the image's CameraInfo.
            distortion: D of the CameraInfo, up to 8 coefficients of plumb_bob or rational_polynomial; None or zeros
                for none.
            support_depth_m: z of the plane the objects stand on, from the palm.
            finger_centrelines_m: (k, n, 3), where fingers are told to be if they are not open. Masked is what they
                pass on their way there; the same finger may be told of at two times.
            depth: what a depth camera sees at the same time, rectified.
            patience: how many times the configured budget it may take.

        Raises:
            ImageError: type, encoding, size, depth of the support or centrelines do not fit.
            BackgroundError: the empty table was learnt with other images.
        """
        began_s = time.thread_time()
        grey_or_rgb = _checked(image, encoding, intrinsics)
        if not math.isfinite(support_depth_m) or support_depth_m <= self._pose.position_m[2]:
            raise ImageError(f"support_depth_m must lie below the camera, found {support_depth_m}")
        lens = _lens(distortion)
        view = self._view(intrinsics)
        if lens is not None:
            grey_or_rgb = view.straightened(grey_or_rgb, lens)
        hidden = self._hidden(view, finger_centrelines_m)
        prepared_s = time.thread_time()  # what the first frame alone needs is not taken from its budget
        smooth = _levels(cv2.GaussianBlur(grey_or_rgb, (3, 3), 0.8)).reshape(*grey_or_rgb.shape[:2], -1)
        coarse = _coarse(grey_or_rgb, hidden.shape)
        table, remark = None, ""
        if depth is not None:
            try:
                table = find_table(aligned(depth, view.camera), view.camera, COARSE, hidden, support_depth_m)
            except DepthError as error:
                remark = f"depth not used: {error}"
        source: Source = "depth" if table is not None else "image" if self.background is None else "background"
        if table is not None:
            masks, camera, support_m = _above(table, hidden), table.camera, table.support_depth_m
        else:
            camera, support_m = view.camera, support_depth_m
            known = hidden == 0
            of_image = partial(foreground, coarse, known, self._config.segmentation)
            masks = of_image() if self.background is None else self.background.differences(coarse, known)
        level = coarse[..., 0] if coarse.shape[2] == 1 else _levels(cv2.cvtColor(coarse, cv2.COLOR_RGB2GRAY))
        surface = None if table is None else Surface(table.points_m, table.height_m, table.noise_m)
        fit = RegionFit(camera, support_m, smooth, level, hidden, masks.sure, self._config.edge_levels, surface)
        second = of_image if source == "background" else None
        ends_s = prepared_s + patience * self._config.budget_s
        search = _Search(self._config, source, fit, coarse, masks, ends_s, second)
        found = search.run()
        detections = [described(item, camera, support_m, source, lens) for item in found]
        return Sighting(
            detections,
            source,
            support_m,
            None if table is None else table.tilt_deg,
            search.passed_over,
            time.thread_time() - began_s,
            camera,
            tuple(search.weighed),
            remark,
        )

    def prepare(self, intrinsics: Intrinsics) -> None:
        """Work out what depends on the camera and the open fingers alone, so that the first frame takes no longer."""
        self._hidden(self._view(intrinsics), None)

    def learn_background(
        self,
        frames: Sequence[NDArray[np.uint8]],
        encoding: str,
        intrinsics: Intrinsics,
        distortion: ArrayLike | None,
        finger_centrelines_m: Sequence[NDArray[np.float64] | None] | None = None,
    ) -> Background:
        """Take frames, as for :meth:`look`, as the empty table, and return what was learnt.

        What fingers hide in one frame is learnt from the others, so they may move meanwhile.

        Args:
            frames: images.
            encoding: of all of them.
            intrinsics, distortion: likewise.
            finger_centrelines_m: of each frame, as for :meth:`look`.

        Raises:
            ImageError: type, encoding, size or centrelines do not fit.
            BackgroundError: there are no frames, or fingers hid a part of the view, which open ones leave free, in all
                of them. What was learnt before stands.
        """
        lens, view = _lens(distortion), self._view(intrinsics)
        told = [None] * len(frames) if finger_centrelines_m is None else finger_centrelines_m
        hidden = [self._hidden(view, fingers) for fingers in told]
        coarse = []
        for frame, mask in zip(frames, hidden, strict=True):
            pixels = _checked(frame, encoding, intrinsics)
            pixels = pixels if lens is None else view.straightened(pixels, lens)
            coarse.append(_coarse(pixels, mask.shape))
        background = Background.learn(coarse, hidden)
        background.require_known(self._hidden(view, None) == 0, len(coarse))
        self.background = background
        return background

    def _view(self, intrinsics: Intrinsics) -> _View:
        if intrinsics not in self._views:
            radius_m = self._finger_radius_m + self._config.finger_margin_m
            camera = Camera(intrinsics, self._pose)
            self._views = {
                intrinsics: _View(camera, FingerMask(camera, COARSE, radius_m, self._config.finger_bend_margin))
            }
        return self._views[intrinsics]

    def _hidden(self, view: _View, finger_centrelines_m: NDArray[np.float64] | None) -> NDArray[np.uint8]:
        fingers = self._open_fingers
        if finger_centrelines_m is not None:
            fingers = np.asarray(finger_centrelines_m, dtype=float)
            if fingers.ndim != 3 or fingers.shape[1] < 2 or fingers.shape[2] != 3 or not np.isfinite(fingers).all():
                raise ImageError(f"finger_centrelines_m must be finite and (k, n >= 2, 3), found {fingers.shape}")
        return view.hidden_by(fingers)


def described(
    found: Hypothesis, camera: Camera, support_depth_m: float, source: Source, lens: NDArray | None = None
) -> Detection:
    """Return a hypothesis as a detection.

    Args:
        found: the hypothesis.
        camera: that it was made with.
        support_depth_m: z of the plane it stands on.
        source: what it was told from.
        lens: distortion of the image in which the contour shall lie; None for none.
    """
    shape = SHAPE_OF[found.form]
    size_range = _size_range(found, camera, support_depth_m)
    bound = "; ".join(part for part in (_length_bound(found, camera), _height_bound(found, size_range)) if part)
    body = place(found.form, found.parameters, support_depth_m)
    return Detection(
        shape,
        sizes(found.form, found.parameters),
        body.centre,
        body.orientation_xyzw,
        found.confidence,
        LABELS[shape],
        found.outline_px if lens is None else _distorted(found.outline_px, camera.intrinsics, lens),
        source,
        bound,
        found.hidden_m,
        size_range,
    )


def _size_range(found: Hypothesis, camera: Camera, support_depth_m: float) -> NDArray[np.float64] | None:
    if found.height_range_m is None and not any(found.hidden_m):
        return None
    size = sizes(found.form, found.parameters)
    least, most = size.copy(), size.copy()
    if found.height_range_m is not None:
        for height_m in found.height_range_m:
            other = sizes(found.form, at_height(found.parameters, height_m, support_depth_m, camera.position_m))
            least, most = np.minimum(least, other), np.maximum(most, other)
    most[1 if SHAPE_OF[found.form] == "box" else 2] += sum(found.hidden_m)
    return np.stack([least, most])


def _height_bound(found: Hypothesis, size_range: NDArray[np.float64] | None) -> str:
    """What is known of a box of which the top alone is seen."""
    if found.height_range_m is None or size_range is None:
        return ""
    least, most = 1e3 * size_range
    return f"height not seen: {least[2]:.0f} to {most[2]:.0f} mm, so {least[0]:.0f} to {most[0]:.0f} mm wide"


def _length_bound(found: Hypothesis, camera: Camera) -> str:
    """What is known of a length of which an end is not seen."""
    if not any(found.hidden_m):
        return ""
    k = camera.intrinsics
    (left, top), (right, bottom) = found.outline_px.min(axis=0), found.outline_px.max(axis=0)
    border = 3.0 * COARSE
    sides = [
        name
        for name, past in (
            ("left", left < border),
            ("right", right > k.width_px - 1 - border),
            ("top", top < border),
            ("bottom", bottom > k.height_px - 1 - border),
        )
        if past
    ]
    where = f"runs out of the image on the {' and the '.join(sides)}" if sides else "a finger hides an end"
    least_m = float(found.parameters[4])
    most_m = least_m + sum(found.hidden_m)
    most = f" (at most {1e3 * most_m:.0f} mm)" if max(found.hidden_m) < LONGEST_M else ""
    return f"at least {1e3 * least_m:.0f} mm long{most}, {where}"


def _above(table: Table, hidden: NDArray[np.uint8]) -> Masks:
    """What stands above the plane of a depth image. Small holes are closed."""
    least = max(_LEAST_HEIGHT_M, _HEIGHT_SIGMAS * table.noise_m)
    with np.errstate(invalid="ignore"):
        above = (table.height_m > least) & (table.height_m < table.support_depth_m + 1.0)
    mask = cv2.morphologyEx(above.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)).astype(bool) & (hidden == 0)
    return Masks(mask, mask)


def _explains(found: Hypothesis, region: Region) -> bool:
    """Whether a good hypothesis already covers half of a region: then no other reading of it is sought."""
    if found.confidence < _GOOD_CONFIDENCE:
        return False
    model = np.zeros(region.mask.shape, np.uint8)
    corners = np.round((found.outline_px / COARSE - (region.left, region.top)) * 16.0)
    cv2.fillConvexPoly(model, np.clip(corners, -(2**20), 2**20).astype(np.int32), 1, shift=4)
    return bool(np.count_nonzero(model.astype(bool) & region.mask) > 0.5 * region.area)


def _coarse(image: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    small = _levels(cv2.resize(image, (shape[1], shape[0]), interpolation=cv2.INTER_AREA))
    return small.reshape(shape[0], shape[1], -1)


def _levels(image: NDArray) -> NDArray[np.uint8]:
    return image.astype(np.uint8, copy=False)


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


def open_fingers(gripper: Gripper) -> NDArray[np.float64]:
    """Return clamps and tips of the fingers that hang open, (4, 2, 3) [m] in ``gripper_base``."""
    base = gripper.finger_base_m
    return np.stack([base, base + (0.0, 0.0, gripper.geometry.length_m)], axis=1)


class _View:
    """What depends on the camera alone: how its images are straightened, and the mask of the fingers."""

    def __init__(self, camera: Camera, mask: FingerMask) -> None:
        self.camera, self._mask = camera, mask
        self._maps: tuple[NDArray, NDArray, NDArray] | None = None

    def straightened(self, image: NDArray[np.uint8], lens: NDArray[np.float64]) -> NDArray[np.uint8]:
        """The image as an ideal pinhole would have it."""
        if self._maps is None or not np.array_equal(self._maps[0], lens):
            k = self.camera.intrinsics
            size = (k.width_px, k.height_px)
            self._maps = lens, *cv2.initUndistortRectifyMap(k.matrix, lens, None, k.matrix, size, cv2.CV_16SC2)
        _, u, v = self._maps
        return cv2.remap(image, u, v, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def hidden_by(self, fingers_m: NDArray[np.float64] | None) -> NDArray[np.uint8]:
        """Coarse mask, (h, w) uint8, of what fingers (k, n, 3) may hide."""
        return self._mask.of(np.empty((0, 2, 3)) if fingers_m is None else fingers_m)


class _Look:
    """Masks of where objects may be, and what explains their regions.

    Args:
        fit: explains regions.
        masks: of where objects may be.
        min_area: smaller regions are none, in pixels of the masks.
    """

    def __init__(self, fit: RegionFit, masks: Masks, min_area: float) -> None:
        self.fit, self.masks, self._min_area = fit, masks, min_area

    def sure(self, aside: bool) -> list[Region]:
        """The regions that surely show an object, of those aside of the hand or of the others, the largest first."""
        return self._sure[aside]

    def with_shadow(self, aside: bool) -> list[Region]:
        """Likewise with what may be shadow, where that makes a difference."""
        return self._with_shadow[aside]

    @cached_property
    def _sure(self) -> tuple[list[Region], list[Region]]:
        return self._parted(self.masks.sure)

    @cached_property
    def _with_shadow(self) -> tuple[list[Region], list[Region]]:
        return ([], []) if self.masks.with_shadow is self.masks.sure else self._parted(self.masks.with_shadow)

    def _parted(self, mask: NDArray[np.bool_]) -> tuple[list[Region], list[Region]]:
        parted: tuple[list[Region], list[Region]] = ([], [])
        for region in connected_regions(mask, self._min_area):
            parted[self.fit.is_aside(region)].append(region)
        return parted


class _Search:
    """The objects of one image: what lies where the hand can reach it first, by all masks, then what lies aside.

    Args:
        config: thresholds.
        source: of the masks.
        fit: explains regions.
        coarse: (h, w, c) uint8, every second pixel.
        masks: where objects may be.
        began_s: thread time at which the frame was begun.
        second_masks: gives others, for what the first leave unexplained; None for none.
    """

    def __init__(
        self,
        config: DetectorConfig,
        source: Source,
        fit: RegionFit,
        coarse: NDArray[np.uint8],
        masks: Masks,
        ends_s: float,
        second_masks: Callable[[], Masks] | None = None,
    ) -> None:
        self._config, self._coarse = config, coarse
        self._min_area = config.segmentation.min_area_px / COARSE**2
        self._first, self._second_masks = _Look(fit, masks, self._min_area), second_masks
        self._weights = config.confidence[source]
        self._ends_s = ends_s
        self.passed_over = 0
        self.weighed: list[tuple[Hypothesis, ...]] = []

    def run(self) -> list[Hypothesis]:
        """The likeliest hypotheses that do not overlap each other, the surest first."""
        found: list[Hypothesis] = []
        first, second = self._first, None
        for aside in (False, True):
            self._look_at(first, self._regions(first, aside), found)
            if self._second_masks is not None and self._leaves_some(first, aside, found):
                if second is None:
                    masks = self._second_masks()
                    second = _Look(first.fit.with_foreground(masks.sure), masks, self._min_area)
                differing = first.masks.with_shadow
                others = [region for region in self._regions(second, aside) if _share_within(region, differing) > 0.5]
                self._look_at(second, others, found)
        found.sort(key=lambda item: -item.confidence)
        chosen: list[Hypothesis] = []
        for candidate in found:
            if not any(same_place(candidate, other) for other in chosen):
                chosen.append(candidate)
        return [item for item in chosen if item.confidence >= self._config.min_confidence]

    @property
    def _time_is_up(self) -> bool:
        return time.thread_time() > self._ends_s

    def _look_at(self, look: _Look, regions: Iterable[Region], found: list[Hypothesis]) -> None:
        """Add to ``found`` what explains regions that are not yet explained, while there is time."""
        for region in regions:
            if any(_explains(item, region) for item in found):
                continue
            if self._time_is_up:
                self.passed_over += 1
                continue
            found += self._explain(look, region)

    def _leaves_some(self, look: _Look, aside: bool, found: list[Hypothesis]) -> bool:
        """Whether a region there that surely shows an object has no good explanation, and there is time to seek it."""
        unexplained = sum(not any(_explains(item, region) for item in found) for region in look.sure(aside))
        if self._time_is_up:
            self.passed_over = max(self.passed_over, unexplained)
            return False
        return unexplained > 0

    def _regions(self, look: _Look, aside: bool) -> list[Region]:
        """What may be objects: what a finger may have cut apart, then the largest first, then regions with shadows."""
        sure = look.sure(aside)
        others = [
            region
            for region in look.with_shadow(aside)
            if all(region.shared(known) < _ALIKE * region.area for known in sure)
        ]
        return [*_severed(sure, look.fit.hidden), *sure, *others]

    def _explain(self, look: _Look, region: Region) -> list[Hypothesis]:
        """The likeliest primitive for the region as a whole or, if none is likely, also those for its parts."""
        whole = self._best(look, region) if region.solidity > _LEAST_SOLIDITY else None
        if whole is not None and whole.confidence > _GOOD_CONFIDENCE:
            return [whole]
        found = [] if whole is None else [whole]
        parts = self._parts(look, region)
        for index, part in enumerate(parts):
            if self._time_is_up:
                self.passed_over += len(parts) - index
                break
            best = self._best(look, part)
            if best is not None:
                found.append(best)
        return found

    def _parts(self, look: _Look, region: Region) -> list[Region]:
        if look.fit.surface is not None:
            parts = split_by_depth(look.fit.surface.points_m, region, self._min_area)
            if parts:
                return parts
        relative = look.masks.relative
        if relative is None:
            return split_by_hue(self._coarse, region, self._min_area) or split_by_edges(
                self._coarse, region, self._min_area
            )
        parts = split_by_hue(relative, region, self._min_area) or split_by_edges(relative, region, self._min_area)
        return [*without_shadows(relative, region, parts, self._min_area), *parts]

    def _best(self, look: _Look, region: Region) -> Hypothesis | None:
        """The likeliest primitive for a region."""
        readings = look.fit.explanations(region)
        rated = tuple(
            replace(item, confidence=p)
            for item, p in zip(readings, probabilities(readings, self._weights), strict=True)
        )
        self.weighed.append(rated)
        least_m = self._config.min_object_size_m
        usable = [item for item in rated if float(sizes(item.form, item.parameters).min()) >= least_m]
        return max(usable, key=lambda item: item.confidence, default=None)


def _severed(regions: list[Region], hidden: NDArray[np.uint8]) -> Iterator[Region]:
    """Unions of regions that fingers may have cut apart."""
    if len(regions) < 2 or not hidden.any():
        return
    count, fingers = cv2.connectedComponents(hidden)
    kernel = np.ones((5, 5), np.uint8)
    severed: list[set[int]] = []
    for finger in range(1, count):
        near = cv2.dilate((fingers == finger).astype(np.uint8), kernel).astype(bool)
        touching = {i for i, region in enumerate(regions) if (region.mask & near[region.window]).any()}
        if len(touching) > 1:
            severed.append(touching)
    if len(severed) > 1:
        severed.append(set().union(*severed))
    for group in severed:
        if len(group) <= _MOST_PIECES:
            yield union([regions[i] for i in group])


def _share_within(region: Region, mask: NDArray[np.bool_]) -> float:
    return float(np.count_nonzero(mask[region.window] & region.mask)) / region.area
