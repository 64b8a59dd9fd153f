"""Compiled passes over the pixels of an image and of the empty table: in NumPy each step writes the whole image."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

DARK = 4.0
"""Added before ratios [levels]: what is black has no hue."""

LIKE = 128.0
"""The relative image's level where both are alike."""

_GREY = (0.299, 0.587, 0.114)
_STEP_LEVELS = 9.0
_HUE_LEVELS = 7.0
_NOISE_SIGMAS = 4.0
_HUE_NOISE_SIGMAS = 3.0
_DEEPEST_SHADOW = 0.18
_BRIGHTER = 1.08
_TEXTURE = 0.05
_EDGE_SHARE = 0.6
_MOST_SPREAD = 12.0

# Compiled when imported, not under the first frame.
_RATIOS = "void(u1[:,:,::1], f4[:,:,::1], f4[:,::1], f4[:,::1], u1[:,:,::1])"
_DIFFERING = "void(u1[:,:,::1], f4[:,:,::1], f4[:,::1], f4[:,::1], f4[:,:,::1], f8, u1[:,::1], u1[:,::1])"


@njit(_RATIOS, cache=True, nogil=True)
def ratios(
    image: NDArray[np.uint8],
    table: NDArray[np.float32],
    grey_table: NDArray[np.float32],
    ratio: NDArray[np.float32],
    relative: NDArray[np.uint8],
) -> None:
    """Compare brightness and colours pixel by pixel.

    Args:
        image: (h, w, c) levels.
        table: (h, w, c) levels of the empty table at the same exposure.
        grey_table: (h, w), filled with its brightness and :data:`DARK`.
        ratio: (h, w), filled with the image's over that.
        relative: (h, w, c), filled with the ratio of each colour, :data:`LIKE` where they are alike.
    """
    height, width, channels = image.shape
    for v in range(height):
        for u in range(width):
            grey, of_table = DARK, DARK
            for c in range(channels):
                weight = _GREY[c] if channels == 3 else 1.0
                grey += weight * image[v, u, c]
                of_table += weight * table[v, u, c]
                relative[v, u, c] = min(LIKE * (image[v, u, c] + DARK) / (table[v, u, c] + DARK), 255.0)
            grey_table[v, u] = of_table
            ratio[v, u] = grey / of_table


@njit(_DIFFERING, cache=True, nogil=True)
def differing(
    image: NDArray[np.uint8],
    table: NDArray[np.float32],
    slope: NDArray[np.float32],
    spread: NDArray[np.float32],
    means: NDArray[np.float32],
    noise: float,
    sure: NDArray[np.uint8],
    darker: NDArray[np.uint8],
) -> None:
    """Mark pixels that surely show no table, and those that are darker than it, in the same hue or not.

    Args:
        image, table: as for :func:`ratios`.
        slope: (h, w), of the table's brightness, the steepest near by [levels per px].
        spread: (h, w), standard deviation of the table's frames [levels].
        means: (h, w, 4), the means about each pixel of the logarithms of ratio and grey_table, and of their squares.
        noise: standard deviation between image and table [levels].
        sure, darker: (h, w), filled with 0 or 1.
    """
    height, width, channels = image.shape
    step, hue = max(_STEP_LEVELS, _NOISE_SIGMAS * noise), max(_HUE_LEVELS, _HUE_NOISE_SIGMAS * noise)
    for v in range(height):
        for u in range(width):
            grey, of_table = DARK, DARK
            for c in range(channels):
                weight = _GREY[c] if channels == 3 else 1.0
                grey += weight * image[v, u, c]
                of_table += weight * table[v, u, c]
            ratio = grey / of_table
            # Beside an edge of the table's pattern a fraction of a pixel makes a difference.
            tolerance = _EDGE_SHARE * slope[v, u] + min(2.0 * spread[v, u], _MOST_SPREAD)
            is_darker = of_table - grey > step + tolerance
            differs = ratio < _DEEPEST_SHADOW or (grey - of_table > step + tolerance and ratio > _BRIGHTER)
            if channels == 3 and not differs:
                for c in range(channels):
                    off = image[v, u, c] + DARK - ratio * (table[v, u, c] + DARK)
                    differs = differs or abs(off) > hue + tolerance
            # In a shadow the table's texture is found again; an object covers it, or has one of its own.
            if is_darker and not differs:
                own = math.sqrt(max(means[v, u, 2] - means[v, u, 0] ** 2, 0.0))
                of_tables = math.sqrt(max(means[v, u, 3] - means[v, u, 1] ** 2, 0.0))
                differs = own > _TEXTURE + 2.0 * noise / of_table and own > 0.8 * of_tables and of_tables > _TEXTURE
            sure[v, u] = differs
            darker[v, u] = is_darker
