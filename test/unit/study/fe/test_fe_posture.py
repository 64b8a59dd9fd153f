import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

pytest.importorskip("felupe")

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.planar_rod import rod_tip_angle
from mbpam_ros.study.fe.law import BendingLaw
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.posture import SILICONE_DENSITY_KG_M3, upright_tip_angle_rad, weight_n_mm
from mbpam_ros.study.fe.unit_cell import UnitCell

GEOMETRY = CellGeometry()
SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)


class StraightLaw:
    """M = B kappa - M0 where a sampled law is asked for; it counts how far it was asked to reach."""

    def __init__(self, moment_n_mm, stiffness_n_mm2, stretch=1.0):
        self._moment, self._per_rad, self._stretch = moment_n_mm, stiffness_n_mm2 / 100.0, stretch
        self.moment_n_mm = np.array([])

    def cover(self, lowest_n_mm, highest_n_mm, step_rad):
        ends = [*self.moment_n_mm, lowest_n_mm, highest_n_mm]
        self.moment_n_mm = np.linspace(min(ends), max(ends), 5)

    def bend_and_stretch_of_moment(self):
        bend = (self.moment_n_mm + self._moment) / self._per_rad
        return PchipInterpolator(self.moment_n_mm, np.stack([bend, np.full(5, self._stretch)], axis=1))


def rod_geometry():
    return MuscleGeometry(0.010, 0.015, 0.100, weight_n_mm(GEOMETRY) * 1e3 / 9.81)


@pytest.mark.parametrize("moment", [5.0, 20.0, 43.5])
def test_with_a_straight_law_it_is_the_planar_rod(moment):
    expected = rod_tip_angle(1e-3 * moment, 1919e-6, rod_geometry())
    angle = upright_tip_angle_rad(StraightLaw(moment, 1919.0), GEOMETRY, end_weight_factor=1.0)
    assert angle == pytest.approx(expected, abs=1e-6)


def test_the_law_is_sampled_as_far_as_the_weight_bends():
    law = StraightLaw(43.5, 1919.0)
    upright_tip_angle_rad(law, GEOMETRY)
    # the weight's moment about the clamp cannot exceed weight times half the length
    assert 2.0 < law.moment_n_mm[-1] < 0.5 * weight_n_mm(GEOMETRY) * 115.0**2


def test_a_heavier_tip_bends_the_muscle_further():
    none, same, solid = (
        upright_tip_angle_rad(StraightLaw(20.0, 1919.0), GEOMETRY, end_weight_factor=factor) for factor in (0, 1, 2.1)
    )
    assert none < same < solid


def test_without_weight_the_tip_has_the_free_bend():
    angle = upright_tip_angle_rad(StraightLaw(20.0, 1919.0), GEOMETRY, gravity_factor=0.0)
    assert angle == pytest.approx(2000.0 / 1919.0, rel=1e-9)


def test_a_longer_axis_gives_the_weight_more_lever():
    short, long = (upright_tip_angle_rad(StraightLaw(20.0, 1919.0, stretch), GEOMETRY) for stretch in (1.0, 1.1))
    rigid = upright_tip_angle_rad(StraightLaw(20.0, 1919.0, 1.1), GEOMETRY, stretching=False)
    assert long > short == rigid


def test_the_weight_is_that_of_the_silicone_in_a_wave():
    cell = UnitCell(GEOMETRY, "pdc", Resolution(wave=16, sector=6))
    half_section_mm3 = cell._body._region.dV.sum()
    section_mm2 = 2.0 * half_section_mm3 / cell.mesh.length_mm
    assert weight_n_mm(GEOMETRY) == pytest.approx(SILICONE_DENSITY_KG_M3 * 1e-9 * section_mm2 * 9.81, rel=5e-3)


def test_the_finite_element_muscle_leans_further_under_its_weight():
    cell = UnitCell(GEOMETRY, "psc", SMALL)
    state = cell.free_bend(0.02)
    law = BendingLaw(cell, [state])
    upright = upright_tip_angle_rad(law, GEOMETRY)
    assert state.angle_rad * cell.angle_per_muscle < upright < math.pi
    assert law.moment_n_mm[0] < 0.0 < law.moment_n_mm[-1]


def test_a_heavier_silicone_weighs_as_more_gravity_does():
    law = StraightLaw(20.0, 1919.0)
    heavier = upright_tip_angle_rad(law, GEOMETRY, density_kg_m3=1.5 * SILICONE_DENSITY_KG_M3)
    assert heavier == pytest.approx(upright_tip_angle_rad(law, GEOMETRY, gravity_factor=1.5), rel=1e-12)
    assert heavier > upright_tip_angle_rad(law, GEOMETRY)
