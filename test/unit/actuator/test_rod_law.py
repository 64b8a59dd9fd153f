import math

import numpy as np
import pytest

from mbpam_ros.actuator.bending_law import stored_cell_laws
from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.actuator.rod_law import (
    BendCurve,
    PatternFactors,
    RodLaw,
    StrainLaw,
    StrainLawError,
    finite_element_rod_law,
)
from mbpam_ros.actuator.yielding_ends import finite_element_uniform_law
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
LAW = calibrated_rod_law(GRIPPER.design, GRIPPER.geometry)


def table_law(psc_stiffness, pdc_stiffness, moment=(0.0, 1.0), **strains):
    grid = np.array([0.0, 1e5])
    moments = np.array(moment)
    return RodLaw(grid, moments, moments, np.array(psc_stiffness), np.array(pdc_stiffness), **strains)


def strains(stretch=(0.0, 0.1), slope=(0.0, -1e-3), axial=(30.0, 20.0), torsion=(1e-3, 2e-3)):
    return StrainLaw(*(np.array(values) for values in (stretch, slope, axial, torsion)))


@pytest.mark.parametrize("azimuth_deg", range(0, 360, 45))
def test_each_of_the_eight_directions_bends_toward_its_azimuth(azimuth_deg):
    chambers = pressurised_chambers(math.radians(azimuth_deg))
    moment, stiffness = LAW.moment_and_stiffness(1e5 * chambers)
    bend = hanging_bend(moment, stiffness, GRIPPER.geometry)
    direction = np.array([math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))])
    np.testing.assert_allclose(bend / np.hypot(*bend), direction, atol=1e-12)


@pytest.mark.parametrize(("pattern", "chambers"), [("psc", [1, 0, 0, 0]), ("pdc", [1, 1, 0, 0])])
@pytest.mark.parametrize("pressure_gauge_pa", [0.0, 2e4, 5.5e4, 1e5, 1.1e5])
def test_psc_and_pdc_come_back_exactly(pattern, chambers, pressure_gauge_pa):
    moment, stiffness = LAW.moment_and_stiffness(pressure_gauge_pa * np.array(chambers))
    index = round(pressure_gauge_pa / 100.0)
    tables = {
        "psc": (LAW.psc_moment_n_m, LAW.psc_stiffness_n_m2),
        "pdc": (LAW.pdc_moment_n_m, LAW.pdc_stiffness_n_m2),
    }
    assert np.hypot(*moment) == pytest.approx(tables[pattern][0][index], rel=1e-12)
    assert stiffness == pytest.approx(tables[pattern][1][index], rel=1e-12)


@pytest.mark.parametrize(("pattern", "chambers"), [("psc", [1, 0, 0, 0]), ("pdc", [1, 1, 0, 0])])
def test_the_uncalibrated_law_returns_free_bend_and_straight_moment_of_the_unit_cell(pattern, chambers):
    cell = stored_cell_laws()[pattern]
    law = finite_element_rod_law()
    moment, stiffness = law.moment_and_stiffness(cell.pressure_gauge_pa[:, None] * np.array(chambers))
    size = np.hypot(*moment.T)
    np.testing.assert_allclose(size / stiffness, cell.free_curvature_per_m, atol=1e-9)
    np.testing.assert_allclose(size, cell.straight_moment_n_m, atol=1e-9)


@pytest.mark.parametrize(("pattern", "chambers"), [("psc", [1, 0, 0, 0]), ("pdc", [0, 0, 1, 1])])
def test_the_uncalibrated_law_returns_stretch_and_stiffnesses_of_the_free_unit_cell(pattern, chambers):
    cell, law = stored_cell_laws()[pattern], finite_element_rod_law()
    pressure = cell.pressure_gauge_pa[1:, None] * np.array(chambers)
    found, (moment, stiffness) = law.strain_law(pressure), law.moment_and_stiffness(pressure)
    free = found.free_stretch + np.sum(found.stretch_per_curvature_m * moment, axis=1) / stiffness
    expected = (cell.straight_stretch + cell.stretch_slope_m * cell.free_curvature_per_m - 1.0)[1:]
    np.testing.assert_allclose(free, expected, atol=1e-9)
    np.testing.assert_allclose(found.axial_stiffness_n, cell.free_stiffness("axial_stiffness_n")[1:], rtol=1e-9)
    np.testing.assert_allclose(
        found.torsion_stiffness_n_m2, cell.free_stiffness("torsion_stiffness_n_m2")[1:], rtol=1e-9
    )


