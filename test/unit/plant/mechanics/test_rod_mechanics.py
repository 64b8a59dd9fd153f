"""The compiled rod against the actuator's kinematics, fine integration, finite differences and closed forms."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import gravity_gradient_n_m
from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.rod import (
    Motion,
    ball_jacobian,
    ball_position,
    build_rod,
    masses_and_loads,
    motion_at_rest,
    move_rods,
    position_weights,
    room_for_loads,
    stumpff,
    stumpff_of_lanes,
)
from mbpam_ros.plant.tiers.rod import tip_bend

GEOMETRY = MuscleGeometry(0.010, 0.015, 0.100, 0.162)
BENDS = [(0.0, 0.0), (1e-6, -2e-6), (0.4, -0.3), (-1.5, 1.2), (2.4, 1.8)]
ACTIVE_END_M = 0.115
RATE = np.array([3.0, -5.0, 1.0, 2.0, -4.0, 0.5, 6.0, -3.0, 2.0, -1.5])
TILTED = (2.0, -5.0, 8.0)


class Shape(NamedTuple):
    """Coordinates of a muscle: those of curvature, of twist and of stretch."""

    bend: np.ndarray
    twist: np.ndarray = np.zeros(0)
    stretch: np.ndarray = np.zeros(0)

    @property
    def all(self):
        return np.concatenate(self)

    @property
    def size(self):
        return len(self.all)

    @property
    def rate(self):
        own = np.split(RATE, [6, 8])
        return np.concatenate([rate[: len(part)] for rate, part in zip(own, self, strict=True)])

    def moved_by(self, step):
        ends = np.cumsum([len(part) for part in self])[:-1]
        return Shape(*(part + change for part, change in zip(self, np.split(step, ends), strict=True)))


SMALL, LARGE = np.array([1.2, -0.5, 0.4, 0.3, -0.2, 0.1]), np.array([-2.0, 1.6, -0.3, -0.8, 0.3, -0.2])
SHAPES = [
    Shape(np.zeros(6)),
    Shape(SMALL),
    Shape(LARGE),
    Shape(np.zeros(6), np.zeros(2), np.zeros(2)),
    Shape(SMALL, np.array([1.1, -0.4])),
    Shape(LARGE, np.zeros(0), np.array([0.15, -0.05])),
    Shape(LARGE, np.array([-0.9, 0.5]), np.array([0.12, 0.06])),
]
BENT = [shape for shape in SHAPES if shape.bend.any()]


def moved(shape, rate=None, segments=5):
    """Rod and motion of one muscle with these coordinates, which all four have."""
    shape = shape if isinstance(shape, Shape) else Shape(np.asarray(shape, dtype=float))
    rod = build_rod(GEOMETRY, len(shape.bend) // 2, segments, 27, len(shape.twist), len(shape.stretch))
    motion, q = motion_at_rest(rod), shape.all
    q, rate = (np.repeat(part[:, None], WIDTH, axis=1) for part in (q, 0.0 * q if rate is None else np.asarray(rate)))
    move_rods.py_func(q, rate, rod, motion)
    return rod, motion.of(0)


def in_lanes(motion):
    return Motion(*(np.repeat(part[..., None], WIDTH, axis=-1) for part in motion))


def mechanics(shape, rate=None, gravity=(0.0, 0.0, 0.0), segments=5):
    rod, motion = moved(shape, rate, segments)
    size = motion.slope.shape[2]
    mass, load = np.empty((size, size, WIDTH)), np.empty((size, WIDTH))
    masses_and_loads.py_func(rod, in_lanes(motion), gravity, room_for_loads(rod), mass, load)
    return mass[..., 0], load[:, 0]


def weights(shape, segments, arc_length_m):
    return position_weights(GEOMETRY, segments, arc_length_m, len(shape.stretch) > 0)


def finely_integrated(shape):
    """Position and rotation of the active part's end by an integrator with error control."""

    def strain(modes, sigma):
        return legendre.legval(2.0 * sigma - 1.0, modes) if len(modes) else 0.0

    def slope(sigma, state):
        (x, y), twist = strain(shape.bend.reshape(-1, 2), sigma), strain(shape.twist, sigma)
        rotation, speed = state[3:].reshape(3, 3), 0.1 * (1.0 + strain(shape.stretch, sigma))
        turn = np.array([[0, -twist, x], [twist, 0, y], [-x, -y, 0]])
        return np.concatenate([speed * rotation[:, 2], (rotation @ turn).ravel()])

    start = np.concatenate([[0.0, 0.0, 0.015], np.eye(3).ravel()])
    end = solve_ivp(slope, (0.0, 1.0), start, rtol=1e-11, atol=1e-13).y[:, -1]
    return end[:3], end[3:].reshape(3, 3)


