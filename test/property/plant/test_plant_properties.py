"""What holds for any solid, any muscle and any contact."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.geometry.surfaces import BOX, CYLINDER, SPHERE, signed_distance
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.mechanics.contact_config import ContactConfig
from mbpam_ros.plant.mechanics.contact_law import SHEAR, contact_force, contact_table, no_grip, remember
from mbpam_ros.plant.mechanics.contact_solver import (
    NEWTON_LIMIT,
    VELOCITY_TOLERANCE,
    scratch,
    solve_contacts,
    solve_in_place,
)
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.object_contact import object_columns
from mbpam_ros.plant.mechanics.rod import build_rod, masses_and_loads, motion_at_rest, move_rods, room_for_loads

MODES = 2
ROD = build_rod(load_gripper().geometry, MODES, 4, 2)
coordinate = st.floats(-0.2, 0.2)
points = st.tuples(coordinate, coordinate, coordinate)
halves = st.tuples(st.floats(0.005, 0.1), st.floats(0.005, 0.1), st.floats(0.005, 0.1)).map(np.array)
bends = st.lists(st.floats(-3.0, 3.0), min_size=2 * MODES, max_size=2 * MODES).map(np.array)
shapes = st.sampled_from([SPHERE, CYLINDER, BOX])


@given(shapes, halves, points, points)
@settings(deadline=None)  # the first example compiles
def test_distance_changes_by_no_more_than_the_way_moved(shape, half, here, there):
    first, second = (signed_distance(shape, half, *point)[0] for point in (here, there))
    assert abs(first - second) <= np.linalg.norm(np.subtract(here, there)) + 1e-12


@given(shapes, halves, points)
@settings(deadline=None)  # the first example compiles
def test_outside_a_solid_going_the_distance_against_the_gradient_ends_on_its_surface(shape, half, point):
    distance, *gradient = signed_distance(shape, half, *point)
    assert abs(np.linalg.norm(gradient) - 1.0) < 1e-9
    if distance > 1e-6:
        surface = np.array(point) - distance * np.array(gradient)
        assert abs(signed_distance(shape, half, *surface)[0]) < 1e-9


def mechanics(shape, rate):
    motion, mass, load = motion_at_rest(ROD), np.empty((2 * MODES, 2 * MODES, WIDTH)), np.empty((2 * MODES, WIDTH))
    shape, rate = (np.repeat(values[:, None], WIDTH, axis=1) for values in (shape, rate))
    move_rods.py_func(shape, rate, ROD, motion)  # not compiled: the helpers alone would have to be
    masses_and_loads.py_func(ROD, motion, (0.0, 0.0, 9.81), room_for_loads(ROD), mass, load)
    return mass[..., 0], load[:, 0]


@given(bends, bends, st.floats(-np.pi, np.pi))
@settings(deadline=None, max_examples=50)  # the first example compiles
def test_mass_and_load_turn_with_the_muscle_and_the_mass_is_positive(shape, rate, azimuth):
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.kron(np.eye(MODES), [[cos, -sin], [sin, cos]])
    mass, load = mechanics(shape, rate)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    turned_mass, turned_load = mechanics(turn @ shape, turn @ rate)
    np.testing.assert_allclose(turned_mass, turn @ mass @ turn.T, atol=1e-15)
    np.testing.assert_allclose(turned_load, turn @ load, atol=1e-13)


velocities = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


held = st.lists(st.floats(-1e-4, 1e-4), min_size=3, max_size=3).map(np.array)


@given(velocities, held, st.floats(-1e-3, 1e-3), st.floats(0.0, 1.0), st.floats(-5.0, -2.0))
@settings(deadline=None)  # the first example compiles
def test_contact_takes_energy_and_stays_within_the_friction_cone_of_its_push(velocity, stretch, depth, friction, power):
    """Work on the two bodies and change of what the spring holds, which was in the cone of another push before."""
    config, h = ContactConfig(2000.0, 2.0, friction, 0.001, 0.0002), 10.0**power
    normal, force, table, grip = np.array([0.0, 0.6, 0.8]), np.empty(6), contact_table(1, 2, 4), no_grip(1)
    springs = table.springs[0]
    springs[:3] = stretch - (stretch @ normal) * normal
    before = np.linalg.norm(springs[:3])
    arguments = normal, springs, velocity, force
    f = contact_force(config.law(), h, depth, 1.0, 0.0, *arguments)
    contact_force(config.law(), h, depth, 1.0, f, *arguments)
    table.count[0], table.share[0], table.push[0], table.normal[0], table.velocity[0] = 1, 1.0, f, normal, velocity
    remember(h, np.array([config.law()]), table, grip)
    along = force[:3] - f * normal
    assert f >= 0.0
    assert abs(along @ normal) <= 1e-9 * (1.0 + f)
    assert np.linalg.norm(along) <= friction * f * (1.0 + 1e-9) + 1e-12
    stored = 0.5 * SHEAR * 2000.0 * (np.linalg.norm(grip.springs[0, :3]) ** 2 - before**2)
    assert h * along @ velocity[:3] + stored <= 1e-9 * (1.0 + f)


@given(st.integers(1, 40), st.integers(0, 10_000), st.floats(0.0, 2.0))
@settings(max_examples=50, deadline=None)
def test_the_velocities_after_contact_are_the_same_from_any_start(count, seed, friction):
    random = np.random.default_rng(seed)
    table, laws = contact_table(count, 2, 4), np.array([ContactConfig(2e3, 2.0, friction, 1e-3, 2e-4).law()])
    table.count[0] = count
    table.depth[:] = random.uniform(-1e-4, 1e-3, count)
    table.springs[:] = random.uniform(-1e-4, 1e-4, (count, 7))
    table.share[:] = random.uniform(0.1, 1.0, count)
    table.normal[:] = random.standard_normal((count, 3))
    table.normal[:] /= np.linalg.norm(table.normal, axis=1, keepdims=True)
    table.jacobian[:] = 0.05 * random.standard_normal((count, 8, 6))
    for columns, arm in zip(table.jacobian, 0.05 * random.standard_normal((count, 3)), strict=True):
        object_columns.py_func(tuple(arm), 2, columns.T)
    table.one[:], table.other[:] = random.integers(0, 4, count), 4
    a, b = np.diag(random.uniform(1e-5, 1e-1, 14)), 1e-3 * random.standard_normal(14)
    ends = []
    for start in (np.zeros(14), random.standard_normal(14)):
        room = scratch(14, 5, count)
        room.island[:] = 0
        left, iterations = solve_contacts.py_func(
            a, b, start, 0, 1e-3, laws, table, room
        )  # its loops only: less to compile
        assert left <= VELOCITY_TOLERANCE
        assert iterations < NEWTON_LIMIT
        ends.append(start)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-5)


@given(st.integers(1, 14), st.integers(0, 10_000))
@settings(deadline=None)  # the first example compiles
def test_a_symmetric_positive_system_has_the_solution_numpy_finds(size, seed):
    random = np.random.default_rng(seed)
    root, right = random.standard_normal((size, size)), random.standard_normal(size)
    matrix = root @ root.T + 1e-3 * np.eye(size)
    solution = right.copy()
    assert solve_in_place(matrix.copy(), solution, np.zeros(size, int), 0, size)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-8 * np.linalg.cond(matrix))


@given(st.integers(1, 4), st.integers(0, 10_000))
@settings(deadline=None)
def test_an_arrow_of_fingers_around_an_object_is_solved_inside_its_envelope(coordinates, seed):
    random, fingers = np.random.default_rng(seed), 4 * coordinates
    size = fingers + 6
    first = np.where(np.arange(size) < fingers, np.arange(size) // coordinates * coordinates, 0)
    root = random.standard_normal((size, size))
    matrix = root @ root.T
    for f in range(4):  # fingers meet only the object
        block = slice(f * coordinates, (f + 1) * coordinates)
        matrix[block, :fingers][:, [j for j in range(fingers) if j // coordinates != f]] = 0.0
    matrix += 2.0 * size * np.eye(size)
    right = random.standard_normal(size)
    solution, lower = right.copy(), np.tril(matrix)
    lower[first[:, None] > np.arange(size)] = np.nan  # what is outside is not read
    assert solve_in_place(lower, solution, first, 0, size)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-9)


def test_a_matrix_that_is_not_positive_is_refused():
    assert not solve_in_place(np.diag([1.0, -1.0]), np.ones(2), np.zeros(2, int), 0, 2)
    assert not solve_in_place(np.full((2, 2), np.nan), np.ones(2), np.zeros(2, int), 0, 2)
