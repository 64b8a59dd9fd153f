"""Which pixels are neither table, shadow nor finger, and which of them may belong to one object.

The table's colour is learnt from each image: a smooth surface is fitted to what surrounds the scene, then to all
that looks alike. A pixel is foreground if its hue differs from the table's, if it is brighter, or if it is darker
than any shadow. No object's colour and no table's colour is assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import require_positive

_RING_FRACTION = 0.05  # width of the frame along the image's border that is first taken for table
_SAMPLE_STRIDE = 5
_GRID = 8
_INLIER_LEVELS = (40.0, 12.0, 12.0, 12.0)  # successive fits: first to the border alone, then to all that looks alike
_DEGREES = (2, 2, 4, 4)
_HUE_BINS = 32
_HUE_BIN_SHARE = 0.01
_CLUSTER_SHARE = 0.08


@dataclass(frozen=True)
class SegmentationConfig:
    """Thresholds, all in 8 bit levels or ratios, so that they hold for any table.

    Args:
        hue_levels: distance from the table's hue (at equal brightness) that makes a pixel foreground.
        brighter_levels: how much brighter than the table a pixel must be.
        shadow_ratio: darker than this share of the table's brightness is no shadow.
        noise_sigmas: the two thresholds in levels are at least this many standard deviations of the image's noise.
        min_area_px: smaller patches are dropped [px of the full image].
    """

    hue_levels: float
    brighter_levels: float
    shadow_ratio: float
    noise_sigmas: float
    min_area_px: float

    def __post_init__(self) -> None:
        require_positive(self, "hue_levels", "brighter_levels", "shadow_ratio", "noise_sigmas", "min_area_px")
        if self.shadow_ratio >= 1.0:
            raise ValueError(f"shadow_ratio must be less than 1, found {self.shadow_ratio:g}")


def table_surface(image: NDArray[np.float32], known: NDArray[np.bool_]) -> tuple[NDArray[np.float32], float]:
    """The table's colour in every pixel, and the noise about it.

    Args:
        image: (h, w, c) levels.
        known: (h, w), pixels that no finger covers.

    Returns:
        (h, w, c) levels of the table as if nothing stood on it, and the standard deviation of the noise [levels].
    """
    height, width, channels = image.shape
    sample, border, terms, orders, grid, maps = _surface_basis(height, width)
    pixels, usable = image[sample].reshape(-1, channels), known[sample].ravel()
    border = border & usable
    if border.sum() < 4 * terms.shape[1]:
        border = usable
    if border.sum() < 4 * terms.shape[1]:
        return np.zeros_like(image), 0.0
    coefficients = np.zeros((terms.shape[1], channels), dtype=np.float32)
    coefficients[0] = np.median(pixels[border], axis=0)
    noise = 0.0
    for candidates, limit, degree in zip((border, usable, usable, usable), _INLIER_LEVELS, _DEGREES, strict=True):
        residual = np.abs(pixels - terms @ coefficients).max(axis=1)
        inliers = candidates & (residual < limit)
        columns = orders <= degree
        if inliers.sum() < 4 * columns.sum():
            break
        basis, levels = terms[inliers][:, columns], pixels[inliers]
        coefficients[:] = 0.0
        ridge = 1e-6 * len(basis) * np.eye(basis.shape[1], dtype=np.float32)
        coefficients[columns] = np.linalg.solve(basis.T @ basis + ridge, basis.T @ levels)
        noise = 1.4826 * float(np.median(np.abs(levels - basis @ coefficients[columns])))
    small = (grid @ coefficients).reshape(-(-height // _GRID), -(-width // _GRID), channels)
    u, v = maps
    return cv2.remap(small, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(image.shape), noise


@lru_cache(maxsize=4)
def _surface_basis(height: int, width: int) -> tuple[Any, ...]:
    """What :func:`table_surface` needs of an image size.

    Sampled pixels, which of them lie on the border, the polynomial's terms there and their degrees, its terms on a
    coarse grid, and the maps from grid to pixels.
    """
    v, u = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    ring_rows, ring_columns = max(int(_RING_FRACTION * height), 1), max(int(_RING_FRACTION * width), 1)
    ring = np.ones((height, width), dtype=bool)
    ring[ring_rows:-ring_rows, ring_columns:-ring_columns] = False
    sample = np.s_[::_SAMPLE_STRIDE, ::_SAMPLE_STRIDE]
    powers = sorted(((i, j) for i in range(5) for j in range(5 - i)), key=sum)

    def terms(every: tuple[slice, slice]) -> NDArray[np.float32]:
        return np.stack([u[every].ravel() ** i * v[every].ravel() ** j for i, j in powers], axis=1)

    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    grid = terms(np.s_[::_GRID, ::_GRID])
    orders = np.array([i + j for i, j in powers])
    return sample, ring[sample].ravel(), terms(sample), orders, grid, (columns / _GRID, rows / _GRID)


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.einsum("ijk,ijk->ij", a, b)


def foreground(image: NDArray[np.float32], known: NDArray[np.bool_], config: SegmentationConfig) -> NDArray[np.bool_]:
    """Pixels, (h, w), that are neither table nor shadow nor unknown. ``image`` is (h, w, c) levels."""
    table, noise = table_surface(image, known)
    table = np.maximum(table, 1.0)
    channels = image.shape[2]
    table_sq = _dot(table, table)
    ratio = _dot(image, table) / table_sq
    brightness = np.sqrt(table_sq / channels)
    floor = config.noise_sigmas * noise
    result = (ratio - 1.0) * brightness > max(config.brighter_levels, floor)
    darker = (ratio < config.shadow_ratio) & ((1.0 - ratio) * brightness > max(config.brighter_levels, floor))
    result |= darker
    if channels > 1:
        off_hue = image - ratio[..., None] * table
        result |= _dot(off_hue, off_hue) > channels * max(config.hue_levels, floor) ** 2
    result &= known
    cleaned = cv2.morphologyEx(result.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return cleaned.astype(bool)


def connected_regions(mask: NDArray[np.bool_], min_area: float) -> list[NDArray[np.bool_]]:
    """The connected parts of ``mask`` with at least ``min_area`` pixels, largest first, holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    order = sorted(range(1, count), key=lambda i: -stats[i, cv2.CC_STAT_AREA])
    return [labels == i for i in order if stats[i, cv2.CC_STAT_AREA] >= min_area]


