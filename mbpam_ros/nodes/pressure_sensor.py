"""Node ``pressure_sensor``: transducer voltages to pressures, with a verdict on every channel."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

from mbpam_ros.nodes.runtime import NEWEST, STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import FluidPressure, JointState
from std_srvs.srv import Trigger

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_NAMES, FINGER_COUNT
from mbpam_ros.answer import Answer
from mbpam_ros.nodes.messages import JointStateForm, MessageError, named_values, seconds, time_stamp
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.stamps import CLOCK_TOLERANCE, StampClock
from mbpam_ros.nodes.transforms import FRAME_PREFIX
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.sensing import (
    ChannelStatus,
    PressureReading,
    PressureSensing,
    SensingInputError,
    ZeroRefusedError,
)

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("pneumatics", "pneumatics.yaml", "pneumatics file: transducers and how their volts are read"),
    Parameter("ambient_pressure_pa", 101325.0, "absolute ambient pressure [Pa]", 5e4, 1.2e5, changeable=True),
    Parameter("fluid_pressure_rate_hz", 10.0, "rate of the FluidPressure topics [Hz]", 0.1, 100.0),
    Parameter("zero_forced", False, "zero takes readings far from the last zero, or unsteady, too", changeable=True),
    FRAME_PREFIX,
    CLOCK_TOLERANCE,
)

SILENCE_LOOKS = 5
"""How often within the time after which a sample is missing the node looks for it."""


class PressureSensorNode(GripperNode):
    """Adapter around :class:`PressureSensing`."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("pressure_sensor", PARAMETERS, **node_options)
        config = load_pneumatics(self.text("pneumatics"))
        self._sensing = PressureSensing(config.sensing, config.transducer)
        self._missing_time_s = config.sensing.missing_time_s
        self._clock_of_samples = StampClock(self._missing_time_s, self.number("clock_tolerance_s"))
        self._reading: PressureReading | None = None

        self._states = self.create_publisher(JointState, "chamber_states", STREAM)
        self._pressures = JointStateForm(CHANNEL_NAMES)
        self._fluid = [self.create_publisher(FluidPressure, topic, STREAM) for topic in _fluid_topics()]
        self.create_subscription(JointState, "transducers", self._on_transducers, NEWEST)
        self.serve(Trigger, "pressure_sensor/zero", self._on_zero)
        self.create_timer(1.0 / self.number("fluid_pressure_rate_hz"), self._publish_fluid_pressures)
        self.create_timer(self._missing_time_s / SILENCE_LOOKS, self._on_silence)

    def health(self) -> Health:
        """ERROR while a channel has no valid reading; the values say which and why."""
        if self._reading is None:
            return Health(DiagnosticStatus.ERROR, "no transducer voltages received on 'transducers'")
        faults = {
            name: status.value
            for name, status in zip(CHANNEL_NAMES, self._reading.status, strict=True)
            if status is not ChannelStatus.OK
        }
        if faults:
            return Health(DiagnosticStatus.ERROR, f"no valid reading from {len(faults)} of 16 channels", faults)
        return Health(message="16 channels valid")

    def _on_transducers(self, message: JointState) -> None:
        try:
            volts = named_values(message, CHANNEL_NAMES, "effort")
            time_s = self._clock_of_samples.sample(seconds(message.header.stamp), self.now_s(), self.clock_s())
            self._reading = self._sensing.update(time_s, volts)
        except (MessageError, SensingInputError) as error:
            self.refuse("transducers", error)
            return
        self._states.publish(self._pressures.filled(message.header.stamp, effort=self._reading.pressure_gauge_pa))
        self.publish_health_change(self._reading.status)

    def _on_silence(self) -> None:
        """Say that the channels are missing when no voltages come any more."""
        if self._reading is None or self._clock_of_samples.age(self.now_s()) <= self._missing_time_s:
            return
        self._reading = self._sensing.check(self._clock_of_samples.time(self.now_s()))
        stamp = time_stamp(self._reading.time_s)
        self._states.publish(self._pressures.filled(stamp, effort=self._reading.pressure_gauge_pa))
        self.publish_health_change(self._reading.status)

    def _publish_fluid_pressures(self) -> None:
        """Publish absolute pressure, as FluidPressure is by its definition, of channels that have one."""
        if self._reading is None:
            return
        ambient_pa = self.number("ambient_pressure_pa")
        for i, publisher in enumerate(self._fluid):
            if publisher.get_subscription_count() == 0 or math.isnan(self._reading.pressure_gauge_pa[i]):
                continue
            message = FluidPressure()
            message.header.stamp = time_stamp(self._reading.time_s)
            message.header.frame_id = f"{self.text('frame_prefix')}{CHANNEL_NAMES[i]}"
            message.fluid_pressure = float(self._reading.pressure_gauge_pa[i] + ambient_pa)
            message.variance = float(self._reading.variance_pa2[i])
            publisher.publish(message)

    def _on_zero(self, _: Trigger.Request) -> Answer:
        try:
            correction_pa = self._sensing.zero(forced=bool(self.value("zero_forced")))
        except ZeroRefusedError as refusal:
            return Answer(False, str(refusal))
        return Answer(True, f"zeroed; largest correction {abs(correction_pa).max():.0f} Pa")


def _fluid_topics() -> list[str]:
    chambers = range(1, CHAMBERS_PER_FINGER + 1)
    return [f"chamber_{finger}_{chamber}/pressure" for finger in range(1, FINGER_COUNT + 1) for chamber in chambers]


def main() -> int:
    """Run the node until a signal."""
    return run(PressureSensorNode)


if __name__ == "__main__":
    sys.exit(main())
