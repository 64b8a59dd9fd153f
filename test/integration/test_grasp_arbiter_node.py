"""The grasp arbiter's promises on its topics and services."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.action import GoalResponse
from rclpy.executors import await_or_execute
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.nodes import gripper_action
from mbpam_ros.nodes.grasp_arbiter import GraspArbiterNode
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import LATCHED

TICK_S = 0.02
GRIP_PA = {"envelope": 100e3, "short_rod": 100e3, "slender_rod": 105e3, "mid_rod": 100e3}
CHAMBERS_UNDER_PRESSURE = {
    "envelope": [(1,), (2,), (3,), (4,)],
    "short_rod": [(1, 4), (2,), (2, 3), (4,)],
    "slender_rod": [(4,), (2,), (2,), (4,)],
    "mid_rod": [(1, 4), (2, 3), (2, 3), (1, 4)],
}
"""Of fingers 1 to 4: those opposite to where the mode bends each finger."""


def grip(mode):
    values = np.zeros((4, 4))
    for finger, chambers in enumerate(CHAMBERS_UNDER_PRESSURE[mode]):
        values[finger, [chamber - 1 for chamber in chambers]] = GRIP_PA[mode]
    return values.ravel()


def marker(**changes):
    """A bulb of 60 mm as the camera sees it, with changes."""
    message = Marker(ns="sphere", type=Marker.SPHERE, action=Marker.ADD, text="bulb")
    message.header.frame_id = "gripper_base"
    message.pose.position.z = 0.085
    message.pose.orientation.w = 1.0
    message.scale.x = message.scale.y = message.scale.z = 0.060
    message.color.a = 0.9
    for path, value in changes.items():
        *parents, name = path.split("__")
        target = message
        for parent in parents:
            target = getattr(target, parent)
        setattr(target, name, value)
    return message


class Grasp:
    """The node in simulated time, with pressures and detections in the test's hands."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        self.node = graph.add(GraspArbiterNode, use_sim_time=True, **parameters)
        self.setpoints = graph.listen(JointState, "pressure_setpoints")
        self.states = graph.listen(DiagnosticStatus, "grasp_state", LATCHED)
        self.pressures = graph.publisher(JointState, "chamber_states")
        self.detections = graph.publisher(MarkerArray, "detections")
        self.diagnostics = graph.publisher(DiagnosticArray, "/diagnostics")
        self.time_s = 1.0
        self.measured_pa = np.zeros(16)
        self.follows = True
        graph.set_time(self.time_s)

    def tick(self):
        """Let one tick pass in which the pressures reach their set-points, unless the test holds them."""
        self.time_s += TICK_S
        if self.follows and self.setpoints:
            self.measured_pa = np.array(self.setpoints[-1].effort)
        self.pressures.publish(joint_state(time_stamp(self.time_s), CHANNEL_NAMES, effort=self.measured_pa))
        self.graph.set_time(self.time_s)

    def tick_until(self, predicate, what, limit_s=10.0):
        end_s = self.time_s + limit_s
        while not predicate():
            assert self.time_s < end_s, f"{what}: not within {limit_s:g} simulated seconds; {self.state}"
            self.tick()

    def call(self, name):
        return self.graph.call(Trigger, f"grasp/{name}")

    def hold(self, mode="envelope"):
        """Close in a mode and wait until it holds."""
        self.tick_until(lambda: self.call(mode).success, "a grasp accepted")
        self.tick_until(lambda: self.phase == "holding", "holding")

    def see(self, *markers):
        """Have the node take a detection: a refusal of the camera's grasp then names no missing detection."""
        self.detections.publish(self.stamped(*markers))

    def stamped(self, *markers):
        """The markers as a detection of this moment."""
        for each in markers:
            each.header.stamp = time_stamp(self.time_s)
        return MarkerArray(markers=markers)

    def refuse(self, publisher, message):
        """Send something the node must refuse."""
        refused = self.node.refused_inputs
        publisher.publish(message)
        self.graph.spin_until(lambda: self.node.refused_inputs > refused, "the refusal")

    def report(self, name, level, message, **values):
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        status = DiagnosticStatus(name=name, level=level, message=message, values=pairs)
        self.diagnostics.publish(DiagnosticArray(status=[status]))

    def report_both_well(self, *names):
        """Have both watched nodes report that they are well, and wait until the node has heard it."""
        for name in names or ("/pressure_sensor", "/valve_controller"):
            self.report(name, DiagnosticStatus.OK, "well")
        arbiter = self.node._arbiter
        self.graph.spin_until(lambda: "report" not in (arbiter.obstacle(self.time_s) or ""), "the reports taken")

    @property
    def state(self):
        return {item.key: item.value for item in self.states[-1].values} if self.states else {}

    @property
    def phase(self):
        return self.state.get("phase")

    @property
    def setpoint_pa(self):
        return np.array(self.setpoints[-1].effort)


