"""The planner on a table whose numbers are plain to see, and a plant that is built from a plan."""

import dataclasses
import json
import os

import numpy as np
import pytest
import yaml

from mbpam_ros.configuration import ConfigError, load_yaml
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import (
    Fidelity,
    FidelityRequest,
    FidelityTable,
    Measured,
    ModelError,
    Tolerance,
    load_fidelity_table,
)
from mbpam_ros.plant.planner import (
    AIR_CASES,
    GRASP_CASES,
    PlanError,
    cases_of,
    choose_fidelity,
    kinds_of,
    may_touch,
    plan,
)
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import PlacedObject, load_scene, scene_names

LENGTH_M = load_gripper().geometry.length_m
(EMPTY, _), (BULB, BULB_REQUEST) = load_scene("empty"), load_scene("bulb")

# tier, modes, step, pneumatics: static, transient, force, cost
AIR = {
    ("static", 1, 0.01, "lag"): (3.0, 9.0, None, 40.0),
    ("arc", 1, 0.002, "lag"): (3.0, 8.0, None, 20.0),
    ("arc", 1, 0.002, "iso6358"): (3.0, 3.0, None, 30.0),
    ("rod", 2, 0.002, "lag"): (0.1, 7.0, None, 21.0),
    ("rod", 2, 0.002, "iso6358"): (0.1, 0.2, None, 31.0),
    ("rod", 2, 0.010, "iso6358"): (0.1, 0.9, None, 29.9),
    ("rod", 3, 0.002, "iso6358"): (0.05, 0.1, None, 60.0),
}
GRASP = {
    ("arc", 1, 0.002, "iso6358"): (9.0, 9.0, 30.0, 30.0),
    ("rod", 2, 0.002, "lag"): (0.5, 6.0, 2.0, 35.0),
    ("rod", 2, 0.002, "iso6358"): (0.5, 0.6, 2.0, 50.0),
    ("rod", 2, 0.010, "iso6358"): (80.0, 80.0, 50.0, 40.0),
    ("rod", 3, 0.002, "iso6358"): (0.2, 0.3, 1.0, 80.0),
}


def table(reference=None, extra=()):
    rows = list(extra)
    grasps = [case for cases in GRASP_CASES.values() for case in cases]
    for cases, numbers in ((AIR_CASES, AIR), (grasps, GRASP)):
        for case in cases:
            for how, (static, transient, force, cost) in numbers.items():
                rows.append(Measured(case, *how, static, transient, 0.0, cost, force))
    return FidelityTable(tuple(rows), reference or {}, {}, {})


def planned(scene, static=5.0, transient=None, force=None, reference=None, tick_s=None, camera=None, **forced):
    allowed = Tolerance(static, transient or static, force or 2.0 * static)
    return plan(scene, LENGTH_M, table(reference), FidelityRequest(tolerance=allowed, **forced), tick_s, camera)


def measured(fidelity):
    """What the rows of the table are told apart by."""
    return fidelity.tier, fidelity.modes, fidelity.sub_step_s, fidelity.pneumatics


ALL = ("bend", "stretch", "twist")
MODEL_ERRORS = (
    ModelError(("bend",), 10.0, 14.0),
    ModelError(("bend", "stretch"), 1.0, 12.0),
    ModelError(ALL, 1.0, 2.0),
)


def with_strains():
    """A table in which two more strains cost half as much again each, and models have errors."""
    plain = table()
    rods = [row for row in plain.rows if row.tier == "rod"]
    more = [
        dataclasses.replace(row, twist_modes=twist, stretch_modes=2, cpu_ms_per_s=(2 + twist) * row.cpu_ms_per_s)
        for row in rods
        for twist in (0, 2)
    ]
    return dataclasses.replace(plain, rows=(*plain.rows, *more), model_errors=MODEL_ERRORS)


