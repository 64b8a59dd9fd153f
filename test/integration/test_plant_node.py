"""The simulated plant's promises on its topics and services."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.configuration import ConfigError, load_yaml
from mbpam_ros.description.frames import up
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes import plant as plant_module
from mbpam_ros.nodes.messages import joint_state, seconds, time_stamp
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.plant.plant import Plant
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.vision.camera import camera_intrinsics, load_camera_config

pytestmark = pytest.mark.usefixtures("compiled_plant")

VENTED_V = 0.5
NOISE_V = 0.002
COUNT_V = 5.0 / 4096
TICK_S = 0.01


def command(opening, stamp=None, names=CHANNEL_NAMES):
    return joint_state(stamp or time_stamp(0.0), names, position=opening)


def volts(message):
    return np.array(message.effort)


def vector(frame_id, values):
    message = Vector3Stamped()
    message.header.frame_id = frame_id
    message.vector.x, message.vector.y, message.vector.z = (float(value) for value in values)
    return message


class PlantInRealTime:
    """The node on the wall clock, without a camera."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        self.transducers = graph.listen(JointState, "transducers")
        self.node = graph.add(PlantNode, **{"scene": "empty", "camera_rate_hz": 0.0, **parameters})
        self.commands = graph.publisher(JointState, "valve_commands")

    def wait_ticks(self, count):
        """Let the plant tick and return the last voltages."""
        wanted = len(self.transducers) + count
        self.graph.spin_until(lambda: len(self.transducers) >= wanted, f"{count} ticks")
        return volts(self.transducers[-1])


class PlantInLockStep:
    """The node on simulated time with valves in the test's hands: each tick is answered by ``opening(time_s)``."""

    def __init__(self, graph, opening=lambda time_s: np.zeros(16), **parameters):
        self.graph = graph
        self.opening = opening
        self.answers = True
        self.transducers = []
        graph.test_node.create_subscription(JointState, "transducers", self._on_transducers, 10)
        self.clock = graph.listen(Clock, "/clock")
        self.truth = graph.listen(MarkerArray, "plant/finger_markers")
        self.node = graph.add(
            PlantNode,
            **{"scene": "empty", "camera_rate_hz": 0.0, "publish_clock": True, "lock_step": True, **parameters},
        )
        self.commands = graph.publisher(JointState, "valve_commands")

    def _on_transducers(self, message):
        self.transducers.append(message)
        if self.answers:
            self.answer(message)

    def answer(self, message):
        self.commands.publish(command(self.opening(seconds(message.header.stamp)), message.header.stamp))

    @property
    def time_s(self):
        return seconds(self.transducers[-1].header.stamp) if self.transducers else 0.0

    def run_until(self, time_s):
        self.graph.spin_until(lambda: self.time_s >= time_s - 1e-6, f"simulated time {time_s:g} s")

    def call(self, name):
        return self.graph.call(Trigger, f"plant/{name}")

    def tip_x_m(self):
        """Where the tip of finger 1 is along x, from the markers of truth."""
        return self.truth[-1].markers[0].points[-1].x

    def true_height_m(self, namespace):
        """Height of the palm or the object over its start, from the markers of truth."""
        (marker,) = [item for item in self.truth[-1].markers if item.ns == namespace]
        return marker.pose.position.z


def test_transducers_read_half_a_volt_at_ambient_pressure_within_their_noise(graph):
    plant = PlantInRealTime(graph, rate_hz=500.0)
    plant.wait_ticks(100)
    message = plant.transducers[0]
    assert tuple(message.name) == CHANNEL_NAMES
    assert not message.position and not message.velocity
    samples = np.array([volts(message) for message in plant.transducers])
    assert abs(samples.mean() - VENTED_V) < 3.0 * NOISE_V / math.sqrt(samples.size) + 0.5 * COUNT_V
    assert np.abs(samples - VENTED_V).max() < 6.0 * NOISE_V + COUNT_V
    assert 0.8 * NOISE_V < samples.std() < 1.2 * NOISE_V
    assert np.abs(np.rint(samples / COUNT_V) - samples / COUNT_V).max() < 1e-6


