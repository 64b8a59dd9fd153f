"""Arrays behind one address: both sides see the same, and other types are refused."""

from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba import njit

from mbpam_ros.plant.mechanics.packed_arguments import NEWEST_NUMBA, OLDEST_NUMBA, access, new_block, packs


class Inner(NamedTuple):
    matrix: np.ndarray
    on: bool


class Outer(NamedTuple):
    inner: Inner
    count: int
    row: np.ndarray
    scale: float


def outer(rows):
    return Outer(Inner(np.ones((rows, 2)), True), 3, np.arange(3), 0.5)


SAMPLE = outer(1)


@njit
def set_all(inner, value):
    inner.matrix[:] = value
    return inner.on


@pytest.mark.parametrize("packed", [True, False])
def test_changes_are_seen_on_both_sides(packed):
    read = access(SAMPLE, packed)

    @njit
    def fill(block):
        parts = read(block)
        on = set_all(parts.inner, parts.scale * parts.count * parts.row.sum())
        return parts.inner.matrix.shape[0], on

    parts = outer(4)
    block = new_block(parts, SAMPLE, packed)
    parts.row[2] = 7
    assert fill(block) == (4, True)
    np.testing.assert_array_equal(parts.inner.matrix, np.full((4, 2), 0.5 * 3 * 8))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"row": np.arange(6)[::2]}, "not contiguous"),
        ({"row": np.arange(3.0)}, "not of the types"),
        ({"row": np.zeros((3, 1), np.int64)}, "not of the types"),
        ({"count": 3.0}, "not of the types"),
    ],
)
def test_parts_of_other_types_are_refused(change, message):
    with pytest.raises(TypeError, match=message):
        new_block(outer(2)._replace(**change), SAMPLE, packed=True)


@pytest.mark.parametrize(
    ("version", "packed"),
    [((0, 58), False), (OLDEST_NUMBA, True), (NEWEST_NUMBA, True), ((0, NEWEST_NUMBA[1] + 1), False), ((1, 0), False)],
)
def test_tuples_are_packed_by_the_versions_that_were_tried(version, packed):
    assert packs(version) == packed


def test_the_installed_version_was_tried():
    assert OLDEST_NUMBA <= numba.version_info.short <= NEWEST_NUMBA
