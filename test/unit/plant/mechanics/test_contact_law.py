"""Where a muscle touches, and with what force."""

import numpy as np
import pytest

from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.geometry.surfaces import BOX, CYLINDER, SPHERE, signed_distance
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.mechanics.contact_config import ContactConfig, ContactKind
from mbpam_ros.plant.mechanics.contact_law import contact_force, contact_slope, contact_table
from mbpam_ros.plant.mechanics.contact_search import (
    BALLS,
    Surroundings,
    _object_columns,
    contact_limit,
)
from mbpam_ros.plant.mechanics.contact_solver import _hessian, _push, _relative, _residual, scratch
from mbpam_ros.plant.mechanics.rod import build_rod
from mbpam_ros.plant.mechanics.step import State, System, advance, assemble, bind

GEOMETRY = load_gripper().geometry
ROD = build_rod(GEOMETRY, 1, 7, BALLS)
BASE = np.array([0.035, 0.035, 0.0])
CONFIG = ContactConfig(2000.0, 2.0, 0.6, 0.001, 0.0002, 2e-5, 1e-3)
NORMAL = np.array([0.6, 0.0, 0.8])
STEP_S = 1e-3


NO_PLANES = np.empty((0, 3))


def touches(bend, shape, half, centre, planes=NO_PLANES):
    """Depths, shares, points and normals of the contacts of one muscle of four: from a step too short to move it."""
    table = contact_table(contact_limit(4, len(planes)), 2)
    around = Surroundings(shape, np.array(half), planes, bool(len(planes)))
    bases = np.array([BASE, *np.full((3, 3), -9.0)])
    laws = np.array([CONFIG.law()] * 5)
    system = System(1e-12, 2, np.array([0.0, 0.0, 9.81]), bases, ROD, 0.02, 1.0, np.ones(3), around, laws)
    state = State(
        np.array([*bend, *np.zeros(6)]), np.zeros(8 if shape < 0 else 14), np.array(centre), np.array([0.0, 0, 0, 1])
    )
    parts = assemble(state, system, table)
    advance(bind(parts), np.zeros(2), np.zeros(2))
    used = np.flatnonzero(table.finger[: table.count[0]] == 0)
    arm = np.column_stack([table.jacobian[used, 7, 1], table.jacobian[used, 5, 2], table.jacobian[used, 6, 0]])
    return table.depth[used], table.share[used], arm + centre, table.normal[used]


def finely_sought_depth(bend, shape, half, centre):
    points = BASE + centreline(bend, GEOMETRY, np.linspace(0.0, 0.120, 481)) - centre
    return 0.010 - min(signed_distance(shape, half, *point)[0] for point in points)


def force_at(velocity, depth=2e-4, share=1.0):
    force = np.empty(6)
    f = contact_force(CONFIG.law(), STEP_S, depth, share, NORMAL, np.array(velocity, dtype=float), force)
    return f, force


@pytest.mark.parametrize("inward", [0.35, 0.5, 1.0, 1.6])
def test_the_deepest_contact_is_that_of_a_fine_search(inward):
    bend, half, centre = (-inward, -0.8 * inward), np.full(3, 0.03), np.array([0.001, 0.002, 0.085])
    depths, _, points, normals = touches(bend, SPHERE, half, centre)
    assert depths.max() == pytest.approx(finely_sought_depth(bend, SPHERE, half, centre), abs=5e-5)
    outward = (points - centre) / np.linalg.norm(points - centre, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, -outward, atol=1e-9)


@pytest.mark.parametrize("shape", [SPHERE, CYLINDER, BOX])
def test_a_contact_is_missed_by_half_the_spacing_of_the_balls_at_most(shape):
    random, half, touched = np.random.default_rng(1), np.full(3, 0.03), 0
    for _ in range(60):
        bend, centre = random.uniform(-3.0, 3.0, 2), BASE + random.uniform(-0.06, 0.06, 3)
        found = touches(bend, shape, half, centre)[0].max(initial=0.0)
        sought = max(finely_sought_depth(bend, shape, half, centre), 0.0)
        assert found - 1e-6 <= sought <= found + 0.5 * 0.120 / (BALLS - 1)
        touched += found > 0.0
    assert touched > 10


def test_force_hardly_depends_on_where_along_the_muscle_a_ball_is_pressed():
    depths, shares = np.full(3, 0.03), []
    for z in np.linspace(0.060, 0.065, 21):
        depth, share, *_ = touches((0.0, 0.0), SPHERE, depths, (-0.0046, 0.035, z))
        shares.append(depth @ share)
    assert np.ptp(shares) < 0.05 * np.mean(shares)


def test_the_centre_of_force_does_not_jump_where_a_muscle_turns_past_a_flat_face():
    centres, forces = [], []
    for tilt in np.linspace(-0.004, 0.004, 801):
        depth, share, points, _ = touches((tilt, 0.5), BOX, (0.01, 0.1, 0.1), (0.0151, 0.035, 0.06))
        forces.append(depth @ share)
        centres.append(depth * share @ points / forces[-1])
    assert np.ptp(np.array(centres)[:, 2]) > 0.005  # the force moves along the muscle
    assert np.abs(np.diff(centres, axis=0)).max() < 0.0003
    assert np.abs(np.diff(forces)).max() < 0.01 * np.max(forces)


