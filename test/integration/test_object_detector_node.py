"""The object detector's promises on its topics, on rendered images of the paper's five objects."""

import array
import functools
import math
import re
import threading
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.configuration import config_path
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes import vision_detections
from mbpam_ros.nodes.markers import finger_markers
from mbpam_ros.nodes.messages import time_stamp
from mbpam_ros.nodes.object_detector import ObjectDetectorNode
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.vision.camera import camera_intrinsics, load_camera_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

SCENES = ("tomato", "bulb", "banana", "tube", "carton")
MARKER_TYPES = {"sphere": Marker.SPHERE, "cylinder": Marker.CYLINDER, "box": Marker.CUBE}
WITHIN_M = 0.005
CLOSING_DEG = (12.0, 24.0, 36.0, 48.0, 60.0)
CAMERA = load_camera_config()
INTRINSICS = camera_intrinsics(CAMERA)


@functools.cache
def depth_of(scene_name):
    """The depth image of :func:`photograph`, 32FC1."""
    return Renderer.from_config(CAMERA).render_depth(view_of(scene_name), np.random.default_rng(0))


@functools.cache
def photograph(scene_name, offset_m=(0.0, 0.0)):
    """An rgb8 image of a scene with the fingers hanging, its object moved sideways by ``offset_m``."""
    return Renderer.from_config(CAMERA).render(view_of(scene_name, offset_m), np.random.default_rng(0))


def view_of(scene_name, offset_m=(0.0, 0.0)):
    scene, _ = load_scene(scene_name)
    support = scene.support
    base = load_gripper().finger_base_m
    solids = ()
    if scene.object is not None:
        spec, position = scene.object, np.array(scene.object_position_m) + (*offset_m, 0.0)
        solids = (ColouredSolid(spec.shape, spec.size_m, position, scene.object_orientation_xyzw, spec.colour_rgb),)
    stand = {}
    if support is not None:
        stand = {
            "support_half_size_m": support.half_size_m,
            "floor_depth_m": support.depth_m + support.stand_height_m,
        }
    return SceneView(
        support_depth_m=support.depth_m if support else 0.115,
        solids=solids,
        finger_centrelines_m=np.stack([base, base + (0.0, 0.0, load_gripper().geometry.length_m)], axis=1),
        **stand,
    )


def image(pixels, encoding="rgb8", padding=0):
    """``pixels`` as a message, each row followed by ``padding`` bytes that mean nothing."""
    rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=170)
    message = Image(height=rows.shape[0], width=pixels.shape[1], encoding=encoding, step=rows.shape[1])
    message.header.frame_id = "camera_optical"
    message.data = array.array("B", rows.tobytes())
    return message


def camera_info(**changes):
    message = CameraInfo(width=INTRINSICS.width_px, height=INTRINSICS.height_px, distortion_model="plumb_bob")
    message.d, message.k = [0.0] * 5, INTRINSICS.matrix.ravel()
    for name, value in changes.items():
        setattr(message, name, value)
    return message


class Camera:
    """The node and a camera in the test's hands; simulated time but for who asks, a quarter of a second an image."""

    def __init__(self, graph, informed=True, **parameters):
        self.graph = graph
        self.node = graph.add(ObjectDetectorNode, **{"use_sim_time": True, **parameters})
        self.detections = graph.listen(MarkerArray, "detections")
        self.overlays = graph.listen(CompressedImage, "detections/image")
        self.reports = graph.listen(DiagnosticArray, "/diagnostics")
        self.infos = graph.publisher(CameraInfo, "camera/camera_info")
        self.images = graph.publisher(Image, "camera/image_raw")
        self.time_s = 1.0
        if informed:
            self.inform(camera_info())

    def inform(self, message):
        """Publish the camera's data and have the node take them."""
        self.infos.publish(message)
        self.node.publish_health()
        seen = len(self.reports)
        self.graph.spin_until(lambda: len(self.reports) > seen, "a report after the camera_info")

    def send(self, message):
        self.time_s += 0.25
        self.graph.set_time(self.time_s)
        message.header.stamp = time_stamp(self.time_s)
        self.images.publish(message)

    def show(self, message):
        """Publish an image and return the markers of what was seen in it."""
        seen = len(self.detections)
        self.send(message)
        self.graph.spin_until(lambda: len(self.detections) > seen, "detections")
        clearing, *found = self.detections[-1].markers
        assert clearing.action == Marker.DELETEALL
        return found

    def refuse(self, publisher_or_send, message):
        """Send something the node must refuse."""
        refused, seen = self.node.refused_inputs, len(self.detections)
        publisher_or_send(message)
        self.graph.spin_until(lambda: self.node.refused_inputs > refused, "the refusal")
        assert len(self.detections) == seen