def test_an_open_valve_fills_its_chamber_and_no_other(graph):
    opening = np.zeros(16)
    opening[5] = 0.5
    plant = PlantInLockStep(graph, opening=lambda time_s: opening)
    plant.run_until(0.3)
    filled = volts(plant.transducers[-1])
    assert filled[5] > 1.5
    assert np.abs(np.delete(filled, 5) - VENTED_V).max() < 0.02
    opening[5] = -1.0
    plant.run_until(1.5)
    assert abs(volts(plant.transducers[-1])[5] - VENTED_V) < 0.05


def test_the_same_seed_and_commands_give_the_same_bits_and_another_seed_does_not(new_graph):
    def run(seed):
        plant = PlantInLockStep(new_graph(), opening=lambda time_s: np.full(16, math.sin(20.0 * time_s)), seed=seed)
        plant.run_until(1.0)
        return [(message.header.stamp, volts(message).tobytes()) for message in plant.transducers[:100]]

    first = run(7)
    assert run(7) == first
    other = run(8)
    assert [stamp for stamp, _ in other] == [stamp for stamp, _ in first]
    assert [bits for _, bits in other] != [bits for _, bits in first]


def test_in_lock_step_every_tick_is_one_period_of_the_clock(graph):
    plant = PlantInLockStep(graph)
    plant.run_until(0.5)
    graph.spin_until(lambda: len(plant.clock) >= 50, "the clock")
    for tick, (clock, message) in enumerate(zip(plant.clock, plant.transducers, strict=False), start=1):
        assert clock.clock == message.header.stamp == time_stamp(tick * TICK_S)


def test_in_lock_step_a_command_for_an_earlier_tick_does_not_make_one(graph):
    plant = PlantInLockStep(graph)

    def opening(time_s):
        plant.commands.publish(command(np.ones(16), time_stamp(0.01)))
        return np.zeros(16)

    plant.run_until(0.02)
    plant.opening = opening
    plant.run_until(0.3)
    assert np.abs(volts(plant.transducers[-1]) - VENTED_V).max() < 0.02


def test_lock_step_goes_on_without_an_answer_and_reports_that_it_is_slow(graph):
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    transducers = graph.listen(JointState, "transducers")
    node = graph.add(
        PlantNode, scene="empty", camera_rate_hz=0.0, publish_clock=True, lock_step=True, lock_step_timeout_s=0.1
    )
    graph.spin_until(lambda: len(transducers) >= 6, "six ticks without an answer")
    node.publish_health()
    graph.spin_until(lambda: reports, "a report")
    assert "slower than real time" in reports[-1].status[0].message
    assert reports[-1].status[0].level == DiagnosticStatus.WARN


def test_in_lock_step_valves_that_have_answered_are_waited_for_however_slow_they_are(graph):
    plant = PlantInLockStep(graph, lock_step_timeout_s=0.05)
    plant.run_until(0.1)
    plant.answers = False
    answered = len(plant.transducers)
    graph.spin_until(lambda: len(plant.transducers) > answered, "the tick that the last answer made")
    late_s = time.monotonic() + 0.5
    graph.spin_until(lambda: time.monotonic() > late_s, "ten time-outs")
    assert len(plant.transducers) == answered + 1
    plant.answer(plant.transducers[-1])
    plant.answers = True
    plant.run_until(plant.time_s + 0.1)


def test_in_lock_step_the_plant_ticks_on_without_valves_that_have_left(graph):
    plant = PlantInLockStep(graph, lock_step_timeout_s=0.05)
    plant.run_until(0.1)
    plant.answers = False
    graph.test_node.destroy_publisher(plant.commands)
    plant.run_until(plant.time_s + 0.1)


def test_valves_close_when_commands_stop(graph):
    plant = PlantInRealTime(graph, command_timeout_s=0.05)
    plant.wait_ticks(1)
    plant.commands.publish(command(np.full(16, 0.5)))
    graph.spin_until(lambda: (volts(plant.transducers[-1]) > 0.6).all(), "some pressure")
    before = plant.wait_ticks(20)
    after = plant.wait_ticks(20)
    assert np.abs(after - before).max() < 0.02
    assert after.max() < 2.0


