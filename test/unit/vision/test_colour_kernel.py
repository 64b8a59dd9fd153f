"""The compiled passes behind the histogram of the table's colours, beside the same in NumPy."""

import numpy as np
import pytest

from mbpam_ros.vision.colour_kernel import HUE_BINS, HUE_SPAN, LEVEL_BINS, LEVEL_SPAN, binned, blurred, counted, voted

BINS = LEVEL_BINS * HUE_BINS**2
SHAPE = (24, 40)


def bin_of(values, span, count):
    """Bins of values, those beyond the span in the outermost."""
    share = (np.asarray(values, float) - span[0]) / (span[1] - span[0])
    return np.clip(np.floor(share * count), 0, count - 1).astype(int)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_pixel_gets_the_bin_of_its_brightness_and_hues(channels):
    rng = np.random.default_rng(5)
    logs = rng.uniform(1.0, 5.6, (*SHAPE, channels)).astype(np.float32)
    level = rng.uniform(-3.0, 2.0, SHAPE).astype(np.float32)
    index = np.empty(SHAPE, np.int32)
    binned(logs, level, index)
    hues = (logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]) if channels == 3 else (0.0 * level, 0.0 * level)
    bins = bin_of(level, LEVEL_SPAN, LEVEL_BINS), *(bin_of(hue, HUE_SPAN, HUE_BINS) for hue in hues)
    assert np.array_equal(index, np.ravel_multi_index(bins, (LEVEL_BINS, HUE_BINS, HUE_BINS)))


def test_pixels_of_the_frame_are_counted_by_bin_and_by_the_sectors_they_lie_in():
    rng = np.random.default_rng(6)
    index = rng.integers(0, 50, SHAPE).astype(np.int32)
    frame, sectors = rng.random(SHAPE) < 0.3, rng.integers(0, 8, SHAPE)
    places, counts, spread = np.zeros((BINS, 8), bool), np.zeros(BINS, np.int64), np.zeros(BINS, np.int64)
    counted(index, frame, sectors, places, counts, spread)
    assert np.array_equal(counts, np.bincount(index[frame], minlength=BINS))
    of_bins = [np.unique(sectors[frame & (index == each)]) for each in range(50)]
    assert spread[:50].tolist() == [len(each) for each in of_bins] and not spread[50:].any()


def test_a_count_is_spread_over_its_neighbours_and_what_lies_beyond_the_border_is_lost():
    histogram = np.zeros((4, 5, 6), np.float32)
    histogram[1, 2, 3], histogram[3, 4, 0] = 64.0, 64.0
    for _ in range(3):
        histogram, before = np.empty((histogram.shape[2], *histogram.shape[:2]), np.float32), histogram
        blurred(before, histogram)
    line = np.array([1.0, 2.0, 1.0])
    assert histogram.shape == (4, 5, 6)
    assert np.array_equal(histogram[0:3, 1:4, 2:5], np.einsum("i,j,k", line, line, line))
    assert histogram[2:, 3:, :2].sum() == 3.0**3


def test_only_pixels_that_are_known_vote_and_they_vote_as_their_bins_do():
    rng = np.random.default_rng(7)
    index, known = rng.integers(0, 50, SHAPE).astype(np.int32), rng.random(SHAPE) < 0.7
    stranger, strange = (rng.random(BINS) < share for share in (0.3, 0.6))
    votes = np.empty((*SHAPE, 3), np.float32)
    voted(index, known, stranger, strange, votes)
    assert np.array_equal(votes[..., 0], stranger[index] & known)
    assert np.array_equal(votes[..., 1], strange[index] & known)
    assert np.array_equal(votes[..., 2], known)
