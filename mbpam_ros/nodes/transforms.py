"""Where the gripper's frames are, on ``/tf`` and ``/tf_static``: where tf2_msgs is installed, which no wheel holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from mbpam_ros.nodes.parameters import Parameter

FRAME_PREFIX = Parameter("frame_prefix", "", "before every frame of this gripper, such as right/; world has none")

MOVING = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STILL = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""As tf2's own broadcasters have them."""


@dataclass(frozen=True)
class Placed:
    """A frame in its parent.

    Args:
        parent, child: names.
        position_m: (3,).
        orientation_xyzw: unit quaternion (4,), takes vectors of the child to the parent.
    """

    parent: str
    child: str
    position_m: NDArray
    orientation_xyzw: NDArray | tuple[float, float, float, float]


class TransformBroadcaster:
    """Publishes frames; without tf2_msgs it does nothing, and ``active`` is false."""

    def __init__(self, node: Node) -> None:
        self._message_type = message_type = tf_message_type()
        self.active = message_type is not None
        if message_type is not None:
            self._moving: Publisher = node.create_publisher(message_type, "/tf", MOVING)
            self._still: Publisher = node.create_publisher(message_type, "/tf_static", STILL)

    def send(self, stamp: Time, frames: Iterable[Placed]) -> None:
        """Publish where moving frames are now."""
        if self.active:
            self._moving.publish(self._message(stamp, frames))

    def send_once(self, stamp: Time, frames: Iterable[Placed]) -> None:
        """Publish all frames of this node that never move; late listeners get them too."""
        if self.active:
            self._still.publish(self._message(stamp, frames))

    def _message(self, stamp: Time, frames: Iterable[Placed]) -> object:
        assert self._message_type is not None
        return self._message_type(transforms=[_transform(stamp, each) for each in frames])


def tf_message_type() -> type | None:
    """Return ``tf2_msgs/msg/TFMessage``, or None where it is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return None
    found: type = TFMessage
    return found


def _transform(stamp: Time, placed: Placed) -> TransformStamped:
    message = TransformStamped(child_frame_id=placed.child)
    message.header.stamp, message.header.frame_id = stamp, placed.parent
    for field, values in (("xyz", placed.position_m), ("xyzw", placed.orientation_xyzw)):
        part = message.transform.translation if field == "xyz" else message.transform.rotation
        for name, value in zip(field, values, strict=True):
            setattr(part, name, float(value))
    return message
