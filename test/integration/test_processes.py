"""The gripper as operating-system processes: start, signals, wrong arguments, kill -9 and restart, name spaces."""

import importlib
import itertools
import os
import signal
import subprocess
import sys

import pytest

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip
import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image, JointState
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.commands.system import launch_executable
from mbpam_ros.configuration import config_path
from mbpam_ros.nodes.interface import NODES, SERVICES, TOPICS
from mbpam_ros.nodes.messages import joint_state, rgb_image, seconds, time_stamp
from mbpam_ros.nodes.runtime import STREAM
from mbpam_ros.study.judge.hostile import hostile_images
from mbpam_ros.vision.camera import load_camera_config

START_S = 60.0
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
WATCHDOG_S = 0.2  # of the valve controller
CAMERALESS = ("plant", "pressure_sensor", "valve_controller", "grasp_arbiter")
OK = DiagnosticStatus.OK


@pytest.mark.parametrize("launch", [launch_executable])  # as users start them
def test_every_executable_reports_its_health_and_a_signal_ends_it_with_code_0(start, launch):
    gripper = start()
    gripper.enable()
    gripper.ask("grasp/envelope")  # so that the signal meets work in every node
    for process, stop_signal in zip(gripper.processes.processes.values(), itertools.cycle(STOP_SIGNALS), strict=False):
        process.send_signal(stop_signal)
    assert gripper.processes.stop() == dict.fromkeys(NODES, 0)
    for executable in NODES:
        log = gripper.processes.log(executable).read_text()
        assert "Traceback" not in log and "FATAL" not in log, log


@pytest.mark.parametrize("stop_signal", STOP_SIGNALS)
def test_bringup_runs_all_six_nodes_and_a_signal_ends_it_with_code_0(start, stop_signal):
    gripper = start(["bringup"], nodes=NODES)
    gripper.enable()
    gripper.ask("grasp/envelope")
    assert gripper.processes.stop(stop_signal) == {"bringup": 0}
    log = gripper.processes.log("bringup").read_text()
    assert "Traceback" not in log and "FATAL" not in log, log


def test_hostile_images_hold_up_no_valve_and_lose_no_grasp(start):
    """In one process with the valves; the gap itself is measured by ``mbpam bench``."""
    gripper = start(["bringup"], arguments={"bringup": ["-p", "object_detector:max_rate_hz:=20.0"]}, nodes=NODES)
    gripper.enable()
    gripper.close_fingers()
    stamps_s: list[float] = []
    seen = []
    node = gripper.operator.node
    node.create_subscription(
        JointState, "valve_commands", lambda message: stamps_s.append(seconds(message.header.stamp)), STREAM
    )
    node.create_subscription(MarkerArray, "detections", seen.append, STREAM)
    images = node.create_publisher(Image, "camera/image_raw", STREAM)
    camera = load_camera_config()
    for pixels in hostile_images(camera.width_px, camera.height_px) * 3:
        before = len(seen)
        images.publish(rgb_image(pixels))
        gripper.wait_for(lambda: len(seen) > before, "what was seen")  # noqa: B023
    assert len(stamps_s) > 20
    assert max(np.diff(stamps_s)) < WATCHDOG_S
    assert gripper.grasp["phase"] == "holding", gripper.report()


@pytest.mark.parametrize(
    ("executable", "parameter", "named"),
    [
        ("plant", "scene:=nonsense", "scene 'nonsense'"),
        ("plant", "rat_hz:=5", "unknown parameter rat_hz"),
        ("plant", "seed:=-1", "parameter seed"),
        ("pressure_sensor", "pneumatics:=nowhere.yaml", "nowhere.yaml"),
        ("valve_controller", "watchdog_rate_hz:=fast", "parameter watchdog_rate_hz"),
        ("state_estimator", "metamodel:=oracle", "unknown metamodel 'oracle'"),
        ("object_detector", "support_depth_m:=.nan", "parameter support_depth_m"),
        ("grasp_arbiter", "modes:=gripper.yaml", "gripper.yaml"),
        ("bringup", "plant:scene:=nonsense", "scene 'nonsense'"),
    ],
)
def test_a_wrong_parameter_ends_the_executable_with_code_2_and_one_line_that_names_it(
    executable, parameter, named, nursery
):
    ended = nursery.run(executable, "--ros-args", "-p", parameter)
    assert ended.returncode == 2
    assert len(ended.stderr.strip().splitlines()) == 1, ended.stderr
    assert ended.stderr.startswith("error: ") and named in ended.stderr


