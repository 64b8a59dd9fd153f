import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.actuator.equilibrium import (
    GRAVITY_M_S2,
    gravity_energy_j,
    gravity_gradient_n_m,
    gravity_stiffness_n_m,
    hanging_bend,
    holding_moment_n_m,
    resting_bend,
)
from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.gripper import load_gripper

GRIPPER = load_gripper()
GEOMETRY = GRIPPER.geometry
ANGLES = np.array([0.0, 1e-6, 1e-3, 0.01, 0.3, 1.5, 2.6, 4.0, 7.0])


def test_gravity_energy_is_the_weight_lifted_along_the_centreline():
    along = (np.arange(20000) + 0.5) * GEOMETRY.length_m / 20000
    for bend in ([0.2, 0.1], [-1.0, 2.0], [3.0, 4.0]):
        depth = centreline(bend, GEOMETRY, along)[:, 2]
        weight = GEOMETRY.mass_per_length_kg_m * GRAVITY_M_S2
        lifted = weight * (along - depth).mean() * GEOMETRY.length_m
        assert gravity_energy_j(bend, GEOMETRY) == pytest.approx(lifted, rel=1e-7)


def test_the_gradient_is_the_slope_of_the_energy():
    step = 1e-6
    for bend in np.array([[0.0, 0.0], [0.01, 0.0], [0.5, -0.8], [-2.0, 1.5], [4.0, 4.0]]):
        slope = [
            (gravity_energy_j(bend + e, GEOMETRY) - gravity_energy_j(bend - e, GEOMETRY)) / (2.0 * step)
            for e in step * np.eye(2)
        ]
        np.testing.assert_allclose(gravity_gradient_n_m(bend, GEOMETRY), slope, atol=1e-9)


def test_the_tangent_stiffness_is_the_slope_of_the_gradient():
    step = 1e-4
    for angle in ANGLES[3:]:
        above, below = (gravity_gradient_n_m([angle + sign * step, 0.0], GEOMETRY)[0] for sign in (1, -1))
        tangent = gravity_stiffness_n_m(angle, GEOMETRY)[1]
        assert tangent == pytest.approx((above - below) / (2.0 * step), abs=1e-9)


def test_gravity_stiffness_of_the_straight_muscle_is_the_closed_form():
    active, end = GEOMETRY.active_length_m, GEOMETRY.end_length_m
    weight = GEOMETRY.mass_per_length_kg_m * GRAVITY_M_S2
    closed_form = weight * (active**2 / 12.0 + end * active / 3.0 + end**2 / 2.0)
    secant, tangent = gravity_stiffness_n_m(np.zeros(2), GEOMETRY)
    np.testing.assert_allclose([secant, tangent], closed_form, rtol=2e-6)


@pytest.mark.parametrize("moment", [0.0, 1e-6, 0.003, 0.02, 0.045, 0.07])
def test_the_hanging_bend_has_the_least_potential_energy(moment):
    stiffness = 1.5e-3

    def energy(angle):
        elastic = 0.5 * stiffness / GEOMETRY.active_length_m * angle**2 - moment * angle
        return elastic + gravity_energy_j([angle, 0.0], GEOMETRY)

    best = minimize_scalar(energy, bounds=(-1.0, 8.0), method="bounded", options={"xatol": 1e-10}).x
    np.testing.assert_allclose(hanging_bend([moment, 0.0], stiffness, GEOMETRY), [best, 0.0], atol=2e-6)


def test_the_balance_holds_to_rounding_for_many_muscles_at_once():
    rng = np.random.default_rng(3)
    moment, stiffness = rng.normal(0.0, 0.03, (50, 4, 2)), rng.uniform(0.5e-3, 4e-3, (50, 4))
    bend = hanging_bend(moment, stiffness, GEOMETRY)
    elastic = stiffness[..., None] / GEOMETRY.active_length_m * bend
    np.testing.assert_allclose(elastic + gravity_gradient_n_m(bend, GEOMETRY), moment, atol=1e-10)


def test_without_gravity_the_bend_is_the_free_one():
    bend = hanging_bend([0.03, -0.01], 1.5e-3, GEOMETRY, gravity_m_s2=0.0)
    np.testing.assert_allclose(bend, np.array([0.03, -0.01]) * 0.1 / 1.5e-3, rtol=1e-12)


