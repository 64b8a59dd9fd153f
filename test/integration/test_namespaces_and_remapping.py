"""Names on the graph: the interface table, two grippers side by side, and remapping."""

import math
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, FluidPressure, Image, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import BEND_NAMES, CHANNEL_NAMES, FINGER_NAMES
from mbpam_ros.nodes import transforms
from mbpam_ros.nodes.grasp_arbiter import GraspArbiterNode
from mbpam_ros.nodes.interface import NODES, SERVICES, TOPICS
from mbpam_ros.nodes.messages import joint_state, seconds, time_stamp
from mbpam_ros.nodes.object_detector import ObjectDetectorNode
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode
from mbpam_ros.nodes.runtime import LATCHED
from mbpam_ros.nodes.state_estimator import StateEstimatorNode
from mbpam_ros.nodes.valve_controller import ValveControllerNode

pytestmark = pytest.mark.usefixtures("compiled_plant")

BEST_EFFORT_INPUTS = {
    "transducers",
    "chamber_states",
    "valve_commands",
    "gravity",
    *(f"{node}/alive" for node in NODES),
}  # drivers may publish them either way
OF_ROS_ITSELF = {"/rosout", "/parameter_events", "/clock", "/diagnostics"}


def add_gripper(graph, namespace="", remap=None, clock=True, **plant):
    """All six nodes in a namespace, on simulated time in lock step unless told otherwise."""
    own = {"publish_clock": True, "lock_step": True} if clock else {}
    graph.add(PressureSensorNode, namespace, remap, use_sim_time=clock)
    graph.add(ValveControllerNode, namespace, remap, use_sim_time=clock, enable_at_start=True)
    graph.add(StateEstimatorNode, namespace, remap, use_sim_time=clock)
    graph.add(ObjectDetectorNode, namespace, remap, use_sim_time=clock)
    graph.add(GraspArbiterNode, namespace, remap, use_sim_time=clock)
    return graph.add(PlantNode, namespace, remap, **own, **plant)


@pytest.mark.parametrize("namespace", ["", "/left"])
def test_topics_have_the_names_types_and_ends_of_the_interface_table(graph, namespace):
    add_gripper(graph, namespace)
    names = {name: topic for topic in TOPICS for name in topic.names}
    for relative_name, topic in names.items():
        name = f"{namespace}/{relative_name}"
        outgoing = graph.test_node.get_publishers_info_by_topic(name)
        incoming = graph.test_node.get_subscriptions_info_by_topic(name)
        assert {end.node_name for end in outgoing} == set(topic.publishers), name
        assert {end.node_name for end in incoming} == set(topic.subscribers), name
        assert {end.topic_type for end in [*outgoing, *incoming]} == {topic.message_type}, name
        reliable = {end.qos_profile.reliability is ReliabilityPolicy.RELIABLE for end in outgoing}
        assert reliable == {True for _ in topic.publishers}, name
        best_effort = {end.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT for end in incoming}
        assert best_effort <= {relative_name in BEST_EFFORT_INPUTS}, name
        latched = {end.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for end in outgoing}
        assert latched == {topic.latched for _ in topic.publishers}, name
    present = {name for name, _ in graph.test_node.get_topic_names_and_types()}
    assert present - OF_ROS_ITSELF == {f"{namespace}/{name}" for name in names}
    clocks = graph.test_node.get_publishers_info_by_topic("/clock")
    assert [(end.node_name, end.topic_type) for end in clocks] == [("plant", "rosgraph_msgs/msg/Clock")]
    reporters = graph.test_node.get_publishers_info_by_topic("/diagnostics")
    assert {end.node_name for end in reporters} == set(NODES)
    assert {end.topic_type for end in reporters} == {"diagnostic_msgs/msg/DiagnosticArray"}


@pytest.mark.parametrize("namespace", ["", "/left"])
def test_services_have_the_names_and_types_of_the_interface_table(graph, namespace):
    add_gripper(graph, namespace)
    of_rclpy = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")
    for node in NODES:
        services = {service.name: service.service_type for service in SERVICES if service.node == node}
        offered = graph.test_node.get_service_names_and_types_by_node(node, namespace or "/")
        ours = {name: types[0] for name, types in offered if not types[0].startswith(of_rclpy)}
        assert ours == {f"{namespace}/{name}": service_type for name, service_type in services.items()}, node


def test_without_publish_clock_nobody_publishes_a_clock(graph):
    add_gripper(graph, clock=False, camera_rate_hz=0.0)
    assert graph.test_node.count_publishers("/clock") == 0