@pytest.fixture
def grasp(graph):
    ready = Grasp(graph)
    ready.tick_until(lambda: ready.phase == "idle", "the first state")
    ready.report_both_well()
    return ready


def test_without_reports_of_sensor_and_valves_no_grasp_begins_and_the_refusal_says_what_to_do(graph):
    lonely = Grasp(graph)
    lonely.tick_until(lambda: lonely.phase == "idle", "the first state")
    refusal = lonely.call("envelope")
    assert not refusal.success
    assert "no health report from /pressure_sensor yet" in refusal.message
    assert "pressure_sensor_node" in refusal.message
    lonely.report_both_well()
    lonely.tick_until(lambda: lonely.call("envelope").success, "a grasp accepted")


def test_watched_nodes_may_have_other_names(graph):
    renamed = Grasp(graph, pressure_sensor_node="gauges", valve_controller_node="valves")
    renamed.tick_until(lambda: renamed.phase == "idle", "the first state")
    renamed.report_both_well("/gauges", "/valves")
    renamed.hold()
    renamed.report("/valves", DiagnosticStatus.ERROR, "valve 3 does not answer")
    renamed.tick_until(lambda: renamed.phase == "fault", "the fault")
    assert "valve 3 does not answer" in renamed.state["reason"]


def test_started_beside_chambers_with_air_it_keeps_the_object_and_waits_for_a_release(graph):
    restarted = Grasp(graph)
    restarted.follows, restarted.measured_pa = False, grip("envelope")
    restarted.tick_until(lambda: restarted.phase == "fault", "the fault")
    assert restarted.state["air"] == "hold"
    assert "started with air in finger_1_chamber_1" in restarted.state["reason"]
    np.testing.assert_array_equal(restarted.setpoint_pa, grip("envelope"))
    restarted.report_both_well()
    restarted.follows = True
    assert restarted.call("release").success
    restarted.tick_until(lambda: restarted.call("reset").success, "a reset accepted")
    restarted.hold()


def test_before_the_first_pressures_it_has_no_say_over_the_air(graph):
    silent = Grasp(graph)
    silent.report_both_well()
    for _ in range(60):
        silent.time_s += TICK_S
        graph.set_time(silent.time_s)
    assert not silent.call("envelope").success
    assert not silent.setpoints and not silent.states
    silent.tick_until(lambda: silent.states, "the state with the first pressures")
    assert silent.phase == "idle" and silent.states[-1].level == DiagnosticStatus.OK


def test_set_points_chosen_before_the_first_pressures_are_not_repeated_after_them(graph):
    restarted = Grasp(graph, tick_rate_hz=5.0)  # it decides at 1.4 and 1.6 s, and repeats its set-points at 1.5 s
    restarted.report_both_well()
    graph.set_time(1.42)
    assert not restarted.call("envelope").success  # a decision, without pressures
    restarted.follows, restarted.measured_pa = False, grip("envelope")
    restarted.pressures.publish(joint_state(time_stamp(1.42), CHANNEL_NAMES, effort=restarted.measured_pa))
    graph.spin_until(lambda: restarted.node._arbiter.obstacle(1.42) is None, "the pressures taken")
    restarted.time_s = 1.42
    restarted.tick_until(lambda: len(restarted.setpoints) > 1, "set-points")
    for message in restarted.setpoints:
        np.testing.assert_array_equal(message.effort, grip("envelope"))


