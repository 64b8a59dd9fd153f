"""The valve controller's promises on its topics and its service."""

import math
import types

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.configuration import load_yaml
from mbpam_ros.nodes import runtime
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import LATCHED, STREAM
from mbpam_ros.nodes.valve_controller import ValveControllerNode

TICK_S = 0.01
WATCHDOG_S = 0.2
LIMIT_PA = 110e3
AMBIENT = np.zeros(16)


def channels(**pressure_pa):
    """Sixteen pressures, zero but for ``c<index>``."""
    values = np.zeros(16)
    for name, value in pressure_pa.items():
        values[int(name[1:])] = value
    return values


def setpoints(values, names=CHANNEL_NAMES):
    return joint_state(time_stamp(1.0), names, effort=values)


def air(word):
    return DiagnosticStatus(values=[KeyValue(key="air", value=word)])


def faults(status):
    return {item.key: item.value for item in status.values if item.key in CHANNEL_NAMES}


class Loops:
    """The node with its pressures in the test's hands: each message is answered by one command.

    The simulated time never starts, so no timer runs and the node knows time by the stamps alone. The observers are
    given bounds that any pressures keep to.
    """

    unwatched = ""

    def __init__(self, graph, **parameters):
        self.graph = graph
        parameters = {"pneumatics": self.unwatched, **parameters}
        self.node = graph.add(ValveControllerNode, use_sim_time=True, **parameters)
        self.commands = graph.listen(JointState, "valve_commands")
        self.reports = graph.listen(DiagnosticArray, "/diagnostics")
        self.pressures = graph.publisher(JointState, "chamber_states")
        self.setpoints = graph.publisher(JointState, "pressure_setpoints")
        self.grasp_state = graph.publisher(DiagnosticStatus, "grasp_state", LATCHED)
        self.time_s = 1.0

    def feed(self, pressure_pa, ticks=1):
        """Measure these pressures for some ticks and return the last openings."""
        for _ in range(ticks):
            self.time_s += TICK_S
            seen = len(self.commands)
            self.pressures.publish(joint_state(time_stamp(self.time_s), CHANNEL_NAMES, effort=pressure_pa))
            self.graph.spin_until(lambda seen=seen: len(self.commands) > seen, "a command")
        return spools(self.commands[-1])

    def feed_until(self, predicate, pressure_pa=AMBIENT):
        """Measure these pressures until the openings satisfy ``predicate``."""
        for _ in range(100):
            opening = self.feed(pressure_pa)
            if predicate(opening):
                return opening
        raise AssertionError(f"not within 100 ticks; last openings {opening}")

    def refuse(self, publisher, message):
        """Send something the node must refuse."""
        refused = self.node.refused_inputs
        publisher.publish(message)
        self.graph.spin_until(lambda: self.node.refused_inputs > refused, "the refusal")

    def clear(self):
        """Lift the vent, as the arbiter does in a reset."""
        assert self.graph.call(Trigger, "valve_controller/clear").success

    def enable(self, on):
        return self.graph.call(SetBool, "valve_controller/enable", SetBool.Request(data=on))

    def wait_for_health(self, level):
        """Return the latest report once it has this level."""
        self.graph.spin_until(
            lambda: self.reports and self.reports[-1].status[0].level == level, f"a report of level {level}"
        )
        return self.reports[-1].status[0]


@pytest.fixture(autouse=True)
def unwatched(tmp_path, monkeypatch):
    content = load_yaml("pneumatics.yaml")
    content["observer"] = {name: 1e9 for name in ("follow_threshold_pa", "move_threshold_pa", "jump_threshold_pa")}
    path = tmp_path / "unwatched.yaml"
    path.write_text(yaml.safe_dump(content))
    monkeypatch.setattr(Loops, "unwatched", str(path))


def spools(command):
    return np.array(command.position[: len(CHANNEL_NAMES)])


def test_the_air_is_off_until_it_is_enabled(graph):
    loops = Loops(graph)
    loops.setpoints.publish(setpoints(channels(c3=50e3)))
    assert not loops.feed(AMBIENT, ticks=10).any()
    assert loops.enable(True).success
    opening = loops.feed_until(lambda opening: opening.any())
    assert opening[3] > 0.1
    assert not np.delete(opening, 3).any()


def test_a_parameter_switches_the_air_on_at_start(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(channels(c3=50e3)))
    assert loops.feed_until(lambda opening: opening.any())[3] > 0.1


