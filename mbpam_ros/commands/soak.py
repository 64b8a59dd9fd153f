"""The gripper under random use for a long time: first in simulated time at full speed, then as six nodes in real time.

    mbpam soak --minutes M              half of M minutes each way
    mbpam soak --minutes M --json FILE  what came of it, as a file too
    mbpam soak --minutes M --simulated-hours H
                                        H simulated hours, however long they take, then M minutes of real time

Grasps in random modes, stops and releases at random moments; among the nodes also one that is killed and started again,
or frozen for some seconds, while a grasp closes or holds. After each the same way back is gone: release, reset, air on.
What must not be is listed: a fault of nobody's making, a pressure more than 2 % above the limit for longer than 20 ms,
no way back to idle. Then memory, threads and open files of each process from the first minute to the last, and how many
valve commands came later than a driver waits for them while every node ran; what a node's end, freeze or new beginning
held up is told apart, by what befell which node. Exit code 1 if anything is listed.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
import random
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mbpam_ros.commands.system import NodeProcesses, NodeSystemError, Operator, exit_on_stop_signals  # isort: skip
import numpy as np
import psutil
from domain_coordinator import domain_id
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mbpam_ros.commands.bench import machine
from mbpam_ros.commands.result_arguments import result_file, result_folder
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.runtime import NEWEST
from mbpam_ros.study.result_file import write_json
from mbpam_ros.study.soak import OVER_LIMIT_S, SoakResult, soak
from mbpam_ros.terminal import Progress, table

START_S = 180.0
WAIT_S = 20.0
ANSWER_S = 5.0
VENTED_PA = 5e3
LATE_COMMAND_S = 0.03
"""A driver closes its valve when no command came for so long."""

KILLED, FROZEN = "killed", "frozen"
BEFALL = ("grasp_arbiter", "valve_controller", "pressure_sensor", "state_estimator", "object_detector")
"""Nodes that are killed or frozen; the plant is the machine, and stays."""

ENDS_A_GRASP = ("grasp_arbiter", "valve_controller", "pressure_sensor")


@dataclass
class NodeSoakResult:
    """What came of the six nodes in real time.

    Args:
        wall_s: how long it lasted.
        grasps, held: asked for, and held before they were ended.
        befallen: how often what was done to which node.
        pressure_max_kpa: highest measured pressure.
        commands, late_commands: valve commands, and how many came later than a driver waits, while every node ran.
        longest_gap_ms: the longest of these gaps.
        befallen_gap_ms: the longest gap from when a node was killed or frozen until all is on again, by what befell it.
        usage: by node: memory [MB], threads and open files, each at the first and the last look.
        wrong: what must not be, in words.
    """

    wall_s: float = 0.0
    grasps: int = 0
    held: int = 0
    befallen: dict[str, int] = field(default_factory=dict)
    pressure_max_kpa: float = 0.0
    commands: int = 0
    late_commands: int = 0
    longest_gap_ms: float = 0.0
    befallen_gap_ms: dict[str, float] = field(default_factory=dict)
    usage: dict[str, dict[str, tuple[float, float]]] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)


class NodeSoak:
    """Six node processes and an operator who does things at random.

    Args:
        processes: the nodes.
        operator: who calls their services.
        seed: of everything drawn.
    """

    def __init__(self, processes: NodeProcesses, operator: Operator, seed: int) -> None:
        self._processes, self._operator = processes, operator
        self._random = random.Random(seed)
        self._limit_pa = load_gripper().pressure_limit_gauge_pa
        self.result = NodeSoakResult()
        self._pressure_pa = np.full(1, np.nan)
        self._over_since_s: float | None = None
        self._commanded_s: float | None = None
        self._befallen: str | None = None
        subscribe = operator.node.create_subscription
        subscribe(JointState, "chamber_states", self._on_pressures, NEWEST)
        subscribe(JointState, "valve_commands", self._on_command, NEWEST)

    def run(self, wall_s: float, progress: Progress) -> None:
        """Do things until the time is over."""
        began_s = time.monotonic()
        self._enable()
        self._look_at_usage()
        while (passed_s := time.monotonic() - began_s) < wall_s:
            progress.show(f"real time: {passed_s / 60.0:.1f} of {wall_s / 60.0:.1f} min, {self.result.grasps} grasps")
            try:
                self._round()
            except NodeSystemError as error:
                self.result.wrong.append(f"{passed_s:.0f} s: {error}")
                return
        self._look_at_usage()
        self.result.wall_s = round(time.monotonic() - began_s, 1)

    def _round(self) -> None:
        self._operator.ask(Trigger, f"grasp/{self._random.choice(MODE_NAMES)}", timeout_s=WAIT_S)
        self.result.grasps += 1
        self._wait(self._random.uniform(0.05, 4.0))
        self._expect_no_fault()
        self.result.held += self._phase() == "holding"
        draw = self._random.random()
        if draw < 0.25:
            self._operator.call(Trigger, "grasp/stop")
        elif draw < 0.75:
            self._befall(self._random.choice(BEFALL), self._random.choice((KILLED, FROZEN)))
        self._go_back()

    def _befall(self, node: str, how: str) -> None:
        name = f"{node} {how}"
        self.result.befallen[name] = self.result.befallen.get(name, 0) + 1
        process = self._processes.processes[node]
        self._befallen = name
        if how == KILLED:
            del self._processes.processes[node]  # or its end is taken for a failure
            process.kill()
            process.wait()
            self._wait(self._random.uniform(0.1, 3.0))
            self._processes.start(node)
        else:
            process.send_signal(signal.SIGSTOP)
            self._wait(self._random.uniform(0.1, 5.0))
            process.send_signal(signal.SIGCONT)
        self._wait(0.5)

    def _go_back(self) -> None:
        """Release, wait until vented, reset, air on."""
        begun_s = time.monotonic()
        while self._phase() != "idle" or not (self._pressure_pa < VENTED_PA).all():
            self._call("grasp/release")
            self._wait(0.3)
            if self._phase() == "fault":
                self._call("grasp/reset")
            self._wait(0.2)
            if time.monotonic() - begun_s > START_S:
                raise NodeSystemError(f"no way back to idle: {self._operator.grasp}")
        self._enable()

    def _enable(self) -> None:
        """Switch the air on as soon as that is accepted, and wait until a grasp may begin."""
        until_s = time.monotonic() + START_S
        while True:
            try:
                self._operator.enable(ANSWER_S)
                break
            except NodeSystemError as error:
                self._processes.check()
                if time.monotonic() > until_s:
                    raise NodeSystemError(f"the air cannot be switched on: {error}") from error
                self._wait(0.2)
        self._befallen, self._commanded_s = None, None

    def _call(self, service: str) -> None:
        """Call a service of a node that may be starting anew: what its predecessor in the graph was asked is lost."""
        with suppress(NodeSystemError):
            self._operator.call(Trigger, service, timeout_s=ANSWER_S)
        self._processes.check()

    def _expect_no_fault(self) -> None:
        if self._phase() == "fault":
            self.result.wrong.append(f"a fault of nobody's making: {self._operator.grasp.get('reason')}")

    def _phase(self) -> str:
        return self._operator.grasp.get("phase", "")

    def _wait(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            self._operator.spin()

    def _on_pressures(self, message: JointState) -> None:
        self._pressure_pa = np.array(message.effort)
        highest_pa = float(np.nanmax(self._pressure_pa, initial=0.0))
        self.result.pressure_max_kpa = max(self.result.pressure_max_kpa, round(highest_pa / 1e3, 3))
        now_s = time.monotonic()
        if highest_pa <= 1.02 * self._limit_pa:
            self._over_since_s = None
        elif self._over_since_s is None:
            self._over_since_s = now_s
        elif now_s - self._over_since_s > OVER_LIMIT_S:
            self.result.wrong.append(f"{highest_pa / 1e3:.1f} kPa for {now_s - self._over_since_s:.2f} s")

    def _on_command(self, _: JointState) -> None:
        now_s, result = time.monotonic(), self.result
        gap_s = 0.0 if self._commanded_s is None else now_s - self._commanded_s
        gap_ms, self._commanded_s = round(1e3 * gap_s, 1), now_s
        if self._befallen is not None:
            longest_ms = result.befallen_gap_ms.get(self._befallen, 0.0)
            result.befallen_gap_ms[self._befallen] = max(longest_ms, gap_ms)
            return
        result.commands += 1
        result.late_commands += gap_s > LATE_COMMAND_S
        result.longest_gap_ms = max(result.longest_gap_ms, gap_ms)

    def _look_at_usage(self) -> None:
        """Take memory, threads and open files; of a process that was started anew the later of its own two looks."""
        for name, popen in self._processes.processes.items():
            process = psutil.Process(popen.pid)
            with process.oneshot():
                now = {
                    "memory_mb": round(process.memory_info().rss / 1e6, 1),
                    "threads": process.num_threads(),
                    "files": process.num_fds(),
                }
            before = self.result.usage.get(name, {})
            self.result.usage[name] = {key: (before.get(key, (value,))[0], value) for key, value in now.items()}


def nodes_under_random_use(wall_s: float, seed: int, logs: Path) -> NodeSoakResult:
    """Start six nodes, use them at random, and return what came of it."""
    with domain_id() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain)}
        with NodeProcesses(logs, executables=NODES, environment=environment) as processes:
            operator = Operator("soak", idle=processes.check, domain_id=domain)
            try:
                operator.wait_for_nodes(timeout_s=START_S)
                test = NodeSoak(processes, operator, seed)
                test.run(wall_s, Progress(sys.stderr))
                return test.result
            finally:
                operator.close()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--minutes", type=float, default=10.0, metavar="M", help="of the wall clock (default 10)")
    parser.add_argument("--seed", type=int, default=0, help="of everything drawn (default 0)")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the result goes")
    parser.add_argument(
        "--simulated-hours", type=float, metavar="H", help="so much simulated time first, then all M real"
    )
    parser.add_argument("--simulated-only", action="store_true", help="all of the time in simulated time, no nodes")
    parser.add_argument("--logs", type=result_folder, default=Path("report/soak"), help="output of the nodes")


def run(options: argparse.Namespace) -> int:
    """Use the gripper at random both ways, print what came of it, and return 1 if something must not be."""
    if not (options.minutes > 0.0 and (options.simulated_hours is None or options.simulated_hours > 0.0)):
        print("mbpam soak: --minutes and --simulated-hours must be greater than 0", file=sys.stderr)
        return 2
    exit_on_stop_signals()
    print("  ".join(f"{key}: {value}" for key, value in machine().items()), f" load: {os.getloadavg()[0]:.1f}")
    wall_s = 60.0 * options.minutes
    if options.simulated_hours is not None:
        simulated = soak(options.seed, math.inf, 3600.0 * options.simulated_hours)
    else:
        wall_s *= 1.0 if options.simulated_only else 0.5
        simulated = soak(options.seed, wall_s)
    print(simulated_text(simulated), flush=True)
    nodes = None if options.simulated_only else nodes_under_random_use(wall_s, options.seed, options.logs)
    if nodes is not None:
        print(nodes_text(nodes))
    if options.json is not None:
        result = {"machine": machine(), "simulated": simulated.row(), "nodes": nodes and dataclasses.asdict(nodes)}
        write_json(options.json, result)
    return 1 if simulated.wrong or (nodes is not None and nodes.wrong) else 0


def simulated_text(result: SoakResult) -> str:
    """Return what is printed of the simulated time."""
    memory = result.memory_mb or [0.0]
    lines = [
        f"simulated: {result.simulated_s / 3600.0:.2f} h in {result.wall_s:.0f} s, {result.grasps} grasps, "
        f"{result.held} held, {result.disturbed} disturbed; highest pressure {result.pressure_max_kpa:.1f} kPa",
        f"memory {memory[min(1, len(memory) - 1)]:.0f} MB after a tenth of the time, {memory[-1]:.0f} MB at the end",
    ]
    return "\n".join([*lines, *_wrong_lines(result.wrong)])


def nodes_text(result: NodeSoakResult) -> str:
    """Return what is printed of the real time."""
    befallen = ", ".join(f"{what} {count}" for what, count in sorted(result.befallen.items()))
    rows = [
        (node, *(f"{first:g} -> {last:g}" for first, last in (use["memory_mb"], use["threads"], use["files"])))
        for node, use in result.usage.items()
    ]
    lines = [
        f"real time: {result.wall_s / 60.0:.1f} min, {result.grasps} grasps, {result.held} held; {befallen}",
        f"highest pressure {result.pressure_max_kpa:.1f} kPa; {result.late_commands} of {result.commands} valve "
        f"commands later than {1e3 * LATE_COMMAND_S:.0f} ms while all nodes ran, the longest pause "
        f"{result.longest_gap_ms:.0f} ms",
        f"longest pause after {_pauses(result.befallen_gap_ms)}",
        table(("node", "memory [MB]", "threads", "files"), rows),
    ]
    return "\n".join([*lines, *_wrong_lines(result.wrong)])


def _pauses(gap_ms: dict[str, float]) -> str:
    return ", ".join(f"{what} {1e-3 * gap:.2f} s" for what, gap in sorted(gap_ms.items())) or "nothing: none was down"


def _wrong_lines(wrong: list[str]) -> list[str]:
    return [f"WRONG: {what}" for what in wrong] or ["nothing wrong"]
