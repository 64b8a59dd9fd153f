"""The rig over ROS: the plant's scene rig behind the pressure loops, read by camera and scale; and what gets lost."""

import dataclasses
import math
import threading
from types import SimpleNamespace

import pytest

from mbpam_ros.commands import ros_rig
from mbpam_ros.commands.ros_rig import RosRig
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode
from mbpam_ros.nodes.valve_controller import ValveControllerNode
from mbpam_ros.plant.rig import MuscleRig, hidden_muscle
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.study.rig.curves import averaged
from mbpam_ros.study.rig.procedure import BEND, FORCE, Plan, RigError, characterise, mounts_of
from mbpam_ros.study.rig.simulated import SimulatedRig

pytestmark = pytest.mark.xdist_group("real_clock")
GRIPPER = load_gripper()
PLAN = Plan(mounts_of(["pdc"]), (0.0, 40.0), repeats=1, window_s=0.3, timeout_s=60.0, bend_spread_rad=math.radians(2.0))


@pytest.fixture
def rig(graph, domain, compiled_plant):
    for node in (PressureSensorNode, ValveControllerNode):
        graph.add(node, use_sim_time=True)
    graph.plant = graph.add(PlantNode, scene="rig", camera_rate_hz=10.0, publish_clock=True, lock_step=True)

    over = threading.Event()

    def run_the_nodes():
        while not over.is_set():
            graph.executor.spin_once(timeout_sec=0.02)

    nodes = threading.Thread(target=run_the_nodes)
    nodes.start()
    try:
        with RosRig(GRIPPER, "rig_camera.yaml", domain_id=domain) as rig:
            yield rig
    finally:
        over.set()
        nodes.join()


def test_camera_and_scale_measure_the_hidden_muscle_as_simulated_time_does(rig):
    found = {(p.quantity, p.branch, round(p.pressure_kpa)): p.mean for p in averaged(characterise(rig, PLAN))}
    config = load_scene("rig")[0].rig
    muscle = MuscleRig(hidden_muscle(GRIPPER.rod_law(), config), GRIPPER.rod_geometry, config)
    plan = dataclasses.replace(PLAN, window_s=1.0)
    expected = {
        (p.quantity, p.branch, round(p.pressure_kpa)): p.mean
        for p in averaged(characterise(SimulatedRig(muscle, 1), plan))
    }
    assert found[BEND, "up", 40] == pytest.approx(expected[BEND, "up", 40], rel=0.05)
    assert found[FORCE, "up", 40] == pytest.approx(expected[FORCE, "up", 40], rel=0.06)


def test_a_camera_and_scale_that_fall_silent_end_it_with_one_line(rig, graph, monkeypatch):
    rig.mount(PLAN.mounts[0])
    rig.read()
    monkeypatch.setattr(ros_rig, "SILENCE_S", 0.5)
    covered = SimpleNamespace(expose=lambda *_: None, publish_finished=lambda **_: None)
    monkeypatch.setattr(graph.plant, "_camera", covered)
    monkeypatch.setattr(graph.plant._rig, "weigh", lambda *_: None)
    with pytest.raises(RigError, match="nothing on .*camera/image_raw.*scale/wrench for 0.5 s") as error:
        while True:
            rig.read()
    assert "\n" not in str(error.value)


def test_a_picture_that_comes_late_counts_for_the_pressure_at_which_it_was_taken(rig):
    """What it shows is not what the air is at when it arrives."""
    rig.mount(PLAN.mounts[0])
    before = rig.read()
    late = rig._heard["camera/image_raw"][1]
    rig.command([30e3, 0.0, 0.0, 30e3])
    while rig.read().pressure_pa[0] < 25e3:
        pass

    def comes_now(picture):
        rig._hearing("camera/image_raw")(picture)
        rig._read = dict.fromkeys(rig._read, -math.inf)

    comes_now(late)
    again = rig.read()
    assert again.time_s == before.time_s and max(again.pressure_pa) < 2e3
    late.header.stamp.sec += 1000
    comes_now(late)
    with pytest.raises(RigError, match="do they have one clock"):
        rig.read()