@pytest.mark.parametrize(
    ("scene", "static_pct", "strains"),
    [
        (EMPTY, 15.0, ("bend",)),
        (EMPTY, 5.0, ("bend", "stretch")),
        (BULB, 15.0, ("bend",)),
        (BULB, 5.0, ALL),
    ],
)
def test_strains_are_chosen_so_that_the_errors_of_model_and_solution_together_are_within_the_tolerance(
    scene, static_pct, strains
):
    request = FidelityRequest(tolerance=Tolerance(static_pct, static_pct, 20.0))
    found = plan(scene, LENGTH_M, with_strains(), request)
    assert found.within_tolerance
    assert found.fidelity.strains == strains
    assert found.expected.model_pct > 0.0
    assert "of them the model's" in str(found)


def test_strains_that_are_forced_are_kept_and_what_they_cost_in_accuracy_is_said():
    request = FidelityRequest(tolerance=Tolerance(5.0, 5.0, 20.0), strains=("bend",))
    found = plan(BULB, LENGTH_M, with_strains(), request)
    assert found.fidelity.strains == ("bend",)
    assert not found.within_tolerance
    assert found.expected.static_pct == pytest.approx(14.0 + 0.5, abs=0.4)


@pytest.mark.parametrize(
    ("scene", "tolerance", "chosen"),
    [
        (EMPTY, {"static": 1.0, "transient": 20.0}, ("rod", 2, 0.002, "lag")),
        (EMPTY, {"static": 1.0}, ("rod", 2, 0.002, "iso6358")),
        (EMPTY, {"static": 0.1, "transient": 0.15}, ("rod", 3, 0.002, "iso6358")),
        (BULB, {"static": 7.0}, ("rod", 2, 0.002, "lag")),
        (BULB, {"static": 1.0}, ("rod", 2, 0.002, "iso6358")),
        (BULB, {"static": 1.0, "force": 1.5}, ("rod", 3, 0.002, "iso6358")),
    ],
)
def test_the_cheapest_fidelity_within_the_tolerance_is_chosen(scene, tolerance, chosen):
    found = planned(scene, **tolerance)
    assert measured(found.fidelity) == chosen
    assert found.within_tolerance


def test_of_those_that_cost_about_the_same_the_nearest_is_chosen():
    cheapest = planned(EMPTY, 1.0, sub_step_s=0.010)
    found = planned(EMPTY, 1.0)
    assert found.expected.cpu_ms_per_s > cheapest.expected.cpu_ms_per_s
    assert found.expected.transient_pct < cheapest.expected.transient_pct


def test_where_nothing_is_within_the_tolerance_the_nearest_is_chosen_and_said_to_be_outside():
    found = planned(BULB, 0.01)
    assert measured(found.fidelity) == ("rod", 3, 0.002, "iso6358")
    assert not found.within_tolerance
    assert "OUTSIDE" in str(found)


def test_an_error_is_never_taken_to_be_smaller_than_the_reference_is_known():
    found = planned(BULB, 1.0, reference={"lift": {"static_pct": 3.0}})
    assert found.expected.static_pct == 3.0
    assert not found.within_tolerance


def test_a_longer_step_is_not_trusted_to_be_nearer_than_a_shorter_one():
    lucky = [Measured(case, "rod", 2, 0.020, "iso6358", 0.0, 0.0, 0.0, 1.0, 0.0) for case in GRASP_CASES["sphere"]]
    asked = FidelityRequest(tolerance=Tolerance(1.0, 1.0, 2.0))
    found = plan(BULB, LENGTH_M, table(extra=lucky), dataclasses.replace(asked, sub_step_s=0.020))
    assert found.expected.static_pct == GRASP["rod", 2, 0.010, "iso6358"][0]
    assert plan(BULB, LENGTH_M, table(extra=lucky), asked).fidelity.sub_step_s == 0.002


@pytest.mark.parametrize(
    "forced", [{"tier": "arc"}, {"modes": 3}, {"sub_step_s": 0.010}, {"pneumatics": "lag"}, {"tier": "static"}]
)
def test_each_part_can_be_forced(forced):
    found = planned(EMPTY, 1.0, **forced)
    for part, value in forced.items():
        assert getattr(found.fidelity, part) == value
        assert found.reasons[part] == ("forced",)


def test_forced_pneumatics_are_taken_for_the_real_ones():
    found = planned(EMPTY, 1.0, pneumatics="lag")
    assert measured(found.fidelity) == ("rod", 2, 0.002, "lag")
    assert found.expected.transient_pct == AIR["rod", 2, 0.002, "iso6358"][1]
    assert found.expected.cpu_ms_per_s == AIR["rod", 2, 0.002, "lag"][3]