def test_a_running_gripper_fills_every_topic_as_the_interface_table_says(graph):
    joint_states = {
        # topic: names, and the fields that are filled
        "transducers": (CHANNEL_NAMES, {"effort"}),
        "chamber_states": (CHANNEL_NAMES, {"effort"}),
        "pressure_setpoints": (CHANNEL_NAMES, {"effort"}),
        "valve_commands": ((*CHANNEL_NAMES, "supply"), {"position"}),
        "joint_states": (BEND_NAMES, {"position", "velocity", "effort"}),
        "finger_forces": (FINGER_NAMES, {"position", "effort"}),
    }
    received = {topic: graph.listen(JointState, topic) for topic in joint_states}
    others = {
        "chamber_3_2/pressure": graph.listen(FluidPressure, "chamber_3_2/pressure"),
        "finger_tips": graph.listen(PoseArray, "finger_tips"),
        "finger_markers": graph.listen(MarkerArray, "finger_markers"),
        "plant/finger_markers": graph.listen(MarkerArray, "plant/finger_markers"),
        "camera/image_raw": graph.listen(Image, "camera/image_raw"),
        "camera/camera_info": graph.listen(CameraInfo, "camera/camera_info"),
        "detections": graph.listen(MarkerArray, "detections"),
        "detections/image": graph.listen(CompressedImage, "detections/image"),
        "grasp_state": graph.listen(DiagnosticStatus, "grasp_state", LATCHED),
        "grasp_pose": graph.listen(PoseStamped, "grasp_pose", LATCHED),
        "/clock": graph.listen(Clock, "/clock"),
    }
    add_gripper(graph)
    graph.spin_until(lambda: others["detections"], "detections")
    graph.spin_until(lambda: graph.call(Trigger, "grasp/auto").success, "a grasp accepted")
    start_s = seconds(others["/clock"][-1].clock)
    graph.spin_until(lambda: seconds(others["/clock"][-1].clock) > start_s + 0.4, "0.4 s", timeout_s=30.0)
    assert not [topic for topic, messages in others.items() if not messages]

    for topic, (names, filled) in joint_states.items():
        for message in received[topic]:
            assert tuple(message.name) == names, topic
            lengths = {field: len(getattr(message, field)) for field in ("position", "velocity", "effort")}
            assert lengths == {field: len(names) if field in filled else 0 for field in lengths}, topic
            assert np.isfinite([*message.position, *message.velocity, *message.effort]).all(), topic
    for topic in ("transducers", "chamber_states", "valve_commands", "joint_states"):
        stamps = [seconds(message.header.stamp) for message in received[topic]]
        np.testing.assert_allclose(np.diff(stamps), 0.01, atol=1e-9, err_msg=topic)

    # Units: volts, pascals gauge, openings, and absolute pascals where the message says so.
    assert 0.4 < min(received["transducers"][-1].effort) < max(received["transducers"][-1].effort) < 4.5
    assert 50e3 < max(received["chamber_states"][-1].effort) < 110e3
    assert max(received["pressure_setpoints"][-1].effort) == 100e3
    assert all(np.abs(message.position).max() <= 1.0 for message in received["valve_commands"])
    absolute = others["chamber_3_2/pressure"][0]
    assert math.isclose(absolute.fluid_pressure, 101325.0, abs_tol=2e3)
    assert absolute.header.frame_id == "finger_3_chamber_2"
    frames = {topic: others[topic][-1].header.frame_id for topic in ("finger_tips", "grasp_pose")}
    assert set(frames.values()) == {"gripper_base"}
    assert others["finger_markers"][-1].markers[0].header.frame_id == "gripper_base"
    assert others["detections"][-1].markers[0].header.frame_id == "gripper_base"
    assert others["plant/finger_markers"][-1].markers[0].header.frame_id == "world"


class StandInForTransforms:
    """``tf2_msgs/msg/TFMessage``, which no wheel holds, and what is published of it."""

    sent: dict[str, list] = {}

    def __init__(self, transforms):
        self.transforms = transforms

    @classmethod
    def install(cls, monkeypatch):
        cls.sent, real = {}, Node.create_publisher

        def create(node, message_type, topic, qos, **options):
            if message_type is not cls:
                return real(node, message_type, topic, qos, **options)
            return SimpleNamespace(publish=lambda message: cls.sent.setdefault(topic, []).extend(message.transforms))

        monkeypatch.setattr(transforms, "tf_message_type", lambda: cls)
        monkeypatch.setattr(Node, "create_publisher", create)