@pytest.mark.parametrize(
    "message",
    [
        command(np.full(16, math.nan)),
        command([math.nan] + [1.0] * 15),
        command([math.inf] + [1.0] * 15),
        command([1.001] + [1.0] * 15),
        command([-1.001] + [1.0] * 15),
        command(np.ones(15)),
        command(np.ones(15), names=CHANNEL_NAMES[:15]),
        command(np.ones(16), names=(*CHANNEL_NAMES[:15], "valve_16")),
        command(np.ones(16), names=(*CHANNEL_NAMES[:15], CHANNEL_NAMES[0])),
        joint_state(time_stamp(0.0), CHANNEL_NAMES, effort=np.ones(16)),
        JointState(),
    ],
    ids=[
        "all NaN",
        "one NaN",
        "infinity",
        "above fully open",
        "below fully vented",
        "a value missing",
        "a channel missing",
        "an unknown name",
        "a name twice",
        "in the wrong field",
        "empty",
    ],
)
def test_wrong_valve_commands_are_refused_whole_and_the_next_right_one_is_applied(graph, message):
    plant = PlantInRealTime(graph)
    plant.commands.publish(message)
    graph.spin_until(lambda: plant.node.refused_inputs == 1, "the refusal")
    assert np.abs(plant.wait_ticks(5) - VENTED_V).max() < 0.02
    plant.commands.publish(command(np.ones(16)))
    graph.spin_until(lambda: (volts(plant.transducers[-1]) > 0.6).all(), "pressure")


def test_the_hand_is_raised_and_lowered_and_refuses_while_it_moves(graph):
    plant = PlantInLockStep(graph, marker_rate_hz=100.0)
    plant.run_until(0.05)
    assert plant.call("lift").success
    for name in ("lift", "lower"):
        refusal = plant.call(name)
        assert not refusal.success
        assert "the hand is moving" in refusal.message
    lifted_s = plant.time_s + 1.1
    plant.run_until(lifted_s)
    assert plant.true_height_m("palm") == pytest.approx(0.1 + 0.005, abs=1e-6)  # the middle of the palm's plate
    refusal = plant.call("lift")
    assert not refusal.success and "already up" in refusal.message
    assert plant.call("lower").success
    plant.run_until(plant.time_s + 1.1)
    assert plant.true_height_m("palm") == pytest.approx(0.005, abs=1e-6)
    refusal = plant.call("lower")
    assert not refusal.success and "already down" in refusal.message


def test_reset_puts_the_scene_back_but_not_the_clock(graph):
    plant = PlantInLockStep(graph, opening=lambda time_s: np.ones(16), scene="bulb", marker_rate_hz=100.0)
    plant.run_until(0.2)
    assert (volts(plant.transducers[-1]) > 2.0).all()
    assert plant.call("lift").success
    plant.run_until(plant.time_s + 0.6)
    assert plant.true_height_m("palm") > 0.02
    plant.opening = lambda time_s: np.zeros(16)
    answer = plant.call("reset")
    assert answer.success and "bulb" in answer.message
    reset_s = plant.time_s
    plant.run_until(reset_s + 0.1)
    assert np.abs(volts(plant.transducers[-1]) - VENTED_V).max() < 0.02
    assert plant.true_height_m("palm") == pytest.approx(0.005, abs=1e-6)
    assert plant.true_height_m("object") == pytest.approx(-0.085, abs=1e-4)
    assert plant.call("lift").success  # the hand is down, and knows it
    stamps = [seconds(message.header.stamp) for message in plant.transducers]
    np.testing.assert_allclose(np.diff(stamps), TICK_S, atol=1e-9)


def test_the_markers_of_truth_show_fingers_palm_and_object_in_the_world(graph):
    plant = PlantInLockStep(graph, scene="carton")
    plant.run_until(0.2)
    graph.spin_until(lambda: plant.truth, "markers")
    markers = plant.truth[-1].markers
    assert {marker.header.frame_id for marker in markers} == {"world"}
    assert [marker.ns for marker in markers] == ["finger"] * 4 + ["palm", "object"]
    ends = [(finger.points[-1].x, finger.points[-1].y, finger.points[-1].z) for finger in markers[:4]]
    np.testing.assert_allclose(ends, up(load_gripper().finger_base_m + (0.0, 0.0, 0.130)), atol=1e-3)
    body = markers[-1]
    assert body.type == Marker.CUBE
    assert (body.scale.x, body.scale.y, body.scale.z) == (0.035, 0.120, 0.060)
    assert body.pose.position.z == pytest.approx(-0.085, abs=1e-3)


