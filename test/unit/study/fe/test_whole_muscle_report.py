import json
from dataclasses import asdict

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.fe import whole_muscle, whole_muscle_report
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_mesh import EndPieces
from mbpam_ros.study.fe.solve import StepControl
from mbpam_ros.study.fe.whole_muscle_report import Case, draw, mesh_study, run_case, unit_cells_deg

COARSE = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
STIFF = Case(CellGeometry(a_mm=1.5, c_mm=3.0, wave_count=1.0, active_length_mm=7.0), "psc", COARSE, EndPieces(4.0, 2.0))
"""A muscle that bends little: its runs are short."""

pytestmark = pytest.mark.xdist_group("whole_muscle_report")  # its muscles are solved once


@pytest.fixture(scope="module")
def rows():
    return mesh_study({"coarse": COARSE}, STIFF)


def test_a_mesh_study_has_the_free_and_the_blocked_muscle_with_cost_angle_and_force(rows):
    free, blocked = rows
    assert (free["name"], blocked["name"]) == ("coarse mesh", "coarse mesh, blocked")
    assert free["failure"] is None and blocked["failure"] is None
    assert free["unknowns"] == blocked["unknowns"] > 500
    assert free["theta_deg"] > blocked["theta_deg"] > 0.0
    assert free["force_n"] == 0.0 and blocked["force_n"] > 0.1
    assert 0.0 < free["cpu_s"] < 60.0
    assert free["curve"]["p_kpa"][0] == 0.0 and free["curve"]["p_kpa"][-1] == pytest.approx(100.0)
    assert free["curve"]["theta_deg"] == sorted(free["curve"]["theta_deg"])


def test_the_sections_are_those_of_a_crest_and_of_a_valley(rows):
    crest, valley = (np.array(quads) for quads in rows[0]["sections_mm"])
    assert crest.shape == valley.shape
    assert crest[..., 1].min() == 0.0
    assert crest[..., 1].max() - valley[..., 1].max() == pytest.approx(STIFF.geometry.a_mm, abs=0.5)


def test_a_muscle_that_stops_says_where_and_why(monkeypatch):
    monkeypatch.setattr(whole_muscle_report, "NOMINAL_MPA", 5.0)  # fifty times the pressure of the paper
    monkeypatch.setattr(
        whole_muscle, "_MUSCLE_STEPS", StepControl(residual_n=1e-5, first_step=0.005, smallest_step=0.004)
    )
    row = run_case("burst", STIFF)
    assert "stopped at" in row["failure"]
    assert 0.0 < row["p_kpa"] < 5000.0


def test_the_command_keeps_what_its_file_holds_and_draws_it(rows, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    weightless = Case(**{**vars(STIFF), "gravity_factor": 0.0})
    monkeypatch.setattr(whole_muscle_report, "STUDIES", {"ends": lambda: {"stiff": weightless}})
    path = tmp_path / "muscles.json"
    assert main(["fe", "whole", "--json", str(path), "--pictures", str(tmp_path / "pictures")]) == 0
    (row,) = json.loads(path.read_text(encoding="utf-8"))["muscles"]
    assert row["case"] == json.loads(json.dumps(asdict(weightless)))
    assert row["unit_cells_deg"] == pytest.approx(unit_cells_deg(weightless))
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 3
    monkeypatch.setattr(whole_muscle_report, "run_case", None)  # would fail
    assert main(["fe", "whole", "--json", str(path)]) == 0
    assert all(picture.stat().st_size > 10_000 for picture in draw(rows, tmp_path))


def test_a_file_of_something_else_is_not_overwritten(tmp_path, capsys):
    path = tmp_path / "other.json"
    path.write_text("[1, 2]", encoding="utf-8")
    assert main(["fe", "whole", "--json", str(path)]) == 1
    assert "give another file" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "[1, 2]"
