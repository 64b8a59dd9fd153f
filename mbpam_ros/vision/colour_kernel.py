"""Compiled passes over pixels for the histogram of the table's colours: in NumPy each step writes the whole image."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEVEL_BINS, HUE_BINS = 40, 28
LEVEL_SPAN, HUE_SPAN = (-2.2, 1.2), (-1.0, 1.0)

_LEVEL_LOW, _HUE_LOW = np.float32(LEVEL_SPAN[0]), np.float32(HUE_SPAN[0])
_LEVEL_SCALE = np.float32(LEVEL_BINS / (LEVEL_SPAN[1] - LEVEL_SPAN[0]))
_HUE_SCALE = np.float32(HUE_BINS / (HUE_SPAN[1] - HUE_SPAN[0]))
_LAST_LEVEL, _LAST_HUE = np.float32(LEVEL_BINS - 1), np.float32(HUE_BINS - 1)
_NONE = np.float32(0.0)

# Compiled when imported, not under the first frame.
_BINNED = "void(f4[:,:,::1], f4[:,::1], i4[:,::1])"
_COUNTED = "void(i4[:,::1], b1[:,::1], i8[:,::1], b1[:,::1], i8[::1], i8[::1])"
_BLURRED = "void(f4[:,:,::1], f4[:,:,::1])"
_VOTED = "void(i4[:,::1], b1[:,::1], b1[::1], b1[::1], f4[:,:,::1])"


@njit(_BINNED, cache=True, nogil=True)
def binned(logs: NDArray[np.float32], level: NDArray[np.float32], index: NDArray[np.int32]) -> None:
    """Find each pixel's bin of brightness and two hues.

    Args:
        logs: (h, w, c), logarithms of the colours; of one colour, the hues are none.
        level: (h, w), logarithm of the brightness, the lamps' fall-off taken out.
        index: (h, w), filled with the bin in a histogram of LEVEL_BINS x HUE_BINS x HUE_BINS.
    """
    height, width, channels = logs.shape
    for v in range(height):
        for u in range(width):
            red = blue = _NONE
            if channels == 3:
                red, blue = logs[v, u, 0] - logs[v, u, 1], logs[v, u, 2] - logs[v, u, 1]
            of_level = min(max((level[v, u] - _LEVEL_LOW) * _LEVEL_SCALE, _NONE), _LAST_LEVEL)
            of_red = min(max((red - _HUE_LOW) * _HUE_SCALE, _NONE), _LAST_HUE)
            of_blue = min(max((blue - _HUE_LOW) * _HUE_SCALE, _NONE), _LAST_HUE)
            index[v, u] = (np.int32(of_level) * HUE_BINS + np.int32(of_red)) * HUE_BINS + np.int32(of_blue)


@njit(_COUNTED, cache=True, nogil=True)
def counted(
    index: NDArray[np.int32],
    frame: NDArray[np.bool_],
    sectors: NDArray[np.int64],
    places: NDArray[np.bool_],
    counts: NDArray[np.int64],
    spread: NDArray[np.int64],
) -> None:
    """Count the pixels of the frame by their bins, and the sectors in which each bin is found.

    Args:
        index: (h, w), bins of :func:`binned`.
        frame: (h, w), the pixels to count.
        sectors: (h, w), which direction each pixel lies in.
        places: (bins, sectors), False, filled with whether a bin is found in a sector.
        counts: (bins,), zeros, filled with the pixels.
        spread: (bins,), zeros, filled with the sectors.
    """
    height, width = index.shape
    for v in range(height):
        for u in range(width):
            if frame[v, u]:
                bin_, sector = index[v, u], sectors[v, u]
                counts[bin_] += 1
                if not places[bin_, sector]:
                    places[bin_, sector] = True
                    spread[bin_] += 1


@njit(_BLURRED, cache=True, nogil=True)
def blurred(histogram: NDArray[np.float32], result: NDArray[np.float32]) -> None:
    """Spread a histogram over the neighbouring bins along its last axis by 1/4, 1/2, 1/4.

    Args:
        histogram: (l, m, n).
        result: (n, l, m), filled: its last axis is the first, so three times make the round.
    """
    first, second, third = histogram.shape
    quarter, half = np.float32(0.25), np.float32(0.5)
    for i in range(first):
        for j in range(second):
            before, here = _NONE, histogram[i, j, 0]
            for k in range(third):
                after = histogram[i, j, k + 1] if k + 1 < third else _NONE
                result[k, i, j] = quarter * before + half * here + quarter * after
                before, here = here, after


@njit(_VOTED, cache=True, nogil=True)
def voted(
    index: NDArray[np.int32],
    known: NDArray[np.bool_],
    stranger: NDArray[np.bool_],
    strange: NDArray[np.bool_],
    votes: NDArray[np.float32],
) -> None:
    """Spread what is known of bins over the pixels that have them.

    Args:
        index: (h, w), bins of :func:`binned`.
        known: (h, w), pixels that no finger hides; the others vote for nothing.
        stranger, strange: (bins,), whether a bin is none of the table's, shadows apart and included.
        votes: (h, w, 3), filled with 1 where a pixel is of such a bin, and where it is known, else 0.
    """
    height, width = index.shape
    for v in range(height):
        for u in range(width):
            bin_, counts = index[v, u], known[v, u]
            votes[v, u, 0] = counts and stranger[bin_]
            votes[v, u, 1] = counts and strange[bin_]
            votes[v, u, 2] = counts