def test_ros_arguments_that_cannot_be_read_end_the_executable_with_code_2(nursery):
    ended = nursery.run("plant", "--ros-args", "--params-file", "/nowhere/nodes.yaml")
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("error: ") and "/nowhere/nodes.yaml" in ended.stderr


@pytest.mark.parametrize("executable", [*NODES, "bringup"])
def test_help_says_what_a_node_does_and_takes_and_starts_none(executable, nursery):
    ended = nursery.run(executable, "--help")
    assert ended.returncode == 0 and not ended.stderr
    nodes, prefix = ([executable], "") if executable in NODES else (NODES, "{}:")
    for name in nodes:
        module = importlib.import_module(f"mbpam_ros.nodes.{name}")
        said = [module.__doc__.strip(), *(prefix.format(name) + parameter.name for parameter in module.PARAMETERS)]
        said += [topic.name for topic in TOPICS if name in (*topic.publishers, *topic.subscribers)]
        said += [service.name for service in SERVICES if service.node == name]
        assert not [text for text in said if text not in ended.stdout]


@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        (["-p", "plant:scene:=tomato"], "bringup --ros-args -p plant:scene:=tomato"),
        (["tomato"], "see bringup -h"),
        (["--ros-args", "-p", "plant:scene:=tomato", "--", "--verbose"], "unknown argument --verbose"),
        (["--ros-args", "-p", "plan:scene:=tomato"], "no node plan in bringup, only plant, "),
    ],
)
def test_arguments_that_nobody_would_read_are_refused_with_the_right_spelling(arguments, cure, nursery):
    ended = nursery.run("bringup", *arguments)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: bringup: ") and cure in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def test_a_parameter_given_to_one_node_by_name_reaches_it_in_a_namespace_too(nursery):
    ended = nursery.run("bringup", "--ros-args", "-r", "__ns:=/right", "-p", "plant:scene:=nowhere")
    assert (ended.returncode, ended.stderr[:27]) == (2, "error: no scene 'nowhere'; ")


def test_a_valve_controller_that_is_told_to_stop_while_filling_closes_its_valves(start):
    gripper = start(CAMERALESS)
    gripper.enable()
    gripper.ask("grasp/envelope")
    gripper.wait_for(lambda: gripper.pressure_pa.max() > 20e3, "filling")
    gripper.processes.processes.pop("valve_controller").send_signal(signal.SIGINT)
    gripper.wait_for_phase("fault")
    assert gripper.pressure_pa.max() < 100e3


def test_after_kill_of_the_pressure_sensor_the_watchdog_reports_and_a_restart_recovers(start):
    gripper = start(CAMERALESS)
    gripper.enable()
    gripper.close_fingers()
    gripper.lift()
    held_at_m = gripper.height_m["object"]
    gripper.kill("pressure_sensor")
    gripper.wait_for(lambda: gripper.health("valve_controller")[0] == DiagnosticStatus.ERROR, "the watchdog's report")
    assert gripper.health("valve_controller")[1].startswith(
        "16 channels at fault: finger_1_chamber_1: no valid reading"
    )
    assert "no fresh valid pressure" in gripper.health("valve_controller")[2][CHANNEL_NAMES[0]]
    gripper.wait_for_phase("fault")
    # Whichever comes first: the watchdog's report, the sensor's silence, or the arbiter's look at the pressures.
    reasons = ("no fresh valid pressure", "no sign of life", "no valid pressure reading")
    assert any(reason in gripper.grasp["reason"] for reason in reasons), gripper.grasp["reason"]
    assert gripper.grasp["air"] == "hold"

    gripper.restart("pressure_sensor")
    gripper.wait_for(lambda: np.isfinite(gripper.pressure_pa).all(), "pressures")
    gripper.wait_for(
        lambda: gripper.health("valve_controller")[0] != DiagnosticStatus.ERROR, "the watchdog's all-clear"
    )
    assert abs(gripper.height_m["object"] - held_at_m) < 0.005
    gripper.let_go_and_reset()
    gripper.close_fingers()


