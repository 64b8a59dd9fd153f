"""The state estimator's promises on its topics."""

import math

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, Vector3, Vector3Stamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import BEND_NAMES, CHANNEL_NAMES, FINGER_NAMES
from mbpam_ros.actuator.metamodel import load_metamodel
from mbpam_ros.actuator.named_designs import load_design
from mbpam_ros.configuration import ConfigError, load_yaml
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.state_estimator import StateEstimatorNode

FULL_PA = 100e3
BEND_AZIMUTH_DEG = {
    (1,): 225,
    (2,): 315,
    (3,): 45,
    (4,): 135,
    (1, 2): 270,
    (2, 3): 0,
    (3, 4): 90,
    (4, 1): 180,
}
"""Chambers under pressure and where the muscle bends: away from them."""


def pressures(fingers, pressure_pa=FULL_PA):
    """Sixteen pressures from the chambers (1 to 4) under pressure in each finger."""
    values = np.zeros((4, 4))
    for finger, chambers in enumerate(fingers):
        values[finger, [chamber - 1 for chamber in chambers]] = pressure_pa
    return values.ravel()


class Estimates:
    """The node, the test's pressures, and what comes of them."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        self.node = graph.add(StateEstimatorNode, **parameters)
        self.joints = graph.listen(JointState, "joint_states")
        self.tips = graph.listen(PoseArray, "finger_tips")
        self.forces = graph.listen(JointState, "finger_forces")
        self.reports = graph.listen(DiagnosticArray, "/diagnostics")
        self.pressures = graph.publisher(JointState, "chamber_states")
        # The node builds nothing that nobody listens to.
        topics = {"/joint_states", "/finger_tips", "/finger_forces"}
        heard = [each for each in self.node.publishers if each.topic_name in topics]
        graph.spin_until(lambda: all(each.get_subscription_count() for each in heard), "listeners known to the node")

    def feed(self, values, time_s=1.0):
        """Measure these pressures once."""
        seen = len(self.joints)
        self.pressures.publish(joint_state(time_stamp(time_s), CHANNEL_NAMES, effort=values))
        self.graph.spin_until(
            lambda: min(len(self.joints), len(self.tips), len(self.forces)) > seen, "joints, tips and forces"
        )

    def listen_to_markers(self):
        """Return a list that fills with the messages of finger_markers."""
        markers = self.graph.listen(MarkerArray, "finger_markers")
        (publisher,) = (each for each in self.node.publishers if each.topic_name == "/finger_markers")
        self.graph.spin_until(publisher.get_subscription_count, "a listener known to the node")
        return markers

    def refuse(self, message):
        """Send something the node must refuse."""
        refused = self.node.refused_inputs
        self.pressures.publish(message)
        self.graph.spin_until(lambda: self.node.refused_inputs > refused, "the refusal")

    @property
    def bend_rad(self):
        return np.array(self.joints[-1].position).reshape(4, 2)


def test_gravity_from_the_arm_moves_the_fingers_and_a_bad_one_leaves_the_last(graph):
    estimates = Estimates(graph)
    gravity = graph.publisher(Vector3Stamped, "gravity")
    estimates.feed(np.zeros(16), 1.0)
    np.testing.assert_allclose(estimates.bend_rad, 0.0, atol=1e-9)
    seen = estimates.node._gravity_m_s2
    level = Vector3Stamped(vector=Vector3(x=2.0))
    level.header.frame_id = "gripper_base"
    gravity.publish(level)
    graph.spin_until(lambda: estimates.node._gravity_m_s2 is not seen, "gravity")
    for bad in (Vector3Stamped(), Vector3Stamped(vector=Vector3(z=1.0))):
        bad.header.frame_id = "" if bad.vector.z else "gripper_base"
        refused = estimates.node.refused_inputs
        gravity.publish(bad)
        graph.spin_until(lambda refused=refused: estimates.node.refused_inputs > refused, "the refusal")
    for index in range(1, 100):
        estimates.feed(np.zeros(16), 1.0 + 0.01 * index)
    assert (estimates.bend_rad[:, 0] > math.radians(5.0)).all()
    tips, bases = estimates.tips[-1].poses, load_gripper().finger_base_m
    assert all(tip.position.x - base[0] > 0.005 for tip, base in zip(tips, bases, strict=True))


def test_when_the_pressures_end_its_health_says_so_and_no_fingers_are_drawn(graph):
    estimates = Estimates(graph, use_sim_time=True)
    markers = estimates.listen_to_markers()
    graph.set_time(1.0)
    estimates.feed(np.zeros(16))
    graph.spin_until(lambda: markers, "fingers")
    graph.set_time(1.6)
    estimates.node.publish_health()
    stale = lambda: [report for report in estimates.reports if "for 0.5 s" in report.status[0].message]  # noqa: E731
    graph.spin_until(stale, "the report")
    assert stale()[0].status[0].level == DiagnosticStatus.ERROR
    drawn = len(markers)
    graph.set_time(2.0)
    assert len(markers) == drawn


@pytest.mark.parametrize("fingers", [[(1,), (2,), (3,), (4,)], [(1, 2), (2, 3), (3, 4), (4, 1)]], ids=["PSC", "PDC"])
def test_each_direction_bends_away_from_its_chambers_and_pushes_the_same_way(graph, fingers):
    estimates = Estimates(graph)
    estimates.feed(pressures(fingers))
    joints = estimates.joints[-1]
    assert tuple(joints.name) == BEND_NAMES
    assert joints.header.stamp == time_stamp(1.0)
    moment = np.array(joints.effort).reshape(4, 2)
    for finger, chambers in enumerate(fingers):
        azimuth = math.radians(BEND_AZIMUTH_DEG[chambers])
        towards = np.array([math.cos(azimuth), math.sin(azimuth)])
        across = np.array([-towards[1], towards[0]])
        assert estimates.bend_rad[finger] @ towards > math.radians(60.0)
        assert abs(estimates.bend_rad[finger] @ across) < 1e-6
        assert moment[finger] @ towards > 0.0
        assert abs(moment[finger] @ across) < 1e-9
        tip = estimates.tips[-1].poses[finger].position
        base = load_gripper().finger_base_m[finger]
        assert (np.array([tip.x, tip.y]) - base[:2]) @ towards > 0.03


def test_unpressurised_fingers_hang_straight_under_the_palm(graph):
    estimates = Estimates(graph)
    estimates.feed(np.zeros(16))
    tips = estimates.tips[-1]
    assert tips.header.frame_id == "gripper_base"
    assert np.abs(estimates.bend_rad).max() < 1e-6
    positions = [[pose.position.x, pose.position.y, pose.position.z] for pose in tips.poses]
    np.testing.assert_allclose(positions, load_gripper().finger_base_m + (0.0, 0.0, 0.130), atol=1e-6)
    assert all(math.isclose(pose.orientation.w, 1.0, abs_tol=1e-6) for pose in tips.poses)
    assert np.abs(estimates.forces[-1].effort).max() < 1e-9


@pytest.mark.parametrize("metamodel", ["prs", "rbf", "krg"])
def test_two_chambers_at_100_kpa_push_with_the_chosen_metamodel_s_force(graph, metamodel, tmp_path):
    gripper = tmp_path / "gripper.yaml"  # target "test" scales every metamodel to the measured force
    gripper.write_text(yaml.safe_dump({**load_yaml("gripper.yaml"), "target": "fe"}))
    estimates = Estimates(graph, metamodel=metamodel, gripper=str(gripper))
    estimates.feed(pressures([(1, 2), (2, 3), (3, 4), (4, 1)]))
    forces = estimates.forces[-1]
    assert tuple(forces.name) == FINGER_NAMES
    performance = load_metamodel(metamodel).predict(load_gripper().design)
    np.testing.assert_allclose(forces.effort, performance.f_max_n, rtol=1e-3)
    relative_sigma = performance.theta_max_sigma_rad / performance.theta_max_rad
    assert (np.array(forces.position) >= relative_sigma * np.hypot(*estimates.bend_rad.T)).all()
    assert not forces.velocity
    graph.spin_until(lambda: estimates.reports, "a report")
    assert ("metamodel", metamodel) in [(item.key, item.value) for item in estimates.reports[-1].status[0].values]


def test_the_design_that_the_gripper_file_names_is_the_one_that_pushes(graph, tmp_path):
    gripper = tmp_path / "gripper.yaml"
    gripper.write_text(yaml.safe_dump({**load_yaml("gripper.yaml"), "target": "fe", "design": "optimised"}))
    estimates = Estimates(graph, gripper=str(gripper))
    estimates.feed(pressures([(1, 2), (2, 3), (3, 4), (4, 1)]))
    initial, optimised = (load_metamodel("prs").predict(load_design(name)).f_max_n for name in ("initial", "optimised"))
    np.testing.assert_allclose(estimates.forces[-1].effort, optimised, rtol=1e-3)
    assert abs(optimised / initial - 1.0) > 0.05


def test_an_unknown_metamodel_is_a_configuration_error(graph):
    with pytest.raises(ConfigError, match="metamodel.*spline.*prs, rbf, krg"):
        graph.add(StateEstimatorNode, metamodel="spline")


def test_more_pressure_noise_means_more_uncertainty(graph):
    estimates = Estimates(graph)
    estimates.feed(pressures([(1,)] * 4))
    before = np.array(estimates.forces[-1].position)
    estimates.node.set_parameters([Parameter("pressure_sigma_pa", value=5e3)])
    estimates.feed(pressures([(1,)] * 4))
    assert (np.array(estimates.forces[-1].position) > 1.1 * before).all()


def test_a_bend_lags_behind_its_pressures(graph):
    estimates = Estimates(graph)
    estimates.feed(np.zeros(16), time_s=1.0)
    bends = []
    for tick in range(1, 101):
        estimates.feed(pressures([(2, 3)] * 4), time_s=1.0 + 0.01 * tick)
        bends.append(estimates.bend_rad[0, 0])
    assert len(estimates.joints) == 101
    assert (np.diff(bends) > 0.0).all()
    # The pressure rises within the first tick; time constant 50 ms.
    share = np.array(bends) / bends[-1]
    assert share[4] == pytest.approx(1.0 - math.exp(-0.045 / 0.05), abs=0.02)
    assert estimates.joints[1].velocity[0] > 1.0 > abs(estimates.joints[-1].velocity[0])


def test_a_finger_with_an_invalid_pressure_is_nan_and_named_until_it_is_back(graph):
    estimates = Estimates(graph)
    broken = np.zeros(16)
    broken[9] = math.nan
    estimates.feed(broken)
    expected = [finger == 2 for finger in range(4)]
    assert np.isnan(estimates.bend_rad).all(axis=1).tolist() == expected
    assert np.isnan(estimates.bend_rad).any(axis=1).tolist() == expected
    assert np.isnan(estimates.forces[-1].effort).tolist() == expected
    assert np.isnan(estimates.forces[-1].position).tolist() == expected
    assert [math.isnan(pose.position.x) for pose in estimates.tips[-1].poses] == expected
    graph.spin_until(lambda: estimates.reports, "a report")
    assert estimates.reports[-1].status[0].level == DiagnosticStatus.ERROR
    assert estimates.reports[-1].status[0].message == "state not known: finger_3"
    estimates.feed(np.zeros(16), time_s=1.01)
    assert np.isfinite(estimates.bend_rad).all()
    graph.spin_until(lambda: estimates.reports[-1].status[0].level == DiagnosticStatus.OK, "the report of recovery")


def test_infinite_pressure_is_no_valid_reading(graph):
    estimates = Estimates(graph)
    broken = np.zeros(16)
    broken[0] = math.inf
    estimates.feed(broken)
    assert np.isnan(estimates.bend_rad).any(axis=1).tolist() == [True, False, False, False]


def test_markers_are_drawn_in_the_gripper_s_frame_and_an_unknown_finger_is_deleted(graph):
    estimates = Estimates(graph, marker_rate_hz=100.0)
    drawn = estimates.listen_to_markers()
    broken = np.zeros(16)
    broken[0] = math.nan
    estimates.feed(broken)
    graph.spin_until(lambda: drawn, "markers")
    markers = drawn[-1].markers
    assert {marker.header.frame_id for marker in markers} == {"gripper_base"}
    assert [marker.action for marker in markers] == [Marker.DELETE, Marker.ADD, Marker.ADD, Marker.ADD]
    assert math.isclose(markers[1].scale.x, 0.020)
    ends = [(point.x, point.y, point.z) for point in (markers[1].points[0], markers[1].points[-1])]
    base = load_gripper().finger_base_m[1]
    np.testing.assert_allclose(ends, [base, base + (0.0, 0.0, 0.130)], atol=1e-6)


def test_markers_come_with_the_first_pressures_of_each_period_and_carry_their_stamp(graph):
    estimates = Estimates(graph, marker_rate_hz=20.0)
    markers = estimates.listen_to_markers()
    for tick in range(100, 112):
        estimates.feed(np.zeros(16), 0.01 * tick)
    graph.spin_until(lambda: len(markers) == 3, "the markers of three periods")
    assert [each.markers[0].header.stamp for each in markers] == [time_stamp(at) for at in (1.0, 1.05, 1.1)]


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
def test_wrong_chamber_states_are_refused_and_the_next_right_ones_are_estimated(graph, message):
    estimates = Estimates(graph)
    estimates.refuse(message)
    assert not estimates.joints and not estimates.tips and not estimates.forces
    estimates.feed(np.zeros(16), time_s=2.0)
    assert estimates.joints[0].header.stamp == time_stamp(2.0)


def test_a_simulation_started_anew_finds_the_fingers_at_rest(graph):
    estimates = Estimates(graph)
    estimates.feed(pressures([(1,)] * 4), time_s=100.0)
    estimates.feed(np.zeros(16), time_s=0.01)
    assert np.abs(estimates.bend_rad).max() < 1e-6
