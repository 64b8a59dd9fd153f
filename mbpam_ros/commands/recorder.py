"""Listens to all topics of a gripper and writes them as they come."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Sequence
from functools import partial
from typing import Any

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mbpam_ros.nodes.interface import TOPICS
from mbpam_ros.nodes.message_definitions import DefinitionError, message_class
from mbpam_ros.study.recordings import Recorded, RecordingWriter

SHARED = ("/diagnostics", "/clock", "/rosout", "/tf", "/tf_static")
"""Of all grippers, whatever their namespace."""

LOOK_PERIOD_S = 0.2
"""How often new topics are looked for."""

FLUSH_PERIOD_S = 0.5
"""What is older than this outlives a kill -9; a second of promise, half of it for a busy machine."""

DEPTH = 1000
"""Messages that wait while the disk is slow."""


class Recorder:
    """Subscribes to each topic of a gripper as soon as somebody publishes it, and writes what comes.

    Args:
        node: in whose namespace the gripper is; the caller spins it.
        writer: takes the messages.
        left_out: topics, relative to the namespace, that are not recorded.
    """

    def __init__(self, node: Node, writer: RecordingWriter, left_out: Collection[str] = ()) -> None:
        self._node, self._writer = node, writer
        names = [name for topic in TOPICS for name in topic.names if name not in left_out]
        self._wanted = {node.resolve_topic_name(name) for name in (*names, *SHARED)} - set(left_out)
        self._qos: dict[str, str] = {}
        self.lost: Counter[str] = Counter()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(LOOK_PERIOD_S, self._look, clock=steady)
        node.create_timer(FLUSH_PERIOD_S, writer.flush, clock=steady)

    @property
    def counts(self) -> Counter[str]:
        """Messages written, by topic."""
        return self._writer.counts

    def _look(self) -> None:
        for topic in sorted(self._wanted):
            ends = self._node.get_publishers_info_by_topic(topic)
            if ends:
                self._wanted.discard(topic)
                self._subscribe(topic, ends)

    def _subscribe(self, topic: str, ends: Sequence[TopicEndpointInfo]) -> None:
        """Ask for no more than every publisher offers; one that offers less and comes later is not heard."""
        type_name = ends[0].topic_type
        try:
            message_type = message_class(type_name)
        except DefinitionError as error:
            self._node.get_logger().warning(f"{topic} is not recorded: {error}")
            return
        reliable = all(end.qos_profile.reliability is ReliabilityPolicy.RELIABLE for end in ends)
        latched = all(end.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for end in ends)
        qos = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        self._qos[topic] = "".join(_qos_yaml(end.qos_profile) for end in ends)
        events = SubscriptionEventCallbacks(message_lost=partial(self._count_lost, topic))
        write = partial(self._write, topic, type_name)
        # Without the message's info, which has the time it was sent: this executor cannot call one that takes it.
        self._node.create_subscription(message_type, topic, write, qos, event_callbacks=events, raw=True)

    def _write(self, topic: str, type_name: str, data: bytes) -> None:
        self._writer.write(Recorded(topic, type_name, time.time_ns(), data), self._qos[topic])

    def _count_lost(self, topic: str, status: Any) -> None:
        self.lost[topic] += status.total_count_change


def _qos_yaml(offered: QoSProfile) -> str:
    """Return an offered QoS as rosbag2 writes it, an item of a list."""
    lines = [
        "history: keep_last",  # discovery tells neither history nor depth
        f"depth: {max(offered.depth, 1)}",
        f"reliability: {offered.reliability.name.lower()}",
        f"durability: {offered.durability.name.lower()}",
    ]
    for name, duration in (("deadline", offered.deadline), ("lifespan", offered.lifespan)):
        lines += _duration_yaml(name, duration.nanoseconds)
    lines += [f"liveliness: {offered.liveliness.name.lower()}"]
    lines += _duration_yaml("liveliness_lease_duration", offered.liveliness_lease_duration.nanoseconds)
    lines += ["avoid_ros_namespace_conventions: false"]
    return "- " + "\n  ".join(lines) + "\n"


def _duration_yaml(name: str, nanoseconds: int) -> list[str]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return [f"{name}:", f"  sec: {seconds}", f"  nsec: {rest}"]
