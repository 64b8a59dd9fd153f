"""Detections as ``vision_msgs/Detection3DArray`` beside the markers: where vision_msgs is installed.

No wheel holds it. For nodes of others; ours hear the markers, which also say how far a length seen in part may reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Vector3
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from mbpam_ros.nodes.messages import pose
from mbpam_ros.nodes.runtime import STREAM
from mbpam_ros.vision.detector import Detection

TOPIC = "detections/vision"


class DetectionBroadcaster:
    """Publishes detections on :data:`TOPIC`; without vision_msgs it does nothing, and ``active`` is false."""

    def __init__(self, node: Node) -> None:
        self._types = vision_messages()
        self.active = self._types is not None
        if self._types is not None:
            self._detections: Publisher = node.create_publisher(self._types.Detection3DArray, TOPIC, STREAM)

    def send(self, header: Header, found: Sequence[Detection]) -> None:
        """Publish what was found, each with a box around it, one hypothesis and its confidence."""
        if self.active:
            self._detections.publish(self._message(header, found))

    def _message(self, header: Header, found: Sequence[Detection]) -> Any:
        assert self._types is not None
        array = self._types.Detection3DArray()
        array.header = header
        array.detections = [self._detection(header, each) for each in found]
        return array

    def _detection(self, header: Header, found: Detection) -> Any:
        assert self._types is not None
        message, result = self._types.Detection3D(), self._types.ObjectHypothesisWithPose()
        where = pose(found.position_m, found.orientation_xyzw)
        x, y, z = (float(length) for length in found.size_m)
        message.header = header
        message.bbox.center, message.bbox.size = where, Vector3(x=x, y=y, z=z)
        result.hypothesis.class_id, result.hypothesis.score = found.label, float(found.confidence)
        result.pose.pose = where
        message.results = [result]
        return message


def vision_messages() -> Any:
    """Return the module ``vision_msgs.msg``, or None where it is not installed."""
    try:
        from vision_msgs import msg
    except ImportError:
        return None
    return msg
