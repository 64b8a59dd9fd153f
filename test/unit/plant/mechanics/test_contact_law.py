"""Where a muscle touches, and with what force."""

import numpy as np
import pytest

from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.geometry.surfaces import BOX, CYLINDER, SPHERE, signed_distance
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.mechanics.contact_config import ContactConfig, ContactKind
from mbpam_ros.plant.mechanics.contact_law import (
    SHEAR,
    contact_force,
    contact_slope,
    contact_table,
    no_grip,
    recall,
    remember,
)
from mbpam_ros.plant.mechanics.contact_search import (
    BALLS,
    Surroundings,
    contact_limit,
)
from mbpam_ros.plant.mechanics.contact_solver import _gather, _hessian, _push, _relative, _residual, scratch
from mbpam_ros.plant.mechanics.object_contact import object_columns
from mbpam_ros.plant.mechanics.parts import System, assemble, new_state
from mbpam_ros.plant.mechanics.rod import build_rod
from mbpam_ros.plant.mechanics.step import advance, bind

pytestmark = pytest.mark.slow

GEOMETRY = load_gripper().geometry
ROD = build_rod(GEOMETRY, 1, 7, BALLS)
BASE = np.array([0.035, 0.035, 0.0])
CONFIG = ContactConfig(2000.0, 2.0, 0.6, 0.001, 0.0002)
NORMAL = np.array([0.6, 0.0, 0.8])
STEP_S = 1e-3
NOTHING_HELD = np.zeros(7)

NO_PLANES = np.empty((0, 3))


def touches(bend, shape, half, centre, planes=NO_PLANES):
    """Depths, shares, points and normals of the contacts of one muscle of four: from a step too short to move it."""
    table, there = contact_table(contact_limit(4, len(planes)), 2, 4), slice(0, int(shape >= 0))
    shapes, halves = np.array([shape])[there], np.array([half], float)[there]
    around = Surroundings(shapes, halves, planes, bool(len(planes)))
    bases = np.array([BASE, *np.full((3, 3), -9.0)])
    laws = np.array([CONFIG.law()] * 6)
    system = System(
        1e-12, 2, np.array([0.0, 0.0, 9.81]), bases, ROD, 0.02, np.ones(1)[there], np.ones((1, 3))[there], around, laws
    )
    rates, upright = np.zeros(8 if shape < 0 else 14), np.array([0.0, 0, 0, 1])
    state = new_state(
        table, np.array([*bend, *np.zeros(6)]), rates, np.array([centre], float)[there], np.array([upright])[there]
    )
    parts = assemble(state, system, table)
    advance(bind(parts), np.zeros(2), np.zeros(2))
    used = np.flatnonzero(table.one[: table.count[0]] == 0)
    arm = np.column_stack([table.jacobian[used, 7, 1], table.jacobian[used, 5, 2], table.jacobian[used, 6, 0]])
    return table.depth[used], table.share[used], arm + centre, table.normal[used]


def finely_sought_depth(bend, shape, half, centre):
    points = BASE + centreline(bend, GEOMETRY, np.linspace(0.0, 0.120, 481)) - centre
    return 0.010 - min(signed_distance(shape, half, *point)[0] for point in points)


def force_at(velocity, depth=2e-4, share=1.0, load=None, springs=NOTHING_HELD, step_s=STEP_S):
    """f and the force of a contact whose friction is bounded by ``load``, by default by f itself."""
    law, force, velocity = CONFIG.law(), np.empty(6), np.array(velocity, dtype=float)
    f = contact_force(law, step_s, depth, share, 0.0, NORMAL, springs, velocity, force)
    contact_force(law, step_s, depth, share, f if load is None else load, NORMAL, springs, velocity, force)
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


@pytest.mark.parametrize("depth", [-1e-4, 0.0, 2e-4])
@pytest.mark.parametrize("speed", [1e-6, 1e-3, 1.0])
def test_friction_opposes_slip_and_stays_within_coulombs_cone(speed, depth):
    f, force = force_at([-0.3 * 0.6, speed, -0.3 * 0.8, 0.0, 0.0, 0.0], depth)  # while it closes at 0.3 m/s
    assert f > 0.0
    assert force[:3] @ NORMAL == pytest.approx(f)
    spring = SHEAR * (CONFIG.stiffness_n_m * STEP_S + CONFIG.damping_n_s_m) * speed
    assert force[1] == pytest.approx(-min(0.6 * f, spring))


def test_a_gap_pushes_only_if_it_closes_within_the_step_and_as_much_as_touching_in_the_limit():
    def pushing(gap):
        return force_at([*(-0.3 * NORMAL), 0.0, 0.0, 0.0], -gap)[0]

    assert pushing(0.3 * STEP_S * (1.0 + 1e-9)) == 0.0
    assert pushing(0.3 * STEP_S * 0.99) > 0.0
    assert pushing(1e-12) == pytest.approx(pushing(0.0), rel=1e-6)