def test_a_forced_step_that_was_not_measured_counts_as_the_next_longer_one():
    found = planned(BULB, 1.0, sub_step_s=0.003)
    assert found.fidelity.sub_step_s == 0.003
    assert found.expected.static_pct == GRASP["rod", 2, 0.010, "iso6358"][0]
    with pytest.raises(PlanError, match=r"sub_step_s 0\.02.*measured there.*0\.002, 0\.01"):
        planned(BULB, 1.0, sub_step_s=0.02)


def test_a_tier_that_cannot_move_an_object_is_refused_with_those_that_can():
    with pytest.raises(PlanError, match=r"tier static.*tier arc, rod"):
        planned(BULB, 1.0, tier="static")


def test_steps_go_into_the_tick():
    assert planned(EMPTY, 1.0, tick_s=0.004).fidelity.sub_step_s == 0.002
    with pytest.raises(PlanError, match="tick of 0.003"):
        planned(BULB, 1.0, tick_s=0.003)


def test_contact_and_camera_are_there_only_with_an_object():
    for scene, there in ((EMPTY, False), (BULB, True)):
        found = planned(scene)
        assert (found.contact, found.camera) == (there, there)
    assert planned(EMPTY, camera=True).camera


def test_contact_that_is_forced_is_judged_on_the_cases_with_or_without_it():
    left_out, put_in = planned(BULB, 1.0, contact=False), planned(EMPTY, 1.0, contact=True)
    assert (left_out.contact, put_in.contact) == (False, True)
    assert left_out.expected == planned(EMPTY, 1.0).expected
    assert put_in.expected == planned(BULB, 1.0).expected
    assert left_out.reasons["contact"] == put_in.reasons["contact"] == ("forced",)
    assert left_out.camera and planned(BULB, 1.0, modes=3, contact=False).fidelity.air_modes is None


def test_all_fingers_move_unless_some_are_named():
    assert planned(EMPTY).fidelity.moving_fingers == (1, 2, 3, 4)
    assert planned(EMPTY, moving_fingers=(1, 3)).fidelity.moving_fingers == (1, 3)


def test_an_object_out_of_reach_takes_as_many_modes_as_the_air():
    assert planned(BULB, 1.0, modes=3).fidelity.air_modes == 2
    assert planned(BULB, 1.0).fidelity.air_modes is None  # two in contact as well
    assert planned(EMPTY, 1.0).fidelity.air_modes is None


def test_the_plan_says_for_each_part_what_else_there_was():
    text = str(planned(EMPTY, 1.0))
    for part in (
        "pneumatics",
        "tier",
        "modes",
        "air_modes",
        "sub_step_s",
        "contact",
        "camera",
        "moving_fingers",
        "expected",
    ):
        assert any(line.startswith(part) for line in text.splitlines())
    assert "not arc: 3 % at rest, 3 % in motion, 30 ms/s, too far off" in text
    assert "not 3: 0.05 % at rest, 0.1 % in motion, 60 ms/s\n" in text
    assert "within the tolerance" in text


# Promises over kinds of scenes, and scenes unlike those they are made from


def promising(ranges=None):
    """The table with its grasps as promises, for which the worst case of a kind stands."""
    rows = [
        Measured(kind, *how, static, transient, 0.0, cost, force)
        for kind, numbers in (("air", AIR), *((kind, GRASP) for kind in GRASP_CASES))
        for how, (static, transient, force, cost) in numbers.items()
    ]
    return dataclasses.replace(table(), rows=(), promises=tuple(rows), ranges=ranges or {})


RANGES = {"sphere": {"diameter [mm]": (50.0, 70.0), "friction": (0.1, 0.5), "pressure [kPa]": (60.0, 100.0)}}
ONE_PCT = FidelityRequest(tolerance=Tolerance(1.0, 1.0, 2.0))


def test_promises_are_planned_with_like_cases():
    for scene in (EMPTY, BULB):
        assert plan(scene, LENGTH_M, promising(), ONE_PCT).expected == planned(scene, 1.0).expected


