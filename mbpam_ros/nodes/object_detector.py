"""Node ``object_detector``: camera images to objects with shape, size and pose.

A frame is looked at in a thread of its own, one at a time, so that in one process with the valves a slow frame delays
none of their ticks; images that come meanwhile are passed over, and what is found is published by the next timer tick.
An image waits until where the fingers were is told (:mod:`~mbpam_ros.vision.told_fingers`), if anybody tells it.
"""

from __future__ import annotations

import array
import copy
import math
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

from mbpam_ros.nodes.runtime import STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.description.frames import Frames
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.markers import colour, delete_all, finger_lines, mark_hidden_lengths, solid_marker
from mbpam_ros.nodes.messages import MessageError, image_pixels, seconds
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.transforms import FRAME_PREFIX
from mbpam_ros.nodes.vision_detections import DetectionBroadcaster
from mbpam_ros.vision.background import BackgroundError
from mbpam_ros.vision.camera import CameraData, CameraError, Intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.depth import DepthError, DepthImage, depth_in_metres
from mbpam_ros.vision.detector import ImageError, ObjectDetector, Sighting, load_detector_config, open_fingers
from mbpam_ros.vision.overlay import draw_overlay
from mbpam_ros.vision.stillness import FrozenCamera, is_same_scene
from mbpam_ros.vision.told_fingers import ToldFingers, UnderHand

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: the fingers, which hide parts of the view"),
    Parameter("camera", "camera.yaml", "camera file: pose of the camera in gripper_base"),
    Parameter("detector", "detector.yaml", "detector file: thresholds"),
    Parameter("support_depth_m", 0.115, "depth of the surface under the objects below the palm [m]", 0.02, 2.0, True),
    Parameter("max_rate_hz", 4.0, "images that come faster are passed over [Hz]", 0.1, 60.0, changeable=True),
    Parameter(
        "rectified", False, "images are rectified, as image_proc leaves them: P of the camera_info is used, D is not"
    ),
    Parameter("background_frames", 5, "images of the empty table that learn_background takes", 1, 50, changeable=True),
    Parameter("depth_max_age_s", 0.2, "older depth images are not used [s]", 0.01, 5.0, changeable=True),
    Parameter(
        "frozen_after_s", 1.0, "the very same image for longer is a camera that has stopped [s]; 0: off", 0.0, 60.0
    ),
    Parameter("jpeg_quality", 85, "quality of detections/image", 1, 100, changeable=True),
    FRAME_PREFIX,
)

DEPTH_TYPES = {"32FC1": np.float32, "16UC1": np.uint16}
SHAPE_RGB = (0.2, 0.8, 0.3)
TILT_WARNING_DEG = 2.0
POLL_PERIOD_S = 0.005
"""How often the node looks whether the frame in work is done."""

_UNUSABLE = (MessageError, ImageError, CameraError, BackgroundError, DepthError)


class _Frame(NamedTuple):
    """An image with what belongs to it."""

    message: Image
    image: NDArray[np.uint8]
    intrinsics: Intrinsics
    distortion: NDArray[np.float64]
    depth: DepthImage | None