def test_a_lens_model_it_cannot_undo_is_refused_and_the_health_says_what_to_do(graph):
    camera = Camera(graph, informed=False)
    camera.refuse(camera.infos.publish, camera_info(distortion_model="equidistant", d=[0.1, 0.0, 0.0, 0.0]))
    health = camera.node.health()
    assert health.level == DiagnosticStatus.WARN
    assert "'equidistant'" in health.message and "publish rectified images" in health.message
    camera.inform(camera_info())
    camera.show(image(photograph("bulb")))
    assert camera.node.health().level == DiagnosticStatus.OK


def test_while_images_are_refused_the_health_says_why(graph):
    camera = Camera(graph)
    camera.show(image(photograph("bulb")))
    wrong = image(photograph("bulb"))
    wrong.encoding = "16UC1"
    camera.refuse(camera.send, wrong)
    assert camera.node.health().level == DiagnosticStatus.WARN and "'16UC1'" in camera.node.health().message
    camera.show(image(photograph("bulb")))
    assert camera.node.health().level == DiagnosticStatus.OK


def test_a_camera_that_publishes_best_effort_is_heard_when_a_parameter_says_so(graph):
    topics = ("camera_info", "image_raw")
    overrides = {f"qos_overrides./camera/{topic}.subscription.reliability": "best_effort" for topic in topics}
    node = graph.add(ObjectDetectorNode, **overrides)
    detections = graph.listen(MarkerArray, "detections")
    infos = graph.publisher(CameraInfo, "camera/camera_info", qos_profile_sensor_data)
    images = graph.publisher(Image, "camera/image_raw", qos_profile_sensor_data)
    infos.publish(camera_info())
    graph.spin_until(lambda: "no camera_info" not in node.health().message, "camera_info")
    images.publish(image(photograph("bulb")))
    graph.spin_until(lambda: detections, "detections")


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8"])
@pytest.mark.parametrize("scene_name", SCENES)
def test_each_object_of_the_paper_is_seen_with_its_shape_size_and_place(graph, scene_name, encoding):
    scene, _ = load_scene(scene_name)
    camera = Camera(graph, support_depth_m=scene.support.depth_m)
    pixels = photograph(scene_name)
    if encoding != "rgb8":
        pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR if encoding == "bgr8" else cv2.COLOR_RGB2GRAY)
    (found,) = camera.show(image(pixels, encoding))
    assert found.type == MARKER_TYPES[scene.object.shape]
    assert found.ns == scene.object.shape
    assert found.header.frame_id == "gripper_base"
    assert found.header.stamp == time_stamp(camera.time_s)
    assert found.text
    assert 0.5 < found.color.a <= 1.0
    size = (found.scale.x, found.scale.y, found.scale.z)
    np.testing.assert_allclose(size, scene.object.size_m, atol=WITHIN_M)
    place = (found.pose.position.x, found.pose.position.y, found.pose.position.z)
    np.testing.assert_allclose(place, scene.object_position_m, atol=WITHIN_M)


def test_a_rod_along_gripper_y_has_its_axis_there(graph):
    scene, _ = load_scene("banana")
    camera = Camera(graph, support_depth_m=scene.support.depth_m)
    (found,) = camera.show(image(photograph("banana")))
    q = found.pose.orientation
    body_z = (2.0 * (q.x * q.z + q.y * q.w), 2.0 * (q.y * q.z - q.x * q.w), 1.0 - 2.0 * (q.x**2 + q.y**2))
    assert abs(body_z[1]) > math.cos(math.radians(3.0))


def test_an_empty_table_clears_what_was_drawn(graph):
    camera = Camera(graph)
    assert camera.show(image(photograph("bulb")))
    assert camera.show(image(photograph("empty"))) == []


