"""Death, freeze, restart and duplicates of nodes that are processes, over real DDS, while a grasp closes and holds."""

import os
import signal
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.commands.system import NodeProcesses
from mbpam_ros.nodes.runtime import LATCHED

ENDS = ("plant", "pressure_sensor", "valve_controller", "grasp_arbiter")
"""The nodes that a grasp needs."""

VENTED_PA = 5e3


class Watched:
    """A gripper with its valves' own word beside the arbiter's."""

    def __init__(self, gripper):
        self.gripper = gripper
        self.valves = {}
        node = gripper.operator.node
        node.create_subscription(DiagnosticStatus, "valve_controller/state", self._on_valves, LATCHED)
        gripper.wait_for(lambda: self.valves, "the state of the valves")
        gripper.enable()

    def _on_valves(self, state):
        self.valves = {"message": state.message, **{item.key: item.value for item in state.values}}

    def stop_process(self, name, how):
        """Kill or freeze a node; return the time of it."""
        if how == "kill":
            self.gripper.kill(name)
        else:
            os.kill(self.gripper.processes.processes[name].pid, signal.SIGSTOP)
        return time.monotonic()

    def bring_back(self, name, how):
        if how == "kill":
            self.gripper.restart(name)
        else:
            os.kill(self.gripper.processes.processes[name].pid, signal.SIGCONT)

    def wait_for(self, predicate, what, since_s=None):
        self.gripper.wait_for(predicate, what)
        if since_s is not None:
            print(f"{what}: {1e3 * (time.monotonic() - since_s):.0f} ms")

    def close_half(self):
        """Begin a grasp and wait until the chambers fill."""
        self.wait_for(lambda: self.gripper.operator.call(Trigger, "grasp/envelope").success, "a grasp accepted")
        self.wait_for(lambda: np.nanmax(self.gripper.pressure_pa) > 15e3, "filling")

    def vented(self):
        return bool((self.gripper.pressure_pa < VENTED_PA).all())

    def back_to_idle(self):
        """The way back that is the same after every fault: release, reset, air on."""
        gripper = self.gripper
        self.wait_for(lambda: gripper.grasp.get("phase") == "fault", "the fault")
        gripper.operator.call(Trigger, "grasp/release")
        self.wait_for(self.vented, "vented chambers")
        self.wait_for(lambda: gripper.operator.call(Trigger, "grasp/reset").success, "a reset accepted")
        gripper.wait_for_phase("idle")
        gripper.operator.call(SetBool, "valve_controller/enable", SetBool.Request(data=True))


@pytest.fixture
def watched(start):
    return Watched(start(ENDS, arguments={"plant": ["-p", "camera_rate_hz:=0.0"]}))


# The other way round was tried by hand, once; here each takes seconds.
HOLDING_CLOSING = [("kill", "freeze")]


@pytest.mark.parametrize(("while_holding", "while_closing"), HOLDING_CLOSING)
def test_without_its_arbiter_the_valves_keep_what_is_held_and_end_what_closes(watched, while_holding, while_closing):
    gripper = watched.gripper
    gripper.close_fingers()
    gripper.lift()
    held_at_m, held_pa = gripper.height_m["object"], gripper.pressure_pa
    since_s = watched.stop_process("grasp_arbiter", while_holding)
    watched.wait_for(lambda: watched.valves["message"] == "the arbiter has fallen silent", "silence known", since_s)
    refusal = gripper.operator.call(SetBool, "valve_controller/enable", SetBool.Request(data=True))
    assert not refusal.success and "silent" in refusal.message
    watched.bring_back("grasp_arbiter", while_holding)
    gripper.wait_for_phase("fault")
    assert gripper.grasp["air"] == "hold"
    if while_holding == "kill":
        assert "started with air" in gripper.grasp["reason"]
    assert abs(gripper.height_m["object"] - held_at_m) < 0.005
    assert np.abs(gripper.pressure_pa - held_pa).max() < 2e3
    gripper.lower()
    watched.back_to_idle()

    watched.close_half()
    since_s = watched.stop_process("grasp_arbiter", while_closing)
    watched.wait_for(lambda: "silent while a grasp closed" in watched.valves["vent_latched"], "the vent", since_s)
    watched.wait_for(watched.vented, "vented chambers")
    watched.bring_back("grasp_arbiter", while_closing)
    watched.wait_for(lambda: "silent while a grasp closed" in gripper.grasp.get("reason", ""), "the arbiter knows")
    watched.back_to_idle()
    gripper.close_fingers()


