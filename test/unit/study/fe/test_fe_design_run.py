import math

import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.design_run import MESHES, Run, bend_curve, nominal_values
from mbpam_ros.study.fe.mesh import CellGeometry

STIFF = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc", MESHES["coarse"])
"""A muscle that bends little: its runs are short."""


def test_a_bend_curve_starts_at_zero_and_rises():
    curve = bend_curve(STIFF, [0.0, 10.0, 20.0])
    assert curve["p_kpa"] == [0.0, 10.0, 20.0]
    assert curve["theta_deg"][0] == pytest.approx(0.0, abs=1e-6)
    assert curve["theta_deg"][0] < curve["theta_deg"][1] < curve["theta_deg"][2]


def test_at_100_kpa_the_numbers_belong_together():
    values = nominal_values(STIFF, (0.0, 2.0))
    assert 0.0 < values["free_bend_deg"] < values["theta_deg"]
    near, far = 15.0, 115.0
    lever_per_mm = ((far**2 - near**2) / 2.0) / ((far**3 - near**3) / 3.0)
    assert values["force_n"] == pytest.approx(values["straight_moment_n_mm"] * lever_per_mm, rel=1e-9)
    weightless, heavy = values["theta_deg_by_end_weight"]
    assert weightless == pytest.approx(values["theta_deg"], abs=1e-4)  # the default; one more sample may refine the law
    assert heavy > weightless + 0.1 and math.isfinite(heavy)


def test_the_domains_softest_corner_is_followed_to_120_kpa():
    cell = Run(CellGeometry(a_mm=1.5, b_mm=1.0), "psc", MESHES["coarse"]).cell()
    nominal = cell.free_bend(0.1)
    beyond = cell.free_bend(0.12, nominal)
    assert beyond.angle_rad > nominal.angle_rad > 0.0
    assert abs(beyond.moment_n_mm) < 1e-5
