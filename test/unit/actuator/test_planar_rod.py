import math

import numpy as np
import pytest
from scipy.optimize import minimize

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import (
    RodSolutionError,
    blocked_tip_force_per_moment,
    rod_tip_angle,
    stiffness_for_tip_angle,
)
from mbpam_ros.gripper import load_gripper

GEOMETRY = load_gripper().geometry
L, END = GEOMETRY.active_length_m, GEOMETRY.end_length_m
WEIGHT = GEOMETRY.mass_per_length_kg_m * GRAVITY_M_S2


def least_energy_tip_angle(moment, stiffness, segments=80):
    """Tip angle of the upright rod as a chain of equal segments, by minimising its potential energy."""
    h = L / segments
    to_tip = END + L - (np.arange(segments) + 0.5) * h

    def energy(angles):
        node = np.concatenate([[0.0], angles])
        middle, turn = 0.5 * (node[1:] + node[:-1]), np.diff(node)
        value = 0.5 * stiffness / h * (turn @ turn) - moment * node[-1]
        value += WEIGHT * (h * (to_tip @ np.cos(middle)) + 0.5 * END**2 * math.cos(node[-1]))
        slope = np.zeros(segments + 1)
        slope[1:] += stiffness / h * turn
        slope[:-1] -= stiffness / h * turn
        sag = -0.5 * WEIGHT * h * to_tip * np.sin(middle)
        slope[1:] += sag
        slope[:-1] += sag
        slope[-1] -= moment + 0.5 * WEIGHT * END**2 * math.sin(node[-1])
        return 1e3 * value, 1e3 * slope[1:]

    start = moment / stiffness * h * np.arange(1, segments + 1)
    return minimize(energy, start, jac=True, method="BFGS", options={"gtol": 1e-6, "maxiter": 2000}).x[-1]


@pytest.mark.parametrize(("moment", "stiffness"), [(0.044, 1.86e-3), (0.032, 1.74e-3), (0.005, 1.2e-3)])
def test_the_tip_angle_is_that_of_least_potential_energy(moment, stiffness):
    assert rod_tip_angle(moment, stiffness, GEOMETRY) == pytest.approx(
        least_energy_tip_angle(moment, stiffness), rel=3e-4
    )


def test_without_gravity_the_rod_is_an_arc():
    angle = rod_tip_angle(0.04, 1.8e-3, GEOMETRY, gravity_m_s2=0.0)
    assert angle == pytest.approx(0.04 * L / 1.8e-3, rel=1e-10)


def test_an_unpressurised_upright_rod_stands_straight():
    assert rod_tip_angle(0.0, 1.14e-3, GEOMETRY) == pytest.approx(0.0, abs=1e-9)


def test_the_weight_bends_the_upright_rod_further():
    assert rod_tip_angle(0.02, 1.5e-3, GEOMETRY) > 1.05 * rod_tip_angle(0.02, 1.5e-3, GEOMETRY, 0.0)


def test_the_stiffness_for_a_tip_angle_returns_that_angle():
    stiffness = stiffness_for_tip_angle(2.6, 0.045, GEOMETRY)
    assert rod_tip_angle(0.045, stiffness, GEOMETRY) == pytest.approx(2.6, rel=1e-9)


def test_an_angle_that_no_stiffness_gives_is_a_typed_error():
    with pytest.raises(RodSolutionError, match="no equilibrium of the upright rod"):
        stiffness_for_tip_angle(0.1, 1e-9, GEOMETRY)


def test_the_blocked_force_undoes_the_free_tip_deflection():
    x = END + (np.arange(10000) + 0.5) * L / 10000
    moment, stiffness = 0.0435, 1.9e-3
    free_deflection = np.mean(moment / stiffness * x) * L
    deflection_per_newton = np.mean(x * x / stiffness) * L
    force = moment * blocked_tip_force_per_moment(GEOMETRY)
    assert force == pytest.approx(free_deflection / deflection_per_newton, rel=1e-7)
    assert force == pytest.approx(0.559, abs=5e-4)
