"""The managed valve controller: a supervisor configures it, and air flows while it is active alone."""

import shutil

import numpy as np
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.configuration import config_path

from mbpam_ros.nodes.managed_valve_controller import ManagedValveControllerNode  # isort: skip
from sensor_msgs.msg import JointState

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import NEWEST

INFLATED = np.full(16, 50e3)


def remark(node):
    return node.health().message


class Valves:
    """A managed valve controller, with pressures and set-points from the test."""

    def __init__(self, graph, pneumatics):
        self.graph, self.time_s = graph, 1.0
        self.node = graph.add(ManagedValveControllerNode, use_sim_time=True, pneumatics=str(pneumatics))
        self.commands = graph.listen(JointState, "valve_commands", NEWEST)
        self.pressures = graph.test_node.create_publisher(JointState, "chamber_states", NEWEST)
        self.setpoints = graph.test_node.create_publisher(JointState, "pressure_setpoints", 5)

    def commanded(self, pressure_pa=0.0):
        """Return the openings that answer the pressures and set-points of one more tick, the supply's last."""
        self.graph.spin_until(lambda: self.pressures.get_subscription_count() > 0, "a node that hears pressures")
        self.time_s, seen = self.time_s + 0.01, len(self.commands)
        stamp = time_stamp(self.time_s)
        self.setpoints.publish(joint_state(stamp, CHANNEL_NAMES, effort=INFLATED))
        self.pressures.publish(joint_state(stamp, CHANNEL_NAMES, effort=np.full(16, pressure_pa)))
        self.graph.spin_until(lambda: len(self.commands) > seen, "a command")
        return np.array(self.commands[-1].position)

    def fills(self):
        return any((self.commanded()[:16] > 0.1).all() for _ in range(20))


def test_air_flows_through_a_managed_valve_controller_while_it_is_active_alone(graph, tmp_path):
    pneumatics = tmp_path / "pneumatics.yaml"
    pneumatics.write_text("no: such key\n")
    valves = Valves(graph, pneumatics)
    node = valves.node
    enable = lambda: graph.call(SetBool, "valve_controller/enable", SetBool.Request(data=True))  # noqa: E731

    assert node.state == "unconfigured" and graph.test_node.count_publishers("valve_commands") == 0
    assert graph.change(node, "configure") == (False, "unconfigured")
    assert "configure refused" in remark(node) and str(pneumatics) in remark(node)
    shutil.copy(config_path("pneumatics.yaml"), pneumatics)
    assert graph.change(node, "configure") == (True, "inactive")
    assert not valves.fills()
    assert "inactive" in enable().message and not valves.fills()

    assert graph.change(node, "activate") == (True, "active")
    assert valves.fills() and valves.commanded()[16] == 1.0
    assert graph.change(node, "deactivate") == (True, "inactive")
    assert not valves.commanded(30e3).any()
    assert (valves.commanded(125e3)[:16] == -1.0).all()  # over-pressure leaves whatever the state

    assert graph.call(Trigger, "valve_controller/vent").success
    assert graph.change(node, "activate") == (False, "inactive")
    assert "call grasp/reset first" in remark(node)
    assert graph.change(node, "cleanup") == (False, "inactive")  # a latched vent is not forgotten
    assert graph.call(Trigger, "valve_controller/clear").success
    for _ in range(3):  # topics close and open under the executor's hands
        assert graph.change(node, "cleanup") == (True, "unconfigured")
        graph.spin_until(lambda: graph.test_node.count_publishers("valve_commands") == 0, "the topic closed")
        assert not np.array(valves.commands[-1].position).any()
        assert graph.change(node, "configure") == (True, "inactive")
        assert not valves.commanded().any()
    assert graph.change(node, "activate") == (True, "active")
    assert valves.fills()
    assert graph.change(node, "shutdown") == (True, "finalized")
    assert not np.array(valves.commands[-1].position).any()
    assert remark(node) == "finalized: no valve is commanded"


def test_a_transition_that_breaks_down_closes_the_valves(graph, monkeypatch):
    valves = Valves(graph, "pneumatics.yaml")
    node = valves.node
    assert graph.change(node, "configure")[0] and graph.change(node, "activate")[0] and valves.fills()

    def breaks(on):
        raise OSError("no way")

    monkeypatch.setattr(node, "let_air_flow", breaks)
    assert graph.change(node, "deactivate") == (False, "unconfigured")
    graph.spin_until(lambda: not np.array(valves.commands[-1].position).any(), "closed valves")
    assert remark(node) == "unconfigured: deactivate broke down: OSError: no way"
