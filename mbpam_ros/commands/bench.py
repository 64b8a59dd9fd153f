"""What the running gripper costs, beside its budgets.

CPU of six processes and of "bringup", answer time of services, delay from set-point to valve command, the speed of
the simulation, and what loops and observers of the valves cost. Figures are measured, never asserted: the exit code is
0 whether or not a budget is kept. Shares of a core are medians over several short windows, so that another program's
burst does not count.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import random
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbpam_ros.commands.system import NodeProcesses, NodeSystemError, Operator, exit_on_stop_signals  # isort: skip
import numpy as np
import psutil
from domain_coordinator import domain_id
from rclpy.client import Client
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, JointState
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.commands.result_arguments import result_file, result_folder
from mbpam_ros.commands.workers import refuse_workers
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.messages import joint_state, rgb_image, seconds
from mbpam_ros.nodes.runtime import NEWEST, STREAM
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.study.guard_costs import ALONE, MODELS, guard_costs_us
from mbpam_ros.study.judge.hostile import hostile_images
from mbpam_ros.study.provenance import processor
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, table

if TYPE_CHECKING:
    from rclpy.type_support import Msg  # Jazzy has none

START_S = 180.0
"""A first start compiles the contact model for about half a minute."""

SETTLE_S = 3.0
WAIT_S = 20.0
ALONE_S = 5.0
LOCK_STEP_S = 5.0
SETPOINT_PA = 20e3
HOSTILE_HZ = 20.0
HOSTILE_SIZE_PX = (800, 480)
"""That of the simulated camera, whose camera_info goes with the images."""
HOSTILE_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
RESPONSE = 0.02
"""An opening beyond this answers a set-point; at rest a valve is closed."""


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    Args:
        name: what was measured.
        value: the median of the windows, or the percentile the name says.
        unit: of the value.
        budget: what it may be at most; None where there is none.
        least, greatest: range over the windows or samples.
    """

    name: str
    value: float
    unit: str
    budget: float | None = None
    least: float | None = None
    greatest: float | None = None

    @property
    def over_budget(self) -> bool:
        """Whether the value exceeds its budget."""
        return self.budget is not None and self.value > self.budget


@dataclass(frozen=True)
class Plan:
    """How long to measure.

    Args:
        scene: scene of the plant.
        windows: number of CPU windows.
        window_s: length of each.
        calls: service calls, and set-points.
        logs: folder for the output of the nodes.
    """

    scene: str
    windows: int
    window_s: float
    calls: int
    logs: Path


