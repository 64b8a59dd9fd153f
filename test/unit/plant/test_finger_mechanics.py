"""The compiled constant-curvature muscle against the actuator's kinematics, finite differences and closed forms."""

import math

import numpy as np
import pytest

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import gravity_gradient_n_m
from mbpam_ros.actuator.kinematics import centreline, tip_pose
from mbpam_ros.plant.finger import Muscle, inertia_and_load, mass_nodes, station, station_jacobian, stumpff

GEOMETRY = MuscleGeometry(0.010, 0.015, 0.100, 0.162)
MUSCLE = Muscle(0.015, 0.100, 0.010)
NODES = mass_nodes(GEOMETRY)
BENDS = [(0.0, 0.0), (1e-6, -2e-6), (0.4, -0.3), (-1.5, 1.2), (2.4, 1.8)]


def mass_and_load(bend, rate, gravity=0.0):
    mxx, mxy, myy, qx, qy = inertia_and_load(*bend, *rate, MUSCLE, NODES, gravity)
    return np.array([[mxx, mxy], [mxy, myy]]), np.array([qx, qy])


def jacobian_at(bend, s, sign=1.0, arm=(0.0, 0.0, 0.0)):
    jacobian = np.empty((6, 2))
    station_jacobian(*bend, MUSCLE, s, sign, *arm, jacobian)
    return jacobian


@pytest.mark.parametrize("u", [0.0, 1e-12, 0.3, 9.9, 39.0])
def test_stumpff_functions_are_cosine_sinc_and_their_remainders(u):
    angle = math.sqrt(u)
    c = stumpff(u)
    assert c[0] == pytest.approx(math.cos(angle), abs=1e-11)
    assert c[1] == pytest.approx(np.sinc(angle / math.pi), abs=1e-11)
    assert c[2] == pytest.approx(0.5 * np.sinc(0.5 * angle / math.pi) ** 2, abs=1e-11)


@pytest.mark.parametrize("bend", BENDS)
def test_stations_lie_on_the_actuators_centre_line(bend):
    arc_length = np.linspace(0.0, GEOMETRY.length_m, 27)
    points = np.array([station(*bend, MUSCLE, s) for s in arc_length])
    np.testing.assert_allclose(points, centreline(np.array(bend), GEOMETRY, arc_length), atol=1e-9)


@pytest.mark.parametrize("bend", BENDS)
@pytest.mark.parametrize("s", [0.008, 0.05, 0.113, 0.125])
def test_position_jacobian_is_the_derivative_of_the_position(bend, s):
    step = 1e-6
    for j in range(2):
        moved = [np.array(bend) + sign * step * np.eye(2)[j] for sign in (1, -1)]
        forward, back = (np.array(station(*m, MUSCLE, s)) for m in moved)
        np.testing.assert_allclose(jacobian_at(bend, s)[:3, j], (forward - back) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("bend", BENDS)
def test_turning_jacobian_is_the_derivative_of_the_tips_orientation(bend):
    step = 1e-5
    for j in range(2):
        ends = [tip_pose(np.array(bend) + sign * step * np.eye(2)[j], GEOMETRY)[1] for sign in (1, -1)]
        (x, y, z, w), q = (ends[0] - ends[1]) / (2 * step), tip_pose(np.array(bend), GEOMETRY)[1]
        rate, conjugate = np.array([x, y, z]), -q[:3]
        turning = 2.0 * (w * conjugate + q[3] * rate + np.cross(rate, conjugate))  # omega = 2 (dq/dt) q*
        np.testing.assert_allclose(jacobian_at(bend, 0.125)[3:, j], turning, atol=1e-8)


def test_material_beside_the_centreline_moves_with_its_turning():
    bend, arm = (0.4, -0.3), np.array([0.003, -0.002, 0.005])
    centre = jacobian_at(bend, 0.05)
    expected = np.vstack([centre[:3] + np.cross(centre[3:], arm, axisa=0).T, centre[3:]])
    np.testing.assert_allclose(jacobian_at(bend, 0.05, -1.0, arm), -expected, atol=1e-12)


def test_mass_of_a_straight_muscle_is_its_closed_form():
    length, end, density = 0.100, 0.015, 0.162
    lever = length**3 / 20 + ((length / 2 + end) ** 3 - (length / 2) ** 3) / 3  # s^2 / 2L, then L/2 + d
    mass, _ = mass_and_load((0.0, 0.0), (0.0, 0.0))
    np.testing.assert_allclose(mass, density * lever * np.eye(2), rtol=1e-12)


@pytest.mark.parametrize("bend", BENDS)
def test_mass_matrix_is_that_of_a_fine_chain_of_points(bend):
    # The active part and the far end, each by midpoints (the Jacobian has a kink between them).
    expected = np.zeros((2, 2))
    for start, length in ((0.015, 0.1), (0.115, 0.015)):
        for s in start + (np.arange(2000) + 0.5) * length / 2000:
            j = jacobian_at(bend, s)[:3]
            expected += 0.162 * length / 2000 * j.T @ j
    np.testing.assert_allclose(mass_and_load(bend, (0.0, 0.0))[0], expected, rtol=4e-6)


@pytest.mark.parametrize("bend", BENDS)
def test_gravity_load_is_minus_the_gradient_of_the_potential_energy(bend):
    expected = -gravity_gradient_n_m(np.array(bend), GEOMETRY)
    np.testing.assert_allclose(mass_and_load(bend, (0.0, 0.0), 9.81)[1], expected, atol=2e-9)


@pytest.mark.parametrize("bend", BENDS[2:])
def test_velocity_terms_are_those_of_lagranges_equation(bend):
    rate, step = np.array([3.0, -5.0]), 1e-5

    def mass(b):
        return mass_and_load(b, (0.0, 0.0))[0]

    slopes = [(mass(np.array(bend) + step * e) - mass(np.array(bend) - step * e)) / (2 * step) for e in np.eye(2)]
    change = sum(slope * v for slope, v in zip(slopes, rate, strict=True))
    expected = -change @ rate + 0.5 * np.array([rate @ slope @ rate for slope in slopes])
    np.testing.assert_allclose(mass_and_load(bend, rate)[1], expected, rtol=1e-6, atol=1e-10)
