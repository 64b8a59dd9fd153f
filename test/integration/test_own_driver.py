"""The examples of a driver, in the place of the simulated plant, and of a client that operates the gripper."""

import importlib.util
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mbpam_ros.commands.system import NodeProcesses, Operator  # isort: skip
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import LATCHED, NEWEST

EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVER = EXAMPLES / "own_driver.py"
OTHERS = ("pressure_sensor", "valve_controller", "grasp_arbiter")


def operate(service: str, domain: int) -> str:
    command = [sys.executable, EXAMPLES / "operate.py", service]
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60.0, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture
def operator(domain, log_directory):
    environment = {"ROS_DOMAIN_ID": str(domain)}
    with NodeProcesses(log_directory, executables=OTHERS, environment=environment) as processes:
        driver = subprocess.Popen([sys.executable, DRIVER], env=os.environ | environment)
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


def test_the_example_driver_refuses_openings_that_cannot_be_and_closes_the_valves(graph):
    spec = importlib.util.spec_from_file_location("own_driver", DRIVER)
    example = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = example
    spec.loader.exec_module(example)
    driver = graph.add(example.DriverNode)
    commands = graph.publisher(JointState, "valve_commands")
    volts = graph.listen(JointState, "transducers")
    commands.publish(joint_state(time_stamp(1.0), CHANNEL_NAMES, position=[1.0] * 15 + [math.nan]))
    graph.spin_until(lambda: driver.refused_inputs == 1, "the refusal")
    commands.publish(joint_state(time_stamp(1.0), CHANNEL_NAMES, position=[1.0] * 16))
    graph.spin_until(lambda: volts and max(volts[-1].effort) > 0.6, "some pressure")
    seen = len(volts)
    graph.spin_until(lambda: len(volts) > seen + 20, "valves without commands")
    assert max(volts[-1].effort) < 2.0
