"""The examples of a driver, in the place of the simulated plant, and of a client that operates the gripper."""

import importlib.util
import math
import os
import signal
import socket
import socketserver
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from mbpam_ros.commands.system import NodeProcesses, Operator  # isort: skip
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.configuration import load_config
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import LATCHED, NEWEST
from mbpam_ros.pneumatics.findings import SUPPLY

EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVER = EXAMPLES / "own_driver.py"
OTHERS = ("pressure_sensor", "valve_controller", "grasp_arbiter")


def operate(service: str, domain: int) -> str:
    command = [sys.executable, EXAMPLES / "operate.py", service]
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def example(name: str) -> ModuleType:
    """An example as a module."""
    if name == "own_managed_driver":  # finds its neighbour, as a program in their folder does
        example("own_driver")
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def start_terminal() -> Iterator[Callable[..., socketserver.BaseServer]]:
    """Start simulated terminals."""
    with ExitStack() as stack:

        def start(port: int = 0) -> socketserver.BaseServer:
            terminal = stack.enter_context(example("simulated_terminal").SimulatedTerminal(port))
            threading.Thread(target=terminal.serve_forever, args=(0.02,), daemon=True).start()
            stack.callback(terminal.shutdown)
            return terminal

        yield start


def address(terminal: socketserver.BaseServer) -> str:
    return "{}:{}".format(*terminal.server_address)


@pytest.fixture
def operator(domain, log_directory, launch, start_terminal):
    environment = {"ROS_DOMAIN_ID": str(domain)}
    with NodeProcesses(log_directory, executables=OTHERS, environment=environment, launch=launch) as processes:
        command = [sys.executable, DRIVER, "--ros-args", "-p", f"address:={address(start_terminal())}"]
        driver = subprocess.Popen(command, env=os.environ | environment)
        operator = Operator("test_operator", idle=processes.check, domain_id=domain)
        yield operator
        operator.close()
        driver.send_signal(signal.SIGINT)
        assert driver.wait(timeout=30.0) == 0


def test_with_the_example_driver_a_grasp_closes_and_opens(operator, domain):
    phases, pressures_pa = [], []
    told = lambda state: phases.extend(item.value for item in state.values if item.key == "phase")  # noqa: E731
    operator.node.create_subscription(DiagnosticStatus, "grasp_state", told, LATCHED)
    heard = lambda message: pressures_pa.append(max(message.effort))  # noqa: E731
    operator.node.create_subscription(JointState, "chamber_states", heard, NEWEST)
    operator.wait_for_nodes((*OTHERS, "driver"))
    assert operate("valve_controller/enable", domain) == "valve_controller/enable: air on\n"
    operator.wait_for(lambda: operator.call(Trigger, "grasp/mid_rod").success, 15.0, "a grasp accepted")
    operator.wait_for(lambda: phases[-1:] == ["holding"], 15.0, "phase holding")
    assert 95e3 < pressures_pa[-1] < 105e3
    assert operate("grasp/release", domain) == "grasp/release: releasing\n"
    operator.wait_for(lambda: phases[-1:] == ["idle"], 15.0, "phase idle")
    assert pressures_pa[-1] < 5e3


def test_the_example_driver_refuses_openings_that_cannot_be_and_closes_the_valves(graph, start_terminal):
    terminal = start_terminal()
    driver = graph.add(example("own_driver").DriverNode, address=address(terminal))
    commands = graph.publisher(JointState, "valve_commands")
    volts = graph.listen(JointState, "transducers")
    commands.publish(joint_state(time_stamp(1.0), CHANNEL_NAMES, position=[1.0] * 15 + [math.nan]))
    graph.spin_until(lambda: driver.refused_inputs == 1, "the refusal")
    commands.publish(joint_state(time_stamp(1.0), CHANNEL_NAMES, position=[1.0] * 16))
    graph.spin_until(lambda: volts and max(volts[-1].effort) > 0.6, "some pressure")
    seen = len(volts)
    graph.spin_until(lambda: len(volts) > seen + 20, "valves without commands")
    assert max(volts[-1].effort) < 2.0 and not terminal.device.spools.any()


