"""A driver to start from: it stands where the simulated plant stands, between your hardware and the other nodes.

python examples/simulated_terminal.py &
python examples/own_driver.py --ros-args -p address:=127.0.0.1:5020 &
ros2 run mbpam_ros pressure_sensor & ros2 run mbpam_ros valve_controller & ros2 run mbpam_ros grasp_arbiter

It speaks Modbus/TCP with a terminal of sixteen proportional valves, a supply valve and sixteen analogue inputs. Their
registers are those of simulated_terminal.py, their calibration is terminal.yaml. For other hardware replace the two
functions "start" and "exchange" of the class Terminal. What stays: it connects again, sets the terminal's watchdog,
which closes all valves when this program or the cable is gone, and reports its health. own_managed_driver.py is the
same as a managed node.
"""

import socket
import struct
import time
from dataclasses import dataclass
from pathlib import Path

from mbpam_ros.nodes.runtime import NEWEST, STREAM, Health, run  # isort: skip
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError, load_config, require_positive
from mbpam_ros.nodes.air_node import AirNode
from mbpam_ros.nodes.messages import JointStateForm, MessageError, named_values
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.pneumatics.findings import SUPPLY

PARAMETERS = (
    Parameter("address", "127.0.0.1:5020", "host:port of the terminal"),
    Parameter("terminal", str(Path(__file__).with_name("terminal.yaml")), "terminal file: converters and calibration"),
)
PERIOD_S = 0.01
COMMAND_TIMEOUT_S = 0.03  # a valve that hears nothing for so long must close
SUPPLY_TIMEOUT_S = 0.2
ANSWER_TIMEOUT_S = 0.02  # of the terminal; it holds up this node for so long at most
CONNECT_TIMEOUT_S = 0.05
RECONNECT_S = 0.5

# Holding registers of the terminal.
SPOOLS, SUPPLY_VALVE, WATCHDOG_MS, ANALOGUE = 0, 16, 17, 100
WRITE, READ_AND_WRITE = 0x10, 0x17  # Modbus functions


@dataclass(frozen=True)
class TerminalConfig:
    """The terminal file; every key has its meaning beside it there."""

    adc_reference_v: float
    adc_bits: int
    volt_gain: tuple[float, ...]
    volt_offset: tuple[float, ...]
    spool_full_scale: int
    spool_closed: tuple[int, ...]
    watchdog_s: float

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        require_positive(self, "adc_reference_v", "adc_bits", "spool_full_scale", "watchdog_s")
        for name in ("volt_gain", "volt_offset", "spool_closed"):
            if len(getattr(self, name)) != CHANNEL_COUNT:
                raise ValueError(f"{name} must have {CHANNEL_COUNT} values, found {len(getattr(self, name))}")


