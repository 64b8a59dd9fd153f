"""Solids: distance, inertia, height and resting points."""

import numpy as np
import pytest

from mbpam_ros.geometry.solids import SHAPES, distance_m, half_height, principal_inertia
from mbpam_ros.geometry.surfaces import BOX, CYLINDER, REST_POINTS, SHAPE_CODES, SPHERE, rest_points, signed_distance

pytestmark = pytest.mark.xdist_group("solids")  # what rest points call is compiled once
SIZES = {"sphere": (0.06, 0.06, 0.06), "cylinder": (0.02, 0.02, 0.25), "box": (0.035, 0.12, 0.06)}
LYING = np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # body z along world y


LEVEL = np.eye(3)


def rests(shape, size, centre, rotation=LEVEL, foot=(np.inf, np.inf)):
    """Places, numbers and shares of the rest points."""
    points = np.empty((REST_POINTS, 5))
    count = rest_points.py_func(  # to compile it takes seconds
        shape, 0.5 * np.array(size), np.array(centre, dtype=float), np.array(rotation, dtype=float), *foot, points
    )
    assert (np.diff(points[:count, 3]) > 0.0).all()  # springs are found again by it
    return points[:count]


def lowest(*arguments, **keywords):
    return rests(*arguments, **keywords)[:, :3]


@pytest.mark.parametrize("shape", SIZES)
def test_inertia_is_that_of_a_cloud_of_points_filling_the_solid(shape):
    size = np.array(SIZES[shape])
    cloud = (np.random.default_rng(1).random((400_000, 3)) - 0.5) * size
    if shape == "sphere":
        cloud = cloud[np.linalg.norm(cloud, axis=1) < size[0] / 2]
    if shape == "cylinder":
        cloud = cloud[np.linalg.norm(cloud[:, :2], axis=1) < size[0] / 2]
    square = (cloud**2).mean(axis=0)
    np.testing.assert_allclose(principal_inertia(shape, size, 0.1), 0.1 * (square.sum() - square), rtol=0.01)


@pytest.mark.parametrize(("shape", "expected"), [("sphere", 0.03), ("cylinder", 0.01), ("box", 0.06)])
def test_half_height_of_a_solid_lying_along_y(shape, expected):
    assert half_height(shape, SIZES[shape], LYING) == pytest.approx(expected)


def test_known_distances():
    half = np.array([0.01, 0.02, 0.03])
    assert signed_distance(SPHERE, half, 0.0, 0.05, 0.0) == pytest.approx((0.04, 0.0, 1.0, 0.0))
    assert signed_distance(CYLINDER, half, 0.013, 0.0, 0.034)[0] == pytest.approx(0.005)  # off the rim: 3-4-5
    assert signed_distance(CYLINDER, half, 0.0, 0.004, 0.0) == pytest.approx((-0.006, 0.0, 1.0, 0.0))
    assert signed_distance(BOX, half, -0.013, 0.024, 0.0)[0] == pytest.approx(0.005)
    assert signed_distance(BOX, half, 0.0, 0.0, 0.028) == pytest.approx((-0.002, 0.0, 0.0, 1.0))


@pytest.mark.parametrize("shape", SHAPES)
def test_distances_are_those_of_the_nearest_of_many_points_of_the_surface(shape):
    size = {"sphere": (0.06,) * 3, "cylinder": (0.03, 0.03, 0.1), "box": (0.04, 0.06, 0.1)}[shape]
    half = 0.5 * np.array(size)
    rng = np.random.default_rng(1)
    inside = rng.uniform(-half, half, size=(400_000, 3))
    if shape != "box":
        around = inside[:, : 3 if shape == "sphere" else 2]
        inside = inside[np.linalg.norm(around, axis=1) <= half[0]]
    points = rng.uniform(-0.1, 0.1, size=(8, 3))
    points = points[np.abs(points).max(axis=1) > 0.055]
    sought = [np.linalg.norm(inside - point, axis=1).min() for point in points]
    np.testing.assert_allclose(distance_m(shape, size, points), sought, atol=0.002)


