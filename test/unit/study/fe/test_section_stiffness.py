import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.section_stiffness import section_stiffness
from mbpam_ros.study.fe.solve import StepControl
from mbpam_ros.study.fe.unit_cell import UnitCell

SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
PRESSURE_MPA, ANGLE_RAD = 0.02, 0.05  # a bend of 80 deg of the muscle
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])


@BOTH_PATTERNS
def test_the_bend_row_without_axial_force_is_the_slope_of_the_held_states(pattern):
    exact = StepControl(residual_n=1e-10)
    cell = UnitCell(CellGeometry(), pattern, SMALL, control=exact)
    held = cell.held_bend(PRESSURE_MPA, ANGLE_RAD)
    found, step = section_stiffness(cell, held), 1e-4
    ahead, behind = (cell.held_bend(PRESSURE_MPA, ANGLE_RAD + sign * step, held) for sign in (1.0, -1.0))
    per_curvature = cell.mesh.length_mm / (2.0 * step)
    assert found.bend_n_mm2 == pytest.approx((ahead.moment_n_mm - behind.moment_n_mm) * per_curvature, rel=1e-6)
    stretched = (ahead.axis_stretch - behind.axis_stretch) * per_curvature
    assert found.stretch_per_curvature_mm == pytest.approx(stretched, rel=1e-6)


def test_turning_the_bent_sections_takes_the_moment_over_the_curvature_and_what_four_arms_add():
    """W = W0(kappa) + W4(kappa) cos 4 azimuth: the fourth harmonic leaves the sum over PDC and PSC planes."""
    side, over_curvature = 0.0, 0.0
    for pattern in ("pdc", "psc"):
        cell = UnitCell(CellGeometry(), pattern, SMALL)
        held = cell.held_bend(0.0, ANGLE_RAD)
        side += section_stiffness(cell, held).side_bend_n_mm2
        over_curvature += held.moment_n_mm * cell.mesh.length_mm / ANGLE_RAD
    assert side == pytest.approx(over_curvature, rel=1e-5)


def test_at_rest_both_half_sections_are_those_of_one_muscle():
    pdc, psc = (
        section_stiffness(cell, cell.rest())
        for cell in (UnitCell(CellGeometry(), name, SMALL) for name in ("pdc", "psc"))
    )
    assert vars(pdc) == pytest.approx(vars(psc), rel=1e-9, abs=1e-9)
    assert pdc.side_bend_n_mm2 == pytest.approx(pdc.bend_n_mm2, rel=1e-9)


@BOTH_PATTERNS
def test_a_small_bend_changes_little_though_a_moment_holds_it(pattern):
    """Second order terms of the held moment over the curvature must not be left."""
    cell = UnitCell(CellGeometry(), pattern, SMALL)
    straight = cell.held_bend(PRESSURE_MPA, 0.0)
    bent = cell.held_bend(PRESSURE_MPA, 1e-3, straight)
    assert straight.moment_n_mm < -1.0
    before, after = section_stiffness(cell, straight), section_stiffness(cell, bent)
    for name in ("bend_n_mm2", "side_bend_n_mm2", "torsion_n_mm2", "axial_n"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), rel=2e-3), name


@pytest.mark.parametrize("quadratic", [False, True])
def test_without_waves_axial_stiffness_and_torsion_are_those_of_a_prism(quadratic):
    """E A, and G J with Saint-Venant's J by a plane computation of its own."""
    silicone = Silicone()
    shear, bulk = 2.0 * silicone.c10_mpa, silicone.bulk_mpa
    young = 9.0 * bulk * shear / (3.0 * bulk + shear)
    fine = Resolution(wave=2, wall=2, arm=2, spoke=4, sector=4)
    mesh = UnitCell(CellGeometry(a_mm=0.0), "pdc", fine).mesh
    area, torsion = _saint_venant(mesh)
    resolution = Resolution(wave=2, wall=2, arm=2, spoke=4, sector=4, quadratic=quadratic)
    cell = UnitCell(CellGeometry(a_mm=0.0), "pdc", resolution)
    found = section_stiffness(cell, cell.rest())
    tolerance = 0.01 if quadratic else 1e-6  # of the same trilinear mesh; the curved one fills the circle
    assert found.axial_n == pytest.approx(young * area, rel=tolerance)
    assert found.torsion_n_mm2 == pytest.approx(shear * torsion, rel=tolerance)


def _saint_venant(mesh):
    """Area and J = least int (w_x - y)^2 + (w_y + x)^2 over warpings w, of both halves of the section at z = 0."""
    cells = mesh.cells[np.all(mesh.points_mm[mesh.cells[:, :4], 2] == 0.0, axis=1)][:, :4]
    place, nodes = mesh.points_mm[:, :2], np.unique(cells)
    number = np.full(len(place), -1)
    number[nodes] = np.arange(nodes.size)
    matrix, right, polar, area = np.zeros((nodes.size, nodes.size)), np.zeros(nodes.size), 0.0, 0.0
    corner_s, corner_t = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    point = 1.0 / np.sqrt(3.0)
    for cell in cells:
        for s, t in ((-point, -point), (point, -point), (point, point), (-point, point)):
            shape = 0.25 * (1 + s * corner_s) * (1 + t * corner_t)
            slopes = 0.25 * np.stack([corner_s * (1 + t * corner_t), corner_t * (1 + s * corner_s)])
            jacobian = slopes @ place[cell]
            slopes, weight = np.linalg.solve(jacobian, slopes), abs(np.linalg.det(jacobian))
            x, y = shape @ place[cell]
            here = number[cell]
            matrix[np.ix_(here, here)] += weight * slopes.T @ slopes
            right[here] += weight * (y * slopes[0] - x * slopes[1])
            polar += weight * (x * x + y * y)
            area += weight
    free = place[nodes, 1] > 0.0  # w is odd in y
    warping = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    return 2.0 * area, 2.0 * (polar - right[free] @ warping)


def test_only_half_a_wave_of_a_half_section_will_do():
    whole = UnitCell(CellGeometry(), "full", SMALL)
    with pytest.raises(ValueError, match="half a wave of a half section"):
        section_stiffness(whole, whole.rest())
    waves = UnitCell(CellGeometry(), "pdc", SMALL, half_waves=2)
    with pytest.raises(ValueError, match="not of 2 half waves"):
        section_stiffness(waves, waves.rest())
