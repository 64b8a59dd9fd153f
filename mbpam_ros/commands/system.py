"""The six nodes as six operating-system processes, and an operator that talks to them as a user would."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.client import Client
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.errors import MbpamError
from mbpam_ros.nodes.interface import NODES, SERVICES, SET_BOOL, TRIGGER
from mbpam_ros.nodes.runtime import LATCHED

if TYPE_CHECKING:
    from rclpy.type_support import Msg  # Jazzy has none

STOP_TIMEOUT_S = 30.0
"""Ending takes 1 s, several on a busy machine or when the middleware hangs (``TEAR_DOWN_TIMEOUT_S``)."""


class NodeSystemError(MbpamError, RuntimeError):
    """A node process ended unexpectedly, or something awaited did not happen in time."""


Launch = Callable[[list[str], Path, dict[str, str]], "subprocess.Popen[bytes]"]
"""Makes a process of an executable and its arguments; a file takes its output; with all variables."""


def launch_executable(arguments: list[str], log: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """Start an executable in a Python of its own."""
    command = [sys.executable, "-m", "mbpam_ros.nodes", *arguments]
    with log.open("ab") as output:
        return subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, env=environment)


class NodeProcesses:
    """Node executables as processes; stops them when the ``with`` block ends.

    Args:
        log_directory: where each node's output goes, as ``<node>.log``.
        arguments: ROS arguments by executable, e.g. ``{"plant": ["-p", "scene:=bulb"]}``.
        common: ROS arguments for all, e.g. ``["-r", "__ns:=/left"]``.
        executables: which to start.
        environment: variables on top of this process's.
        launch: how a process is started.
    """

    def __init__(
        self,
        log_directory: Path,
        arguments: Mapping[str, Sequence[str]] | None = None,
        common: Sequence[str] = (),
        executables: Sequence[str] = NODES,
        environment: Mapping[str, str] | None = None,
        launch: Launch = launch_executable,
    ) -> None:
        self._launch = launch
        self._log_directory = log_directory
        self._arguments = arguments or {}
        self._common = list(common)
        self._executables = tuple(executables)
        self._environment = {**os.environ, **(environment or {})}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> NodeProcesses:
        self._log_directory.mkdir(parents=True, exist_ok=True)
        for executable in self._executables:
            self.start(executable)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, executable: str) -> None:
        """Start (again) one executable."""
        ros = ["--ros-args", *self._common, *self._arguments.get(executable, ())]
        self.processes[executable] = self._launch([executable, *ros], self.log(executable), self._environment)

    def log(self, executable: str) -> Path:
        """Return the log file of an executable."""
        return self._log_directory / f"{executable}.log"

    def check(self) -> None:
        """Raise NodeSystemError with the last lines of its log if a process has ended."""
        for executable, process in self.processes.items():
            if process.poll() is not None:
                last = self.log(executable).read_text(errors="replace").strip().splitlines()[-3:]
                raise NodeSystemError(f"{executable} ended with code {process.returncode}: {' | '.join(last)}")

    def stop(self, stop_signal: signal.Signals = signal.SIGINT) -> dict[str, int]:
        """Ask every process to end, kill what does not in time, and return the exit codes."""
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(stop_signal)
        deadline = time.monotonic() + STOP_TIMEOUT_S
        for process in self.processes.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        return {executable: process.returncode for executable, process in self.processes.items()}


_SERVICE_TYPES = {TRIGGER: Trigger, SET_BOOL: SetBool}


class Service(Protocol):
    """What is asked of a type of service."""

    Request: ClassVar[Callable[[], Msg]]


class Answered(Protocol):
    """The response of every service that the gripper has."""

    success: bool
    message: str


class Operator:
    """A node of our own beside the running system: it listens, calls services, and waits on predicates.

    What the nodes say of themselves is in ``health`` (level, message, values by full name), the arbiter's state in
    ``grasp`` (values by key, e.g. ``phase``).

    Args:
        node_name: its ROS name.
        namespace: the gripper's namespace.
        idle: called between spins, e.g. to draw progress and to check the processes; may raise.
    """

    def __init__(
        self, node_name: str, namespace: str = "", idle: Callable[[], None] = lambda: None, domain_id: int | None = None
    ) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = Node(node_name, context=self._context, namespace=namespace, use_global_arguments=False)
        self._prefix = self.node.get_namespace().rstrip("/")
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._idle = idle
        # Made before anybody calls: a server that sees a client late loses its request or the answer to it.
        self._clients: dict[str, Client] = {
            service.name: self.node.create_client(_SERVICE_TYPES[service.service_type], service.name)
            for service in SERVICES
        }
        self.health: dict[str, tuple[bytes, str, dict[str, str]]] = {}
        self.grasp: dict[str, str] = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 50)
        self.node.create_subscription(DiagnosticStatus, "grasp_state", self._on_grasp_state, LATCHED)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def spin(self, timeout_s: float = 0.02) -> None:
        """Handle what has arrived, waiting at most ``timeout_s``, then call ``idle``."""
        self._executor.spin_once(timeout_sec=timeout_s)
        self._idle()

    def wait_for(self, predicate: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Spin until ``predicate`` holds.

        Raises:
            NodeSystemError: it did not within ``timeout_s``.
        """
        deadline = time.monotonic() + timeout_s
        while not predicate():
            if time.monotonic() > deadline:
                raise NodeSystemError(f"{what}: not within {timeout_s:g} s")
            self.spin()

    def call(
        self, service_type: type[Service], name: str, request: Msg | None = None, timeout_s: float = 10.0
    ) -> Answered:
        """Call a service and return its response; waits for the server and for a real answer.

        Raises:
            NodeSystemError: no answer within ``timeout_s``.
        """
        client = self._clients.get(name)
        if client is None:  # none of the gripper's
            client = self._clients[name] = self.node.create_client(service_type, name)
        self.wait_for(client.service_is_ready, timeout_s, f"service {name}")
        future = client.call_async(request if request is not None else service_type.Request())
        self.wait_for(future.done, timeout_s, f"answer of {name}")
        answer = future.result()
        if answer is None:
            raise NodeSystemError(f"answer of {name}: none came")
        return answer

    def ask(self, service_type: type[Service], name: str, request: Msg | None = None, timeout_s: float = 10.0) -> str:
        """Call a service that must not refuse; return its message.

        Raises:
            NodeSystemError: it refused, or no answer came within ``timeout_s``.
        """
        answer = self.call(service_type, name, request, timeout_s)
        if not answer.success:
            raise NodeSystemError(f"{name} refused: {answer.message}")
        return answer.message

    def enable(self, timeout_s: float = 20.0) -> None:
        """Let the valves open, and wait until the arbiter is ready to grasp.

        Raises:
            NodeSystemError: refused, or it is not within ``timeout_s``.
        """
        self.ask(SetBool, "valve_controller/enable", SetBool.Request(data=True), timeout_s)
        arbiter = f"{self._prefix}/grasp_arbiter"
        ready = lambda: arbiter in self.health and self.health[arbiter][0] == DiagnosticStatus.OK  # noqa: E731
        self.wait_for(ready, timeout_s, "the arbiter's readiness")

    def close_fingers(self, service: str = "grasp/envelope", timeout_s: float = 20.0) -> str:
        """Ask for a grasp and wait for its end: return the reason of the fault, or nothing where it holds.

        Raises:
            NodeSystemError: refused, or neither came within ``timeout_s``.
        """
        self.ask(Trigger, service, timeout_s=timeout_s)
        self.wait_for(lambda: self.grasp.get("phase") in ("holding", "fault"), timeout_s, "the end of the grasp")
        return "" if self.grasp["phase"] == "holding" else self.grasp["reason"]

    def wait_for_nodes(self, names: Sequence[str] = NODES, timeout_s: float = 60.0) -> None:
        """Wait until every node has reported its health."""
        wanted = {f"{self._prefix}/{name}" for name in names}
        self.wait_for(lambda: wanted <= self.health.keys(), timeout_s, f"health of {', '.join(sorted(wanted))}")

    def _on_grasp_state(self, state: DiagnosticStatus) -> None:
        self.grasp = {item.key: item.value for item in state.values}

    def _on_diagnostics(self, report: DiagnosticArray) -> None:
        for status in report.status:
            values = {item.key: item.value for item in status.values}
            self.health[status.name] = (status.level, status.message, values)


def exit_on_stop_signals() -> None:
    """Let SIGTERM and SIGHUP end this process by an exception, as SIGINT does: ``with`` blocks stop their nodes."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda received, _: sys.exit(128 + received))
