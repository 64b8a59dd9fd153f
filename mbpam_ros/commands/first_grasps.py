"""How long the valves are left alone in the first grasp after a start.

Starts ``bringup`` without its camera over and over, grasps once each time, and prints the longest pause between two
valve commands from the call of the service to the held object. "--busy N" keeps N other processes at full load beside
it. Figures are measured, never asserted: the exit code is 0 whatever they are.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mbpam_ros.commands.system import NodeProcesses, Operator, exit_on_stop_signals  # isort: skip
import numpy as np
from domain_coordinator import domain_id
from sensor_msgs.msg import JointState

from mbpam_ros.commands.bench import machine
from mbpam_ros.commands.result_arguments import result_folder
from mbpam_ros.nodes.runtime import NEWEST

START_S = 180.0
WAIT_S = 20.0
WITHOUT_CAMERA = {"bringup": ["-p", "plant:camera_rate_hz:=0.0"]}


@dataclass(frozen=True)
class FirstGrasp:
    """One grasp, the first of a process.

    Args:
        longest_pause_s: between two valve commands as they arrived, from the call on.
        outcome: ``held``, or the reason of the fault.
    """

    longest_pause_s: float
    outcome: str


def first_grasp(logs: Path) -> FirstGrasp:
    """Start a gripper, close it once, and stop it.

    Raises:
        NodeSystemError: a process ended, or a node did not answer.
    """
    with domain_id() as domain, _operated_bringup(logs, domain) as operator:
        commanded_s: list[float] = []
        operator.node.create_subscription(
            JointState, "valve_commands", lambda _: commanded_s.append(time.monotonic()), NEWEST
        )
        operator.wait_for_nodes(timeout_s=START_S)
        operator.enable(WAIT_S)
        operator.wait_for(lambda: len(commanded_s) > 100, WAIT_S, "a hundred valve commands")
        before = len(commanded_s) - 1
        fault = operator.close_fingers(timeout_s=WAIT_S)
        return FirstGrasp(float(np.diff(commanded_s[before:]).max()), fault or "held")


@contextmanager
def _operated_bringup(logs: Path, domain: int) -> Iterator[Operator]:
    environment = {"ROS_DOMAIN_ID": str(domain)}
    with NodeProcesses(logs, WITHOUT_CAMERA, executables=["bringup"], environment=environment) as processes:
        operator = Operator("first_grasps", idle=processes.check, domain_id=domain)
        try:
            yield operator
        finally:
            operator.close()


@contextmanager
def _busy_processes(count: int) -> Iterator[None]:
    processes = [multiprocessing.Process(target=_work, daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()


def _work() -> None:
    while True:
        pass


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--starts", type=int, default=20, help="grasps, each after a start (default 20)")
    parser.add_argument("--busy", type=int, default=0, help="processes at full load beside it (default 0)")
    parser.add_argument("--logs", type=result_folder, default=Path("report/first_grasps"), help="output of the nodes")


def run(options: argparse.Namespace) -> int:
    """Measure, print a line for each grasp and the distribution, and return the exit status."""
    if options.starts < 1 or options.busy < 0:
        print("mbpam first-grasps: --starts must be greater than 0, --busy not less", file=sys.stderr)
        return 2
    exit_on_stop_signals()
    print("  ".join(f"{key}: {value}" for key, value in machine().items()), f" busy: {options.busy}")
    print(f"{options.starts} starts take about {6 * options.starts} s")
    grasps = []
    with _busy_processes(options.busy):
        for number in range(1, options.starts + 1):
            grasps.append(first_grasp(options.logs))
            print(f"{number}: {1e3 * grasps[-1].longest_pause_s:.0f} ms, {grasps[-1].outcome}", flush=True)
    pauses_ms = [1e3 * grasp.longest_pause_s for grasp in grasps]
    median, upper, worst = np.quantile(pauses_ms, (0.5, 0.9, 1.0))
    held = sum(grasp.outcome == "held" for grasp in grasps)
    print(f"longest pause: median {median:.0f}, 90 % {upper:.0f}, worst {worst:.0f} ms; {held} of {len(grasps)} held")
    return 0
