"""Node ``valve_controller``: pressure set-points and measured pressures to spool openings."""

from __future__ import annotations

import sys

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, GripperNode, Health, run  # isort: skip
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import Air
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.messages import JointStateForm, MessageError, named_values, seconds
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.stamps import StampClock
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import ControllerInputError, PressureController, SetpointError, ValveFault

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: pressure limit and over-pressure"),
    Parameter("pneumatics", "pneumatics.yaml", "pneumatics file: gains, limits and watchdog of the loops"),
    Parameter("enable_at_start", False, "follow set-points from the start, without valve_controller/enable"),
    Parameter("watchdog_rate_hz", 50.0, "how often silence of the pressures is looked for [Hz]", 10.0, 1000.0),
)


class ValveControllerNode(GripperNode):
    """Adapter around :class:`PressureController`."""

    def __init__(self, **node_options: object) -> None:
        super().__init__("valve_controller", PARAMETERS, **node_options)
        gripper = load_gripper(self.value("gripper"))
        config = load_pneumatics(self.value("pneumatics")).controller
        try:
            self._controller = PressureController(
                config, gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
            )
        except ValueError as error:
            raise ConfigError(f"{self.value('gripper')} against {self.value('pneumatics')}: {error}") from error
        self._hold_time_s = config.hold_time_s
        self._clock_of_pressures = StampClock()
        self._switched_on: bool = self.value("enable_at_start")
        self._air = Air.REGULATE
        self._has_setpoints = False

        self._commands = self.create_publisher(JointState, "valve_commands", STREAM)
        self._openings = JointStateForm(CHANNEL_NAMES)
        self.create_subscription(JointState, "chamber_states", self._on_chamber_states, NEWEST)
        self.create_subscription(JointState, "pressure_setpoints", self._on_setpoints, STREAM)
        self.create_subscription(DiagnosticStatus, "grasp_state", self._on_grasp_state, LATCHED)
        self.create_service(SetBool, "valve_controller/enable", self._on_enable)
        self.create_timer(1.0 / self.value("watchdog_rate_hz"), self._on_silence)

    def health(self) -> Health:
        """ERROR with the channels at fault; WARN while the air is off."""
        faults = {
            name: fault.value
            for name, fault in zip(CHANNEL_NAMES, self._controller.faults, strict=True)
            if fault is not ValveFault.NONE
        }
        values = {"enabled": str(self._switched_on).lower(), "air": self._air.value, **faults}
        if faults:
            return Health(DiagnosticStatus.ERROR, f"{len(faults)} of 16 channels at fault", values)
        if self._air is not Air.REGULATE:
            return Health(DiagnosticStatus.WARN, f"{self._air.value} after a stop or fault; see grasp_state", values)
        if not self._switched_on:
            return Health(DiagnosticStatus.WARN, "air is off; call valve_controller/enable", values)
        return Health(message="16 loops running", values=values)

    def leave(self) -> None:
        """Close the valves (or vent, where all vents): nobody will move them afterwards."""
        opening = -1.0 if self._air is Air.VENT else 0.0
        now = self.now_stamp()
        self._commands.publish(self._openings.filled(now, position=[opening] * len(CHANNEL_NAMES)))

    def _on_setpoints(self, message: JointState) -> None:
        try:
            self._controller.request(named_values(message, CHANNEL_NAMES, "effort"))
        except (MessageError, SetpointError) as error:
            self.refuse("pressure_setpoints", error)
            return
        if not self._has_setpoints:
            self._has_setpoints = True
            self._apply_switches()

    def _on_chamber_states(self, message: JointState) -> None:
        try:
            pressure_gauge_pa = named_values(message, CHANNEL_NAMES, "effort")
            time_s = self._clock_of_pressures.sample(seconds(message.header.stamp), self.now_s())
            spool = self._controller.update(time_s, pressure_gauge_pa)
        except (MessageError, ControllerInputError) as error:
            self.refuse("chamber_states", error)
            return
        self._commands.publish(self._openings.filled(message.header.stamp, position=spool))
        self.publish_health_change((self._controller.faults, self._air, self._switched_on))

    def _on_silence(self) -> None:
        """Close the valves when the pressures stay out."""
        now_s = self.now_s()
        if self._clock_of_pressures.age(now_s) <= self._hold_time_s or now_s == 0.0:
            return
        spool = self._controller.check(self._clock_of_pressures.time(now_s))
        self._commands.publish(self._openings.filled(self.now_stamp(), position=spool))
        self.publish_health_change((self._controller.faults, self._air, self._switched_on))

    def _on_grasp_state(self, state: DiagnosticStatus) -> None:
        """Follow the arbiter's word on the air in the next command, without waiting for set-points or measurements."""
        try:
            air = Air(next((item.value for item in state.values if item.key == "air"), "none given"))
        except ValueError as error:
            self.refuse("grasp_state", error)
            return
        # An arbiter started anew does not know of a stop and would keep what is still in the chambers.
        if air is not self._air and (self._air, air) != (Air.VENT, Air.HOLD):
            self._air = air
            self._apply_switches()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and self._air is not Air.REGULATE:
            response.success, response.message = False, f"the arbiter says {self._air.value}; call grasp/reset first"
            return response
        self._switched_on = request.data
        self._apply_switches()
        valves = "valves vent until grasp/reset" if self._air is Air.VENT else "valves closed"
        response.success, response.message = True, "air on" if request.data else f"air off, {valves}"
        return response

    def _apply_switches(self) -> None:
        if self._air is Air.VENT:
            self._controller.vent_all()
        elif self._air is Air.HOLD:
            self._controller.enable(False)
        else:
            self._controller.enable(True)  # ends a vent, also where the air is switched off
            # Started beside a gripper that holds, it must not take its own zeros for set-points.
            self._controller.enable(self._switched_on and self._has_setpoints)
        self.publish_health()


def main() -> int:
    """Run the node until a signal."""
    return run(ValveControllerNode)


if __name__ == "__main__":
    sys.exit(main())
