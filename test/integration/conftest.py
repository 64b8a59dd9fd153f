"""Nodes for the tests: composed in one process in a context and a domain of their own, or as processes."""

from __future__ import annotations

import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

# Before the first message import: wrong field types become errors, and nothing leaves this machine.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import pytest
from domain_coordinator import domain_id

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.commands.compile import compile_all
from mbpam_ros.commands.system import Launch, NodeProcesses, NodeSystemError, Operator
from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.messages import time_stamp
from mbpam_ros.nodes.runtime import NEWEST, STREAM
from mbpam_ros.terminal import Progress

WAIT_S = 10.0
PROCESS_WAIT_S = 15.0
START_S = 60.0
UNDER_WAY_S = 0.2
"""What a killed process has said arrives within this."""

REAL_CLOCK = pytest.mark.xdist_group("real_clock")
"""Node processes run one after another in one worker of xdist, so that no other test's nodes compete with them."""


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what starts node processes: those tests need a directory for their output, or the nursery."""
    for item in items:
        if {"log_directory", "nursery"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(REAL_CLOCK)


_domain_numbers = itertools.count(1 + os.getpid() % 100)


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain that no other test of this session has used lately and no other session uses now."""
    with domain_id(selector=lambda: next(_domain_numbers) % 100 + 1) as number:
        yield number


class Graph:
    """Nodes of the package and a test node, composed in this process in a private context."""

    def __init__(self, domain_number: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_number)
        self.executor = EventsExecutor(context=self._context)
        self.nodes: list[Node] = []
        self._clock_publisher = None
        self.test_node = self._adopt(Node("test_node", context=self._context, use_global_arguments=False))

    def add(self, node_class: type[Node], namespace: str = "", remap: dict[str, str] | None = None, **parameters):
        """Build a node of the package with these parameters and let it run."""
        rules = [argument for old, new in (remap or {}).items() for argument in ("-r", f"{old}:={new}")]
        return self._adopt(
            node_class(
                context=self._context,
                namespace=namespace,
                use_global_arguments=False,
                cli_args=["--ros-args", *rules] if rules else None,
                parameter_overrides=[Parameter(name, value=value) for name, value in parameters.items()],
            )
        )

    def _adopt(self, node: Node) -> Node:
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def remove(self, node: Node) -> None:
        """Take one node down, as when its process ends."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def spin_until(self, predicate: Callable[[], bool], what: str, timeout_s: float = WAIT_S) -> None:
        """Run the nodes until ``predicate`` holds; fail the test if it does not in time."""
        deadline = time.monotonic() + timeout_s
        while not predicate():
            assert time.monotonic() < deadline, f"{what}: not within {timeout_s:g} s"
            self.executor.spin_once(timeout_sec=0.05)

    def listen(self, message_type: type, topic: str, qos: QoSProfile = STREAM) -> list:
        """Return a list that fills with the messages of a topic."""
        received: list = []
        self.test_node.create_subscription(message_type, topic, received.append, qos)
        return received

    def publisher(self, message_type: type, topic: str, qos: QoSProfile = STREAM):
        """Return a publisher of the test node, matched with at least one subscription."""
        publisher = self.test_node.create_publisher(message_type, topic, qos)
        self.spin_until(lambda: publisher.get_subscription_count() > 0, f"a subscription of {topic}")
        return publisher

    def call(self, service_type: type, name: str, request: object = None):
        """Call a service and return its response."""
        client = self.test_node.create_client(service_type, name)
        self.spin_until(client.service_is_ready, f"service {name}")
        future = client.call_async(request if request is not None else service_type.Request())
        self.spin_until(future.done, f"answer of {name}")
        return future.result()

    def change(self, node: Node, label: str) -> tuple[bool, str]:
        """Ask a managed node for a transition, as ``ros2 lifecycle set`` does; return if it was made, and its state."""
        request = ChangeState.Request(transition=Transition(label=label))
        return self.call(ChangeState, f"{node.get_name()}/change_state", request).success, node.state

    def set_time(self, time_s: float) -> None:
        """Set the clock of the nodes that were added with ``use_sim_time=True``."""
        simulated = [node for node in self.nodes if node.get_parameter("use_sim_time").value]
        if self._clock_publisher is None:
            self._clock_publisher = self.test_node.create_publisher(Clock, "/clock", STREAM)
        self.spin_until(lambda: self._clock_publisher.get_subscription_count() == len(simulated), "listeners of /clock")
        stamp = time_stamp(time_s)
        self._clock_publisher.publish(Clock(clock=stamp))
        self.spin_until(lambda: all(node.get_clock().now().to_msg() == stamp for node in simulated), "simulated time")

    def close(self) -> None:
        """Take everything down."""
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture(scope="session")
def compiled_plant() -> None:
    """Have the simulated plant compiled: on a fresh machine that takes longer than a test waits."""
    compile_all(Progress(silent=True), processes=1)


@pytest.fixture
def new_graph(domain: int) -> Iterator[Callable[[], Graph]]:
    """Opens an empty graph in the test's domain; the one before it is taken down."""
    opened: list[Graph] = []

    def open_next() -> Graph:
        while opened:
            opened.pop().close()
        opened.append(Graph(domain))
        return opened[0]

    yield open_next
    for last in opened:
        last.close()


