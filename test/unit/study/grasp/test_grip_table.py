"""The table of least pressures and what it changes, with grasps that are decided by a rule instead of the plant."""

import json

import pytest

from mbpam_ros.commands import grip_table as grip_table_command
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import load_config
from mbpam_ros.grasp.grip_pressure import GripConfig, load_grip_table
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.placement import placed
from mbpam_ros.plant.plant import PlantConfig
from mbpam_ros.study.grasp import compare_grips, grip_table
from mbpam_ros.study.grasp.drawn_grasps import drawn_grasp
from mbpam_ros.study.grasp.trial import Trial

EMPTY = [
    {"mode": mode, "pressure_gauge_pa": [50e3, 100e3], "bend_deg": [[30.0] * 4, [90.0] * 4]}
    for mode in grip_table.WIDTHS_M
]


def needs_pa(scene):
    spec = scene.object
    return 50e3 + 3e5 * spec.mass_kg + 2e4 * (0.8 - scene.friction_coefficient) + 1e5 * abs(spec.size_m[0] - 0.03)


def by_a_rule(scene, request, gripper, grip_pressure_gauge_pa=None, expected=None, mode=None, grasp=None):
    grip_pa = grip_pressure_gauge_pa or (60e3 + 3e5 * expected.mass_kg if expected and expected.mass_kg else 100e3)
    held = grip_pa >= needs_pa(scene)
    return Trial(mode or "envelope", held, 0.1, 0.1, 0.2, 0.5, 1e-5 * grip_pa, "", grip_pa)


@pytest.fixture
def rule(monkeypatch):
    monkeypatch.setattr(grip_table, "run_trial", by_a_rule)
    monkeypatch.setattr(compare_grips, "run_trial", by_a_rule)
    monkeypatch.setattr(grip_table_command, "empty_rows", lambda request, gripper: EMPTY)


def test_the_least_pressures_are_found_to_the_resolution_and_read_again(rule, tmp_path, capsys):
    path = tmp_path / "table.json"
    assert main(["grip-table", "--json", str(path), "--workers", "1"]) == 0
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["empty"] == EMPTY and content["settings"]["sources"]
    assert len(content["rows"]) == 4 * 3 * 4 * 2
    for row in content["rows"]:
        for mass_kg, least_pa in zip(row["mass_kg"], row["least_gauge_pa"], strict=True):
            spec = grip_table.object_for(row["mode"], row["width_m"], mass_kg)
            scene = grip_table.scene_for(row["mode"], spec, (0.0, 0.0, 0.08), 0.0, row["friction_coefficient"])
            needed_pa = max(needs_pa(scene), grip_table.LOWEST_PA)
            assert needed_pa <= least_pa <= needed_pa + grip_table.RESOLUTION_PA
    least, weight = load_grip_table(path).corners("mid_rod", 0.032, 0.08, 0.6, 0.1)
    assert float(least @ weight) == pytest.approx(50e3 + 3e4 + 4e3 + 200.0, abs=3e3)
    assert "96 rows in" in capsys.readouterr().out


def test_an_interrupted_table_goes_on_from_what_is_finished(rule, tmp_path, monkeypatch, capsys):
    path = tmp_path / "table.json"
    assert main(["grip-table", "--json", str(path), "--workers", "1"]) == 0
    content = json.loads(path.read_text(encoding="utf-8"))
    kept = content["rows"][:-1]
    path.write_text(json.dumps(content | {"rows": kept}), encoding="utf-8")
    run = []
    monkeypatch.setattr(grip_table, "run_trial", lambda *args, **more: run.append(args) or by_a_rule(*args, **more))
    assert main(["grip-table", "--json", str(path), "--workers", "1"]) == 0
    assert len({args[0].friction_coefficient for args in run}) == 1
    assert json.loads(path.read_text(encoding="utf-8"))["rows"] == content["rows"]


def test_no_pressure_that_was_tried_leaves_none_and_heavier_objects_are_not_tried(monkeypatch):
    tried = []

    def lost(scene, request, gripper, pressure_pa, mode):
        tried.append((scene.object.mass_kg, pressure_pa))
        return Trial(mode, False, 0.0, 0.1, 0.2, 0.5, 0.0)

    monkeypatch.setattr(grip_table, "run_trial", lost)
    row = grip_table.table_row("envelope", 0.05, 0.08, 0.4, None, load_gripper())
    assert row["least_gauge_pa"] == [None] * len(grip_table.MASSES_KG)
    assert {mass for mass, _ in tried} == {grip_table.MASSES_KG[0]} and tried[-1][1] == grip_table.HIGHEST_PA


def test_drawn_grasps_repeat_and_fit_between_the_fingers():
    gripper, config, plant = load_gripper(), GripConfig(), load_config(PlantConfig, "plant.yaml")
    drawn = [drawn_grasp(5, number, gripper, config) for number in range(40)]
    assert drawn == [drawn_grasp(5, number, gripper, config) for number in range(40)]
    assert {each.mode for each in drawn} == set(grip_table.WIDTHS_M)
    for each in drawn:
        placed(each.scene, gripper, plant, contact=True)
        assert each.expected.mass_kg >= each.scene.object.mass_kg
        assert each.expected.friction_coefficient <= each.scene.friction_coefficient


def test_both_pressures_are_compared_on_the_same_grasps(rule, tmp_path, capsys):
    table = tmp_path / "table.json"
    assert main(["grip-table", "--json", str(table), "--workers", "1"]) == 0
    path = tmp_path / "grips.json"
    status = main(["judge-grips", "--json", str(path), "--grasps", "30", "--table", str(table), "--workers", "1"])
    content = json.loads(path.read_text(encoding="utf-8"))
    found, rows = content["verdict"], content["grasps"]
    assert found["grasps"] == len(rows) == 30
    lost = [row["job"] for row in rows if row["by_mode_held"] and not row["by_object_held"]]
    assert found["lost"] == lost and status == (1 if lost else 0)
    both = next(each for each in found["force"] if each["of"] == "all")
    assert both["by_object_grip_gauge_pa"] < both["by_mode_grip_gauge_pa"] == 100e3
    assert both["by_object_force_n"] < both["by_mode_force_n"]
    assert "held by the pressure of the mode" in capsys.readouterr().out
