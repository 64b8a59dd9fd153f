"""Which pixels are neither table, shadow nor finger, and which of them may belong to one object.

What a table looks like is learnt from each image, from what lies along its border: the histogram of its colours after
the lamps' slow fall of brightness is taken out. So a table may have several colours, and a pattern. A pixel is
foreground if the table has no such colour; whether the table has it darker, as in a shadow, is told apart. A region
is also foreground if it is smooth where the table is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import require_positive
from mbpam_ros.vision.background import Masks
from mbpam_ros.vision.colour_kernel import HUE_BINS, LEVEL_BINS, LEVEL_SPAN, binned, blurred, counted, voted

_RING = 0.08
"""Width of the frame along the image's border that is taken for table, as a share of the image."""
_SAMPLE = 13
_SECTORS, _LEAST_SECTOR_SHARE = 32, 0.35
_OFFSET = 6.0
_SMOOTH = (9, 9)
_TEXTURE = (9, 9)
_HUE_BIN_COUNT = 32
_HUE_BIN_SHARE = 0.01
_CLUSTER_SHARE = 0.08


@dataclass(frozen=True)
class SegmentationConfig:
    """Thresholds of the foreground, as shares, so that they hold for any table.

    Args:
        rarity: a colour that fewer than this share of the table's pixels have is none of the table's.
        majority: share of the pixels about a place that must have such a colour.
        shadow_ratio: darker than this share of the table's brightness is no shadow.
        min_area_px: smaller patches are dropped [px of the full image].
    """

    rarity: float
    majority: float
    shadow_ratio: float
    min_area_px: float

    def __post_init__(self) -> None:
        require_positive(self, "rarity", "majority", "shadow_ratio", "min_area_px")
        if max(self.rarity, self.majority, self.shadow_ratio) >= 1.0:
            raise ValueError("rarity, majority and shadow_ratio must be less than 1")


