"""What the detector finds in rendered scenes, and what it refuses."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError, load_yaml, parse_config
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import CameraError, Intrinsics, camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.detector import Detection, DetectorConfig, ImageError, ObjectDetector, load_detector_config
from mbpam_ros.vision.overlay import describe_size, draw_overlay
from mbpam_ros.vision.primitives import at_height, place, sizes
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView
from mbpam_ros.vision.solid_fit.outline import BOX, ROD, SPHERE

TOLERANCE_M = 0.005
USED_FROM = load_grasp_config().selection.confidence_min
CONFIG = load_camera_config()
INTRINSICS = camera_intrinsics(CONFIG)
RENDERER = Renderer.from_config(CONFIG)
GRIPPER = load_gripper()
OPEN_FINGERS = np.stack([GRIPPER.finger_base_m, GRIPPER.finger_base_m + [0.0, 0.0, GRIPPER.geometry.length_m]], axis=1)

FORM_OF = {"sphere": SPHERE, "cylinder": ROD, "box": BOX}

# name: shape, sizes as parameters of the primitive [m], colour
OBJECTS = {
    "tomato": ("sphere", (0.035,), (0.82, 0.16, 0.10)),
    "bulb": ("sphere", (0.030,), (0.93, 0.92, 0.86)),
    "banana": ("cylinder", (0.0175, 0.18), (0.93, 0.80, 0.20)),
    "aluminium tube": ("cylinder", (0.010, 0.25), (0.66, 0.67, 0.70)),
    "carton": ("box", (0.035, 0.12, 0.06), (0.72, 0.53, 0.34)),
}
# x [m], y [m], yaw [rad], support depth [m]: a finger hides no end of the tube, the camera sees a side of the box.
POSES = [(0.0, 0.0, 0.0, 0.13), (-0.012, 0.014, 0.09, 0.12), (0.002, -0.013, -0.06, 0.14), (-0.014, -0.01, 0.05, 0.11)]


def standing(shape, extents, colour=(0.75, 0.3, 0.2), x=0.0, y=0.0, yaw=0.0, depth=0.13):
    parameters = np.array([x, y, *extents] if shape == "sphere" else [x, y, yaw, *extents])
    form = FORM_OF[shape]
    body = place(form, parameters, depth)
    return ColouredSolid(shape, sizes(form, parameters), body.centre, body.orientation_xyzw, colour)


def photograph(*solids, depth=0.13, seed=0, fingers=OPEN_FINGERS, **view):
    return RENDERER.render(SceneView(depth, solids, fingers, **view), np.random.default_rng(seed))


@pytest.fixture(scope="module")
def detector():
    """With all the time it wants: how long it takes here says nothing."""
    return ObjectDetector(replace(load_detector_config(), budget_s=10.0), camera_pose(CONFIG), GRIPPER)


def look(detector, image, encoding="rgb8", depth=0.13, **keys):
    return detector.detect(image, encoding, INTRINSICS, np.zeros(5), depth, **keys)


def assert_is(detection, solid, yaw=0.0):
    assert detection.shape == solid.shape
    assert detection.size_m == pytest.approx(solid.size_m, abs=TOLERANCE_M)
    assert detection.position_m == pytest.approx(solid.position_m, abs=TOLERANCE_M)
    if solid.shape != "sphere":
        off = (detection.yaw_rad - yaw + math.pi / 2) % math.pi - math.pi / 2
        assert abs(off) < math.radians(2.0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("name", OBJECTS)
def test_each_object_of_the_paper_is_measured_to_5_mm(detector, name, pose, seed):
    shape, extents, colour = OBJECTS[name]
    x, y, yaw, depth = pose
    solid = standing(shape, extents, colour, x, y, yaw, depth)
    found = look(detector, photograph(solid, depth=depth, seed=seed), depth=depth)
    assert len(found) == 1
    assert_is(found[0], solid, yaw)
    assert found[0].confidence > 0.5


@pytest.mark.parametrize("encoding", ["bgr8", "mono8"])
@pytest.mark.parametrize("name", OBJECTS)
def test_the_encoding_does_not_matter(detector, name, encoding):
    solid = standing(*OBJECTS[name])
    image = photograph(solid)
    image = image[..., ::-1].copy() if encoding == "bgr8" else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    (found,) = look(detector, image, encoding)
    assert_is(found, solid)


@pytest.mark.parametrize("stand_rgb", [(0.115, 0.135, 0.165), (0.30, 0.35, 0.45)])
@pytest.mark.parametrize("name", OBJECTS)
def test_a_slim_stand_below_the_object_is_not_taken_for_a_part_of_it(detector, name, stand_rgb):
    solid = standing(*OBJECTS[name])
    image = photograph(solid, support_half_size_m=(0.014, 0.03), support_rgb=stand_rgb)
    (found,) = look(detector, image)
    assert_is(found, solid)


@pytest.mark.parametrize("name", ["tomato", "bulb", "banana", "carton"])
def test_a_light_table_serves_as_well_as_a_dark_one(detector, name):
    solid = standing(*OBJECTS[name])
    (found,) = look(detector, photograph(solid, support_rgb=(0.62, 0.60, 0.56)))
    assert_is(found, solid)


@pytest.mark.parametrize("name", OBJECTS)
def test_noise_four_times_the_cameras_own_is_borne(detector, name):
    solid = standing(*OBJECTS[name])
    clean = RENDERER.render(SceneView(0.13, (solid,), OPEN_FINGERS)).astype(float)
    noise = np.random.default_rng(4).normal(0.0, 6.0, clean.shape)
    (found,) = look(detector, np.clip(clean + noise, 0, 255).astype(np.uint8))
    assert_is(found, solid)


def test_a_rod_across_is_found_with_its_yaw(detector):
    banana = standing(*OBJECTS["banana"], yaw=math.pi / 2)
    (found,) = look(detector, photograph(banana))
    assert_is(found, banana, math.pi / 2)


def test_the_orientation_turns_the_body_axis_onto_the_object(detector):
    yaw = 0.3
    carton = standing(*OBJECTS["carton"], x=-0.01, yaw=yaw)
    (found,) = look(detector, photograph(carton))
    assert abs(np.dot(found.orientation_xyzw, carton.orientation_xyzw)) == pytest.approx(1.0, abs=1e-4)
    assert found.yaw_rad == pytest.approx(yaw, abs=0.02)


@pytest.mark.parametrize("view", [{}, {"support_half_size_m": (0.02, 0.03)}, {"fingers": None}])
def test_an_empty_scene_gives_an_empty_list(detector, view):
    assert look(detector, photograph(**view)) == []


def test_several_objects_are_several_detections(detector):
    ball = standing("sphere", (0.02,), (0.9, 0.9, 0.85), x=-0.01, y=-0.05)
    brick = standing("box", (0.03, 0.05, 0.03), (0.72, 0.53, 0.34), x=-0.01, y=0.06, yaw=0.3)
    found = look(detector, photograph(ball, brick))
    assert {d.shape for d in found} == {"sphere", "box"} and len(found) == 2
    for detection in found:
        assert_is(detection, ball if detection.shape == "sphere" else brick, 0.3)


def test_the_depth_of_the_support_scales_what_is_measured(detector):
    image = photograph(standing(*OBJECTS["bulb"]))
    (near,), (far,) = look(detector, image, depth=0.12), look(detector, image, depth=0.144)
    assert far.size_m / near.size_m == pytest.approx(np.full(3, 1.2), rel=1e-3)


def test_a_rod_whose_end_a_finger_hides_is_not_reported_with_a_wrong_length(detector):
    tube = standing(*OBJECTS["aluminium tube"], x=0.011, yaw=math.radians(10.0))
    (found,) = look(detector, photograph(tube))
    assert found.shape == "cylinder" and found.size_m[0] == pytest.approx(0.020, abs=0.002)
    assert 0.15 < found.size_m[2] < 0.255
    assert found.bound.startswith(f"at least {1e3 * found.size_m[2]:.0f} mm long") and "finger" in found.bound


def test_of_a_box_seen_from_straight_above_height_and_width_are_bounds(detector):
    carton = standing(*OBJECTS["carton"], x=CONFIG.position_m[0])
    (found,) = look(detector, photograph(carton))
    assert found.shape == "box" and "height not seen" in found.bound
    least, most = found.size_range_m
    assert (least < carton.size_m).all() and (carton.size_m < most).all()
    assert (least < found.size_m).all() and (found.size_m < most).all()


@pytest.mark.parametrize("height_m", [0.02, 0.05, 0.09])
def test_boxes_of_all_heights_in_one_cone_of_rays_have_the_same_top(height_m):
    box, eye, support = np.array([0.01, 0.02, 0.3, 0.04, 0.12, 0.06]), np.array([0.027, 0.0, 0.01]), 0.13
    other = at_height(box, height_m, support, eye)

    def top_corner(p):
        c, s = np.cos(p[2]), np.sin(p[2])
        x, y = p[:2] + 0.5 * p[3] * np.array([c, s]) + 0.5 * p[4] * np.array([-s, c])
        return (np.array([x, y]) - eye[:2]) / (support - p[5] - eye[2])

    assert top_corner(other) == pytest.approx(top_corner(box))


def test_bent_fingers_are_looked_past_when_their_shape_is_given(detector):
    station = np.linspace(0.0, 1.0, 12)[None, :, None]
    inward = -GRIPPER.finger_base_m[:, None] * [1.0, 1.0, 0.0]
    bent = GRIPPER.finger_base_m[:, None] + 0.45 * station**2 * inward + [0.0, 0.0, 0.12] * station
    tube = standing(*OBJECTS["aluminium tube"])
    (found,) = look(detector, photograph(tube, fingers=bent), finger_centrelines_m=bent)
    assert_is(found, tube)


def test_a_tube_of_the_fingers_colour_is_parted_from_fingers_that_hold_it_and_are_not_told_of(detector):
    tube = standing(*OBJECTS["aluminium tube"], yaw=0.14, depth=0.08)
    angle, azimuth = np.radians(40.0) * np.linspace(0.0, 1.0, 14), np.radians([135.0, 315.0, 315.0, 135.0])
    aside, down = (GRIPPER.geometry.length_m / angle[-1] * part for part in (1.0 - np.cos(angle), np.sin(angle)))
    arcs = [np.outer(np.cos(azimuth), aside), np.outer(np.sin(azimuth), aside), np.tile(down, (4, 1))]
    image = photograph(tube, depth=0.18, fingers=GRIPPER.finger_base_m[:, None] + np.stack(arcs, axis=-1))
    (found,) = look(detector, image, depth=0.08)
    assert_is(found, tube, 0.14)
    assert found.confidence > USED_FROM


def test_a_distorting_lens_is_undone(detector):
    lens = np.array([-0.03, 0.004, 0.0, 0.0, 0.0])
    bulb = standing(*OBJECTS["bulb"], x=-0.02, y=0.05)
    ideal = photograph(bulb)
    v, u = np.mgrid[0 : INTRINSICS.height_px, 0 : INTRINSICS.width_px].astype(np.float32)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    source = cv2.undistortPoints(pixels, INTRINSICS.matrix, lens, P=INTRINSICS.matrix).reshape(*u.shape, 2)
    bent = cv2.remap(ideal, source[..., 0], source[..., 1], cv2.INTER_LINEAR)
    (found,) = detector.detect(bent, "rgb8", INTRINSICS, lens, 0.13)
    assert found.size_m == pytest.approx(bulb.size_m, abs=0.001)
    assert found.position_m == pytest.approx(bulb.position_m, abs=0.001)
    # The outline is that of the image as it was given.
    (straight,) = look(detector, ideal)
    assert np.abs(found.contour_px.mean(axis=0) - straight.contour_px.mean(axis=0)).max() > 0.5


def test_the_image_is_left_as_it_was(detector):
    image = photograph(standing(*OBJECTS["bulb"]))
    before = image.copy()
    draw_overlay(image, "rgb8", look(detector, image))
    assert np.array_equal(image, before)


@pytest.mark.parametrize(
    ("image", "encoding", "match"),
    [
        (np.zeros((CONFIG.height_px, CONFIG.width_px, 3), np.uint8), "rgba8", "encoding"),
        (np.zeros((CONFIG.height_px, CONFIG.width_px, 3), np.float32), "rgb8", "uint8"),
        (np.zeros((CONFIG.height_px, CONFIG.width_px), np.uint8), "rgb8", "does not fit"),
        (np.zeros((CONFIG.height_px, CONFIG.width_px, 3), np.uint8), "mono8", "does not fit"),
        (np.zeros((240, 320, 3), np.uint8), "rgb8", "does not fit"),
        (np.zeros((0, 0, 3), np.uint8), "rgb8", "does not fit"),
        ("an image", "rgb8", "uint8"),
    ],
)
def test_images_that_are_not_what_they_are_said_to_be_are_refused(detector, image, encoding, match):
    with pytest.raises(ImageError, match=match):
        look(detector, image, encoding)


@pytest.mark.parametrize("depth", [0.0, -0.1, math.nan, math.inf])
def test_a_support_that_is_not_below_the_camera_is_refused(detector, depth):
    with pytest.raises(ImageError, match="support_depth_m"):
        look(detector, photograph(), depth=depth)


@pytest.mark.parametrize("lens", [np.ones(3), [math.nan] * 5])
def test_senseless_distortion_is_refused(detector, lens):
    with pytest.raises(ImageError, match="D must"):
        detector.detect(photograph(), "rgb8", INTRINSICS, lens, 0.13)


def test_an_uncalibrated_camera_is_refused():
    with pytest.raises(CameraError, match="focal"):
        Intrinsics.from_camera_info(640, 480, np.zeros(9))


@pytest.mark.parametrize("fill", [0, 128, 255])
def test_a_blank_image_shows_nothing(detector, fill):
    assert look(detector, np.full((CONFIG.height_px, CONFIG.width_px, 3), fill, np.uint8)) == []


def test_pure_noise_shows_nothing(detector):
    image = np.random.default_rng(0).integers(0, 256, (CONFIG.height_px, CONFIG.width_px, 3), dtype=np.uint8)
    assert look(detector, image) == []


@pytest.mark.parametrize(("key", "value"), [("edge_levels", -1.0), ("min_confidence", 1.5), ("model", "yolo")])
def test_senseless_detector_files_are_refused(key, value):
    with pytest.raises(ConfigError, match=key):
        parse_config(DetectorConfig, {**load_yaml("detector.yaml"), key: value}, "detector.yaml")


def test_the_overlay_draws_the_outline_and_the_size(detector):
    image = photograph(standing(*OBJECTS["carton"]))
    (found,) = look(detector, image)
    overlay = draw_overlay(image, "rgb8", [found])
    assert overlay.shape == image.shape and overlay.dtype == np.uint8
    changed = np.abs(overlay.astype(int) - image[..., ::-1]).max(axis=2) > 30
    for u, v in found.contour_px.round().astype(int):
        assert changed[v - 2 : v + 3, u - 2 : u + 3].any()


@pytest.mark.parametrize(
    ("shape", "size", "text"),
    [
        ("sphere", (0.07, 0.07, 0.07), "d 70 mm"),
        ("cylinder", (0.0204, 0.0204, 0.25), "d 20 x 250 mm"),
        ("box", (0.035, 0.12, 0.06), "35 x 120 x 60 mm"),
    ],
)
def test_sizes_are_written_in_millimetres(shape, size, text):
    found = Detection(shape, np.array(size), np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), 1.0, shape, np.zeros((4, 2)))
    assert describe_size(found) == text


def test_the_overlay_accepts_grey_images_and_refuses_unknown_encodings():
    grey = np.full((48, 64), 7, np.uint8)
    assert (draw_overlay(grey, "mono8", []) == 7).all()
    with pytest.raises(ImageError, match="encoding"):
        draw_overlay(grey, "yuv", [])


def test_a_cylinder_that_stands_upright_is_one(detector):
    post = ColouredSolid("cylinder", (0.05, 0.05, 0.06), (-0.02, 0.0, 0.10), (0.0, 0.0, 0.0, 1.0), (0.2, 0.5, 0.8))
    (found,) = look(detector, photograph(post))
    assert found.shape == "cylinder" and found.stands and found.yaw_rad == 0.0
    assert found.size_m == pytest.approx(post.size_m, abs=TOLERANCE_M)
    assert found.position_m == pytest.approx(post.position_m, abs=TOLERANCE_M)


def test_a_rod_that_runs_out_of_the_image_is_at_least_as_long_as_is_seen(detector):
    rod = standing("cylinder", (0.012, 0.7), (0.2, 0.6, 0.3), x=-0.01)
    (found,) = look(detector, photograph(rod))
    assert found.size_m[0] == pytest.approx(0.024, abs=0.002)
    assert 0.2 < found.size_m[2] <= 0.7
    assert "runs out of the image on the left and the right" in found.bound


def discs(count):
    """Discs of one size in rows, all of other colours than the table."""
    image = np.full((CONFIG.height_px, CONFIG.width_px, 3), 60, np.uint8)
    for index in range(count):
        centre = (250 + 60 * (index % 6), 140 + 60 * (index // 6))
        cv2.circle(image, centre, 20, (250 - 5 * index, 120, 30 + 5 * index), -1)
    return image


def test_a_cluttered_view_stops_at_the_budget_and_says_what_it_passed_over():
    free = ObjectDetector(load_detector_config(), camera_pose(CONFIG))
    hurried = ObjectDetector(replace(load_detector_config(), budget_s=1e-6), camera_pose(CONFIG))
    assert hurried.look(discs(0), "rgb8", INTRINSICS, None, 0.13).passed_over == 0
    seen = hurried.look(discs(20), "rgb8", INTRINSICS, None, 0.13)
    assert seen.detections == [] and seen.passed_over >= 20
    assert free.look(discs(1), "rgb8", INTRINSICS, None, 0.13).passed_over == 0
