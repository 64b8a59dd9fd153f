"""The trade: its norms on made-up runs, its reference against closed forms, and the command on a short case."""

import dataclasses
import json
import re

import cv2
import numpy as np
import pytest

from mbpam_ros.commands import trade as trade_command
from mbpam_ros.commands.mbpam import main
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity, load_fidelity_table
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.study.fidelity import costs, trade
from mbpam_ros.study.fidelity.absent_costs import imported_parts
from mbpam_ros.study.fidelity.boundary_value import boundary_value_error_pct, hanging_tip_m
from mbpam_ros.study.fidelity.cases import Case, all_cases
from mbpam_ros.study.fidelity.errors import errors
from mbpam_ros.study.fidelity.picture import pareto_front
from mbpam_ros.study.fidelity.runs import Record, run
from mbpam_ros.study.fidelity.trade import can_run, fidelities

GRIPPER = load_gripper()
GEOMETRY = GRIPPER.geometry
AIR = Case(
    name="free_bend",
    scene=load_scene("empty")[0],
    setpoint_gauge_pa=np.tile([40e3, 0.0, 0.0, 0.0], 4),
    shares=((0.0, 0.0), (0.05, 1.0)),
    rest_s=(0.1,),
    moving_s=(0.0, 0.1),
)
GRASP = dataclasses.replace(AIR, name="sphere", scene=load_scene("bulb")[0], rest_s=(0.0, 0.1), moving_s=(0.05, 0.1))
WEIGHT_N = GRASP.scene.object.mass_kg * 9.81


def record(case, instants=11):
    body = None if case.scene.object is None else np.zeros((instants, 3))
    time = 0.01 * np.arange(instants)
    return Record(time, np.zeros((instants, 4, 3)), np.zeros((instants, 16)), np.zeros((instants, 4, 3)), body, 1.0)


def test_a_run_beside_itself_is_without_error():
    off = errors(GRASP, record(GRASP), record(GRASP), 0.1)
    assert (off.static_pct, off.transient_pct, off.pressure_pct, off.contact_force_pct) == (0.0, 0.0, 0.0, 0.0)
    assert errors(AIR, record(AIR), record(AIR), 0.1).contact_force_pct is None


def test_errors_at_rest_and_in_motion_are_the_largest_distance_over_the_active_length():
    found = record(GRASP)
    found.tip_m[10, 2] = (0.0, 0.003, 0.004)  # at rest and in motion
    found.tip_m[7, 1] = (0.010, 0.0, 0.0)  # in motion only
    found.tip_m[3, 0] = (0.050, 0.0, 0.0)  # before the motion
    off = errors(GRASP, found, record(GRASP), 0.1)
    assert off.static_pct == pytest.approx(5.0)
    assert off.transient_pct == pytest.approx(10.0)


def test_a_lost_object_is_an_error_of_position():
    found = record(GRASP)
    found.object_m[10] = (0.0, 0.0, 0.1)
    assert errors(GRASP, found, record(GRASP), 0.1).static_pct == pytest.approx(100.0)


@pytest.mark.parametrize(("largest_n", "scale_n"), [(2.0, 2.0), (0.1, WEIGHT_N)])
def test_force_errors_are_vectors_over_the_larger_of_the_largest_force_and_the_weight(largest_n, scale_n):
    reference, found = record(GRASP), record(GRASP)
    reference.finger_force_n[10, 0] = (largest_n, 0.0, 0.0)
    found.finger_force_n[10, 0] = (largest_n, 0.03, 0.04)
    assert errors(GRASP, found, reference, 0.1).contact_force_pct == pytest.approx(5.0 / scale_n)


def test_pressure_errors_are_over_100_kpa():
    found = record(AIR)
    found.pressure_gauge_pa[5, 3] = -7e3
    assert errors(AIR, found, record(AIR), 0.1).pressure_pct == pytest.approx(7.0)


def test_the_boundary_value_problem_returns_a_weightless_muscles_circle_and_a_hanging_ones_straight_line():
    light = dataclasses.replace(GEOMETRY, mass_per_length_kg_m=1e-12)
    angle, radius = 1.5, GEOMETRY.active_length_m / 1.5
    tip = hanging_tip_m(np.array([0.0, -1.5e-3 * 15.0]), 1.5e-3, light)
    across = radius * (1.0 - np.cos(angle)) + GEOMETRY.end_length_m * np.sin(angle)
    down = GEOMETRY.end_length_m * (1.0 + np.cos(angle)) + radius * np.sin(angle)
    np.testing.assert_allclose(tip, [0.0, -across, down], atol=1e-8)
    np.testing.assert_allclose(hanging_tip_m(np.zeros(2), 1.5e-3, GEOMETRY), [0.0, 0.0, GEOMETRY.length_m], atol=1e-12)


