"""The rig over ROS: set-points to the valve controller, pressures, pictures and the scale's readings back."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Any

from mbpam_ros.commands.system import NodeSystemError, Operator  # isort: skip
import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_srvs.srv import SetBool

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.gripper import Gripper
from mbpam_ros.nodes.messages import MessageError, image_pixels, joint_state, named_values, seconds, time_stamp
from mbpam_ros.nodes.plant_rig import MOUNT
from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM
from mbpam_ros.study.rig.procedure import FORCE, Mount, Reading, RigError
from mbpam_ros.vision.camera import Camera, CameraData, CameraError, camera_pose, load_camera_config
from mbpam_ros.vision.side_markers import MarkerError, bend_between_markers
from mbpam_ros.vision.side_view import MuscleSize, SilhouetteError, bend_in_picture

SILENCE_S = 2.0
"""Whoever has sent nothing new for so long is lost."""

APART_S = 1.0
"""What belongs to a picture was measured no further from it in time."""

FIRST_S = 20.0
"""What has not been heard at all after so long is not there."""


_KEPT = 2000
"""Messages of each kind: 20 s at 100 Hz."""


class RosRig:
    """A :class:`~mbpam_ros.study.rig.procedure.Rig` of running nodes; vents the muscle when the ``with`` block ends.

    Args:
        gripper: whose muscle is mounted, as finger 1.
        camera: file of where the camera at the side stands.
        tip_round_mm: by how much a round tip stands out; none: a flat one, the simulated one's being round.
        marker_rgb: colour, 0 to 1, of two strips to read the bend from; None: of the silhouette.
        namespace: of the nodes.
        domain_id: ROS domain; none: of the environment.
        idle: called while one waits for messages.

    Raises:
        RigError: a part of the rig is not there.
    """

    def __init__(
        self,
        gripper: Gripper,
        camera: str,
        tip_round_mm: float | None = None,
        marker_rgb: tuple[float, float, float] | None = None,
        namespace: str = "",
        domain_id: int | None = None,
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        self._pose = camera_pose(load_camera_config(camera))
        self._gripper, self._tip_round_mm, self._marker_rgb = gripper, tip_round_mm, marker_rgb
        self._heard: dict[str, tuple[float, Any]] = {}
        self._past: dict[str, deque[tuple[float, Any]]] = {
            name: deque(maxlen=_KEPT) for name in ("chamber_states", "scale/wrench")
        }
        self._read = dict.fromkeys(("chamber_states", "camera/image_raw", "scale/wrench"), -math.inf)
        self._operator = Operator("characterise", namespace, idle, domain_id)
        node = self._operator.node
        self._setpoints = node.create_publisher(JointState, "pressure_setpoints", STREAM)
        self._mounts = node.create_publisher(JointState, "rig/mount", LATCHED)
        for topic, kind in (
            ("chamber_states", JointState),
            ("camera/image_raw", Image),
            ("camera/camera_info", CameraInfo),
            ("scale/wrench", WrenchStamped),
        ):
            node.create_subscription(kind, topic, self._hearing(topic), NEWEST)

    def __enter__(self) -> RosRig:
        """Wait for all parts of the rig, and switch the air on."""
        try:
            for name in (*self._read, "camera/camera_info"):
                self._operator.wait_for(partial(self._heard.__contains__, name), FIRST_S, f"a message on {name}")
            self._operator.ask(SetBool, "valve_controller/enable", SetBool.Request(data=True))
        except NodeSystemError as error:
            self._operator.close()
            raise RigError(f"the rig is not complete: {error}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Vent the muscle and leave."""
        self.command([0.0] * CHAMBERS_PER_FINGER)
        self._operator.spin(0.1)
        self._operator.close()

    def mount(self, mount: Mount) -> None:
        """Have the muscle put up so: by the plant, or by whoever sits at the terminal."""
        plate = mount.quantity == FORCE
        position = np.array([math.radians(mount.azimuth_deg), float(plate)])
        self._mounts.publish(joint_state(time_stamp(time.time()), MOUNT, position=position))
        if self._is_simulated():
            return
        if not sys.stdin.isatty():
            raise RigError(f"{mount}: the muscle must be put up by hand; run it in a terminal, where it asks for that")
        where = "put the plate to its tip, on the right" if plate else "take the plate away"
        print(
            f"Turn the muscle so that its azimuth of {mount.azimuth_deg:g} deg points to the right of the picture, and"
        )
        input(f"{where}. Then press Enter. ")
        self._read = dict.fromkeys(self._read, time.monotonic())

    def _is_simulated(self) -> bool:
        return self._mounts.get_subscription_count() > 0

    def command(self, pressure_gauge_pa: Sequence[float]) -> None:
        """Ask for the pressures of finger 1; the other fingers stay vented."""
        wanted = np.zeros(CHANNEL_COUNT)
        wanted[:CHAMBERS_PER_FINGER] = pressure_gauge_pa
        self._setpoints.publish(joint_state(time_stamp(time.time()), CHANNEL_NAMES, effort=wanted))

    def read(self) -> Reading:
        """Return the next reading: a new picture, and what pressures and scale were when it was taken.

        A picture comes later than they do, by as long as it takes to expose, send and draw it.

        Raises:
            RigError: a part of the rig fell silent or says nonsense, a picture shows no muscle or is from another time,
                or the valve controller reports a fault.
        """
        begun_s = time.monotonic()
        while missing := [name for name, read_s in self._read.items() if self._heard[name][0] <= read_s]:
            self._operator.spin(0.002)
            if time.monotonic() - begun_s > SILENCE_S:
                raise RigError(f"nothing on {' and '.join(missing)} for {SILENCE_S:g} s; is it still connected?")
        self._check_air()
        self._read = {name: self._heard[name][0] for name in self._read}
        taken_s = seconds(self._heard["camera/image_raw"][1].header.stamp)
        measured: JointState = self._at("chamber_states", taken_s)
        force_n = float(self._at("scale/wrench", taken_s).wrench.force.z)
        if not math.isfinite(force_n):
            raise RigError(f"scale/wrench: force.z is {force_n}")
        return Reading(taken_s, self._pressures(measured), self._bend_rad(), force_n)

    def _hearing(self, name: str) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            self._heard[name] = (time.monotonic(), message)
            if name in self._past:
                self._past[name].append((seconds(message.header.stamp), message))

        return hear

    def _at(self, name: str, time_s: float) -> Any:
        """The message of that time."""
        stamp_s, message = min(self._past[name], key=lambda each: abs(each[0] - time_s))
        if abs(stamp_s - time_s) > APART_S:
            raise RigError(
                f"the picture is {time_s - stamp_s:+.1f} s from what {name} has nearest to it; do they have one clock?"
            )
        return message

    def _check_air(self) -> None:
        for name, (level, said, _) in self._operator.health.items():
            if name.endswith("/valve_controller") and level == DiagnosticStatus.ERROR:
                raise RigError(f"the valve controller reports: {said}")

    @staticmethod
    def _pressures(message: JointState) -> tuple[float, ...]:
        try:
            values = named_values(message, CHANNEL_NAMES, "effort")
        except MessageError as error:
            raise RigError(f"chamber_states: {error}") from error
        found = values[:CHAMBERS_PER_FINGER]
        if not np.isfinite(found).all():
            silent = ", ".join(CHANNEL_NAMES[k] for k in np.flatnonzero(~np.isfinite(found)))
            raise RigError(f"chamber_states: no valid reading of {silent}")
        return tuple(found.tolist())

    def _bend_rad(self) -> float:
        image: Image = self._heard["camera/image_raw"][1]
        info: CameraInfo = self._heard["camera/camera_info"][1]
        geometry = self._gripper.geometry
        rod = self._gripper.rod_geometry
        round_mm = self._tip_round_mm
        round_m = (geometry.outer_radius_m if self._is_simulated() else 0.0) if round_mm is None else 1e-3 * round_mm
        end_m = rod.end_length_m if self._is_simulated() else geometry.end_length_m
        try:
            data = CameraData(info.width, info.height, info.distortion_model, info.d, info.k)
            intrinsics, lens = data.pinhole(rectified=False)
            pixels = image_pixels(image)
            if np.any(lens):
                pixels = np.asarray(cv2.undistort(pixels, intrinsics.matrix, lens), dtype=np.uint8)
            if self._marker_rgb is not None:
                return bend_between_markers(pixels, Camera(intrinsics, self._pose), self._marker_rgb).bend_rad
            size = MuscleSize(geometry.outer_radius_m, end_m, geometry.length_m, round_m)
            return bend_in_picture(pixels, Camera(intrinsics, self._pose), size).bend_rad
        except (CameraError, MarkerError, MessageError, SilhouetteError) as error:
            raise RigError(f"camera/image_raw: {error}") from error
