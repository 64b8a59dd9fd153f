"""How a node lives: start, spin, stop on SIGINT or SIGTERM with exit code 0, and report its health at 1 Hz."""

from __future__ import annotations

import gc
import inspect
import signal
import sys
import time
import warnings
from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypedDict

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.timer import Timer
from std_msgs.msg import Header

from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.nodes.answering import AnsweringService, Reply
from mbpam_ros.nodes.command_line import answer, node_name, rules_of_node
from mbpam_ros.nodes.compiling import STOP_SIGNALS, compilation_announced, stop_signals_end_the_process
from mbpam_ros.nodes.exit_timer import exits_after
from mbpam_ros.nodes.heartbeat import LIFE_LOOK_S, PERIOD_S, Instance, SignsOfLife, alive_topic, places
from mbpam_ros.nodes.lateness import Lateness
from mbpam_ros.nodes.messages import time_stamp
from mbpam_ros.nodes.parameters import Parameter, declare_parameters
from mbpam_ros.nodes.protection import unprotected, without_security

if TYPE_CHECKING:
    from typing_extensions import Unpack

STREAM = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
"""What data topics are published with, so that any subscription matches; and for subscriptions to requests and images,
of which each one counts."""

NEWEST = qos_profile_sensor_data
"""For subscriptions to the 100 Hz streams: the next sample is worth more than a late one."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For a state that a late subscriber must see."""

LOOK_PERIOD_S = 0.1
"""How often a process looks whether it has to end."""

SPIN_TIMEOUT_S = 1.0
"""How often a spin returns. One without a time-out never runs Python's signal handlers in this executor."""

BUILDING_STOPS_WITHIN_S = 0.5
"""A stop signal while nodes are built, air off and no valve commanded, ends the process after this."""

TEAR_DOWN_TIMEOUT_S = 5.0
"""Leaving the graph takes milliseconds. When peers leave at the same moment, Fast DDS 3.2 may wait for one of its own
callbacks for ever, at full load and with the interpreter locked (as in its issue 6513): the process then just ends."""

WARNING_PERIOD_S = 1.0

CLOCK_PATIENCE_S = 5.0

LATENESS_MEMORY_S = 1.0

LATE_S = 0.1
"""A process that was held up for longer says so beside what it reports: valves and sensor time out at twice this."""


@dataclass
class Health:
    """What a node says of itself in ``/diagnostics``.

    Args:
        level: one of DiagnosticStatus.OK, WARN, ERROR.
        message: one line.
        values: key-values with units in the keys.
    """

    level: bytes = DiagnosticStatus.OK
    message: str = "ok"
    values: dict[str, str] = field(default_factory=dict)


@dataclass
class _WatchedNode:
    """A node that another depends on: what is heard of it, and whom to tell."""

    signs: SignsOfLife
    changed: Callable[[tuple[Instance, ...]], None]
    alive: tuple[Instance, ...] = ()


class NodeOptions(TypedDict, total=False):
    """What rclpy's ``Node`` takes beside its name, as far as anybody here gives it."""

    context: Context
    cli_args: list[str]
    namespace: str
    use_global_arguments: bool
    parameter_overrides: list[RosParameter]