@pytest.mark.parametrize("pattern", ["psc", "pdc"])
def test_calibration_keeps_the_shape_of_pdcs_free_bend_and_nearly_that_of_pscs(pattern):
    """From 20 to 100 kPa relative to 100 kPa: what a user sees over pressure is the unit cell's nonlinearity."""
    pressure = np.arange(2e4, 1.01e5, 1e4)
    shapes = []
    for law in (LAW, finite_element_uniform_law(GRIPPER.geometry)):
        moment, stiffness = law.of_pattern(pattern, pressure)
        shapes.append(moment / stiffness / (moment[-1] / stiffness[-1]))
    np.testing.assert_allclose(*shapes, rtol=1e-9 if pattern == "pdc" else 0.2)


def test_the_bend_is_strongly_nonlinear_in_pressure():
    half, full = (np.hypot(*LAW.moment_and_stiffness([p, p, 0, 0])[0]) for p in (5e4, 1e5))
    assert half < 0.3 * full


@pytest.mark.parametrize("pattern", ["psc_moment_n_m", "pdc_moment_n_m"])
def test_the_moment_rises_with_pressure_beyond_the_samples(pattern):
    assert (np.diff(getattr(LAW, pattern)) > 0.0).all()


def test_above_120_kpa_the_free_curvature_keeps_its_end_slope():
    law = finite_element_rod_law()
    curvature = law.pdc_moment_n_m / law.pdc_stiffness_n_m2
    beyond = np.diff(curvature[1200:])
    np.testing.assert_allclose(beyond, beyond[0], rtol=1e-6)
    assert beyond[0] == pytest.approx(curvature[1200] - curvature[1199], rel=0.02)


def test_the_moment_is_continuous_where_a_chambers_pressure_passes_the_other_ones():
    for pressure in ([6e4, 6e4, 0, 0], [0, 7e4, 0, 0], [8e4, 0, 8e4, 0], [3e4, 5e4, 3e4, 5e4]):
        at = LAW.moment_and_stiffness(np.array(pressure, dtype=float))
        for nudge in 1e-3 * np.vstack([np.eye(4), -np.eye(4)]):
            near = LAW.moment_and_stiffness(pressure + nudge)
            np.testing.assert_allclose(near[0], at[0], atol=1e-8)
            np.testing.assert_allclose(near[1], at[1], atol=1e-10)


def test_scaling_multiplies_each_pattern_at_nominal_pressure_and_keeps_one_stiffness_without_pressure():
    law = finite_element_rod_law()
    scaled = law.scaled(psc=PatternFactors(1.2, 0.9), pdc=PatternFactors(0.9, 0.8))
    for pattern, moment_factor, stiffness_factor in (("psc", 1.2, 0.9), ("pdc", 0.9, 0.8)):
        moment, stiffness = law.at_nominal_pressure(pattern)
        expected = (moment_factor * moment, stiffness_factor * stiffness)
        assert scaled.at_nominal_pressure(pattern) == pytest.approx(expected, rel=1e-12)
    assert scaled.psc_stiffness_n_m2[0] == pytest.approx(0.8 * law.pdc_stiffness_n_m2[0])


def test_a_missing_reading_makes_only_its_finger_unknown():
    moment, stiffness = LAW.moment_and_stiffness([[1e5, math.nan, 0, 0], [1e5, 0, 0, 0]])
    assert np.isnan(moment[0]).all() and math.isnan(stiffness[0])
    assert np.isfinite(moment[1]).all() and math.isfinite(stiffness[1])


def test_pressures_of_other_than_four_chambers_are_refused():
    with pytest.raises(ValueError, match="four chambers"):
        LAW.moment_and_stiffness(np.zeros((4, 3)))
    with pytest.raises(ValueError, match="four chambers"):
        LAW.moment_and_stiffness(0.0)


def test_an_unknown_pattern_is_refused():
    with pytest.raises(ValueError, match="'tsc'.*psc, pdc"):
        LAW.at_nominal_pressure("tsc")