def split_by_hue(image: NDArray[np.float32], region: NDArray[np.bool_], min_area: float) -> list[NDArray[np.bool_]]:
    """Parts of ``region`` that differ in hue, whatever their shading: an object and its stand, or two objects.

    The parts are the islands of the region's hue histogram. Grey images, and regions of one hue, have none.
    """
    if image.shape[2] < 3:
        return []
    pixels = image[region]
    share = pixels[:, :2] / np.maximum(pixels.sum(axis=1, keepdims=True), 1.0)
    bins = np.minimum((share * _HUE_BINS).astype(int), _HUE_BINS - 1)
    histogram = np.zeros((_HUE_BINS, _HUE_BINS))
    np.add.at(histogram, (bins[:, 0], bins[:, 1]), 1.0)
    islands = (histogram > _HUE_BIN_SHARE * len(pixels)).astype(np.uint8)
    count, labels = cv2.connectedComponents(islands, connectivity=8)
    if count <= 2:
        return []
    parts = []
    for island in range(1, count):
        part = np.zeros_like(region)
        part[region] = labels[bins[:, 0], bins[:, 1]] == island
        part = cv2.morphologyEx(part.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(bool)
        parts += [p for p in connected_regions(part, max(min_area, _CLUSTER_SHARE * len(pixels)))]
    return parts


def split_by_edges(image: NDArray[np.float32], region: NDArray[np.bool_], min_area: float) -> list[NDArray[np.bool_]]:
    """Smooth patches of ``region``: parts between which brightness or colour jumps. None if it is one patch."""
    gradient = np.zeros(region.shape, dtype=np.float32)
    for channel in cv2.split(image):
        gx, gy = cv2.Sobel(channel, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(channel, cv2.CV_32F, 0, 1, scale=0.125)
        np.maximum(gradient, cv2.magnitude(gx, gy), out=gradient)
    inner = cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    typical = float(np.median(gradient[inner])) if inner.any() else 0.0
    smooth = region & (gradient < max(6.0, 4.0 * typical))
    patches = connected_regions(smooth, max(min_area, _CLUSTER_SHARE * float(region.sum())))
    if len(patches) < 2:
        return []
    grown = (cv2.dilate(patch.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & region for patch in patches)
    return list(grown)
