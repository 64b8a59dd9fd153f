"""Rotations: what others take them to be."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbpam_ros.geometry.rotations import about_z, product, rotation_matrix

TURNS = Rotation.random(20, random_state=1)


def test_matrices_are_those_of_scipy():
    for turn in TURNS:
        np.testing.assert_allclose(rotation_matrix(turn.as_quat()), turn.as_matrix(), atol=1e-15)


def test_a_product_turns_by_the_second_first():
    for first, second in zip(TURNS[:10], TURNS[10:], strict=True):
        both = product(tuple(first.as_quat()), tuple(second.as_quat()))
        np.testing.assert_allclose(rotation_matrix(both), (first * second).as_matrix(), atol=1e-15)


@pytest.mark.parametrize("angle_rad", [0.0, 0.3, -2.0, np.pi])
def test_a_turn_about_z(angle_rad):
    np.testing.assert_allclose(about_z(angle_rad), Rotation.from_euler("z", angle_rad).as_quat(), atol=1e-15)