@pytest.mark.parametrize("u", [0.0, 1e-12, 0.3, 0.999999, 1.000001, 9.9, 39.0])
def test_stumpff_functions_follow_from_each_other_and_from_sine_and_cosine(u):
    angle = math.sqrt(u)
    c1, c2, c3, c4, c5 = stumpff(u)
    assert c1 == pytest.approx(np.sinc(angle / math.pi), abs=1e-15)
    assert c2 == pytest.approx(0.5 * np.sinc(0.5 * angle / math.pi) ** 2, abs=1e-15)
    assert u * c3 == pytest.approx(1.0 - c1, abs=1e-15)
    assert u * c4 == pytest.approx(0.5 - c2, abs=1e-15)
    assert u * c5 == pytest.approx(1.0 / 6.0 - c3, abs=1e-15)


def test_in_lanes_each_stumpff_function_is_what_it_is_alone():
    u = np.array([0.3, 39.0, 1.000001, 0.0])
    alone = np.array([stumpff(value) for value in u])
    np.testing.assert_array_equal(np.transpose(stumpff_of_lanes(u)), alone)


def test_one_mode_is_the_constant_curvature_of_the_actuators_kinematics():
    arc_length = np.linspace(0.0, GEOMETRY.length_m, 27)
    for bend in BENDS:
        for segments, error_m in ((4, 1e-4), (8, 1e-8)):
            _, motion = moved(bend, segments=segments)
            points = position_weights(GEOMETRY, segments, arc_length) @ motion.tangent
            np.testing.assert_allclose(points, centreline(np.array(bend), GEOMETRY, arc_length), atol=error_m)


@pytest.mark.parametrize("shape", BENT)
def test_tip_tangent_and_position_converge_with_the_fourth_power_of_the_segments_length(shape):
    position, rotation = finely_integrated(shape)
    errors = []
    for segments in (8, 16):
        _, motion = moved(shape, segments=segments)
        end = weights(shape, segments, [ACTIVE_END_M])[0] @ motion.tangent
        errors.append([np.linalg.norm(motion.tangent[-1] - rotation[:, 2]), np.linalg.norm(end - position) / 0.1])
    coarse, fine = np.array(errors)
    assert (fine < 3e-6).all()
    assert (14.0 < coarse / fine).all() and (coarse / fine < 20.0).all()


