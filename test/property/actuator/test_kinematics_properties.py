import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mbpam_ros.actuator.kinematics import centreline, tip_pose
from mbpam_ros.gripper import load_gripper

GEOMETRY = load_gripper().geometry
ANGLES = st.floats(-8.0, 8.0)
BENDS = st.tuples(ANGLES, ANGLES).map(np.array)


def turned(vector, azimuth_rad):
    cosine, sine = np.cos(azimuth_rad), np.sin(azimuth_rad)
    result = np.array(vector, dtype=float)
    result[..., 0] = cosine * vector[..., 0] - sine * vector[..., 1]
    result[..., 1] = sine * vector[..., 0] + cosine * vector[..., 1]
    return result


@given(BENDS)
def test_the_centreline_ends_at_the_tip(bend):
    end = centreline(bend, GEOMETRY, [GEOMETRY.length_m])[0]
    np.testing.assert_allclose(tip_pose(bend, GEOMETRY)[0], end, atol=1e-15)


@given(BENDS, st.floats(-4.0, 4.0))
def test_turning_the_bend_turns_the_muscle(bend, azimuth_rad):
    along = np.linspace(0.0, GEOMETRY.length_m, 9)
    expected = turned(centreline(bend, GEOMETRY, along), azimuth_rad)
    np.testing.assert_allclose(centreline(turned(bend, azimuth_rad), GEOMETRY, along), expected, atol=1e-14)


@given(BENDS)
def test_the_muscle_keeps_its_length(bend):
    points = centreline(bend, GEOMETRY, np.linspace(0.0, GEOMETRY.length_m, 3001))
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    np.testing.assert_allclose(length, GEOMETRY.length_m, rtol=1e-5)


@given(BENDS)
def test_the_tip_points_along_the_end_of_the_centreline_and_does_not_twist(bend):
    (x, y, z, w) = tip_pose(bend, GEOMETRY)[1]
    np.testing.assert_allclose(np.linalg.norm([x, y, z, w]), 1.0, rtol=1e-14)
    assert z == 0.0
    last = centreline(bend, GEOMETRY, [GEOMETRY.length_m - GEOMETRY.end_length_m, GEOMETRY.length_m])
    tangent = (last[1] - last[0]) / GEOMETRY.end_length_m
    z_axis = [2.0 * w * y, -2.0 * w * x, 1.0 - 2.0 * (x * x + y * y)]
    np.testing.assert_allclose(z_axis, tangent, atol=1e-12)
