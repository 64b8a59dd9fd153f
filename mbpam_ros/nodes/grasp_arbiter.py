"""Node ``grasp_arbiter``: services, pressures and detections to set-points, by the grasp state machine."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.client import Client
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.description.frames import Frames
from mbpam_ros.grasp.arbitration import (
    Decision,
    Phase,
    build_arbiter,
    build_holding_watch,
    load_grasp_config,
)
from mbpam_ros.grasp.confirmation import StopConfirmation
from mbpam_ros.grasp.grip_pressure import Expected
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.opening import AUTO, Command, HandState, Outcome, TwoJaws, grasp_of, outcome
from mbpam_ros.grasp.selection import DetectedObject
from mbpam_ros.grasp.watch import HealthWatch
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.answering import Reply
from mbpam_ros.nodes.gripper_action import GripperActions
from mbpam_ros.nodes.heartbeat import SILENCE_S, Instance, places
from mbpam_ros.nodes.markers import SHAPES, hidden_lengths
from mbpam_ros.nodes.messages import MessageError, findings_in, joint_state, named_values, pose, pose_arrays, seconds
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.stamps import CLOCK_TOLERANCE, StampClock, stamp_age
from mbpam_ros.nodes.transforms import FRAME_PREFIX
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.findings import SUPPLY

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: layout and pressure limit"),
    Parameter("modes", "modes.yaml", "mode file: bend azimuths of the four modes"),
    Parameter("grasp", "grasp.yaml", "grasp file: selection thresholds, grip pressures, times"),
    Parameter("pneumatics", "pneumatics.yaml", "pneumatics file: with the model iso6358 the air tells what is held"),
    Parameter("object_mass_kg", 0.0, "mass of the object to come [kg]; 0: not known", 0.0, 10.0, changeable=True),
    Parameter("object_mass_class", "", "instead: light, medium or heavy; empty: not known", changeable=True),
    Parameter("object_friction", 0.0, "its friction [1], at least; 0: as in the grasp file", 0.0, 2.0, changeable=True),
    Parameter(
        "wait_for_result",
        False,
        "grasp/auto and the modes answer once the grasp holds, or has failed; else once it has begun",
        changeable=True,
    ),
    Parameter("action_mode", AUTO, "mode of gripper actions' goals; auto: the camera chooses", changeable=True),
    Parameter("pressure_sensor_node", "pressure_sensor", "name of the node that senses the pressures"),
    Parameter("valve_controller_node", "valve_controller", "name of the node that moves the valves"),
    Parameter("object_detector_node", "object_detector", "name of the node that sees the objects"),
    Parameter("tick_rate_hz", 50.0, "rate of the state machine [Hz]", 5.0, 1000.0),
    FRAME_PREFIX,
    CLOCK_TOLERANCE,
)

SETPOINT_REPEAT_S = 0.5

CALL_LOOK_S = 0.01
"""How often the node looks what has come of its own calls, while there are any."""

CLEAR_TIMEOUT_S = 1.0

VENT_UNDER_WAY_S = 7.0
"""A request that a network loses is sent again after 3 s, and maybe once more: until then it may come. Were all reset
before, it would vent the next grasp."""

WATCHED_NODES = ("pressure_sensor", "valve_controller")
"""Nodes of the same namespace whose faults stop a grasp; without their reports none begins."""


class GraspArbiterNode(GripperNode):
    """Adapter around :class:`Arbiter`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("grasp_arbiter", PARAMETERS, **node_options)
        self._frame = Frames(self.text("frame_prefix")).base
        gripper = load_gripper(self.text("gripper"))
        config = load_grasp_config(self.text("grasp"))
        modes = load_modes(self.text("modes"))
        pneumatics = load_pneumatics(self.text("pneumatics"))
        holding = build_holding_watch(config, gripper, pneumatics, pneumatics.model)
        try:
            self._arbiter = build_arbiter(config, gripper, modes, holding)
        except ConfigError:
            raise
        except ValueError as error:
            raise ConfigError(f"{self.value('grasp')}: {error}") from error
        prefix = self.get_namespace().rstrip("/")
        self._watched = {f"{prefix}/{self.value(f'{name}_node')}": name for name in WATCHED_NODES}
        unheard = {
            source: f"no health report from {full_name} yet; start it, or name it by the parameter {source}_node"
            for full_name, source in self._watched.items()
        }
        self._watch = HealthWatch(self._arbiter, unheard, self.now_s())
        self._decision: Decision | None = None
        self._pressure_stale_s = config.arbitration.pressure_stale_s
        self._detection_stale_s = config.arbitration.detection_stale_s
        self._open_below_gauge_pa = config.arbitration.open_below_gauge_pa
        self._clock_of_pressures = StampClock(self._pressure_stale_s, self.number("clock_tolerance_s"))
        self._mass_classes = config.grip.mass_classes_kg
        self._vent_latched = False
        self._stopping: StopConfirmation | None = None
        self._vents_under_way = 0
        self._awaited: list[Callable[[], bool]] = []

        self._setpoints = self.create_publisher(JointState, "pressure_setpoints", STREAM)
        self._state = self.create_publisher(DiagnosticStatus, "grasp_state", LATCHED)
        self._pose = self.create_publisher(PoseStamped, "grasp_pose", LATCHED)
        self.create_subscription(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        self.create_subscription(MarkerArray, "detections", self._on_detections, STREAM)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 20)
        for mode in MODE_NAMES:
            self._serve_grasp(f"grasp/{mode}", partial(self._arbiter.request_mode, mode))
        self._serve_grasp("grasp/auto", self._on_auto)
        self._serve("grasp/release", self._arbiter.release)
        self._serve("grasp/check", self._arbiter.check)
        if holding.listens_to_air:
            self.create_subscription(JointState, "valve_commands", self._on_valve_commands, STREAM)
        self.serve_later(Trigger, "grasp/stop", self._on_stop)
        self.serve_later(Trigger, "grasp/reset", self._on_reset)
        # Made now: an answer to a client that was made just before its call may be lost.
        self._vent: Client = self.create_client(Trigger, "valve_controller/vent")
        self._clear: Client = self.create_client(Trigger, "valve_controller/clear")
        self.create_subscription(DiagnosticStatus, "valve_controller/state", self._on_valves, LATCHED)
        for source in WATCHED_NODES:
            self.watch_node(self.text(f"{source}_node"), partial(self._on_life, source))
        self.watch_node(self.text("object_detector_node"), self._on_detectors)
        self._calls = self.create_timer(CALL_LOOK_S, self._look_at_calls, clock=self._steady_clock)
        self._calls.cancel()
        self._jaws: TwoJaws | None = None
        self._actions = GripperActions(self, self)
        if self._actions.active:
            self._jaws = TwoJaws(self._arbiter, gripper, modes)
        self.create_timer(1.0 / self.number("tick_rate_hz"), self._tick)
        # A valve controller started anew has missed the last change.
        self.create_timer(SETPOINT_REPEAT_S, self._publish_setpoints)

    def health(self) -> Health:
        """ERROR while a fault is latched, WARN while idle and not ready for a grasp."""
        if self._decision is None:
            return Health(DiagnosticStatus.WARN, "starting")
        phase, reason = self._decision.phase, self._decision.reason
        level = DiagnosticStatus.ERROR if phase is Phase.FAULT else DiagnosticStatus.OK
        obstacle = self._arbiter.obstacle(self.now_s()) if phase is Phase.IDLE else None
        if obstacle is not None:
            level, reason = DiagnosticStatus.WARN, f"not ready: {obstacle}"
        return Health(level, f"{phase.value}: {reason}", self._decision.key_values())

    def _on_auto(self, time_s: float) -> Answer:
        """Let the camera choose; what the parameters tell of the object decides how hard it is gripped."""
        return self._objection_to_expected() or self._arbiter.request_auto(time_s)

    def _objection_to_expected(self) -> Answer | None:
        """Have the arbiter expect the object that the parameters tell of; return why there can be none, or None."""
        try:
            self._arbiter.expect(self._expected())
        except ValueError as error:
            return Answer(False, str(error))
        return None

    def _expected(self) -> Expected:
        mass_kg, name = self.number("object_mass_kg") or None, self.text("object_mass_class")
        lightest_kg, heaviest_kg = self._mass_classes.named(name) if name else (mass_kg, mass_kg)
        return Expected(heaviest_kg, self.number("object_friction") or None, lightest_kg)

    def _on_valve_commands(self, message: JointState) -> None:
        try:
            spool = named_values(message, CHANNEL_NAMES, "position", optional=SUPPLY)[: len(CHANNEL_NAMES)]
            self._arbiter.observe_valves(self.now_s(), spool)
        except (MessageError, ValueError) as error:
            self.refuse("valve_commands", error)

    def rivals_changed(self) -> None:
        """Take another arbiter beside this one for a fault; neither knows what the other has asked for."""
        message = f"another {self.get_fully_qualified_name()} runs: {places(self.rivals)}; end one of them"
        self._arbiter.observe_health(self.now_s(), "grasp_arbiter", not self.rivals, message)

    def _on_life(self, source: str, alive: tuple[Instance, ...]) -> None:
        """Take notice of how many nodes of a name live."""
        if len(alive) == 1:
            self._watch.find_right(source)
        elif alive:
            message = f"{len(alive)} of this name run: {places(alive)}; end one of them"
            self._watch.find_wrong(self.now_s(), source, message)
        else:
            self._watch.find_wrong(self.now_s(), source, f"no sign of life for {SILENCE_S:g} s")
        self._tick()

    def _on_detectors(self, alive: tuple[Instance, ...]) -> None:
        """What a detector saw that lives no longer starts nothing."""
        if not alive:
            self._arbiter.forget_detections(f"object_detector gives no sign of life for {SILENCE_S:g} s")

    def _serve(self, name: str, request: Callable[[float], Answer]) -> None:
        def answer(_: Trigger.Request) -> Answer:
            return self._said(name, request(self.now_s()))

        self.serve(Trigger, name, answer)

    def _serve_grasp(self, name: str, request: Callable[[float], Answer]) -> None:
        """Answer at once, or where ``wait_for_result`` says so with what became of the grasp."""

        def answer(_: Trigger.Request, reply: Reply) -> None:
            begun = self._said(name, request(self.now_s()))
            if begun.accepted and self.value("wait_for_result"):
                self._await(partial(self._told_result, reply))
            else:
                reply(begun)

        self.serve_later(Trigger, name, answer)

    def _told_result(self, reply: Reply) -> bool:
        """Reply that the grasp holds, or why it does not; return False while it closes."""
        if self._decision is None or self._decision.phase is Phase.CLOSING:
            return False
        phase, reason = self._decision.phase, self._decision.reason
        reply(Answer(phase is Phase.HOLDING, f"{phase.value}: {reason}"))
        return True

    def _said(self, name: str, answer: Answer) -> Answer:
        """Log an answer, and let the state machine act upon the request before it is given."""
        # Two call sites: rclpy refuses a severity that changes at one.
        if answer.accepted:
            self.get_logger().info(f"{name}: {answer.reason}")
        else:
            self.get_logger().warning(f"{name} refused: {answer.reason}")
        self._tick()
        return answer

    # The hand of the gripper actions

    def begin_command(self, opening_m: float, force_n: float) -> tuple[Answer, Command]:
        """Open or close as a gripper with two jaws is told to."""
        assert self._jaws is not None
        mode = self.text("action_mode")
        opens = self._jaws.opens(mode, opening_m)
        answer = self._objection_to_expected() if mode == AUTO and not opens else None
        if answer is None:
            answer = self._jaws.request(self.now_s(), mode, opening_m, force_n)
        answer = self._said("gripper goal", answer)
        assert self._decision is not None
        return answer, Command(opens, grasp_of(self._decision))

    def outcome_of(self, command: Command) -> Outcome:
        """Return how far a command has come, by the last decision."""
        assert self._decision is not None
        return outcome(command, self._decision)

    def let_go(self) -> None:
        """Open: the command is cancelled."""
        self._said("gripper goal cancelled", self._arbiter.release(self.now_s()))

    def hand_state(self) -> HandState:
        """Return opening and force at the pressures of now."""
        assert self._jaws is not None and self._decision is not None
        return self._jaws.state(self._decision.mode or self.text("action_mode"))

    # Requests that another node has to confirm

    def _on_stop(self, _: Trigger.Request, reply: Reply) -> None:
        """Stop at once; answer when it is known what came of it."""
        self._arbiter.stop(self.now_s())
        self._tick()
        if self._stopping is not None:  # asked for twice: both get what comes of the first
            stopping = self._stopping
        else:
            before_pa = self._arbiter.pressure_gauge_pa
            stopping = self._stopping = StopConfirmation(time.monotonic(), before_pa, self._open_below_gauge_pa)
            self._ask_for_vent(stopping.acknowledge)

        def answered() -> bool:
            verdict = stopping.verdict(time.monotonic(), self._arbiter.pressure_gauge_pa)
            if verdict is None:
                return False
            self._stopping = None
            self.get_logger().warning(f"grasp/stop: {verdict.reason}")
            reply(verdict)
            return True

        self._await(answered)

    def _on_reset(self, _: Trigger.Request, reply: Reply) -> None:
        """Have the vent lifted where it is latched, then reset.

        The word that it is latched may be lost on the way here: whoever has a vent to lift is asked in any case.
        """
        now_s = self.now_s()
        to_clear = self._arbiter.phase is Phase.FAULT and (self._vent_latched or self._clear.service_is_ready())
        if not to_clear or self._arbiter.objection_to_reset(now_s) is not None:
            reply(self._said("grasp/reset", self._arbiter.reset(now_s)))
            return
        if self._vents_under_way > 0:
            refusal = "the vent that grasp/stop asked for may still be on its way to valve_controller; ask again"
            reply(self._said("grasp/reset", Answer(False, refusal)))
            return
        cleared: list[bool] = []
        self._call(self._clear, lambda: cleared.append(True))
        until_s = time.monotonic() + CLEAR_TIMEOUT_S

        def answered() -> bool:
            if cleared:
                self._vent_latched = False
                reply(self._said("grasp/reset", self._arbiter.reset(self.now_s())))
            elif time.monotonic() > until_s:
                refusal = Answer(False, "valve_controller does not answer: the vent stays latched there")
                reply(self._said("grasp/reset", refusal))
            else:
                return False
            return True

        self._await(answered)

    def _ask_for_vent(self, acknowledge: Callable[[], None]) -> None:
        """Have the valves vent, and remember that they were asked until they answer."""

        def ended() -> None:
            self._vents_under_way -= 1

        if self._call(self._vent, acknowledge, VENT_UNDER_WAY_S, ended):
            self._vents_under_way += 1

    def _call(
        self,
        client: Client,
        done: Callable[[], None],
        timeout_s: float = CLEAR_TIMEOUT_S,
        ended: Callable[[], None] = lambda: None,
    ) -> bool:
        """Call a service of the valve controller, if it is there; return whether it is.

        Args:
            done: called if it says that it has done it.
            timeout_s: for how long the answer counts.
            ended: called when there is an answer or none comes any more.
        """
        if not client.service_is_ready():
            return False
        future: Any = client.call_async(Trigger.Request())
        until_s = time.monotonic() + timeout_s

        def answered() -> bool:
            if future.done():
                answer = future.result()
                if answer is not None and answer.success:
                    done()
            elif time.monotonic() <= until_s:
                return False
            else:
                client.remove_pending_request(future)
            ended()
            return True

        self._await(answered)
        return True

    def _await(self, answered: Callable[[], bool]) -> None:
        self._awaited.append(answered)
        self._calls.reset()

    def _look_at_calls(self) -> None:
        awaited, self._awaited = self._awaited, []
        self._awaited += [answered for answered in awaited if not answered()]
        if not self._awaited:
            self._calls.cancel()

    def _on_valves(self, state: DiagnosticStatus) -> None:
        """Take notice of a vent that is latched at the valves, be it from before this node was started."""
        reason = next((item.value for item in state.values if item.key == "vent_latched"), "")
        self._vent_latched = bool(reason)
        if reason:
            self._arbiter.observe_vent(self.now_s(), reason)
            self._tick()

    def _tick(self) -> None:
        """Let the state machine decide; publish the decision if it changed."""
        now_s = self.now_s()
        self._watch.look(now_s)
        if (late_s := self.late_s()) > 0.0:
            self._arbiter.observe_lateness(now_s, late_s)
        self._decision = self._arbiter.tick(now_s)
        self._publish_decision(self._decision)
        self._actions.look()

    def _publish_decision(self, decision: Decision) -> None:
        """Publish it, if it changed."""
        if not decision.changed:
            return
        stamp = self.now_stamp()
        self._publish_setpoints()
        self._publish_state(decision)
        if decision.grasp_pose is not None:
            target = decision.grasp_pose
            wrist = PoseStamped(pose=pose(target.position_m, target.orientation_xyzw))
            wrist.header.stamp, wrist.header.frame_id = stamp, self._frame
            self._pose.publish(wrist)
        self.publish_health_change()

    def _publish_setpoints(self) -> None:
        if self._decision is not None and self._decision.informed:
            stamp = self.now_stamp()
            self._setpoints.publish(joint_state(stamp, CHANNEL_NAMES, effort=self._decision.setpoint_gauge_pa))

    def _publish_state(self, decision: Decision) -> None:
        # An arbiter that knows no pressures cannot know whether another one before it has stopped the gripper.
        if not decision.informed:
            return
        self._state.publish(
            DiagnosticStatus(
                level=DiagnosticStatus.ERROR if decision.phase is Phase.FAULT else DiagnosticStatus.OK,
                name=f"{self.get_namespace().rstrip('/')}/grasp",
                message=f"{decision.phase.value}: {decision.reason}",
                values=[KeyValue(key=key, value=value) for key, value in decision.key_values().items()],
            )
        )

    def _on_chamber_states(self, message: JointState) -> None:
        try:
            pressure_gauge_pa = named_values(message, CHANNEL_NAMES, "effort")
            self._clock_of_pressures.sample(seconds(message.header.stamp), self.now_s(), self.clock_s())
            self._arbiter.observe_pressures(self.now_s(), pressure_gauge_pa)
        except (MessageError, ValueError) as error:
            self.refuse("chamber_states", error)

    def _on_detections(self, message: MarkerArray) -> None:
        try:
            stamps_s = [seconds(marker.header.stamp) for marker in message.markers]
            age_s = 0.0
            if stamps_s:
                now_s, tolerance_s = seconds(self.now_stamp()), self.number("clock_tolerance_s")
                age_s = stamp_age(min(stamps_s), now_s, self._detection_stale_s, tolerance_s)
            added = [marker for marker in message.markers if marker.action == Marker.ADD]
            objects = [_detected_object(marker, self._frame) for marker in added]
        except (MessageError, ValueError) as error:
            self.refuse("detections", error)
            return
        self._arbiter.observe_detections(self.now_s(), objects, age_s)

    def _on_diagnostics(self, report: DiagnosticArray) -> None:
        for status in report.status:
            source = self._watched.get(status.name)
            if source is not None:
                well = status.level in (DiagnosticStatus.OK, DiagnosticStatus.WARN)
                if source == "valve_controller":
                    self._arbiter.observe_findings(self.now_s(), findings_in(status))
                air_on = not any(item.key == "enabled" and item.value == "false" for item in status.values)
                self._watch.report(self.now_s(), source, well, status.message, air_on)
        self.publish_health_change()


def _detected_object(marker: Marker, frame: str) -> DetectedObject:
    if marker.header.frame_id != frame:
        raise MessageError(f"frame {marker.header.frame_id!r}; detections must be in {frame}")
    if marker.type not in SHAPES:
        raise MessageError(f"marker type {marker.type} is none of {', '.join(SHAPES.values())}")
    position, orientation = pose_arrays(marker.pose)
    return DetectedObject(
        label=marker.text or marker.ns,
        shape=SHAPES[marker.type],
        size_m=(marker.scale.x, marker.scale.y, marker.scale.z),
        position_m=tuple(position),
        orientation_xyzw=tuple(orientation),
        # A float32 field: 1.0 may arrive a rounding above.
        confidence=min(marker.color.a, 1.0),
        hidden_m=hidden_lengths(marker),
    )


def main() -> int:
    """Run the node until a signal."""
    return run(GraspArbiterNode)


if __name__ == "__main__":
    sys.exit(main())
