"""Node ``object_detector``: camera images to objects with shape, size and pose."""

from __future__ import annotations

import array
import copy
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mbpam_ros.nodes.runtime import STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.markers import BASE_FRAME, colour, delete_all, solid_marker
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.vision.camera import CameraError, Intrinsics, camera_pose, distortion_of, load_camera_config
from mbpam_ros.vision.detector import Detection, ImageError, ObjectDetector, load_detector_config
from mbpam_ros.vision.overlay import draw_overlay

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: the open fingers, which hide parts of the view"),
    Parameter("camera", "camera.yaml", "camera file: pose of the camera in gripper_base"),
    Parameter("detector", "detector.yaml", "detector file: thresholds"),
    Parameter("support_depth_m", 0.115, "depth of the surface under the objects below the palm [m]", 0.02, 2.0, True),
    Parameter("max_rate_hz", 4.0, "images that come faster are passed over [Hz]", 0.1, 60.0, changeable=True),
    Parameter("jpeg_quality", 85, "quality of detections/image", 1, 100, changeable=True),
)

CHANNELS = {"rgb8": 3, "bgr8": 3, "mono8": 1}
SHAPE_RGB = (0.2, 0.8, 0.3)


class ObjectDetectorNode(GripperNode):
    """Adapter around :class:`ObjectDetector`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("object_detector", PARAMETERS, **node_options)
        camera = load_camera_config(self.text("camera"))
        self._detector = ObjectDetector(
            load_detector_config(self.text("detector")), camera_pose(camera), load_gripper(self.text("gripper"))
        )
        self._intrinsics: Intrinsics | None = None
        self._distortion: NDArray[np.float64] | None = None
        self._seen_at_s: float | None = None
        self._refusals: dict[str, str] = {}
        self._found: list[Detection] = []
        self._found_in: tuple[object, ...] | None = None

        self._detections = self.create_publisher(MarkerArray, "detections", STREAM)
        self._overlay = self.create_publisher(CompressedImage, "detections/image", STREAM)
        self._listen_to_camera(CameraInfo, "camera/camera_info", self._on_camera_info)
        self._listen_to_camera(Image, "camera/image_raw", self._on_image)

    def health(self) -> Health:
        """WARN while no image comes or none can be used."""
        if self._refusals:
            refusals = (f"{source} refused: {reason}" for source, reason in self._refusals.items())
            return Health(DiagnosticStatus.WARN, "; ".join(refusals))
        if self._intrinsics is None:
            return Health(DiagnosticStatus.WARN, "no camera_info received on 'camera/camera_info'")
        if self._seen_at_s is None or self.now_s() - self._seen_at_s > 2.0:
            return Health(DiagnosticStatus.WARN, "no image received on 'camera/image_raw' for 2 s")
        return Health(message=f"{len(self._found)} objects in view")

    def _listen_to_camera(self, message_type: type, topic: str, callback: Callable[[Any], None]) -> None:
        """Subscribe reliably, as large images need, unless a parameter ``qos_overrides.<topic>...`` says otherwise."""
        qos = copy.copy(STREAM)  # rclpy writes the overrides into the profile it is given
        overrides = QoSOverridingOptions.with_default_policies()
        self.create_subscription(message_type, topic, callback, qos, qos_overriding_options=overrides)

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            distortion = distortion_of(message.distortion_model, message.d)
            self._intrinsics = Intrinsics.from_camera_info(message.width, message.height, message.k)
            self._distortion = distortion
            self._refusals.pop("camera_info", None)
        except CameraError as error:
            self._refuse("camera_info", error)

    def _on_image(self, message: Image) -> None:
        now_s = self.now_s()
        # A tenth early, so that an image stream of just this rate is not halved by its jitter.
        if self._seen_at_s is not None and 0.0 <= now_s - self._seen_at_s < 0.9 / self.number("max_rate_hz"):
            return
        self._seen_at_s = now_s
        try:
            if self._intrinsics is None or self._distortion is None:
                raise ImageError("no valid camera_info yet")
            image = _pixels(message)
            depth_m = self.number("support_depth_m")
            # A still scene of the simulated camera repeats its image byte for byte: what was found stands.
            view = (message.encoding, image.shape, self._intrinsics, self._distortion.tobytes(), depth_m, message.data)
            if view != self._found_in:
                self._found = self._detector.detect(
                    image, message.encoding, self._intrinsics, self._distortion, depth_m
                )
                self._found_in = view
        except (ImageError, CameraError) as error:
            self._refuse("image", error)
            return
        self._refusals.pop("image", None)
        self._publish_detections(message)
        if self._overlay.get_subscription_count() > 0:
            self._publish_overlay(message, image)

    def _refuse(self, source: str, error: ImageError | CameraError) -> None:
        self._refusals[source] = str(error)
        self.refuse(source, error)

    def _publish_detections(self, message: Image) -> None:
        stamp = message.header.stamp
        markers: list[Marker] = [delete_all(stamp, BASE_FRAME)]
        for index, found in enumerate(self._found):
            marker = solid_marker(
                stamp,
                BASE_FRAME,
                found.shape,
                index,
                found.shape,
                found.size_m,
                found.position_m,
                found.orientation_xyzw,
                colour(SHAPE_RGB, found.confidence),
            )
            marker.text = found.label
            markers.append(marker)
        self._detections.publish(MarkerArray(markers=markers))

    def _publish_overlay(self, message: Image, image: NDArray[np.uint8]) -> None:
        overlay = draw_overlay(image, message.encoding, self._found)
        _, jpeg = cv2.imencode(".jpg", overlay, [cv2.IMWRITE_JPEG_QUALITY, self.whole("jpeg_quality")])
        compressed = CompressedImage(header=message.header, format="jpeg")
        compressed.data = array.array("B", jpeg.tobytes())
        self._overlay.publish(compressed)


def _pixels(message: Image) -> NDArray[np.uint8]:
    """Return the image as (H, W, 3) or, for mono8, (H, W).

    Raises:
        ImageError: an encoding the detector does not read, or fewer bytes than size and step say.
    """
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise ImageError(f"encoding {message.encoding!r} is none of {', '.join(CHANNELS)}")
    row_bytes = message.width * channels
    if row_bytes == 0 or message.step < row_bytes or len(message.data) != message.step * message.height:
        raise ImageError(
            f"{message.width} x {message.height} {message.encoding} with step {message.step} does not fit "
            f"{len(message.data)} bytes"
        )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.step)[:, :row_bytes]
    shape = (message.height, message.width) if channels == 1 else (message.height, message.width, channels)
    return np.ascontiguousarray(rows).reshape(shape)


def main() -> int:
    """Run the node until a signal."""
    return run(ObjectDetectorNode)


if __name__ == "__main__":
    sys.exit(main())
