import math

import pytest

from mbpam_ros.actuator.calibration import calibrated_rod_law, calibration_factors, calibration_targets
from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.actuator.metamodel import METAMODELS, load_metamodel
from mbpam_ros.actuator.planar_rod import blocked_tip_force_per_moment, rod_tip_angle
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
GEOMETRY, INITIAL = GRIPPER.geometry, MuscleDesign(2.5, 2.0)
DESIGNS = [INITIAL, MuscleDesign(1.5, 1.0), MuscleDesign(3.5, 1.0), MuscleDesign(1.5, 3.0), MuscleDesign(3.5, 3.0)]


@pytest.mark.parametrize("target", ["fe", "test"])
@pytest.mark.parametrize("metamodel", METAMODELS)
@pytest.mark.parametrize("design", DESIGNS, ids=str)
def test_the_calibrated_rod_returns_angle_and_force_of_the_design(design, metamodel, target):
    law = calibrated_rod_law(design, GEOMETRY, metamodel, target)
    for pattern, wanted in calibration_targets(design, metamodel, target).items():
        moment, stiffness = law.at_nominal_pressure(pattern)
        assert rod_tip_angle(moment, stiffness, GEOMETRY) == pytest.approx(wanted.theta_max_rad, rel=1e-3)
        assert moment * blocked_tip_force_per_moment(GEOMETRY) == pytest.approx(wanted.f_max_n, rel=1e-3)


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
    moment, stiffness = calibrated_rod_law(INITIAL, GEOMETRY, "prs", target).at_nominal_pressure(pattern)
    performance = load_metamodel("prs").predict(INITIAL)
    tolerance_deg = math.degrees(performance.theta_max_sigma_rad)
    assert math.degrees(rod_tip_angle(moment, stiffness, GEOMETRY)) == pytest.approx(angle_deg, abs=tolerance_deg)
    force = moment * blocked_tip_force_per_moment(GEOMETRY)
    assert force == pytest.approx(force_n, abs=2.0 * performance.f_max_sigma_n)


@pytest.mark.parametrize("pattern", ["pdc", "psc"])
def test_the_finite_element_law_is_nearly_calibrated_at_its_own_design(pattern):
    factors = calibration_factors(pattern, calibration_targets(INITIAL)[pattern], GEOMETRY)
    assert factors.moment == pytest.approx(1.0, abs=0.10)
    assert factors.stiffness == pytest.approx(1.0, abs=0.20)


@pytest.mark.parametrize("metamodel", ["prs", "rbf", "krg"])
def test_a_test_target_returns_what_the_paper_measured_on_its_initial_design(metamodel):
    targets = calibration_targets(INITIAL, metamodel, "test")
    assert targets["pdc"].theta_max_rad == pytest.approx(math.radians(151.0))
    assert targets["pdc"].f_max_n == pytest.approx(0.643)
    assert targets["psc"].theta_max_rad == pytest.approx(math.radians(120.0))
    assert targets["psc"].f_max_n == pytest.approx(0.466)


def test_both_stiffnesses_rise_with_pressure_in_the_whole_domain():
    for a in (1.5, 2.0, 2.5, 3.0, 3.5):
        for b in (1.0, 1.5, 2.0, 2.5, 3.0):
            law = calibrated_rod_law(MuscleDesign(a, b), GEOMETRY)
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