def test_the_markers_of_truth_show_every_object_of_a_scene_the_first_as_before(graph, tmp_path):
    content = load_yaml("scenes/bulb.yaml")
    bulb = {key: content.pop(key) for key in ("object", "object_position_m", "object_yaw_rad")}
    far = {"object": "carton", "object_position_m": [0.15, 0.0, 0.285]}
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(content | {"objects": [bulb, far]}))
    plant = PlantInLockStep(graph, scene=str(tmp_path / "two.yaml"))
    plant.run_until(0.2)
    graph.spin_until(lambda: plant.truth, "markers")
    first, second = plant.truth[-1].markers[-2:]
    assert [(each.ns, each.id, each.type) for each in (first, second)] == [
        ("object", 0, Marker.SPHERE),
        ("other_object", 1, Marker.CUBE),
    ]
    assert second.pose.position.x == pytest.approx(0.15, abs=1e-3)
    assert second.pose.position.z == pytest.approx(-0.285, abs=1e-3)


def test_gravity_from_the_side_pulls_the_fingers_there_and_a_vector_without_direction_is_refused(graph):
    plant = PlantInLockStep(graph, marker_rate_hz=100.0)
    gravity = graph.publisher(Vector3Stamped, "gravity")
    plant.run_until(0.05)
    for frame, values in (
        ("gripper_base", (0.0, 0.0, 0.0)),
        ("gripper_base", (math.nan, 0.0, 1.0)),
        ("world", (1, 0, 0)),
    ):
        refused = plant.node.refused_inputs
        gravity.publish(vector(frame, values))
        graph.spin_until(lambda refused=refused: plant.node.refused_inputs == refused + 1, "the refusal")
    assert plant.tip_x_m() == pytest.approx(load_gripper().finger_base_m[0, 0], abs=1e-6)
    gravity.publish(vector("gripper_base", (3.0, 0.0, 0.0)))
    graph.spin_until(lambda: plant.tip_x_m() > load_gripper().finger_base_m[0, 0] + 0.015, "a finger that sags")
    assert plant.call("reset").success
    start_s = plant.time_s
    plant.run_until(start_s + 1.0)
    assert plant.tip_x_m() > load_gripper().finger_base_m[0, 0] + 0.015


def test_the_camera_publishes_images_with_their_camera_info_at_its_own_rate(graph):
    images, infos = graph.listen(Image, "camera/image_raw"), graph.listen(CameraInfo, "camera/camera_info")
    plant = PlantInLockStep(graph, scene="bulb", camera_rate_hz=10.0)
    plant.run_until(0.5)
    graph.spin_until(lambda: len(images) >= 4 and len(infos) >= 4, "images")
    stamps = [seconds(image.header.stamp) for image in images]
    np.testing.assert_allclose(np.diff(stamps), 0.1, atol=1e-6)
    assert [info.header.stamp for info in infos] == [image.header.stamp for image in images]
    image, info = images[0], infos[0]
    expected = load_camera_config()
    assert (image.encoding, image.width, image.height) == ("rgb8", expected.width_px, expected.height_px)
    assert (info.width, info.height, info.distortion_model) == (image.width, image.height, "plumb_bob")
    np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), camera_intrinsics(expected).matrix)
    assert image.header.frame_id == info.header.frame_id == "camera_optical"
    assert image.step == 3 * image.width
    assert len(image.data) == image.step * image.height
    assert np.frombuffer(image.data, np.uint8).std() > 5.0


def test_ticks_that_a_busy_computer_held_up_are_made_up_for_as_far_as_five(graph, monkeypatch):
    clock = SimpleNamespace(now_s=0.0, monotonic=lambda: clock.now_s, thread_time=time.thread_time)
    monkeypatch.setattr(plant_module, "time", clock)
    plant = PlantInRealTime(graph)

    def passes(held_up_s):
        """Let the computer be held up for so long; return how far the plant then comes."""
        before, from_s = len(plant.transducers), float(plant.node.health().values["time_s"])
        clock.now_s += held_up_s
        graph.spin_until(lambda: len(plant.transducers) > before, "a tick")
        assert len(plant.transducers) == before + 1  # what was held up is not published late
        return float(plant.node.health().values["time_s"]) - from_s

    def heard():
        clock.now_s += 0.001
        return plant.transducers

    graph.spin_until(heard, "a first tick")
    passes(0.01)
    for held_up_s in (0.03, 0.05, 0.02):
        assert passes(held_up_s) == pytest.approx(held_up_s)
    assert passes(0.20) == pytest.approx(0.05)
    assert passes(0.01) == pytest.approx(0.01)


