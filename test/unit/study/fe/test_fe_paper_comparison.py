import io
import json
import math
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe import paper_comparison
from mbpam_ros.study.fe.design_run import MESHES, Run
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.paper_comparison import (
    PaperPoint,
    compare_with_paper,
    error_summary,
    paper_points,
)
from mbpam_ros.study.jobs import ResultFileError
from mbpam_ros.terminal import Progress

TEMPLATE = Run(CellGeometry(c_mm=3.0), "psc", MESHES["coarse"])
POINTS = (PaperPoint("table_1:1", 1.5, 2.0, 20.0, 0.5, "psc"), PaperPoint("table_2:1", 1.6, 2.0, 21.0, 0.5, "psc"))


def test_the_paper_has_thirty_two_finite_element_designs_and_one_measured_single_chamber():
    points = paper_points()
    assert [point.pattern for point in points].count("pdc") == 32
    assert points[-1] == PaperPoint("measured:psc", 2.5, 2.0, 120.0, 0.466, "psc")
    assert PaperPoint("table_2:1", 2.5, 2.0, 148.423, 0.6036) in points
    assert PaperPoint("table_5:2", 2.54, 1.42, 156.01, 0.6350) in points


def test_errors_are_split_into_fit_and_check():
    rows = [
        {"source": "table_1:1", "theta_error_pct": 3.0, "force_error_pct": 1.0},
        {"source": "table_2:1", "theta_error_pct": -4.0, "force_error_pct": -1.0},
        {"source": "table_5:1", "theta_error_pct": 2.0, "force_error_pct": 0.0},
    ]
    errors = error_summary(rows)
    assert errors["tables_1_2"]["theta_rms_pct"] == pytest.approx(math.sqrt(12.5))
    assert errors["tables_1_2"]["theta_worst_pct"] == -4.0
    assert errors["table_5"]["points"] == 1


@pytest.fixture
def counted(monkeypatch):
    designs = []

    def quick(run):
        designs.append((run.geometry.a_mm, run.pattern))
        return {"theta_deg": 10.0 * run.geometry.a_mm, "force_n": 0.25}

    monkeypatch.setattr(paper_comparison, "nominal_values", quick)
    return designs


def compare(path, points=POINTS, template=TEMPLATE):
    said = io.StringIO()
    with ThreadPoolExecutor(1) as executor:
        return compare_with_paper(template, path, executor, Progress(said), points), said.getvalue()


def test_each_design_is_run_and_compared(tmp_path, counted):
    result, said = compare(tmp_path / "out.json")
    assert counted == [(1.5, "psc"), (1.6, "psc")]
    assert [row["theta_error_pct"] for row in result["points"]] == pytest.approx([-25.0, 100 * (16 / 21 - 1)])
    assert [row["force_error_pct"] for row in result["points"]] == pytest.approx([-50.0, -50.0])
    assert json.loads((tmp_path / "out.json").read_text()) == result
    assert [line.split()[0] for line in said.splitlines()[1:]] == ["[1/2]", "[2/2]"]  # after what it will cost


def test_after_an_interrupt_only_the_missing_designs_are_run(tmp_path, counted):
    compare(tmp_path / "out.json", POINTS[:1])
    result, _ = compare(tmp_path / "out.json")
    assert counted == [(1.5, "psc"), (1.6, "psc")]
    assert len(result["points"]) == 2


def test_other_settings_are_run_anew_and_it_is_said(tmp_path, counted):
    compare(tmp_path / "out.json")
    _, said = compare(tmp_path / "out.json", template=Run(CellGeometry(c_mm=2.3), "psc", MESHES["coarse"]))
    assert len(counted) == 4
    assert "other settings" in said


def test_a_file_of_something_else_is_not_overwritten(tmp_path, counted):
    (tmp_path / "out.json").write_text('{"p_kpa": []}')
    with pytest.raises(ResultFileError, match="give another file"):
        compare(tmp_path / "out.json")
    assert not counted
    assert (tmp_path / "out.json").read_text() == '{"p_kpa": []}'
