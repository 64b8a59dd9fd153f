import json

import numpy as np
import pytest

from mbpam_ros.actuator.tables import read_columns
from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.design import latin_hypercube


def test_designs_are_printed_and_written_beside_the_papers_figures(tmp_path, capsys):
    table, figures = tmp_path / "designs.csv", tmp_path / "designs.json"
    assert main(["sample", "--restarts", "1", "--csv", str(table), "--json", str(figures)]) == 0
    said, (no, a_mm, b_mm) = capsys.readouterr().out, read_columns(table, "no", "a_mm", "b_mm")
    assert no.tolist() == list(range(1, 22))
    assert (a_mm.min(), a_mm.max(), b_mm.min(), b_mm.max()) == (1.5, 3.5, 1.0, 3.0)
    result = json.loads(figures.read_text())
    assert result["points"] == np.column_stack([a_mm, b_mm]).tolist()
    # Table 1's closest two points: steps of 3 of 20 levels in both variables.
    paper = result["space_filling"]["paper_over_a_b"]
    assert paper["smallest_distance"] == pytest.approx(np.hypot(3, 3) / 20.0)
    assert f"{paper['discrepancy']:.6f}" in said


def test_four_variables_have_whole_waves_within_the_papers_ranges(tmp_path):
    path = tmp_path / "designs.json"
    assert (
        main(
            ["sample", "--variables", "a,b,c,n", "--count", "12", "--restarts", "1", "--seed", "3", "--json", str(path)]
        )
        == 0
    )
    result = json.loads(path.read_text())
    points = np.array(result["points"])
    assert points.shape == (12, 4)
    assert np.all(points >= [1.5, 1.0, 1.0, 6.0]) and np.all(points <= [3.5, 3.0, 3.0, 14.0])
    np.testing.assert_array_equal(points[:, 3], np.round(points[:, 3]))
    assert result["space_filling"]["design_over_a_b"] != result["space_filling"]["design"]


def test_the_restarts_are_the_same_in_any_number_of_processes_and_go_on_from_a_file(tmp_path, monkeypatch, capsys):
    path, kept_in = tmp_path / "designs.json", tmp_path / "designs_runs.json"
    command = ["sample", "--count", "8", "--restarts", "3", "--json", str(path)]
    assert main([*command, "--workers", "2"]) == 0
    whole, said, kept = path.read_text(), capsys.readouterr().out, json.loads(kept_in.read_text())
    assert [row["restart"] for row in kept["restarts"]] == [0, 1, 2]
    kept_in.unlink()
    assert main([*command, "--workers", "1"]) == 0
    assert (path.read_text(), capsys.readouterr().out) == (whole, said)
    monkeypatch.setattr(latin_hypercube, "_restarted", lambda *_: pytest.fail("sampled anew"))
    assert main([*command, "--workers", "1"]) == 0
    assert path.read_text() == whole


def test_what_cannot_be_sampled_is_said_in_one_line(tmp_path, capsys):
    assert main(["sample", "--count", "1"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mbpam sample: ") and "at least 2 points" in said and said.count("\n") == 1
    with pytest.raises(SystemExit, match="2"):
        main(["sample", "--seed", "-1"])
