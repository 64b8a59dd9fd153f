import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.actuator.calibration import calibrate
from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.actuator.elastic_rod import RodLoads, rod_at_rest, rod_section
from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.configuration import load_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
CONFIG = load_config(EstimatorConfig, "estimator.yaml")
NOISY = np.full(CHANNEL_COUNT, 300.0**2)
PRESSURE = st.floats(0.0, 1.1e5)
READINGS = st.lists(PRESSURE, min_size=CHANNEL_COUNT, max_size=CHANNEL_COUNT).map(np.array)


def new_estimator():
    return BendEstimator.for_gripper(GRIPPER, CONFIG)


def sigma_rad(estimate, variance_pa2=NOISY):
    return new_estimator().bend_sigma_rad(estimate, variance_pa2)


@settings(max_examples=30, deadline=None)
@given(READINGS, READINGS, st.integers(1, 40))
def test_a_settling_bend_does_not_depend_on_the_step(start, end, steps):
    bends = []
    for count in (1, steps):
        estimator = new_estimator()
        estimator.update(0.0, start)
        estimator.update(0.0, end)
        for index in range(1, count + 1):
            estimate = estimator.update(0.1 * index / count, end)
        bends.append(estimate.bend_rad)
    np.testing.assert_allclose(bends[1], bends[0], atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(READINGS, READINGS, st.floats(1e-6, 10.0))
def test_the_bend_stays_between_where_it_was_and_where_it_goes(start, end, dt_s):
    estimator = new_estimator()
    first = estimator.update(0.0, start).bend_rad
    last = new_estimator().update(0.0, end).bend_rad
    bend = estimator.update(dt_s, end).bend_rad
    assert (bend >= np.minimum(first, last) - 1e-9).all()
    assert (bend <= np.maximum(first, last) + 1e-9).all()


@settings(max_examples=30, deadline=None)
@given(READINGS)
def test_quarter_turned_pressures_turn_the_estimate_and_keep_its_scalars(pressure):
    estimate = new_estimator().update(0.0, pressure)
    turned = new_estimator().update(0.0, np.roll(pressure.reshape(4, 4), 1, axis=1).ravel())
    expected = np.column_stack([-estimate.bend_rad[:, 1], estimate.bend_rad[:, 0]])
    np.testing.assert_allclose(turned.bend_rad, expected, atol=1e-9)
    forces = (new_estimator().tip_force_n(of.moment_n_m) for of in (turned, estimate))
    np.testing.assert_allclose(*forces, atol=1e-12)
    np.testing.assert_allclose(sigma_rad(turned), sigma_rad(estimate), rtol=1e-6)


@settings(max_examples=30, deadline=None)
@given(READINGS)
def test_mirrored_pressures_mirror_the_estimate(pressure):
    estimate = new_estimator().update(0.0, pressure)
    mirrored = new_estimator().update(0.0, pressure.reshape(4, 4)[:, ::-1].ravel())
    np.testing.assert_allclose(mirrored.bend_rad, estimate.bend_rad * [1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(sigma_rad(mirrored), sigma_rad(estimate), rtol=1e-6)


@settings(max_examples=30, deadline=None)
@given(READINGS, st.floats(1.0, 10.0))
def test_more_pressure_noise_never_means_more_certainty(pressure, factor):
    estimate = new_estimator().update(0.0, pressure)
    sigma, more = (sigma_rad(estimate, scale * NOISY) for scale in (1.0, factor))
    assert (more >= sigma).all()


@settings(max_examples=30, deadline=None)
@given(READINGS)
def test_fingers_do_not_influence_each_other(pressure):
    estimate = new_estimator().update(0.0, pressure)
    moved = np.roll(pressure, 4)
    np.testing.assert_allclose(
        np.roll(estimate.bend_rad, 1, axis=0), new_estimator().update(0.0, moved).bend_rad, atol=1e-9
    )


CALIBRATION = calibrate(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target)
POSTURES = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3)
    .filter(lambda vector: np.linalg.norm(vector) > 0.1)
    .map(lambda vector: 9.81 * np.array(vector) / np.linalg.norm(vector))
)


def stretching_estimator():
    return BendEstimator(
        CALIBRATION,
        GRIPPER.rod_geometry,
        GRIPPER.finger_base_m,
        0.05,
        dataclasses.replace(CONFIG, strains=STRAINS),
    )


@settings(max_examples=40, deadline=None)
@given(READINGS, POSTURES)
def test_at_rest_the_tips_are_those_of_the_full_rod_at_any_pressure_and_tilt(pressure, gravity):
    estimator = stretching_estimator()
    tips, _ = estimator.tips(estimator.update(0.0, pressure, gravity))
    for tip, base, of_finger in zip(tips, GRIPPER.finger_base_m, pressure.reshape(4, 4), strict=True):
        rod = rod_at_rest(
            rod_section(CALIBRATION.law, of_finger),
            GRIPPER.rod_geometry,
            RodLoads(gravity_m_s2=tuple(gravity.tolist())),
        )
        assert np.linalg.norm(tip - base - rod.tip_position_m) < 1e-5


@settings(max_examples=10, deadline=None)
@given(READINGS, POSTURES)
def test_at_rest_the_tips_are_within_2_mm_of_the_plants_at_any_pressure_and_tilt(pressure, gravity):
    law, config = CALIBRATION.law, load_config(PlantConfig, "plant.yaml")
    of_fingers = pressure.reshape(4, 4)
    acts = Actuation(*law.moment_and_stiffness(of_fingers), law.strain_law(of_fingers))
    toward = tuple((gravity / np.linalg.norm(gravity)).tolist())
    setup = TierSetup(GRIPPER.rod_geometry, GRIPPER.finger_base_m, 9.81, None, np.empty((0, 3)), config, False, toward)
    plant = build_tier(setup, Fidelity("rod", 3, 5e-3, twist_modes=2, stretch_modes=2))
    plant.reset(acts)
    plant.step(acts, np.zeros(601), np.zeros(601))
    estimator = stretching_estimator()
    tips, _ = estimator.tips(estimator.update(0.0, pressure, gravity))
    assert np.linalg.norm(plant.state().centreline_m[:, -1] - tips, axis=1).max() < 2e-3