class Bench:
    """Measures one thing after the other and collects the figures."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._line = Progress()
        self.figures: list[Figure] = []
        self._loops_ms: list[float] = []
        self.failures: list[str] = []

    def run(self) -> None:
        """Measure everything; what cannot be measured is noted in ``failures``."""
        for name, measure in (
            ("six processes", self._six_processes),
            ("set-point to valve command", self._setpoint_delay),
            ("bringup", self._bringup),
            ("bringup, hostile images", self._hostile_images),
            ("plant alone", self._plant_alone),
            ("loops and observers", self._observers),
            ("lock step, one process", lambda: self._lock_step(["bringup"])),
            ("lock step, six processes", lambda: self._lock_step(NODES)),
        ):
            self._line.say(f"measuring: {name}")
            # A domain of its own: processes that have just ended linger in the graph.
            with domain_id() as domain:
                os.environ["ROS_DOMAIN_ID"] = str(domain)
                try:
                    measure()
                except NodeSystemError as error:
                    self.failures.append(f"{name}: {error}")
                    self._line.say(f"failed: {self.failures[-1]}")
        if self._loops_ms:
            self._median("100 000 turns of a Python loop, between the windows", self._loops_ms, "ms")

    # What is measured

    def _six_processes(self) -> None:
        scene = ["-p", f"scene:={self._plan.scene}"]
        with self._running("six", NODES, {"plant": scene}) as (processes, operator):
            self._cpu("six processes, idle", processes, 60.0)
            self._service_times(operator)
            self._hold(operator)
            self._cpu("six processes, holding", processes, 60.0)
            self._real_time_factor(operator)

    def _bringup(self) -> None:
        scene = ["-p", f"plant:scene:={self._plan.scene}"]
        with self._running("bringup", ["bringup"], {"bringup": scene}) as (processes, operator):
            self._cpu("bringup, idle", processes, 25.0)
            self._hold(operator)
            self._cpu("bringup, holding", processes, 25.0)
            # The simulated camera repeats the image of a still scene, which the detector passes over; a real one
            # never does. This is what rendering and detecting cost on top.
            self._cpu("bringup, hand moving", processes, during=lambda duration_s: self._move(operator, duration_s))

    def _hostile_images(self) -> None:
        """Time between valve commands, by their stamps, while images come that take the detector all its time."""
        scene = ["-p", f"plant:scene:={self._plan.scene}", "-p", f"object_detector:max_rate_hz:={HOSTILE_HZ}"]
        with self._running("hostile", ["bringup"], {"bringup": scene}) as (_, operator):
            self._hold(operator)
            stamps_s: list[float] = []
            operator.node.create_subscription(
                JointState,
                "valve_commands",
                lambda message: stamps_s.append(seconds(message.header.stamp)),
                HOSTILE_QOS,
            )
            images = operator.node.create_publisher(Image, "camera/image_raw", STREAM)
            operator.wait_for(lambda: bool(stamps_s) and images.get_subscription_count() > 0, WAIT_S, "valve commands")
            messages = [rgb_image(pixels) for pixels in hostile_images(*HOSTILE_SIZE_PX)]
            for index in range(self._plan.calls):
                self._line.show(f"hostile image {index}")
                images.publish(messages[index % len(messages)])
                self._wait(operator, 1.0 / HOSTILE_HZ)
            gaps_ms = 1e3 * np.diff(stamps_s)
            count, span = len(gaps_ms), (float(gaps_ms.min()), float(gaps_ms.max()))
            name = f"valve commands under {self._plan.calls} hostile images, "
            self.figures.append(Figure(f"{name}longest gap of {count}", span[1], "ms", 30.0, *span))
            self.figures.append(Figure(f"{name}gap p99", float(np.percentile(gaps_ms, 99)), "ms", None, *span))
            if operator.grasp.get("phase") != "holding":
                self.failures.append(f"hostile images: the grasp was lost, {operator.grasp.get('reason')}")

    def _service_times(self, operator: Operator) -> None:
        """Time services of three nodes that change nothing in an idle gripper."""
        requests = [
            (SetBool, "valve_controller/enable", SetBool.Request(data=True)),
            (Trigger, "grasp/reset", Trigger.Request()),
            (Trigger, "plant/lower", Trigger.Request()),
        ]
        clients: list[tuple[Client, Msg]] = [
            (operator.node.create_client(kind, name), request) for kind, name, request in requests
        ]
        for (kind, name, request), (client, _) in zip(requests, clients, strict=True):
            operator.call(kind, name, request)
            operator.wait_for(client.service_is_ready, WAIT_S, name)
            operator.wait_for(client.call_async(request).done, WAIT_S, name)
        times_ms = []
        for i in range(self._plan.calls):
            self._line.show(f"service call {i}")
            client, request = clients[i % len(clients)]
            self._wait(operator, random.uniform(0.0, 0.02))
            began = time.perf_counter()
            operator.wait_for(client.call_async(request).done, WAIT_S, "a service's answer")
            times_ms.append(1e3 * (time.perf_counter() - began))
        self._percentiles("service answer", times_ms, 10.0)

    def _setpoint_delay(self) -> None:
        """Time from publishing a set-point to the first valve command that answers it, without the arbiter."""
        executables = ("plant", "pressure_sensor", "valve_controller")
        arguments = {
            "plant": ["-p", "scene:=empty"],
            "valve_controller": ["-p", "enable_at_start:=true"],
        }
        with self._running("setpoint", executables, arguments) as (_, operator):
            latest: list[tuple[float, JointState]] = []
            operator.node.create_subscription(
                JointState, "valve_commands", lambda message: latest.append((time.perf_counter(), message)), NEWEST
            )
            setpoints = operator.node.create_publisher(JointState, "pressure_setpoints", STREAM)
            operator.wait_for(lambda: setpoints.get_subscription_count() > 0 and bool(latest), WAIT_S, "valve commands")
            wanted = np.zeros(len(CHANNEL_NAMES))
            times_ms = []
            for i in range(self._plan.calls):
                self._line.show(f"set-point {i}")
                channel = i % len(wanted)
                rising = wanted[channel] == 0.0
                self._wait(operator, random.uniform(0.02, 0.04))
                wanted[channel] = SETPOINT_PA if rising else 0.0
                latest.clear()
                stamp = operator.node.get_clock().now().to_msg()
                began = time.perf_counter()
                setpoints.publish(joint_state(stamp, CHANNEL_NAMES, effort=wanted))
                answered_at = _wait_for_answer(operator, latest, channel, 1.0 if rising else -1.0)
                times_ms.append(1e3 * (answered_at - began))
            self._percentiles("set-point to valve command", times_ms, 15.0)

    def _plant_alone(self) -> None:
        """Speed of the plant's model without ROS."""
        plant = build_plant(*load_scene(self._plan.scene), load_gripper())
        spool, tick_s = np.zeros(len(CHANNEL_NAMES)), 0.01
        plant.step(spool, tick_s)
        factors = []
        for _ in range(self._plan.windows):
            began, ticks = time.perf_counter(), round(ALONE_S / tick_s)
            for _ in range(ticks):
                plant.step(spool, tick_s)
            factors.append(ticks * tick_s / (time.perf_counter() - began))
        self._median("plant's model alone, speed", factors, "x real time")

    def _observers(self) -> None:
        """What a sample costs the valve controller without ROS, and how much of it the observers are."""
        costs = guard_costs_us(load_pneumatics(), self._plan.windows)
        alone_us = statistics.median(costs[ALONE])
        self._median("pressure loops, a sample", costs[ALONE], "us")
        for model in MODELS:
            guarded = costs[model]
            self._median(f"with observers and test pulses, valves as {model}, a sample", guarded, "us")
            self._median(f"the same over the loops alone, {model}", [each / alone_us for each in guarded], "times")

    def _lock_step(self, executables: Sequence[str]) -> None:
        """Speed of the whole system with a simulated clock that runs as fast as the nodes answer."""
        one = "bringup" in executables
        prefix = "plant:" if one else ""
        arguments = {executable: ["-p", "use_sim_time:=true"] for executable in executables}
        for parameter in (f"scene:={self._plan.scene}", "publish_clock:=true", "lock_step:=true"):
            arguments["bringup" if one else "plant"] += ["-p", prefix + parameter]
        name = "lock step, one process" if one else "lock step, six processes"
        with self._running(f"lock_step_{len(executables)}", executables, arguments) as (_, operator):
            factors = []
            for window in range(self._plan.windows):
                self._line.show(f"{name}: window {window + 1} of {self._plan.windows}")
                began, from_s = time.perf_counter(), _plant_time_s(operator)
                self._wait(operator, LOCK_STEP_S)
                factors.append((_plant_time_s(operator) - from_s) / (time.perf_counter() - began))
            self._median(f"{name}, speed", factors, "x real time")

    # How

    @contextmanager
    def _running(
        self, name: str, executables: Sequence[str], arguments: dict[str, list[str]]
    ) -> Iterator[tuple[NodeProcesses, Operator]]:
        """Processes and an operator beside them, from the nodes' first reports on."""
        with NodeProcesses(self._plan.logs / name, arguments, executables=executables) as processes:
            operator = Operator("bench", idle=processes.check)
            try:
                self._wait_for_start(operator, NODES if "bringup" in executables else executables)
                yield processes, operator
            finally:
                operator.close()

    def _wait_for_start(self, operator: Operator, nodes: Sequence[str]) -> None:
        """Wait until every node has reported and start-up is over."""
        names = {f"/{node}" for node in nodes}
        deadline = time.monotonic() + START_S
        while not names <= operator.health.keys():
            self._line.show(f"waiting for {', '.join(sorted(names - operator.health.keys()))}")
            if time.monotonic() > deadline:
                raise NodeSystemError(f"no health report within {START_S:g} s")
            operator.spin()
        self._wait(operator, SETTLE_S)

    def _hold(self, operator: Operator) -> None:
        """Grasp and lift the object, and wait until everything is still."""
        operator.enable(WAIT_S)
        fault = operator.close_fingers(timeout_s=WAIT_S)
        if fault:
            raise NodeSystemError(fault)
        operator.call(Trigger, "plant/lift")
        self._wait(operator, SETTLE_S)

    def _move(self, operator: Operator, duration_s: float) -> None:
        """Lower and raise the hand in turn."""
        until = time.perf_counter() + duration_s
        while time.perf_counter() < until:
            # The one that the hand's place does not allow is refused and changes nothing.
            operator.call(Trigger, "plant/lower")
            operator.call(Trigger, "plant/lift")
            self._wait(operator, 0.05)

    def _cpu(
        self,
        name: str,
        processes: NodeProcesses,
        budget: float | None = None,
        during: Callable[[float], None] = time.sleep,
    ) -> None:
        """Share of one core of every process and of all, as medians over the windows.

        This process is asleep in them, unless ``during`` says otherwise.
        """
        watched = {executable: psutil.Process(process.pid) for executable, process in processes.processes.items()}
        windows: list[dict[str, float]] = []
        for window in range(self._plan.windows):
            self._line.show(f"{name}: window {window + 1} of {self._plan.windows}")
            self._loops_ms.append(_fixed_loop_ms())
            began, before = time.perf_counter(), {key: _cpu_s(process) for key, process in watched.items()}
            during(self._plan.window_s)
            elapsed_s = time.perf_counter() - began
            windows.append({key: 100.0 * (_cpu_s(watched[key]) - before[key]) / elapsed_s for key in watched})
        processes.check()
        if len(watched) > 1:
            for key in watched:
                self._median(f"CPU of {name}: {key}", [window[key] for window in windows], "% of a core")
        self._median(f"CPU of {name}", [sum(window.values()) for window in windows], "% of a core", budget)

    def _real_time_factor(self, operator: Operator) -> None:
        factors = []
        for _ in range(self._plan.windows):
            operator.health.pop("/plant", None)
            operator.wait_for(lambda: "/plant" in operator.health, WAIT_S, "the plant's report")
            factors.append(float(operator.health["/plant"][2]["real_time_factor"]))
        self._median("plant in real time, holding, factor", factors, "x real time")

    def _wait(self, operator: Operator, duration_s: float) -> None:
        until = time.perf_counter() + duration_s
        while (left_s := until - time.perf_counter()) > 0.0:
            operator.spin(min(left_s, 0.02))

    def _median(self, name: str, values: Sequence[float], unit: str, budget: float | None = None) -> None:
        self.figures.append(Figure(name, statistics.median(values), unit, budget, min(values), max(values)))

    def _percentiles(self, name: str, times_ms: Sequence[float], budget_p99: float) -> None:
        count, span = len(times_ms), (min(times_ms), max(times_ms))
        for percent, budget in ((50, None), (99, budget_p99)):
            value = float(np.percentile(times_ms, percent))
            self.figures.append(Figure(f"{name}, p{percent} of {count}", value, "ms", budget, *span))


