"""What the command says about grasps, with grasps that are decided by a rule instead of the plant."""

import json

import pytest

from mbpam_ros.commands import grasps
from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.grasp import grasp_study
from mbpam_ros.study.grasp.trial import Trial


@pytest.fixture
def thresholds(monkeypatch):
    """Objects are held from these pressures on, slippery ones from twice as much over ambient."""
    least_pa = {"initial": 63e3, "optimised": 47e3}
    names = {}

    def trial(scene, request, gripper, pressure_pa):
        slippery = scene.friction_coefficient == grasp_study.SLIPPERY
        held = pressure_pa >= least_pa[names[gripper.design.a_mm]] * (2.0 if slippery else 1.0)
        return Trial("envelope", held, 0.1 if held else 0.0, 0.1, 0.2, 0.5, 1.0 if held else 0.0)

    def load_design(name):
        design = load(name)
        names[design.a_mm] = name
        return design

    load = grasps.load_design
    monkeypatch.setattr(grasps, "load_design", load_design)
    monkeypatch.setattr(grasp_study, "run_trial", trial)
    return least_pa


def test_designs_stand_side_by_side_in_table_and_json(thresholds, capsys, tmp_path):
    path = tmp_path / "grasps.json"
    assert main(["grasps", "--objects", "bulb", "tomato", "--workers", "1", "--json", str(path)]) == 0
    result = json.loads(path.read_text(encoding="utf-8"))
    assert (result["settings"]["nominal_gauge_pa"], result["settings"]["slippery_friction"]) == (100e3, 0.05)
    rows = result["grasps"]
    assert [(row["scene"], row["design"]) for row in rows] == [
        ("bulb", "initial"),
        ("bulb", "optimised"),
        ("tomato", "initial"),
        ("tomato", "optimised"),
    ]
    for row in rows:
        least_pa = thresholds[row["design"]]
        assert row["least"]["fails_pa"] < least_pa <= row["least"]["holds_pa"] <= row["least"]["fails_pa"] + 1e3
    assert [row["held_by"] for row in rows[:2]] == ["friction", "caging"]
    assert rows[0]["slippery_least"]["holds_pa"] is None  # 126 kPa is above the limit
    assert rows[1]["slippery_least"]["holds_pa"] == pytest.approx(94e3, abs=1e3)
    said = capsys.readouterr().out
    assert "[4/4] tomato, optimised: least pressure 4" in said
    assert "bulb" in said and "held, envelope" in said and "none" in said


def test_what_is_not_held_is_said(monkeypatch, capsys):
    lost = Trial("slender_rod", False, 0.0, 0.1, None, 0.5, 0.0)
    monkeypatch.setattr(grasp_study, "run_trial", lambda *_: lost)
    assert main(["grasps", "--objects", "tube", "--design", "initial"]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("aluminium_tube"))
    assert row.split()[5:] == ["slender_rod", "not", "held", "-", "0", "-", "0.50", "none", "none"]


def test_a_pressure_that_fails_above_the_least_one_is_named(monkeypatch, capsys):
    def trial(scene, request, gripper, pressure_pa):
        held = pressure_pa in (60e3, 80e3, 100e3, 110e3)
        return Trial("envelope", held, 0.1 if held else 0.0, 0.1, 0.2, 0.5, 0.0)

    monkeypatch.setattr(grasp_study, "run_trial", trial)
    assert main(["grasps", "--objects", "bulb", "--design", "initial"]) == 0
    said = capsys.readouterr().out
    assert "60.0*" in said and "bulb, initial: held at less, but not at 70, 90 kPa" in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--design", "best"], "no design 'best'; known: initial, optimised"),
        (["--objects", "unicorn"], "no scene 'unicorn'; known: "),
        (["--objects", "empty", "--design", "initial"], "scene empty: nothing to grasp"),
        (["--objects", "bulb", "bulb"], "scene bulb: there are two of this name"),
        (["--objects", "bulb", "--workers", "0"], "at least 1 worker"),
        (["--objects", "bulb", "--tier", "arc", "--strains", "bend", "twist"], "neither twists nor stretches"),
    ],
)
def test_what_cannot_be_studied_is_said_in_one_line(arguments, message, capsys):
    assert main(["grasps", *arguments]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mbpam grasps: ") and message in said and said.count("\n") == 1


def test_a_tier_without_objects_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["grasps", "--tier", "static"])
    assert "invalid choice" in capsys.readouterr().err


def test_what_the_file_holds_is_not_searched_again(thresholds, monkeypatch, capsys, tmp_path):
    command = ["grasps", "--objects", "bulb", "--workers", "1", "--json", str(tmp_path / "grasps.json")]
    assert main([*command, "--design", "initial"]) == 0
    first = json.loads((tmp_path / "grasps.json").read_text(encoding="utf-8"))["grasps"]
    searched = []
    study = grasp_study.study_grasp
    monkeypatch.setattr(grasp_study, "study_grasp", lambda *job: (searched.append(job[3]), study(*job))[1])
    capsys.readouterr()
    assert main(command) == 0
    assert searched == ["optimised"]
    rows = json.loads((tmp_path / "grasps.json").read_text(encoding="utf-8"))["grasps"]
    assert rows[0] == first[0] and [row["design"] for row in rows] == ["initial", "optimised"]


def test_any_number_of_workers_gives_the_same_bits(monkeypatch, tmp_path):
    monkeypatch.setattr(grasp_study, "LEAST_PA", grasp_study.NOMINAL_PA)  # two grasps for each friction
    monkeypatch.setattr(grasp_study, "RESOLUTION_PA", grasp_study.STEP_PA)
    found = []
    for workers in ("1", "2"):
        path = tmp_path / f"{workers}.json"
        command = ["grasps", "--objects", "bulb", "--tier", "arc", "--workers", workers, "--json", str(path)]
        assert main(command) == 0
        found.append(path.read_bytes())
    assert found[0] == found[1]
