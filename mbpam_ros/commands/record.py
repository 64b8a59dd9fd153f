"""Record all topics of a gripper as MCAP, which ros2 bag, Foxglove and rosbags read.

    mbpam record grasp.mcap                                   until Ctrl-C
    mbpam record grasp.mcap --namespace right                 of a gripper in a namespace
    mbpam record grasp.mcap --leave-out camera/image_raw      without the raw images, which are most of it

Nothing is recorded twice and nobody is waited for: topics are joined as they appear, latched ones with their last
message. What is older than a second outlives a kill -9. A file of --split-mb is finished and FILE_1.mcap begun. At the
end the messages of each topic are counted: those written, and those lost on the way.
"""

from __future__ import annotations

import argparse
import signal
import time
from pathlib import Path

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from mbpam_ros.commands.recorder import Recorder
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.nodes.message_definitions import definition
from mbpam_ros.study.recordings import RecordingWriter
from mbpam_ros.terminal import Progress, table

SPIN_S = 0.1
SHOW_PERIOD_S = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("file", type=result_file, metavar="FILE.mcap", help="where the recording goes")
    parser.add_argument("--namespace", default="", help="of the gripper (default: none)")
    parser.add_argument("--leave-out", nargs="+", default=[], metavar="TOPIC", help="topics that are not recorded")
    parser.add_argument(
        "--split-mb", type=_positive, default=1000.0, metavar="MB", help="size of a file (default 1000)"
    )
    parser.add_argument("--duration", type=_positive, metavar="S", help="end by itself (default: at Ctrl-C)")


def run(options: argparse.Namespace) -> int:
    """Record until a signal or the end of the time, and print the counts; return 1 if messages were lost."""
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    writer = RecordingWriter(options.file, definition, round(1e6 * options.split_mb))
    context, progress = Context(), Progress()
    rclpy.init(context=context)
    node = Node("recorder", context=context, namespace=options.namespace, use_global_arguments=False)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    recorder = Recorder(node, writer, options.leave_out)
    began_s = shown_s = time.monotonic()
    try:
        while not stopped and (options.duration is None or time.monotonic() - began_s < options.duration):
            executor.spin_once(timeout_sec=SPIN_S)
            if time.monotonic() - shown_s > SHOW_PERIOD_S:
                shown_s = time.monotonic()
                progress.show(f"{shown_s - began_s:.0f} s, {recorder.counts.total()} messages; Ctrl-C ends it")
    finally:
        writer.close()
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
    progress.say(_counts_text(recorder, writer.paths))
    return 1 if recorder.lost else 0


def _counts_text(recorder: Recorder, paths: list[Path]) -> str:
    topics = sorted(recorder.counts.keys() | recorder.lost.keys())
    rows = [(topic, str(recorder.counts[topic]), str(recorder.lost[topic])) for topic in topics]
    rows.append(("all", str(recorder.counts.total()), str(recorder.lost.total())))
    return f"{table(('topic', 'written', 'lost'), rows)}\n{', '.join(map(str, paths))}"


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError("must be greater than 0")
    return value
