"""Where a muscle touches, and with what force."""

import numpy as np
import pytest

from mbpam_ros.plant.contact import deepest_near, force_law, force_slope, may_touch, sample_distances
from mbpam_ros.plant.contact_config import ContactConfig
from mbpam_ros.plant.finger import STATIONS, station
from mbpam_ros.plant.shapes import CYLINDER, SPHERE, signed_distance

MUSCLE = np.array([0.015, 0.100, 0.010])
BASE = np.array([0.035, 0.035, 0.0])
CONFIG = ContactConfig(2000.0, 2.0, 0.6, 0.001, 0.0002, 2e-5, 1e-3)
NORMAL = np.array([0.6, 0.0, 0.8])
STEP_S = 1e-3


LEVEL = np.eye(3)


def touches(bend, shape, half, centre, rotation=LEVEL):
    """All points where the muscle touches: rows (depth, arc length), deepest first."""
    distances, found = np.empty(STATIONS), np.empty(7)
    spacing = sample_distances(*bend, MUSCLE, BASE, shape, half, centre, rotation, found, distances)
    near = [k for k in range(STATIONS) if may_touch(distances, k, MUSCLE[2], spacing)]
    points = [deepest_near(*bend, MUSCLE, BASE, shape, half, centre, rotation, k, spacing, found) for k in near]
    return sorted((point for point in points if point[0] > 0.0), reverse=True)


def force_at(velocity, depth=2e-4, grip=-1.0):
    force = np.empty(6)
    return force_law(CONFIG.law(), depth, STEP_S, NORMAL, np.array(velocity, dtype=float), grip, force), force


@pytest.mark.parametrize("inward", [0.35, 0.5, 1.0, 1.6])
def test_deepest_point_is_that_of_a_fine_search(inward):
    bend, half, centre = (-inward, -0.8 * inward), np.full(3, 0.03), np.array([0.001, 0.002, 0.085])
    ((depth, s),) = touches(bend, SPHERE, half, centre)
    fine = np.linspace(0.0, 0.120, 24001)
    distance = [signed_distance(SPHERE, half, *(BASE + station(*bend, MUSCLE, t)[:3] - centre))[0] for t in fine]
    assert depth == pytest.approx(0.010 - min(distance), abs=1e-9)
    assert s == pytest.approx(fine[int(np.argmin(distance))], abs=1e-5)


def test_deepest_point_moves_smoothly_with_the_bend():
    along_y = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    half, centre = np.array([0.0175, 0.0175, 0.09]), np.array([0.0, 0.0, 0.07])
    points = np.array(
        [touches((-angle, 0.0), CYLINDER, half, centre, along_y)[0] for angle in np.linspace(0.5, 0.7, 401)]
    )
    assert np.all(points[:, 0] > 0.0)
    assert np.abs(np.diff(points[:, 1])).max() < 2e-4  # 0.5 mrad a sample


def test_a_muscle_far_away_does_not_touch():
    assert not touches((0.5, 0.5), SPHERE, np.full(3, 0.03), np.array([0.0, 0.0, 0.085]))


def test_force_never_pulls():
    f, force = force_at([*(1.0 * NORMAL), 0.0, 0.0, 0.0])
    assert f == 0.0
    assert not force.any()


@pytest.mark.parametrize("speed", [1e-6, 1e-5, 1e-3, 1.0])
def test_friction_opposes_slip_and_stays_within_coulombs_cone(speed):
    f, force = force_at([0.0, speed, 0.0, 0.0, 0.0, 0.0])
    assert force[:3] @ NORMAL == pytest.approx(f)
    assert force[1] == pytest.approx(-0.6 * f * min(1.0, speed / 2e-5))


def test_resting_force_is_stiffness_times_depth():
    f, force = force_at(np.zeros(6))
    np.testing.assert_allclose(force, [*(0.4 * NORMAL), 0.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    "velocity",
    [[0.01, 1e-5, -0.01, 1e-4, 2e-4, 3e-4], [0.01, 0.02, -0.01, 0.5, -0.2, 0.3]],
    ids=["sticking", "sliding and turning"],
)
def test_slope_is_the_derivative_of_the_force(velocity):
    velocity, slope = np.array(velocity), np.empty((6, 6))
    velocity[:3] -= (velocity[:3] @ NORMAL) * NORMAL * 0.9  # keep it touching
    if abs(velocity[1]) < 1e-4:
        velocity[:3] = [4e-6, 1e-5, -3e-6]
    f, force = force_at(velocity)
    assert f > 0.0
    force_slope(CONFIG.law(), STEP_S, NORMAL, velocity, f, f, force, True, False, slope)
    for j in range(6):
        step = 1e-8 * np.eye(6)[j]
        expected = -(force_at(velocity + step)[1] - force_at(velocity - step)[1]) / 2e-8
        np.testing.assert_allclose(slope[:, j], expected, rtol=1e-4, atol=1e-4 * np.abs(slope).max())


def test_slope_at_held_friction_load_is_symmetric_and_positive():
    velocity, slope = np.array([0.001, 0.002, -0.001, 0.5, -0.2, 0.3]), np.empty((6, 6))
    f, force = force_at(velocity)
    force_slope(CONFIG.law(), STEP_S, NORMAL, velocity, f, f, force, False, False, slope)
    np.testing.assert_allclose(slope, slope.T, atol=1e-12)
    assert np.linalg.eigvalsh(slope).min() > -1e-9


def test_negative_friction_is_refused():
    with pytest.raises(ValueError, match="friction_coefficient"):
        ContactConfig(2000.0, 2.0, -0.1, 0.001, 0.0, 2e-5, 1e-3)
