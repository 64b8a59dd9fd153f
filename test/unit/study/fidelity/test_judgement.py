"""The verdict on made-up rows, and the command on one drawn scene."""

import json

import pytest

from mbpam_ros.commands.mbpam import main
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.study.fidelity import judgement
from mbpam_ros.study.fidelity.runs import run
from mbpam_ros.study.fidelity.trade import fidelities

ROW = {
    "kind": "sphere",
    "tolerance_pct": 2.0,
    "promised_pct": 1.5,
    "promised": True,
    "undecided_pct": 0.1,
    "found_pct": 0.5,
    "cost_ms_per_s": 30.0,
    "cheapest": "rod 2, 5 ms, lag",
    "cheapest_ms_per_s": 25.0,
}


def test_a_verdict_counts_kept_promises_care_and_costs():
    found = judgement.verdict([ROW, ROW | {"found_pct": 3.0, "cheapest_ms_per_s": 10.0}, ROW])
    assert found["kept_share"] == pytest.approx(2.0 / 3.0)
    assert found["care_median"] == pytest.approx(3.0)
    assert found["cost_median"] == pytest.approx(1.2)
    assert found["cost_share"] == pytest.approx(2.0 / 3.0)
    assert not judgement.reached(found)
    assert judgement.reached(judgement.verdict([ROW]))


def test_undecided_scenes_are_counted_and_not_judged():
    found = judgement.verdict([ROW, ROW | {"undecided_pct": 50.0, "found_pct": 90.0}])
    assert (found["scenes"], found["undecided"], found["kept_share"]) == (2, 1, 1.0)


def test_a_planner_that_promises_nothing_where_something_holds_is_called_timid():
    found = judgement.verdict([ROW, ROW | {"promised": False}, ROW | {"promised": False, "cheapest": None}])
    assert found["promised"] == 1
    assert found["too_timid_share"] == pytest.approx(1.0 / 3.0)


def test_one_drawn_scene_is_judged_and_not_run_again(tmp_path, monkeypatch, capsys):
    """Number 0 of this seed hangs in the air; few fidelities are tried."""
    few = fidelities(steps_s=(0.005,), modes=(2,), pneumatics=("lag", "iso6358"))
    monkeypatch.setattr(judgement, "fidelities", lambda: few)
    near = Fidelity("rod", 3, 0.0025, "iso6358")
    for reference in ("run_reference", "run_coarser_reference"):
        monkeypatch.setattr(judgement, reference, lambda case, strains, gripper: run(case, near, gripper))
    monkeypatch.setattr(judgement, "_MOST_RUNS", 2)
    command = ["judge_planner", "--scenes", "1", "--seed", "3", "--workers", "1", "--json", str(tmp_path / "j.json")]
    main(command)
    told = json.loads((tmp_path / "j.json").read_text())
    (row,) = told["judged"]
    assert row["kind"] == "air"
    assert row["undecided_pct"] == 0.0
    assert row["found_pct"] == row["tried"][row["chosen"]]
    assert told["verdict"]["scenes"] == 1
    assert "to reach" in capsys.readouterr().out
    monkeypatch.setattr(judgement, "judged_row", None)  # would fail
    main(command)
    assert json.loads((tmp_path / "j.json").read_text()) == told
