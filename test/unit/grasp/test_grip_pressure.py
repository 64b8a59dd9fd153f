"""The least pressure that holds, read from the table, and what is made of it."""

import dataclasses
import itertools
import json
import re

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import build_selector, load_grasp_config
from mbpam_ros.grasp.grip_pressure import (
    TABLE,
    Expected,
    GripConfig,
    GripPlanner,
    GripTable,
    MassClasses,
    load_grip_table,
    made_with,
    table_for,
)
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject, GraspChoice, Refusal
from mbpam_ros.gripper import load_gripper

MASSES = [0.05, 0.1, 0.2]
HIGHEST_PA, STEP_PA = 120e3, 10e3


def linear_pa(width_m, depth_m, friction, mass_kg):
    return 40e3 + 1e5 * width_m + 5e4 * depth_m - 2e4 * friction + 2e5 * mass_kg


def rows(least=linear_pa):
    return [
        {
            "mode": mode,
            "width_m": width,
            "depth_m": depth,
            "friction_coefficient": friction,
            "mass_kg": MASSES,
            "least_gauge_pa": [least(width, depth, friction, mass) for mass in MASSES],
        }
        for mode in MODE_NAMES
        for width, depth, friction in itertools.product((0.03, 0.06), (0.07, 0.08, 0.1), (0.4, 0.8))
    ]


def interpolated(table, mode, *place):
    least, weight = table.corners(mode, *place)
    return float(least @ weight)


def planner(table_rows=None, limit_pa=110e3, **config):
    table = GripTable(rows() if table_rows is None else table_rows, HIGHEST_PA, STEP_PA)
    return GripPlanner(GripConfig(**config), table, limit_pa)


def weighing(mass_kg):
    return Expected(mass_kg, lightest_kg=mass_kg)


def test_between_the_measured_places_a_linear_law_comes_back():
    table = GripTable(rows(), HIGHEST_PA, STEP_PA)
    rng = np.random.default_rng(4)
    for _ in range(50):
        at = rng.uniform((0.03, 0.07, 0.4, 0.05), (0.06, 0.1, 0.8, 0.2))
        assert interpolated(table, "mid_rod", *at) == pytest.approx(linear_pa(*at), rel=1e-12)


def test_beyond_the_measured_places_the_nearest_counts_but_no_pressure_holds_a_heavier_object():
    table = GripTable(rows(), HIGHEST_PA, STEP_PA)
    nearest = linear_pa(0.03, 0.07, 0.4, 0.05)
    assert interpolated(table, "envelope", 0.01, 0.02, 0.1, 0.01) == pytest.approx(nearest)
    assert interpolated(table, "envelope", 0.05, 0.08, 0.5, 0.201) > HIGHEST_PA


def test_the_grip_is_the_least_pressure_and_the_margin():
    grip = planner(margin_ratio=0.1, margin_pa=1000.0)
    least = linear_pa(0.05, 0.075, 0.5, 0.12)
    assert grip.pressure_gauge_pa("mid_rod", 0.05, 0.075, 0.5, weighing(0.12)) == pytest.approx(1.1 * least + 1000.0)


def test_a_margin_beyond_the_limit_is_cut_to_it():
    grip = planner(rows(lambda *_: 100e3), limit_pa=101e3)
    assert grip.pressure_gauge_pa("mid_rod", 0.05, 0.075, 0.5, weighing(0.12)) == 101e3


def test_what_needs_more_than_the_limit_is_too_heavy_by_name_and_figures():
    grip = planner(rows(lambda width, depth, friction, mass: 60e3 if mass < 0.1 else 118e3))
    found = grip.pressure_gauge_pa("mid_rod", 0.05, 0.075, 0.5, weighing(0.12))
    assert found == "too heavy: 120 g needs 118 kPa even with a friction of 0.8, limit 110"


def test_what_is_thinner_than_anything_measured_is_too_thin():
    assert planner().pressure_gauge_pa("mid_rod", 0.026, 0.075, 0.5, weighing(None)) == (
        "too thin by 4.0 mm: 26.0 mm, 30 mm are known to be held"
    )
    assert planner().pressure_gauge_pa("mid_rod", 0.028, 0.075, 0.5, weighing(None)) is None


def test_without_a_mass_the_mode_decides():
    assert planner().pressure_gauge_pa("mid_rod", 0.05, 0.075, 0.5, weighing(None)) is None


def held_between(low_m, high_m, heaviest_kg=1.0):
    return rows(lambda width, depth, friction, mass: 60e3 if low_m <= depth <= high_m and mass <= heaviest_kg else None)


