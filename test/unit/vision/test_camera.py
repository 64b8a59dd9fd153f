"""The pinhole and its pose."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError, load_yaml, parse_config
from mbpam_ros.vision.camera import (
    Camera,
    CameraConfig,
    CameraData,
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


K = (600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("index", "value", "name"),
    [
        (8, 0.0, r"K\[8\]"),
        (1, 5.0, "skew"),
        (6, 0.1, r"K\[6\]"),
        (4, 200.0, "focal lengths"),
        (0, 1200.0, "proportion"),
        (2, 1300.0, "cx"),
        (5, -400.0, "cy"),
    ],
)
def test_an_entry_of_k_that_no_camera_has_is_refused_by_its_name(index, value, name):
    k = list(K)
    k[index] = value
    with pytest.raises(CameraError, match=name):
        Intrinsics.from_camera_info(640, 480, k)


def test_a_focal_length_of_another_image_size_is_refused():
    with pytest.raises(CameraError, match="another size"):
        Intrinsics.from_camera_info(640, 480, [2e5, 0, 320, 0, 2e5, 240, 0, 0, 1])


def data(**changes):
    p = (500.0, 0.0, 310.0, 0.0, 0.0, 500.0, 235.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    return CameraData(
        **{"width_px": 640, "height_px": 480, "model": "plumb_bob", "d": [0.1] * 5, "k": K, "p": p, **changes}
    )


def test_of_a_rectified_image_p_counts_and_d_does_not():
    raw, d = data().pinhole(rectified=False)
    assert raw.fx == 600.0 and list(d) == [0.1] * 5
    rectified, d = data(model="equidistant").pinhole(rectified=True)
    assert (rectified.fx, rectified.cx, rectified.cy) == (500.0, 310.0, 235.0) and d.size == 0
    with pytest.raises(CameraError, match="P must"):
        data(p=[0.0] * 12).pinhole(rectified=True)


def test_region_and_binning_are_applied_as_the_message_defines_them():
    """A point's pixel in the full image, less the corner, over the binning, is its pixel in what is sent."""
    sent, _ = data(roi=(100, 60, 400, 300), binning=(2, 2)).pinhole(rectified=False)
    assert (sent.width_px, sent.height_px) == (200, 150)
    x, y = 0.3, -0.2
    full = (600.0 * x + 320.0, 600.0 * y + 240.0)
    assert (sent.fx * x + sent.cx, sent.fy * y + sent.cy) == pytest.approx(((full[0] - 100) / 2, (full[1] - 60) / 2))
    whole, _ = data(binning=(0, 0)).pinhole(rectified=False)
    assert (whole.width_px, whole.fx) == (640, 600.0)
    with pytest.raises(CameraError, match="roi"):
        data(roi=(500, 0, 200, 100)).pinhole(rectified=False)
