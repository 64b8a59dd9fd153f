"""Fingers that press on each other: balance, action and reaction, symmetry, and nothing where they do not meet."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.actuator.equilibrium import gravity_gradient_n_m
from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
GEOMETRY, BASES = GRIPPER.geometry, GRIPPER.finger_base_m
CONFIG = load_config(PlantConfig, "plant.yaml")
STIFFNESS = 1.5e-3  # N m2
INWARD = -BASES[:, :2] / np.linalg.norm(BASES[:, :2], axis=1, keepdims=True)
BULB = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), np.array([0.0, 0.0, 0.0, 1.0]))
STAND = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
NO_PLANES = np.empty((0, 3))
TIERS = [("arc", 1), ("rod", 3)]
LAST_BALL_M = GEOMETRY.length_m - GEOMETRY.outer_radius_m  # centre of the rounded tip


def pressed(name, modes, moment, step_s=1e-3, duration_s=1.5, touch=True, body=None, config=CONFIG):
    """Tier after the moments were raised in 0.3 s and held."""
    planes = NO_PLANES if body is None else STAND
    tier = build_tier(TierSetup(GEOMETRY, BASES, 9.81, body, planes, config, touch), Fidelity(name, modes, step_s))
    none, full = (Actuation(share * np.array(moment), np.full(4, STIFFNESS)) for share in (0.0, 1.0))
    tier.reset(none)
    for length_s in (0.3, duration_s):
        still = np.zeros(round(length_s / step_s) + 1)
        tier.step(full, still, still)
    return tier


def opposite(strength_n_m):
    """Moments of fingers 1 and 3 toward each other."""
    return np.where([[True], [False], [True], [False]], strength_n_m * INWARD, 0.0)


def ball_centres(tier):
    """Of the swept spheres, shape (4, n, 3)."""
    return tier._parts.system.rod.balls @ np.moveaxis(tier._motion.tangent, -1, 0) + BASES[:, None]


def distance_m(tier, one, other):
    """Smallest distance of two centrelines, sought on pieces of 0.05 mm."""
    lines = ball_centres(tier)
    share = np.linspace(0.0, 1.0, 50, endpoint=False)[None, :, None]
    fine = [
        np.vstack([(line[:-1, None] * (1 - share) + line[1:, None] * share).reshape(-1, 3), line[-1:]])
        for line in lines[[one, other]]
    ]
    return min(np.linalg.norm(fine[1] - point, axis=1).min() for point in fine[0][::5])


@pytest.mark.parametrize(("name", "modes"), TIERS)
@pytest.mark.parametrize("step_s", [1e-3, 1e-2])
def test_two_tips_pressed_on_each_other_rest_as_deep_as_their_stiffness_says(name, modes, step_s):
    tier = pressed(name, modes, opposite(0.03), step_s)
    force = tier.state().between_fingers_force_n
    push = np.linalg.norm(force[0])
    assert 0.1 < push < 0.5
    np.testing.assert_allclose(force[0] / push, [*-INWARD[0], 0.0], atol=1e-6)
    tip = tier._parts.system.rod.spacing / 2 / GEOMETRY.outer_radius_m + 1.0  # the rounded end, in lengths of a radius
    depth = push / (CONFIG.finger_finger.stiffness_n_m * tip)
    assert distance_m(tier, 0, 2) == pytest.approx(2.0 * GEOMETRY.outer_radius_m - depth, abs=2e-6)
    assert np.abs(tier.state().bend_rate_rad_s).max() < 1e-3


@pytest.mark.parametrize(("name", "modes"), TIERS)
def test_action_is_reaction_to_rounding_where_many_fingers_meet_and_slide(name, modes):
    moment = 0.035 * INWARD + [[0.004, 0.0], [0.0, 0.002], [-0.003, 0.001], [0.0, 0.0]]
    for duration_s in (0.01, 0.1, 1.0):
        force = pressed(name, modes, moment, duration_s=duration_s).state().between_fingers_force_n
        assert np.abs(force).max() > 0.01
        assert np.abs(force.sum(axis=0)).max() < 1e-15


def test_each_of_two_pressed_arcs_is_in_balance_by_virtual_work():
    """Moment, bending, gravity and the push at the tip's centre, its path by differences of the arc's own formula."""
    moment = opposite(0.03)
    state = pressed("arc", 1, moment).state()
    for f in (0, 2):
        bend, path = state.bend_rad[f], []
        for nudge in 1e-6 * np.eye(2):
            ends = [centreline(bend + sign * nudge, GEOMETRY, np.array([LAST_BALL_M]))[0] for sign in (1.0, -1.0)]
            path.append((ends[0] - ends[1]) / 2e-6)
        work = np.array(path) @ state.between_fingers_force_n[f]
        left = moment[f] - STIFFNESS / GEOMETRY.active_length_m * bend - gravity_gradient_n_m(bend, GEOMETRY) + work
        assert np.linalg.norm(work) > 0.2 * np.linalg.norm(moment[f])
        assert np.linalg.norm(left) < 1e-3 * np.linalg.norm(moment[f])


@pytest.mark.parametrize(("name", "modes"), TIERS)
def test_crossed_fingers_touch_where_a_fine_search_finds_them_and_rub_within_coulombs_cone(name, modes):
    moment = np.array([[-0.04, -0.012], [0.012, -0.04], [0.0, 0.0], [0.0, 0.0]])
    tier = pressed(name, modes, moment, duration_s=0.5)
    table = tier._parts.contacts
    used = slice(0, int(table.count[0]))
    assert used.stop > 0
    assert set(zip(table.one[used], table.other[used], strict=True)) == {(0, 1)}
    deepest = table.depth[used].max()
    assert 2.0 * GEOMETRY.outer_radius_m - distance_m(tier, 0, 1) == pytest.approx(deepest, abs=5e-5)
    force, normal, push = table.force[used, :3], table.normal[used], table.push[used]
    load = CONFIG.finger_finger.stiffness_n_m * table.share[used] * table.depth[used]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-12)
    rubbing = np.linalg.norm(force - push[:, None] * normal, axis=1)
    assert (rubbing <= CONFIG.finger_finger.friction_coefficient * load * (1.0 + 1e-9)).all()
    assert rubbing.max() > 0.0


@pytest.mark.parametrize("duration_s", [0.05, 0.5])
def test_mirrored_moments_give_the_mirrored_motion(duration_s):
    """Fingers 1 and 2 change places in the mirror x -> -x, and so do 3 and 4: each is the lower number once."""
    moment = np.array([[-0.03, 0.004], [0.034, 0.0], [0.028, -0.01], [-0.03, 0.012]])
    mirror, places = np.array([-1.0, 1.0, 1.0]), [1, 0, 3, 2]
    states = [pressed("rod", 3, m, duration_s=duration_s).state() for m in (moment, (moment * mirror[:2])[places])]
    plain, mirrored = (state.between_fingers_force_n for state in states)
    assert np.abs(plain).max() > 0.01
    np.testing.assert_allclose(mirrored, (plain * mirror)[places], atol=1e-6)
    np.testing.assert_allclose(states[1].centreline_m, (states[0].centreline_m * mirror)[places], atol=1e-7)


def test_fingers_pressed_on_each_other_converge_with_the_step():
    """To the first order below 0.5 ms; above it the errors grow more slowly."""
    moment = 0.035 * INWARD + [[0.004, 0.0], [0.0, 0.002], [-0.003, 0.001], [0.0, 0.0]]
    reference, *ends = (
        pressed("rod", 3, moment, h, 0.1).state().centreline_m for h in (1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3)
    )
    errors = [np.abs(end - reference).max() for end in ends]
    assert errors[0] < 0.45 * errors[1]
    assert max(errors) < 3e-4


@pytest.mark.parametrize("body", [None, BULB], ids=["free", "object"])
def test_fingers_that_do_not_meet_move_by_the_same_bits_as_those_that_cannot(body):
    moment = 0.024 * INWARD if body else opposite(0.012)
    tiers = [pressed("rod", 3, moment, duration_s=0.3, touch=touch, body=body) for touch in (False, True)]
    closest = min(distance_m(tiers[1], 0, other) for other in (1, 2))
    assert 2.0 * GEOMETRY.outer_radius_m < closest < 0.06  # so near that their boxes meet
    first, second = (tier.state() for tier in tiers)
    np.testing.assert_array_equal(first.centreline_m, second.centreline_m)
    np.testing.assert_array_equal(first.bend_rate_rad_s, second.bend_rate_rad_s)
    np.testing.assert_array_equal(first.finger_force_n, second.finger_force_n)
    assert not second.between_fingers_force_n.any()


def test_fingers_pass_through_each_other_where_the_setup_says_so():
    tier = pressed("rod", 3, opposite(0.045), touch=False)
    assert distance_m(tier, 0, 2) < GEOMETRY.outer_radius_m
    assert not tier.state().between_fingers_force_n.any()


@pytest.mark.parametrize("step_s", [1e-3, 5e-3, 1e-2])
def test_fingers_that_close_at_once_stop_each_other(step_s):
    """Moments as of 100 kPa from one step to the next: tips give way by half a radius; to pass takes two."""
    tier = build_tier(TierSetup(GEOMETRY, BASES, 9.81, None, NO_PLANES, CONFIG, True), Fidelity("rod", 3, step_s))
    full = Actuation(opposite(0.045), np.full(4, STIFFNESS))
    tier.reset(full)
    deepest = 0.0
    for _ in range(round(0.3 / step_s)):
        tier.step(full, np.zeros(2), np.zeros(2))
        deepest = max(deepest, tier._parts.contacts.depth[: tier._parts.contacts.count[0]].max(initial=0.0))
    assert 0.0 < deepest < 0.7 * GEOMETRY.outer_radius_m


def test_a_scene_says_whether_fingers_touch():
    scene, request = load_scene("empty")
    for touch in (True, False):
        own = dataclasses.replace(scene, fingers_touch=touch)
        plant = build_plant(own, dataclasses.replace(request, tier="rod"), GRIPPER)
        for _ in range(25):
            plant.step(np.eye(16)[[0, 10]].sum(axis=0), 0.01)  # fingers 1 and 3 bend toward each other
        assert plant._tier.state().between_fingers_force_n.any() == touch