@lru_cache(maxsize=4)
def _geometry(height: int, width: int) -> tuple[Any, ...]:
    """The ring of pixels along the border, each pixel's sector about the middle, and the terms of a slow fall-off."""
    v, u = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    ring = (np.abs(u) > 1.0 - 2.0 * _RING) | (np.abs(v) > 1.0 - 2.0 * _RING)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    sectors = ((np.arctan2(v, u) / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    return ring, sectors, terms


def foreground(image: NDArray[np.uint8], known: NDArray[np.bool_], config: SegmentationConfig) -> Masks:
    """What of an image, (h, w, c) uint8 levels, is not table.

    Args:
        image: levels.
        known: (h, w), pixels that no finger hides.
    """
    height, width, channels = image.shape
    ring, sectors, terms = _geometry(height, width)
    logs = np.asarray(cv2.LUT(image, _log_table()), np.float32).reshape(image.shape)
    level = np.asarray(
        logs[..., 0] if channels == 1 else cv2.transform(logs, np.full((1, 3), 1.0 / 3.0, np.float32)), np.float32
    )
    frame = ring & known
    if frame.sum() < 200:
        frame = known
    if frame.sum() < 200:
        nothing = np.zeros((height, width), bool)
        return Masks(nothing, nothing)
    level = level - _falloff(level, frame, known, terms)
    index = np.empty((height, width), np.int32)
    binned(logs, level, index)
    # An object that reaches into the frame has its colours in one place, the table has them all around.
    bins = LEVEL_BINS * HUE_BINS**2
    counts, spread = np.zeros(bins, np.int64), np.zeros(bins, np.int64)
    counted(index, frame, sectors, np.zeros((bins, _SECTORS), bool), counts, spread)
    least = max(_LEAST_SECTOR_SHARE * float(np.count_nonzero(np.bincount(sectors[frame]))), 3.0)
    of_table = (counts * (spread >= least)).astype(np.float32)
    histogram = _blurred(of_table.reshape(LEVEL_BINS, HUE_BINS, HUE_BINS)) / float(frame.sum())
    shadowed = _with_shadows(histogram, config.shadow_ratio)
    votes = np.empty((height, width, 3), np.float32)
    voted(index, known, (shadowed < config.rarity).ravel(), (histogram < config.rarity).ravel(), votes)
    stranger, strange, about = cv2.split(cv2.blur(votes, _SMOOTH))
    about = np.maximum(about, 0.05)
    masks = [(share / about > config.majority) & known for share in (stranger, strange)]
    smooth = _smooth_where_table_is_not(level, frame, known)
    sure = masks[0] | (smooth & masks[1])
    return Masks(_cleaned(sure), _cleaned(masks[1] | sure))


@lru_cache(maxsize=1)
def _log_table() -> NDArray[np.float32]:
    return np.log(np.arange(256) + _OFFSET).astype(np.float32)


def _falloff(
    level: NDArray[np.float32], frame: NDArray[np.bool_], known: NDArray[np.bool_], terms: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The slow part of the table's brightness: a quadric through the frame's pixels, then all that are near it."""
    coefficients = np.zeros(terms.shape[-1], np.float32)
    scale = 0.0
    samples = []
    for where in (frame, known):
        picked = np.flatnonzero(where)[:: _SAMPLE if where is frame else 5 * _SAMPLE]
        samples += [(level.ravel()[picked], terms.reshape(-1, terms.shape[-1])[picked])] * 2
    for values, basis in samples:
        rest = values - basis @ coefficients
        if scale > 0.0:
            weights = (1.0 / (1.0 + (rest / (2.0 * scale)) ** 2)).astype(np.float32)
        else:
            weights = np.ones_like(values)
        left = basis.T * weights
        normal = left @ basis + 1e-3 * len(values) * np.eye(terms.shape[-1], dtype=np.float32)
        coefficients = np.linalg.solve(normal, left @ values).astype(np.float32)
        scale = max(1.4826 * float(np.median(np.abs(values - basis @ coefficients))), 0.02)
    return (terms @ coefficients).astype(np.float32)


def _blurred(histogram: NDArray[np.float32]) -> NDArray[np.float32]:
    """Spread over the neighbouring bins, as noise and the blur between two colours do."""
    for _ in range(3):
        histogram, before = np.empty((histogram.shape[2], *histogram.shape[:2]), np.float32), histogram
        blurred(before, histogram)
    return histogram


def _with_shadows(histogram: NDArray[np.float32], ratio: float) -> NDArray[np.float32]:
    """Each bin holds the most of its own and of those brighter ones whose shadow it may be."""
    steps = int(np.ceil(-np.log(ratio) * LEVEL_BINS / (LEVEL_SPAN[1] - LEVEL_SPAN[0])))
    result = histogram.copy()
    for k in range(1, steps + 1):
        np.maximum(result[:-k], histogram[k:], out=result[:-k])
    return result


def _smooth_where_table_is_not(
    level: NDArray[np.float32], frame: NDArray[np.bool_], known: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Where the texture is far weaker than anywhere on the table; nowhere if the table itself is smooth."""
    mean, square = cv2.blur(level, _TEXTURE), cv2.blur(level * level, _TEXTURE)
    variance = np.maximum(square - mean * mean, 0.0)
    least = float(np.quantile(np.sqrt(variance[frame][::_SAMPLE]), 0.03))
    if least < 0.035:
        return np.zeros(level.shape, bool)
    texture = np.sqrt(variance)
    smooth = (texture < 0.6 * least) & known
    return cv2.dilate(smooth.astype(np.uint8), np.ones((7, 7), np.uint8)).astype(bool)


def _cleaned(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    kernel = np.ones((3, 3), np.uint8)
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel).astype(bool)


@dataclass(frozen=True, eq=False)
class Region:
    """Pixels that may be one object.

    Args:
        top, left: of the window in the image.
        mask: (h, w) bool, in the window, with a margin of :data:`MARGIN` pixels where the image has them.
    """

    top: int
    left: int
    mask: NDArray[np.bool_]

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the image."""
        height, width = self.mask.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)

    @property
    def area(self) -> int:
        """Pixels."""
        return int(np.count_nonzero(self.mask))

    @property
    def solidity(self) -> float:
        """Its share of its convex hull: near 1 for what is seen of a convex solid."""
        rows = np.flatnonzero(self.mask.any(axis=1))
        of_rows = self.mask[rows]
        first, last = of_rows.argmax(axis=1), of_rows.shape[1] - 1 - of_rows[:, ::-1].argmax(axis=1)
        ends = np.column_stack([np.concatenate([first, last]), np.concatenate([rows, rows])])
        return self.area / max(float(cv2.contourArea(cv2.convexHull(ends.astype(np.int32)))), 1.0)

    def shared(self, other: Region) -> int:
        """Pixels that both have."""
        (a, b), (c, d) = self.window, other.window
        rows = slice(max(a.start, c.start), min(a.stop, c.stop))
        columns = slice(max(b.start, d.start), min(b.stop, d.stop))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return 0
        return int(np.count_nonzero(self._part(rows, columns) & other._part(rows, columns)))

    def _part(self, rows: slice, columns: slice) -> NDArray[np.bool_]:
        return self.mask[
            rows.start - self.top : rows.stop - self.top, columns.start - self.left : columns.stop - self.left
        ]

    def of(self, mask: NDArray[np.bool_]) -> Region:
        """Another mask in the same window."""
        return Region(self.top, self.left, mask)


MARGIN = 12
_MOST_REGIONS = 24


def connected_regions(mask: NDArray[np.bool_], min_area: float) -> list[Region]:
    """The connected parts of ``mask``, (h, w), with at least ``min_area`` pixels, largest first."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=4)
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind="stable")[: int((areas >= min_area).sum())]
    regions = []
    for i in order[:_MOST_REGIONS] + 1:
        x, y, width, height = stats[i, :4]
        top, left = max(y - MARGIN, 0), max(x - MARGIN, 0)
        window = labels[top : y + height + MARGIN, left : x + width + MARGIN]
        regions.append(Region(int(top), int(left), window == i))
    return regions


def union(regions: list[Region]) -> Region:
    """The pixels of several regions of one image."""
    top, left = min(r.top for r in regions), min(r.left for r in regions)
    bottom = max(r.window[0].stop for r in regions)
    right = max(r.window[1].stop for r in regions)
    mask = np.zeros((bottom - top, right - left), bool)
    for region in regions:
        rows, columns = region.window
        mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] |= region.mask
    return Region(top, left, mask)


def split_by_hue(image: NDArray, region: Region, min_area: float) -> list[Region]:
    """Parts of ``region`` that differ in hue, whatever their shading: an object and its stand, or two objects.

    The parts are the islands of the region's hue histogram, the largest first. Grey images, and regions of one hue,
    have none.
    """
    if image.shape[2] < 3:
        return []
    pixels = image[region.window][region.mask].astype(np.float32)
    share = pixels[:, :2] / np.maximum(pixels.sum(axis=1, keepdims=True), 1.0)
    bins = np.minimum((share * _HUE_BIN_COUNT).astype(int), _HUE_BIN_COUNT - 1)
    histogram = np.bincount(bins[:, 0] * _HUE_BIN_COUNT + bins[:, 1], minlength=_HUE_BIN_COUNT**2)
    islands = (histogram.reshape(_HUE_BIN_COUNT, -1) > _HUE_BIN_SHARE * len(pixels)).astype(np.uint8)
    count, labels = cv2.connectedComponents(islands, connectivity=8)
    if count <= 2:
        return []
    parts = []
    for island in range(1, min(count, _MOST_PARTS + 1)):
        part = np.zeros_like(region.mask)
        part[region.mask] = labels[bins[:, 0], bins[:, 1]] == island
        parts += _within(region, _cleaned(part), max(min_area, _CLUSTER_SHARE * len(pixels)))
    return sorted(parts, key=lambda part: -part.area)[:_MOST_PARTS]


def split_by_edges(image: NDArray, region: Region, min_area: float) -> list[Region]:
    """Smooth patches of ``region``: parts between which brightness or colour jumps. None if it is one patch.

    What jumps is first what is far from the region's typical slope, then what is half as far: beside corrugated fingers
    an object is the one smooth patch.
    """
    gradient = np.zeros(region.mask.shape, dtype=np.float32)
    for channel in cv2.split(image[region.window].astype(np.float32)):
        gx, gy = cv2.Sobel(channel, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(channel, cv2.CV_32F, 0, 1, scale=0.125)
        np.maximum(gradient, cv2.magnitude(gx, gy), out=gradient)
    inner = cv2.erode(region.mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    typical = float(np.median(gradient[inner])) if inner.any() else 0.0
    parts = _grown(region, region.mask & (gradient < max(6.0, 4.0 * typical)), min_area)
    if parts or 2.0 * typical < 6.0 or region.solidity > _COMPACT:
        return parts
    return _grown(region, region.mask & (gradient < 2.0 * typical), min_area, _PATCH_SHARE)


def split_by_depth(points_m: NDArray, region: Region, min_area: float) -> list[Region]:
    """Parts of ``region`` between which the height above the table jumps. None if it is one."""
    height = points_m[region.window][..., 2]
    known = region.mask & np.isfinite(height)
    high = cv2.dilate(np.where(known, height, -9.0).astype(np.float32), np.ones((3, 3), np.uint8))
    low = cv2.erode(np.where(known, height, 9.0).astype(np.float32), np.ones((3, 3), np.uint8))
    return _grown(region, known & (high - low < _JUMP_M), min_area)


def without_shadows(relative: NDArray, region: Region, parts: list[Region], min_area: float) -> list[Region]:
    """What is left of ``region`` when those of its parts are taken away that only darken the table.

    Args:
        relative: (h, w, c), the image over the empty table, 128 where they are alike.
        region: that was split.
        parts: of it.
        min_area: smaller remainders are dropped.
    """
    shadows = []
    for part in parts:
        mean = np.median(relative[part.window][part.mask].astype(np.float32), axis=0)
        if mean.max() < _SHADED_BELOW and float(np.ptp(mean)) < _COLOURLESS * float(mean.max()):
            shadows.append(part)
    if not shadows or len(shadows) == len(parts):
        return []
    rest = region.mask.copy()
    for part in shadows:
        rows = slice(part.top - region.top, part.top - region.top + part.mask.shape[0])
        columns = slice(part.left - region.left, part.left - region.left + part.mask.shape[1])
        rest[rows, columns] &= ~part.mask
    return _within(region, _cleaned(rest), max(min_area, _CLUSTER_SHARE * region.area))[:_MOST_PARTS]


_SHADED_BELOW, _COLOURLESS = 124.0, 0.08
_JUMP_M = 0.012
_PATCH_SHARE, _COMPACT = 0.7, 0.75
_MOST_PARTS = 6


def _grown(region: Region, whole: NDArray[np.bool_], min_area: float, most_share: float = 0.0) -> list[Region]:
    """The connected parts of a mask of the region, a pixel wider each; none if there is one.

    One that has no more than ``most_share`` of the region's pixels is a part all the same.
    """
    parts = _within(region, whole, max(min_area, _CLUSTER_SHARE * region.area))
    if not parts or (len(parts) == 1 and parts[0].area > most_share * region.area):
        return []
    kernel = np.ones((3, 3), np.uint8)
    grown = []
    for part in parts[:_MOST_PARTS]:
        inside = Region(part.top - region.top, part.left - region.left, part.mask)
        wider = cv2.dilate(part.mask.astype(np.uint8), kernel).astype(bool)
        grown.append(Region(part.top, part.left, wider & region.mask[inside.window]))
    return grown


def _within(region: Region, mask: NDArray[np.bool_], min_area: float) -> list[Region]:
    """The connected parts of a mask of the region's window, as regions of the image."""
    return [
        Region(part.top + region.top, part.left + region.left, part.mask)
        for part in connected_regions(np.ascontiguousarray(mask), min_area)
    ]
