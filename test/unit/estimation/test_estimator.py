import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.actuator.calibration import calibrate, calibrated_rod_law, calibration_targets
from mbpam_ros.actuator.chambers import CHANNEL_COUNT, pressurised_chambers
from mbpam_ros.actuator.elastic_rod import RodLoads, rod_at_rest, rod_section
from mbpam_ros.actuator.equilibrium import hanging_bend, resting_bend
from mbpam_ros.actuator.metamodel import load_metamodel
from mbpam_ros.configuration import ConfigError, load_config, parse_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
CONFIG = load_config(EstimatorConfig, "estimator.yaml")
LAG = CONFIG.bend_time_constant_s
QUIET = np.zeros(CHANNEL_COUNT)
NOISY = np.full(CHANNEL_COUNT, 300.0**2)


@pytest.fixture
def estimator():
    return BendEstimator.for_gripper(GRIPPER, CONFIG)


def all_fingers(chambers, pressure_gauge_pa=1e5):
    return pressure_gauge_pa * np.tile(np.asarray(chambers, dtype=float), 4)


def rest(pressure_gauge_pa):
    law = calibrated_rod_law(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target)
    return hanging_bend(*law.moment_and_stiffness(np.reshape(pressure_gauge_pa, (4, 4))), GRIPPER.rod_geometry)


def fields(estimate):
    """What an estimate says of each finger."""
    return {
        field.name: getattr(estimate, field.name)
        for field in dataclasses.fields(estimate)
        if field.name != "gravity_m_s2"
    }


def test_the_first_reading_finds_the_fingers_at_rest(estimator):
    pressure = all_fingers([1, 1, 0, 0], 8e4)
    estimate = estimator.update(5.0, pressure)
    np.testing.assert_allclose(estimate.bend_rad, rest(pressure), atol=1e-12)
    np.testing.assert_array_equal(estimate.bend_rate_rad_s, 0.0)


@pytest.mark.parametrize("azimuth_deg", range(0, 360, 45))
def test_every_finger_bends_in_the_direction_of_its_chambers(estimator, azimuth_deg):
    azimuth = math.radians(azimuth_deg)
    estimate = estimator.update(0.0, all_fingers(pressurised_chambers(azimuth)))
    direction = np.array([math.cos(azimuth), math.sin(azimuth)])
    size = np.hypot(*estimate.bend_rad.T)
    np.testing.assert_allclose(estimate.bend_rad, size[:, None] * direction, atol=1e-12)
    assert (size > math.radians(90.0)).all()
    moved = (estimator.tips(estimate)[0] - GRIPPER.finger_base_m)[:, :2]
    assert (moved @ direction > 0.0).all()


def test_a_step_of_the_equilibrium_is_followed_with_the_time_constant(estimator):
    start, end = all_fingers([1, 0, 0, 0], 3e4), all_fingers([1, 0, 0, 0], 9e4)
    estimator.update(0.0, start)
    at_step = estimator.update(0.0, end)
    np.testing.assert_allclose(at_step.bend_rad, rest(start), atol=1e-12)
    np.testing.assert_allclose(at_step.bend_rate_rad_s, (rest(end) - rest(start)) / LAG, atol=1e-9)
    later = estimator.update(1.7 * LAG, end)
    np.testing.assert_allclose(later.bend_rad, rest(end) + math.exp(-1.7) * (rest(start) - rest(end)), atol=1e-9)


def test_a_steady_ramp_is_followed_one_time_constant_late():
    estimator = BendEstimator.for_gripper(GRIPPER, CONFIG)
    equilibria = []
    for index in range(200):
        pressure = all_fingers([1, 0, 0, 0], 5e4 + 1.0 * index)
        estimate = estimator.update(0.01 * index, pressure)
        equilibria.append(rest(pressure))
    rate = (equilibria[-1] - equilibria[-2]) / 0.01
    np.testing.assert_allclose(estimate.bend_rad, equilibria[-1] - LAG * rate, rtol=1e-5)
    np.testing.assert_allclose(estimate.bend_rate_rad_s, rate, rtol=1e-3)


LEVEL = (9.81, 0.0, 0.0)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (0.0, 0.0, -9.81), LEVEL, (3.0, -6.0, 7.0)])
def test_at_rest_the_tip_is_the_full_rods_standing_at_its_base(estimator, gravity):
    pressure = np.linspace(0.0, 9e4, CHANNEL_COUNT)
    position, orientation = estimator.tips(estimator.update(0.0, pressure, gravity))
    law = calibrated_rod_law(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target)
    for finger in range(4):
        section = rod_section(law, pressure.reshape(4, 4)[finger], CONFIG.strains)
        rod = rod_at_rest(section, GRIPPER.rod_geometry, RodLoads(gravity_m_s2=gravity))
        np.testing.assert_allclose(position[finger], GRIPPER.finger_base_m[finger] + rod.tip_position_m, atol=1e-7)
        assert abs(orientation[finger] @ rod.tip_orientation_xyzw) == pytest.approx(1.0, abs=1e-9)