class Terminal:
    """One valve terminal on Modbus/TCP. Any OSError means that it is not there."""

    def __init__(self, host: str, port: int, config: TerminalConfig) -> None:
        """Remember where it is; nothing is connected yet."""
        self._where, self._config = (host, port), config
        self._socket: socket.socket | None = None
        self._number = 0

    def start(self) -> None:
        """Connect, and set the watchdog."""
        self._socket = socket.create_connection(self._where, CONNECT_TIMEOUT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(ANSWER_TIMEOUT_S)
        self._ask(WRITE, struct.pack(">HHBH", WATCHDOG_MS, 1, 2, round(1e3 * self._config.watchdog_s)))

    def exchange(self, opening: np.ndarray, supply_open: bool) -> np.ndarray:
        """Set the spools, -1 (vent) over 0 (closed) to +1 (fill), and the supply; return the transducers' volts."""
        config = self._config
        spools = np.rint(opening * config.spool_full_scale) + np.array(config.spool_closed)
        registers = struct.pack(">16hH", *spools.clip(-32768, 32767).astype(int), supply_open)
        asked = struct.pack(">HHHHB", ANALOGUE, CHANNEL_COUNT, SPOOLS, CHANNEL_COUNT + 1, len(registers))
        answer = self._ask(READ_AND_WRITE, asked + registers)
        if len(answer) != 1 + 2 * CHANNEL_COUNT:
            raise ConnectionError(f"{len(answer) - 1} bytes of analogue inputs, expected {2 * CHANNEL_COUNT}")
        counts = np.array(struct.unpack(">16H", answer[1:]))
        volts = counts * config.adc_reference_v / 2**config.adc_bits
        return volts * np.array(config.volt_gain) + np.array(config.volt_offset)

    def close(self) -> None:
        """Hang up; the next :meth:`start` begins anew."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @property
    def connected(self) -> bool:
        """Whether it was there when it was last spoken to."""
        return self._socket is not None

    def _ask(self, function: int, data: bytes) -> bytes:
        """Send one request and return what its answer holds behind the function's code."""
        if self._socket is None:
            raise ConnectionError("not connected")
        self._number = (self._number + 1) % 65536
        self._socket.sendall(struct.pack(">HHHBB", self._number, 0, len(data) + 2, 1, function) + data)
        number, protocol, length = struct.unpack(">HHH", self._receive(6))
        unit, answered, *_ = body = self._receive(length)
        if (number, protocol, unit) != (self._number, 0, 1):
            raise ConnectionError("an answer to another request")
        if answered != function:
            raise ConnectionError(f"the terminal refuses: Modbus exception {body[2]}")
        return bytes(body[2:])

    def _receive(self, count: int) -> bytes:
        received = b""
        while len(received) < count:
            part = self._socket.recv(count - len(received)) if self._socket else b""
            if not part:
                raise ConnectionError("the terminal hung up")
            received += part
        return received


class DriverNode(AirNode):
    """Publishes ``transducers`` at 100 Hz, follows ``valve_commands``, and closes the valves when these stay out."""

    def __init__(self, **node_options: object) -> None:
        """Build and configure it."""
        super().__init__("driver", PARAMETERS, **node_options)

    def configure(self) -> None:
        """Read the terminal file and open topics; the terminal is connected by the first period."""
        host, _, port = self.text("address").rpartition(":")
        if not host or not port.isdigit():
            raise ConfigError(f"driver: address {self.text('address')!r} is no host:port")
        self.terminal = Terminal(host, int(port), load_config(TerminalConfig, self.text("terminal")))
        self.opening, self.supply_open, self.commanded_s = np.zeros(CHANNEL_COUNT), False, -np.inf
        self.air_flows = True
        self.fault, self.connect_at_s, self.connections, self.slowest_s = "not connected yet", 0.0, 0, 0.0
        self.transducers = self.create_publisher(JointState, "transducers", STREAM)
        self.volts = JointStateForm(CHANNEL_NAMES)
        self.create_subscription(JointState, "valve_commands", self.on_valve_commands, NEWEST)
        self.create_timer(PERIOD_S, self.on_period)

    def health(self) -> Health:
        """ERROR while the terminal is not there."""
        slowest_ms, self.slowest_s = 1e3 * self.slowest_s, 0.0
        values = {"connections": str(self.connections), "slowest_answer_ms": f"{slowest_ms:.1f}"}
        if self.fault:
            return Health(DiagnosticStatus.ERROR, f"terminal at {self.value('address')}: {self.fault}", values)
        return Health(message=f"terminal at {self.value('address')}", values=values)

    def let_air_flow(self, on: bool) -> Answer:
        """Follow the commands, if the terminal is there; or from now on let air out alone, where all of it is to go."""
        if on and self.fault:
            return Answer(False, f"terminal at {self.value('address')}: {self.fault}")
        self.air_flows = on
        self.on_period()
        return Answer(True, "")

    def leave(self) -> None:
        """Close the valves before the node ends; if that fails, the terminal's watchdog does."""
        try:
            if self.terminal.connected:
                self.terminal.exchange(np.zeros(CHANNEL_COUNT), False)
        except OSError as error:
            self.get_logger().warning(f"the valves are left to the terminal's watchdog: {error}")
        self.terminal.close()

    def on_valve_commands(self, message: JointState) -> None:
        """Take the commands, unless one of them cannot be."""
        try:
            opening = named_values(message, CHANNEL_NAMES, "position", optional=SUPPLY)
            if not (np.abs(opening) <= 1.0).all():  # NaN is refused too
                raise MessageError("an opening that is not within -1 .. 1")
        except MessageError as error:
            self.refuse("valve_commands", error)
            return
        # A 17th value is for the supply's own valve: 1 open, 0 shut and what stands before the valves dumped.
        self.supply_open = bool(opening[CHANNEL_COUNT:].min(initial=1.0) > 0.5)
        self.opening, self.commanded_s = opening[:CHANNEL_COUNT], time.monotonic()

    def on_period(self) -> None:
        """Move the valves, then tell what the transducers read; without a terminal nothing is told."""
        now_s = time.monotonic()
        silence_s = now_s - self.commanded_s
        opening = self.opening if silence_s <= COMMAND_TIMEOUT_S else np.zeros(CHANNEL_COUNT)
        supply_open = self.supply_open and silence_s <= SUPPLY_TIMEOUT_S
        if not self.air_flows:
            opening, supply_open = np.where(opening <= -1.0, -1.0, 0.0), False
        try:
            if not self.terminal.connected:
                if now_s < self.connect_at_s:
                    return
                self.connect_at_s = now_s + RECONNECT_S
                self.terminal.start()
                self.connections += 1
            volts = self.terminal.exchange(opening, supply_open)
        except OSError as error:
            self.terminal.close()
            self.find(str(error) or type(error).__name__)
            return
        self.find("")
        self.slowest_s = max(self.slowest_s, time.monotonic() - now_s)
        self.transducers.publish(self.volts.filled(self.now_stamp(), effort=volts))

    def find(self, fault: str) -> None:
        """Report at once when the terminal is lost or found again."""
        lost, self.fault = bool(fault) != bool(self.fault), fault
        if lost:
            self.publish_health()
            if fault:
                self.get_logger().error(f"terminal lost: {fault}")
            else:
                self.get_logger().info("terminal connected")


if __name__ == "__main__":
    raise SystemExit(run(DriverNode))
