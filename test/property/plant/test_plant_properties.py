"""What holds for any solid, any muscle and any contact."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.contact import deepest_near, force_law, may_touch, sample_distances
from mbpam_ros.plant.contact_config import ContactConfig
from mbpam_ros.plant.finger import STATIONS, inertia_and_load, mass_nodes, station
from mbpam_ros.plant.multibody import solve_in_place
from mbpam_ros.plant.shapes import BOX, CYLINDER, SPHERE, signed_distance

MUSCLE = np.array([0.015, 0.100, 0.010])
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


@given(bends, points)
@settings(max_examples=50, deadline=None)
def test_no_sampled_point_of_a_muscle_is_deeper_in_a_sphere_than_the_deepest_by_more_than_the_search_allows(
    bend, centre
):
    half, centre = np.full(3, 0.03), np.array(centre)
    place, distances, found = (np.zeros(3), SPHERE, half, centre, np.eye(3)), np.empty(STATIONS), np.empty(7)
    spacing = sample_distances(*bend, MUSCLE, *place, found, distances)
    near = [k for k in range(STATIONS) if may_touch(distances, k, 0.010, spacing)]
    depth = max((deepest_near(*bend, MUSCLE, *place, k, spacing, found)[0] for k in near), default=0.0)
    sampled = max(
        0.010 - signed_distance(SPHERE, half, *(np.array(station(*bend, MUSCLE, s)[:3]) - centre))[0]
        for s in np.linspace(0.0, 0.120, 241)
    )
    # Two nearly equal minima a sample apart may be confused; by 1 mm at most at 9 mm between samples.
    assert sampled <= max(depth, 0.0) + 1e-3


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
def test_contact_takes_energy_and_stays_within_the_friction_cone(velocity, depth, friction):
    config = ContactConfig(2000.0, 2.0, friction, 0.001, 0.0002, 2e-5, 1e-3)
    normal, force = np.array([0.0, 0.6, 0.8]), np.empty(6)
    f = force_law(config.law(), depth, 1e-3, normal, velocity, -1.0, force)
    along = force[:3] - f * normal
    assert f >= 0.0
    assert abs(along @ normal) <= 1e-9 * (1.0 + f)
    assert np.linalg.norm(along) <= friction * f * (1.0 + 1e-9) + 1e-12
    assert along @ velocity[:3] <= 1e-9 * (1.0 + f)
    assert force[3:] @ velocity[3:] <= 1e-12


@given(st.integers(1, 14), st.integers(0, 10_000))
@settings(deadline=None)  # the first example compiles
def test_elimination_solves_what_numpy_solves(size, seed):
    random = np.random.default_rng(seed)
    matrix, right = random.standard_normal((size, size)) + 3.0 * np.eye(size), random.standard_normal(size)
    solution = right.copy()
    assert solve_in_place(matrix.copy(), solution, size)
    np.testing.assert_allclose(matrix @ solution, right, atol=1e-8 * np.linalg.cond(matrix))