def test_gravity_moves_the_equilibrium_and_a_bad_one_is_refused(estimator):
    pressure = all_fingers([1, 0, 0, 0], 6e4)
    level = estimator.update(0.0, pressure, LEVEL)
    law = calibrated_rod_law(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target)
    expected = resting_bend(*law.moment_and_stiffness(pressure.reshape(4, 4)), GRIPPER.rod_geometry, LEVEL)
    np.testing.assert_allclose(level.bend_rad, expected, atol=1e-12)
    assert (level.bend_rad[:, 0] - rest(pressure)[:, 0] > 0.05).all()
    for bad in ((0.0, 9.81), (0.0, 0.0, math.nan)):
        with pytest.raises(ValueError, match="gravity_m_s2"):
            estimator.update(0.01, pressure, bad)


def test_a_finger_on_its_way_has_the_tip_of_the_rod_that_its_bend_is_held_at(estimator):
    """Half way between two rests, and continuous up to the second one."""
    start, end = all_fingers([1, 0, 0, 0], 3e4), all_fingers([1, 0, 0, 0], 9e4)
    tips = [estimator.tips(estimator.update(0.0, start))[0]]
    for index in range(400):
        tips.append(estimator.tips(estimator.update(0.001 * index, end))[0])
    moved = np.linalg.norm(np.diff(tips, axis=0), axis=2)
    assert moved[1:].max() < 0.002
    np.testing.assert_allclose(tips[-1], BendEstimator.for_gripper(GRIPPER, CONFIG).tips(rest_of(end))[0], atol=1e-4)


def rest_of(pressure_gauge_pa):
    return BendEstimator.for_gripper(GRIPPER, CONFIG).update(0.0, pressure_gauge_pa)


def test_centrelines_run_from_the_clamps_to_the_tips(estimator):
    estimate = estimator.update(0.0, np.linspace(0.0, 9e4, CHANNEL_COUNT))
    lines = estimator.centrelines(estimate)
    assert lines.shape == (4, CONFIG.centreline_points, 3)
    np.testing.assert_allclose(lines[:, 0], GRIPPER.finger_base_m, atol=1e-15)
    np.testing.assert_allclose(lines[:, -1], estimator.tips(estimate)[0], atol=1e-15)


@pytest.mark.parametrize(("pattern", "chambers"), [("pdc", [1, 1, 0, 0]), ("psc", [1, 0, 0, 0])])
def test_the_available_force_at_100_kpa_is_the_calibrations_target(estimator, pattern, chambers):
    estimate = estimator.update(0.0, all_fingers(chambers))
    target = calibration_targets(GRIPPER.design, GRIPPER.metamodel, GRIPPER.target)[pattern]
    np.testing.assert_allclose(estimator.tip_force_n(estimate.moment_n_m), target.f_max_n, rtol=1e-9)


def test_without_pressure_noise_sigma_is_the_metamodels_relative_error(estimator):
    performance = load_metamodel(GRIPPER.metamodel).predict(GRIPPER.design)
    estimate = estimator.update(0.0, all_fingers([1, 1, 0, 0], 9e4))
    expected = np.hypot(*estimate.bend_rad.T) * performance.theta_max_sigma_rad / performance.theta_max_rad
    np.testing.assert_allclose(estimator.bend_sigma_rad(estimate, QUIET), expected, rtol=1e-12)


def test_sigma_of_pressure_noise_is_the_scatter_of_the_bend(estimator):
    rng = np.random.default_rng(7)
    pressure = np.array([8e4, 0, 0, 0, 9e4, 4e4, 0, 0, 5e4, 3e4, 1e4, 2e4, 0, 7e4, 3e4, 0])
    deviation = rng.uniform(50.0, 400.0, CHANNEL_COUNT)
    estimate = estimator.update(0.0, pressure)
    with_noise, without = (estimator.bend_sigma_rad(estimate, variance) for variance in (deviation**2, QUIET))
    samples = np.array([rest(pressure + deviation * rng.standard_normal(CHANNEL_COUNT)) for _ in range(3000)])
    scatter = np.sqrt(samples.var(axis=0).sum(axis=1))
    np.testing.assert_allclose(np.sqrt(with_noise**2 - without**2), scatter, rtol=0.05)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_finger_without_a_valid_reading_is_unknown_and_the_others_are_not(estimator, bad):
    pressure = all_fingers([1, 0, 0, 0], 6e4)
    whole = fields(estimator.update(0.0, pressure))
    pressure[4 + 2] = bad
    broken = fields(estimator.update(0.0, pressure))
    for name, value in broken.items():
        others = [0, 2, 3]
        assert np.isnan(value[1]).all(), name
        np.testing.assert_array_equal(value[others], whole[name][others], err_msg=name)