def test_a_mode_answers_with_what_became_of_it_where_that_is_asked_for(graph):
    grasp = Grasp(graph, wait_for_result=True)
    grasp.report_both_well()
    grasp.tick_until(lambda: grasp.phase == "idle", "idle")
    client = graph.test_node.create_client(Trigger, "grasp/envelope")
    graph.spin_until(client.service_is_ready, "the service")
    answers = []
    for grasp.follows in (True, False):  # the air comes; it does not
        asked = client.call_async(Trigger.Request())
        grasp.tick_until(lambda: grasp.phase == "closing", "closing")
        assert not asked.done()
        grasp.tick_until(lambda: grasp.phase != "closing", "the end")
        graph.spin_until(asked.done, "the answer")
        answers.append(asked.result())
        grasp.call("release")
        grasp.tick_until(lambda: grasp.phase != "releasing", "released")
    assert answers[0].success and answers[0].message.startswith("holding: ")
    assert not answers[1].success and answers[1].message.startswith("fault: ")
    assert not grasp.call("envelope").success  # at once: a fault is latched


@pytest.mark.parametrize("mode", CHAMBERS_UNDER_PRESSURE)
def test_each_mode_fills_the_chambers_opposite_to_its_bends(grasp, mode):
    answer = grasp.call(mode)
    assert answer.success and mode in answer.message
    grasp.graph.spin_until(lambda: grasp.phase == "closing", "closing")
    grasp.graph.spin_until(lambda: grasp.setpoint_pa.any(), "set-points")
    np.testing.assert_array_equal(grasp.setpoint_pa, grip(mode))
    assert tuple(grasp.setpoints[-1].name) == CHANNEL_NAMES
    assert not grasp.setpoints[-1].position and not grasp.setpoints[-1].velocity
    assert (grasp.state["mode"], grasp.state["source"]) == (mode, "operator")
    grasp.tick_until(lambda: grasp.phase == "holding", "holding")
    assert grasp.states[-1].level == DiagnosticStatus.OK


def test_the_camera_s_grasp_takes_mode_and_wrist_pose_from_the_object(grasp):
    poses = grasp.graph.listen(PoseStamped, "grasp_pose", LATCHED)
    grasp.see(marker(pose__position__x=0.01))
    answer = grasp.call("auto")
    assert answer.success, answer.message
    grasp.graph.spin_until(lambda: grasp.phase == "closing" and poses, "closing and a wrist pose")
    assert (grasp.state["mode"], grasp.state["source"], grasp.state["object"]) == ("envelope", "camera", "bulb")
    assert poses[-1].header.frame_id == "gripper_base"
    assert math.isclose(poses[-1].pose.position.x, 0.01, abs_tol=1e-6)
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("envelope"))


def test_a_late_subscriber_sees_the_state_and_the_wrist_pose(grasp):
    grasp.see(marker())
    assert grasp.call("auto").success
    grasp.tick_until(lambda: grasp.phase == "holding", "holding")
    states = grasp.graph.listen(DiagnosticStatus, "grasp_state", LATCHED)
    poses = grasp.graph.listen(PoseStamped, "grasp_pose", LATCHED)
    grasp.graph.spin_until(lambda: states and poses, "the latched messages")
    assert {item.key: item.value for item in states[0].values}["phase"] == "holding"


def test_before_any_pressure_a_grasp_is_refused_for_want_of_readings(graph):
    grasp = Grasp(graph)
    grasp.report_both_well()
    refusal = grasp.call("envelope")
    assert not refusal.success
    assert "no valid pressure reading" in refusal.message
    assert not any(np.array(message.effort).any() for message in grasp.setpoints)


def test_the_camera_s_grasp_is_refused_without_a_detection(grasp):
    refusal = grasp.call("auto")
    assert not refusal.success
    assert "no detection" in refusal.message


def test_the_camera_s_grasp_is_refused_when_the_detection_is_old(grasp):
    grasp.see(marker())
    end_s = grasp.time_s + 1.1
    grasp.tick_until(lambda: grasp.time_s > end_s, "1.1 s")
    refusal = grasp.call("auto")
    assert not refusal.success
    assert " s old" in refusal.message