def test_the_overlay_is_a_jpeg_of_the_image_s_size_and_stamp(graph):
    camera = Camera(graph)
    pixels = photograph("bulb")
    camera.show(image(pixels))
    graph.spin_until(lambda: camera.overlays, "an overlay")
    overlay = camera.overlays[-1]
    assert overlay.format == "jpeg"
    assert overlay.header.stamp == time_stamp(camera.time_s)
    assert overlay.header.frame_id == "camera_optical"
    drawn = cv2.imdecode(np.frombuffer(overlay.data, np.uint8), cv2.IMREAD_COLOR)
    assert drawn.shape == pixels.shape
    # What is drawn over the bulb is green; the picture beside it is the camera's.
    changed = np.abs(drawn[..., ::-1].astype(int) - pixels).max(axis=2) > 60
    assert changed.sum() > 200
    assert changed[:40].sum() < 20


def test_an_object_beside_the_axis_is_found_there(graph):
    camera = Camera(graph)
    (found,) = camera.show(image(photograph("bulb", offset_m=(0.012, -0.008))))
    expected = np.array(load_scene("bulb")[0].object_position_m) + (0.012, -0.008, 0.0)
    place = (found.pose.position.x, found.pose.position.y, found.pose.position.z)
    np.testing.assert_allclose(place, expected, atol=WITHIN_M)


def test_rows_may_be_padded(graph):
    camera = Camera(graph)
    (found,) = camera.show(image(photograph("bulb"), padding=12))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


def test_images_that_come_too_fast_are_passed_over(graph):
    camera = Camera(graph, max_rate_hz=1.0, frozen_after_s=0.0)
    for _ in range(8):  # two seconds
        camera.send(image(photograph("empty")))
    camera.show(image(photograph("empty")))
    seen_at = [markers.markers[0].header.stamp for markers in camera.detections]
    assert seen_at == [time_stamp(time_s) for time_s in (1.25, 2.25, 3.25)]
    camera.node.set_parameters([Parameter("max_rate_hz", value=4.0)])
    camera.show(image(photograph("empty")))


def hurried(folder):
    """A detector file with hardly any time for a frame."""
    config = folder / "hurried.yaml"
    config.write_text(re.sub(r"budget_s: \S+", "budget_s: 0.001", config_path("detector.yaml").read_text()))
    return str(config)


def test_what_the_time_was_too_short_for_is_found_in_a_later_image_of_a_still_scene(graph, tmp_path):
    camera = Camera(graph, use_sim_time=False, detector=hurried(tmp_path), max_rate_hz=60.0, frozen_after_s=0.0)
    assert camera.show(image(photograph("bulb"))) == []
    assert "passed over, the time was up" in camera.node.health().message

    def is_found():
        camera.send(image(photograph("bulb")))
        return len(camera.detections[-1].markers) > 1

    graph.spin_until(is_found, "the bulb")


def test_in_simulated_time_a_slow_computer_finds_the_same(graph, tmp_path):
    (found,) = Camera(graph, detector=hurried(tmp_path)).show(image(photograph("bulb")))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


def test_a_camera_that_repeats_its_image_to_the_bit_is_refused_and_a_still_scene_is_not(graph):
    camera = Camera(graph)
    message = image(photograph("bulb"))
    for _ in range(8):
        message.data[1000] ^= 1
        assert camera.show(message)
    for _ in range(4):
        camera.show(message)
    camera.refuse(camera.send, message)
    camera.node.publish_health()
    graph.spin_until(lambda: "not a bit" in camera.reports[-1].status[0].message, "the health's word of it")
    assert camera.reports[-1].status[0].level == DiagnosticStatus.WARN
    message.data[1000] ^= 1
    assert camera.show(message)


def test_an_image_without_camera_info_is_refused_and_the_first_with_it_is_used(graph):
    camera = Camera(graph, informed=False)
    camera.refuse(camera.send, image(photograph("bulb")))
    camera.node.publish_health()
    graph.spin_until(lambda: camera.reports, "a report")
    assert camera.reports[-1].status[0].level == DiagnosticStatus.WARN
    assert "camera_info" in camera.reports[-1].status[0].message
    camera.inform(camera_info())
    assert camera.show(image(photograph("bulb")))


def renamed(encoding):
    return image(photograph("bulb"), encoding)


