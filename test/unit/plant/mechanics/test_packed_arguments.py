"""Arrays behind one address: both sides see the same, and other types are refused."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from mbpam_ros.plant.mechanics.packed_arguments import access, new_block


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


write, read = access(outer(1))


@njit
def bind(block, parts):
    write(block, parts)


@njit
def fill(block):
    parts = read(block)
    parts.inner.matrix[:] = parts.scale * parts.count * parts.row.sum()
    return parts.inner.matrix.shape[0], parts.inner.on


def test_changes_are_seen_on_both_sides():
    parts = outer(4)
    block = new_block(parts)
    bind(block, parts)
    parts.row[2] = 7
    assert fill(block) == (4, True)
    np.testing.assert_array_equal(parts.inner.matrix, np.full((4, 2), 0.5 * 3 * 8))


def test_an_array_of_another_layout_is_refused():
    parts = outer(2)
    with pytest.raises(TypingError):
        bind(new_block(parts), parts._replace(row=np.arange(6)[::2]))