def test_a_law_with_two_stiffnesses_without_pressure_is_refused():
    with pytest.raises(ValueError, match="one stiffness"):
        table_law([1.0, 2.0], [1.1, 2.0])


def test_a_law_that_loses_its_stiffness_is_refused():
    table_law([1.0, 0.4], [1.0, 0.3])
    with pytest.raises(ValueError, match="positive"):
        table_law([1.0, 0.0], [1.0, 0.45])
    with pytest.raises(ValueError, match="positive"):
        table_law([1.0, 2.0], [1.0, -0.1])
    with pytest.raises(ValueError, match="positive"):
        table_law([1.0, 2.0], [1.0, 1.4], psc_side_stiffness_n_m2=np.array([1.0, 0.0]))
    with pytest.raises(ValueError, match="same in all directions"):
        table_law([1.0, 2.0], [1.0, 1.4], psc_side_stiffness_n_m2=np.array([1.1, 1.0]))


def test_what_chambers_add_to_the_logarithm_of_the_stiffness_is_summed():
    """In units of B0: PSC 2 along and 1.5 across, PDC 4.5, which is 1.5 more than the two chambers have."""
    law = table_law([1.0, 2.0], [1.0, 4.5], psc_side_stiffness_n_m2=np.array([1.0, 1.5]))
    for chambers, expected in (
        ([1, 0, 0, 0], 2.0),
        ([1, 0, 0, 1], 4.5),
        ([1, 0, 1, 0], 3.0),
        ([1, 1, 1, 1], 3.0**2 * 1.5**4),
    ):
        assert law.moment_and_stiffness(1e5 * np.array(chambers))[1] == pytest.approx(expected, rel=1e-12)


def test_a_law_with_a_moment_without_pressure_is_refused():
    with pytest.raises(ValueError, match="must be 0"):
        table_law([1.0, 2.0], [1.0, 2.0], moment=(0.1, 1.0))


def test_a_grid_that_does_not_rise_from_zero_is_refused():
    with pytest.raises(ValueError, match="rise from 0"):
        RodLaw(np.array([1.0, 2.0]), np.zeros(2), np.zeros(2), np.ones(2), np.ones(2))


PSC_STRAINS, PDC_STRAINS = strains(), strains((0.0, 0.25), (0.0, -2e-3), (30.0, 12.0), (1e-3, 3e-3))
STRETCHING = table_law([1.0, 2.0], [1.0, 2.5], psc_strains=PSC_STRAINS, pdc_strains=PDC_STRAINS)


@pytest.mark.parametrize(
    ("pattern", "chambers", "direction"),
    [(PSC_STRAINS, [0, 1, 0, 0], [math.sqrt(0.5), -math.sqrt(0.5)]), (PDC_STRAINS, [1, 0, 0, 1], [-1.0, 0.0])],
    ids=["psc", "pdc"],
)
def test_stretch_and_twist_of_psc_and_pdc_come_back_exactly(pattern, chambers, direction):
    for pressure, index in ((0.0, 0), (1e5, 1)):
        found = STRETCHING.strain_law(pressure * np.array(chambers))
        assert found.free_stretch == pytest.approx(pattern.free_stretch[index], rel=1e-12)
        slope = pattern.stretch_per_curvature_m[index] * np.array(direction)
        np.testing.assert_allclose(found.stretch_per_curvature_m, slope, atol=1e-15)
        assert found.axial_stiffness_n == pytest.approx(pattern.axial_stiffness_n[index], rel=1e-12)
        assert found.torsion_stiffness_n_m2 == pytest.approx(pattern.torsion_stiffness_n_m2[index], rel=1e-12)


def test_scaling_multiplies_axial_and_torsional_stiffness_as_the_bending_stiffness_and_leaves_the_free_stretch():
    scaled = STRETCHING.scaled(psc=PatternFactors(1.2, 0.9), pdc=PatternFactors(0.9, 0.8))
    for pattern in ("psc", "pdc"):
        before, after = (getattr(law, f"{pattern}_strains") for law in (STRETCHING, scaled))
        ratio = np.divide(*(getattr(law, f"{pattern}_stiffness_n_m2") for law in (scaled, STRETCHING)))
        assert ratio == pytest.approx([0.8, {"psc": 0.9, "pdc": 0.8}[pattern]])
        np.testing.assert_allclose(after.axial_stiffness_n, ratio * before.axial_stiffness_n)
        np.testing.assert_allclose(after.torsion_stiffness_n_m2, ratio * before.torsion_stiffness_n_m2)
        np.testing.assert_array_equal(after.free_stretch, before.free_stretch)
        np.testing.assert_array_equal(after.stretch_per_curvature_m, before.stretch_per_curvature_m)