def test_before_its_first_set_points_a_controller_started_beside_a_gripper_that_holds_leaves_the_air_in(graph):
    loops = Loops(graph, enable_at_start=True)
    assert not loops.feed(np.full(16, 100e3), ticks=10).any()
    loops.setpoints.publish(setpoints(channels(c3=100e3)))
    assert loops.feed_until(lambda opening: (np.delete(opening, 3) < 0.0).all(), np.full(16, 100e3))[3] >= 0.0


def test_its_last_command_closes_every_valve(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    seen = len(loops.commands)
    loops.node.leave()
    graph.spin_until(lambda: len(loops.commands) > seen, "the last command")
    assert not spools(loops.commands[-1]).any()


def test_pressures_whose_stamp_stands_still_are_refused_and_the_valves_close(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    loops.refuse(loops.pressures, joint_state(time_stamp(loops.time_s), CHANNEL_NAMES, effort=AMBIENT))
    graph.set_time(1.0)
    graph.set_time(1.1)
    graph.spin_until(lambda: not spools(loops.commands[-1]).any(), "closed valves")


def test_a_command_carries_the_names_and_the_stamp_of_its_pressures(graph):
    loops = Loops(graph)
    loops.feed(AMBIENT)
    command = loops.commands[-1]
    assert tuple(command.name) == (*CHANNEL_NAMES, "supply")
    assert command.header.stamp == time_stamp(loops.time_s)
    assert len(command.position) == 17 and not command.velocity and not command.effort


def test_disabling_closes_every_valve(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    assert loops.enable(False).success
    assert not loops.feed(np.full(16, 20e3), ticks=3).any()
    assert "valve_controller/enable" in loops.wait_for_health(DiagnosticStatus.WARN).message


@pytest.mark.parametrize("reading", [math.nan, math.inf, -math.inf, -2e5])
def test_a_channel_without_a_valid_reading_closes_and_is_reported_by_the_watchdog(graph, reading):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    broken = channels(c6=reading)
    ticks = round(WATCHDOG_S / TICK_S)
    opening = loops.feed(broken, ticks=ticks)
    assert opening[6] == 0.0
    assert (np.delete(opening, 6) > 0.1).all()
    assert not loops.node.refused_inputs
    loops.feed(broken)
    assert faults(loops.wait_for_health(DiagnosticStatus.ERROR)) == {
        CHANNEL_NAMES[6]: "no valid reading (100 %): no fresh valid pressure"
    }
    assert loops.feed_until(lambda opening: opening[6] > 0.1)[6] > 0.1


def test_pressures_that_do_not_follow_the_valves_are_named_and_the_supply_stays_open_only_while_the_air_is_on(graph):
    loops = Loops(graph, pneumatics="pneumatics.yaml")
    loops.feed(AMBIENT)
    assert loops.commands[-1].name[-1] == "supply" and loops.commands[-1].position[-1] == 0.0
    assert loops.enable(True).success
    loops.setpoints.publish(setpoints(channels(c6=50e3)))
    loops.feed_until(lambda opening: opening[6] > 0.1)
    assert loops.commands[-1].position[-1] == 1.0
    assert loops.feed(AMBIENT, ticks=40)[6] == 0.0
    found = faults(loops.wait_for_health(DiagnosticStatus.ERROR))
    assert found.keys() == {CHANNEL_NAMES[6]} and found[CHANNEL_NAMES[6]].startswith("does not follow (")


def test_without_a_supply_valve_its_name_is_left_out(graph):
    loops = Loops(graph, supply_valve=False)
    loops.feed(AMBIENT)
    assert tuple(loops.commands[-1].name) == CHANNEL_NAMES


def test_silence_of_all_pressures_closes_every_valve_and_is_reported(graph):
    loops = Loops(graph, enable_at_start=True)
    graph.set_time(loops.time_s)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    graph.set_time(loops.time_s)
    seen = len(loops.commands)
    graph.set_time(loops.time_s + WATCHDOG_S + TICK_S)
    graph.spin_until(lambda: len(loops.commands) > seen, "a command of the watchdog")
    assert not spools(loops.commands[-1]).any()
    assert loops.wait_for_health(DiagnosticStatus.ERROR).message.startswith("16 channels at fault: ")


@pytest.mark.parametrize("enabled", [True, False])
def test_over_pressure_vents_its_chamber_at_once(graph, enabled):
    loops = Loops(graph, enable_at_start=enabled)
    opening = loops.feed(channels(c9=LIMIT_PA + 10.1e3))
    assert opening[9] == -1.0
    assert not np.delete(opening, 9).any()
    assert faults(loops.wait_for_health(DiagnosticStatus.ERROR)) == {
        CHANNEL_NAMES[9]: "over-pressure (100 %): more than a chamber may have"
    }


@pytest.mark.parametrize("reading", [50e3, math.nan])
def test_vent_in_the_grasp_state_vents_every_chamber_measured_or_not(graph, reading):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    loops.grasp_state.publish(air("vent"))
    loops.feed_until(lambda opening: (opening == -1.0).all(), np.full(16, reading))
    assert (loops.feed(np.full(16, reading), ticks=50) == -1.0).all()


def test_vent_needs_no_measurement_at_all(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.grasp_state.publish(air("vent"))
    graph.spin_until(lambda: any("vent" in report.status[0].message for report in loops.reports), "word of the vent")
    graph.set_time(1.0)
    graph.spin_until(lambda: loops.commands, "a command without pressures")
    assert (spools(loops.commands[-1]) == -1.0).all()


def test_hold_in_the_grasp_state_closes_every_valve_and_regulate_opens_them_again(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    loops.grasp_state.publish(air("hold"))
    loops.feed_until(lambda opening: not opening.any(), np.full(16, 30e3))
    assert not loops.feed(np.full(16, 30e3), ticks=20).any()
    loops.grasp_state.publish(air("regulate"))
    loops.feed_until(lambda opening: (opening > 0.1).all(), np.full(16, 30e3))


def test_an_arbiter_that_knows_of_no_stop_does_not_keep_what_is_being_vented(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.grasp_state.publish(air("vent"))
    loops.feed_until(lambda opening: (opening == -1.0).all(), np.full(16, 60e3))
    loops.grasp_state.publish(air("hold"))
    loops.grasp_state.publish(air("no word"))
    graph.spin_until(lambda: loops.node.refused_inputs == 1, "the message behind it")
    assert (loops.feed(np.full(16, 60e3), ticks=5) == -1.0).all()


def test_enabling_is_refused_while_the_arbiter_vents(graph):
    loops = Loops(graph)
    loops.grasp_state.publish(air("vent"))
    loops.feed_until(lambda opening: (opening == -1.0).all())
    refusal = loops.enable(True)
    assert not refusal.success
    assert "vent" in refusal.message and "grasp/reset" in refusal.message
    assert (loops.feed(AMBIENT, ticks=3) == -1.0).all()
    loops.clear()
    loops.grasp_state.publish(air("regulate"))
    loops.feed_until(lambda opening: not opening.any())
    assert loops.enable(True).success


def test_switching_the_air_off_does_not_end_a_vent_and_says_so(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.grasp_state.publish(air("vent"))
    loops.feed_until(lambda opening: (opening == -1.0).all())
    answer = loops.enable(False)
    assert answer.success and "vent" in answer.message
    assert (loops.feed(AMBIENT, ticks=3) == -1.0).all()
    loops.clear()
    loops.grasp_state.publish(air("regulate"))
    loops.feed_until(lambda opening: not opening.any())


def test_a_set_point_is_refused_while_the_arbiter_vents(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.grasp_state.publish(air("vent"))
    loops.feed_until(lambda opening: (opening == -1.0).all())
    loops.refuse(loops.setpoints, setpoints(channels(c0=50e3)))
    loops.clear()
    loops.grasp_state.publish(air("regulate"))
    loops.feed_until(lambda opening: not opening.any())
    assert not loops.feed(AMBIENT, ticks=10).any()


@pytest.mark.parametrize(
    "message",
    [
        setpoints(channels(c0=math.nan, c3=50e3)),
        setpoints(channels(c0=math.inf, c3=50e3)),
        setpoints(channels(c0=-1.0, c3=50e3)),
        setpoints(channels(c0=LIMIT_PA + 1.0, c3=50e3)),
        setpoints(channels(c3=50e3)[:15]),
        setpoints(channels(c3=50e3)[:15], names=CHANNEL_NAMES[:15]),
        setpoints(np.full(17, 50e3), names=(*CHANNEL_NAMES, "finger_5_chamber_1")),
        setpoints(channels(c3=50e3), names=(*CHANNEL_NAMES[:15], "finger_1_chamber_5")),
        setpoints(channels(c3=50e3), names=(*CHANNEL_NAMES[:15], CHANNEL_NAMES[0])),
        joint_state(time_stamp(1.0), CHANNEL_NAMES, position=channels(c3=50e3)),
        JointState(),
    ],
    ids=[
        "NaN",
        "infinity",
        "below zero",
        "above the limit",
        "a value missing",
        "a channel missing",
        "a channel too many",
        "an unknown name",
        "a name twice",
        "in the wrong field",
        "empty",
    ],
)
def test_wrong_set_points_are_refused_whole_and_the_next_right_ones_are_followed(graph, message):
    loops = Loops(graph, enable_at_start=True)
    loops.refuse(loops.setpoints, message)
    assert not loops.feed(AMBIENT, ticks=5).any()
    loops.setpoints.publish(setpoints(channels(c3=LIMIT_PA)))
    assert loops.feed_until(lambda opening: opening.any())[3] > 0.1


@pytest.mark.parametrize(
    "message",
    [
        joint_state(time_stamp(2.0), CHANNEL_NAMES, effort=AMBIENT[:15]),
        joint_state(time_stamp(2.0), CHANNEL_NAMES[:15], effort=AMBIENT[:15]),
        joint_state(time_stamp(2.0), (*CHANNEL_NAMES[:15], "pressure_16"), effort=AMBIENT),
        joint_state(time_stamp(2.0), (*CHANNEL_NAMES[:15], CHANNEL_NAMES[0]), effort=AMBIENT),
        JointState(),
    ],
    ids=["a value missing", "a channel missing", "an unknown name", "a name twice", "empty"],
)
def test_wrong_chamber_states_are_refused_without_a_command(graph, message):
    loops = Loops(graph)
    loops.refuse(loops.pressures, message)
    assert not loops.commands
    loops.feed(AMBIENT)
    assert loops.commands[0].header.stamp == time_stamp(loops.time_s)


@pytest.mark.parametrize("message", [DiagnosticStatus(), air("open wide")], ids=["no air", "an unknown word"])
def test_a_grasp_state_without_a_word_on_the_air_changes_nothing(graph, message):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    loops.refuse(loops.grasp_state, message)
    assert (loops.feed(AMBIENT) > 0.1).all()


def test_warnings_come_at_most_once_a_second_for_each_source(graph, monkeypatch):
    loops = Loops(graph)
    logs = graph.listen(Log, "/rosout", QoSProfile(depth=100))
    wall = types.SimpleNamespace(now_s=100.0)
    monkeypatch.setattr(runtime, "time", types.SimpleNamespace(monotonic=lambda: wall.now_s))

    def warnings():
        return [log.msg.split()[0] for log in logs if log.name == "valve_controller" and log.level == 30]

    for wall.now_s in np.linspace(100.0, 100.99, 12):
        loops.refuse(loops.setpoints, JointState())
        loops.refuse(loops.pressures, JointState())
    graph.spin_until(lambda: len(warnings()) >= 2, "the first warnings")
    wall.now_s = 101.0
    loops.refuse(loops.setpoints, JointState())
    graph.spin_until(lambda: len(warnings()) >= 3, "the next warning")
    assert warnings() == ["pressure_setpoints", "chamber_states", "pressure_setpoints"]
    assert loops.node.refused_inputs == 25


def test_the_number_of_refused_inputs_is_in_the_diagnostics(graph):
    loops = Loops(graph)
    loops.refuse(loops.setpoints, JointState())
    loops.node.publish_health()
    values = loops.wait_for_health(DiagnosticStatus.WARN).values
    assert ("refused_inputs", "1") in [(item.key, item.value) for item in values]


def test_a_simulation_started_anew_is_followed_at_once(graph):
    loops = Loops(graph, enable_at_start=True)
    graph.set_time(100.0)
    loops.time_s = 100.0
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    graph.set_time(0.5)
    loops.time_s = 0.5
    loops.feed_until(lambda opening: (opening > 0.1).all())
    assert loops.time_s < 0.6
    assert not any(faults(report.status[0]) for report in loops.reports)


def values(status):
    return {item.key: item.value for item in status.values}


class Arbiter:
    """An arbiter's signs of life and its word, in the test's hands."""

    def __init__(self, loops, runs=("alpha 17 0a",)):
        self.loops, self.runs = loops, list(runs)
        self.alive = loops.graph.publisher(Header, "grasp_arbiter/alive")
        self.timer = loops.graph.test_node.create_timer(0.05, self.beat)
        watched = loops.node._watched_nodes[0]
        loops.graph.spin_until(lambda: len(watched.alive) == len(runs), "signs of life taken")

    def beat(self):
        for run in self.runs:
            self.alive.publish(Header(frame_id=run))

    def say(self, phase, word="regulate"):
        message = air(word)
        message.values.append(KeyValue(key="phase", value=phase))
        self.loops.grasp_state.publish(message)


def until(loops, predicate, what):
    """Wait for what the node publishes as its state."""
    states = loops.graph.listen(DiagnosticStatus, "valve_controller/state", LATCHED)
    loops.graph.spin_until(lambda: states and predicate(values(states[-1]), states[-1].message), what)


def test_a_vent_asked_for_without_an_arbiter_is_latched_and_told_to_who_comes_late(graph):
    loops = Loops(graph, enable_at_start=True)
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    assert graph.call(Trigger, "valve_controller/vent").success
    assert (loops.feed(np.full(16, 30e3)) == -1.0).all()
    loops.grasp_state.publish(air("hold"))
    loops.grasp_state.publish(air("regulate"))
    loops.grasp_state.publish(air("no word"))
    graph.spin_until(lambda: loops.node.refused_inputs == 1, "the message behind them")
    assert (loops.feed(np.full(16, 30e3), ticks=3) == -1.0).all()
    until(loops, lambda said, _: said["vent_latched"] == "asked for by an operator", "the latched state")
    loops.clear()
    until(loops, lambda said, _: said["vent_latched"] == "" and said["air"] == "regulate", "the state after it")
    assert not loops.feed(AMBIENT, ticks=3).any()


def test_an_arbiter_that_falls_silent_while_a_grasp_closes_has_it_vented(graph):
    loops = Loops(graph, enable_at_start=True)
    arbiter = Arbiter(loops)
    arbiter.say("closing")
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    arbiter.runs.clear()
    until(loops, lambda said, _: "silent while a grasp closed" in said["vent_latched"], "the vent")
    assert (loops.feed(np.full(16, 30e3)) == -1.0).all()


def test_an_arbiter_that_falls_silent_while_a_grasp_holds_leaves_it_held_and_nothing_new_begins(graph):
    loops = Loops(graph, enable_at_start=True)
    arbiter = Arbiter(loops)
    arbiter.say("holding")
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
    arbiter.runs.clear()
    until(loops, lambda _, message: message == "the arbiter has fallen silent", "word of the silence")
    assert loops.wait_for_health(DiagnosticStatus.ERROR).message == "the arbiter has fallen silent"
    assert (loops.feed(np.full(16, 30e3), ticks=5) > 0.1).all()
    loops.refuse(loops.setpoints, setpoints(np.full(16, 80e3)))
    arbiter.runs.append("alpha 18 0c")
    until(loops, lambda _, message: message == "regulate", "the new arbiter")
    loops.setpoints.publish(setpoints(np.full(16, 80e3)))
    assert (loops.feed_until(lambda opening: (opening > 0.1).all(), np.full(16, 60e3)) > 0.1).all()


def test_two_arbiters_are_a_fault_that_names_both_before_a_valve_opens(graph):
    loops = Loops(graph, enable_at_start=True)
    arbiter = Arbiter(loops, runs=("alpha 17 0a", "beta 4 0b"))
    both = lambda _, message: "process 17 on alpha" in message and "process 4 on beta" in message  # noqa: E731
    until(loops, both, "both named")
    loops.refuse(loops.setpoints, setpoints(np.full(16, 50e3)))
    assert not loops.feed(AMBIENT, ticks=5).any()
    arbiter.runs.pop()
    until(loops, lambda _, message: message == "regulate", "one of them gone")
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())


def test_a_second_publisher_of_set_points_is_a_fault_that_names_both(graph):
    loops = Loops(graph, enable_at_start=True)
    intruder = Node("intruder", context=graph.test_node.context, use_global_arguments=False)
    graph.nodes.append(intruder)
    publisher = intruder.create_publisher(JointState, "pressure_setpoints", STREAM)
    named = "pressure_setpoints is published by /intruder and /test_node"
    until(loops, lambda _, message: message == named, "both named")
    loops.refuse(loops.setpoints, setpoints(np.full(16, 50e3)))
    intruder.destroy_publisher(publisher)
    until(loops, lambda _, message: message == "regulate", "the intruder gone")
    loops.setpoints.publish(setpoints(np.full(16, 50e3)))
    loops.feed_until(lambda opening: (opening > 0.1).all())
