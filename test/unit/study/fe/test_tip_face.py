import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_mesh import EndPieces, muscle_mesh
from mbpam_ros.study.fe.tip_face import TipFace, TipPose

GEOMETRY = CellGeometry(wave_count=1.0, active_length_mm=7.0)
BOTH_ELEMENTS = pytest.mark.parametrize("quadratic", [False, True], ids=["trilinear", "quadratic"])
FORCE_N = np.array([0.2, -0.3, 0.5])
TORQUE_N_MM = 4.0


def tip(section="full", quadratic=False):
    mesh = muscle_mesh(GEOMETRY, Resolution(4, 1, 2, 2, 2, quadratic), section, EndPieces(4.0, 4.0))
    return mesh.points_mm, TipFace(mesh.points_mm, mesh.tip_face, mirrored=section != "full")


def crumpled(points, seed=1):
    """Turned, moved and strained at random."""
    rng = np.random.default_rng(seed)
    moved = Rotation.from_rotvec([0.4, -1.0, 0.7]).apply(points * (1.1, 0.9, 1.0)) + (3.0, 1.0, -2.0)
    return moved + 0.3 * rng.standard_normal(points.shape)


@BOTH_ELEMENTS
def test_a_rigid_motion_comes_back(quadratic):
    points, face = tip(quadratic=quadratic)
    turn = Rotation.from_rotvec([0.3, -2.0, 1.0])
    pose = face.pose(turn.apply(points) + (1.0, 2.0, 3.0))
    assert pose.rotation == pytest.approx(turn.as_matrix(), abs=1e-12)
    assert pose.position_mm == pytest.approx(turn.apply([0.0, 0.0, 15.0]) + (1.0, 2.0, 3.0), abs=1e-12)


def test_half_a_face_has_the_pose_of_the_whole():
    poses = []
    for section in ("full", "pdc"):
        points, face = tip(section)
        bent = Rotation.from_rotvec([0.0, -0.7, 0.0]).apply(points * (1.1, 0.9, 1.0))
        bent[:, 0] += 0.01 * points[:, 1] ** 2
        poses.append(face.pose(bent))
    assert poses[1].rotation == pytest.approx(poses[0].rotation, abs=1e-12)
    assert poses[1].position_mm == pytest.approx(poses[0].position_mm, abs=1e-12)


@BOTH_ELEMENTS
def test_force_and_moment_are_what_they_are_called_on_any_deformed_face(quadratic):
    points, face = tip(quadratic=quadratic)
    x = crumpled(points)
    pose, forces = face.pose(x), face.forces_n(x, FORCE_N, TORQUE_N_MM)
    assert forces.sum(axis=0) == pytest.approx(FORCE_N, abs=1e-12)
    moment = np.cross(x[face.nodes] - pose.position_mm, forces).sum(axis=0)
    assert moment == pytest.approx(TORQUE_N_MM * pose.direction, abs=1e-12)


@BOTH_ELEMENTS
def test_the_moments_tangent_is_the_slope_of_its_forces(quadratic):
    points, face = tip(quadratic=quadratic)
    x = crumpled(points)
    change = np.zeros_like(x)
    change[face.nodes] = np.random.default_rng(2).standard_normal((face.nodes.size, 3))
    left, right = face.torque_tangent(x, TORQUE_N_MM)
    ahead, behind = (face.forces_n(x + sign * 1e-5 * change, FORCE_N, TORQUE_N_MM).ravel() for sign in (1.0, -1.0))
    slope = (ahead - behind) / 2e-5
    assert left @ (right.T @ change[face.nodes].ravel()) == pytest.approx(slope, abs=1e-8 * np.abs(slope).max())


@pytest.mark.parametrize("bend_rad", [0.0, 0.5, 2.0, 3.0])
@pytest.mark.parametrize("roll_rad", [-2.0, 0.0, 0.3])
def test_the_roll_is_the_turn_left_when_the_direction_is_turned_back_the_shortest_way(bend_rad, roll_rad):
    azimuth = 0.8
    shortest = Rotation.from_rotvec([-bend_rad * math.sin(azimuth), bend_rad * math.cos(azimuth), 0.0])
    pose = TipPose(np.zeros(3), (shortest * Rotation.from_rotvec([0.0, 0.0, roll_rad])).as_matrix())
    assert pose.roll_rad == pytest.approx(roll_rad, abs=1e-12)