@pytest.mark.parametrize("mass_kg", [None, 0.1])
def test_an_object_that_lies_where_even_the_lightest_is_lost_is_too_deep_or_too_near(mass_kg):
    deep = planner(held_between(0.0, 0.08)).pressure_gauge_pa("mid_rod", 0.05, 0.1, 0.5, weighing(mass_kg))
    assert deep == "too deep by 1 mm: 100 mm below the palm, the fingers hold it at 70 to 99 mm"
    near = planner(held_between(0.08, 1.0)).pressure_gauge_pa("mid_rod", 0.05, 0.06, 0.5, weighing(mass_kg))
    assert near == "too near by 11 mm: 60 mm below the palm, the fingers hold it at 71 to 100 mm"
    nowhere = planner(held_between(1.0, 1.0)).pressure_gauge_pa("mid_rod", 0.05, 0.06, 0.5, weighing(mass_kg))
    assert nowhere == "no depth at which 110 kPa hold 50 mm in mid_rod"


def test_where_it_may_be_lost_the_mode_decides():
    beside = planner(held_between(0.0, 0.08)).pressure_gauge_pa("mid_rod", 0.05, 0.09, 0.5, weighing(0.1))
    some_of_the_class = planner(held_between(0.0, 1.0, 0.1))
    assert beside is None
    assert some_of_the_class.pressure_gauge_pa("mid_rod", 0.05, 0.08, 0.5, Expected(0.2, lightest_kg=0.1)) is None
    assert some_of_the_class.pressure_gauge_pa("mid_rod", 0.05, 0.08, 0.5, Expected(0.2)) is None


def test_a_class_lies_between_the_one_below_and_its_heaviest():
    classes = MassClasses(0.06, 0.12, 0.2)
    assert [classes.named(name) for name in ("light", "medium", "heavy")] == [(None, 0.06), (0.06, 0.12), (0.12, 0.2)]


def test_where_the_lightest_is_held_a_heavier_object_is_too_heavy():
    found = planner(held_between(0.0, 1.0, 0.1)).pressure_gauge_pa("mid_rod", 0.05, 0.08, 0.5, weighing(0.2))
    assert found.startswith("too heavy: 200 g needs more than 120 kPa")


@pytest.mark.parametrize("mode", MODE_NAMES)
def test_the_shipped_table_asks_for_more_the_heavier_and_the_more_slippery(mode):
    table = load_grip_table()
    width_m, depth_m = {"envelope": (0.06, 0.08), "mid_rod": (0.035, 0.085)}.get(mode, (0.022, 0.07))
    by_mass = [interpolated(table, mode, width_m, depth_m, 0.6, mass_kg) for mass_kg in (0.02, 0.06, 0.12, 0.2)]
    assert by_mass == sorted(by_mass) and by_mass[0] < by_mass[-1]
    slippery, rough = (interpolated(table, mode, width_m, depth_m, friction, 0.12) for friction in (0.4, 0.8))
    assert rough <= slippery


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content["rows"].pop(), "full grid"),
        (lambda content: content["rows"].clear(), "no least pressures of the mode envelope"),
        (lambda content: content.pop("settings"), "settings"),
        (lambda content: content["rows"][0].update(mass_kg=[0.05, 0.1, 0.3]), "same mass_kg"),
    ],
)
def test_a_file_that_is_no_such_table_is_refused_by_name(tmp_path, change, message):
    content = {"settings": {"highest_gauge_pa": HIGHEST_PA, "step_pa": STEP_PA}, "rows": rows()}
    change(content)
    path = tmp_path / "table.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"table\.json: .*{re.escape(message)}.*mbpam grip-table"):
        load_grip_table(path)


def test_a_table_tells_nothing_of_other_muscles_or_fingers_elsewhere(tmp_path):
    gripper = load_gripper()
    assert table_for(TABLE, gripper) == TABLE and table_for(None, gripper) is None
    for change in ({"muscle": "half", "target": "fe"}, {"finger_circle_radius_m": 0.06}):
        other = dataclasses.replace(gripper, **change)
        assert table_for(TABLE, other) is None
        own = tmp_path / "own.json"
        own.write_text(json.dumps({"settings": {"gripper": made_with(other)}}), encoding="utf-8")
        assert table_for(own, other) == own
    own.write_text(json.dumps({"settings": {}}), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"own\.json: no table that tells of its gripper .*mbpam grip-table"):
        table_for(own, gripper)


def test_what_the_table_says_of_other_fingers_refuses_no_object():
    config, modes, gripper = load_grasp_config(), load_modes(), load_gripper()
    ball = DetectedObject("ball", "sphere", (0.06, 0.06, 0.06), (0.0, 0.0, 0.085), (0.0, 0.0, 0.0, 1.0), 1.0)
    refused = build_selector(config, gripper, modes).select(ball, weighing(1.0))
    assert isinstance(refused, Refusal) and "too heavy: 1000 g" in refused.reason
    closer = dataclasses.replace(gripper, finger_circle_radius_m=0.045)
    assert isinstance(build_selector(config, closer, modes).select(ball, weighing(1.0)), GraspChoice)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: GripConfig(margin_ratio=-0.1), "margins must not be negative"),
        (lambda: MassClasses(0.1, 0.1, 0.2), "mass classes must rise"),
        (lambda: Expected(mass_kg=0.0), "mass_kg must be greater than 0"),
        (lambda: Expected(friction_coefficient=float("nan")), "friction_coefficient must be greater than 0"),
    ],
)
def test_values_that_cannot_be_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()
