import io
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe import effects
from mbpam_ros.study.fe.design_run import Run
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.terminal import Progress


@pytest.mark.parametrize(
    "values, words",
    [
        ((1, 2, 3), "rises"),
        ((3, 2, 1), "falls"),
        ((1, 3, 2), "rises, then falls"),
        ((3, 1, 2), "falls, then rises"),
    ],
)
def test_a_trend_in_words(values, words):
    assert effects.trend(values) == words


def test_one_parameter_at_a_time_beside_the_paper(tmp_path, monkeypatch):
    run_designs = []

    def quick(run):
        geometry = run.geometry
        run_designs.append(geometry)
        if geometry.c_mm == 1.0:
            raise LoadStepError("the wall bursts", 60.0)
        theta = 50.0 * geometry.a_mm + geometry.wave_count - 5.0 * geometry.c_mm - 9.0 * (geometry.b_mm - 1.8) ** 2
        return {"theta_deg": theta, "force_n": 1.0 - 0.1 * geometry.a_mm + 0.1 * geometry.b_mm}

    monkeypatch.setattr(effects, "nominal_values", quick)
    monkeypatch.setattr(effects, "blocked_force_n", lambda run: 1.0 + 0.1 * run.geometry.b_mm)
    with ThreadPoolExecutor(1) as executor:
        result = effects.effects(Run(CellGeometry(), "psc"), tmp_path / "x.json", executor, Progress(io.StringIO()))
    assert len(run_designs) == len(set(run_designs)) == 10  # the initial design is in three of the four series
    trends = {(row["parameter"], row["quantity"]): row for row in result["trends"]}
    assert trends["a", "theta"]["found"] == "rises" and trends["a", "theta"]["agrees"]
    assert trends["b", "theta"]["found"] == "rises, then falls" and trends["b", "theta"]["agrees"]
    assert trends["b", "force"]["found"] == "rises" and not trends["b", "force"]["agrees"]
    assert trends["c", "theta"]["found"] is None and not trends["c", "theta"]["agrees"]
    assert result["failures"] == {"a 2.5 b 2 c 1 n 14": "the wall bursts"}
    known = {(row["parameter"], row["level"]): row["paper_theta_deg"] for row in result["designs"]}
    assert known["a", 1.5] == 107.6123 and known["b", 1.0] == 141.78 and known["n", 14.0] == 148.423
    assert known["c", 2.0] is None and known["n", 6.0] is None


def test_the_papers_tables_bear_out_the_trends_its_text_gives():
    table = {(point.a_mm, point.b_mm): point for point in effects.paper_points() if point.source.startswith("table_2")}
    for parameter, designs in {
        "a": [(1.5, 2.0), (2.5, 2.0), (3.5, 2.0)],
        "b": [(2.5, 1.0), (2.5, 2.0), (2.5, 3.0)],
    }.items():
        assert effects.trend([table[d].theta_deg for d in designs]) == effects.PAPER_TRENDS[parameter, "theta"]
        assert effects.trend([table[d].force_n for d in designs]) == effects.PAPER_TRENDS[parameter, "force"]
