"""``mbpam detect`` on rendered photographs."""

import json

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import load_yaml
from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

CONFIG = load_camera_config()
DEPTH_M, RADIUS_M = 0.13, 0.030


def calibration(**changes):
    """As ROS's camera_calibration writes it."""
    intrinsics = camera_intrinsics(CONFIG)
    content = {
        "image_width": intrinsics.width_px,
        "image_height": intrinsics.height_px,
        "camera_name": "palm",
        "camera_matrix": {"rows": 3, "cols": 3, "data": intrinsics.matrix.ravel().tolist()},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0] * 5},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": np.eye(3).ravel().tolist()},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [0.0] * 12},
    }
    return {**content, **changes}


@pytest.fixture(scope="module")
def photograph():
    gripper, ball_m = load_gripper(), np.array([0.005, -0.01, DEPTH_M - RADIUS_M])
    ball = ColouredSolid(
        "sphere", np.full(3, 2.0 * RADIUS_M), ball_m, np.array([0.0, 0.0, 0.0, 1.0]), (0.82, 0.16, 0.10)
    )
    fingers = np.stack([gripper.finger_base_m, gripper.finger_base_m + [0.0, 0.0, gripper.geometry.length_m]], axis=1)
    rgb = Renderer.from_config(CONFIG).render(SceneView(DEPTH_M, (ball,), fingers), np.random.default_rng(0))
    return rgb, ball_m


@pytest.fixture
def files(tmp_path, photograph, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", photograph[0][..., ::-1])
    (tmp_path / "info.yaml").write_text(yaml.safe_dump(calibration()))
    return tmp_path


COMMAND = ["detect", "--image", "photo.png", "--camera-info", "info.yaml", "--support-depth", str(DEPTH_M)]


def test_an_image_file_becomes_detections_and_an_overlay(files, photograph, capsys):
    assert main([*COMMAND, "--json", "found.json", "--overlay", "found.png"]) == 0
    found = json.loads((files / "found.json").read_text())
    (ball,) = found["detections"]
    assert (found["frame"], ball["shape"], ball["label"], ball["yaw_rad"]) == ("gripper_base", "sphere", "sphere", 0.0)
    assert ball["size_m"] == pytest.approx([2.0 * RADIUS_M] * 3, abs=0.005)
    assert ball["position_m"] == pytest.approx(photograph[1], abs=0.005)
    assert 0.5 < ball["confidence"] <= 1.0 and np.linalg.norm(ball["orientation_xyzw"]) == pytest.approx(1.0)
    drawn, given = cv2.imread("found.png"), cv2.imread("photo.png")
    assert drawn.shape == given.shape
    changed = np.argwhere((drawn != given).any(axis=2))
    outline = np.array(ball["contour_px"])[:, ::-1]
    assert (changed.min(axis=0) < outline.max(axis=0)).all() and (changed.max(axis=0) > outline.min(axis=0)).all()
    assert "sphere" in capsys.readouterr().out


def test_a_file_is_looked_at_for_as_long_as_it_takes(files, capsys):
    (files / "hurried.yaml").write_text(yaml.safe_dump({**load_yaml("detector.yaml"), "budget_s": 1e-6}))
    assert main([*COMMAND, "--detector", "hurried.yaml"]) == 0
    assert "sphere" in capsys.readouterr().out


def test_the_pose_of_the_camera_can_be_given(files, capsys):
    pose = camera_pose(CONFIG)
    numbers = [*pose.position_m, *Rotation.from_matrix(pose.rotation).as_quat()]
    assert main([*COMMAND, "--json", "file.json"]) == 0
    assert main([*COMMAND, "--camera-pose=" + ",".join(map(str, numbers)), "--json", "given.json"]) == 0
    (by_file,), (given,) = (
        json.loads((files / name).read_text())["detections"] for name in ("file.json", "given.json")
    )
    assert given["position_m"] == pytest.approx(by_file["position_m"], abs=1e-6)


def test_an_empty_table_is_said(files, capsys):
    cv2.imwrite("photo.png", np.full((CONFIG.height_px, CONFIG.width_px, 3), 120, np.uint8))
    assert main([*COMMAND, "--no-fingers", "--json", "found.json"]) == 0
    assert json.loads((files / "found.json").read_text())["detections"] == []
    assert capsys.readouterr().out == "nothing found\n"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"distortion_model": "equidistant"}, "info.yaml: distortion_model 'equidistant' is none of plumb_bob"),
        ({"camera_matrix": {"data": [1.0] * 4}}, "info.yaml: K must have 9 values, found 4"),
        ({"camera_matrix": {"data": ["x"] * 9}}, "info.yaml: could not convert string to float"),
        ({"camera_matrix": None}, "info.yaml: missing key camera_matrix: data"),
        ({"image_width": "wide"}, "info.yaml: invalid literal for int()"),
        ({"image_width": 640}, "does not fit bgr8 and its CameraInfo"),
        ({"distortion_coefficients": {"data": [0.1, 0.2]}}, "D must hold 0, 4, 5 or 8 finite coefficients"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_said_in_one_line(changes, said, files, capsys):
    (files / "info.yaml").write_text(yaml.safe_dump(calibration(**changes)))
    assert main([*COMMAND, "--json", "found.json"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("mbpam detect: ") and said in told and told.count("\n") == 1
    assert not (files / "found.json").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--image", "nowhere.png"], "nowhere.png: cannot be read: No such file"),
        (["--image", "info.yaml"], "info.yaml: no image that OpenCV can read"),
        (["--camera-info", "nowhere.yaml"], "nowhere.yaml: no such file"),
        (["--support-depth", "-1"], "support_depth_m must lie below the camera"),
        (["--overlay", "found.unknown"], "found.unknown: cannot be written"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(arguments, said, files, capsys):
    assert main([*COMMAND, *arguments]) == 1
    told = capsys.readouterr().err
    assert told.startswith("mbpam detect: ") and said in told and told.count("\n") == 1


@pytest.mark.parametrize("pose", ["1,2,3", "0,0,0,0,0,0,0", "a,b,c,d,e,f,g"])
def test_a_pose_that_is_none_is_refused(pose, files, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([*COMMAND, f"--camera-pose={pose}"])
    assert "wants X,Y,Z,QX,QY,QZ,QW" in capsys.readouterr().err