def test_gravity_straightens_a_hanging_muscle():
    free, hanging = (np.hypot(*hanging_bend([0.02, 0.01], 1.5e-3, GEOMETRY, g)) for g in (0.0, GRAVITY_M_S2))
    assert 0.7 * free < hanging < 0.95 * free


def test_the_balance_has_one_solution_in_the_whole_domain():
    fall = -gravity_stiffness_n_m(np.linspace(0.0, 4.0 * math.pi, 4000), GEOMETRY)[1].min()
    assert fall == pytest.approx(0.0014, abs=1e-4)
    for a in (1.5, 2.5, 3.5):
        for b in (1.0, 2.0, 3.0):
            law = calibrated_rod_law(MuscleDesign(a, b), GEOMETRY)
            assert law.pdc_stiffness_n_m2[0] / GEOMETRY.active_length_m > 0.0044 > fall


def test_nan_stays_with_its_muscle():
    bend = hanging_bend([[math.nan, 0.0], [0.02, 0.01]], [1.5e-3, 1.5e-3], GEOMETRY)
    assert np.isnan(bend[0]).all()
    np.testing.assert_array_equal(bend[1], hanging_bend([0.02, 0.01], 1.5e-3, GEOMETRY))


def energy_j(bend, gravity):
    """Weight times the centre line's place, by quadrature."""
    along = (np.arange(4000) + 0.5) * GEOMETRY.length_m / 4000
    mean = centreline(bend, GEOMETRY, along).mean(axis=0)
    return -GEOMETRY.mass_per_length_kg_m * GEOMETRY.length_m * float(mean @ gravity)


def test_the_moment_that_holds_a_bend_in_any_posture_is_the_slope_of_its_energy():
    stiffness, step = 1.5e-3, 1e-5
    for gravity in np.array([[9.81, 0.0, 0.0], [3.0, -5.0, 7.0], [2.0, 6.0, -7.0]]):
        for bend in np.array([[0.0, 0.0], [2e-4, -1e-4], [0.5, -0.8], [-2.0, 1.5], [3.0, 4.0]]):
            slope = [
                (energy_j(bend + e, gravity) - energy_j(bend - e, gravity)) / (2.0 * step) for e in step * np.eye(2)
            ]
            expected = stiffness / GEOMETRY.active_length_m * bend + slope
            held = holding_moment_n_m(bend[None], np.array([stiffness]), GEOMETRY, gravity)[0]
            np.testing.assert_allclose(held, expected, atol=2e-8)


def test_the_bend_at_rest_in_any_posture_is_what_its_moment_holds():
    rng = np.random.default_rng(5)
    moment, stiffness = rng.normal(0.0, 0.03, (60, 2)), rng.uniform(0.6e-3, 4e-3, 60)
    for gravity in (*np.eye(3), *-np.eye(3), *rng.normal(size=(20, 3))):
        gravity = GRAVITY_M_S2 * gravity / np.linalg.norm(gravity)
        bend = resting_bend(moment, stiffness, GEOMETRY, gravity)
        np.testing.assert_allclose(holding_moment_n_m(bend, stiffness, GEOMETRY, gravity), moment, atol=1e-10)
    shaped = resting_bend(moment.reshape(3, 20, 2), stiffness.reshape(3, 20), GEOMETRY, gravity)
    np.testing.assert_array_equal(shaped.reshape(60, 2), bend)


def test_a_level_muscle_sags_and_gravity_along_it_is_the_hanging_case():
    sagging = resting_bend(np.zeros((1, 2)), np.array([1.2e-3]), GEOMETRY, [0.0, GRAVITY_M_S2, 0.0])[0]
    assert sagging[0] == 0.0 and sagging[1] > 0.1
    moment, stiffness = np.array([[0.02, 0.01], [np.nan, 0.0]]), np.full(2, 1.5e-3)
    hanging = resting_bend(moment, stiffness, GEOMETRY, [0.0, 0.0, GRAVITY_M_S2])
    np.testing.assert_array_equal(hanging, hanging_bend(moment, stiffness, GEOMETRY))
    assert np.isnan(resting_bend(moment, stiffness, GEOMETRY, [1.0, 0.0, 9.0])[1]).all()
