"""The plant's one face: reset, step, observe, lift."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.plant import StepSizeError, build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import PlantDivergedError, TierError
from mbpam_ros.pneumatics.chamber import PneumaticsInputError

GRIPPER = load_gripper()
EMPTY = load_scene("empty")
BULB = load_scene("bulb")
FILL_ONE = np.eye(16)[2]


def plant_of(named, seed=0, **changes):
    scene, request = named
    there = {key: changes.pop(key) for key in tuple(changes) if hasattr(scene, key)}
    how = dataclasses.replace(request, **changes)
    return build_plant(dataclasses.replace(scene, **there), how, GRIPPER, seed=seed)


def fields(observation):
    flat = dataclasses.asdict(observation)
    for name in ("object_in_world", "object_in_gripper"):
        flat |= {f"{name}.{key}": value for key, value in (flat.pop(name) or {}).items()}
    for there in flat.pop("objects"):
        for part in ("in_world", "in_gripper", "forces"):
            flat |= {f"{there['name']}.{part}.{key}": value for key, value in there[part].items()}
    return flat


def test_an_observation_has_the_promised_shapes_and_no_nan():
    plant = plant_of(BULB)
    plant.step(FILL_ONE, 0.01)
    seen = plant.observe()
    assert seen.pressure_gauge_pa.shape == seen.transducer_v.shape == (16,)
    assert seen.bend_rad.shape == seen.bend_rate_rad_s.shape == (4, 2)
    assert seen.finger_force_n.shape == (4, 3)
    assert seen.centreline_m.shape == (4, 14, 3)
    assert seen.support_force_n.shape == (3,)
    assert all(np.isfinite(value).all() for value in fields(seen).values())


@pytest.mark.parametrize("dt_s", [0.0, -0.01, 0.0015, 0.0101, float("nan"), float("inf")])
def test_a_step_that_is_no_whole_multiple_of_the_sub_step_is_refused_and_changes_nothing(dt_s):
    plant = plant_of(EMPTY, sub_step_s=0.001)
    with pytest.raises(StepSizeError, match="whole multiple"):
        plant.step(FILL_ONE, dt_s)
    assert plant.time_s == 0.0
    assert not plant.observe().pressure_gauge_pa.any()


def test_on_orifices_a_bending_muscle_draws_more_gas_than_one_that_is_held_straight():
    def pressure_pa(**tier):
        plant = plant_of(EMPTY, pneumatics="iso6358", **tier)
        for _ in range(25):
            plant.step(FILL_ONE, 0.01)
        return plant.observe().pressure_gauge_pa[2]

    heavy = 1e4  # gravity that keeps the muscle straight
    assert 50e3 < pressure_pa(tier="static") < pressure_pa(tier="static", gravity_m_s2=heavy)


def test_wrong_spool_commands_are_refused_and_change_nothing():
    plant = plant_of(EMPTY)
    for spool in (np.full(16, np.nan), np.zeros(15), np.full(16, 2.0)):
        with pytest.raises(PneumaticsInputError):
            plant.step(spool, 0.01)
    assert plant.time_s == 0.0


def test_observing_twice_gives_the_same_and_hands_out_copies():
    plant = plant_of(BULB)
    plant.step(FILL_ONE, 0.01)
    first, second = fields(plant.observe()), fields(plant.observe())
    for name, value in first.items():
        np.testing.assert_array_equal(value, second[name])
    plant.observe().bend_rad[:] = 99.0
    assert plant.observe().bend_rad.max() < 1.0


def test_the_same_seed_gives_the_same_bits_and_so_does_a_reset():
    runs = []
    plant = plant_of(BULB, seed=7)
    for other in (plant, plant_of(BULB, seed=7), plant):
        other.reset()
        other.lift()
        for _ in range(40):
            other.step(np.full(16, 0.5), 0.01)
        runs.append(fields(other.observe()))
    for later in runs[1:]:
        for name, value in runs[0].items():
            np.testing.assert_array_equal(value, later[name])


def test_another_seed_gives_other_noise():
    assert not np.array_equal(plant_of(EMPTY, 1).observe().transducer_v, plant_of(EMPTY, 2).observe().transducer_v)


def test_the_length_of_the_callers_step_hardly_matters():
    ends = []
    for dt_s in (0.002, 0.01):
        plant = plant_of(EMPTY)
        for _ in range(round(0.4 / dt_s)):
            plant.step(0.5 * FILL_ONE, dt_s)
        ends.append(plant.observe().bend_rad)
    assert np.abs(ends[0]).max() > 0.5
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-3)


@pytest.mark.parametrize("tier", ["static", "arc"])
def test_muscles_end_at_the_hanging_bend_of_their_pressures(tier):
    plant = plant_of(EMPTY, tier=tier)
    for _ in range(30):
        plant.step(0.5 * FILL_ONE, 0.01)
    for _ in range(200):
        plant.step(np.zeros(16), 0.01)
    seen = plant.observe()
    law = calibrated_rod_law(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target)
    expected = hanging_bend(*law.moment_and_stiffness(seen.pressure_gauge_pa.reshape(4, 4)), GRIPPER.rod_geometry)
    assert np.abs(expected).max() > 0.3
    np.testing.assert_allclose(seen.bend_rad, expected, atol=1e-5)


@pytest.mark.parametrize("tier", ["static", "arc"])
def test_centre_lines_hang_from_the_clamps_in_the_arcs_of_the_bends(tier):
    plant = plant_of(EMPTY, tier=tier)
    for _ in range(30):
        plant.step(0.5 * FILL_ONE, 0.01)
    seen = plant.observe()
    lines = centreline(seen.bend_rad, GRIPPER.rod_geometry, np.linspace(0.0, GRIPPER.geometry.length_m, 14))
    np.testing.assert_allclose(seen.centreline_m, GRIPPER.finger_base_m[:, None, :] + lines, atol=1e-5)


def test_the_number_of_modes_is_the_scenes():
    ends = [plant_of(EMPTY, tier="rod", modes=modes) for modes in (None, 2, 4)]
    for plant in ends:
        for _ in range(20):
            plant.step(0.5 * FILL_ONE, 0.01)
    default, two, four = (plant.observe().centreline_m for plant in ends)
    np.testing.assert_array_equal(default, two)
    assert 1e-6 < np.abs(four - two).max() < 2e-3


def test_the_static_tier_refuses_an_object_and_names_the_tier_that_can():
    with pytest.raises(TierError, match="'arc'"):
        plant_of(BULB, tier="static")


def test_an_unknown_tier_lists_the_known_ones():
    with pytest.raises(TierError, match="static, arc, rod"):
        plant_of(EMPTY, tier="fe")


def test_an_unknown_pneumatic_model_is_refused():
    with pytest.raises(PneumaticsInputError, match="ideal, lag"):
        plant_of(EMPTY, pneumatics="steam")


def test_the_hand_rises_by_the_scenes_height_and_refuses_while_it_moves():
    plant = plant_of(EMPTY)
    assert plant.lift().accepted
    assert not plant.lower().accepted
    for _ in range(100):
        plant.step(np.zeros(16), 0.01)
    assert plant.observe().hand_lift_m == pytest.approx(0.1)
    assert plant.lower().accepted


def test_an_object_left_behind_moves_down_in_the_rising_hands_frame():
    plant = plant_of(BULB)
    plant.lift()
    for _ in range(50):
        plant.step(np.zeros(16), 0.01)
    seen = plant.observe()
    moved = seen.object_in_gripper.position_m - seen.object_in_world.position_m
    np.testing.assert_allclose(moved, [0.0, 0.0, seen.hand_lift_m], atol=1e-12)
    assert seen.object_in_gripper.velocity_m_s[2] == pytest.approx(0.1875, abs=1e-4)


def test_a_diverged_plant_says_what_to_change_and_stays_stopped_until_reset():
    plant = plant_of(EMPTY, gravity_m_s2=1e7)
    with pytest.raises(PlantDivergedError, match="smaller sub_step_s"):
        for _ in range(50):
            plant.step(FILL_ONE, 0.01)
    assert np.isfinite(plant.observe().bend_rad).all()
    with pytest.raises(PlantDivergedError, match="Reset"):
        plant.step(FILL_ONE, 0.01)
    plant.reset()
    assert plant.time_s == 0.0


def test_an_empty_scene_has_no_object_and_no_forces():
    plant = plant_of(EMPTY)
    plant.step(FILL_ONE, 0.01)
    seen = plant.observe()
    assert seen.object_in_world is None
    assert seen.object_in_gripper is None
    assert not seen.finger_force_n.any()


@pytest.mark.slow
def test_the_static_tier_neither_loads_nor_compiles_the_moving_tiers():
    code = (
        "import sys, dataclasses; from mbpam_ros.gripper import load_gripper;"
        "from mbpam_ros.plant.plant import build_plant;"
        "from mbpam_ros.plant.scene import load_scene; s, how = load_scene('empty');"
        "build_plant(s, dataclasses.replace(how, tier='static'), load_gripper()).step([0.5] * 16, 0.01);"
        "assert 'mbpam_ros.plant.mechanics.step' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["arc", "rod"])
def test_uncompiled_code_gives_the_same_result(tier):
    code = (
        "import dataclasses; from mbpam_ros.gripper import load_gripper; from mbpam_ros.plant.plant import build_plant;"
        "from mbpam_ros.plant.scene import load_scene; s, how = load_scene('bulb');"
        f"p = build_plant(s, dataclasses.replace(how, tier={tier!r}), load_gripper());"
        " p.lift(); [p.step([0.5] * 16, 0.01) for _ in range(5)]; o = p.observe();"
        "print(*o.bend_rad.ravel().tolist(), *o.object_in_world.position_m.tolist(), *o.support_force_n.tolist())"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], check=True, env=environment, capture_output=True, text=True)
    plant = plant_of(BULB, tier=tier)
    plant.lift()
    for _ in range(5):
        plant.step(np.full(16, 0.5), 0.01)
    seen = plant.observe()
    expected = np.concatenate([seen.bend_rad.ravel(), seen.object_in_world.position_m, seen.support_force_n])
    np.testing.assert_allclose(np.array(done.stdout.split(), dtype=float), expected, atol=1e-7)