def test_after_kill_of_the_plant_the_other_nodes_report_stay_up_and_go_on_with_a_new_plant(start):
    gripper = start(CAMERALESS)
    gripper.enable()
    gripper.close_fingers()
    gripper.kill("plant")
    gripper.wait_for_phase("fault")
    gripper.wait_for(lambda: gripper.health("pressure_sensor")[0] == DiagnosticStatus.ERROR, "the sensor's report")
    assert gripper.health("pressure_sensor")[2][CHANNEL_NAMES[0]] == "missing"
    assert np.isnan(gripper.pressure_pa).all()
    gripper.restart("plant")
    gripper.let_go_and_reset()
    gripper.close_fingers()


def test_two_grippers_run_side_by_side_from_one_parameter_file_in_which_one_differs(start, tmp_path):
    for_all, for_left = tmp_path / "all.yaml", tmp_path / "left.yaml"
    parameters = yaml.safe_load(config_path("nodes.yaml").read_text())
    parameters["/**/plant"]["ros__parameters"] |= {"scene": "tomato", "camera_rate_hz": 0.0}
    for_all.write_text(yaml.safe_dump(parameters, sort_keys=False))
    for_left.write_text("/left/plant:\n  ros__parameters:\n    scene: bulb\n")
    files = ["--params-file", str(for_all), "--params-file", str(for_left)]
    left, right = (start(["bringup"], common=files, namespace=name, nodes=NODES) for name in ("/left", "/right"))
    assert left.health("plant")[2]["scene"] == "bulb"
    assert right.health("plant")[2]["scene"] == "tomato"
    right.enable()
    left.enable()
    left.close_fingers()
    assert left.pressure_pa.max() > 90e3
    right.wait_for_phase("idle")
    assert right.pressure_pa.max() < 1e3
    left.ask("grasp/stop")
    left.wait_for_phase("fault")
    right.close_fingers()


def test_topics_can_be_remapped_on_the_command_line(start):
    rules = ["-r", "transducers:=driver/volts", "-p", "clock_tolerance_s:=0.0"]
    gripper = start(["pressure_sensor"], common=rules, namespace="/left")
    publisher = gripper.operator.node.create_publisher(JointState, "driver/volts", STREAM)
    gripper.wait_for(lambda: publisher.get_subscription_count() > 0, "a subscription of driver/volts")
    samples = itertools.count(1)

    def answered() -> bool:
        publisher.publish(joint_state(time_stamp(0.01 * next(samples)), CHANNEL_NAMES, effort=[2.5] * 16))
        return np.isfinite(gripper.pressure_pa).all()

    gripper.wait_for(answered, "chamber_states")
    assert gripper.pressure_pa == pytest.approx(100e3, abs=1.0)


def test_all_nodes_follow_the_plants_clock_under_use_sim_time(start):
    clock = ["-p", "use_sim_time:=true", "-p", "plant:publish_clock:=true", "-p", "plant:lock_step:=true"]
    gripper = start(["bringup"], common=clock, nodes=NODES)
    gripper.enable()
    stamps = []
    on_setpoints = lambda message: stamps.append(message.header.stamp.sec)  # noqa: E731
    gripper.operator.node.create_subscription(JointState, "pressure_setpoints", on_setpoints, STREAM)
    gripper.close_fingers()
    gripper.wait_for(lambda: stamps, "set-points")
    assert max(stamps) < 1e6  # seconds since the plant's start, not since 1970


def test_the_parameter_file_holds_every_parameter_of_every_node_at_its_default():
    written = yaml.safe_load(config_path("nodes.yaml").read_text())
    declared = {
        f"/**/{name}": {
            "ros__parameters": {
                parameter.name: parameter.default
                for parameter in importlib.import_module(f"mbpam_ros.nodes.{name}").PARAMETERS
            }
        }
        for name in NODES
    }
    assert written == declared
    for name, section in declared.items():
        for key, default in section["ros__parameters"].items():
            assert type(written[name]["ros__parameters"][key]) is type(default), key


def test_a_running_node_has_no_long_garbage_collection_before_it(domain):
    code = (
        "import gc; from mbpam_ros.nodes.runtime import GripperNode, Health, run\n"
        "class Collecting(GripperNode):\n"
        "    def __init__(self):\n"
        "        super().__init__('collecting', ())\n"
        "        self.built = len(gc.get_objects())\n"
        "        self.create_timer(0.01, lambda: self.fail(f'{len(gc.get_objects()) / self.built:.3f}'))\n"
        "    def health(self):\n"
        "        return Health()\n"
        "raise SystemExit(run(Collecting))"
    )
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=START_S
    )
    assert done.returncode == 1
    share_still_walked = float(done.stderr.rsplit(maxsplit=1)[-1])
    assert share_still_walked < 0.05
