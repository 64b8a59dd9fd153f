"""Friction: within the cone of the same step's push at every step, and at rest for good inside it."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
CONFIG = load_config(PlantConfig, "plant.yaml")
INWARD = -GRIPPER.finger_base_m[:, :2] / np.linalg.norm(GRIPPER.finger_base_m[:, :2], axis=1, keepdims=True)
STIFFNESS = np.full(4, 1.5e-3)  # N m2
HANGING, CLOSED = (Actuation(share * 0.035 * INWARD, STIFFNESS) for share in (0.0, 1.0))
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
BULB = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), UPRIGHT)
STAND = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
PLANE = np.array([[0.315, np.inf, np.inf]])


def still(count):
    return np.zeros(count + 1), np.zeros(count + 1)


def built(step_s, body=BULB, planes=STAND, tier="rod", direction=(0.0, 0.0, 1.0)):
    setup = TierSetup(
        GRIPPER.geometry, GRIPPER.finger_base_m, 9.81, body, planes, CONFIG, True, gravity_direction=direction
    )
    tier = build_tier(setup, Fidelity(tier, 3 if tier == "rod" else 1, step_s))
    tier.reset(HANGING)
    return tier


def held(step_s=2e-3, tier="rod"):
    """The bulb, raised by 50 mm."""
    muscles = built(step_s, tier=tier)
    closing, raising = round(0.4 / step_s), round(0.5 / step_s)
    muscles.step(CLOSED, *still(closing))
    muscles.step(CLOSED, *still(closing))
    times = np.linspace(0.0, 1.0, raising + 1)
    muscles.step(CLOSED, 0.05 * times, np.full(raising + 1, 0.1))
    up = np.full(closing + 1, 0.05), np.zeros(closing + 1)
    muscles.step(CLOSED, *up)
    muscles.step(CLOSED, *up)
    return muscles, up


def most_of_the_cone(tier):
    """The largest friction over mu times the push of the same step, of all contacts that have any."""
    table, laws = tier._parts.contacts, tier._parts.system.laws
    used = slice(0, int(table.count[0]))
    push, normal = table.push[used], table.normal[used]
    friction = np.linalg.norm(table.force[used, :3] - push[:, None] * normal, axis=1)
    assert (push >= 0.0).all()
    bound = laws[table.kind[used], 2] * push
    assert (friction <= 1.001 * bound).all()
    return (friction[push > 0.0] / bound[push > 0.0]).max(initial=0.0)


@pytest.mark.parametrize("step_s", [1e-5, 1e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2])
def test_friction_stays_in_the_cone_of_the_push_of_the_same_step_while_fingers_close(step_s):
    tier, counts, most = built(step_s), 0, []
    meeting = round(0.12 / step_s)
    closing = Actuation(0.7 * CLOSED.moment_n_m, STIFFNESS)
    tier.step(closing, *still(meeting))
    for _ in range(min(round(0.3 / step_s), 600)):
        tier.step(CLOSED, *still(1))
        most.append(most_of_the_cone(tier))
        counts += tier._parts.contacts.one[: tier._parts.contacts.count[0]].max(initial=-1) >= 0
    assert counts > 10  # fingers touched
    assert max(most) > 0.999  # and slipped


@pytest.mark.parametrize("tier", ["arc", "rod"])
def test_a_held_object_comes_to_rest_for_good(tier):
    muscles, up = held(tier=tier)
    start = muscles.state().body
    for _ in range(20):
        muscles.set_gravity(np.array([0.0, 0.0, 9.81]))  # as a node does again and again
        muscles.step(CLOSED, *up)
    end = muscles.state().body
    duration_s = 20 * (len(up[0]) - 1) * 2e-3
    assert start.position_m[2] < 0.04  # it rose with the hand
    assert np.linalg.norm(end.position_m - start.position_m) < 1e-8 * duration_s
    assert np.abs(end.orientation_xyzw - start.orientation_xyzw).max() < 1e-7 * duration_s


@pytest.mark.parametrize("step_s", [5e-4, 5e-3])
@pytest.mark.parametrize("over", [0.99, 1.01])
def test_a_box_on_a_tilted_plane_slides_where_the_slope_is_the_friction_coefficient(over, step_s):
    """Of the gravity vector turned about x, in the plane's own frame."""
    friction = CONFIG.object_support.friction_coefficient
    slope = math.atan(over * friction)
    body = RigidBody("box", (0.06, 0.06, 0.02), 0.1, np.array([0.0, 0.0, 0.305]), UPRIGHT)
    tier = built(step_s, body, PLANE, "arc", (0.0, math.sin(slope), math.cos(slope)))
    tier.step(HANGING, *still(round(0.5 / step_s)))  # springs stretch and its edges settle
    start = tier.state().body
    tier.step(HANGING, *still(round(1.0 / step_s)))
    end = tier.state().body
    slid_m = end.position_m[1] - start.position_m[1]
    if over < 1.0:
        assert np.linalg.norm(end.position_m - start.position_m) < 1e-8
        return
    acceleration = 9.81 * (math.sin(slope) - friction * math.cos(slope))
    assert slid_m == pytest.approx(start.velocity_m_s[1] + 0.5 * acceleration, rel=0.02)
    assert end.velocity_m_s[1] - start.velocity_m_s[1] == pytest.approx(acceleration, rel=0.01)


def test_a_box_thrown_along_a_table_loses_its_energy_to_friction_and_never_gains_any():
    body = RigidBody("box", (0.06, 0.06, 0.02), 0.1, np.array([-0.3, 0.0, 0.305]), UPRIGHT, (0.5, 0.1, 0.0), (0, 0, 4))
    tier, energies = built(1e-3, body, PLANE, "arc"), []
    inertia = 0.1 * (0.06**2 + 0.06**2) / 12.0
    for _ in range(400):
        state = tier.state().body
        kinetic = 0.05 * state.velocity_m_s @ state.velocity_m_s + 0.5 * inertia * state.angular_velocity_rad_s[2] ** 2
        energies.append(kinetic - 0.1 * 9.81 * state.position_m[2])
        tier.step(HANGING, *still(1))
    assert np.diff(energies).max() < 2e-6  # what the springs of the table give back: (m g)^2 / 2 k is 6e-6 J
    assert np.linalg.norm(state.velocity_m_s) < 1e-4
    assert energies[0] - energies[-1] == pytest.approx(0.05 * 0.26 + 0.5 * inertia * 16.0, rel=0.01)


def test_a_reset_forgets_what_the_springs_hold():
    used, fresh = held()[0], built(2e-3)
    used.reset(HANGING)
    for tier in (used, fresh):
        for _ in range(3):
            tier.step(CLOSED, *still(150))
    assert fresh.state().finger_force_n.any()
    np.testing.assert_array_equal(used.state().centreline_m, fresh.state().centreline_m)
    np.testing.assert_array_equal(used.state().body.position_m, fresh.state().body.position_m)


def test_a_step_that_fails_leaves_what_the_springs_hold():
    muscles, up = held()
    twin, _ = held()
    with pytest.raises(PlantDivergedError):
        muscles.step(dataclasses.replace(CLOSED, moment_n_m=np.full((4, 2), 1e3)), *up)
    for tier in (muscles, twin):
        for _ in range(5):
            tier.step(CLOSED, *up)
    np.testing.assert_allclose(muscles.state().body.position_m, twin.state().body.position_m, atol=1e-9)