def with_field(name, value):
    message = image(photograph("bulb"))
    setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    "message",
    [
        renamed("rgba8"),
        renamed(""),
        image(photograph("bulb")[..., 0], "rgb8"),
        image(photograph("bulb")[::2]),
        image(photograph("bulb")[:, ::2]),
        image(photograph("bulb").repeat(2, axis=0).repeat(2, axis=1)),
        with_field("height", INTRINSICS.height_px - 1),
        with_field("step", 100),
        with_field("data", array.array("B", bytes(1000))),
        Image(encoding="rgb8"),
        Image(encoding="mono8", height=480),
    ],
    ids=[
        "four channels",
        "no encoding",
        "rgb8 with one byte a pixel",
        "half as high",
        "half as wide",
        "twice the size",
        "a row too many",
        "a step shorter than a row",
        "too few bytes",
        "empty",
        "rows without columns",
    ],
)
def test_a_wrong_image_is_refused_and_the_next_right_one_is_used(graph, message):
    camera = Camera(graph)
    camera.refuse(camera.send, message)
    assert camera.show(image(photograph("bulb")))


@pytest.mark.parametrize(
    "changes",
    [
        {"k": np.zeros(9)},
        {"k": np.full(9, math.nan)},
        {"k": -INTRINSICS.matrix.ravel()},
        {"width": 0},
    ],
    ids=["uncalibrated", "NaN", "negative focal lengths", "no width"],
)
def test_a_wrong_camera_info_is_refused_and_the_last_right_one_stands(graph, changes):
    camera = Camera(graph)
    camera.refuse(camera.infos.publish, camera_info(**changes))
    (found,) = camera.show(image(photograph("bulb")))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


@pytest.mark.parametrize("coefficients", [[0.1, 0.2], [math.nan] * 5, [0.0] * 12])
def test_a_lens_the_detector_cannot_undo_is_refused(graph, coefficients):
    camera = Camera(graph, informed=False)
    camera.inform(camera_info(d=coefficients))
    camera.refuse(camera.send, image(photograph("bulb")))
    camera.inform(camera_info())
    assert camera.show(image(photograph("bulb")))


def test_the_depth_of_the_support_may_be_set_right_while_the_node_runs(graph):
    camera = Camera(graph, support_depth_m=0.090)
    wrong = camera.show(image(photograph("bulb")))
    assert not any(abs(marker.scale.x - 0.060) < WITHIN_M for marker in wrong)
    camera.node.set_parameters([Parameter("support_depth_m", value=0.115)])
    (found,) = camera.show(image(photograph("bulb")))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


def test_the_health_report_warns_when_images_stop(graph):
    camera = Camera(graph)
    camera.show(image(photograph("bulb")))
    camera.node.publish_health()
    graph.spin_until(lambda: camera.reports[-1].status[0].message == "1 objects in view", "the sound report")
    graph.set_time(camera.time_s + 2.5)
    camera.node.publish_health()
    graph.spin_until(lambda: camera.reports[-1].status[0].level == DiagnosticStatus.WARN, "the warning")
    assert "camera/image_raw" in camera.reports[-1].status[0].message


def depth_image(scene_name, millimetres=False):
    metres = depth_of(scene_name)
    pixels = np.nan_to_num(1e3 * metres).astype(np.uint16) if millimetres else metres
    height, width = pixels.shape
    message = Image(height=height, width=width, encoding="16UC1" if millimetres else "32FC1")
    message.step = pixels.itemsize * width
    message.data = array.array("B", pixels.tobytes())
    return message


@pytest.mark.parametrize("millimetres", [False, True])
def test_a_depth_image_is_used_where_there_is_one(graph, millimetres):
    camera = Camera(graph)
    depths = graph.publisher(Image, "camera/depth/image_raw")
    infos = graph.publisher(CameraInfo, "camera/depth/camera_info")
    infos.publish(camera_info())
    message = depth_image("bulb", millimetres)
    graph.set_time(camera.time_s + 0.25)  # that of the image which follows
    depths.publish(message)
    graph.spin_until(lambda: camera.node._depth is not None, "the depth image")
    (found,) = camera.show(image(photograph("bulb")))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)
    health = camera.node.health()
    assert health.values["source"] == "depth" and float(health.values["camera_tilt_deg"]) < 1.0


def test_a_depth_image_that_is_none_is_refused(graph):
    camera = Camera(graph)
    depths = graph.publisher(Image, "camera/depth/image_raw")
    wrong = depth_image("bulb")
    wrong.encoding = "mono16"
    camera.refuse(depths.publish, wrong)
    assert "'mono16'" in camera.node.health().message