def test_the_camera_s_grasp_is_refused_when_nothing_is_in_view(grasp):
    grasp.see(marker(action=Marker.DELETEALL))
    refusal = grasp.call("auto")
    assert not refusal.success
    assert refusal.message and "no detection yet" not in refusal.message
    grasp.graph.spin_until(lambda: grasp.phase == "idle", "the state")


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({"color__a": 0.3}, "confiden"),
        ({"pose__position__x": 0.08}, "mm"),
        ({"pose__position__z": 0.30}, "mm"),
        ({"scale__x": 0.01, "scale__y": 0.01, "scale__z": 0.01}, "mm"),
    ],
    ids=["unsure", "beside the palm", "too deep", "too thin"],
)
def test_the_camera_s_grasp_of_an_object_out_of_reach_is_refused_with_the_reason(grasp, changes, reason):
    grasp.see(marker(**changes))
    refusal = grasp.call("auto")
    assert not refusal.success
    assert reason in refusal.message


@pytest.mark.parametrize("second", ["short_rod", "auto"])
def test_an_equal_or_lower_source_is_refused_while_an_object_is_held(grasp, second):
    grasp.hold("envelope")
    grasp.see(marker())
    refusal = grasp.call(second)
    assert not refusal.success
    assert "operator's envelope grasp (holding)" in refusal.message and "grasp/release" in refusal.message
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("envelope"))
    grasp.tick()
    assert grasp.phase == "holding"


def test_the_operator_preempts_the_camera(grasp):
    grasp.see(marker())
    assert grasp.call("auto").success
    grasp.tick_until(lambda: grasp.phase == "holding", "holding")
    answer = grasp.call("mid_rod")
    assert answer.success and "preempts" in answer.message
    grasp.tick_until(lambda: grasp.phase == "holding" and grasp.state["mode"] == "mid_rod", "the operator's grasp")
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("mid_rod"))


def test_release_opens_and_ends_idle(grasp):
    grasp.hold()
    grasp.follows = False
    assert grasp.call("release").success
    grasp.graph.spin_until(lambda: grasp.phase == "releasing", "releasing")
    assert not grasp.setpoint_pa.any()
    assert grasp.state["air"] == "regulate"
    refusal = grasp.call("envelope")
    assert not refusal.success and "releasing" in refusal.message
    grasp.follows = True
    grasp.tick_until(lambda: grasp.phase == "idle", "idle")
    assert grasp.call("envelope").success


@pytest.mark.parametrize("before", ["idle", "closing", "holding"])
def test_stop_vents_from_every_phase_and_reset_waits_until_the_pressures_are_down(grasp, before):
    if before == "holding":
        grasp.hold()
    elif before == "closing":
        assert grasp.call("envelope").success
        grasp.tick_until(lambda: grasp.measured_pa.any(), "pressure")
    grasp.follows, grasp.measured_pa = False, grip("envelope")
    grasp.tick()
    answer = grasp.call("stop")
    assert not answer.success  # there are no valves
    assert "nobody answers" in answer.message and "finger_1_chamber_1 at 100000 Pa" in answer.message
    grasp.graph.spin_until(lambda: grasp.phase == "fault", "the fault")
    assert (grasp.state["air"], grasp.state["source"]) == ("vent", "safety")
    assert grasp.states[-1].level == DiagnosticStatus.ERROR
    assert not grasp.setpoint_pa.any()
    for name, reason in (("envelope", "fault latched"), ("auto", "fault latched"), ("reset", "pressure is still up")):
        refusal = grasp.call(name)
        assert not refusal.success
        assert reason in refusal.message
    grasp.follows = True
    grasp.tick_until(lambda: grasp.call("reset").success, "reset accepted")
    grasp.tick_until(lambda: grasp.phase == "idle", "idle")
    assert grasp.state["air"] == "regulate"
    assert grasp.call("envelope").success


def test_reset_without_a_fault_says_what_the_gripper_does(grasp):
    assert "no fault" in grasp.call("reset").message
    grasp.hold()
    refusal = grasp.call("reset")
    assert not refusal.success
    assert "holding" in refusal.message and "grasp/release" in refusal.message


