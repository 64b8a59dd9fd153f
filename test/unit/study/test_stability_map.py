"""The map of stable steps, and the verb that prints it."""

import dataclasses
import json

import numpy as np
import pytest

from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.tiers.base import PlantConfig
from mbpam_ros.study import stability_map
from mbpam_ros.study.stability_map import Cell, map_text, run_cell

GRIPPER, CONFIG = load_gripper(), load_config(PlantConfig, "plant.yaml")


def test_the_quick_map_has_every_cell_and_no_fault(tmp_path, capsys):
    assert main(["stability", "--quick", "--json", str(tmp_path / "map.json")]) == 0
    cells = json.loads((tmp_path / "map.json").read_text())["cells"]
    columns = 1 + len(stability_map.QUICK_STIFFNESSES_N_M)
    assert len(cells) == len(stability_map.QUICK_STEPS_S) * (1 + 2 * columns)
    assert {cell["outcome"] for cell in cells} <= {"at_rest", "moving", "stopped"}
    assert "tier rod" in capsys.readouterr().out


@pytest.mark.parametrize("tier", ["arc", "rod"])
@pytest.mark.parametrize("step_s", [1e-3, 2e-3, 5e-3, 1e-2])
def test_at_the_steps_in_use_the_sphere_is_held_in_balance_whatever_the_stiffness(tier, step_s):
    for stiffness in (1e2, 2e3, 1e5, 1e7):
        cell = run_cell(tier, step_s, stiffness, GRIPPER, CONFIG)
        assert cell.outcome == "at_rest"
        assert cell.force_error_pct < 2.0


def test_contact_at_steps_of_a_second_is_solved_in_few_of_newtons_steps():
    """False position alone took 816, creeping along each toward where a contact closes."""
    assert run_cell("arc", 1.0, 2e3, GRIPPER, CONFIG).outcome == "at_rest"


def test_a_number_that_is_not_finite_is_a_fault(monkeypatch, capsys):
    def broken(setup, fidelity):
        tier = stability_map_build(setup, fidelity)
        state = tier.state
        tier.state = lambda: dataclasses.replace(state(), bend_rad=np.full((4, 2), np.nan))
        return tier

    stability_map_build = stability_map.build_tier
    monkeypatch.setattr(stability_map, "build_tier", broken)
    monkeypatch.setattr(stability_map, "QUICK_STEPS_S", (1.0,))
    assert main(["stability", "--quick", "--workers", "1"]) == 1
    assert "FAULT" in capsys.readouterr().out


def test_a_map_goes_on_from_the_cells_that_its_file_holds(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(stability_map, "QUICK_STEPS_S", (1.0,))
    command = ["stability", "--quick", "--workers", "1", "--json", str(tmp_path / "map.json")]
    assert main(command) == 0
    whole = capsys.readouterr().out
    stored = json.loads((tmp_path / "map.json").read_text())
    lost = stored["cells"].pop(1)
    (tmp_path / "map.json").write_text(json.dumps(stored))
    run, run_anew = stability_map.run_cell, []
    monkeypatch.setattr(stability_map, "run_cell", lambda *cell: run_anew.append(cell[:3]) or run(*cell))
    assert main(command) == 0
    assert run_anew == [(lost["tier"], lost["step_s"], lost["stiffness_n_m"])]
    assert capsys.readouterr().out == whole


def test_an_error_of_another_kind_is_a_fault(monkeypatch):
    def broken(setup, fidelity):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(stability_map, "build_tier", broken)
    cell = run_cell("rod", 1e-3, 2e3, GRIPPER, CONFIG)
    assert (cell.outcome, cell.message) == ("fault", "ZeroDivisionError: division by zero")


def test_messages_are_listed_once_below_the_map():
    cells = [
        Cell("rod", 1e-3, None, "at_rest", None, ""),
        Cell("rod", 1e-3, 1e8, "stopped", None, "tier 'rod' at a sub-step of 0.001 s: too stiff"),
        Cell("rod", 1e-2, None, "moving", None, ""),
        Cell("rod", 1e-2, 1e8, "stopped", None, "tier 'rod' at a sub-step of 0.01 s: too stiff"),
    ]
    lines = map_text(cells).splitlines()
    assert lines[2].split() == ["1", "ms", "at", "rest", "stop", "1"]
    assert lines[3].split() == ["10", "ms", "moving", "stop", "1"]
    assert lines[-1] == "1: too stiff"