@pytest.mark.parametrize("step_s", [1e-5, 1e-3, 1e-2])
def test_what_slips_holds_a_spring_at_the_cone_and_what_sticks_gives_back_what_was_put_in(step_s):
    """Drawn 0.5 mm aside, under a push of 0.4 N: at most mu f; let go, the spring has its stretch at the cone."""
    law, laws, table, grip = CONFIG.law(), np.array([CONFIG.law()] * 6), contact_table(1, 2, 4), no_grip(1)
    table.count[0], table.depth[0], table.share[0], table.normal[0] = 1, 2e-4, 1.0, NORMAL
    stretched, work, velocity = [], 0.0, np.array([0.0, 5e-3, 0.0, 0.0, 0.0, 0.0])
    for _ in range(round(1e-1 / step_s)):
        recall.py_func(grip, table)
        f, force = force_at(velocity, springs=table.springs[0], step_s=step_s)
        table.push[0], table.velocity[0] = f, velocity
        remember.py_func(step_s, laws, table, grip)
        stretched.append(grip.springs[0, 1])
        work -= force[1] * velocity[1] * step_s
    cone = 0.6 * 0.4 / (SHEAR * CONFIG.stiffness_n_m)
    assert f == pytest.approx(0.4) and -force[1] == pytest.approx(0.6 * f)
    assert np.diff(stretched).min() > -1e-15 and stretched[-1] == pytest.approx(cone)
    assert work > 0.6 * f * (5e-4 - cone)  # of the slip; and the spring's
    table.count[0] = 0
    remember.py_func(step_s, laws, table, grip)
    table.count[0] = 1
    recall.py_func(grip, table)
    assert not table.springs.any()  # a contact that was lost for a step is a new one
    assert law.patch == pytest.approx(0.0015)


def test_resting_force_is_stiffness_times_depth_times_share():
    f, force = force_at(np.zeros(6), share=0.25)
    np.testing.assert_allclose(force, [*(0.1 * NORMAL), 0.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("depth", [-1e-6, 2e-4])
@pytest.mark.parametrize(
    "velocity",
    [[-4e-3, 1e-5, -3e-3, 1e-4, 2e-4, 3e-4], [-0.006, 0.12, -0.0075, 15.0, -12.0, 10.3]],
    ids=["sticking", "sliding and turning"],
)
def test_slope_is_the_derivative_of_the_force_and_symmetric_and_positive(velocity, depth):
    velocity, slope = np.array(velocity), np.empty((2, 3, 3))
    springs = np.array([8e-6, 1e-6, -6e-6, 8e-5, 1e-5, -6e-5, 1e-4])
    f, _ = force_at(velocity, depth)
    assert f > 0.0
    contact_slope(CONFIG.law(), STEP_S, depth, 1.0, f, NORMAL, springs, velocity, slope)
    whole = np.zeros((6, 6))
    whole[:3, :3], whole[3:, 3:] = slope
    for j in range(6):
        step = 1e-7 * np.eye(6)[j]
        ends = [force_at(velocity + sign * step, depth, load=f, springs=springs)[1] for sign in (1.0, -1.0)]
        expected = (ends[1] - ends[0]) / 2e-7
        for part in (slice(0, 3), slice(3, 6)):
            np.testing.assert_allclose(
                whole[part, j], expected[part], rtol=1e-4, atol=1e-5 * np.abs(slope[j // 3]).max()
            )
    np.testing.assert_allclose(whole, whole.T, atol=1e-12)
    assert np.linalg.eigvalsh(whole).min() > -1e-9


@pytest.mark.parametrize("kind", [kind for kind in ContactKind if kind != ContactKind.OBJECT_PALM])
def test_the_solutions_derivative_is_that_of_its_equations(kind):
    random, coordinates, size = np.random.default_rng(kind), 4, 28
    table, laws = contact_table(1, coordinates, 4, 2), np.array([CONFIG.law()] * 6)
    table.count[0], table.kind[0], table.depth[0], table.share[0] = 1, kind, 2e-4, 0.5
    table.one[0], table.other[0] = {
        ContactKind.FINGER_OBJECT: (1, 5),
        ContactKind.OBJECT_SUPPORT: (-1, 4),
        ContactKind.FINGER_SUPPORT: (2, -1),
        ContactKind.FINGER_FINGER: (1, 3),
        ContactKind.OBJECT_OBJECT: (4, 5),
    }[kind]
    table.load[0], table.normal[0], table.jacobian[0] = (
        0.3,
        NORMAL,
        0.05 * random.standard_normal(table.jacobian[0].shape),
    )
    if kind in (ContactKind.FINGER_OBJECT, ContactKind.OBJECT_SUPPORT):
        object_columns.py_func((0.01, -0.02, 0.03), coordinates, table.jacobian[0].T)
    room, zero, v = scratch(size, 6, 1), np.zeros((size, size)), 1e-4 * random.standard_normal(size)
    room.island[:], room.smooth[:] = 0, 0.0
    n, count = _gather.py_func(zero, table, 0, room)
    assert (n, count) == (size, 1)

    def residual(velocity):
        _relative.py_func(table, 1, room, velocity, table.velocity)
        _push.py_func(STEP_S, laws, table, 1, room, 0.0)
        _residual.py_func(size, STEP_S, table, 1, room)
        return room.residual.copy()

    sought = np.column_stack([(residual(v + d) - residual(v - d)) / 2e-8 for d in 1e-8 * np.eye(size)])
    residual(v)
    _hessian.py_func(size, STEP_S, laws, table, 1, room)
    inside = np.arange(size) >= room.first[:, None]
    assert not np.tril(sought)[~inside].any()
    np.testing.assert_allclose(np.tril(room.hessian)[inside], np.tril(sought)[inside], atol=1e-5 * np.abs(sought).max())
    assert np.abs(sought).max() > 0.0


def test_negative_friction_is_refused():
    with pytest.raises(ValueError, match="friction_coefficient"):
        ContactConfig(2000.0, 2.0, -0.1, 0.001, 0.0)
