"""Node ``valve_controller``: pressure set-points and measured pressures to spool openings."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, Health, NodeOptions, run  # isort: skip
import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.responses import goes_on
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.air_node import INACTIVE, AirNode
from mbpam_ros.nodes.heartbeat import Instance, places
from mbpam_ros.nodes.messages import JointStateForm, MessageError, named_values, seconds
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.publishers import rival_publishers
from mbpam_ros.nodes.stamps import CLOCK_TOLERANCE, StampClock, Waiting
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import ControllerInputError, SetpointError
from mbpam_ros.pneumatics.findings import SUPPLY
from mbpam_ros.pneumatics.valve_guard import GuardedValves, ValveCommand

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: pressure limit and over-pressure"),
    Parameter("pneumatics", "pneumatics.yaml", "pneumatics file: gains, limits and watchdog of the loops"),
    Parameter("enable_at_start", False, "follow set-points from the start, without valve_controller/enable"),
    Parameter("supply_valve", True, "command the valve before all others, by the name supply; false: there is none"),
    Parameter("watchdog_rate_hz", 50.0, "how often silence of the pressures is looked for [Hz]", 10.0, 1000.0),
    Parameter("grasp_arbiter_node", "grasp_arbiter", "name of the node that decides"),
    CLOCK_TOLERANCE,
)

SOLE_PUBLISHER_TOPICS = ("transducers", "chamber_states", "pressure_setpoints", "grasp_state", "valve_commands")
"""What moves air, and what it is moved by: two who publish one of these are a fault."""

PUBLISHERS_LOOK_S = 0.25


class ValveControllerNode(AirNode):
    """Adapter around :class:`GuardedValves`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("valve_controller", PARAMETERS, **node_options)

    def configure(self) -> None:
        """Read the files and open topics and services.

        Raises:
            ConfigError: wrong keys or values.
        """
        gripper = load_gripper(self.text("gripper"))
        config = load_pneumatics(self.text("pneumatics"))
        limits = gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
        try:
            on = bool(self.value("enable_at_start"))
            self._valves = GuardedValves(config, *limits, switched_on=on, gas_law=gripper.gas_law)
        except ValueError as error:
            raise ConfigError(f"{self.value('gripper')} against {self.value('pneumatics')}: {error}") from error
        self._hold_time_s = config.controller.hold_time_s
        self._clock_of_pressures = StampClock(config.controller.watchdog_s, self.number("clock_tolerance_s"))
        self._waiting = Waiting()
        self._clock_of_setpoints = StampClock(tolerance_s=self.number("clock_tolerance_s"))
        self._switch = self._valves.switch
        self._has_supply_valve = bool(self.value("supply_valve"))
        if not self._has_supply_valve:
            self.get_logger().info("there is no supply valve (parameter supply_valve): nothing can cut the supply")

        self._commands = self.create_publisher(JointState, "valve_commands", STREAM)
        self._openings = JointStateForm((*CHANNEL_NAMES, SUPPLY) if self._has_supply_valve else CHANNEL_NAMES)
        self._state = self.create_publisher(DiagnosticStatus, "valve_controller/state", LATCHED)
        self._publishers_contested: str | None = None
        self.create_subscription(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        self.create_subscription(JointState, "pressure_setpoints", self._on_setpoints, STREAM)
        self.create_subscription(DiagnosticStatus, "grasp_state", self._on_grasp_state, LATCHED)
        self.serve(SetBool, "valve_controller/enable", self._on_enable)
        self.serve(
            Trigger, "valve_controller/vent", lambda _: self._change(self._switch.vent("asked for by an operator"))
        )
        self.serve(Trigger, "valve_controller/clear", lambda _: self._change(self._switch.clear()))
        self.watch_node(self.text("grasp_arbiter_node"), self._on_arbiters)
        self.create_timer(1.0 / self.number("watchdog_rate_hz"), self._on_silence)
        self.create_timer(PUBLISHERS_LOOK_S, self._look_at_publishers, clock=self._steady_clock)
        self._publish_state()

    def health(self) -> Health:
        """ERROR with the channels at fault; WARN while the air is off."""
        findings = self._valves.findings
        faults = {name: str(finding) for finding in findings for name in finding.channels}
        air = self._switch.air
        values = {**self._air_values(), **faults}
        if findings:
            harmless = all(goes_on(finding.fault) for finding in findings)
            level = DiagnosticStatus.WARN if harmless else DiagnosticStatus.ERROR
            return Health(level, f"{len(faults)} channels at fault: {findings[0].text}", values)
        if self._switch.objection is not None:
            return Health(DiagnosticStatus.ERROR, self._switch.objection, values)
        if air is not Air.REGULATE:
            return Health(DiagnosticStatus.WARN, f"{air.value} after a stop or fault; see grasp_state", values)
        if not self._switch.switched_on:
            return Health(DiagnosticStatus.WARN, "air is off; call valve_controller/enable", values)
        return Health(message="16 loops running", values=values)

    def let_air_flow(self, on: bool) -> Answer:
        """Switch the air on, if nothing speaks against it, or off, and then refuse whoever would switch it on."""
        self._switch.unbar()
        answer = self._switch.switch(on)
        if not (on and answer.accepted):
            self._switch.bar(INACTIVE)
        return self._change(answer)

    def objection_to_cleanup(self) -> str | None:
        """A vent is latched until it is cleared, and would be forgotten."""
        reason = self._switch.vent_reason
        return f"all is vented ({reason}); call grasp/reset first" if reason else None

    def leave(self) -> None:
        """Close the valves (or vent, where all vents): nobody will move them afterwards."""
        self._publish(self.now_stamp(), self._valves.parting)

    def rivals_changed(self) -> None:
        """Move no air while another valve controller commands the same valves."""
        rivals = f"another {self.get_fully_qualified_name()} runs: {places(self.rivals)}" if self.rivals else None
        self._contest("name", rivals)

    def _on_arbiters(self, alive: tuple[Instance, ...]) -> None:
        """Take notice of how many arbiters live."""
        if alive:
            self._switch.find_arbiter()
        else:
            self._switch.lose_arbiter()
        name = self.text("grasp_arbiter_node")
        self._contest("arbiters", f"{len(alive)} nodes {name} run: {places(alive)}" if len(alive) > 1 else None)

    def _look_at_publishers(self) -> None:
        found = rival_publishers(self, SOLE_PUBLISHER_TOPICS)
        if found != self._publishers_contested:
            self._publishers_contested = found
            self._contest("publishers", found)

    def _contest(self, by: str, reason: str | None) -> None:
        self._switch.contest(by, reason)
        self._publish_state()
        self.publish_health()

    def _change(self, answer: Answer) -> Answer:
        """Tell of a change before its answer does."""
        self._publish_state()
        self.publish_health()
        return answer

    def _air_values(self) -> dict[str, str]:
        return {
            "enabled": str(self._switch.switched_on).lower(),
            "air": self._switch.air.value,
            "vent_latched": self._switch.vent_reason,
        }

    def _publish_state(self) -> None:
        values = self._air_values()
        air = self._switch.air
        level = DiagnosticStatus.OK if air is Air.REGULATE else DiagnosticStatus.WARN
        self._state.publish(
            DiagnosticStatus(
                level=level,
                name=f"{self.get_namespace().rstrip('/')}/valves",
                message=self._switch.objection or self._switch.vent_reason or air.value,
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        )

    def _on_setpoints(self, message: JointState) -> None:
        try:
            self._clock_of_setpoints.order(seconds(message.header.stamp), self.clock_s())
            first = self._switch.request(named_values(message, CHANNEL_NAMES, "effort"))
        except (MessageError, SetpointError) as error:
            self.refuse("pressure_setpoints", error)
            return
        if first:
            self.publish_health()

    def _on_chamber_states(self, message: JointState) -> None:
        try:
            pressure_gauge_pa = named_values(message, CHANNEL_NAMES, "effort")
            stamp_s, now_s = seconds(message.header.stamp), self.now_s()
            time_s = self._clock_of_pressures.sample(stamp_s, now_s, self.clock_s())
            command = self._valves.update(time_s, pressure_gauge_pa, self._waiting.late_s(stamp_s, now_s))
        except (MessageError, ControllerInputError) as error:
            self.refuse("chamber_states", error)
            return
        self._publish(message.header.stamp, command)
        self._publish_change_of_faults()

    def _publish(self, stamp: Time, command: ValveCommand) -> None:
        openings = command.spool
        if self._has_supply_valve:
            openings = np.append(openings, float(command.supply_open))
        self._commands.publish(self._openings.filled(stamp, position=openings))

    def _on_silence(self) -> None:
        """Close the valves when the pressures stay out."""
        now_s = self.now_s()
        if self._clock_of_pressures.age(now_s) <= self._hold_time_s or now_s == 0.0:
            return
        self._publish(self.now_stamp(), self._valves.check(self._clock_of_pressures.time(now_s)))
        self._publish_change_of_faults()

    def _on_grasp_state(self, state: DiagnosticStatus) -> None:
        """Follow the arbiter's word on the air in the next command, without waiting for set-points or measurements."""
        said = {item.key: item.value for item in state.values}
        try:
            air = Air(said.get("air", "none given"))
        except ValueError as error:
            self.refuse("grasp_state", error)
            return
        if self._switch.obey(air, said.get("phase") == "closing", said.get("reason", "")):
            self._publish_state()
            self.publish_health()

    def _on_enable(self, request: SetBool.Request) -> Answer:
        answer = self._switch.switch(request.data)
        return self._change(answer) if answer.accepted else answer

    def _publish_change_of_faults(self) -> None:
        self.publish_health_change(
            (
                tuple((each.fault, each.channels) for each in self._valves.findings),
                self._switch.air,
                self._switch.switched_on,
            )
        )


def main() -> int:
    """Run the node until a signal."""
    return run(ValveControllerNode)


if __name__ == "__main__":
    sys.exit(main())
