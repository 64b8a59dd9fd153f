"""A wire between driver and sensor that loses, doubles, delays and reorders; and simulated time that pauses."""

import heapq
import random
import time

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.nodes.messages import joint_state
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode
from mbpam_ros.nodes.runtime import NEWEST, STREAM
from mbpam_ros.nodes.valve_controller import ValveControllerNode

pytestmark = [pytest.mark.xdist_group("real_clock"), pytest.mark.usefixtures("compiled_plant")]

TARGET_PA = 80e3
LIMIT_PA = 110e3


class Relay:
    """Passes samples on as a bad wire does.

    Args:
        loss: share that never arrives.
        doubled: share that arrives twice.
        delay_s: of every sample.
        jitter_s: up to this much more, each its own: they overtake one another.
    """

    def __init__(self, graph, loss=0.0, doubled=0.0, delay_s=0.0, jitter_s=0.0):
        self._random = random.Random(1)
        self._loss, self._doubled, self._delay_s, self._jitter_s = loss, doubled, delay_s, jitter_s
        self._waiting, self._count = [], 0
        node = graph.test_node
        self._out = node.create_publisher(JointState, "transducers", STREAM)
        node.create_subscription(JointState, "driver/transducers", self._take, NEWEST)
        node.create_timer(0.002, self._pass_on)

    def _take(self, message):
        if self._random.random() < self._loss:
            return
        for _ in range(2 if self._random.random() < self._doubled else 1):
            self._count += 1
            due_s = time.monotonic() + self._delay_s + self._random.uniform(0.0, self._jitter_s)
            heapq.heappush(self._waiting, (due_s, self._count, message))

    def _pass_on(self):
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            self._out.publish(heapq.heappop(self._waiting)[2])


def filled_through(graph, **wire):
    """Fill four chambers through the wire; return the sensor, and the truth of the pressures over time."""
    Relay(graph, **wire)
    truth = graph.listen(JointState, "driver/transducers", NEWEST)
    sensor = graph.add(PressureSensorNode)
    graph.add(ValveControllerNode, enable_at_start=True)
    driver = {"transducers": "driver/transducers"}
    graph.add(PlantNode, remap=driver, scene="empty", camera_rate_hz=0.0)
    setpoints = graph.publisher(JointState, "pressure_setpoints")
    graph.spin_until(lambda: len(truth) > 20, "samples of the driver")
    target = np.where(np.arange(16) % 5 == 0, TARGET_PA, 0.0)
    setpoints.publish(joint_state(truth[-1].header.stamp, CHANNEL_NAMES, effort=target))
    until = len(truth) + 150
    graph.spin_until(lambda: len(truth) > until, "a second and a half", timeout_s=60.0)
    return sensor, (np.array([message.effort for message in truth]) - 0.5) * 50e3


def test_a_wire_that_loses_doubles_and_reorders_still_fills_to_the_set_point_and_not_above(graph):
    sensor, pressure_pa = filled_through(graph, loss=0.3, doubled=0.3, delay_s=0.005, jitter_s=0.03)
    assert sensor.refused_inputs > 10  # doubled, and overtaken
    assert pressure_pa.max() < LIMIT_PA
    assert np.abs(pressure_pa[-20:, ::5].mean(axis=0) - TARGET_PA).max() < 0.1 * TARGET_PA


def test_a_wire_on_which_everything_is_late_opens_no_valve(graph):
    sensor, pressure_pa = filled_through(graph, delay_s=0.6)
    assert sensor.refused_inputs > 50
    assert pressure_pa.max() < 1e3
