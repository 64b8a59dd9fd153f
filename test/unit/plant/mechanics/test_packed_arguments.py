"""Arrays behind one address: both sides see the same, and other types are refused."""

from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba import njit

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.packed_arguments import NEWEST_NUMBA, OLDEST_NUMBA, access, new_block, packs
from mbpam_ros.plant.mechanics.rod import (
    Motion,
    Rod,
    build_rod,
    masses_and_loads,
    motion_at_rest,
    move_rods,
    room_for_loads,
)


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
read = access(SAMPLE, packed=True)


@njit
def set_all(inner, value):
    inner.matrix[:] = value
    return inner.on


@njit
def fill(block):
    parts = read(block)
    on = set_all(parts.inner, parts.scale * parts.count * parts.row.sum())
    return parts.inner.matrix.shape[0], on


def test_changes_are_seen_on_both_sides():
    parts = outer(4)
    block = new_block(parts, SAMPLE, packed=True)
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


class Muscle(NamedTuple):
    shape: np.ndarray
    rate: np.ndarray
    rod: Rod
    motion: Motion
    work: np.ndarray
    mass: np.ndarray
    load: np.ndarray


def muscle():
    shape = np.array([[0.5, -1.0, 0.2, 0.3], [1.5, 0.1, -0.4, 0.2], [0.0, 0.3, 0.2, 0.0], [-0.1, 0.1, 0.4, 0.7]])
    rod = build_rod(load_gripper().geometry, 2, 4, 2)
    motion = motion_at_rest(rod)
    return Muscle(shape, 3.0 * shape, rod, motion, room_for_loads(rod), np.zeros((4, 4, WIDTH)), np.zeros((4, WIDTH)))


def moved(packed):
    """What the same compiled code makes of a muscle when its tuple is packed, and when it is not."""
    read = access(muscle(), packed)

    @njit
    def move(block):
        muscle = read(block)
        move_rods(muscle.shape, muscle.rate, muscle.rod, muscle.motion)
        masses_and_loads(muscle.rod, muscle.motion, (0.0, 0.0, 9.81), muscle.work, muscle.mass, muscle.load)

    parts = muscle()
    move(new_block(parts, muscle(), packed))
    return parts


@pytest.mark.slow
def test_without_packing_the_same_bits_are_computed():
    packed, plain = moved(True), moved(False)
    assert packed.load.any()
    for one, other in (
        (packed.mass, plain.mass),
        (packed.load, plain.load),
        *zip(packed.motion, plain.motion, strict=True),
    ):
        np.testing.assert_array_equal(one, other)
