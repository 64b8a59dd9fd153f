"""Node ``grasp_arbiter``: services, pressures and detections to set-points, by the grasp state machine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import Arbiter, Decision, Phase, load_grasp_config
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject, ModeSelector
from mbpam_ros.grasp.watch import HealthWatch
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.markers import BASE_FRAME, SHAPES
from mbpam_ros.nodes.messages import (
    MessageError,
    findings_in,
    joint_state,
    named_values,
    pose,
    pose_arrays,
    with_answer,
)
from mbpam_ros.nodes.parameters import Parameter

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: layout and pressure limit"),
    Parameter("modes", "modes.yaml", "mode file: bend azimuths of the four modes"),
    Parameter("grasp", "grasp.yaml", "grasp file: selection thresholds, grip pressures, times"),
    Parameter("pressure_sensor_node", "pressure_sensor", "name of the node that senses the pressures"),
    Parameter("valve_controller_node", "valve_controller", "name of the node that moves the valves"),
    Parameter("tick_rate_hz", 50.0, "rate of the state machine [Hz]", 5.0, 1000.0),
)

SETPOINT_REPEAT_S = 0.5

WATCHED_NODES = ("pressure_sensor", "valve_controller")
"""Nodes of the same namespace whose faults stop a grasp; without their reports none begins."""


class GraspArbiterNode(GripperNode):
    """Adapter around :class:`Arbiter`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("grasp_arbiter", PARAMETERS, **node_options)
        gripper = load_gripper(self.text("gripper"))
        config = load_grasp_config(self.text("grasp"))
        modes = load_modes(self.text("modes"))
        selector = ModeSelector(config.selection, gripper, modes)
        try:
            self._arbiter = Arbiter(
                config.arbitration, modes, selector, gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
            )
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

        self._setpoints = self.create_publisher(JointState, "pressure_setpoints", STREAM)
        self._state = self.create_publisher(DiagnosticStatus, "grasp_state", LATCHED)
        self._pose = self.create_publisher(PoseStamped, "grasp_pose", LATCHED)
        self.create_subscription(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        self.create_subscription(MarkerArray, "detections", self._on_detections, STREAM)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 20)
        for mode in MODE_NAMES:
            self._serve(f"grasp/{mode}", partial(self._arbiter.request_mode, mode))
        self._serve("grasp/auto", self._arbiter.request_auto)
        self._serve("grasp/release", self._arbiter.release)
        self._serve("grasp/stop", self._arbiter.stop)
        self._serve("grasp/reset", self._arbiter.reset)
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

    def _serve(self, name: str, request: Callable[[float], Answer]) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            result = request(self.now_s())
            # Two call sites: rclpy refuses a severity that changes at one.
            if result.accepted:
                self.get_logger().info(f"{name}: {result.reason}")
            else:
                self.get_logger().warning(f"{name} refused: {result.reason}")
            self._tick()
            return with_answer(response, result)

        self.create_service(Trigger, name, answer)

    def _tick(self) -> None:
        """Let the state machine decide; publish the decision if it changed."""
        now_s = self.now_s()
        self._watch.look(now_s)
        if (late_s := self.late_s()) > 0.0:
            self._arbiter.observe_lateness(now_s, late_s)
        self._decision = self._arbiter.tick(now_s)
        if not self._decision.changed:
            return
        stamp = self.now_stamp()
        self._publish_setpoints()
        self._publish_state(self._decision)
        if self._decision.grasp_pose is not None:
            target = self._decision.grasp_pose
            wrist = PoseStamped(pose=pose(target.position_m, target.orientation_xyzw))
            wrist.header.stamp, wrist.header.frame_id = stamp, BASE_FRAME
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
            self._arbiter.observe_pressures(self.now_s(), named_values(message, CHANNEL_NAMES, "effort"))
        except (MessageError, ValueError) as error:
            self.refuse("chamber_states", error)

    def _on_detections(self, message: MarkerArray) -> None:
        try:
            objects = [_detected_object(marker) for marker in message.markers if marker.action == Marker.ADD]
        except (MessageError, ValueError) as error:
            self.refuse("detections", error)
            return
        self._arbiter.observe_detections(self.now_s(), objects)

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


def _detected_object(marker: Marker) -> DetectedObject:
    if marker.header.frame_id != BASE_FRAME:
        raise MessageError(f"frame {marker.header.frame_id!r}; detections must be in {BASE_FRAME}")
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
    )


def main() -> int:
    """Run the node until a signal."""
    return run(GraspArbiterNode)


if __name__ == "__main__":
    sys.exit(main())
