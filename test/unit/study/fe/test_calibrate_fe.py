import json
import math
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.configuration import config_path  # noqa: E402
from mbpam_ros.study.fe import calibrate_fe  # noqa: E402
from mbpam_ros.study.fe.calibrate_fe import (  # noqa: E402
    CalibrationError,
    PaperPoint,
    Run,
    bend_curve,
    compare_with_paper,
    error_summary,
    law_at_pressure,
    main,
    nominal_values,
    paper_points,
    settings,
)
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution  # noqa: E402

SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
STIFF = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc", SMALL)
"""A muscle that bends little: its runs are short."""


def test_the_paper_has_thirty_two_finite_element_designs_and_one_measured_single_chamber():
    points = paper_points()
    assert [point.pattern for point in points].count("pdc") == 32
    assert points[-1] == PaperPoint("measured:psc", 2.5, 2.0, 120.0, 0.466, "psc")
    assert PaperPoint("table_2:1", 2.5, 2.0, 148.423, 0.6036) in points
    assert PaperPoint("table_5:2", 2.54, 1.42, 156.01, 0.6350) in points


def test_a_bend_curve_starts_at_zero_and_rises():
    curve = bend_curve(STIFF, [0.0, 10.0, 20.0])
    assert curve["p_kpa"] == [0.0, 10.0, 20.0]
    assert curve["theta_deg"][0] == pytest.approx(0.0, abs=1e-6)
    assert curve["theta_deg"][0] < curve["theta_deg"][1] < curve["theta_deg"][2]


def test_the_law_knows_the_moment_that_holds_the_muscle_straight():
    table = law_at_pressure(STIFF, 20.0, (-20, 0, 20))
    assert table["bend_deg"] == pytest.approx([-20.0, 0.0, 20.0])
    assert table["moment_n_mm"] == sorted(table["moment_n_mm"])
    assert table["straight_moment_n_mm"] == pytest.approx(-table["moment_n_mm"][1])
    secant = (table["moment_n_mm"][2] - table["moment_n_mm"][0]) / math.radians(40.0) * 100.0
    assert table["line_stiffness_n_mm2"] == pytest.approx(secant, rel=1e-9)
    assert table["missing"] == []


def test_the_stored_law_is_what_the_shipped_mesh_gives():
    stored = json.loads(config_path("data/fe_bending_law.json").read_text(encoding="utf-8"))
    tables = {(row["pattern"], row["p_kpa"]): row for row in stored["tables"]}
    assert len(tables) == 26 and not any(row["missing"] for row in tables.values())
    run = Run(CellGeometry(), "psc")
    for key, value in settings(run).items():
        if key != "versions":
            assert stored["settings"][key] == value, key
    wanted = tables["psc", 20.0]
    at_zero = wanted["bend_deg"].index(0.0)
    table = law_at_pressure(run, 20.0, ())
    assert table["moment_n_mm"][0] == pytest.approx(wanted["moment_n_mm"][at_zero], rel=1e-6)
    assert table["gas_volume_mm3"][0] == pytest.approx(wanted["gas_volume_mm3"][at_zero], rel=1e-6)


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


class TestComparison:
    POINTS = (PaperPoint("table_1:1", 1.5, 2.0, 20.0, 0.5, "psc"), PaperPoint("table_2:1", 1.6, 2.0, 21.0, 0.5, "psc"))

    @pytest.fixture
    def counted(self, monkeypatch):
        designs = []

        def quick(run):
            designs.append((run.geometry.a_mm, run.pattern))
            return {"theta_deg": 10.0 * run.geometry.a_mm, "force_n": 0.25}

        monkeypatch.setattr(calibrate_fe, "nominal_values", quick)
        return designs

    def compare(self, path, points=POINTS, template=STIFF):
        said = []
        with ThreadPoolExecutor(1) as executor:
            return compare_with_paper(template, path, executor, said.append, points), said

    def test_each_design_is_run_and_compared(self, tmp_path, counted):
        result, said = self.compare(tmp_path / "out.json")
        assert counted == [(1.5, "psc"), (1.6, "psc")]
        assert [row["theta_error_pct"] for row in result["points"]] == pytest.approx([-25.0, 100 * (16 / 21 - 1)])
        assert [row["force_error_pct"] for row in result["points"]] == pytest.approx([-50.0, -50.0])
        assert json.loads((tmp_path / "out.json").read_text()) == result
        assert len(said) == 2

    def test_after_an_interrupt_only_the_missing_designs_are_run(self, tmp_path, counted):
        self.compare(tmp_path / "out.json", self.POINTS[:1])
        result, _ = self.compare(tmp_path / "out.json")
        assert counted == [(1.5, "psc"), (1.6, "psc")]
        assert len(result["points"]) == 2

    def test_other_settings_are_run_anew(self, tmp_path, counted):
        self.compare(tmp_path / "out.json")
        self.compare(tmp_path / "out.json", template=Run(CellGeometry(c_mm=2.3), "psc", SMALL))
        assert len(counted) == 4

    def test_a_file_of_something_else_is_not_overwritten(self, tmp_path, counted):
        (tmp_path / "out.json").write_text('{"p_kpa": []}')
        with pytest.raises(CalibrationError, match="give another file"):
            self.compare(tmp_path / "out.json")
        assert not counted


def test_at_100_kpa_the_numbers_belong_together():
    values = nominal_values(STIFF)
    assert 0.0 < values["free_bend_deg"] < values["theta_deg"]
    near, far = 15.0, 115.0
    lever_per_mm = ((far**2 - near**2) / 2.0) / ((far**3 - near**3) / 3.0)
    assert values["force_n"] == pytest.approx(values["straight_moment_n_mm"] * lever_per_mm, rel=1e-9)


@pytest.mark.parametrize(
    "arguments",
    [[], ["--design", "2.5,2.0", "--json", "x"], ["--design", "9,2,2,14", "--json", "x"]],
    ids=["nothing to write", "two numbers", "no room for a chamber"],
)
def test_what_cannot_be_run_is_said_and_fails(arguments, capsys):
    assert main(arguments) == 1
    assert capsys.readouterr().err.startswith("calibrate_fe: ")