@pytest.mark.parametrize("shape", SHAPES)
def test_distances_of_many_points_are_those_of_each(shape):
    half = 0.5 * np.array(SIZES[shape])
    points = np.random.default_rng(2).uniform(-2.0 * half, 2.0 * half, size=(200, 3))
    each = [signed_distance(SHAPE_CODES[shape], half, *point)[0] for point in points]
    assert min(each) < 0.0 < max(each)
    np.testing.assert_allclose(distance_m(shape, SIZES[shape], points), each, atol=1e-15)


def test_a_sphere_rests_on_its_lowest_point_if_that_is_over_the_stand():
    np.testing.assert_allclose(lowest(SPHERE, SIZES["sphere"], [0.005, 0, 0.1], foot=(0.01, 0.01)), [[0.005, 0, 0.13]])
    assert len(lowest(SPHERE, SIZES["sphere"], [0.02, 0, 0.1], foot=(0.01, 0.01))) == 0


def test_a_lying_rod_rests_on_the_ends_of_the_part_over_the_stand():
    along_y = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    found = lowest(CYLINDER, SIZES["cylinder"], [0.0, 0.01, 0.1], along_y, foot=(0.008, 0.03))
    np.testing.assert_allclose(sorted(found.tolist()), [[0, -0.03, 0.11], [0, 0.03, 0.11]], atol=1e-12)


def test_a_standing_rod_rests_on_four_points_of_its_rim():
    found = lowest(CYLINDER, SIZES["cylinder"], [0.0, 0.0, 0.0])
    assert len(found) == 4
    np.testing.assert_allclose(np.linalg.norm(found[:, :2], axis=1), 0.01)
    np.testing.assert_allclose(found[:, 2], 0.125)


@pytest.mark.slow
@pytest.mark.parametrize("foot", [(np.inf, np.inf), (0.01, 0.03), (0.1, 0.03), (0.01, 0.1)])
def test_a_box_rests_on_the_corners_of_what_it_and_the_stand_share(foot):
    found = lowest(BOX, SIZES["box"], [0.0, 0.0, 0.05], foot=foot)
    x, y = min(0.0175, foot[0]), min(0.06, foot[1])
    expected = [[sx * x, sy * y, 0.08] for sx in (-1, 1) for sy in (-1, 1)]
    np.testing.assert_allclose(sorted(found.tolist()), sorted(expected), atol=1e-12)


def test_a_box_beside_the_stand_does_not_rest_on_it():
    assert len(lowest(BOX, SIZES["box"], [0.1, 0.0, 0.05], foot=(0.01, 0.03))) == 0


def tilted(angle, azimuth, yaw=0.0):
    """A turn about the vertical, then a tilt about a level axis."""
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross) @ turn


@pytest.mark.parametrize("foot", [(np.inf, np.inf), (0.008, 0.03)])
@pytest.mark.parametrize(("shape", "size"), [("cylinder", (0.035, 0.035, 0.1)), ("box", (0.035, 0.06, 0.1))])
def test_what_holds_a_solid_up_is_continuous_in_its_tilt(shape, size, foot):
    """Push and moments of a plane 1 mm above the lowest point, from upright to lying, by steps of 0.05 deg."""
    wrenches = []
    for angle in np.radians(np.arange(-0.5, 90.0, 0.05)):
        points = rests(SHAPE_CODES[shape], size, np.zeros(3), tilted(angle, 0.3, 0.2), foot)
        push = points[:, 4] * np.maximum(points[:, 2] - points[:, 2].max() + 1e-3, 0.0)
        wrenches.append([push.sum(), *(push @ points[:, :2] / 0.02)])
    wrenches = np.array(wrenches)
    assert wrenches[:, 0].min() > 3e-4
    # A point moves by 50 um a step, four of them press.
    assert np.abs(np.diff(wrenches, axis=0)).max() < 3e-4