@pytest.mark.parametrize(("while_holding", "while_closing"), HOLDING_CLOSING)
def test_a_stop_that_no_valve_confirms_says_so_and_is_done_when_they_are_back(watched, while_holding, while_closing):
    gripper = watched.gripper
    gripper.close_fingers()
    gripper.lift()
    held_at_m = gripper.height_m["object"]
    since_s = watched.stop_process("valve_controller", while_holding)
    watched.wait_for(lambda: "no sign of life" in gripper.grasp.get("reason", ""), "death known", since_s)
    assert gripper.grasp["air"] == "hold"
    gripper.lower()
    assert abs(gripper.height_m["object"] - held_at_m + 0.1) < 0.005
    since_s = time.monotonic()
    answer = gripper.operator.call(Trigger, "grasp/stop")
    print(f"the stop's answer: {1e3 * (time.monotonic() - since_s):.0f} ms: {answer.message}")
    assert not answer.success and "nobody answers" in answer.message and "finger_" in answer.message
    assert np.nanmax(gripper.pressure_pa) > 90e3
    watched.bring_back("valve_controller", while_holding)
    watched.wait_for(watched.vented, "vented chambers")
    watched.wait_for(lambda: watched.valves["vent_latched"], "the vent latched")
    watched.back_to_idle()

    watched.close_half()
    since_s = watched.stop_process("valve_controller", while_closing)
    watched.wait_for(lambda: "no sign of life" in gripper.grasp.get("reason", ""), "death known", since_s)
    assert gripper.grasp["air"] == "vent"
    assert np.nanmax(gripper.pressure_pa) < 100e3
    watched.bring_back("valve_controller", while_closing)
    watched.wait_for(watched.vented, "vented chambers")
    watched.back_to_idle()
    gripper.close_fingers()


@pytest.mark.parametrize("name", ["pressure_sensor", "plant"])
@pytest.mark.parametrize(("while_holding", "while_closing"), HOLDING_CLOSING)
def test_without_readings_nothing_fills_and_what_is_held_is_kept(watched, name, while_holding, while_closing):
    """Frozen for 5 s or killed, then back: a sensor whose readings end, and a driver that moves no valve any more."""
    gripper = watched.gripper
    for closing, how in ((False, while_holding), (True, while_closing)):
        if closing:
            watched.close_half()
        else:
            gripper.close_fingers()
        since_s = watched.stop_process(name, how)
        phases = []  # on a busy machine, a grasp that closed may hold by now

        def at_fault(phases=phases):
            phases.append(gripper.grasp["phase"])
            return phases[-1] == "fault"

        watched.wait_for(at_fault, f"fault without {name}", since_s)
        assert gripper.grasp["air"] == ("vent" if "closing" in phases else "hold"), str(gripper.grasp)
        if how == "freeze":
            watched.wait_for(lambda: time.monotonic() > since_s + 5.0, "five seconds")  # noqa: B023
        watched.bring_back(name, how)
        watched.wait_for(lambda: np.isfinite(gripper.pressure_pa).all(), "pressures")
        assert np.nanmax(gripper.pressure_pa) < 110e3
        watched.back_to_idle()
    gripper.close_fingers()


def test_a_latched_stop_survives_a_restart_of_either_node(watched):
    gripper = watched.gripper
    gripper.close_fingers()
    answer = gripper.operator.call(Trigger, "grasp/stop")
    assert answer.success and "valve_controller vents" in answer.message
    for name in ("grasp_arbiter", "valve_controller", "grasp_arbiter"):
        gripper.kill(name)
        if name == "grasp_arbiter":  # what its forerunner said last is no answer
            gripper.operator.grasp = {}
        else:
            watched.valves = {}
        gripper.restart(name)
        # Both know before the next is killed: of two that are lost at once, nobody is left who could tell.
        watched.wait_for(lambda: gripper.grasp.get("air") == "vent", f"{name}: the arbiter's word to vent")
        watched.wait_for(
            lambda: "stop requested" in watched.valves.get("vent_latched", ""), f"{name}: the vent latched"
        )
        gripper.wait_for_phase("fault")
        refusal = gripper.operator.call(Trigger, "grasp/envelope")
        assert not refusal.success
    watched.back_to_idle()
    watched.wait_for(lambda: watched.valves["vent_latched"] == "", "no vent latched")


def test_a_node_started_twice_is_a_fault_that_names_it_while_a_grasp_holds_and_while_it_closes(
    watched, domain, log_directory, launch
):
    gripper = watched.gripper
    for name in ("grasp_arbiter", "valve_controller", "pressure_sensor"):
        if name == "valve_controller":
            watched.close_half()
        else:
            gripper.close_fingers()
        environment = {"ROS_DOMAIN_ID": str(domain)}
        with NodeProcesses(log_directory / "twin", executables=[name], environment=environment, launch=launch):
            watched.wait_for(lambda: gripper.grasp.get("phase") == "fault", f"the fault of two {name}")

            def named(name=name):
                said = [health[1] for node, health in gripper.operator.health.items() if node.endswith(name)]
                return any("another node" in words or "2 nodes" in words for words in said)

            watched.wait_for(named, f"two {name} named")
            assert np.nanmax(gripper.pressure_pa) < 112e3
            assert not gripper.operator.call(Trigger, "grasp/envelope").success
        watched.back_to_idle()
