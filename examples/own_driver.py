"""A driver to start from: it stands where the simulated plant stands, between your hardware and the other nodes.

python examples/own_driver.py &
ros2 run mbpam_ros pressure_sensor & ros2 run mbpam_ros valve_controller & ros2 run mbpam_ros grasp_arbiter

Replace the class Hardware by your converters. As it is here it fakes sixteen chambers, so that the loops can be tried.
"""

import time

from mbpam_ros.nodes.runtime import NEWEST, STREAM, GripperNode, Health, run  # isort: skip
import numpy as np
from sensor_msgs.msg import JointState

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.nodes.messages import JointStateForm, MessageError, named_values
from mbpam_ros.pneumatics.findings import SUPPLY

PARAMETERS = ()  # yours, as mbpam_ros.nodes.parameters.Parameter: --help shows them, ROS holds their ranges
PERIOD_S = 0.01
COMMAND_TIMEOUT_S = 0.03  # a valve that hears nothing for so long must close


class Hardware:
    """Sixteen valves and transducers: write spool openings, read volts."""

    SUPPLY_PA, TIME_CONSTANT_S, VOLT_PER_PA = 200e3, 0.25, 4.0 / 200e3

    def __init__(self) -> None:
        """Start vented."""
        self.pressure_pa, self.noise = np.zeros(CHANNEL_COUNT), np.random.default_rng(0)

    def write(self, opening: np.ndarray) -> None:
        """Set the spools, each from -1 (vent) over 0 (closed) to +1 (fill)."""
        toward_pa = np.where(opening > 0.0, self.SUPPLY_PA, 0.0)
        self.pressure_pa += np.abs(opening) * (toward_pa - self.pressure_pa) * PERIOD_S / self.TIME_CONSTANT_S

    def read(self) -> np.ndarray:
        """Return the transducers' volts; the noise is what tells a sound transducer from a stuck one."""
        return 0.5 + self.VOLT_PER_PA * self.pressure_pa + self.noise.normal(0.0, 0.002, CHANNEL_COUNT)


class DriverNode(GripperNode):
    """Publishes ``transducers`` at 100 Hz, follows ``valve_commands``, and closes the valves when these stay out."""

    def __init__(self, **node_options: object) -> None:
        """Open topics and hardware."""
        super().__init__("driver", PARAMETERS, **node_options)
        self.hardware = Hardware()
        self.opening, self.commanded_s = np.zeros(CHANNEL_COUNT), -np.inf
        self.transducers = self.create_publisher(JointState, "transducers", STREAM)
        self.volts = JointStateForm(CHANNEL_NAMES)
        self.create_subscription(JointState, "valve_commands", self.on_valve_commands, NEWEST)
        self.create_timer(PERIOD_S, self.on_period)

    def health(self) -> Health:
        """Report what the hardware says of itself here."""
        return Health(message="running")

    def leave(self) -> None:
        """Close the valves before the node ends."""
        self.hardware.write(np.zeros(CHANNEL_COUNT))

    def on_valve_commands(self, message: JointState) -> None:
        """Take the commands, unless one of them cannot be."""
        try:
            opening = named_values(message, CHANNEL_NAMES, "position", optional=SUPPLY)
            if not (np.abs(opening) <= 1.0).all():  # NaN is refused too
                raise MessageError("an opening that is not within -1 .. 1")
        except MessageError as error:
            self.refuse("valve_commands", error)
            return
        # A 17th value is for the supply's own valve: 1 open, 0 shut and what stands before the valves dumped. This
        # hardware has none.
        self.opening, self.commanded_s = opening[:CHANNEL_COUNT], time.monotonic()

    def on_period(self) -> None:
        """Move the valves, then tell what the transducers read."""
        silent = time.monotonic() - self.commanded_s > COMMAND_TIMEOUT_S
        self.hardware.write(np.zeros(CHANNEL_COUNT) if silent else self.opening)
        self.transducers.publish(self.volts.filled(self.now_stamp(), effort=self.hardware.read()))


if __name__ == "__main__":
    raise SystemExit(run(DriverNode))