def test_the_empty_table_is_learnt_by_a_service(graph):
    camera = Camera(graph, background_frames=2)
    assert graph.call(Trigger, "object_detector/learn_background").success
    for _ in range(2):
        camera.show(image(photograph("empty")))
    (found,) = camera.show(image(photograph("bulb")))
    assert camera.node.health().values["source"] == "background"
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


def arcs(angle_deg):
    """Fingers bent inward, (4, 14, 3)."""
    base, length_m = load_gripper().finger_base_m[:, None], load_gripper().geometry.length_m
    angle = np.radians(max(angle_deg, 1e-6)) * np.linspace(0.0, 1.0, 14)[:, None]
    inward = -base / np.linalg.norm(base, axis=2, keepdims=True)
    return base + length_m / angle[-1] * ((1.0 - np.cos(angle)) * inward + np.sin(angle) * [0.0, 0.0, 1.0])


@functools.cache
def hand(angle_deg):
    """An image of fingers bent so far over an empty table."""
    return Renderer.from_config(CAMERA).render(SceneView(0.14, (), arcs(angle_deg)), np.random.default_rng(0))


class Fingers:
    """Tells the camera's node where the fingers are."""

    def __init__(self, camera):
        self._camera = camera
        self.words = camera.graph.publisher(MarkerArray, "finger_markers")

    def message(self, time_s, angle_deg, frame="gripper_base"):
        markers = finger_markers(time_stamp(time_s), frame, arcs(angle_deg), 0.01, (1.0, 1.0, 1.0))
        return MarkerArray(markers=markers)

    def tell(self, time_s, angle_deg):
        """Have the node hear where they are at a time."""
        self.words.publish(self.message(time_s, angle_deg))
        after = lambda: self._camera.node._fingers.awaited(time_s + 0.01)  # noqa: E731
        self._camera.graph.spin_until(after, "the word heard")

    def show(self, angle_deg):
        """Show bent fingers, told of just before and just after, and return what is seen."""
        seen = len(self._camera.detections)
        self.tell(self._camera.time_s + 0.20, angle_deg)
        self._camera.send(image(hand(angle_deg)))
        self.tell(self._camera.time_s + 0.05, angle_deg)
        self._camera.graph.spin_until(lambda: len(self._camera.detections) > seen, "detections")
        return self._camera.detections[-1].markers[1:]


def test_a_hand_that_closes_over_an_empty_table_is_no_object_where_its_fingers_are_told(graph):
    camera = Camera(graph, support_depth_m=0.14)
    assert camera.show(image(hand(0.0))) == []
    alarms = [len(camera.show(image(hand(angle_deg)))) for angle_deg in CLOSING_DEG]
    assert sum(alarms) > 0
    fingers = Fingers(camera)
    assert fingers.show(0.0) == []
    assert [fingers.show(angle_deg) for angle_deg in CLOSING_DEG] == [[]] * len(CLOSING_DEG)


def test_an_image_waits_for_the_first_word_of_the_fingers_at_or_after_it(graph):
    camera, reports = Camera(graph), graph.listen(DiagnosticArray, "/diagnostics")
    fingers = Fingers(camera)
    fingers.tell(camera.time_s + 0.20, 0.0)
    camera.send(image(photograph("bulb")))
    camera.node.publish_health()
    graph.spin_until(lambda: reports, "a report")
    assert not camera.detections
    fingers.words.publish(fingers.message(camera.time_s, 0.0))
    graph.spin_until(lambda: camera.detections, "detections")
    assert camera.detections[0].markers[0].header.stamp == time_stamp(camera.time_s)


def test_without_a_word_of_the_fingers_for_long_images_are_looked_at_at_once(graph):
    camera = Camera(graph)
    Fingers(camera).tell(camera.time_s - 0.4, 0.0)
    assert camera.show(image(photograph("bulb")))


def test_wrong_words_of_the_fingers_are_refused(graph):
    camera = Camera(graph)
    fingers = Fingers(camera)
    camera.refuse(fingers.words.publish, fingers.message(1.0, 30.0, frame="world"))
    one_missing, uneven, lost = (fingers.message(1.0, 30.0) for _ in range(3))
    one_missing.markers.pop()
    uneven.markers[2].points.pop()
    lost.markers[1].points[3].y = math.nan
    for message in (one_missing, uneven, lost):
        camera.refuse(fingers.words.publish, message)
    assert camera.show(image(photograph("bulb")))