def test_a_camera_rate_of_zero_means_no_camera(graph):
    plant = PlantInRealTime(graph)
    plant.wait_ticks(1)
    assert graph.test_node.count_publishers("camera/image_raw") == 0


def test_a_step_that_diverges_stops_the_node_with_an_error_and_never_a_nan(graph, monkeypatch):
    real_step, raised = Plant.step, []

    def diverge(self, spool, dt_s, supply_open):
        if self.time_s > 0.1 and not raised:
            raised.append(True)
            raise PlantDivergedError("diverged at 0.11 s: use a smaller sub_step_s")
        real_step(self, spool, dt_s, supply_open)

    monkeypatch.setattr(Plant, "step", diverge)
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    truth = graph.listen(MarkerArray, "plant/finger_markers")
    clock = graph.listen(Clock, "/clock")
    plant = PlantInRealTime(graph, publish_clock=True, marker_rate_hz=100.0)

    def errors():
        return [item.status[0] for item in reports if item.status[0].level == DiagnosticStatus.ERROR]

    graph.spin_until(errors, "the error report")
    assert plant.node.failure == "plant: diverged at 0.11 s: use a smaller sub_step_s"
    assert errors()[0].message == plant.node.failure
    counts = len(plant.transducers), len(truth), len(clock)
    plant.commands.publish(command(np.ones(16)))
    # The report repeats at 1 Hz: a hundred ticks that did not happen.
    graph.spin_until(lambda: len(errors()) >= 2, "the next error report")
    assert (len(plant.transducers), len(truth), len(clock)) == counts
    assert all(np.isfinite(volts(message)).all() for message in plant.transducers)
    points = [point for message in truth for marker in message.markers for point in marker.points]
    assert points and all(math.isfinite(point.x + point.y + point.z) for point in points)


def test_a_scene_no_step_can_follow_ends_in_the_same_error(graph, tmp_path):
    mapping = {**load_yaml("scenes/bulb.yaml"), "gravity_m_s2": 1e6}
    scene = tmp_path / "violent.yaml"
    scene.write_text(yaml.safe_dump(mapping), encoding="utf-8")
    plant = PlantInRealTime(graph, scene=str(scene))
    graph.spin_until(lambda: plant.node.failure, "the failure")
    assert "diverged" in plant.node.failure
    assert all(np.isfinite(volts(message)).all() for message in plant.transducers)


@pytest.mark.parametrize(
    "parameters, complaint",
    [
        ({"lock_step": True}, "lock_step needs publish_clock"),
        ({"rate_hz": 30.0}, "rate_hz = 30 .*sub-step of 0.002 s"),
        ({"rate_hz": 1000.0}, "rate_hz = 1000 .*sub-step of 0.002 s"),
        ({"scene": "volcano"}, "no scene 'volcano'; known: banana, bulb"),
        ({"scene": "volcano.yaml"}, "volcano.yaml: no such file"),
        ({"tier": "quantum"}, "scene bulb: no tier 'quantum'; known: static, arc"),
        ({"scene": "bulb", "tier": "static"}, "scene bulb: .*static"),
    ],
    ids=str,
)
def test_what_cannot_be_simulated_is_a_configuration_error(graph, parameters, complaint):
    with pytest.raises(ConfigError, match=complaint):
        graph.add(PlantNode, **parameters)


def test_the_tier_may_be_chosen_by_parameter(graph):
    reports = graph.listen(DiagnosticArray, "/diagnostics")
    plant = PlantInRealTime(graph, tier="static")
    plant.wait_ticks(1)
    plant.node.publish_health()
    graph.spin_until(lambda: reports, "a report")
    assert ("tier", "static") in [(item.key, item.value) for item in reports[-1].status[0].values]
