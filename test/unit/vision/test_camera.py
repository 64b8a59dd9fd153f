"""The pinhole and its pose."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError, load_yaml, parse_config
from mbpam_ros.vision.camera import (
    Camera,
    CameraConfig,
    CameraError,
    CameraPose,
    Intrinsics,
    camera_intrinsics,
    camera_pose,
    load_camera_config,
)


@pytest.fixture(scope="module")
def camera():
    return Camera.from_config(load_camera_config())


def test_the_point_looked_at_is_in_the_middle_of_the_image(camera):
    config = load_camera_config()
    middle = ((config.width_px - 1) / 2, (config.height_px - 1) / 2)
    assert camera.project(config.look_at_m) == pytest.approx(middle, abs=1e-9)


def test_the_image_is_as_wide_as_the_field_of_view():
    config = load_camera_config()
    intrinsics = camera_intrinsics(config)
    assert 2.0 * math.atan(0.5 * config.width_px / intrinsics.fx) == pytest.approx(config.horizontal_fov_rad)


def test_the_image_x_axis_follows_gripper_y_and_down_is_toward_the_palms_minus_x(camera):
    middle = camera.project([0.0, 0.0, 0.09])
    assert camera.project([0.0, 0.01, 0.09])[0] > middle[0] + 5.0
    assert camera.project([-0.01, 0.0, 0.09])[1] > middle[1] + 5.0


def test_a_rod_of_250_mm_along_y_fits_into_the_image(camera):
    ends = camera.project([[0.0, -0.125, 0.10], [0.0, 0.125, 0.10]])
    assert (ends > 0).all() and (ends[:, 0] < camera.intrinsics.width_px).all()


def test_the_optical_frame_is_right_handed_with_z_along_the_view():
    config = load_camera_config()
    rotation = camera_pose(config).rotation
    view = np.subtract(config.look_at_m, config.position_m)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert rotation[:, 2] == pytest.approx(view / np.linalg.norm(view))


def test_a_point_behind_the_camera_is_refused(camera):
    with pytest.raises(CameraError, match="not in front"):
        camera.project([[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]])


def test_a_ray_that_misses_the_plane_is_refused(camera):
    with pytest.raises(CameraError, match="does not meet"):
        camera.unproject([320.0, 240.0], -0.05)


@pytest.mark.parametrize("index", [0, 4])
def test_k_without_positive_focal_lengths_is_refused(index):
    k = np.array([200.0, 0.0, 320.0, 0.0, 200.0, 240.0, 0.0, 0.0, 1.0])
    assert Intrinsics.from_camera_info(640, 480, k).matrix.ravel() == pytest.approx(k)
    k[index] = 0.0
    with pytest.raises(CameraError, match="focal"):
        Intrinsics.from_camera_info(640, 480, k)


@pytest.mark.parametrize(("size", "k"), [((0, 480), np.eye(3)), ((640, 480), np.ones(8)), ((640, 480), [np.nan] * 9)])
def test_other_senseless_intrinsics_are_refused(size, k):
    with pytest.raises(CameraError):
        Intrinsics.from_camera_info(*size, k)


def test_a_matrix_that_is_no_rotation_is_refused():
    with pytest.raises(CameraError, match="rotation"):
        CameraPose(np.diag([1.0, 1.0, -1.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("width_px", 0),
        ("horizontal_fov_rad", 3.2),
        ("noise_levels", -1.0),
        ("image_x_axis", [-0.027, 0.0, 0.09]),
        ("colour", 1),
    ],
)
def test_senseless_camera_files_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        parse_config(CameraConfig, {**load_yaml("camera.yaml"), key: value}, "camera.yaml")


def test_the_camera_file_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_camera_config().width_px = 1
