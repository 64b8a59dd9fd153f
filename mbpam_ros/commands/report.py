"""The picture report of a grasp, as mbpam demo draws it, from a recording.

    mbpam report grasp.mcap                          grasp.png: the last grasp of the recording
    mbpam report grasp.mcap --picture lost.pdf       another file or format

Drawn are the fingers and the object before the fingers close and at the end of holding, the detection, pressures and
bends, and how hand and object rose. What is true (shapes, heights) only a simulated gripper tells; of a real one the
picture has what it measures and estimates.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.watcher import Watcher
from mbpam_ros.grasp.phases import Phase
from mbpam_ros.nodes.markers import SHAPES
from mbpam_ros.nodes.message_definitions import message_class
from mbpam_ros.nodes.runtime import LATCHED
from mbpam_ros.study.grasp_report import GraspRecord, draw_report
from mbpam_ros.study.recordings import Recorded, RecordingError, read_recording

CLOSING, HOLDING, IDLE = Phase.CLOSING.value, Phase.HOLDING.value, Phase.IDLE.value

LEAD_NS = 5_000_000_000
"""The camera saw the object before the fingers closed."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("file", type=Path, metavar="FILE.mcap", help="the recording")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where it goes (default: FILE.png)")
    parser.add_argument("--namespace", default="", help="of the gripper (default: none)")


def run(options: argparse.Namespace) -> int:
    """Read, draw, and say where the picture is."""
    span_ns = last_grasp_ns(read_recording(options.file), options.namespace)
    if span_ns is None:
        raise RecordingError(f"{options.file}: no grasp in it: grasp_state never said {CLOSING}")
    record = grasp_record(_within(read_recording(options.file), *span_ns), options.namespace)
    picture = options.picture or options.file.with_suffix(".png")
    draw_report(record, picture)
    print(picture)
    return 0


class _Player:
    """Stands for a node: calls what is subscribed with the messages of a recording."""

    def __init__(self, namespace: str) -> None:
        self._prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self._callbacks: defaultdict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self.now_s = 0.0

    def create_subscription(self, _: type, topic: str, callback: Callable[[Any], None], __: QoSProfile, /) -> None:
        self._callbacks[topic if topic.startswith("/") else f"{self._prefix}/{topic}"].append(callback)

    def play(self, message: Recorded) -> None:
        self.now_s = 1e-9 * message.received_ns
        callbacks = self._callbacks.get(message.topic)
        if callbacks:
            told: Any = deserialize_message(message.data, message_class(message.type_name))
            for callback in callbacks:
                callback(told)


def last_grasp_ns(messages: Iterable[Recorded], namespace: str = "") -> tuple[int, int] | None:
    """Return the span of a gripper's last grasp, with what came shortly before; None if there is none."""
    player, now_ns = _Player(namespace), 0
    phases = [(now_ns, "")]
    note = lambda state: phases.append((now_ns, _phase(state)))  # noqa: E731
    player.create_subscription(DiagnosticStatus, "grasp_state", note, LATCHED)
    for message in messages:
        now_ns = message.received_ns
        player.play(message)
    began = [time_ns for (_, before), (time_ns, phase) in pairwise(phases) if phase == CLOSING != before]
    if not began:
        return None
    ended = [time_ns for time_ns, phase in phases if phase == IDLE and time_ns > began[-1]]
    return began[-1] - LEAD_NS, (ended or [now_ns])[0]


def _within(messages: Iterable[Recorded], begin_ns: int, end_ns: int) -> Iterator[Recorded]:
    """Yield the messages of a span, before them the last of each topic that was said earlier and still held."""
    latched: dict[str, Recorded] = {}
    for message in messages:
        if message.received_ns < begin_ns:
            if message.topic.endswith("grasp_state"):
                latched[message.topic] = replace(message, received_ns=begin_ns)
        elif message.received_ns <= end_ns:
            yield from latched.values()
            latched.clear()
            yield message


def grasp_record(messages: Iterable[Recorded], namespace: str = "") -> GraspRecord:
    """Return the record of the one grasp among the messages of a gripper."""
    player, phase, mode = _Player(namespace), "", ""
    messages = iter(messages)
    first = next(messages)
    player.now_s = 1e-9 * first.received_ns
    watcher = Watcher(player, lambda: player.now_s)
    for message in (first, *messages):
        player.play(message)
        before, phase = phase, watcher.grasp.get("phase", "")
        if phase == before:
            continue
        if phase == CLOSING:
            mode = watcher.grasp.get("mode", "")
            watcher.set_start()
            watcher.snapshot("start")
        if before:
            watcher.event(phase)
        if before == HOLDING:
            watcher.snapshot("held")
    if phase == HOLDING:
        watcher.snapshot("held")
    record, found = watcher.record, watcher.detection
    fault = f"fault: {watcher.grasp['reason']}" if phase == Phase.FAULT.value else ""
    record.title = ", ".join(filter(None, (found and found.text, mode, fault)))
    if found is not None:
        record.object_size_m = (found.scale.x, found.scale.y, found.scale.z)
        record.object_shape = SHAPES[found.type]
    return record


def _phase(state: DiagnosticStatus) -> str:
    return next((item.value for item in state.values if item.key == "phase"), "")
