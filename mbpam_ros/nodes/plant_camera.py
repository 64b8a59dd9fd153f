"""The plant's camera: renders beside the plant's own thread and publishes what is finished."""

from __future__ import annotations

import array
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from mbpam_ros.gripper import Gripper
from mbpam_ros.nodes.runtime import STREAM, GripperNode
from mbpam_ros.plant.plant import Observation
from mbpam_ros.plant.scene import Scene
from mbpam_ros.vision.camera import Intrinsics, camera_intrinsics, load_camera_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

_Frame = tuple[array.array, array.array | None]

DEFAULT_FLOOR_DEPTH_M = 0.5
STILL_TURN_RAD = 1e-3
STILL_DISTANCE_M = 1e-4
STILL_NOISE_VALUES = 500


class PlantCamera:
    """Camera images of the simulated scene on ``camera/image_raw`` and ``camera/camera_info``; depth where asked for.

    One frame is rendered at a time in a thread of its own, so that a slow frame delays no transducer; a frame asked
    for meanwhile is dropped, as a camera would. A scene that has not moved since the last frame is not rendered anew,
    but some of its noise is: pictures that repeat to the bit are those of a camera that has stopped.

    Args:
        node: publishes for it; its parameters ``camera`` and ``seed`` are read.
        gripper: size of the fingers.
        scene: the objects and their support.
        frame: name of the optical frame.
        camera: file of the camera instead of the parameter's.
    """

    def __init__(
        self, node: GripperNode, gripper: Gripper, scene: Scene, frame: str, camera: str | None = None
    ) -> None:
        config = load_camera_config(camera or node.text("camera"))
        self._renderer = Renderer.from_config(config)
        self._rng = np.random.default_rng(node.whole("seed"))
        self._finger_radius_m = gripper.geometry.outer_radius_m
        self._scene = scene
        self._info = _camera_info(camera_intrinsics(config), frame)
        self._images = node.create_publisher(Image, "camera/image_raw", STREAM)
        self._infos = node.create_publisher(CameraInfo, "camera/camera_info", STREAM)
        self._depths = node.create_publisher(Image, "camera/depth/image_raw", STREAM)
        self._depth_infos = node.create_publisher(CameraInfo, "camera/depth/camera_info", STREAM)
        self._with_depth = bool(node.value("depth_camera"))
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="camera")
        self._exposure: tuple[Future[_Frame], Time] | None = None
        self._last_pose: NDArray[np.float64] | None = None
        self._last_data: tuple[array.array, array.array | None] | None = None

    def expose(self, observation: Observation, stamp: Time) -> None:
        """Start a frame of what is seen now, unless nobody looks or the last frame is not finished."""
        if self._images.get_subscription_count() == 0 or self._exposure is not None:
            return
        pose = _pose_vector(observation)
        if self._last_data is not None and _is_still(pose, self._last_pose):
            self._publish((self._with_fresh_noise(self._last_data[0]), self._last_data[1]), stamp)
            return
        self._last_pose = pose
        self._exposure = self._thread.submit(self._render, self._view(observation)), stamp

    def publish_finished(self, wait: bool) -> None:
        """Publish the frame begun before if it is finished, or once it is (``wait``)."""
        if self._exposure is None or not (wait or self._exposure[0].done()):
            return
        future, stamp = self._exposure
        self._exposure = None
        self._last_data = future.result()
        self._publish(self._last_data, stamp)

    def _render(self, view: SceneView) -> _Frame:
        image = array.array("B", self._renderer.render(view, self._rng).tobytes())
        if not self._with_depth:
            return image, None
        return image, array.array("B", self._renderer.render_depth(view, self._rng).tobytes())

    def _with_fresh_noise(self, data: array.array) -> array.array:
        """Return a picture in which a few values are another grey level."""
        fresh = array.array("B", data)
        values = np.frombuffer(fresh, dtype=np.uint8)
        where = self._rng.integers(len(values), size=STILL_NOISE_VALUES)
        values[where] ^= 1
        return fresh

    def _publish(self, frame: _Frame, stamp: Time) -> None:
        data, depth_data = frame
        self._info.header.stamp = stamp
        image = Image(encoding="rgb8", height=self._info.height, width=self._info.width, is_bigendian=0)
        image.header.stamp, image.header.frame_id = stamp, self._info.header.frame_id
        image.step = 3 * self._info.width
        image.data = data
        self._infos.publish(self._info)
        if depth_data is not None:
            # Before the image: who waits for that has the depth of the same moment.
            depth = Image(encoding="32FC1", height=image.height, width=image.width, step=4 * image.width)
            depth.header, depth.data = image.header, depth_data
            self._depth_infos.publish(self._info)
            self._depths.publish(depth)
        self._images.publish(image)

    def _view(self, observation: Observation) -> SceneView:
        """The scene in ``gripper_base``; the support sinks when the hand is raised."""
        rise_m = observation.hand_lift_m
        support = self._scene.support
        half_size_m: tuple[float, float] | None = None
        floor_depth_m = SceneView.floor_depth_m
        if support is None:
            depth_m = DEFAULT_FLOOR_DEPTH_M
        else:
            depth_m = support.depth_m + rise_m
            if support.half_size_m is not None and support.stand_height_m is not None:
                half_size_m, floor_depth_m = support.half_size_m, depth_m + support.stand_height_m
        solids = tuple(
            ColouredSolid(
                placed.object.shape,
                np.array(placed.object.size_m),
                there.in_gripper.position_m,
                there.in_gripper.orientation_xyzw,
                placed.object.colour_rgb,
            )
            for placed, there in zip(self._scene.placed, observation.objects, strict=True)
        )
        return SceneView(
            support_depth_m=depth_m,
            solids=solids,
            finger_centrelines_m=observation.centreline_m,
            finger_radius_m=self._finger_radius_m,
            support_half_size_m=half_size_m,
            floor_depth_m=floor_depth_m,
        )


def _camera_info(intrinsics: Intrinsics, frame: str) -> CameraInfo:
    info = CameraInfo(width=intrinsics.width_px, height=intrinsics.height_px, distortion_model="plumb_bob")
    info.header.frame_id = frame
    info.d = [0.0] * 5
    info.k = intrinsics.matrix.ravel()
    info.r = np.eye(3).ravel()
    info.p = np.column_stack([intrinsics.matrix, np.zeros(3)]).ravel()
    return info


def _pose_vector(observation: Observation) -> NDArray[np.float64]:
    """Everything the view depends on, scaled so that 1 is a change worth a new frame."""
    parts = [
        observation.centreline_m.ravel() / STILL_DISTANCE_M,
        np.array([observation.hand_lift_m / STILL_DISTANCE_M]),
    ]
    for there in observation.objects:
        parts.append(there.in_gripper.position_m / STILL_DISTANCE_M)
        parts.append(there.in_gripper.orientation_xyzw / STILL_TURN_RAD)
    return np.concatenate(parts)


def _is_still(pose: NDArray[np.float64], last: NDArray[np.float64] | None) -> bool:
    return last is not None and bool(np.abs(pose - last).max() < 1.0)
