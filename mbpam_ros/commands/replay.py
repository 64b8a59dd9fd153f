"""Let nodes live through a recording again: what they would say of it now, to the bit the same in every run.

    mbpam replay grasp.mcap --into state_estimator --out again.mcap
    mbpam replay grasp.mcap --into state_estimator,object_detector --out again.mcap --params-file mine.yaml

The nodes run here, in simulated time and as fast as they can; no wire is between them and the recording, so nothing is
lost or late. They hear what the recording has of their inputs, but what one of them publishes itself they hear from it.
What they say goes to --out, stamped with the simulated time. Nodes that follow services (valve_controller,
grasp_arbiter, plant) are left out: what operators ask for is on no topic.
"""

from __future__ import annotations

import argparse
import importlib
from collections import Counter
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context

from mbpam_ros.commands.node_replay import ReplayedNode
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.nodes.message_definitions import definition
from mbpam_ros.nodes.runtime import GripperNode
from mbpam_ros.study.recordings import Recorded, RecordingWriter, read_recording
from mbpam_ros.terminal import table

REPLAYED = {
    "pressure_sensor": "PressureSensorNode",
    "state_estimator": "StateEstimatorNode",
    "object_detector": "ObjectDetectorNode",
}
"""Nodes that take all their inputs from topics, in the order of the data flow, and their classes."""

QOS = "- history: keep_last\n  depth: 5\n  reliability: reliable\n  durability: volatile\n"
WHOLE_BYTES = 2**62


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("file", type=Path, metavar="FILE.mcap", help="the recording")
    known = ",".join(REPLAYED)
    parser.add_argument("--into", type=_nodes, required=True, metavar="NODES", help=f"some of {known}")
    parser.add_argument("--out", type=result_file, required=True, metavar="OUT.mcap", help="where goes what they say")
    parser.add_argument("--namespace", default="", help="of the gripper that was recorded (default: none)")
    parser.add_argument("--params-file", metavar="YAML", help="parameters of the nodes")


def run(options: argparse.Namespace) -> int:
    """Replay, and print how many messages each topic had before and has now; return 1 if the nodes heard nothing."""
    recording = read_recording(options.file)
    writer = RecordingWriter(options.out, definition, WHOLE_BYTES)
    arguments = [] if options.params_file is None else ["--params-file", options.params_file]
    with domain_id() as domain, closing(writer):
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        try:
            replay = Replay(writer, context, options.into, options.namespace, arguments)
            with closing(replay):
                replay.run(recording)
        finally:
            context.try_shutdown()
    said, before = writer.counts, replay.before
    rows = [(topic, str(before[topic]), str(said[topic])) for topic in sorted(said)]
    print(table(("topic", "recorded", "replayed"), rows))
    heard = ", ".join(f"{count} of {topic}" for topic, count in sorted(replay.heard.items()))
    print(f"heard: {heard or 'nothing; is this a recording of another namespace?'}")
    return 0 if replay.heard else 1


class Replay:
    """Some nodes, what they hear of a recording and of each other, and where goes what they say."""

    def __init__(
        self, writer: RecordingWriter, context: Context, names: Iterable[str], namespace: str, ros_arguments: list[str]
    ) -> None:
        self.heard: Counter[str] = Counter()
        self.before: Counter[str] = Counter()
        self._writer = writer
        self._nodes: list[ReplayedNode] = []
        for name in names:
            factory = _class_of(name)
            self._nodes.append(ReplayedNode(factory, context, namespace, ros_arguments, self._say))
        self._own = frozenset(topic for node in self._nodes for topic in node.said)

    def run(self, recording: Iterable[Recorded]) -> None:
        """Hand every message to the nodes that listen to it."""
        for message in recording:
            self.before[message.topic] += 1
            if message.topic in self._own or message.topic.endswith("/alive") or message.topic == "/clock":
                continue
            self._hand_on(message)

    def close(self) -> None:
        """Let the nodes go."""
        for node in self._nodes:
            node.close()

    def _say(self, message: Recorded) -> None:
        self._writer.write(message, QOS)
        self._hand_on(message)

    def _hand_on(self, message: Recorded) -> None:
        for node in self._nodes:
            if message.topic in node.topics:
                self.heard[message.topic] += 1
                node.hear(message)


def _class_of(name: str) -> type[GripperNode]:
    found: type[GripperNode] = getattr(importlib.import_module(f"mbpam_ros.nodes.{name}"), REPLAYED[name])
    return found


def _nodes(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in REPLAYED]:
        raise argparse.ArgumentTypeError(f"cannot replay {', '.join(unknown)}; can: {', '.join(REPLAYED)}")
    return [name for name in REPLAYED if name in names]
