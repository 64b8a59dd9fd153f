"""What the topics of a gripper tell of a grasp, for whoever tells it on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Protocol

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM  # isort: skip
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CompressedImage, JointState
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.study.grasp_report import GraspRecord


class Listener(Protocol):
    """What is asked of a node: that it calls back with the messages of a topic."""

    def create_subscription(
        self, message_type: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile, /
    ) -> object:
        """Call ``callback`` with each message of ``topic``."""


class Watcher:
    """Listens to a gripper, running or recorded, and keeps the record of one grasp.

    Args:
        node: whose subscriptions call what is heard.
        clock: the time [s] that goes with it.
    """

    def __init__(self, node: Listener, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.record = GraspRecord()
        self.grasp: dict[str, str] = {}
        self.detection: Marker | None = None
        self.object_z_m = math.nan
        self.palm_z_m = math.nan
        self._least_real_time_factor = math.inf
        self._lines: dict[int, list[list[float]]] = {}
        self._object_start_z_m = math.nan
        self._palm_start_z_m = math.nan
        self._centre_m = np.full(3, math.nan)
        self._start_s = clock()
        subscribe = node.create_subscription
        subscribe(DiagnosticStatus, "grasp_state", self._on_grasp_state, LATCHED)
        subscribe(DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM)
        subscribe(MarkerArray, "detections", self._on_detections, STREAM)
        subscribe(CompressedImage, "detections/image", self._on_overlay, STREAM)
        subscribe(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        subscribe(JointState, "joint_states", self._on_joint_states, NEWEST)
        subscribe(MarkerArray, "plant/finger_markers", self._on_truth, STREAM)

    @property
    def elapsed_s(self) -> float:
        """Time since the record began [s]."""
        return self._clock() - self._start_s

    @property
    def rise_m(self) -> float:
        """True rise of the object since :meth:`set_start` [m]."""
        return self.object_z_m - self._object_start_z_m

    @property
    def palm_rise_m(self) -> float:
        """True rise of the palm since :meth:`set_start` [m]."""
        return self.palm_z_m - self._palm_start_z_m

    @property
    def greatest_pressure_pa(self) -> float:
        """Greatest measured pressure now [Pa gauge]; 0 before the first valid reading."""
        latest = self.record.pressure_gauge_pa[-1] if self.record.pressure_gauge_pa else np.zeros(1)
        return float(np.max(latest, initial=0.0, where=np.isfinite(latest)))

    @property
    def pace(self) -> str:
        """How slowly the plant has run in the grasp, in words; a machine too busy for real time causes faults."""
        if math.isinf(self._least_real_time_factor):
            return "the plant has not told its pace"
        return f"the plant at {self._least_real_time_factor:.2f} of real time or more"

    @property
    def unheard(self) -> list[str]:
        """What the record still lacks before a grasp: topics that have not spoken, an object not detected."""
        heard = {
            "grasp_state": bool(self.grasp),
            "an object in detections": self.detection is not None,
            "detections/image": bool(self.record.overlay_jpeg),
            "chamber_states": bool(self.record.pressure_time_s),
            "joint_states": bool(self.record.bend_time_s),
            "the object in plant/finger_markers": math.isfinite(self.object_z_m),
        }
        return [name for name, spoken in heard.items() if not spoken]

    def set_start(self) -> None:
        """Take the present heights of object and palm as zero of their rise."""
        self._object_start_z_m, self._palm_start_z_m = self.object_z_m, self.palm_z_m

    def event(self, name: str) -> None:
        """Note that something happened now."""
        self.record.events[name] = self.elapsed_s

    def snapshot(self, name: str) -> None:
        """Keep the true shapes as they are now."""
        lines = np.array([self._lines[finger] for finger in sorted(self._lines)])
        self.record.shapes[name] = lines, self._centre_m.copy()

    def _on_grasp_state(self, state: DiagnosticStatus) -> None:
        self.grasp = {item.key: item.value for item in state.values}

    def _on_diagnostics(self, report: DiagnosticArray) -> None:
        """Keep the least pace of the plant from the first report in a grasp on."""
        if self.grasp.get("phase") not in ("closing", "holding"):
            return
        for status in report.status:
            for item in status.values:
                if item.key == "real_time_factor":
                    self._least_real_time_factor = min(self._least_real_time_factor, float(item.value))

    def _on_detections(self, message: MarkerArray) -> None:
        found = [marker for marker in message.markers if marker.action == Marker.ADD]
        if self.grasp.get("phase") == "idle" and found:
            self.detection = max(found, key=lambda marker: marker.color.a)

    def _on_overlay(self, message: CompressedImage) -> None:
        if self.grasp.get("phase") == "idle" and self.detection is not None and not self.record.overlay_jpeg:
            self.record.overlay_jpeg = bytes(message.data)

    def _on_chamber_states(self, message: JointState) -> None:
        self.record.pressure_time_s.append(self.elapsed_s)
        self.record.pressure_gauge_pa.append(np.array(message.effort))

    def _on_joint_states(self, message: JointState) -> None:
        self.record.bend_time_s.append(self.elapsed_s)
        self.record.bend_rad.append(np.array(message.position))

    def _on_truth(self, message: MarkerArray) -> None:
        for marker in message.markers:
            if marker.ns == "finger":
                self._lines[marker.id] = [[p.x, p.y, p.z] for p in marker.points]
            elif marker.ns == "palm":
                self.palm_z_m = marker.pose.position.z
            elif marker.ns == "object":
                position = marker.pose.position
                self.object_z_m = position.z
                self._centre_m = np.array([position.x, position.y, position.z])
        if math.isfinite(self.rise_m):
            self.record.object_time_s.append(self.elapsed_s)
            self.record.object_rise_m.append(self.rise_m)
            self.record.palm_rise_m.append(self.palm_rise_m)