class GripperNode(Node):
    """A node with declared parameters, a 1 Hz health report, and counted, throttled warnings about bad input."""

    _destroyed = False

    def __init__(self, name: str, parameters: Sequence[Parameter], **node_options: Unpack[NodeOptions]) -> None:
        super().__init__(name, **node_options)
        try:
            declare_parameters(self, parameters)
        except Exception:
            self.destroy_node()
            raise
        self.refused_inputs = 0
        self.failure: str | None = None
        self._reported_level: bytes | None = None
        self._judged: Hashable = None
        self._warn_again_at: dict[str, float] = {}
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._answering_services: list[AnsweringService] = []
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self.publish_health)
        if self.value("use_sim_time"):
            self.create_timer(CLOCK_PATIENCE_S, self._warn_of_missing_clock, clock=self._steady_clock)
        self.instance = Instance.of_this_process()
        self.rivals: tuple[Instance, ...] = ()
        self._sign_of_life = Header(frame_id=str(self.instance))
        self._beats = Lateness(PERIOD_S, LATENESS_MEMORY_S)
        self._watched_nodes: list[_WatchedNode] = []
        self._alive = self.create_publisher(Header, alive_topic(self.get_name()), STREAM)
        self._same_name = self.signs_of(self.get_name())
        self.create_timer(PERIOD_S, self._beat, clock=self._steady_clock)

    @abstractmethod
    def health(self) -> Health:
        """Return the node's present health."""

    def value(self, parameter: str) -> bool | int | float | str:
        """Return the present value of a declared parameter."""
        return self.get_parameter(parameter).value

    def number(self, parameter: str) -> float:
        """Return the present value of a parameter that is a number."""
        return float(self.value(parameter))

    def whole(self, parameter: str) -> int:
        """Return the present value of a parameter that is a whole number."""
        return int(self.value(parameter))

    def text(self, parameter: str) -> str:
        """Return the present value of a parameter that is text."""
        return str(self.value(parameter))

    def create_timer(  # type: ignore[override]  # rclpy also takes callbacks that want to be told the time
        self,
        period_s: float,
        callback: Callable[[], None],
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
    ) -> Timer:
        """Create a timer; options as for rclpy's.

        The executor looks at a callback's signature at every call, to see whether it takes the timer's times: given
        here once, that costs a tenth of what it does for a method.
        """

        def call() -> None:
            if not self._destroyed:  # the executor may have found it due before
                callback()

        vars(call)["__signature__"] = inspect.signature(call)
        return super().create_timer(period_s, call, callback_group, clock)

    def destroy_node(self) -> None:
        """Leave the graph; timers that are due already do nothing more."""
        self._destroyed = True
        super().destroy_node()

    def now_s(self) -> float:
        """Return the node's time [s], for how old something is.

        Simulated under ``use_sim_time``, else of a clock that nobody can set.
        """
        return self.get_clock().now().nanoseconds * 1e-9 if self.value("use_sim_time") else time.monotonic()

    def clock_s(self) -> float:
        """Return the time with which the stamps of a stream are compared [s]; 0 under ``use_sim_time`` for none.

        There one process makes both, and with a simulation set back a sample may come before the clock's own message.
        """
        return 0.0 if self.value("use_sim_time") else time.time()

    def now_stamp(self) -> Time:
        """Return the node's time as messages carry it."""
        # The wall clock read here costs a fifth of asking ROS for it.
        return self.get_clock().now().to_msg() if self.value("use_sim_time") else time_stamp(time.time())

    def late_s(self) -> float:
        """Return for how long this process was held up within the last second [s]; 0 for less than is worth a word."""
        if self.value("use_sim_time"):  # simulated time waits for the computer
            return 0.0
        worst_s = self._beats.worst_s(time.monotonic())
        return worst_s if worst_s > LATE_S else 0.0

    def signs_of(self, node_name: str) -> SignsOfLife:
        """Return what is heard of the nodes of a name in this namespace."""
        signs = SignsOfLife()
        hear = lambda message: signs.hear(Instance.read(message.frame_id))  # noqa: E731
        self.create_subscription(Header, alive_topic(node_name), hear, NEWEST)
        return signs

    def watch_node(self, node_name: str, changed: Callable[[tuple[Instance, ...]], None]) -> None:
        """Have ``changed`` called with the runs of a node that are alive, whenever these change.

        Before its first sign of life nothing is called: it may be none of ours, and give none.
        """
        if not self._watched_nodes:
            self.create_timer(LIFE_LOOK_S, self._look_who_lives, clock=self._steady_clock)
        self._watched_nodes.append(_WatchedNode(self.signs_of(node_name), changed))

    def _look_who_lives(self) -> None:
        now_s = time.monotonic()
        held_up_s = self._beats.worst_s(now_s)
        for watched in self._watched_nodes:
            alive = watched.signs.look(now_s, held_up_s)
            if alive != watched.alive:
                watched.alive = alive
                watched.changed(alive)

    def rivals_changed(self) -> None:
        """Do what must be done when another node of this name appears or goes; ``self.rivals`` has them."""

    def serve(self, service_type: type, name: str, answer: Callable[[Any], Answer]) -> None:
        """Offer a service whose request is answered at once."""
        self.serve_later(service_type, name, lambda request, reply: reply(answer(request)))

    def serve_later(self, service_type: type, name: str, handle: Callable[[Any, Reply], None]) -> None:
        """Offer a service whose answer is given to ``reply``, at once or later."""
        self._answering_services.append(AnsweringService(self, service_type, name, handle))

    def _beat(self) -> None:
        """Give a sign of life, look for another node of this name, and send what answers wait."""
        now_s = time.monotonic()
        self._beats.call(now_s)
        self._sign_of_life.stamp = self.now_stamp()
        self._alive.publish(self._sign_of_life)
        alive = self._same_name.look(now_s, self._beats.worst_s(now_s))
        rivals = tuple(each for each in alive if each != self.instance)
        if rivals != self.rivals:
            self.rivals = rivals
            self.rivals_changed()
            self.publish_health()
        for service in self._answering_services:
            service.send_waiting()

    def refuse(self, source: str, error: object) -> None:
        """Count an input that was not applied and warn about its source, at most once a second or as the error says."""
        self.refused_inputs += 1
        now = time.monotonic()
        if now >= self._warn_again_at.get(source, now):
            self._warn_again_at[source] = now + getattr(error, "repeat_s", WARNING_PERIOD_S)
            self.get_logger().warning(f"{source} refused: {error}")

    def fail(self, error: object) -> None:
        """Report, at once, that the node cannot go on; :func:`run` then ends the process with exit code 1."""
        self.failure = f"{self.get_name()}: {error}"
        self.publish_health()

    def leave(self) -> None:
        """Do what must be done before the node ends on a signal or a failure, e.g. a last command."""

    def publish_health(self) -> None:
        """Publish the health report now."""
        health = self._present_health()
        self._reported_level, self._judged = health.level, None
        values = {**health.values, "refused_inputs": str(self.refused_inputs)}
        message, late_s = health.message, self.late_s()
        if late_s > 0.0:
            values["late_ms"] = f"{1e3 * late_s:.0f}"
            if health.level != DiagnosticStatus.OK:
                message = f"this computer ran {1e3 * late_s:.0f} ms late: {message}"
        status = DiagnosticStatus(
            level=health.level,
            name=self.get_fully_qualified_name(),
            message=message,
            hardware_id=self.get_namespace().strip("/") or "gripper",
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.now_stamp()
        self._diagnostics.publish(report)

    def _warn_of_missing_clock(self) -> None:
        """Speak while time stands still and every other timer is silent."""
        if self.now_s() == 0.0:
            self.get_logger().warning("use_sim_time is set and nothing comes on /clock: time stands still")

    def publish_health_change(self, cause: Hashable = None) -> None:
        """Publish the health report at once if its level changed since the last one.

        Args:
            cause: what the level depends on where a sample changes it; while it stays the same nothing is worked out.
        """
        if cause is not None and cause == self._judged:
            return
        self._judged = cause
        if self._present_health().level != self._reported_level:
            self.publish_health()

    def _present_health(self) -> Health:
        if self.failure:
            return Health(DiagnosticStatus.ERROR, self.failure)
        health = self.health()
        if not self.rivals:
            return health
        twice = f"another node {self.get_fully_qualified_name()} runs: {places(self.rivals)}; end one of them"
        return Health(DiagnosticStatus.ERROR, twice, health.values)


def run(*factories: Callable[..., GripperNode], arguments: Sequence[str] | None = None) -> int:
    """Run nodes in this process until SIGINT, SIGTERM or a failure.

    Args:
        factories: the node classes, or what builds one node each in the default context and takes rclpy's options.
        arguments: command line with its ROS arguments; ``sys.argv`` by default.

    Returns:
        Exit code: 0 after a signal or ``--help``, 1 after a node failed (``GripperNode.fail``), 2 for arguments or a
        configuration that cannot be used. What went wrong goes to standard error as one line.
    """
    given = sys.argv if arguments is None else arguments
    code = answer(given, factories)
    if code is not None:
        return code
    stop_requested = _catch_stop_signals()
    # What rclpy says besides when ROS refuses a node.
    warnings.filterwarnings("ignore", "Failed to fini rosout publisher", RuntimeWarning)
    if (warning := unprotected()) is not None:
        print(f"warning: {warning}", file=sys.stderr)
    try:
        rclpy.init(args=None if arguments is None else list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy's own errors: a file of parameters or a rule it cannot read
        print(f"error: {without_security(error) or f'ROS arguments: {error}'}", file=sys.stderr)
        return 2
    executor = EventsExecutor()
    nodes: list[GripperNode] = []
    code = 1
    try:
        code = _live(executor, nodes, factories, given, stop_requested)
    finally:
        with exits_after(TEAR_DOWN_TIMEOUT_S, code):
            for node in nodes:
                node.leave()
            executor.shutdown()
            for node in nodes:
                node.destroy_node()
            rclpy.try_shutdown()
    return code


def _live(
    executor: Executor,
    nodes: list[GripperNode],
    factories: Sequence[Callable[..., GripperNode]],
    arguments: Sequence[str],
    stop_requested: Callable[[], bool],
) -> int:
    """Build the nodes into ``nodes``, spin them until they have to end, and return the exit code."""
    try:
        with stop_signals_end_the_process(BUILDING_STOPS_WITHIN_S, 0), compilation_announced(_say):
            for factory in factories:
                if stop_requested():  # before the block, which sees what comes in it
                    return 0
                own = rules_of_node(arguments, node_name(factory))
                nodes.append(factory(cli_args=own) if own else factory())
                executor.add_node(nodes[-1])
        _do_now_what_would_hold_up_the_valves()
        ended: Future[None] = Future()

        def look() -> None:
            if not ended.done() and (stop_requested() or any(node.failure for node in nodes)):
                ended.set_result(None)

        nodes[0].create_timer(LOOK_PERIOD_S, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        # A timer looks, because a spin does not return at its time-out while callbacks wait, as in lock step.
        while not ended.done():
            executor.spin_until_future_complete(ended, timeout_sec=SPIN_TIMEOUT_S)
        failure = next((node.failure for node in nodes if node.failure), None)
        if failure is not None:
            print(f"error: {failure}", file=sys.stderr)
            return 1
        return 0
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except RuntimeError as error:
        refusal = without_security(error)
        if refusal is None:
            raise
        print(f"error: {refusal}", file=sys.stderr)
        return 2


def _say(line: str) -> None:
    get_logger("mbpam_ros").info(line)


def _do_now_what_would_hold_up_the_valves() -> None:
    """Spend, before the first tick, the tenths of a second that two things cost once all modules are loaded."""
    # A full collection walks everything that was loaded: 90 ms. It stays anyway.
    gc.collect()
    gc.freeze()
    # rclpy's logger asks for its caller's module. The first to ask has the files of all modules looked up: 90 ms in the
    # answer to the first grasp, 0.2 s on a busy machine.
    inspect.getmodule(inspect.currentframe())


def _catch_stop_signals() -> Callable[[], bool]:
    """Return whether SIGINT or SIGTERM has come.

    Instead of rclpy's handlers, which invalidate the context under the callback that runs at that moment.
    """
    received: list[int] = []
    for stop_signal in STOP_SIGNALS:
        signal.signal(stop_signal, lambda number, _: received.append(number))
    return lambda: bool(received)