def _wait_for_answer(
    operator: Operator, commands: list[tuple[float, JointState]], channel: int, direction: float
) -> float:
    """Return when the first command arrived that opens the channel's valve in ``direction``."""

    def answers() -> Iterator[float]:
        return (at for at, command in commands if direction * command.position[channel] > RESPONSE)

    operator.wait_for(lambda: any(True for _ in answers()), WAIT_S, "an answering valve command")
    return next(answers())


def _fixed_loop_ms() -> float:
    """Return the CPU time of a fixed piece of Python: shares of a core compare only beside how fast the core is."""
    began, total = time.process_time(), 0.0
    for i in range(100_000):
        total += 0.5 * i
    return 1e3 * (time.process_time() - began)


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


def _plant_time_s(operator: Operator) -> float:
    return float(operator.health["/plant"][2]["time_s"])


def machine() -> dict[str, str]:
    """Return what the figures depend on: processor, cores, load, and versions."""
    try:
        rclpy_version = importlib.metadata.version("ros-rclpy")
    except importlib.metadata.PackageNotFoundError:
        rclpy_version = "of the system"
    return {
        "processor": processor(),
        "cores": str(len(os.sched_getaffinity(0))),
        "load_before": f"{os.getloadavg()[0]:.2f}",
        "python": platform.python_version(),
        "rclpy": rclpy_version,
    }