@pytest.mark.parametrize("loss", ["NaN", "silence"])
def test_pressures_lost_while_holding_keep_the_object_until_release(grasp, loss):
    grasp.hold()
    if loss == "NaN":
        grasp.follows, grasp.measured_pa = False, np.full(16, math.nan)
        grasp.tick_until(lambda: grasp.phase == "fault", "the fault", limit_s=0.5)
    else:
        grasp.graph.set_time(grasp.time_s + 0.35)
        grasp.graph.spin_until(lambda: grasp.phase == "fault", "the fault")
    assert grasp.state["air"] == "hold"
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("envelope"))
    refusal = grasp.call("reset")
    assert not refusal.success and "grasp/release" in refusal.message
    assert grasp.call("release").success
    grasp.graph.spin_until(lambda: grasp.state["air"] == "vent", "the vent")
    assert not grasp.setpoint_pa.any()


def test_over_pressure_while_holding_vents(grasp):
    grasp.hold()
    grasp.follows, grasp.measured_pa = False, np.full(16, 121e3)
    grasp.tick_until(lambda: grasp.phase == "fault", "the fault")
    assert grasp.state["air"] == "vent"
    assert "over-pressure" in grasp.state["reason"]


@pytest.mark.parametrize("node", ["pressure_sensor", "valve_controller"])
def test_a_fault_of_sensor_or_valves_prevents_a_grasp_and_its_end_allows_one(grasp, node):
    grasp.report(f"/{node}", DiagnosticStatus.ERROR, "something broke")
    refusal = grasp.call("envelope")
    assert not refusal.success
    assert node in refusal.message and "something broke" in refusal.message
    grasp.report(f"/{node}", DiagnosticStatus.OK, "well")
    assert grasp.call("envelope").success


def test_a_grasp_is_refused_while_the_air_is_off(grasp):
    grasp.report("/valve_controller", DiagnosticStatus.WARN, "air is off", enabled="false")
    refusal = grasp.call("envelope")
    assert not refusal.success
    assert "air is off" in refusal.message


def test_the_fault_of_another_gripper_s_node_is_none_of_ours(grasp):
    grasp.report("/left/valve_controller", DiagnosticStatus.ERROR, "something broke")
    assert grasp.call("envelope").success


@pytest.mark.parametrize(
    "changes",
    [
        {"pose__position__x": math.nan},
        {"pose__position__z": math.inf},
        {"pose__orientation__w": 0.0},
        {"pose__orientation__x": math.nan},
        {"scale__x": math.nan},
        {"scale__x": -0.06, "scale__y": -0.06, "scale__z": -0.06},
        {"scale__z": 0.0},
        {"header__frame_id": "camera_optical"},
        {"header__frame_id": ""},
        {"type": Marker.MESH_RESOURCE},
        {"color__a": -0.1},
        {"color__a": math.nan},
    ],
    ids=str,
)
def test_wrong_detections_are_refused_and_the_next_right_one_is_used(grasp, changes):
    grasp.refuse(grasp.detections, grasp.stamped(marker(), marker(**changes)))
    refusal = grasp.call("auto")
    assert not refusal.success and "no detection yet" in refusal.message
    grasp.see(marker())
    assert grasp.call("auto").success


@pytest.mark.parametrize(
    "message",
    [
        joint_state(time_stamp(1.0), CHANNEL_NAMES, effort=np.zeros(15)),
        joint_state(time_stamp(1.0), CHANNEL_NAMES[:15], effort=np.zeros(15)),
        joint_state(time_stamp(1.0), (*CHANNEL_NAMES[:15], "finger_4_chamber_5"), effort=np.zeros(16)),
        joint_state(time_stamp(1.0), (*CHANNEL_NAMES[:15], CHANNEL_NAMES[0]), effort=np.zeros(16)),
        JointState(),
    ],
    ids=["a value missing", "a channel missing", "an unknown name", "a name twice", "empty"],
)
def test_wrong_chamber_states_are_refused_and_count_as_no_reading(graph, message):
    grasp = Grasp(graph)
    grasp.report_both_well()
    grasp.refuse(grasp.pressures, message)
    refusal = grasp.call("envelope")
    assert not refusal.success and "no valid pressure reading" in refusal.message
    grasp.tick_until(lambda: grasp.call("envelope").success, "a grasp accepted")