def test_a_scene_like_those_that_were_measured_is_not_warned_of():
    scene = dataclasses.replace(BULB, friction_coefficient=0.3)
    assert plan(scene, LENGTH_M, promising(RANGES), ONE_PCT, pressure_gauge_pa=80e3).warnings == ()


def test_a_scene_unlike_all_of_them_is_warned_of_and_its_errors_are_taken_to_be_larger():
    scene = dataclasses.replace(BULB, friction_coefficient=0.7)
    found = plan(scene, LENGTH_M, promising(RANGES), ONE_PCT, pressure_gauge_pa=120e3)
    assert "friction 0.7, measured from 0.1 to 0.5" in str(found)
    assert "pressure 120, measured from 60 to 100 kPa" in str(found)
    assert "2 times as large" in str(found) and "--measure" in str(found)
    plain = planned(BULB, 1.0, modes=found.fidelity.modes, sub_step_s=0.002, pneumatics="iso6358")
    assert found.expected.static_pct == pytest.approx(2.0 * plain.expected.static_pct)


def test_a_scene_of_several_objects_is_unlike_all_that_were_measured():
    carton, _ = load_scene("carton")
    scene = dataclasses.replace(BULB, others=(PlacedObject(carton.object, (0.15, 0.0, 0.285)),))
    for known in (promising(RANGES), table()):
        found = plan(scene, LENGTH_M, known, ONE_PCT)
        assert "2 objects, measured with one" in str(found)
        assert "2 times as large" in str(found)


def test_fewer_modes_in_the_air_are_never_more_than_in_contact():
    """Though three modes in the air were measured to be cheaper than two."""
    cheap = [dataclasses.replace(row, cpu_ms_per_s=1.0) for row in table().rows if row.modes == 3]
    rows = [row for row in table().rows if row.modes != 3]
    strange = dataclasses.replace(table(), rows=(*rows, *cheap))
    found = plan(BULB, LENGTH_M, strange, dataclasses.replace(ONE_PCT, modes=2))
    assert (found.fidelity.air_modes or 2) <= found.fidelity.modes == 2
    with pytest.raises(ValueError, match="air_modes must not be above modes, found 4 and 2"):
        FidelityRequest("rod", 0.002, modes=2, air_modes=4)
    with pytest.raises(PlanError, match="air_modes 4 are more than the modes in contact, 2"):
        plan(BULB, LENGTH_M, table(), dataclasses.replace(ONE_PCT, air_modes=4))


def test_where_the_model_alone_is_beyond_the_tolerance_no_nearer_solution_is_paid_for():
    request = FidelityRequest(tolerance=Tolerance(1.0, 1.0, 20.0))
    found = plan(BULB, LENGTH_M, with_strains(), request)
    assert not found.within_tolerance
    assert found.fidelity.strains == ALL and found.fidelity.modes == 2
    assert "a nearer solution would not help" in str(found)


def test_where_model_and_solution_are_beyond_the_tolerance_only_together_the_nearest_is_taken():
    alone_pct = plan(BULB, LENGTH_M, with_strains(), FidelityRequest(tolerance=Tolerance(1.0, 1.0, 20.0))).expected
    just_above_pct = 1.01 * alone_pct.model_pct
    tolerance = Tolerance(just_above_pct, just_above_pct, 20.0)
    found = plan(BULB, LENGTH_M, with_strains(), FidelityRequest(tolerance=tolerance))
    assert not found.within_tolerance and found.expected.excess < alone_pct.excess
    assert "nothing measured is nearer" in str(found)


def test_where_nothing_holds_of_those_about_as_near_the_cheapest_is_taken():
    twin = [dataclasses.replace(row, modes=4, cpu_ms_per_s=70.0) for row in table().rows if row.modes == 3]
    found = plan(BULB, LENGTH_M, table(extra=twin), FidelityRequest(tolerance=Tolerance(0.01, 0.01, 0.01)))
    assert found.fidelity.modes == 4


# The shipped table and scene files