def _print_table(figures: Sequence[Figure]) -> None:
    rows = [
        (
            figure.name,
            f"{figure.value:.3g} {figure.unit}",
            "" if figure.least is None else f"{figure.least:.3g} .. {figure.greatest:.3g}",
            "" if figure.budget is None else f"{figure.budget:g}",
            "OVER BUDGET" if figure.over_budget else "" if figure.budget is None else "kept",
        )
        for figure in figures
    ]
    print(table(("figure", "value", "range", "budget", ""), rows))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="write machine and figures as JSON")
    parser.add_argument("--scene", default="bulb", help="scene of the plant (default bulb)")
    parser.add_argument("--windows", type=int, default=5, help="windows of which the median counts (default 5)")
    parser.add_argument("--window-s", type=float, default=3.0, help="length of a CPU window [s] (default 3)")
    parser.add_argument("--calls", type=int, default=320, help="service calls, and set-points (default 320)")
    parser.add_argument(
        "--logs", type=result_folder, default=Path("report/bench"), metavar="DIR", help="output of the nodes"
    )
    refuse_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Measure, print the table, and return the exit status."""
    if min(options.windows, options.calls) < 1 or not options.window_s > 0.0:
        print("mbpam bench: --windows, --window-s and --calls must be greater than 0", file=sys.stderr)
        return 2
    exit_on_stop_signals()
    here = machine()
    print("  ".join(f"{key}: {value}" for key, value in here.items()))
    bench = Bench(Plan(options.scene, options.windows, options.window_s, options.calls, options.logs))
    bench.run()
    print(f"shares of a core: median of {options.windows} windows of {options.window_s:g} s")
    _print_table(bench.figures)
    for failure in bench.failures:
        print(f"not measured: {failure}")
    if options.json is not None:
        figures = [{**asdict(figure), "over_budget": figure.over_budget} for figure in bench.figures]
        write_json(options.json, {"machine": here, "figures": figures, "not_measured": bench.failures})
    return 0