def test_an_empty_table_that_fingers_hid_in_all_images_is_refused_and_the_health_says_how_much_of_it(graph):
    camera = Camera(graph, background_frames=2, support_depth_m=0.14)
    fingers = Fingers(camera)
    assert graph.call(Trigger, "object_detector/learn_background").success
    for angle_deg in (80.0, 82.0):
        fingers.show(angle_deg)
    health = camera.node.health()
    assert health.level == DiagnosticStatus.WARN
    assert re.search(r"the empty table refused: fingers hid \d+\.\d% of .* in all of 2 images", health.message)
    assert graph.call(Trigger, "object_detector/learn_background").success
    for angle_deg in (0.0, 40.0):
        fingers.show(angle_deg)
    assert camera.node.health().level == DiagnosticStatus.OK
    assert fingers.show(0.0) == [] and camera.node.health().values["source"] == "background"


def test_of_a_rectified_stream_p_counts(graph):
    camera = Camera(graph, informed=False, rectified=True)
    p = np.column_stack([INTRINSICS.matrix, np.zeros(3)]).ravel()
    camera.inform(camera_info(p=p, d=[0.3, -0.2, 0.0, 0.0, 0.1], distortion_model="plumb_bob"))
    (found,) = camera.show(image(photograph("bulb")))
    assert math.isclose(found.scale.x, 0.060, abs_tol=WITHIN_M)


def test_a_region_of_the_image_is_placed_where_it_is(graph):
    camera = Camera(graph, informed=False)
    roi = RegionOfInterest(x_offset=100, y_offset=0, width=600, height=INTRINSICS.height_px)
    camera.inform(camera_info(roi=roi))
    (found,) = camera.show(image(np.ascontiguousarray(photograph("bulb")[:, 100:700])))
    np.testing.assert_allclose((found.scale.x, found.pose.position.y), (0.060, 0.0), atol=WITHIN_M)


def test_the_executor_goes_on_while_an_image_is_looked_at(graph):
    """What carries the valves in bringup waits for no image, and images that come meanwhile are passed over."""
    node = graph.add(ObjectDetectorNode, max_rate_hz=60.0)
    detections, reports = graph.listen(MarkerArray, "detections"), graph.listen(DiagnosticArray, "/diagnostics")
    infos, images = graph.publisher(CameraInfo, "camera/camera_info"), graph.publisher(Image, "camera/image_raw")
    infos.publish(camera_info())
    graph.spin_until(lambda: "no camera_info" not in node.health().message, "camera_info")
    begun, go_on, looks = threading.Event(), threading.Event(), []
    look = node._detector.look

    def slow(*arguments):
        looks.append(arguments)
        begun.set()
        assert go_on.wait(10.0)
        return look(*arguments)

    node._detector.look = slow
    images.publish(image(photograph("bulb")))
    graph.spin_until(begun.is_set, "the look")
    seen = len(reports)
    images.publish(image(photograph("empty")))
    graph.spin_until(lambda: len(reports) >= seen + 2, "two more reports while it lasts")
    assert not detections and len(looks) == 1
    go_on.set()
    graph.spin_until(lambda: detections, "detections")
    assert len(detections[0].markers) == 2


def test_where_vision_msgs_is_installed_each_detection_goes_out_as_a_box_with_a_hypothesis_too(graph, monkeypatch):
    """Against stand-ins of the types, which no wheel holds; the names of their fields are those of vision_msgs 4."""
    record, sent, real = SimpleNamespace, [], Node.create_publisher
    types = record(
        Detection3DArray=record,
        Detection3D=lambda: record(bbox=record()),
        ObjectHypothesisWithPose=lambda: record(hypothesis=record(), pose=record()),
    )

    def create(node, message_type, topic, qos, **options):
        if message_type is not types.Detection3DArray:
            return real(node, message_type, topic, qos, **options)
        return record(publish=lambda message: sent.append((topic, message)))

    monkeypatch.setattr(vision_detections, "vision_messages", lambda: types)
    monkeypatch.setattr(Node, "create_publisher", create)
    camera = Camera(graph, frame_prefix="right/")
    (marker,) = camera.show(image(photograph("bulb")))
    ((topic, message),) = sent
    (found,) = message.detections
    (result,) = found.results
    assert topic == "detections/vision" and message.header == found.header == marker.header
    assert found.bbox.center == result.pose.pose == marker.pose and found.bbox.size == marker.scale
    assert (result.hypothesis.class_id, result.hypothesis.score) == (marker.text, pytest.approx(marker.color.a))