def test_a_straight_muscle_is_exactly_straight_whatever_its_number_of_modes():
    for modes in (1, 2, 4):
        _, motion = moved(np.zeros(2 * modes))
        np.testing.assert_array_equal(motion.tangent, np.tile([0.0, 0.0, 1.0], (6, 1)))
        assert np.isfinite(motion.slope).all() and np.isfinite(motion.acceleration).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_slope_is_the_derivative_of_the_directors(shape):
    for j, step in enumerate(1e-6 * np.eye(shape.size)):
        expected = (moved(shape.moved_by(step))[1].tangent - moved(shape.moved_by(-step))[1].tangent) / 2e-6
        np.testing.assert_allclose(moved(shape)[1].slope[..., j], expected, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_acceleration_is_the_second_derivative_of_the_directors_at_constant_rates(shape):
    h = 1e-4
    before, now, after = (moved(shape.moved_by(way * shape.rate))[1].tangent for way in (-h, 0.0, h))
    expected = (after - 2.0 * now + before) / h**2
    np.testing.assert_allclose(moved(shape, shape.rate)[1].acceleration, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("shape", [SHAPES[1], SHAPES[4], SHAPES[6]])
def test_turning_is_the_derivative_of_the_sections_rotation(shape):
    h = 1e-5
    for j, step in enumerate(h * np.eye(shape.size)):
        back, here, forward = (finely_integrated(shape.moved_by(way * step))[1] for way in (-1.0, 0.0, 1.0))
        spin = (forward - back) @ here.T / (2.0 * h)
        expected = [spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(moved(shape, segments=12)[1].turning[-1, :, j], expected, atol=2e-5)


@pytest.mark.parametrize("shape", BENT)
def test_jacobian_of_a_ball_is_the_derivative_of_its_position_and_turns_material_beside_it(shape):
    rod, motion = moved(shape)
    centre, beside, arm = np.empty((6, shape.size)), np.empty((6, shape.size)), np.array([0.003, -0.002, 0.005])
    own = in_lanes(motion)
    ball_jacobian.py_func(rod, own, 0, 20, 1.0, (0.0, 0.0, 0.0), centre)
    ball_jacobian.py_func(rod, own, 0, 20, -1.0, tuple(arm), beside)
    for j, step in enumerate(1e-6 * np.eye(shape.size)):
        ahead, back = (ball_position.py_func(rod, in_lanes(moved(shape.moved_by(s))[1]), 0, 20) for s in (step, -step))
        np.testing.assert_allclose(centre[:3, j], np.subtract(ahead, back) / 2e-6, atol=1e-9)
    expected = np.vstack([centre[:3] + np.cross(centre[3:], arm, axisa=0).T, centre[3:]])
    np.testing.assert_allclose(beside, -expected, atol=1e-12)


def test_mass_of_a_straight_muscle_is_its_closed_form():
    length, end, density = 0.100, 0.015, 0.162
    lever = length**3 / 20 + ((length / 2 + end) ** 3 - (length / 2) ** 3) / 3  # s^2 / 2L, then L/2 + d
    np.testing.assert_allclose(mechanics((0.0, 0.0))[0], density * lever * np.eye(2), rtol=1e-12)


@pytest.mark.parametrize("bend", BENDS)
def test_gravity_on_one_mode_is_the_closed_form_of_constant_curvature(bend):
    expected = -gravity_gradient_n_m(np.array(bend), GEOMETRY)
    np.testing.assert_allclose(mechanics(bend, gravity=(0.0, 0.0, 9.81))[1], expected, atol=2e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_mass_is_that_of_a_fine_chain_of_points(shape):
    # The active part and the far end, each by midpoints (positions have a kink between them).
    s = np.concatenate([a + (np.arange(2000) + 0.5) * n / 2000 for a, n in ((0.015, 0.1), (0.115, 0.015))])
    mass = np.repeat([0.162 * 0.1 / 2000, 0.162 * 0.015 / 2000], 2000)
    rod, motion = moved(shape)
    positions = np.einsum("sk,kij->sij", weights(shape, 5, s), motion.slope)
    expected = np.einsum("s,sij,sik->jk", mass, positions, positions)
    expected += np.einsum("k,ki,kj->ij", rod.spins, motion.spin, motion.spin)
    np.testing.assert_allclose(mechanics(shape)[0], expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_straight_muscle_that_twists_has_the_turning_inertia_of_a_solid_cylinder():
    # Twisted evenly: the active part by sigma, the end by all of it.
    per_length = 0.5 * 0.162 * 0.010**2
    mass, _ = mechanics(Shape(np.zeros(2), np.zeros(1)))
    assert mass[2, 2] == pytest.approx(per_length * (0.100 / 3.0 + 0.015), rel=1e-12)


def test_a_straight_muscle_that_stretches_has_the_mass_of_a_bar():
    mass, _ = mechanics(Shape(np.zeros(2), np.zeros(0), np.zeros(1)))
    assert mass[2, 2] == pytest.approx(0.162 * 0.100**2 * (0.100 / 3.0 + 0.015), rel=1e-12)


@pytest.mark.parametrize("shape", [SHAPES[4], SHAPES[6]])
def test_spin_is_the_turning_about_the_tangent(shape):
    _, motion = moved(shape)
    points = slice(2, -1) if len(shape.stretch) else slice(1, None)
    tangents = motion.tangent[points] / np.linalg.norm(motion.tangent[points], axis=1, keepdims=True)
    expected = np.einsum("ki,kij->kj", tangents, motion.turning[points])
    expected[:, len(shape.bend) + len(shape.twist) :] = 0.0
    np.testing.assert_allclose(motion.spin, expected, atol=1e-14)


@pytest.mark.parametrize("shape", BENT)
def test_velocity_terms_are_those_of_lagranges_equation_and_gravity_has_a_potential(shape):
    def potential(q):
        rod, motion = moved(q)
        return -rod.levers @ (motion.tangent[1:] @ TILTED)

    rate, steps = shape.rate, 1e-5 * np.eye(shape.size)
    slopes = [(mechanics(shape.moved_by(e))[0] - mechanics(shape.moved_by(-e))[0]) / 2e-5 for e in steps]
    change = sum(slope * v for slope, v in zip(slopes, rate, strict=True))
    expected = -change @ rate + 0.5 * np.array([rate @ slope @ rate for slope in slopes])
    expected -= [(potential(shape.moved_by(e)) - potential(shape.moved_by(-e))) / 2e-5 for e in steps]
    load = mechanics(shape, rate, TILTED)[1]
    np.testing.assert_allclose(load, expected, atol=1e-8 * np.abs(load).max())


@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.7, 3.1, math.pi, 3.3, 5.0, 7.0])
def test_the_tips_bend_is_that_of_a_planar_muscle_beyond_half_and_full_turns(angle):
    direction, h = np.array([0.6, -0.8]), 1e-6
    _, motion = moved(angle * direction, 2.0 * direction)
    rate = motion.slope[-1] @ (2.0 * direction)
    bend, bend_rate = tip_bend(motion.tangent[-1:], rate[None], (angle + 0.3) * direction[None])
    np.testing.assert_allclose(bend[0], angle * direction, atol=1e-9)
    if 0.0 < angle != math.pi:
        np.testing.assert_allclose(bend_rate[0], 2.0 * direction, atol=1e-6)
    assert np.isfinite(bend_rate).all() and h > 0.0


def test_the_tips_bend_turns_the_clamps_axis_into_the_tips_and_its_rate_is_its_derivative():
    shape, h = SHAPES[2], 1e-6
    bends = []
    for way in (-h, 0.0, h):
        q = shape.moved_by(way * shape.rate)
        _, motion = moved(q, q.rate)
        tip_rate = motion.slope[-1] @ q.rate
        bends.append(tip_bend(motion.tangent[-1:], tip_rate[None], q.bend[None, :2]))
    (x, y), tangent = bends[1][0][0], moved(shape)[1].tangent[-1]
    np.testing.assert_allclose(Rotation.from_rotvec([-y, x, 0.0]).apply([0.0, 0.0, 1.0]), tangent, atol=1e-12)
    np.testing.assert_allclose(bends[1][1], (bends[2][0] - bends[0][0]) / (2.0 * h), rtol=1e-6)
