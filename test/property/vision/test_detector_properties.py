"""Objects of other sizes and poses than the paper's, wherever the camera sees what fixes their size."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.detector import ObjectDetector, load_detector_config
from mbpam_ros.vision.primitives import canonical, place, sizes
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView
from mbpam_ros.vision.solid_fit.outline import BOX, ROD, SPHERE

CONFIG = load_camera_config()
RENDERER = Renderer.from_config(CONFIG)
INTRINSICS = camera_intrinsics(CONFIG)
GRIPPER = load_gripper()
FINGERS = np.stack([GRIPPER.finger_base_m, GRIPPER.finger_base_m + [0.0, 0.0, GRIPPER.geometry.length_m]], axis=1)
DETECTOR = ObjectDetector(replace(load_detector_config(), budget_s=10.0), camera_pose(CONFIG), GRIPPER)

offset = st.floats(-0.012, 0.012)
depth = st.floats(0.11, 0.14)
few = settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)


def measured(shape, parameters, support_depth):
    form = {"sphere": SPHERE, "cylinder": ROD, "box": BOX}[shape]
    body = place(form, np.array(parameters), support_depth)
    size = sizes(form, np.array(parameters))
    solid = ColouredSolid(shape, size, body.centre, body.orientation_xyzw, (0.85, 0.55, 0.30))
    view = SceneView(support_depth, (solid,), FINGERS)
    image = RENDERER.render(view, np.random.default_rng(0))
    (found,) = DETECTOR.detect(image, "rgb8", INTRINSICS, None, support_depth)
    assert found.shape == shape
    expected = sizes(form, canonical(form, np.array(parameters)))
    assert found.size_m == pytest.approx(expected, abs=0.005)
    assert found.position_m == pytest.approx(body.centre, abs=0.005)


@few
@given(offset, offset, st.floats(0.015, 0.04), depth)
def test_spheres_of_any_size_are_measured(x, y, radius, support_depth):
    measured("sphere", (x, y, radius), support_depth)


@few
@given(st.floats(-0.012, 0.0), offset, st.floats(-0.08, 0.08), st.floats(0.008, 0.025), st.floats(0.08, 0.22), depth)
def test_rods_of_any_size_are_measured(x, y, yaw, radius, length, support_depth):
    measured("cylinder", (x, y, yaw, radius, length), support_depth)


@few
@given(
    st.floats(-0.015, -0.005),
    offset,
    st.floats(-0.3, 0.3),
    st.floats(0.025, 0.04),
    st.floats(0.05, 0.12),
    st.floats(0.03, 0.06),
    depth,
)
def test_boxes_of_any_size_are_measured_where_a_side_is_seen(x, y, yaw, width, length, height, support_depth):
    measured("box", (x, y, yaw, width, length, height), support_depth)