def test_a_terminal_that_is_lost_is_said_at_once_closes_by_itself_and_is_found_again(graph, start_terminal):
    terminal = start_terminal()
    driver = graph.add(example("own_driver").DriverNode, address=address(terminal))
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    commands = graph.publisher(JointState, "valve_commands")
    opened = joint_state(time_stamp(1.0), (*CHANNEL_NAMES, SUPPLY), position=[1.0] * 17)

    def open_valves(level: bytes) -> bool:
        commands.publish(opened)
        return bool(reports) and reports[-1].status[0].level == level

    graph.spin_until(lambda: open_valves(DiagnosticStatus.OK) and terminal.device.spools.all(), "open valves")
    terminal.shutdown()
    terminal.server_close()
    for connection in terminal.connections:
        connection.shutdown(socket.SHUT_RDWR)
    graph.spin_until(lambda: open_valves(DiagnosticStatus.ERROR), "the loss")
    assert address(terminal) in reports[-1].status[0].message and not driver.terminal.connected
    device = terminal.device
    graph.spin_until(lambda: device.answer(3, bytes([0, 0, 0, 1])) and not device.spools.any(), "the watchdog")
    again = start_terminal(terminal.server_address[1])
    graph.spin_until(lambda: open_valves(DiagnosticStatus.OK) and again.device.spools.all(), "the terminal again")
    assert driver.connections == 2
    driver.leave()
    assert not again.device.spools.any() and again.device.registers[16] == 0


def test_driver_and_terminal_speak_modbus_as_another_implementation_does(start_terminal):
    client_of = pytest.importorskip("pymodbus.client").ModbusTcpClient
    terminal = start_terminal()
    config = load_config(example("own_driver").TerminalConfig, EXAMPLES / "terminal.yaml")
    ours = example("own_driver").Terminal(*terminal.server_address, replace(config, watchdog_s=60.0))
    ours.start()
    volts = ours.exchange(np.linspace(-1.0, 1.0, 16), True)
    assert volts == pytest.approx(0.5, abs=0.02)
    other = client_of("127.0.0.1", port=terminal.server_address[1])
    assert other.connect()
    written = other.read_holding_registers(0, count=18, device_id=1).registers
    assert [each - 65536 * (each > 32767) for each in written[:16]] == np.rint(np.linspace(-1e4, 1e4, 16)).tolist()
    assert written[16:] == [1, 60_000]
    assert not other.write_registers(0, [10_000] * 16, device_id=1).isError()
    assert terminal.device.spools.tolist() == [1.0] * 16
    assert other.read_coils(0, count=1, device_id=1).isError()
    other.close()
    ours.close()


def test_a_managed_driver_opens_its_terminal_s_valves_while_it_is_active_alone(graph, start_terminal):
    terminal = start_terminal()
    node = graph.add(example("own_managed_driver").ManagedDriverNode, address=address(terminal))
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    volts = graph.listen(JointState, "transducers")
    commands = graph.test_node.create_publisher(JointState, "valve_commands", 5)
    spools = lambda: terminal.device.registers[:17].astype(np.int16)  # noqa: E731

    def told(opening):
        commands.publish(joint_state(time_stamp(1.0), (*CHANNEL_NAMES, SUPPLY), position=[opening] * 16 + [1.0]))
        seen = len(volts)
        graph.spin_until(lambda: len(volts) > seen + 1, "an exchange with the terminal")
        return spools()

    assert graph.change(node, "configure") == (True, "inactive")
    graph.spin_until(lambda: volts, "what the transducers read")
    assert not told(1.0).any()
    assert graph.change(node, "activate") == (True, "active")
    graph.spin_until(lambda: (told(1.0)[:16] > 0).all() and spools()[16] == 1, "open valves")
    assert graph.change(node, "deactivate") == (True, "inactive") and not spools().any()
    graph.spin_until(lambda: (told(-1.0)[:16] < 0).all(), "a stop that lets the air out")
    assert graph.change(node, "activate") == (True, "active")
    assert graph.change(node, "shutdown") == (True, "finalized") and not spools().any()
    graph.spin_until(lambda: "finalized" in reports[-1].status[0].message, "the report")


def test_a_managed_driver_is_not_activated_without_its_terminal(graph):
    node = graph.add(example("own_managed_driver").ManagedDriverNode, address="127.0.0.1:9")
    assert graph.change(node, "configure") == (True, "inactive")
    assert graph.change(node, "activate") == (False, "inactive")
    assert "activate refused: terminal at 127.0.0.1:9" in node.health().message