def test_every_shipped_scene_has_a_plan_from_the_shipped_table():
    shipped = load_fidelity_table()
    for name in scene_names():
        scene, _ = load_scene(name)
        found = plan(scene, LENGTH_M, shipped, FidelityRequest())
        contact = may_touch(scene, LENGTH_M)
        stand_for_it = kinds_of(scene, contact) if shipped.promises else cases_of(scene, contact)
        assert measured(found.fidelity) in {
            measured(row.fidelity) for row in shipped.judging if row.scene in stand_for_it
        }


def test_a_table_is_read_anew_when_its_file_changes(tmp_path):
    path = tmp_path / "table.json"
    empty = {"rows": [], "reference": {}, "machine": {}, "versions": {}}
    for processor in ("one", "another"):
        path.write_text(json.dumps(empty | {"machine": {"processor": processor}}))
        os.utime(path, ns=(0, len(processor)))
        assert load_fidelity_table(path).machine["processor"] == processor


def test_the_shipped_reference_is_that_of_the_boundary_value_problem():
    reference = load_fidelity_table().reference
    for case in AIR_CASES:
        assert reference[case]["boundary_value_pct"] < 0.01


def changed(tmp_path, **values):
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump(load_yaml("scenes/empty.yaml") | values))
    return load_scene(path)


def test_a_scene_with_tier_auto_is_built_as_planned(tmp_path):
    scene, asked = changed(tmp_path, tier="auto", sub_step_s=None, tolerance={"static_pct": 1.0, "transient_pct": 1.0})
    chosen = choose_fidelity(scene, asked, LENGTH_M)
    assert (chosen.tier, chosen.pneumatics, chosen.largest_jump_pct) == ("rod", "iso6358", 1.0)
    plants = [build_plant(scene, each, load_gripper()) for each in (asked, chosen)]
    for plant in plants:
        plant.step(np.ones(16), 0.02)
    np.testing.assert_array_equal(*(plant.observe().centreline_m for plant in plants))


def test_what_a_scene_with_tier_auto_gives_itself_is_forced(tmp_path):
    given = {"sub_step_s": 0.001, "pneumatics": "ideal", "modes": 4, "moving_fingers": [1, 2], "contact": False}
    scene, asked = changed(tmp_path, tier="auto", **given)
    assert asked == FidelityRequest("auto", 0.001, "ideal", 4, None, (1, 2), False, None)
    chosen = choose_fidelity(scene, asked, LENGTH_M)
    assert chosen.moving_fingers == (1, 2) and not chosen.contact
    assert measured(chosen) == ("rod", 4, 0.001, "ideal")


def test_modes_of_the_air_that_are_given_are_kept_where_the_plan_has_a_use_for_them():
    assert planned(BULB, 1.0, modes=3, air_modes=1).fidelity.air_modes == 1
    assert planned(EMPTY, 1.0, air_modes=1).fidelity.air_modes is None


def test_a_scene_with_another_tier_is_computed_as_it_says():
    assert choose_fidelity(BULB, BULB_REQUEST, LENGTH_M) == Fidelity("arc", 1, 0.002, None)


@pytest.mark.parametrize(("scene", "contact", "modes"), [(BULB, None, 3), (BULB, False, 2), (EMPTY, None, 2)])
def test_a_rod_without_modes_has_those_that_do_for_what_it_may_touch(scene, contact, modes):
    asked = FidelityRequest("rod", 0.002, contact=contact)
    assert choose_fidelity(scene, asked, LENGTH_M) == Fidelity("rod", modes, 0.002, contact=contact is None)


def test_what_asks_for_no_step_is_planned():
    assert choose_fidelity(BULB, FidelityRequest("arc", pneumatics="lag"), LENGTH_M).tier == "arc"


def test_modes_of_curvature_are_given_up_where_another_tier_takes_none():
    asked = FidelityRequest("rod", 0.002, modes=4, air_modes=2)
    assert asked.in_tier("arc") == FidelityRequest("arc", 0.002)
    assert asked.in_tier("auto") == dataclasses.replace(asked, tier="auto")


def test_only_tier_auto_may_leave_the_step_open(tmp_path):
    with pytest.raises(ConfigError, match="only tier auto chooses one"):
        changed(tmp_path, sub_step_s=None)


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Tolerance)])
def test_a_tolerance_of_nothing_is_refused(name):
    with pytest.raises(ValueError, match=name):
        Tolerance(**{name: 0.0})
