import io
import math
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe import ablations
from mbpam_ros.study.fe.design_run import Run
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.paper_comparison import paper_points
from mbpam_ros.terminal import Progress


def test_the_fit_is_judged_without_the_points_kept_for_the_last_check():
    assert all(name.startswith(("table_1:", "table_2:")) for name in ablations.SPREAD_POINTS)
    assert set(ablations.SPREAD_POINTS) <= {point.source for point in paper_points()}


def test_each_end_weighs_more_than_the_one_before():
    weightless, hollow, solid = ablations.end_weight_factors(CellGeometry())
    assert weightless == 0.0
    assert 1.0 < hollow < solid  # a crest's section holds more silicone than the waves' mean
    tube = CellGeometry(a_mm=0.0)
    assert ablations.end_weight_factors(tube)[1] == pytest.approx(1.0, rel=1e-9)


def test_errors_of_a_variant_are_those_of_its_rows():
    rows = [
        {"theta_deg": 100.0, "force_n": 0.5, "fe_theta_deg": {"solid": 103.0}, "fe_force_n": 0.5},
        {"theta_deg": 200.0, "force_n": 0.5, "fe_theta_deg": {"solid": 192.0}, "fe_force_n": 0.45},
    ]
    rows[0] |= {"fold_opening": 0.8, "arm_gap_mm": -0.1}
    rows[1] |= {"fold_opening": 0.7, "arm_gap_mm": 0.5}
    errors = ablations.variant_errors("x", rows, "solid")
    assert errors["theta_rms_pct"] == pytest.approx(math.sqrt(12.5))
    assert errors["theta_mean_pct"] == pytest.approx(-0.5)
    assert errors["theta_worst_pct"] == pytest.approx(-4.0)
    assert errors["force_worst_pct"] == pytest.approx(-10.0)
    assert (errors["least_fold_opening"], errors["least_arm_gap_mm"]) == (0.7, -0.1)


def test_every_variant_is_run_once_a_point_and_given_for_each_end(tmp_path, monkeypatch):
    runs = []

    def quick(run, factors):
        runs.append(run)
        clearance = {"fold_opening": 0.9, "arm_gap_mm": 0.6}
        thetas = [100.0 + 9.0 * factor for factor in factors]
        return {"free_bend_deg": 1.0, "force_n": 0.5, "theta_deg_by_end_weight": thetas, **clearance}

    monkeypatch.setattr(ablations, "nominal_values", quick)
    template, points = Run(CellGeometry(), "pdc"), paper_points()[:2]
    for _ in range(2):  # the second time everything is there
        with ThreadPoolExecutor(1) as executor:
            result = ablations.ablations(template, tmp_path / "x.json", executor, Progress(io.StringIO()), points)
    kinds = ablations.variants(template)
    assert len(runs) == len(set(runs)) == 2 * len(kinds)
    assert len(result["variants"]) == len(ablations.ENDS) * len(kinds)
    assert {run.silicone.bulk_mpa for run in runs} == {50.0, 500.0}
    assert {run.self_contact for run in runs} == {False, True}
    assert {run.geometry.corner_fillet_mm for run in runs} == {0.0, 0.5}
    assert {run.geometry.wave_fillet_mm for run in runs} == {None, 0.5, 1.5}
    bends = [row["fe_theta_deg"] for row in result["runs"]]
    assert all(bend["weightless"] < bend["hollow"] < bend["solid"] for bend in bends)
