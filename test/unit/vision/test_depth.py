"""Depth images: units, alignment, the table's plane, and what the detector makes of them."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics, camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.depth import DepthError, DepthImage, aligned, depth_in_metres, find_table
from mbpam_ros.vision.detector import ObjectDetector, load_detector_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

CONFIG = load_camera_config()
INTRINSICS = camera_intrinsics(CONFIG)
RENDERER = Renderer.from_config(CONFIG)
POSE = camera_pose(CONFIG)
CAMERA = Camera(INTRINSICS, POSE)
SUPPORT_M = 0.13
NOT_HIDDEN = np.zeros((INTRINSICS.height_px // 2, INTRINSICS.width_px // 2), np.uint8)
BOX = ColouredSolid("box", (0.04, 0.09, 0.05), (0.0, 0.0, SUPPORT_M - 0.025), (0.0, 0.0, 0.0, 1.0))
ROD = ColouredSolid("cylinder", (0.03, 0.03, 0.12), (0.0, 0.0, SUPPORT_M - 0.015), (-0.7071, 0.0, 0.0, 0.7071))
BALL = ColouredSolid("sphere", (0.06, 0.06, 0.06), (0.01, 0.0, SUPPORT_M - 0.03), (0.0, 0.0, 0.0, 1.0))


def view(*solids):
    return SceneView(SUPPORT_M, solids)


def sensed(*solids, seed=0):
    return RENDERER.render_depth(view(*solids), np.random.default_rng(seed))


def test_millimetres_and_metres_are_the_same():
    millimetres = np.array([[0, 500, 1234]], np.uint16)
    metres = np.array([[math.nan, 0.5, 1.234]], np.float32)
    assert depth_in_metres(millimetres, "16UC1") == pytest.approx(depth_in_metres(metres, "32FC1"), nan_ok=True)


@pytest.mark.parametrize(
    ("values", "encoding"),
    [
        (np.zeros((2, 2), np.uint8), "16UC1"),
        (np.zeros((2, 2), np.float32), "mono16"),
        (np.zeros(4, np.float32), "32FC1"),
    ],
)
def test_what_is_no_depth_image_is_refused(values, encoding):
    with pytest.raises(DepthError):
        depth_in_metres(values, encoding)


def test_rendered_depth_is_that_of_the_plane_along_the_optical_axis():
    depth = RENDERER.render_depth(view())
    seen = np.isfinite(depth)
    v, u = np.nonzero(seen)
    rays = CAMERA.rays(np.column_stack([u, v])[::997])
    forward = rays @ CAMERA.rotation[:, 2]
    expected = (SUPPORT_M - CAMERA.position_m[2]) / rays[:, 2] * forward
    assert depth[v, u][::997] == pytest.approx(expected, rel=1e-4)


def test_the_sensor_has_noise_holes_and_whole_millimetres():
    clean, noisy = RENDERER.render_depth(view(BOX)), sensed(BOX)
    assert np.isnan(noisy).sum() > np.isnan(clean).sum() + 500
    known = np.isfinite(noisy)
    assert np.abs(1e3 * noisy[known] - np.round(1e3 * noisy[known])).max() < 1e-2
    near = known & (clean < 0.2)
    assert 0.0005 < (noisy - clean)[near].std() < 0.002


@pytest.mark.parametrize("tilt_deg", [0.0, 3.0, 8.0])
def test_the_plane_is_found_and_a_wrong_tilt_is_told_and_corrected_for(tilt_deg):
    turn = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    wrong = Camera(INTRINSICS, CameraPose(turn @ POSE.rotation, POSE.position_m))
    table = find_table(sensed(BOX, BALL), wrong, 2, NOT_HIDDEN, SUPPORT_M)
    assert table.tilt_deg == pytest.approx(tilt_deg, abs=0.4)
    assert table.support_depth_m == pytest.approx(SUPPORT_M, abs=0.001)
    assert table.camera.rotation == pytest.approx(POSE.rotation, abs=0.01)


def test_the_plane_is_the_same_every_time():
    depth = sensed(BOX)
    first, second = (find_table(depth, CAMERA, 2, NOT_HIDDEN, SUPPORT_M) for _ in range(2))
    assert first.support_depth_m == second.support_depth_m and first.tilt_deg == second.tilt_deg


def test_a_plane_far_below_is_the_floor_under_a_stand():
    stand = SceneView(SUPPORT_M, (BALL,), support_half_size_m=(0.014, 0.03), floor_depth_m=0.32)
    table = find_table(RENDERER.render_depth(stand, np.random.default_rng(0)), CAMERA, 2, NOT_HIDDEN, SUPPORT_M)
    assert table.support_depth_m == SUPPORT_M and table.tilt_deg < 0.5


def test_an_image_without_a_plane_is_refused():
    with pytest.raises(DepthError, match="an answer in 0"):
        find_table(np.full((480, 800), math.nan, np.float32), CAMERA, 2, NOT_HIDDEN, SUPPORT_M)
    steep = np.broadcast_to(np.linspace(0.1, 3.0, 480)[:, None], (480, 800)).astype(np.float32)
    with pytest.raises(DepthError, match="no plane"):
        find_table(steep, CAMERA, 2, NOT_HIDDEN, SUPPORT_M)


def test_a_depth_camera_of_another_size_and_place_is_aligned():
    small = Intrinsics(400, 240, 0.5 * INTRINSICS.fx, 0.5 * INTRINSICS.fy, 199.5, 119.5)
    beside = CameraPose(POSE.rotation, POSE.position_m + (0.0, 0.02, 0.0))
    depth = Renderer(Camera(small, beside)).render_depth(view(BOX))
    result = aligned(DepthImage(depth, small, beside), CAMERA)
    truth = RENDERER.render_depth(view(BOX))
    both = np.isfinite(result) & np.isfinite(truth)
    both[:, :60] = both[:, -60:] = False
    assert both.mean() > 0.5
    assert np.median(np.abs(result - truth)[both]) < 0.001


def test_a_depth_image_of_another_size_than_its_camera_is_refused():
    with pytest.raises(DepthError, match="does not fit"):
        aligned(DepthImage(np.zeros((10, 10), np.float32)), CAMERA)


@pytest.mark.parametrize("solid", [BOX, ROD, BALL], ids=["box", "rod", "ball"])
def test_objects_are_measured_with_a_wrong_tilt_and_a_wrong_depth_of_the_table(solid):
    turn = Rotation.from_euler("x", 5.0, degrees=True).as_matrix()
    detector = ObjectDetector(load_detector_config(), CameraPose(turn @ POSE.rotation, POSE.position_m))
    image = RENDERER.render(view(solid), np.random.default_rng(0))
    seen = detector.look(image, "rgb8", INTRINSICS, None, SUPPORT_M + 0.03, depth=DepthImage(sensed(solid)))
    assert seen.source == "depth" and seen.tilt_deg == pytest.approx(5.0, abs=0.5)
    (found,) = seen.detections
    assert found.source == "depth" and found.shape == solid.shape
    assert found.size_m == pytest.approx(solid.size_m, abs=0.005)


def test_a_useless_depth_image_is_said_and_the_image_alone_serves():
    detector = ObjectDetector(load_detector_config(), POSE, load_gripper())
    image = RENDERER.render(view(BALL), np.random.default_rng(0))
    nothing = DepthImage(np.full((INTRINSICS.height_px, INTRINSICS.width_px), math.nan, np.float32))
    seen = detector.look(image, "rgb8", INTRINSICS, None, SUPPORT_M, depth=nothing)
    assert seen.source == "image" and "depth not used" in seen.remark