def test_frames_hang_together_under_the_gripper_s_prefix_and_the_urdf_names_them_alike(graph, monkeypatch):
    StandInForTransforms.install(monkeypatch)
    sent = StandInForTransforms.sent
    for each in (PressureSensorNode, StateEstimatorNode):
        graph.add(each, "right", frame_prefix="right/")
    tips = graph.listen(PoseArray, "right/finger_tips")
    pressures = graph.listen(FluidPressure, "right/chamber_1_1/pressure")
    truth = graph.listen(MarkerArray, "right/plant/finger_markers")
    graph.add(PlantNode, "right", frame_prefix="right/", camera_rate_hz=0.0)
    graph.spin_until(lambda: tips and pressures and truth, "tips, a pressure and the truth")
    parents = {each.child_frame_id: each.header.frame_id for topic in ("/tf", "/tf_static") for each in sent[topic]}
    fingers = [f"right/finger_{i}_{end}" for i in range(1, 5) for end in ("mount", "tip")]
    hanging = dict.fromkeys([*fingers, "right/camera_optical"], "right/gripper_base")
    assert parents == {"right/gripper_base": "world", **hanging}
    stamp = tips[-1].header.stamp
    where = {each.child_frame_id: each.transform for each in sent["/tf"] if each.header.stamp == stamp}
    for i, pose in enumerate(tips[-1].poses):
        assert where[f"right/finger_{i + 1}_tip"].translation.z == pose.position.z == pytest.approx(0.130, abs=2e-3)
        assert where[f"right/finger_{i + 1}_tip"].rotation == pose.orientation
    assert hangs(next(each for each in sent["/tf"] if each.header.frame_id == "world"))
    assert max(point.z for marker in truth[-1].markers[:4] for point in marker.points) == pytest.approx(0.0, abs=1e-3)
    assert pressures[-1].header.frame_id == "right/finger_1_chamber_1"
    description = graph.listen(String, "right/robot_description", LATCHED)
    graph.spin_until(lambda: description, "the URDF, though late")
    links = {link.get("name") for link in ElementTree.fromstring(description[0].data).iter("link")}
    assert {"right/gripper_base", "right/camera_optical", *fingers[::2]} <= links


def hangs(placed):
    """Whether a frame in the world has its z axis down, as a palm whose fingers hang."""
    turn = placed.transform.rotation
    return 1.0 - 2.0 * (turn.x**2 + turn.y**2) == pytest.approx(-1.0)


@pytest.mark.parametrize("namespace", ["", "/left"])
def test_every_node_reports_its_health_under_its_full_name(graph, namespace):
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    add_gripper(graph, namespace, clock=False, camera_rate_hz=0.0)
    wanted = {f"{namespace}/{name}" for name in NODES}
    graph.spin_until(lambda: {item.status[0].name for item in reports} >= wanted, "six reports")
    assert {item.status[0].name for item in reports} == wanted
    assert {item.status[0].hardware_id for item in reports} == {namespace.strip("/") or "gripper"}
    assert all(len(item.status) == 1 and item.status[0].message for item in reports)


def test_a_grasp_on_the_left_leaves_the_right_alone(graph):
    states = {side: graph.listen(JointState, f"/{side}/chamber_states") for side in ("left", "right")}
    grasps = {side: graph.listen(DiagnosticStatus, f"/{side}/grasp_state", LATCHED) for side in states}
    for side in states:
        # Each on a clock of its own, so that both may run in lock step.
        add_gripper(graph, f"/{side}", {"/clock": f"/{side}/clock"}, camera_rate_hz=0.0)

    def phase(side):
        return {item.key: item.value for item in grasps[side][-1].values}["phase"] if grasps[side] else None

    graph.spin_until(lambda: all(len(messages) > 5 for messages in states.values()), "pressures on both sides")
    graph.spin_until(lambda: graph.call(Trigger, "/left/grasp/mid_rod").success, "a grasp on the left")
    graph.spin_until(lambda: phase("left") == "holding", "holding on the left")
    assert max(states["left"][-1].effort) > 95e3
    until = len(states["right"]) + 100
    graph.spin_until(lambda: len(states["right"]) >= until, "another second on the right")
    assert np.nanmax([message.effort for message in states["right"]]) < 5e3
    assert phase("right") == "idle"
    assert graph.call(Trigger, "/left/grasp/stop").success
    graph.spin_until(lambda: phase("left") == "fault", "the fault on the left")
    graph.spin_until(lambda: graph.call(Trigger, "/right/grasp/envelope").success, "a grasp on the right")
    graph.spin_until(lambda: phase("right") == "holding", "holding on the right")


def test_a_topic_may_be_remapped_to_that_of_a_driver(graph):
    graph.add(PressureSensorNode, remap={"transducers": "/valve_island/analog_in"}, clock_tolerance_s=0.0)
    states = graph.listen(JointState, "chamber_states")
    driver = graph.publisher(JointState, "/valve_island/analog_in")
    assert graph.test_node.count_subscribers("transducers") == 0
    driver.publish(joint_state(time_stamp(1.0), CHANNEL_NAMES, effort=[2.5] * 16))
    graph.spin_until(lambda: states, "chamber_states")
    np.testing.assert_allclose(states[0].effort, 100e3, atol=1.0)


def test_a_service_may_be_remapped(graph):
    graph.add(PlantNode, remap={"plant/lift": "arm/up"}, scene="empty", camera_rate_hz=0.0)
    assert graph.call(Trigger, "arm/up").success


def test_a_node_may_be_renamed_and_reports_under_that_name(graph):
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    graph.add(PressureSensorNode, namespace="/right", remap={"__node": "pressure_sensor_2"})
    graph.spin_until(lambda: reports, "a report")
    assert reports[0].status[0].name == "/right/pressure_sensor_2"