@pytest.fixture
def graph(new_graph: Callable[[], Graph]) -> Graph:
    """An empty graph in a domain of its own."""
    return new_graph()


@pytest.fixture
def log_directory(tmp_path: Path) -> Path:
    """Where node processes of a test write their output."""
    return tmp_path / "log"


class Forked:
    """A process of the :class:`Nursery` with the face of ``subprocess.Popen``."""

    def __init__(self, nursery: Nursery, number: int) -> None:
        self._nursery, self.pid = nursery, number
        self.returncode: int | None = None

    def poll(self) -> int | None:
        if self.returncode is None:
            self.returncode = self._nursery.ask(poll=self.pid)
        return self.returncode

    def wait(self, timeout: float = PROCESS_WAIT_S) -> int:
        deadline = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(0.01)  # as subprocess does
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Nursery:
    """Starts executables as forks of a process that has loaded them, see nursery.py."""

    def __init__(self) -> None:
        command = [sys.executable, Path(__file__).with_name("nursery.py")]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, **order: object) -> int | None:
        print(json.dumps(order), file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())

    def launch(
        self, arguments: Sequence[str], log: Path, environment: Mapping[str, str], errors: Path | None = None
    ) -> Forked:
        """Start an executable with its arguments; its errors go into the log if no other file is named."""
        files = {"output": str(log), "errors": str(errors or log)}
        return Forked(self, self.ask(argv=arguments, environment=environment, **files))

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run an executable to its end."""
        with TemporaryDirectory() as folder:
            output, errors = Path(folder, "output"), Path(folder, "errors")
            code = self.launch(arguments, output, dict(os.environ), errors).wait(START_S)
            return subprocess.CompletedProcess(arguments, code, output.read_text(), errors.read_text())

    def close(self) -> None:
        self._process.stdin.close()
        assert self._process.wait(PROCESS_WAIT_S) == 0


class Gripper:
    """One gripper as a user sees it: its processes, its services and what it publishes."""

    def __init__(self, processes: NodeProcesses, namespace: str, domain: int) -> None:
        self.processes = processes
        self.operator = Operator("test_operator", namespace, idle=processes.check, domain_id=domain)
        self._prefix = self.operator.node.get_namespace().rstrip("/")
        self.pressure_pa = np.full(len(CHANNEL_NAMES), math.nan)
        self._pressures_at_s = -math.inf
        self.height_m: dict[str, float] = {}
        subscribe = self.operator.node.create_subscription
        subscribe(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        subscribe(MarkerArray, "plant/finger_markers", self._on_truth, STREAM)

    @property
    def grasp(self) -> dict[str, str]:
        """What the arbiter said last."""
        return self.operator.grasp

    def health(self, name: str) -> tuple[bytes, str, dict[str, str]]:
        """Level, message and values that a node reported last; level WARN before the first report."""
        return self.operator.health.get(f"{self._prefix}/{name}", (DiagnosticStatus.WARN, "no report", {}))

    @contextmanager
    def reporting(self) -> Iterator[None]:
        """What does not happen in time fails the test with all that is known of the gripper."""
        try:
            yield
        except NodeSystemError as error:
            raise AssertionError(f"{error}\n{self.report()}") from error

    def wait_for(self, predicate: Callable[[], bool], what: str, timeout_s: float = PROCESS_WAIT_S) -> None:
        with self.reporting():
            self.operator.wait_for(predicate, timeout_s, what)

    def wait_for_phase(self, phase: str) -> None:
        self.wait_for(lambda: self.grasp.get("phase") == phase, f"phase {phase}")

    def report(self) -> str:
        """All that is known of the gripper, for the message of a test that fails."""
        age_s = time.monotonic() - self._pressures_at_s
        lines = [f"arbiter: {self.grasp}", f"pressures {age_s:.2f} s ago: {self.pressure_pa}"]
        lines += [f"{name}: {health}" for name, health in self.operator.health.items()]
        lines += [f"--- {name}\n{self.processes.log(name).read_text()[-2000:]}" for name in self.processes.processes]
        return "\n".join(lines)

    def enable(self) -> None:
        with self.reporting():
            self.operator.enable(PROCESS_WAIT_S)

    def ask(self, service: str) -> None:
        answer = self.operator.call(Trigger, service)
        assert answer.success, f"{service}: {answer.message}"

    def close_fingers(self) -> None:
        with self.reporting():
            fault = self.operator.close_fingers(timeout_s=PROCESS_WAIT_S)
        assert not fault, self.report()

    def let_go_and_reset(self) -> None:
        """Go from a fault that keeps the object back to idle."""
        self.ask("grasp/release")
        self.wait_for(lambda: (self.pressure_pa < 5e3).all(), "vented chambers")
        # The watched nodes must have said that they are well again.
        self.wait_for(lambda: self.operator.call(Trigger, "grasp/reset").success, "a reset that is accepted")
        self.wait_for_phase("idle")

    def lift(self) -> None:
        """Raise the hand by 0.1 m with what it holds."""
        self.wait_for(lambda: {"palm", "object"} <= self.height_m.keys(), "the markers of palm and object")
        low = dict(self.height_m)
        self.ask("plant/lift")
        self.wait_for(lambda: self.height_m["palm"] > low["palm"] + 0.0999, "the raised hand")
        assert self.height_m["object"] > low["object"] + 0.09

    def lower(self) -> None:
        high_m = self.height_m["palm"]
        self.ask("plant/lower")
        self.wait_for(lambda: self.height_m["palm"] < high_m - 0.0998, "the lowered hand")

    def kill(self, executable: str) -> None:
        process = self.processes.processes.pop(executable)
        process.kill()
        process.wait()
        killed_s = time.monotonic()
        self.wait_for(lambda: time.monotonic() > killed_s + UNDER_WAY_S, "what it said last")
        self.operator.health.pop(f"{self._prefix}/{executable}", None)

    def restart(self, executable: str) -> None:
        self.processes.start(executable)
        self.operator.wait_for_nodes([executable], START_S)

    def _on_chamber_states(self, message: JointState) -> None:
        self.pressure_pa = np.array(message.effort)
        self._pressures_at_s = time.monotonic()

    def _on_truth(self, message: MarkerArray) -> None:
        self.height_m.update({m.ns: m.pose.position.z for m in message.markers if m.ns in ("palm", "object")})


@pytest.fixture(scope="session")
def nursery() -> Iterator[Nursery]:
    """Executables that begin at once."""
    nursery = Nursery()
    yield nursery
    nursery.close()


@pytest.fixture
def launch(nursery: Nursery) -> Launch:
    """How executables of :func:`start` are started; a test may have them by Python's own start."""
    return nursery.launch


@pytest.fixture
def start(domain: int, log_directory: Path, launch: Launch) -> Iterator[Callable[..., Gripper]]:
    """Start executables as processes, wait until each node has reported, and return the gripper."""
    with ExitStack() as stack:

        def start_gripper(
            executables: Sequence[str] = NODES,
            *,
            arguments: dict[str, list[str]] | None = None,
            common: Sequence[str] = (),
            namespace: str = "",
            nodes: Sequence[str] | None = None,
        ) -> Gripper:
            rules = [*common, "-r", f"__ns:={namespace}"] if namespace else common
            environment = {"ROS_DOMAIN_ID": str(domain)}
            logs = log_directory / (namespace.strip("/") or "gripper")
            processes = stack.enter_context(NodeProcesses(logs, arguments, rules, executables, environment, launch))
            stack.callback(assert_that_each_ends_when_told, processes)
            gripper = Gripper(processes, namespace, domain)
            stack.callback(gripper.operator.close)
            gripper.operator.wait_for_nodes(executables if nodes is None else nodes, START_S)
            return gripper

        yield start_gripper


def assert_that_each_ends_when_told(processes: NodeProcesses) -> None:
    codes = processes.stop()
    assert set(codes.values()) <= {0}, codes
