"""Several objects in a scene: they push each other, rest on each other, and cost nothing to what they do not touch."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.configuration import load_config
from mbpam_ros.geometry.rotations import about_z, product, rotation_matrix
from mbpam_ros.geometry.solids import distance_m, half_height, principal_inertia
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

pytestmark = pytest.mark.slow

GRIPPER = load_gripper()
CONFIG = load_config(PlantConfig, "plant.yaml")
INWARD = -GRIPPER.finger_base_m[:, :2] / np.linalg.norm(GRIPPER.finger_base_m[:, :2], axis=1, keepdims=True)
STIFFNESS = np.full(4, 1.5e-3)  # N m2
HANGING, CLOSED = (Actuation(share * 0.035 * INWARD, STIFFNESS) for share in (0.0, 1.0))
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
BULB = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), UPRIGHT)
STAND = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
SPACE = np.empty((0, 3))
SIZES = {"sphere": (0.05, 0.05, 0.05), "cylinder": (0.04, 0.04, 0.06), "box": (0.05, 0.04, 0.03)}
MASS_KG = 0.05


def still(count):
    return np.zeros(count + 1), np.zeros(count + 1)


def tier_of(bodies, step_s=2e-3, planes=SPACE, gravity=0.0, name="arc", config=CONFIG):
    setup = TierSetup(
        GRIPPER.geometry, GRIPPER.finger_base_m, gravity, bodies[0] if bodies else None, planes, config, True,
        others=tuple(bodies[1:]),
    )  # fmt: skip
    tier = build_tier(setup, Fidelity(name, 3 if name == "rod" else 1, step_s))
    tier.reset(HANGING)
    return tier


def body(shape, position_m, velocity_m_s=(0.0, 0.0, 0.0), spin_rad_s=(0.0, 0.0, 0.0), turn=UPRIGHT, size_m=None):
    return RigidBody(
        shape, size_m or SIZES[shape], MASS_KG, np.array(position_m, float), np.array(turn), velocity_m_s, spin_rad_s
    )


def momentum(bodies, states):
    """Linear and angular momentum about the origin, and kinetic energy."""
    linear, angular, energy = np.zeros(3), np.zeros(3), 0.0
    for each, state in zip(bodies, states, strict=True):
        turn = rotation_matrix(state.orientation_xyzw)
        spin = turn @ (
            principal_inertia(each.shape, each.size_m, each.mass_kg) * (turn.T @ state.angular_velocity_rad_s)
        )
        moved = each.mass_kg * state.velocity_m_s
        linear += moved
        angular += np.cross(state.position_m, moved) + spin
        energy += 0.5 * (moved @ state.velocity_m_s + spin @ state.angular_velocity_rad_s)
    return linear, angular, energy


def test_two_balls_rebound_as_a_damped_spring_between_them_does():
    """T. Schwager and T. Poeschel, "Coefficient of restitution and linear-dashpot model revisited", 2007, Eq. 17."""
    law = CONFIG.object_support
    balls = [body("sphere", (1.0, 0.0, 1.0), (0.2, 0.0, 0.0)), body("sphere", (1.0501, 0.0, 1.0), (-0.2, 0.0, 0.0))]
    omega_2, beta = 2.0 * law.stiffness_n_m / MASS_KG, law.damping_n_s_m / MASS_KG
    omega = math.sqrt(omega_2 - beta**2)
    expected = math.exp(-beta / omega * (math.pi - math.atan2(2.0 * beta * omega, omega**2 - beta**2)))
    found = []
    for step_s in (4e-5, 2e-5):
        tier = tier_of(balls, step_s)
        tier.step(HANGING, *still(round(0.01 / step_s)))
        one, other = tier.state().bodies
        np.testing.assert_allclose(one.velocity_m_s, -other.velocity_m_s, atol=1e-9)
        found.append(other.velocity_m_s[0] / 0.2)
    assert found[1] == pytest.approx(expected, rel=0.03)
    assert abs(found[1] - expected) < 0.6 * abs(found[0] - expected)


@pytest.mark.parametrize(("one", "other"), [("box", "box"), ("box", "cylinder"), ("cylinder", "cylinder")])
def test_what_collides_in_space_keeps_its_momentum_and_gains_no_energy(one, other):
    askew = product(about_z(0.4), (0.3, 0.1, 0.0, math.sqrt(0.9)))
    bodies = [
        body(one, (1.0, 0.0, 1.0), (0.3, 0.0, 0.0), (1.0, -2.0, 3.0), askew),
        body(other, (1.08, 0.012, 0.992), (-0.3, 0.0, 0.0), (0.0, 3.0, -1.0)),
    ]
    tier = tier_of(bodies, 1e-4)
    linear, angular, energy = momentum(bodies, tier.state().bodies)
    touched = 0
    for _ in range(80):
        tier.step(HANGING, *still(10))
        state = tier.state()
        touched += bool(state.body_forces[0].objects_n.any())
        now = momentum(bodies, state.bodies)
        np.testing.assert_allclose(state.body_forces[0].objects_n, -state.body_forces[1].objects_n)
        np.testing.assert_allclose(now[0], linear, atol=1e-12)
        np.testing.assert_allclose(now[1], angular, atol=1e-3 * np.linalg.norm(angular))
        assert now[2] < energy * (1.0 + 1e-6)
    assert touched
    assert now[2] < 0.95 * energy


def test_the_order_in_which_objects_are_named_changes_nothing():
    bodies = [
        body("box", (1.0, 0.0, 1.0), (0.3, 0.0, 0.0), (1.0, -2.0, 3.0)),
        body("cylinder", (1.07, 0.01, 1.0), (-0.3, 0.0, 0.0)),
        body("sphere", (1.0, 0.06, 1.0), (0.0, -0.4, 0.0)),
    ]
    ends = []
    for order in ((0, 1, 2), (2, 0, 1)):
        tier = tier_of([bodies[k] for k in order], 1e-3)
        tier.step(HANGING, *still(60))
        states = dict(zip(order, tier.state().bodies, strict=True))
        ends.append(np.concatenate([[*states[k].position_m, *states[k].orientation_xyzw] for k in range(3)]))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-7)


@pytest.mark.parametrize("step_s", [5e-4, 2e-3, 1e-2])
def test_a_pile_of_eight_stands_still_and_each_carries_what_is_above_it(step_s):
    """A column of four, two that lean on nothing beside it, a box across two boxes."""
    table = np.array([[0.3, np.inf, np.inf]])
    column = [("box", (0.06, 0.05, 0.02)), ("cylinder", (0.04, 0.04, 0.03)), ("box", (0.04, 0.04, 0.02))]
    bodies, top = [], 0.3
    for shape, size in [*column, ("sphere", (0.03,) * 3)]:
        top -= 0.5 * size[2]
        bodies.append(body(shape, (0.2, 0.0, top), size_m=size))
        top -= 0.5 * size[2]
    for x in (-0.22, -0.16):
        bodies.append(body("box", (x, 0.0, 0.28), size_m=(0.03, 0.03, 0.04)))
    bodies.append(body("box", (-0.19, 0.0, 0.25), size_m=(0.08, 0.02, 0.02)))
    bodies.append(body("cylinder", (0.0, 0.2, 0.27)))
    tier = tier_of(bodies, step_s, table, GRAVITY_M_S2)
    tier.step(HANGING, *still(round(1.0 / step_s)))
    start = tier.state()
    tier.step(HANGING, *still(round(1.0 / step_s)))
    end, weight_n = tier.state(), MASS_KG * GRAVITY_M_S2
    for before, after in zip(start.bodies, end.bodies, strict=True):
        np.testing.assert_allclose(after.position_m, before.position_m, atol=1e-8)
    for there, each in zip(bodies, end.bodies, strict=True):
        np.testing.assert_allclose(each.position_m, there.position_m, atol=3e-4)
    for k, forces in enumerate(end.body_forces):
        np.testing.assert_allclose(forces.support_n + forces.objects_n, (0.0, 0.0, -weight_n), atol=1e-5)
        carried = {0: 4, 4: 1.5, 5: 1.5, 7: 1}.get(k, 0)
        assert -forces.support_n[2] == pytest.approx(carried * weight_n, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("step_s", [5e-4, 2e-3])
def test_a_box_that_slides_on_a_box_stops_after_the_way_that_friction_gives_it(step_s):
    """v^2 / (2 mu g); the lower one is held by the friction of its own weight."""
    lower = dataclasses.replace(body("box", (0.3, 0.0, 0.29), size_m=(0.3, 0.2, 0.02)), mass_kg=1.0)
    upper = body("box", (0.25, 0.0, 0.27), (0.5, 0.0, 0.0), size_m=(0.04, 0.04, 0.02))
    tier = tier_of([lower, upper], step_s, np.array([[0.3, np.inf, np.inf]]), GRAVITY_M_S2)
    tier.step(HANGING, *still(round(0.5 / step_s)))
    below, above = tier.state().bodies
    way_m = 0.5**2 / (2.0 * CONFIG.object_support.friction_coefficient * GRAVITY_M_S2)
    assert above.position_m[0] - 0.25 == pytest.approx(way_m, rel=0.02)
    assert np.linalg.norm(above.velocity_m_s) < 1e-6
    np.testing.assert_allclose(below.position_m[:2], lower.position_m[:2], atol=1e-4)


@pytest.mark.parametrize("step_s", [5e-4, 2e-3, 1e-2])
@pytest.mark.parametrize("speed_m_s", [1.0, 6.0])
@pytest.mark.parametrize("struck", ["sphere", "box", "cylinder"])
def test_nothing_passes_through_another_object_without_an_error(step_s, speed_m_s, struck):
    """A ball, and a box edge first, shot in space at something heavy: a ball, a plate of 4 mm, a disc of 4 mm."""
    size = {"sphere": (0.05,) * 3, "box": (0.06, 0.06, 0.004), "cylinder": (0.06, 0.06, 0.004)}[struck]
    wall = dataclasses.replace(body(struck, (1.0, 0.0, 1.0), size_m=size), mass_kg=50.0)
    edge_first = product(about_z(0.3), (math.sin(0.35), 0.0, 0.0, math.cos(0.35)))
    for shape, turn in (("sphere", UPRIGHT), ("box", edge_first)):
        shot, touched = body(shape, (1.004, 0.003, 0.9), (0.0, 0.0, speed_m_s), turn=turn), False
        tier = tier_of([wall, shot], step_s)
        try:
            for _ in range(round(0.3 / step_s)):
                tier.step(HANGING, *still(1))
                state = tier.state()
                there, flying = state.bodies
                touched = touched or bool(state.body_forces[1].objects_n.any())
                apart = (flying.position_m - there.position_m) @ rotation_matrix(there.orientation_xyzw)
                assert distance_m(struck, size, apart[None])[0] > 0.011  # its half thickness is 15 mm, rounded by 2
                assert apart[2] < 0.0 or np.hypot(*apart[:2]) > 0.03
        except PlantDivergedError as error:
            assert "pushed into something else" in str(error)
        else:
            assert touched


@pytest.mark.parametrize("name", ["arc", "rod"])
def test_objects_far_away_change_no_bit_of_a_grasp(name):
    far = [
        body("box", (0.4, 0.0, 0.3)),
        body("box", (0.4, 0.0, 0.27)),
        body("sphere", (0.5, 0.3, 0.2)),  # falls
        body("cylinder", (-0.5, 0.0, 0.285), (0.3, 0.0, 0.0)),  # slides
    ]
    alone, beside = (
        tier_of([BULB], 2e-3, STAND, GRAVITY_M_S2, name),
        tier_of([BULB, *far], 2e-3, STAND, GRAVITY_M_S2, name),
    )
    for _ in range(4):
        for each in (alone, beside):
            each.step(CLOSED, *still(50))
    for _ in range(2):
        for each in (alone, beside):
            each.step(CLOSED, np.linspace(0.0, 0.01, 51), np.full(51, 0.1))
    one, other = alone.state(), beside.state()
    assert one.finger_force_n.any()
    assert np.abs(other.bodies[3].position_m - far[2].position_m).max() > 0.05
    for part in ("centreline_m", "bend_rate_rad_s", "finger_force_n", "support_force_n"):
        np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
    np.testing.assert_array_equal(one.body.position_m, other.body.position_m)
    np.testing.assert_array_equal(one.body.orientation_xyzw, other.body.orientation_xyzw)


def test_a_finger_pushes_one_object_against_another():
    """Finger 1 on a box, that on a heavier one, which its stand's friction holds."""
    size = (0.02, 0.06, 0.04)
    near = body("box", (0.007, 0.035, 0.095), size_m=size)
    behind = dataclasses.replace(body("box", (-0.0131, 0.035, 0.095), size_m=size), mass_kg=1.0)
    tier = tier_of([near, behind], 2e-3, np.array([[0.115, 0.1, 0.1], [0.315, np.inf, np.inf]]), GRAVITY_M_S2, "rod")
    push = Actuation(np.array([[-0.02, 0.0], *np.zeros((3, 2))]), STIFFNESS)
    tier.step(push, *still(300))
    tier.step(push, *still(300))
    state = tier.state()
    one, other = state.body_forces
    assert one.finger_n[0, 0] < -0.02 and not other.finger_n.any()
    np.testing.assert_allclose(one.objects_n, -other.objects_n, atol=1e-12)
    assert one.objects_n[0] > 0.01
    for forces, each in ((one, near), (other, behind)):
        total = forces.finger_n.sum(axis=0) + forces.support_n + forces.objects_n
        np.testing.assert_allclose(total, (0.0, 0.0, -each.mass_kg * GRAVITY_M_S2), atol=1e-4)


@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_the_push_of_two_solids_is_continuous_in_their_pose(shape):
    """One turns over on the edge of the other; both are held still, so steps are too short to move them."""
    lower, upper = body("box", (1.0, 0.0, 1.0)), body(shape, (1.0, 0.012, 0.9))
    tier, pushes = tier_of([lower, upper], 1e-9), []
    there = tier._parts.state
    for angle in np.linspace(-0.3, 0.05, 1401):
        turn = (math.sin(0.5 * angle), 0.0, 0.0, math.cos(0.5 * angle))
        there.position[:] = lower.position_m, (1.0, 0.012, 0.985 - half_height(shape, SIZES[shape], turn) + 3e-4)
        there.orientation[:] = UPRIGHT, turn
        there.velocity[:], there.held[0] = 0.0, 0
        tier.step(HANGING, *still(1))
        pushes.append(tier.state().body_forces[1].objects_n)
    size = np.linalg.norm(pushes, axis=1)
    assert (size > 0.0).sum() > 200
    assert np.abs(np.diff(pushes, axis=0)).max() < 0.05 * size.max()