def test_a_resting_rod_is_at_the_boundary_value_problem_and_nearer_with_more_modes():
    pressures = np.tile([80e3, 20e3, 0.0, 0.0], 4)
    case = dataclasses.replace(AIR, setpoint_gauge_pa=pressures, rest_s=(1.2,))
    off = [
        boundary_value_error_pct(case, run(case, Fidelity("rod", m, 0.002, "lag"), GRIPPER), GRIPPER) for m in (2, 4)
    ]
    assert off[1] < 0.01 < 0.1 * 0.5
    assert off[1] < 0.5 * off[0] < 0.1


def test_each_of_the_seven_cases_is_driven_to_its_pressure_and_ends_after_its_motion():
    cases = {case.name: case for case in all_cases()}
    assert list(cases) == [
        "free_bend", "unequal_pressures", "fast_release", "sphere", "slender_rod", "box", "lift",
    ]  # fmt: skip
    for case in cases.values():
        assert case.duration_s >= case.moving_s[1] > case.moving_s[0]
        assert case.wanted_gauge_pa(0.5).max() in (80e3, 100e3)


def test_the_fast_release_vents_from_full_pressure_until_the_muscles_hang_straight():
    case = next(case for case in all_cases() if case.name == "fast_release")
    seen = run(case, Fidelity("rod", 2, 0.01, "iso6358"), GRIPPER)
    begun = round(case.moving_s[0] / 0.01)
    assert seen.pressure_gauge_pa[begun].max() > 99e3
    off = np.linalg.norm(seen.tip_m - GRIPPER.finger_base_m - (0.0, 0.0, GEOMETRY.length_m), axis=2).max(axis=1)
    assert off[begun] > 0.1 and off[-1] < 0.001


def test_only_the_front_is_on_the_front():
    assert pareto_front([(3.0, 1.0), (1.0, 5.0), (2.0, 6.0), (2.0, 4.0), (4.0, 1.0)]) == [
        (1.0, 5.0),
        (2.0, 4.0),
        (3.0, 1.0),
    ]


def test_a_tier_without_objects_is_not_run_with_one():
    static = Fidelity("static", 1, 0.01, "lag")
    assert can_run(AIR, static) and not can_run(GRASP, static)


def test_the_shipped_table_has_every_case_at_every_fidelity():
    """Rods that diverge have no row; those that stretch and twist are there all or none."""
    measured = {(row.scene, row.fidelity) for row in load_fidelity_table().rows}
    strains = {fidelity.strains for _, fidelity in measured}
    grid = [each for each in trade.with_strains(fidelities()) if each.strains in strains]
    assert measured == {(case.name, each) for case in all_cases() for each in grid if can_run(case, each)}


TRADE = ["trade", "--workers", "1"]


@pytest.fixture
def short_trade(monkeypatch, tmp_path):
    grid = (Fidelity("arc", 1, 0.005, "lag"), Fidelity("rod", 2, 0.005, "iso6358"))
    monkeypatch.setattr(trade_command, "all_cases", lambda: (AIR, GRASP))
    monkeypatch.setattr(trade, "fidelities", lambda: grid)
    monkeypatch.setattr(trade, "quick_fidelities", lambda: grid)
    monkeypatch.setattr(trade, "QUICK_CASES", ("sphere",))
    monkeypatch.setattr(costs, "MOST_RUNS", 3)
    return tmp_path


def test_the_command_writes_rows_picture_and_a_table_that_the_planner_reads(short_trade, capsys):
    file, table = short_trade / "trade.json", short_trade / "table.json"
    assert main([*TRADE, "--json", str(file), "--table", str(table), "--no-strains", "--scenes", "0"]) in (0, 1)
    rows = json.loads(file.read_text())
    asked = {
        "scene",
        "tier",
        "modes",
        "step_s",
        "pneumatics",
        "static_error_pct",
        "transient_error_pct",
        "cpu_ms_per_s",
    }
    assert len(rows) == 4 and all(asked <= set(row) for row in rows)
    assert [("contact_force_error_pct" in row) for row in rows] == [False, False, True, True]
    assert rows[1]["transient_error_pct"] < rows[0]["transient_error_pct"]
    loaded = load_fidelity_table(table)
    assert [row.cpu_ms_per_s for row in loaded.rows] == [row["cpu_ms_per_s"] for row in rows]
    assert set(loaded.reference) == {"free_bend", "sphere"} and loaded.machine["processor"]
    assert "[4/4]" in capsys.readouterr().out
    pytest.importorskip("matplotlib")
    assert cv2.imread(str(file.with_suffix(".png"))) is not None


