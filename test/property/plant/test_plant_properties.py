"""What holds for any solid, any muscle and any contact."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.contact import contact_force, contact_table
from mbpam_ros.plant.contact_config import ContactConfig
from mbpam_ros.plant.contact_solver import NEWTON_LIMIT, VELOCITY_TOLERANCE, solve_contacts, solve_in_place
from mbpam_ros.plant.finger import Muscle, inertia_and_load, mass_nodes
from mbpam_ros.plant.shapes import BOX, CYLINDER, SPHERE, signed_distance

MUSCLE = Muscle(0.015, 0.100, 0.010)
NODES = mass_nodes(load_gripper().geometry)
coordinate = st.floats(-0.2, 0.2)
points = st.tuples(coordinate, coordinate, coordinate)
halves = st.tuples(st.floats(0.005, 0.1), st.floats(0.005, 0.1), st.floats(0.005, 0.1)).map(np.array)
bends = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
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


@given(bends, bends)
@settings(deadline=None)  # the first example compiles
def test_the_mass_matrix_is_positive_and_the_same_in_every_azimuth(bend, rate):
    mxx, mxy, myy, *_ = inertia_and_load(*bend, *rate, MUSCLE, NODES, 9.81)
    assert np.linalg.eigvalsh([[mxx, mxy], [mxy, myy]]).min() > 0.0
    turned = inertia_and_load(-bend[1], bend[0], -rate[1], rate[0], MUSCLE, NODES, 9.81)
    np.testing.assert_allclose([turned[2], -turned[1], turned[0]], [mxx, mxy, myy], atol=1e-15)


velocities = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


@given(velocities, st.floats(0.0, 1e-3), st.floats(0.0, 1.0))
@settings(deadline=None)  # the first example compiles
def test_contact_takes_energy_and_stays_within_the_friction_cone_of_its_load(velocity, depth, friction):
    config = ContactConfig(2000.0, 2.0, friction, 0.001, 0.0002, 2e-5, 1e-3)
    normal, force = np.array([0.0, 0.6, 0.8]), np.empty(6)
    f = contact_force(config.law(), 1e-3, depth, 1.0, normal, velocity, force)
    along = force[:3] - f * normal
    assert f >= 0.0
    assert abs(along @ normal) <= 1e-9 * (1.0 + f)
    assert np.linalg.norm(along) <= friction * 2000.0 * depth * (1.0 + 1e-9) + 1e-12
    assert along @ velocity[:3] <= 1e-9 * (1.0 + f)
    assert force[3:] @ velocity[3:] <= 1e-12


@given(st.integers(1, 40), st.integers(0, 10_000), st.floats(0.0, 2.0))
@settings(max_examples=50, deadline=None)
def test_the_velocities_after_contact_are_the_same_from_any_start(count, seed, friction):
    random = np.random.default_rng(seed)
    table, laws = contact_table(count), np.array([ContactConfig(2e3, 2.0, friction, 1e-3, 2e-4, 2e-5, 1e-3).law()])
    table.count[0] = count
    table.depth[:] = random.uniform(0.0, 1e-3, count)
    table.share[:] = random.uniform(0.1, 1.0, count)
    table.normal[:] = random.standard_normal((count, 3))
    table.normal[:] /= np.linalg.norm(table.normal, axis=1, keepdims=True)
    table.jacobian[:] = 0.05 * random.standard_normal((count, 6, 8))
    table.finger[:] = random.integers(0, 4, count)
    a, b = np.diag(random.uniform(1e-5, 1e-1, 14)), 1e-3 * random.standard_normal(14)
    ends = []
    for start in (np.zeros(14), random.standard_normal(14)):
        left, iterations = solve_contacts.py_func(a, b, start, 1e-3, laws, table)  # only its loops: less to compile
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
    assert solve_in_place(matrix.copy(), solution)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-8 * np.linalg.cond(matrix))


def test_a_matrix_that_is_not_positive_is_refused():
    assert not solve_in_place(np.diag([1.0, -1.0]), np.ones(2))
    assert not solve_in_place(np.full((2, 2), np.nan), np.ones(2))
