"""A node that lives on a recording: its callbacks are called one after another, in simulated time, without any wire.

The node's own subscriptions and timers are called as an executor would call them, in the order of the recording, so
that what it says repeats to the bit whatever the computer does meanwhile. Timers of the wall clock, as those of signs
of life, do not run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
from rclpy.clock import ClockType, ROSClock
from rclpy.context import Context
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from mbpam_ros.nodes.message_definitions import message_class
from mbpam_ros.nodes.runtime import GripperNode
from mbpam_ros.study.recordings import Recorded

STEP_NS = 5_000_000
"""Simulated time goes on by no more at once: timers are called late by at most this."""

Sink = Callable[[Recorded], None]


class ReplayedNode:
    """One node on simulated time that hears nothing but what it is handed.

    Args:
        factory: class of the node.
        context: that it lives in; nothing else does.
        namespace: of the gripper that was recorded.
        ros_arguments: parameters for it, as after ``--ros-args``.
        sink: takes what it publishes, stamped with the simulated time.
    """

    def __init__(
        self,
        factory: Callable[..., GripperNode],
        context: Context,
        namespace: str,
        ros_arguments: Sequence[str],
        sink: Sink,
    ) -> None:
        arguments = ["--ros-args", *ros_arguments, "-p", "use_sim_time:=true"]
        self._sink, self._now_ns = sink, 0
        self._node = factory(context=context, namespace=namespace, use_global_arguments=False, cli_args=arguments)
        for publisher in self._node.publishers:
            self._tap(publisher)
        self._heard: dict[str, Callable[[Any], None]] = {
            each.topic_name: cast(Callable[[Any], None], each.callback) for each in self._node.subscriptions
        }

    @property
    def said(self) -> frozenset[str]:
        """Full names of what it publishes of its own, not with all nodes."""
        return frozenset(each.topic_name for each in self._node.publishers) - {"/diagnostics", "/parameter_events"}

    @property
    def topics(self) -> frozenset[str]:
        """Full names of what it listens to."""
        return frozenset(self._heard)

    def advance(self, now_ns: int) -> None:
        """Let simulated time go on to ``now_ns``, and the timers with it."""
        clock = self._node.get_clock()
        assert isinstance(clock, ROSClock)
        if self._now_ns == 0:
            self._now_ns = now_ns - STEP_NS
        while self._now_ns < now_ns:
            self._now_ns = min(self._now_ns + STEP_NS, now_ns)
            clock.set_ros_time_override(Time(nanoseconds=self._now_ns, clock_type=ClockType.ROS_TIME))
            for timer in list(self._node.timers):
                if timer.clock.clock_type is ClockType.ROS_TIME and timer.is_ready():
                    timer.reset()
                    cast(Callable[[], None], timer.callback)()

    def hear(self, message: Recorded) -> None:
        """Hand it a message that it listens to, at its time."""
        self.advance(message.received_ns)
        self._heard[message.topic](deserialize_message(message.data, message_class(message.type_name)))

    def _tap(self, publisher: Publisher) -> None:
        """Have a publisher of the node give what it publishes to the sink, as if somebody listened."""
        package, kind = publisher.msg_type.__module__.split(".")[:2]
        type_name = f"{package}/{kind}/{publisher.msg_type.__name__}"

        def publish(message: object) -> None:
            self._sink(Recorded(publisher.topic_name, type_name, self._now_ns, serialize_message(message)))

        # The node holds the publishers themselves, so their own methods give way.
        vars(publisher).update(publish=publish, get_subscription_count=lambda: 1)

    def close(self) -> None:
        """Let it go."""
        self._node.destroy_node()