class ObjectDetectorNode(GripperNode):
    """Adapter around :class:`ObjectDetector`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        # First: a node that refuses its parameters or files is destroyed half built.
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="detector")
        super().__init__("object_detector", PARAMETERS, **node_options)
        self._frame = Frames(self.text("frame_prefix")).base
        camera = load_camera_config(self.text("camera"))
        gripper = load_gripper(self.text("gripper"))
        self._detector = ObjectDetector(load_detector_config(self.text("detector")), camera_pose(camera), gripper)
        self._fingers = ToldFingers(open_fingers(gripper))
        self._under_hand = UnderHand(gripper.finger_circle_radius_m + gripper.geometry.outer_radius_m)
        self._intrinsics: Intrinsics | None = None
        self._distortion: NDArray[np.float64] | None = None
        self._depth_intrinsics: Intrinsics | None = None
        self._depth: DepthImage | None = None
        self._depth_at_s = 0.0
        self._seen_at_s: float | None = None
        self._refusals: dict[str, str] = {}
        self._seen: Sighting | None = None
        self._found_in: tuple[tuple[object, ...], NDArray[np.uint8]] | None = None
        self._patience = 1.0
        self._frozen = FrozenCamera(self.number("frozen_after_s"))
        self._learning: list[tuple[NDArray[np.uint8], NDArray[np.float64] | None]] | None = None
        self._waiting: _Frame | None = None
        self._work: tuple[Future[Sighting], _Frame, tuple[object, ...], bool] | None = None

        self._detections = self.create_publisher(MarkerArray, "detections", STREAM)
        self._of_others = DetectionBroadcaster(self)
        self._overlay = self.create_publisher(CompressedImage, "detections/image", STREAM)
        self._listen_to_camera(CameraInfo, "camera/camera_info", self._on_camera_info)
        self._listen_to_camera(Image, "camera/image_raw", self._on_image)
        self._listen_to_camera(CameraInfo, "camera/depth/camera_info", self._on_depth_info)
        self._listen_to_camera(Image, "camera/depth/image_raw", self._on_depth)
        self.create_subscription(MarkerArray, "finger_markers", self._on_finger_markers, STREAM)
        self.create_service(Trigger, "object_detector/learn_background", self._on_learn_background)
        # Runs while a frame is in work alone: in one process with all nodes every tick counts.
        self._poll = self.create_timer(
            POLL_PERIOD_S, self._take_finished, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._poll.cancel()

    def health(self) -> Health:
        """WARN while no image comes or none can be used."""
        if self._refusals:
            refusals = (f"{source} refused: {reason}" for source, reason in self._refusals.items())
            return Health(DiagnosticStatus.WARN, "; ".join(refusals))
        if self._intrinsics is None:
            return Health(DiagnosticStatus.WARN, "no camera_info received on 'camera/camera_info'")
        if self._seen_at_s is None or self.now_s() - self._seen_at_s > 2.0:
            if self._work is not None:
                return Health(DiagnosticStatus.WARN, "the last image is still being looked at after more than 2 s")
            return Health(DiagnosticStatus.WARN, "no image received on 'camera/image_raw' for 2 s")
        return self._health_of(self._seen)

    def _health_of(self, seen: Sighting | None) -> Health:
        if seen is None:
            return Health(message="looking at the first image")
        values = {"source": seen.source, "cpu_ms": f"{1e3 * seen.cpu_s:.0f}"}
        if seen.tilt_deg is not None:
            values["camera_tilt_deg"] = f"{seen.tilt_deg:.1f}"
            values["support_depth_measured_m"] = f"{seen.support_depth_m:.4f}"
        message = f"{len(seen.detections)} objects in view"
        if seen.remark:
            return Health(DiagnosticStatus.WARN, f"{message}; {seen.remark}", values)
        if seen.tilt_deg is not None and seen.tilt_deg > TILT_WARNING_DEG:
            tilt = f"the camera is tilted {seen.tilt_deg:.1f} deg against camera.yaml; corrected for"
            return Health(DiagnosticStatus.WARN, f"{message}; {tilt}", values)
        if seen.passed_over:
            values["passed_over"] = str(seen.passed_over)
            message += f"; {seen.passed_over} smaller regions passed over, the time was up"
        return Health(message=message, values=values)

    def destroy_node(self) -> None:
        """Wait for the frame in work, then leave the graph."""
        self._thread.shutdown(wait=True, cancel_futures=True)
        super().destroy_node()

    def _listen_to_camera(self, message_type: type, topic: str, callback: Callable[[Any], None]) -> None:
        """Subscribe reliably, as large images need, unless a parameter ``qos_overrides.<topic>...`` says otherwise."""
        qos = copy.copy(STREAM)  # rclpy writes the overrides into the profile it is given
        overrides = QoSOverridingOptions.with_default_policies()
        self.create_subscription(message_type, topic, callback, qos, qos_overriding_options=overrides)

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            self._intrinsics, self._distortion = self._pinhole(message)
            self._refusals.pop("camera_info", None)
        except CameraError as error:
            self._refuse("camera_info", error)

    def _on_depth_info(self, message: CameraInfo) -> None:
        try:
            self._depth_intrinsics, _ = self._pinhole(message)
            self._refusals.pop("depth camera_info", None)
        except CameraError as error:
            self._refuse("depth camera_info", error)

    def _pinhole(self, message: CameraInfo) -> tuple[Intrinsics, NDArray[np.float64]]:
        roi = message.roi
        return CameraData(
            message.width,
            message.height,
            message.distortion_model,
            message.d,
            message.k,
            message.p,
            (message.binning_x, message.binning_y),
            (roi.x_offset, roi.y_offset, roi.width, roi.height),
        ).pinhole(bool(self.value("rectified")))

    def _on_depth(self, message: Image) -> None:
        try:
            values = _depth_values(message)
            self._depth = DepthImage(depth_in_metres(values, message.encoding), self._depth_intrinsics)
            self._depth_at_s = self.now_s()
            self._refusals.pop("depth image", None)
        except DepthError as error:
            self._refuse("depth image", error)

    def _on_image(self, message: Image) -> None:
        now_s = self.now_s()
        # A tenth early, so that an image stream of just this rate is not halved by its jitter.
        if self._seen_at_s is not None and 0.0 <= now_s - self._seen_at_s < 0.9 / self.number("max_rate_hz"):
            return
        if self._work is not None and not self._work[0].done():
            return
        self._take_finished()
        self._seen_at_s = now_s
        try:
            if self._intrinsics is None or self._distortion is None:
                raise ImageError("no valid camera_info yet")
            image = image_pixels(message)
            self._frozen.check(seconds(message.header.stamp), message.data)
        except _UNUSABLE as error:
            self._refuse("image", error)
            return
        depth = self._depth if 0.0 <= now_s - self._depth_at_s <= self.number("depth_max_age_s") else None
        self._waiting = _Frame(message, image, self._intrinsics, self._distortion, depth)
        self._look_once_told()

    def _on_finger_markers(self, message: MarkerArray) -> None:
        try:
            stamp, lines = finger_lines(message, self._frame)
        except MessageError as error:
            self.refuse("finger_markers", error)
            return
        self._fingers.tell(seconds(stamp), lines)
        self._look_once_told()

    def _look_once_told(self) -> None:
        """Look at the image that waits, unless where the fingers were in it is still to be told."""
        frame = self._waiting
        if frame is None or self._fingers.awaited(seconds(frame.message.header.stamp)):
            return
        self._waiting = None
        try:
            self._look(frame, self._fingers.at(seconds(frame.message.header.stamp)))
        except _UNUSABLE as error:
            self._refuse("image", error)

    def _look(self, frame: _Frame, told_m: NDArray[np.float64] | None) -> None:
        message, image, intrinsics, distortion, depth = frame
        if self._learning is not None:
            self._learn(frame, told_m)
        fingers_m = told_m if self._under_hand.is_empty else None
        depth_m = self.number("support_depth_m")
        view = (
            *(message.encoding, image.shape, intrinsics, distortion.tobytes(), depth_m, id(self._detector.background)),
            *(None if each is None else each.tobytes() for each in (depth.metres if depth else None, fingers_m)),
        )
        is_still = self._found_in is not None and view == self._found_in[0] and is_same_scene(image, self._found_in[1])
        # In a still scene what was found stands.
        if is_still and self._seen is not None and self._seen.passed_over == 0:
            self._refusals.pop("image", None)
            self._publish(message, image)
            return
        simulated = bool(self.value("use_sim_time"))
        # What the time was too short for in a still scene is given more of it; simulated time stands still for a frame.
        self._patience = math.inf if simulated else 2.0 * self._patience if is_still else 1.0
        arguments = (image, message.encoding, intrinsics, distortion, depth_m, fingers_m, depth, self._patience)
        self._work = self._thread.submit(self._detector.look, *arguments), frame, view, told_m is None
        self._poll.reset()
        if simulated:  # and a run repeats
            self._work[0].exception()
            self._take_finished()

    def _take_finished(self) -> None:
        """Publish what the thread has found, if it has."""
        if self._work is None or not self._work[0].done():
            return
        future, frame, view, with_open_fingers = self._work
        self._work = None
        self._poll.cancel()
        try:
            self._seen, self._found_in = future.result(), (view, frame.image)
        except _UNUSABLE as error:
            self._refuse("image", error)
            return
        if with_open_fingers:
            self._under_hand.seen(self._seen.detections)
        self._refusals.pop("image", None)
        self._publish(frame.message, frame.image)

    def _publish(self, message: Image, image: NDArray[np.uint8]) -> None:
        self._publish_detections(message)
        header = Header(stamp=message.header.stamp, frame_id=self._frame)
        self._of_others.send(header, self._seen.detections if self._seen else ())
        if self._overlay.get_subscription_count() > 0:
            self._publish_overlay(message, image)

    def _refuse(self, source: str, error: Exception) -> None:
        self._refusals[source] = str(error)
        self.refuse(source, error)

    def _on_learn_background(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin to learn; the images that come next are the empty table's."""
        if self._intrinsics is None:
            response.success, response.message = False, "no camera_info yet"
            return response
        self._learning = []
        response.success = True
        response.message = f"the next {self.whole('background_frames')} images are taken as the empty table"
        return response

    def _learn(self, frame: _Frame, told_m: NDArray[np.float64] | None) -> None:
        assert self._learning is not None
        self._learning.append((frame.image, told_m))
        if len(self._learning) < self.whole("background_frames"):
            return
        (images, told), self._learning = zip(*self._learning, strict=True), None
        try:
            view = frame.message.encoding, frame.intrinsics, frame.distortion
            self._detector.learn_background(images, *view, told)
        except BackgroundError as error:
            self._refuse("the empty table", error)
            return
        self._refusals.pop("the empty table", None)
        self.get_logger().info(f"learnt the empty table from {len(images)} images")

    def _publish_detections(self, message: Image) -> None:
        stamp = message.header.stamp
        markers: list[Marker] = [delete_all(stamp, self._frame)]
        for index, found in enumerate(self._seen.detections if self._seen else ()):
            marker = solid_marker(
                stamp,
                self._frame,
                found.shape,
                index,
                found.shape,
                found.size_m,
                found.position_m,
                found.orientation_xyzw,
                colour(SHAPE_RGB, found.confidence),
            )
            marker.text = f"{found.label} ({found.bound})" if found.bound else found.label
            mark_hidden_lengths(marker, found.hidden_m)
            markers.append(marker)
        self._detections.publish(MarkerArray(markers=markers))

    def _publish_overlay(self, message: Image, image: NDArray[np.uint8]) -> None:
        overlay = draw_overlay(image, message.encoding, self._seen.detections if self._seen else ())
        _, jpeg = cv2.imencode(".jpg", overlay, [cv2.IMWRITE_JPEG_QUALITY, self.whole("jpeg_quality")])
        compressed = CompressedImage(header=message.header, format="jpeg")
        compressed.data = array.array("B", jpeg.tobytes())
        self._overlay.publish(compressed)


def _depth_values(message: Image) -> NDArray:
    """Return a depth image as (H, W) of its own type.

    Raises:
        DepthError: an encoding that is none of depth, or fewer bytes than size and step say.
    """
    kind = DEPTH_TYPES.get(message.encoding)
    if kind is None:
        raise DepthError(f"depth encoding {message.encoding!r} is none of {', '.join(DEPTH_TYPES)}")
    size = np.dtype(kind).itemsize
    if message.width == 0 or message.step < size * message.width or len(message.data) != message.step * message.height:
        raise DepthError(
            f"{message.width} x {message.height} {message.encoding} with step {message.step} does not fit "
            f"{len(message.data)} bytes"
        )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)
    values = np.ascontiguousarray(rows[:, : size * message.width]).view(kind)
    return values.byteswap() if message.is_bigendian else values


def main() -> int:
    """Run the node until a signal."""
    return run(ObjectDetectorNode)


if __name__ == "__main__":
    sys.exit(main())