def test_a_muscle_that_stands_on_its_tip_is_as_stiff_as_a_piece_of_its_radius():
    depth, share, _, normal = touches((0.0, 0.0), -1, np.zeros(3), np.zeros(3), np.array([[0.1298, np.inf, np.inf]]))
    np.testing.assert_allclose(depth, [2e-4], atol=1e-12)
    np.testing.assert_allclose(share, [1.0 + 0.5 * 0.120 / (BALLS - 1) / 0.010])
    np.testing.assert_array_equal(normal, [[0.0, 0.0, -1.0]])


def test_a_muscle_far_away_does_not_touch():
    assert not len(touches((0.5, 0.5), SPHERE, np.full(3, 0.03), np.array([0.0, 0.0, 0.085]))[0])


def test_a_body_that_leaves_is_not_pulled():
    f, force = force_at([*(1.0 * NORMAL), 0.0, 0.0, 0.0])
    assert f == 0.0
    assert not force.any()


@pytest.mark.parametrize("speed", [1e-6, 1e-5, 1e-3, 1.0])
def test_friction_opposes_slip_and_stays_within_coulombs_cone(speed):
    f, force = force_at([0.0, speed, 0.0, 0.0, 0.0, 0.0])
    assert force[:3] @ NORMAL == pytest.approx(f)
    assert force[1] == pytest.approx(-0.6 * f * speed / np.hypot(speed, 2e-5))


def test_resting_force_is_stiffness_times_depth_times_share():
    f, force = force_at(np.zeros(6), share=0.25)
    np.testing.assert_allclose(force, [*(0.1 * NORMAL), 0.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    "velocity",
    [[4e-6, 1e-5, -3e-6, 1e-4, 2e-4, 3e-4], [0.01, 0.02, -0.0075, 0.5, -0.2, 0.3]],
    ids=["sticking", "sliding and turning"],
)
def test_slope_is_the_derivative_of_the_force_and_symmetric_and_positive(velocity):
    velocity, slope = np.array(velocity), np.empty((2, 3, 3))
    f, _ = force_at(velocity)
    assert f > 0.0
    contact_slope(CONFIG.law(), STEP_S, 2e-4, 1.0, NORMAL, velocity, f, slope)
    whole = np.zeros((6, 6))
    whole[:3, :3], whole[3:, 3:] = slope
    for j in range(6):
        step = 1e-8 * np.eye(6)[j]
        expected = -(force_at(velocity + step)[1] - force_at(velocity - step)[1]) / 2e-8
        np.testing.assert_allclose(whole[:, j], expected, rtol=1e-4, atol=1e-4 * np.abs(whole).max())
    np.testing.assert_allclose(whole, whole.T, atol=1e-12)
    assert np.linalg.eigvalsh(whole).min() > -1e-9


@pytest.mark.parametrize("kind", [kind for kind in ContactKind if kind != ContactKind.OBJECT_PALM])
def test_the_solutions_derivative_is_that_of_its_equations(kind):
    random, coordinates, size = np.random.default_rng(kind), 4, 22
    table, laws = contact_table(1, coordinates), np.array([CONFIG.law()] * 5)
    table.count[0], table.kind[0], table.depth[0], table.share[0] = 1, kind, 2e-4, 0.5
    table.finger[0], table.other[0] = (
        (-1 if kind == ContactKind.OBJECT_SUPPORT else 1),
        (3 if kind == ContactKind.FINGER_FINGER else -1),
    )
    table.normal[0], table.jacobian[0] = NORMAL, 0.05 * random.standard_normal(table.jacobian[0].shape)
    if kind in (ContactKind.FINGER_OBJECT, ContactKind.OBJECT_SUPPORT):
        _object_columns.py_func((0.01, -0.02, 0.03), coordinates, table.jacobian[0].T)
    room, zero, v = scratch(size, coordinates, 4), np.zeros((size, size)), 1e-4 * random.standard_normal(size)
    room.first[:] = 0

    def residual(velocity):
        _relative.py_func(table, velocity, table.velocity)
        _push.py_func(STEP_S, laws, table, 0.0, room.trial)
        _residual.py_func(np.zeros(size), STEP_S, table, room.residual)
        return room.residual.copy()

    sought = np.column_stack([(residual(v + d) - residual(v - d)) / 2e-8 for d in 1e-8 * np.eye(size)])
    residual(v)
    _hessian.py_func(zero, STEP_S, laws, table, room)
    np.testing.assert_allclose(np.tril(room.hessian), np.tril(sought), atol=1e-5 * np.abs(sought).max())
    assert np.abs(sought).max() > 0.0


def test_negative_friction_is_refused():
    with pytest.raises(ValueError, match="friction_coefficient"):
        ContactConfig(2000.0, 2.0, -0.1, 0.001, 0.0, 2e-5, 1e-3)