def test_a_finger_goes_on_from_its_last_valid_state(estimator):
    start, end = all_fingers([1, 0, 0, 0], 3e4), all_fingers([1, 0, 0, 0], 9e4)
    estimator.update(0.0, start)
    last_valid = estimator.update(0.0, end).bend_rad
    lost = end.copy()
    lost[0] = math.nan
    for index in range(1, 5):
        estimator.update(0.01 * index, lost)
    recovered = estimator.update(0.05, end).bend_rad
    expected = rest(end) + math.exp(-0.05 / LAG) * (last_valid - rest(end))
    np.testing.assert_allclose(recovered, expected, atol=1e-9)


def test_a_finger_unknown_from_the_start_begins_at_rest_when_it_is_read(estimator):
    pressure = all_fingers([1, 0, 0, 0], 6e4)
    unknown = pressure.copy()
    unknown[:4] = math.nan
    assert np.isnan(estimator.update(0.0, unknown).bend_rad[0]).all()
    np.testing.assert_allclose(estimator.update(0.01, pressure).bend_rad, rest(pressure), atol=1e-12)


def test_time_running_backwards_starts_anew(estimator):
    estimator.update(10.0, all_fingers([1, 0, 0, 0], 3e4))
    pressure = all_fingers([1, 0, 0, 0], 9e4)
    estimate = estimator.update(0.0, pressure)
    np.testing.assert_allclose(estimate.bend_rad, rest(pressure), atol=1e-12)


def test_an_unknown_variance_leaves_only_that_fingers_sigma_unknown(estimator):
    variance = NOISY.copy()
    variance[5] = math.nan
    estimate = estimator.update(0.0, all_fingers([1, 0, 0, 0], 6e4))
    assert np.isnan(estimator.bend_sigma_rad(estimate, variance)).tolist() == [False, True, False, False]


def test_a_variance_that_cannot_be_used_is_refused(estimator):
    estimate = estimator.update(0.0, all_fingers([1, 0, 0, 0], 6e4))
    with pytest.raises(ValueError, match="variance_pa2 must hold 16"):
        estimator.bend_sigma_rad(estimate, QUIET.reshape(4, 4))
    with pytest.raises(ValueError, match="not be negative"):
        estimator.bend_sigma_rad(estimate, QUIET - 1.0)


def test_an_input_that_cannot_be_used_is_refused_and_changes_nothing(estimator):
    start, end = all_fingers([1, 0, 0, 0], 3e4), all_fingers([1, 0, 0, 0], 9e4)
    estimator.update(1.0, start)
    with pytest.raises(ValueError, match="pressure_gauge_pa must hold 16"):
        estimator.update(1.1, end[:15])
    for time_s in (math.nan, math.inf):
        with pytest.raises(ValueError, match="time must be finite"):
            estimator.update(time_s, end)
    np.testing.assert_allclose(estimator.update(1.0, end).bend_rad, rest(start), atol=1e-12)


def test_the_callers_arrays_are_left_alone(estimator):
    pressure = all_fingers([1, 0, 0, 0], 6e4)
    pressure[0] = math.inf
    copy = pressure.copy()
    estimator.update(0.0, pressure)
    np.testing.assert_array_equal(pressure, copy)


def test_bases_of_other_than_four_fingers_are_refused():
    calibration = calibrate(GRIPPER.design, GRIPPER.geometry)
    with pytest.raises(ValueError, match="finger_base_m"):
        BendEstimator(calibration, GRIPPER.geometry, np.zeros((3, 3)), 0.05, CONFIG)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bend_time_constant_s": 0.0}, "greater than 0"),
        ({"bend_time_constant_s": -0.05}, "greater than 0"),
        ({"bend_time_constant_s": math.nan}, "finite"),
        ({"centreline_points": 1}, "at least 2"),
        ({"strains": ["stretch"]}, "bend always"),
        ({"strains": ["bend", "shear"]}, "'shear' is not one of bend, stretch, twist"),
        ({"lag_s": 0.05}, "unknown key lag_s"),
    ],
)
def test_a_configuration_that_cannot_be_used_is_refused(change, message):
    good = {"bend_time_constant_s": 0.05, "centreline_points": 14, "strains": ["bend"]}
    with pytest.raises(ConfigError, match=message):
        parse_config(EstimatorConfig, {**good, **change}, "estimator.yaml")
