import itertools
import math
import time

import numpy as np
import pytest

from mbpam_ros.actuator import calibration
from mbpam_ros.actuator.blocked_rod import blocked_path
from mbpam_ros.actuator.calibration import (
    PatternTarget,
    calibrate,
    calibrated_rod_law,
    calibration_targets,
    pattern_loads,
)
from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.actuator.metamodel import METAMODELS, load_metamodel
from mbpam_ros.actuator.planar_rod import RodSolutionError, rod_tip_angle
from mbpam_ros.actuator.yielding_ends import finite_element_uniform_law
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
GEOMETRY, ROD, INITIAL = GRIPPER.geometry, GRIPPER.rod_geometry, MuscleDesign(2.5, 2.0)
DESIGNS = [INITIAL, MuscleDesign(1.5, 1.0), MuscleDesign(3.5, 1.0), MuscleDesign(1.5, 3.0), MuscleDesign(3.5, 3.0)]
TARGETS = ("fe", "test")
PRESSURES_PA = np.arange(10e3, 101e3, 5e3)


def angle_and_force(law, pattern):
    """Tip angle of the free rod [rad] and force of the blocked one [N] at 100 kPa, both in the paper's posture."""
    loads = pattern_loads(law, pattern, PRESSURES_PA)
    free = rod_tip_angle(loads[-1].moment_n_m, loads[-1].stiffness_n_m2, ROD, stretch=loads[-1].stretch)
    return free, blocked_path(loads, ROD)[-1].push_n


@pytest.mark.slow
@pytest.mark.parametrize(("metamodel", "target"), list(zip(METAMODELS, itertools.cycle(TARGETS), strict=False)))
@pytest.mark.parametrize("design", DESIGNS, ids=str)
def test_the_calibrated_rod_returns_angle_and_force_of_the_design(design, metamodel, target):
    assert_returns_its_targets(design, metamodel, target)


def assert_returns_its_targets(design, metamodel, target):
    law = calibrated_rod_law(design, GEOMETRY, metamodel, target)
    for pattern, wanted in calibration_targets(design, metamodel, target).items():
        assert angle_and_force(law, pattern) == pytest.approx((wanted.theta_max_rad, wanted.f_max_n), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("a_mm", [2.0, 3.0])
@pytest.mark.parametrize("b_mm", [1.0, 1.5, 2.5, 3.0])
def test_designs_inside_the_domain_are_calibrated_too(a_mm, b_mm):
    assert_returns_its_targets(MuscleDesign(a_mm, b_mm), "prs", "fe")


@pytest.mark.parametrize(
    ("target", "pattern", "angle_deg", "force_n"),
    [
        ("fe", "pdc", 148.4, 0.6036),
        ("fe", "psc", 118.0, 0.4374),
        ("test", "pdc", 151.0, 0.643),
        ("test", "psc", 120.0, 0.466),
    ],
)
def test_the_initial_design_bends_and_pushes_as_in_the_paper_within_the_metamodels_error(
    target, pattern, angle_deg, force_n
):
    angle, force = angle_and_force(calibrated_rod_law(INITIAL, GEOMETRY, "prs", target), pattern)
    performance = load_metamodel("prs").predict(INITIAL)
    tolerance_deg = math.degrees(performance.theta_max_sigma_rad)
    assert math.degrees(angle) == pytest.approx(angle_deg, abs=tolerance_deg)
    assert force == pytest.approx(force_n, abs=2.0 * performance.f_max_sigma_n)


@pytest.mark.parametrize(("pattern", "of_moment", "of_stiffness"), [("pdc", 1.08, 1.15), ("psc", 1.31, 1.38)])
def test_what_calibration_does_to_the_finite_element_law_at_its_own_design(pattern, of_moment, of_stiffness):
    """Ends that yield take a sixth of the force; the paper's are not known. PSC's target is measured, and 20 % more."""
    calibrated, uncalibrated = calibrated_rod_law(INITIAL, GEOMETRY), finite_element_uniform_law(GEOMETRY)
    pairs = zip(calibrated.at_nominal_pressure(pattern), uncalibrated.at_nominal_pressure(pattern), strict=True)
    moment_factor, stiffness_factor = (after / before for after, before in pairs)
    assert moment_factor == pytest.approx(of_moment, abs=0.01)
    assert stiffness_factor == pytest.approx(of_stiffness, abs=0.01)


@pytest.mark.parametrize("pattern", ["pdc", "psc"])
def test_the_tip_force_is_that_of_the_blocked_rod_at_every_pressure(pattern):
    found = calibrate(INITIAL, GEOMETRY)
    direction = {"pdc": [1.0, 0.0], "psc": [math.sqrt(0.5), -math.sqrt(0.5)]}[pattern]
    loads = pattern_loads(found.law, pattern, PRESSURES_PA)
    force = found.tip_force.at(np.outer([load.moment_n_m for load in loads], direction))
    np.testing.assert_allclose(force, [contact.push_n for contact in blocked_path(loads, ROD)], rtol=2e-3)


@pytest.mark.parametrize("target", [PatternTarget(9.0, 0.6), PatternTarget(2.5, 1e-4)], ids=["too far", "too weak"])
def test_targets_that_no_rod_meets_are_a_typed_error_that_says_which(target):
    with pytest.raises(RodSolutionError, match=r"pdc: no factors on M0 and B give .* deg and the blocked one .* N"):
        calibration._factors("pdc", target, GEOMETRY)


def test_calibration_is_quick_enough_for_the_start_of_a_node():
    calibrate(INITIAL, GEOMETRY)  # reads the stored law and fits the metamodel
    calibrate.cache_clear()
    began_s = time.process_time()
    calibrate(INITIAL, GEOMETRY)
    assert time.process_time() - began_s < 0.6  # 0.2 s on an idle core


@pytest.mark.parametrize("metamodel", ["prs", "rbf", "krg"])
def test_a_test_target_returns_what_the_paper_measured_on_its_initial_design(metamodel):
    targets = calibration_targets(INITIAL, metamodel, "test")
    assert targets["pdc"].theta_max_rad == pytest.approx(math.radians(151.0))
    assert targets["pdc"].f_max_n == pytest.approx(0.643)
    assert targets["psc"].theta_max_rad == pytest.approx(math.radians(120.0))
    assert targets["psc"].f_max_n == pytest.approx(0.466)


@pytest.mark.parametrize("design", DESIGNS, ids=str)
def test_both_stiffnesses_rise_with_pressure_in_the_whole_domain(design):
    law = calibrated_rod_law(design, GEOMETRY)
    for stiffness in (law.psc_stiffness_n_m2, law.pdc_stiffness_n_m2):
        assert stiffness[0] > 0.0
        assert (stiffness[1:] >= stiffness[:-1]).all()


def test_equal_arguments_give_the_same_law():
    assert calibrated_rod_law(MuscleDesign(2.5, 2.0), GEOMETRY) is calibrated_rod_law(INITIAL, GEOMETRY)


def test_an_unknown_target_or_metamodel_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="'measured'.*fe, test"):
        calibrated_rod_law(INITIAL, GEOMETRY, "prs", "measured")
    with pytest.raises(ValueError, match="'svm'.*prs, rbf, krg"):
        calibrated_rod_law(INITIAL, GEOMETRY, "svm")