def test_set_points_are_repeated_for_a_valve_controller_started_anew(grasp):
    grasp.hold()
    seen = len(grasp.setpoints)
    grasp.tick_until(lambda: len(grasp.setpoints) > seen + 1, "two repeats", limit_s=1.5)
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("envelope"))


def test_a_simulated_clock_set_back_neither_faults_nor_drops(grasp):
    grasp.hold()
    grasp.time_s = 0.1
    seen = len(grasp.setpoints)
    grasp.tick_until(lambda: len(grasp.setpoints) > seen + 1, "two repeats of the set-points")
    assert grasp.phase == "holding"
    np.testing.assert_array_equal(grasp.setpoint_pa, grip("envelope"))
    assert grasp.call("release").success
    grasp.tick_until(lambda: grasp.phase == "idle", "idle")


@pytest.mark.parametrize("age_s", [1.5, None], ids=["old", "1970"])
def test_a_detection_that_is_old_by_its_stamp_or_has_none_starts_nothing(grasp, age_s):
    end_s = grasp.time_s + 2.0
    grasp.tick_until(lambda: grasp.time_s > end_s, "2 s")
    message = grasp.stamped(marker())
    message.markers[0].header.stamp = time_stamp(0.0 if age_s is None else grasp.time_s - age_s)
    grasp.refuse(grasp.detections, message)
    refusal = grasp.call("auto")
    assert not refusal.success and "no detection yet" in refusal.message


def test_a_detection_counts_from_its_picture_not_from_its_arrival(grasp):
    message = grasp.stamped(marker())
    end_s = grasp.time_s + 0.6
    grasp.tick_until(lambda: grasp.time_s > end_s, "0.6 s")
    grasp.detections.publish(message)
    end_s = grasp.time_s + 0.6
    grasp.tick_until(lambda: grasp.time_s > end_s, "0.6 s more")
    refusal = grasp.call("auto")
    assert not refusal.success and "last detection is 1.2 s old" in refusal.message


class Valves:
    """A valve controller's services and state, in the test's hands."""

    def __init__(self, grasp, tells_state=True):
        node = grasp.graph.test_node
        self.tells_state = tells_state
        self.state = node.create_publisher(DiagnosticStatus, "valve_controller/state", LATCHED)
        self.calls = []
        for name in ("vent", "clear"):
            node.create_service(Trigger, f"valve_controller/{name}", partial(self.answer, name))

    def answer(self, name, _, response):
        self.calls.append(name)
        self.latch("stop requested" if name == "vent" else "")
        response.success = True
        return response

    def latch(self, reason):
        if self.tells_state:
            self.state.publish(DiagnosticStatus(values=[KeyValue(key="vent_latched", value=reason)]))


def test_a_stop_is_answered_with_what_the_valves_and_the_pressures_confirm(grasp):
    valves = Valves(grasp)
    grasp.hold()
    assert grasp.node._vent.wait_for_service(5.0)
    stop = grasp.graph.test_node.create_client(Trigger, "grasp/stop")
    grasp.graph.spin_until(stop.service_is_ready, "the service")
    answers = [stop.call_async(Trigger.Request()) for _ in range(2)]
    grasp.follows, grasp.measured_pa = False, 0.9 * grip("envelope")
    grasp.graph.spin_until(lambda: grasp.phase == "fault", "the stop")
    grasp.tick()
    grasp.graph.spin_until(lambda: all(answer.done() for answer in answers), "both answers")
    for answer in answers:
        assert answer.result().success
        assert "valve_controller vents, all fall, the highest is 90000 Pa" in answer.result().message
    assert valves.calls == ["vent"]


def test_a_reset_has_the_vent_at_the_valves_lifted_and_a_vent_there_is_a_fault_here(grasp):
    valves = Valves(grasp)
    assert grasp.node._clear.wait_for_service(5.0)
    valves.latch("asked for by an operator")
    grasp.tick_until(lambda: grasp.phase == "fault", "the fault")
    assert "vented at the valves: asked for by an operator" in grasp.state["reason"]
    assert grasp.state["air"] == "vent"
    grasp.tick_until(lambda: grasp.call("reset").success, "a reset accepted")
    assert valves.calls == ["clear"]
    grasp.tick_until(lambda: grasp.phase == "idle", "idle")


