"""The pressure sensor's promises on its topics and services."""

import math
import re
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import FluidPressure, JointState
from std_srvs.srv import Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode

VENTED_V = 0.5
OWN_CLOCK = {"clock_tolerance_s": 0.0}
"""For stamps that are not of this computer's clock."""


def volts(values, time_s=1.0, names=CHANNEL_NAMES):
    return joint_state(time_stamp(time_s), names, effort=values)


def test_volts_become_gauge_pressure_with_the_stamp_of_the_sample(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V] * 15 + [2.5], time_s=3.25))
    graph.spin_until(lambda: states, "chamber_states")
    assert tuple(states[0].name) == CHANNEL_NAMES
    assert states[0].header.stamp == time_stamp(3.25)
    assert math.isclose(states[0].effort[15], 100e3, abs_tol=1.0)
    assert abs(states[0].effort[0]) < 1.0


def test_a_driver_that_publishes_best_effort_is_heard(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers", qos_profile_sensor_data)
    publisher.publish(volts([VENTED_V] * 16))
    graph.spin_until(lambda: states, "chamber_states")


def test_a_broken_wire_is_nan_and_the_diagnostics_name_the_channel(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V] * 7 + [0.0] + [VENTED_V] * 8))
    graph.spin_until(lambda: states, "chamber_states")
    assert [math.isnan(value) for value in states[0].effort] == [i == 7 for i in range(16)]

    def named():
        return [
            item.value
            for report in reports
            for status in report.status
            for item in status.values
            if item.key == CHANNEL_NAMES[7] and status.level == DiagnosticStatus.ERROR
        ]

    graph.spin_until(named, "the channel in the diagnostics")
    assert named()[0] == "out of range"


def test_fluid_pressure_is_absolute(graph):
    graph.add(PressureSensorNode, fluid_pressure_rate_hz=50.0, **OWN_CLOCK)
    absolute = graph.listen(FluidPressure, "chamber_1_1/pressure")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V] * 16))
    graph.spin_until(lambda: absolute, "chamber_1_1/pressure")
    assert math.isclose(absolute[0].fluid_pressure, 101325.0, abs_tol=1.0)
    assert absolute[0].variance > 0.0
    assert absolute[0].header.frame_id == CHANNEL_NAMES[0]


def test_a_channel_without_a_valid_reading_has_no_fluid_pressure(graph):
    graph.add(PressureSensorNode, fluid_pressure_rate_hz=50.0, **OWN_CLOCK)
    broken, whole = (graph.listen(FluidPressure, f"chamber_1_{chamber}/pressure") for chamber in (1, 2))
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([math.nan, *[VENTED_V] * 15]))
    graph.spin_until(lambda: len(whole) >= 3, "chamber_1_2/pressure")
    assert broken == []


def test_zero_is_refused_while_a_chamber_is_pressurised(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([1.5] + [VENTED_V] * 15))
    graph.spin_until(lambda: states, "chamber_states")
    refusal = graph.call(Trigger, "pressure_sensor/zero")
    assert not refusal.success
    assert CHANNEL_NAMES[0] in refusal.message


def test_zero_takes_the_vented_reading_as_zero(graph):
    graph.add(PressureSensorNode, zero_forced=True, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V + 0.04] * 16, time_s=1.0))
    graph.spin_until(lambda: states, "chamber_states")
    assert abs(states[0].effort[0] - 2000.0) < 1.0
    assert graph.call(Trigger, "pressure_sensor/zero").success
    publisher.publish(volts([VENTED_V + 0.04] * 16, time_s=1.01))
    graph.spin_until(lambda: len(states) == 2, "the next chamber_states")
    assert abs(states[1].effort[0]) < 1.0


def test_silence_of_the_transducers_becomes_nan(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V] * 16))
    graph.spin_until(lambda: len(states) > 1, "a report of silence")
    assert all(math.isnan(value) for value in states[-1].effort)


def test_silence_while_the_computer_is_held_up_is_laid_to_the_computer(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    publisher = graph.publisher(JointState, "transducers")
    graph.spin_until(lambda: reports, "a report, once a second")
    publisher.publish(volts([VENTED_V] * 16))
    graph.spin_until(lambda: reports[-1].status[0].level == DiagnosticStatus.OK, "health")
    resumed_s = time.monotonic() + 0.4
    while time.monotonic() < resumed_s:  # nothing spins: the computer does something else
        pass
    graph.spin_until(lambda: reports[-1].status[0].level == DiagnosticStatus.ERROR, "the silence")
    message = reports[-1].status[0].message
    said = re.fullmatch(r"this computer ran (\d+) ms late: no valid reading from 16 of 16 channels", message)
    assert said and int(said[1]) >= 300


def test_malformed_voltages_are_refused_and_the_node_goes_on(graph):
    node = graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    wrong = [
        volts([VENTED_V] * 15 + [VENTED_V], names=(*CHANNEL_NAMES[:15], "finger_5_chamber_1")),
        volts([VENTED_V] * 15),
        volts([VENTED_V] * 15, names=CHANNEL_NAMES[:15]),
        volts([VENTED_V] * 16, names=(*CHANNEL_NAMES[:15], CHANNEL_NAMES[0])),
        JointState(),
    ]
    for message in wrong:
        publisher.publish(message)
    graph.spin_until(lambda: node.refused_inputs == len(wrong), "the refusals")
    assert not states
    publisher.publish(volts([VENTED_V] * 16))
    graph.spin_until(lambda: states, "chamber_states after refusals")


def test_channels_may_come_in_any_order(graph):
    graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([2.5] + [VENTED_V] * 15, names=CHANNEL_NAMES[::-1]))
    graph.spin_until(lambda: states, "chamber_states")
    assert math.isclose(states[0].effort[15], 100e3, abs_tol=1.0)


def test_samples_stamped_an_hour_ago_are_refused_in_one_line_and_are_no_reading(graph):
    node = graph.add(PressureSensorNode)
    states, logs = graph.listen(JointState, "chamber_states"), graph.listen(Log, "/rosout", QoSProfile(depth=100))
    publisher = graph.publisher(JointState, "transducers")
    for k in range(3):
        publisher.publish(volts([VENTED_V] * 16, time_s=time.time() - 3600.0 + 0.01 * k))
    graph.spin_until(lambda: node.refused_inputs == 3, "the refusals")
    said = lambda: [log.msg for log in logs if log.level == 30]  # noqa: E731
    graph.spin_until(said, "the warning")
    assert not states and len(said()) == 1
    assert said()[0].startswith("transducers refused: stamped 1.00 h ago by this computer's clock")
    assert "chrony" in said()[0]
    publisher.publish(volts([VENTED_V] * 16, time_s=time.time()))
    graph.spin_until(lambda: states, "chamber_states")


def test_a_zero_with_trapped_air_is_refused_and_the_parameter_forces_it(graph):
    node = graph.add(PressureSensorNode, **OWN_CLOCK)
    states = graph.listen(JointState, "chamber_states")
    publisher = graph.publisher(JointState, "transducers")
    publisher.publish(volts([VENTED_V + 0.086] * 16))
    graph.spin_until(lambda: states, "chamber_states")
    refusal = graph.call(Trigger, "pressure_sensor/zero")
    assert not refusal.success and "air may be trapped" in refusal.message
    node.set_parameters([Parameter("zero_forced", value=True)])
    assert graph.call(Trigger, "pressure_sensor/zero").success