def test_a_law_that_says_nothing_of_stretch_and_twist_says_so():
    with pytest.raises(StrainLawError, match="mbpam fe law"):
        table_law([1.0, 2.0], [1.0, 2.0]).strain_law(np.zeros(4))


def test_stretch_and_twist_of_a_missing_reading_are_unknown_and_of_other_than_four_chambers_refused():
    found = STRETCHING.strain_law([[1e5, math.nan, 0, 0], [1e5, 0, 0, 0]])
    assert all(np.isnan(values[0]).all() and np.isfinite(values[1]).all() for values in found)
    with pytest.raises(ValueError, match="four chambers"):
        STRETCHING.strain_law(np.zeros((4, 3)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stretch": (0.1, 0.1)}, "must be 0 without pressure"),
        ({"slope": (0.1, 0.1)}, "must be 0 without pressure"),
        ({"axial": (30.0, 0.0)}, "must be positive"),
        ({"torsion": (1e-3, -1e-3)}, "must be positive"),
        ({"axial": (31.0, 20.0)}, "must have one axial"),
        ({"torsion": (2e-3, 2e-3)}, "must have one axial"),
    ],
)
def test_a_law_of_stretch_and_twist_that_cannot_be_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        table_law([1.0, 2.0], [1.0, 2.0], psc_strains=strains(**change), pdc_strains=PDC_STRAINS)


@pytest.mark.parametrize(("pattern", "chambers"), [("psc", [0, 0, 1, 0]), ("pdc", [0, 1, 1, 0])])
def test_the_curve_of_psc_and_pdc_comes_back_exactly(pattern, chambers):
    cell, law = stored_cell_laws()[pattern], finite_element_rod_law()
    pressure = cell.pressure_gauge_pa[:, None] * np.array(chambers)
    found, (moment, stiffness) = law.bend_curve(pressure), law.moment_and_stiffness(pressure)
    toward = moment[1:] / np.hypot(*moment[1:].T)[:, None]
    np.testing.assert_allclose(found.stiffening_n_m3[1:], cell.stiffening_n_m3[1:, None] * toward, atol=1e-12)
    np.testing.assert_array_equal(found.stiffening_n_m3[0], 0.0)
    side = cell.free_stiffness("side_stiffness_n_m2")
    np.testing.assert_allclose(found.side_n_m2[1:] + stiffness[1:], side[1:], rtol=1e-9)
    assert found.side_n_m2[0] == 0.0


def test_scaling_keeps_the_shape_of_the_curve():
    """M over its own M0, over the bend's share of the free one."""
    law = finite_element_rod_law()
    scaled = law.scaled(psc=PatternFactors(1.2, 0.9), pdc=PatternFactors(0.9, 0.8))
    shapes = []
    for of in (law, scaled):
        moment, stiffness = of.at_nominal_pressure("pdc")
        share, free = np.linspace(-0.5, 1.5, 9), moment / stiffness
        stiffening = of.pdc_curve.stiffening_n_m3[1000]
        shapes.append((stiffness * share * free - moment + stiffening * free**2 * share * (share - 1.0)) / moment)
        side = law.pdc_curve.side_n_m2[1000] / law.at_nominal_pressure("pdc")[1]
        assert of.pdc_curve.side_n_m2[1000] / stiffness == pytest.approx(side)
    np.testing.assert_allclose(*shapes, rtol=1e-9)


def test_a_curve_that_departs_without_pressure_is_refused():
    curve = BendCurve(np.array([1e-6, 1e-6]), np.zeros(2))
    with pytest.raises(ValueError, match="departure from the line must be 0"):
        table_law([1.0, 2.0], [1.0, 2.0], psc_curve=curve, pdc_curve=curve)