def test_a_vent_of_which_no_word_came_is_lifted_by_a_reset_too(grasp):
    valves = Valves(grasp, tells_state=False)
    grasp.hold()
    assert grasp.node._vent.wait_for_service(5.0)
    grasp.call("stop")
    grasp.tick_until(lambda: grasp.call("reset").success, "a reset accepted")
    assert valves.calls == ["vent", "clear"]


def test_a_reset_waits_for_the_answer_to_a_vent_that_may_still_come(grasp):
    """A request lost on the network comes seconds later: it must not vent the grasp after the reset."""
    valves, lost = Valves(grasp), Future()
    grasp.node._vent = SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _: lost)
    grasp.hold()
    assert grasp.node._clear.wait_for_service(5.0)
    grasp.call("stop")
    grasp.tick_until(lambda: "on its way to valve_controller" in grasp.call("reset").message, "the refusal")
    lost.set_result(Trigger.Response(success=True))
    grasp.tick_until(lambda: grasp.call("reset").success, "a reset accepted")
    assert valves.calls == ["clear"]


def test_a_vent_latched_at_the_valves_stands_for_an_arbiter_started_anew(graph):
    state = graph.test_node.create_publisher(DiagnosticStatus, "valve_controller/state", LATCHED)
    state.publish(DiagnosticStatus(values=[KeyValue(key="vent_latched", value="stop requested")]))
    restarted = Grasp(graph)
    restarted.report_both_well()
    restarted.tick_until(lambda: restarted.phase == "fault", "the stop of before")
    assert "stop requested" in restarted.state["reason"] and restarted.state["air"] == "vent"
    refusal = restarted.call("reset")
    assert not refusal.success and "valve_controller does not answer" in refusal.message


@pytest.mark.parametrize("node", ["pressure_sensor", "valve_controller"])
def test_a_node_that_falls_silent_is_a_fault_and_one_that_runs_twice_too(grasp, node):
    alive = grasp.graph.publisher(Header, f"{node}/alive")
    runs = ["alpha 17 0a"]
    grasp.graph.test_node.create_timer(0.05, lambda: [alive.publish(Header(frame_id=run)) for run in runs])
    obstacle = lambda: grasp.node._arbiter.obstacle(grasp.time_s) or ""  # noqa: E731
    grasp.hold()
    runs.append("beta 4 0b")
    grasp.tick_until(lambda: grasp.phase == "fault", "the fault", limit_s=1e3)
    assert "process 17 on alpha" in grasp.state["reason"] and "process 4 on beta" in grasp.state["reason"]
    assert grasp.state["air"] == "hold"
    runs.pop()
    both = ("/pressure_sensor", "/valve_controller")
    report = lambda: [grasp.report(name, DiagnosticStatus.OK, "well") for name in both]  # noqa: E731
    grasp.graph.test_node.create_timer(0.1, report)
    grasp.graph.spin_until(lambda: "process" not in obstacle(), "one of them gone")
    runs.clear()
    grasp.graph.spin_until(lambda: f"{node}: no sign of life" in obstacle(), "the silence")


class StandInForActions:
    """Types of control_msgs, which no wheel holds, and the server of rclpy, which serves none without C code of theirs.

    It calls back as rclpy's does: the goal is asked about, then executed as a task of the executor.
    """

    servers: dict[str, "StandInForActions"] = {}

    def __init__(self, node, kind, name, execute, *, goal_callback, cancel_callback):
        self.node, self.kind, self.execute, self.ask = node, kind, execute, goal_callback
        self.servers[name] = self

    def send(self, goal):
        """Return the handle of a goal that was accepted, None for one that was rejected."""
        if self.ask(goal) is not GoalResponse.ACCEPT:
            return None
        handle = SimpleNamespace(status="executing", feedback=[], is_cancel_requested=False)
        handle.publish_feedback = handle.feedback.append
        for name in ("succeed", "abort", "canceled"):
            setattr(handle, name, partial(setattr, handle, "status", name))
        handle.task = self.node.executor.create_task(await_or_execute, self.execute, handle)
        return handle

    @classmethod
    def install(cls, monkeypatch):
        cls.servers = {}
        numbers = lambda: SimpleNamespace(position=0.0, effort=0.0, stalled=False, reached_goal=False)  # noqa: E731
        state = lambda **more: SimpleNamespace(state=None, **more)  # noqa: E731
        kinds = {
            "GripperCommand": SimpleNamespace(Feedback=numbers, Result=numbers),
            "ParallelGripperCommand": SimpleNamespace(
                Feedback=state, Result=partial(state, stalled=False, reached_goal=False)
            ),
        }
        monkeypatch.setattr(gripper_action, "action_type", kinds.get)
        monkeypatch.setattr(gripper_action, "ActionServer", cls)

    @staticmethod
    def two_numbers(position, max_effort=0.0):
        return SimpleNamespace(command=SimpleNamespace(position=position, max_effort=max_effort))


