import math

import numpy as np
import pytest

from mbpam_ros.actuator.kinematics import centreline, tip_pose
from mbpam_ros.gripper import load_gripper

GEOMETRY = load_gripper().geometry
L, END = GEOMETRY.active_length_m, GEOMETRY.end_length_m


def rotate(orientation_xyzw, vector):
    x, y, z, w = orientation_xyzw
    axis = np.array([x, y, z])
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + w * np.asarray(vector))


def test_an_unbent_muscle_is_straight():
    points = centreline([0.0, 0.0], GEOMETRY, [0.0, 0.05, GEOMETRY.length_m])
    np.testing.assert_array_equal(points, [[0, 0, 0], [0, 0, 0.05], [0, 0, GEOMETRY.length_m]])
    position, orientation = tip_pose([0.0, 0.0], GEOMETRY)
    np.testing.assert_allclose(position, [0.0, 0.0, GEOMETRY.length_m])
    np.testing.assert_array_equal(orientation, [0.0, 0.0, 0.0, 1.0])


def test_a_quarter_circle_ends_where_geometry_says():
    radius = L / (math.pi / 2.0)
    position, orientation = tip_pose([math.pi / 2.0, 0.0], GEOMETRY)
    np.testing.assert_allclose(position, [radius + END, 0.0, END + radius], atol=1e-15)
    np.testing.assert_allclose(rotate(orientation, [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0], atol=1e-15)


def test_a_full_turn_brings_the_active_part_back_to_its_start():
    points = centreline([0.0, 2.0 * math.pi], GEOMETRY, [END, END + L, GEOMETRY.length_m])
    np.testing.assert_allclose(points, [[0, 0, END], [0, 0, END], [0, 0, 2 * END]], atol=1e-15)


def test_bending_toward_plus_x_moves_the_tip_toward_plus_x_and_y_alike():
    assert tip_pose([0.3, 0.0], GEOMETRY)[0][0] > 0.0
    assert tip_pose([0.0, 0.3], GEOMETRY)[0][1] > 0.0


def test_the_centreline_is_the_integral_of_its_tangent():
    bend = np.array([1.9, -1.1])
    angle = np.hypot(*bend)
    along = np.linspace(0.0, GEOMETRY.length_m, 20001)
    tangent_angle = angle * np.clip((along - END) / L, 0.0, 1.0)
    lateral = np.sin(tangent_angle)[:, None] * bend / angle
    tangent = np.column_stack([lateral, np.cos(tangent_angle)])
    step = along[1] - along[0]
    integral = step * np.cumsum(0.5 * (tangent[1:] + tangent[:-1]), axis=0)
    np.testing.assert_allclose(centreline(bend, GEOMETRY, along)[1:], integral, atol=1e-8)


def test_shapes_follow_the_leading_axes():
    bend = np.zeros((5, 4, 2))
    assert centreline(bend, GEOMETRY, np.zeros(7)).shape == (5, 4, 7, 3)
    position, orientation = tip_pose(bend, GEOMETRY)
    assert position.shape == (5, 4, 3) and orientation.shape == (5, 4, 4)


def test_an_unknown_bend_has_an_unknown_tip_and_leaves_the_others_alone():
    position, orientation = tip_pose([[math.nan, 0.0], [0.1, 0.2]], GEOMETRY)
    assert np.isnan(position[0]).all() and np.isnan(orientation[0]).all()
    assert np.isfinite(position[1]).all() and np.isfinite(orientation[1]).all()


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 1e-5, 1e-3])
def test_small_bends_follow_the_linear_limit(angle):
    position, _ = tip_pose([angle, 0.0], GEOMETRY)
    assert position[0] == pytest.approx(angle * (L / 2.0 + END), rel=1e-5)
