"""The whole gripper without ROS: what its own sensing, mode selection, arbitration and loops do with an object."""

import dataclasses
import functools

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.scene import PAPER_SCENES, load_scene
from mbpam_ros.study.grasp.trial import run_trial

GRIPPER = load_gripper()


@functools.cache
def trial(name, pressure_pa, tier="arc", **changes):
    scene, request = load_scene(name)
    return run_trial(dataclasses.replace(scene, **changes), request.in_tier(tier), GRIPPER, pressure_pa)


def test_a_held_bulb_rises_with_the_hand_in_the_papers_mode():
    held = trial("bulb", 100e3)
    assert held.held and held.mode == "envelope" and held.note == ""
    assert held.rise_m == pytest.approx(0.1, abs=0.005) and held.hand_rise_m == pytest.approx(0.1)
    assert 0.1 < held.touch_s < held.close_s < 1.0
    assert held.finger_force_n >= 0.046 * 9.81


def test_without_enough_pressure_it_stays_where_it_was():
    left = trial("bulb", 50e3)
    assert not left.held and left.mode == "envelope" and left.finger_force_n == 0.0
    assert left.rise_m == pytest.approx(0.0, abs=0.002) and left.hand_rise_m == pytest.approx(0.1)


def test_friction_decides_about_the_tomato_and_not_about_the_bulb():
    assert trial("tomato", 100e3).held and not trial("tomato", 100e3, friction_coefficient=0.05).held
    assert trial("bulb", 100e3, friction_coefficient=0.05).held


@pytest.mark.parametrize("name", PAPER_SCENES)
def test_the_grip_pressure_of_each_mode_has_the_margin_it_is_said_to_have(name):
    mode = load_scene(name)[0].object.expected_mode
    held = trial(name, getattr(load_grasp_config().arbitration.grip_pressure_gauge_pa, mode) / 1.035, tier="rod")
    assert held.held and held.mode == mode


@pytest.mark.parametrize("shift_m", [-0.005, 0.005])
@pytest.mark.parametrize("name", ["banana", "tube"])
def test_the_grip_pressure_holds_a_rod_that_lies_5_mm_off_the_middle(name, shift_m):
    scene, request = load_scene(name)
    position_m = np.add(scene.object_position_m, (0.0, shift_m, 0.0))
    scene = dataclasses.replace(scene, object_position_m=tuple(position_m))
    assert run_trial(scene, request.in_tier("rod"), GRIPPER).held


def test_an_object_that_is_refused_is_not_held_and_the_reason_is_kept():
    scene, request = load_scene("tomato")
    wide = dataclasses.replace(scene.object, shape="box", size_m=(0.3, 0.3, 0.07))
    support = dataclasses.replace(scene.support, depth_m=0.205)  # under the tips: a finger is in nothing
    changed = dataclasses.replace(scene, object_position_m=(0.0, 0.0, 0.170), support=support, object=wide)
    refused = run_trial(changed, request, GRIPPER, 100e3)
    assert not refused.held and refused.mode == "" and refused.close_s is None and "tomato" in refused.note


def test_a_grip_pressure_above_the_limit_is_refused():
    with pytest.raises(ConfigError, match="above the limit of 110000 Pa"):
        run_trial(*load_scene("bulb"), GRIPPER, 115e3)


def test_a_scene_without_an_object_is_refused():
    with pytest.raises(ConfigError, match="scene empty: nothing to grasp"):
        run_trial(*load_scene("empty"), GRIPPER)