def test_a_gripper_command_closes_holds_opens_and_ends_as_other_grippers_do(graph, monkeypatch):
    StandInForActions.install(monkeypatch)
    grasp = Grasp(graph, action_mode="envelope")
    server, goal = StandInForActions.servers["grasp/gripper_cmd"], StandInForActions.two_numbers
    assert server.send(goal(0.0)) is None  # nothing is known of sensor and valves
    grasp.tick_until(lambda: grasp.phase == "idle", "the first state")
    grasp.report_both_well()

    closing = server.send(goal(0.0, 0.2))
    grasp.tick_until(lambda: closing.feedback, "feedback")
    assert grasp.phase == "closing" and 0.0 < grasp.setpoint_pa.max() < GRIP_PA["envelope"]
    grasp.tick_until(closing.task.done, "the result")
    result = closing.task.result()
    assert closing.status == "succeed" and result.reached_goal and not result.stalled
    assert (result.position, result.effort) == (0.0, pytest.approx(0.2, abs=1e-3))
    assert server.send(goal(math.nan)) is None and server.send(goal(0.0, -1.0)) is None
    assert server.send(goal(0.02)) is None  # it holds something

    opening = server.send(goal(0.08))
    grasp.tick_until(opening.task.done, "open")
    assert opening.status == "succeed" and opening.task.result().position == pytest.approx(0.08)

    grasp.follows = False  # the air is slow
    cancelled = server.send(goal(0.0))
    grasp.tick_until(lambda: cancelled.feedback, "feedback")
    cancelled.is_cancel_requested = True
    grasp.tick_until(cancelled.task.done, "the end")
    assert cancelled.status == "canceled" and not grasp.setpoint_pa.any()
    grasp.tick_until(lambda: grasp.phase == "idle", "open")

    replaced = server.send(goal(0.0))
    grasp.tick_until(lambda: replaced.feedback, "feedback")
    following = server.send(goal(0.08))
    grasp.tick_until(lambda: replaced.task.done() and following.task.done(), "both ends")
    assert (replaced.status, following.status) == ("abort", "succeed")

    stopped = server.send(goal(0.0))
    grasp.call("stop")
    grasp.tick_until(stopped.task.done, "the end")
    assert stopped.status == "abort" and not stopped.task.result().reached_goal


def test_a_parallel_gripper_command_is_a_joint_state_and_the_camera_chooses_the_mode(graph, monkeypatch):
    StandInForActions.install(monkeypatch)
    grasp = Grasp(graph)
    grasp.tick_until(lambda: grasp.phase == "idle", "the first state")
    grasp.report_both_well()
    server = StandInForActions.servers["grasp/parallel_gripper_cmd"]
    goal = lambda *position: SimpleNamespace(command=JointState(position=position))  # noqa: E731
    assert server.send(goal()) is None and server.send(goal(0.0)) is None  # no position; no detection yet
    grasp.see(marker())
    grasp.tick_until(lambda: grasp.node._arbiter._sightings.newest, "a detection")
    closing = server.send(goal(0.0))
    grasp.tick_until(closing.task.done, "the result")
    result = closing.task.result()
    assert closing.status == "succeed" and result.reached_goal and list(result.state.name) == ["tip_opening"]
    assert (grasp.state["mode"], grasp.state["source"]) == ("envelope", "camera")
    assert list(closing.feedback[0].state.position)[0] <= 0.08


def test_without_types_of_actions_there_is_no_server(grasp):
    assert gripper_action.action_type("GripperCommand") is not None or not grasp.node._actions.active
