"""Tier ``arc`` against closed forms, conserved quantities, symmetry and its own smaller steps."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.actuator.equilibrium import gravity_energy_j, gravity_stiffness_n_m, hanging_bend
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
GEOMETRY = GRIPPER.geometry
CONFIG = load_config(PlantConfig, "plant.yaml")
UNDAMPED = dataclasses.replace(CONFIG, retardation_time_s=0.0)
STIFFNESS = 1.5e-3  # N m2
SPRING = STIFFNESS / GEOMETRY.active_length_m
INWARD = -GRIPPER.finger_base_m[:, :2] / np.linalg.norm(GRIPPER.finger_base_m[:, :2], axis=1, keepdims=True)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
BULB = RigidBody("sphere", (0.06, 0.06, 0.06), 0.046, np.array([0.0, 0.0, 0.085]), UPRIGHT)
TABLE = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])


NO_PLANES = np.empty((0, 3))


def tier(step_s, body=None, planes=NO_PLANES, config=CONFIG, gravity=9.81, bases=GRIPPER.finger_base_m):
    built = build_tier(TierSetup(GEOMETRY, bases, gravity, body, planes, config), Fidelity("arc", 1, step_s))
    built.reset(actuation([0.0, 0.0]))
    return built


def actuation(moment):
    return Actuation(np.broadcast_to(np.asarray(moment, dtype=float), (4, 2)).copy(), np.full(4, STIFFNESS))


def advance(arc, before, after, duration_s, step_s):
    """Jump to ``before``, and run straight from there to ``after``."""
    steps = round(duration_s / step_s)
    arc.step(before, np.zeros(1), np.zeros(1))
    arc.step(after, np.zeros(steps + 1), np.zeros(steps + 1))
    return arc.state()


def energy(arc, moment):
    """Kinetic and total energy of the first muscle, zero at rest and straight."""
    rod, motion, state = arc._parts.system.rod, arc._motion, arc.state()
    speed = motion.of(0).slope[1:] @ state.bend_rate_rad_s[0]
    kinetic = 0.5 * np.sum((rod.inertia @ speed) ** 2)
    bend = state.bend_rad[0]
    return kinetic, kinetic + 0.5 * SPRING * bend @ bend - moment @ bend + gravity_energy_j(bend, GEOMETRY)


def test_small_swings_have_the_period_of_mass_matrix_and_stiffness():
    step_s, moment = 5e-4, actuation([1e-5, 0.0])
    length, end = 0.100, 0.015
    mass = 0.168 * (length**3 / 20 + ((length / 2 + end) ** 3 - (length / 2) ** 3) / 3)
    period_s = 2.0 * math.pi / math.sqrt((SPRING + gravity_stiffness_n_m(0.0, GEOMETRY)[1]) / mass)
    arc, bends = tier(step_s, config=UNDAMPED), []
    for _ in range(round(3.0 * period_s / step_s)):
        bends.append(advance(arc, moment, moment, step_s, step_s).bend_rad[0, 0])
    swing = np.array(bends) - 1e-5 / (SPRING + gravity_stiffness_n_m(0.0, GEOMETRY)[1])
    up = np.nonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))[0]
    crossings = up + swing[up] / (swing[up] - swing[up + 1])
    assert np.diff(crossings).mean() * step_s == pytest.approx(period_s, rel=1e-3)


def test_an_undamped_muscle_keeps_its_energy():
    step_s, moment = 1e-3, np.array([0.02, 0.01])
    arc, highest, drift = tier(step_s, config=UNDAMPED), 0.0, []
    for _ in range(500):  # 5 s, about 12 swings of 100 deg
        advance(arc, actuation(moment), actuation(moment), 0.01, step_s)
        kinetic, total = energy(arc, moment)
        highest = max(highest, kinetic)
        drift.append(total)
    assert np.abs(drift).max() < 2e-3 * highest  # starts at rest and straight: energy 0


def test_a_muscle_comes_to_rest_at_the_hanging_bend():
    moment = np.array([[0.03, 0.0], [0.0, -0.02], [0.01, 0.02], [-0.02, -0.02]])
    arc = tier(2e-3)
    state = advance(arc, actuation(moment), actuation(moment), 4.0, 2e-3)
    np.testing.assert_allclose(state.bend_rad, hanging_bend(moment, np.full(4, STIFFNESS), GEOMETRY), atol=1e-6)
    assert np.abs(state.bend_rate_rad_s).max() < 1e-5


def test_free_muscles_converge_with_the_square_of_the_step():
    moment = actuation([[0.03, 0.0], [0.0, -0.02], [0.01, 0.02], [-0.02, -0.02]])
    ends = {h: advance(tier(h), moment, moment, 0.12, h).bend_rad for h in (2.5e-4, 4e-3, 8e-3)}
    fine, coarse = (np.abs(ends[h] - ends[2.5e-4]).max() for h in (4e-3, 8e-3))
    assert 3.2 < coarse / fine < 5.0
    assert fine < 5e-3


def test_a_grasp_converges_with_the_step():
    before, after = actuation(np.zeros(2)), actuation(0.03 * INWARD)
    ends = {}
    for h in (1.25e-4, 1e-3, 2e-3):
        arc = tier(h, BULB, TABLE)
        ends[h] = advance(arc, before, after, 0.4, h).finger_force_n
    fine, coarse = (np.abs(ends[h] - ends[1.25e-4]).max() for h in (1e-3, 2e-3))
    assert fine < 0.7 * coarse
    assert fine < 0.01 * np.abs(ends[1.25e-4]).max()


def test_an_object_in_free_fall_follows_the_parabola():
    thrown = dataclasses.replace(
        BULB,
        position_m=np.array([0.0, 0.0, 0.5]),
        velocity_m_s=(0.3, -0.2, -1.0),
        angular_velocity_rad_s=(1.0, 2.0, 3.0),
    )
    body = advance(tier(1e-3, thrown), actuation([0, 0]), actuation([0, 0]), 0.5, 1e-3).body
    np.testing.assert_allclose(body.position_m, [0.15, -0.1, 0.5 - 0.5 + 0.5 * 9.81 * 0.25], atol=1e-9)
    np.testing.assert_allclose(body.velocity_m_s, [0.3, -0.2, -1.0 + 9.81 * 0.5], atol=1e-9)
    np.testing.assert_allclose(body.angular_velocity_rad_s, [1.0, 2.0, 3.0], atol=1e-9)  # a sphere


def test_a_tumbling_box_keeps_its_angular_momentum_and_energy():
    inertia = 0.048 / 12.0 * np.array([0.12**2 + 0.06**2, 0.035**2 + 0.06**2, 0.035**2 + 0.12**2])
    spin = np.array([0.1, 8.0, 0.5])
    box = RigidBody(
        "box", (0.035, 0.12, 0.06), 0.048, np.array([0, 0, 0.5]), UPRIGHT, angular_velocity_rad_s=tuple(spin)
    )
    body = advance(tier(1e-3, box), actuation([0, 0]), actuation([0, 0]), 2.0, 1e-3).body
    x, y, z, w = body.orientation_xyzw
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
    local = rotation.T @ body.angular_velocity_rad_s
    assert np.linalg.norm(rotation @ (inertia * local) - inertia * spin) < 1e-3 * np.linalg.norm(inertia * spin)
    assert local @ (inertia * local) == pytest.approx(spin @ (inertia * spin), rel=1e-3)


def test_a_body_dropped_on_the_table_comes_to_rest_with_its_weight_on_it():
    planes = np.array([[0.6, np.inf, np.inf]])
    for shape, size, half in (("sphere", (0.06,) * 3, 0.03), ("box", (0.035, 0.12, 0.06), 0.03)):
        body = RigidBody(shape, size, 0.046, np.array([0.0, 0.0, 0.52]), UPRIGHT)
        state = advance(tier(1e-3, body, planes), actuation([0, 0]), actuation([0, 0]), 2.0, 1e-3)
        assert state.body.position_m[2] == pytest.approx(0.6 - half, abs=1e-4)
        assert state.support_force_n[2] == pytest.approx(-0.046 * 9.81, rel=1e-3)


def test_a_quarter_turn_of_everything_turns_the_result():
    aside = np.array([0.004, 0.001, 0.0])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    strength = np.array([0.030, 0.032, 0.028, 0.031])
    results = []
    for turned in (False, True):
        position = BULB.position_m + (turn @ aside if turned else aside)
        arc = tier(1e-3, dataclasses.replace(BULB, position_m=position), TABLE)
        force = np.roll(strength, 1) if turned else strength
        results.append(advance(arc, actuation([0, 0]), actuation(force[:, None] * INWARD), 0.4, 1e-3))
    plain, turned = results
    np.testing.assert_allclose(turned.body.position_m, turn @ plain.body.position_m, atol=1e-6)
    np.testing.assert_allclose(turned.bend_rad, np.roll(plain.bend_rad @ turn[:2, :2].T, 1, axis=0), atol=1e-5)


def test_muscles_rise_with_an_accelerated_hand_as_in_stronger_gravity():
    step_s, moment = 2e-3, actuation([0.02, 0.0])
    risen, heavy = tier(step_s), tier(step_s, gravity=9.81 + 3.0)
    times = np.arange(501) * step_s
    for arc, acceleration_m_s2 in ((risen, 3.0), (heavy, 0.0)):
        arc.reset(moment)
        arc.step(moment, 0.5 * acceleration_m_s2 * times**2, acceleration_m_s2 * times)
    np.testing.assert_allclose(risen.state().bend_rad, heavy.state().bend_rad, atol=1e-9)


def test_a_table_holds_the_muscles_up():
    planes = np.array([[0.1285, np.inf, np.inf]])
    moment = actuation([0.002, 0.0])
    free = advance(tier(1e-3), moment, moment, 2.0, 1e-3).bend_rad[0, 0]
    rubbed = advance(tier(1e-3, planes=planes), moment, moment, 2.0, 1e-3).bend_rad[0, 0]
    assert abs(rubbed - free) > 0.05 * abs(free)


def test_without_an_object_and_a_table_in_reach_no_contact_is_sought():
    arc = tier(1e-3)
    advance(arc, actuation([0.02, 0.0]), actuation([0.02, 0.0]), 0.1, 1e-3)
    assert arc.iterations == 0
    assert arc._parts.state.velocity.shape == (8,)
    assert not arc._parts.system.surroundings.table_in_reach


def test_a_step_that_diverges_raises_and_keeps_the_state():
    arc = tier(1e-3, gravity=1e7)
    before = advance(arc, actuation([0.0, 0.0]), actuation([0.0, 0.0]), 0.01, 1e-3).bend_rad
    with pytest.raises(PlantDivergedError, match="sub_step_s"):
        advance(arc, actuation([0.01, 0.0]), actuation([0.01, 0.0]), 0.1, 1e-3)
    np.testing.assert_array_equal(arc.state().bend_rad, before)