def test_with_strains_rods_are_measured_against_references_that_stretch_and_twist_too(short_trade, monkeypatch):
    states = short_trade / "states.json"
    state = {"pattern": "pdc", "pressure_kpa": 100.0, "tip_torque_n_mm": 0.0, "gravity_m_s2": [0.0, 0.0, 9.81]}
    state |= {"tip_direction": [-0.8, 0.0, -0.6], "tip_roll_deg": 0.0}
    answers = (([0.0, 0.0, 0.0], [-93.0, 0.0, 48.0]), ([0.0, 0.05, 0.0], [-92.0, 15.0, 48.0]))
    rows = [state | {"tip_force_n": force, "tip_position_mm": tip} for force, tip in answers]
    states.write_text(json.dumps({"states": rows}))
    monkeypatch.setattr(trade_command, "states_file", lambda: states)
    file, table = short_trade / "trade.json", short_trade / "table.json"
    assert main([*TRADE, "--quick", "--strains", "--json", str(file), "--table", str(table)]) == 0
    loaded = load_fidelity_table(table)
    rods = {row.fidelity.strains: row for row in loaded.rows if row.tier == "rod"}
    assert list(rods) == [("bend",), ("bend", "stretch"), ("bend", "stretch", "twist")]
    assert all(row.static_error_pct < 5.0 for row in rods.values())
    assert [each.strains for each in loaded.model_errors] == list(rods)
    assert loaded.model_errors[0].free_pct > 5.0 > loaded.model_errors[1].free_pct > 0.0


def test_what_is_finished_is_not_run_again_and_gives_the_same_rows(short_trade, monkeypatch, capsys):
    command = [*TRADE, "--quick", "--json", str(short_trade / "trade.json")]
    assert main(command) == 0
    rows = (short_trade / "trade.json").read_bytes()
    kept = json.loads((short_trade / "trade_runs.json").read_text())
    assert [row["job"] for row in kept["runs"]] == [
        "sphere: arc 1, 5 ms, lag",
        "sphere: rod 2, 5 ms, iso6358",
        "costs",
    ]
    monkeypatch.setattr(trade, "run", None)  # would fail
    monkeypatch.setattr(trade, "reference_of", None)
    monkeypatch.setattr(trade, "timed", None)
    assert main(command) == 0
    assert (short_trade / "trade.json").read_bytes() == rows
    assert json.loads((short_trade / "trade_runs.json").read_text())["runs"] == kept["runs"]


def test_errors_are_the_same_bits_for_any_number_of_workers(short_trade):
    found = []
    for workers in ("1", "2"):
        path = short_trade / f"{workers}.json"
        assert main(["trade", "--quick", "--workers", workers, "--json", str(path)]) == 0
        found.append([{**row, "cpu_ms_per_s": None} for row in json.loads(path.read_text())])
    assert found[0] == found[1]


def test_a_quick_run_leaves_the_planners_table_alone(short_trade):
    before = load_fidelity_table()
    assert main([*TRADE, "--quick", "--json", str(short_trade / "quick.json")]) == 0
    assert {row["scene"] for row in json.loads((short_trade / "quick.json").read_text())} == {"sphere"}
    assert load_fidelity_table() == before


def test_a_file_that_cannot_be_written_is_said_in_one_line(short_trade, capsys):
    (short_trade / "file").write_text("")
    with pytest.raises(SystemExit, match="2"):
        main([*TRADE, "--quick", "--json", str(short_trade / "file" / "trade.json")])
    said = capsys.readouterr().err
    assert "cannot write" in said and said.count("\n") == 1


def test_the_plan_is_printed_with_what_the_scene_file_says_beside_it(capsys):
    assert main(["plan", "bulb", "--modes", "4", "--tolerance", "20"]) == 0
    text = capsys.readouterr().out
    assert "scene bulb; allowed: 20 % at rest, 20 % in motion, 20 % of contact force" in text
    assert re.search(r"modes +4 +forced", text)
    assert "as the file says (arc, 2 ms, lag taken for the real one)" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["piano"], "no scene 'piano'"),
        (["bulb", "--tier", "static"], "nothing measured on sphere fits tier static"),
        (["bulb", "--tolerance", "-1"], "static_pct must be greater than 0"),
    ],
)
def test_what_cannot_be_planned_is_said_in_one_line(capsys, arguments, said):
    assert main(["plan", *arguments]) == 1
    told = capsys.readouterr().err
    assert told.startswith("mbpam plan: ") and said in told and told.count("\n") == 1


def test_a_plan_outside_the_tolerance_has_its_own_exit_status(capsys):
    assert main(["plan", "carton", "--tolerance", "0.001"]) == 1
    assert "OUTSIDE the tolerance" in capsys.readouterr().out


def test_what_is_absent_from_a_scene_is_not_imported():
    """No tier and no model that the scene does not ask for."""
    scene, _ = load_scene("empty")
    assert imported_parts(scene, Fidelity("static", 1, 0.01, "ideal")) == ("static",)
    assert imported_parts(scene, Fidelity("arc", 1, 0.002)) == ("rod",)
