"""Fewer modes while the object is out of reach: when the plant steps, how little that moves, and that it says so."""

import dataclasses
import logging

import numpy as np
import pytest

from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import TierError

GRIPPER = load_gripper()
L = GRIPPER.geometry.active_length_m
TICK_S = 0.01
CLOSED = load_modes()["envelope"].setpoints(80e3)
OPEN = np.zeros(16)


def plant_of(name="bulb", tier="rod", air_modes=2, modes=4, static_pct=5.0, pneumatics=None, **changes):
    scene, _ = load_scene(name)
    how = Fidelity(tier, modes if tier == "rod" else 1, 0.002, pneumatics, air_modes, largest_jump_pct=static_pct)
    return build_plant(dataclasses.replace(scene, **changes), how, GRIPPER)


def drive(plant, target_pa, duration_s):
    seen = [plant.observe()]
    for _ in range(round(duration_s / TICK_S)):
        plant.step(np.clip((target_pa - seen[-1].pressure_gauge_pa) / 2e4, -1.0, 1.0), TICK_S)
        seen.append(plant.observe())
    return seen


def messages(caplog):
    return [record.getMessage() for record in caplog.records if record.name.endswith("adaptive")]


def test_the_plant_steps_down_at_rest_up_before_contact_and_down_after_the_release_and_says_so(caplog):
    caplog.set_level(logging.INFO)
    plant = plant_of()
    drive(plant, OPEN, 0.3)
    assert [("down to 2 modes" in text) for text in messages(caplog)] == [True]
    closing = drive(plant, CLOSED, 0.8)
    touched = next(i for i, seen in enumerate(closing) if seen.finger_force_n.any())
    assert len(messages(caplog)) == 2 and "up to 4 modes" in messages(caplog)[1]
    assert touched > 0
    drive(plant, OPEN, 2.5)
    assert "down to 2 modes" in messages(caplog)[-1]
    assert all("tips moved by 0.0" in text for text in messages(caplog))  # below 0.1 mm


def test_what_it_computes_is_what_the_modes_of_contact_compute():
    """But for what two modes are off in the air, 0.05 % of the active length."""
    ends = []
    for plant in (plant_of(), plant_of(air_modes=None)):
        drive(plant, OPEN, 0.2)
        closed = drive(plant, CLOSED, 1.0)[-1]
        plant.lift()
        ends.append((closed, drive(plant, CLOSED, 1.3)[-1]))
    for stepping, fixed in zip(*ends, strict=True):
        assert np.abs(stepping.centreline_m - fixed.centreline_m).max() < 0.005 * L
        np.testing.assert_allclose(
            stepping.object_in_world.position_m, fixed.object_in_world.position_m, atol=0.005 * L
        )
        assert np.abs(stepping.finger_force_n - fixed.finger_force_n).max() < 0.05 * np.abs(fixed.finger_force_n).max()
    assert ends[0][1].object_in_world.position_m[2] < 0.0  # raised


def test_a_resting_object_stays_where_it_is_and_on_its_support_while_out_of_reach():
    plant = plant_of()
    seen = drive(plant, OPEN, 0.5)[-1]
    weight_n = load_scene("bulb")[0].object.mass_kg * 9.81
    assert seen.support_force_n[2] == pytest.approx(-weight_n, rel=0.01)
    before = seen.object_in_world.position_m
    plant.lift()
    after = drive(plant, OPEN, 1.2)[-1]
    np.testing.assert_array_equal(after.object_in_world.position_m, before)
    assert after.object_in_gripper.position_m[2] == pytest.approx(before[2] + 0.1, abs=1e-6)


def test_an_object_that_falls_is_computed_until_it_rests(caplog):
    caplog.set_level(logging.INFO)
    plant = plant_of("bulb", object_position_m=(0.0, 0.0, 0.075))  # 10 mm above its stand
    seen = drive(plant, OPEN, 0.4)
    assert seen[-1].object_in_world.position_m[2] == pytest.approx(0.085, abs=2e-4)
    assert seen[2].time_s < float(messages(caplog)[0].split()[1])


@pytest.mark.parametrize(("static_pct", "changes"), [(1e-4, 0), (10.0, 1)])
def test_it_does_not_step_down_where_the_tips_would_jump_by_more_than_is_allowed(caplog, static_pct, changes):
    caplog.set_level(logging.INFO)
    deep = dataclasses.replace(load_scene("bulb")[0].support, depth_m=0.43)
    plant = plant_of(air_modes=1, static_pct=static_pct, object_position_m=(0.0, 0.0, 0.4), support=deep)
    drive(plant, CLOSED, 1.0)
    assert len(messages(caplog)) == changes


@pytest.mark.parametrize("waited_s", [0.12, 0.13, 0.2, 0.31])
def test_however_fast_the_fingers_close_the_plant_steps_up_before_they_touch(caplog, waited_s):
    caplog.set_level(logging.INFO)
    plant = plant_of(pneumatics="ideal", object_position_m=(0.0, 0.0, 0.105),
                     support=dataclasses.replace(load_scene("bulb")[0].support, depth_m=0.135))  # fmt: skip
    drive(plant, OPEN, waited_s)
    drive(plant, 1.5 * CLOSED, 0.5)
    up = [text for text in messages(caplog) if "up to" in text]
    assert len(up) == 1
    assert 0.0 < float(up[0].split("the object ")[1].split()[0]) < 12.0


def test_a_reset_gives_the_same_bits_again():
    plant = plant_of()
    first = drive(plant, CLOSED, 0.7)[-1]
    plant.reset()
    second = drive(plant, CLOSED, 0.7)[-1]
    for name in ("centreline_m", "bend_rad", "finger_force_n"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize(("name", "tier"), [("empty", "rod"), ("bulb", "arc")])
def test_modes_of_the_air_are_refused_where_they_mean_nothing(name, tier):
    with pytest.raises(TierError, match="air_modes"):
        plant_of(name, tier, air_modes=1)
