"""Tier ``rod`` against an independent boundary-value solution, conserved energy, symmetry and its own refinement."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import (
    Actuation,
    PlantConfig,
    PlantDivergedError,
    RigidBody,
    TierError,
    TierSetup,
)
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
GEOMETRY = GRIPPER.geometry
CONFIG = load_config(PlantConfig, "plant.yaml")
UNDAMPED = dataclasses.replace(CONFIG, retardation_time_s=0.0)
STIFFNESS = 1.5e-3  # N m2
INWARD = -GRIPPER.finger_base_m[:, :2] / np.linalg.norm(GRIPPER.finger_base_m[:, :2], axis=1, keepdims=True)
BULB = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), np.array([0.0, 0.0, 0.0, 1.0]))
TABLE = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
NO_PLANES = np.empty((0, 3))
MOMENTS = np.array([[0.04, 0.0], [0.0, -0.02], [0.01, 0.03], [0.0, 0.0]])


def tier(modes, step_s, name="rod", body=None, planes=NO_PLANES, config=CONFIG, gravity=9.81):
    setup = TierSetup(GEOMETRY, GRIPPER.finger_base_m, gravity, body, planes, config)
    built = build_tier(setup, Fidelity(name, modes, step_s))
    built.reset(actuation([0.0, 0.0]))
    return built


def actuation(moment, stiffness=STIFFNESS):
    return Actuation(np.broadcast_to(np.asarray(moment, dtype=float), (4, 2)).copy(), np.full(4, stiffness))


def advance(rod, before, after, duration_s, step_s):
    """Jump to ``before``, and run straight from there to ``after``."""
    steps = round(duration_s / step_s)
    rod.step(before, np.zeros(1), np.zeros(1))
    rod.step(after, np.zeros(steps + 1), np.zeros(steps + 1))
    return rod.state()


def tips(rod):
    return rod.state().centreline_m[:, -1] - GRIPPER.finger_base_m


def at_rest(modes, moment=MOMENTS, **changes):
    rod = tier(modes, 5e-3, **changes)
    advance(rod, actuation(moment), actuation(moment), 4.0, 5e-3)
    return rod


def hanging_rod(moment_n_m, stiffness_n_m2=STIFFNESS):
    """Tip (across, down) and angle of the hanging Kirchhoff rod: B theta'' = w (weight's arm beyond) sin theta."""
    length, end, weight = GEOMETRY.active_length_m, GEOMETRY.end_length_m, 9.81 * GEOMETRY.mass_per_length_kg_m

    def slope(s, y):
        bending = weight * (length + end - s) * np.sin(y[0]) / stiffness_n_m2
        return np.array([y[1], bending, np.sin(y[0]), np.cos(y[0])])

    def ends(clamp, tip):
        curvature = (moment_n_m - 0.5 * weight * end**2 * np.sin(tip[0])) / stiffness_n_m2
        return np.array([clamp[0], tip[1] - curvature, clamp[2], clamp[3] - end])

    s, kappa = np.linspace(0.0, length, 41), moment_n_m / stiffness_n_m2
    solution = solve_bvp(slope, ends, s, np.array([kappa * s, kappa + 0 * s, 0 * s, end + s]), tol=1e-9)
    assert solution.success
    angle, _, across, down = solution.y[:, -1]
    return np.array([across + end * np.sin(angle), down + end * np.cos(angle)]), angle


def test_the_resting_tip_is_that_of_the_boundary_value_problem():
    rod = at_rest(modes=4)
    for moment, tip, bend in zip(MOMENTS, tips(rod), rod.state().bend_rad, strict=True):
        size = np.linalg.norm(moment)
        toward = moment / size if size else np.array([1.0, 0.0])
        expected, angle = hanging_rod(size)
        assert np.linalg.norm([*(tip[:2] - expected[0] * toward), tip[2] - expected[1]]) < 1e-4 * GEOMETRY.length_m
        np.testing.assert_allclose(bend, angle * toward, atol=1e-3 * max(angle, 1e-6))


def test_the_resting_tip_converges_with_the_number_of_modes():
    expected, _ = hanging_rod(0.04)
    errors = [np.linalg.norm(tips(at_rest(modes))[0, [0, 2]] - expected) / GEOMETRY.length_m for modes in (1, 2, 3, 4)]
    assert errors[0] > 0.005
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.6 * errors[1]
    assert errors[3] < 0.1 * errors[2]


def test_one_mode_comes_to_rest_at_the_closed_form_of_constant_curvature_and_is_the_tier_arc():
    rod, arc = at_rest(modes=1), at_rest(modes=1, name="arc")
    np.testing.assert_allclose(rod.state().bend_rad, hanging_bend(MOMENTS, np.full(4, STIFFNESS), GEOMETRY), atol=1e-5)
    np.testing.assert_array_equal(rod.state().centreline_m, arc.state().centreline_m)


def test_without_gravity_every_number_of_modes_rests_in_the_circle_of_its_intrinsic_moment():
    for modes in (2, 4):
        bend = at_rest(modes, gravity=0.0).state().bend_rad
        np.testing.assert_allclose(bend, MOMENTS * GEOMETRY.active_length_m / STIFFNESS, atol=1e-6)


def test_a_hanging_muscle_without_pressure_stays_exactly_straight():
    rod = tier(3, 1e-3)
    state = advance(rod, actuation([0.0, 0.0]), actuation([0.0, 0.0]), 0.2, 1e-3)
    assert not state.bend_rad.any() and not state.bend_rate_rad_s.any()
    assert not state.centreline_m[:, :, :2].any() or np.ptp(state.centreline_m[:, :, :2], axis=1).max() == 0.0


def test_free_muscles_converge_with_the_square_of_the_step():
    before, after = actuation(MOMENTS), actuation(MOMENTS[::-1])
    ends = {}
    for h in (2.5e-4, 2e-3, 4e-3):
        rod = tier(3, h)
        advance(rod, before, before, 0.06, h)
        advance(rod, after, after, 0.1, h)
        ends[h] = tips(rod)
    fine, coarse = (np.abs(ends[h] - ends[2.5e-4]).max() for h in (2e-3, 4e-3))
    assert 3.2 < coarse / fine < 5.0
    assert fine < 1e-3 * GEOMETRY.length_m


def test_a_grasp_converges_with_the_step():
    """To the first order below 0.5 ms (a third is what is left of it at half the step), and to 1 % at 1 ms."""
    ends = {}
    for h in (1.25e-4, 2.5e-4, 5e-4, 1e-3):
        rod = tier(3, h, body=BULB, planes=TABLE)
        ends[h] = advance(rod, actuation([0.0, 0.0]), actuation(0.03 * INWARD), 0.4, h).finger_force_n
    fine, coarse, coarsest = (np.abs(ends[h] - ends[1.25e-4]).max() for h in (2.5e-4, 5e-4, 1e-3))
    assert np.abs(ends[1.25e-4]).max() > 0.05
    assert fine < 0.45 * coarse
    assert coarsest < 0.01 * np.abs(ends[1.25e-4]).max()


def energy(rod, moment):
    """Kinetic and total energy of each muscle, shape (4,); the potential is zero straight."""
    parts, motion, size = rod._parts.system.rod, rod._motion, rod._coordinates // 4
    q, rate = (part[: 4 * size].reshape(4, size) for part in rod._parts.state[:2])
    speed = np.einsum("rk,kijf,fj->fri", parts.inertia, motion.slope[1:], rate)
    kinetic = 0.5 * (speed**2).sum(axis=(1, 2))
    stiffness = STIFFNESS / GEOMETRY.active_length_m / (2.0 * (np.arange(size) // 2) + 1.0)
    elastic = 0.5 * (stiffness * q**2).sum(axis=1) - (moment * q[:, :2]).sum(axis=1)
    return kinetic, kinetic + elastic + 9.81 * parts.levers @ (1.0 - motion.tangent[1:, 2])


def test_other_threads_run_while_steps_are_taken():
    rod, still = tier(3, 1e-3), np.zeros(100_001)
    with ThreadPoolExecutor(1) as executor:
        steps = executor.submit(rod.step, actuation(MOMENTS), still, still)
        seen = set()
        while not steps.done():
            seen.add(float(rod._parts.state.shape[0]))
    steps.result()
    assert len(seen) > 20  # were the lock held, there would be what was before and what is after


def test_a_refused_step_leaves_the_muscles_and_what_drives_them_as_they_were():
    rod, still = tier(2, 5e-3), np.zeros(11)
    rod.step(actuation(MOMENTS), still, still)
    parts = rod._parts
    before = [part.copy() for part in (*parts.state, *parts.drive)]
    with pytest.raises(PlantDivergedError):
        rod.step(actuation(100.0 * MOMENTS), still, still)
    for part, values in zip((*parts.state, *parts.drive), before, strict=True):
        np.testing.assert_array_equal(part, values)


PUSH = np.array([[0.02, 0.0], [0.0, 0.015], [0.01, -0.01], [-0.015, 0.005]])
PULL = np.array([[0.004, 0.012], [-0.008, 0.0], [0.01, 0.004], [0.0, -0.012]])


def energies_of_a_swing(modes, step_s, duration_s):
    """Change of the total energies over the time [s], shape (n, 4), and the highest kinetic energies, shape (4,).

    Started in one plane, pulled into another: a motion out of any plane, in bends up to 150 deg.
    """
    rod = tier(modes, step_s, config=UNDAMPED)
    advance(rod, actuation(PUSH), actuation(PUSH), 0.15, step_s)
    start, highest, totals = energy(rod, PULL)[1], np.zeros(4), []
    for _ in range(round(duration_s / 0.05)):
        advance(rod, actuation(PULL), actuation(PULL), 0.05, step_s)
        kinetic, total = energy(rod, PULL)
        highest = np.maximum(highest, kinetic)
        totals.append(total - start)
    return np.array(totals), highest


@pytest.mark.slow
@pytest.mark.parametrize(("modes", "step_s"), [(1, 5e-3), (2, 2e-3), (3, 1e-3)])
def test_undamped_muscles_swinging_in_space_keep_their_energy_for_ten_seconds(modes, step_s):
    totals, highest = energies_of_a_swing(modes, step_s, 10.0)
    drift = np.mean(totals[-40:], axis=0) - np.mean(totals[:40], axis=0)
    assert (np.abs(drift) < 2e-5 * highest).all()
    assert (np.abs(totals).max(axis=0) < 1e-4 * highest).all()


def test_the_energy_of_undamped_muscles_swings_with_the_fourth_power_of_the_step():
    swings = []
    for step_s in (1e-3, 5e-4):
        totals, highest = energies_of_a_swing(4, step_s, 0.5)
        swings.append((np.abs(totals).max(axis=0) / highest).max())
    assert 10.0 < swings[0] / swings[1] < 60.0
    assert swings[1] < 1e-5


def test_without_damping_a_hand_that_accelerates_is_stronger_gravity_in_every_part_of_a_step():
    step_s, push = 2e-3, actuation(MOMENTS)
    risen, heavy = tier(2, step_s, config=UNDAMPED), tier(2, step_s, config=UNDAMPED, gravity=9.81 + 3.0)
    times = np.arange(101) * step_s
    for rod, acceleration_m_s2 in ((risen, 3.0), (heavy, 0.0)):
        rod.reset(push)
        rod.step(push, 0.5 * acceleration_m_s2 * times**2, acceleration_m_s2 * times)
    np.testing.assert_allclose(risen.state().bend_rad, heavy.state().bend_rad, atol=1e-8)


def test_without_damping_a_grasp_is_one_plain_step_at_a_time_where_anything_touches():
    """Pressed on one another nothing goes back in time: the bulb rests on its stand with its weight."""
    rod = tier(2, 1e-3, body=BULB, planes=TABLE, config=UNDAMPED)
    state = advance(rod, actuation([0.0, 0.0]), actuation([0.0, 0.0]), 0.5, 1e-3)
    assert state.support_force_n[2] == pytest.approx(-0.046 * 9.81, rel=1e-3)
    assert np.linalg.norm(state.body.velocity_m_s) < 1e-5


def test_a_quarter_turn_of_everything_turns_the_result():
    aside = np.array([0.004, 0.001, 0.0])
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    strength = np.array([0.030, 0.032, 0.028, 0.031])
    results = []
    for turned in (False, True):
        position = BULB.position_m + (turn @ aside if turned else aside)
        rod = tier(3, 1e-3, body=dataclasses.replace(BULB, position_m=position), planes=TABLE)
        force = np.roll(strength, 1) if turned else strength
        results.append(advance(rod, actuation([0, 0]), actuation(force[:, None] * INWARD), 0.4, 1e-3))
    plain, turned = results
    np.testing.assert_allclose(turned.body.position_m, turn @ plain.body.position_m, atol=1e-6)
    np.testing.assert_allclose(turned.centreline_m, np.roll(plain.centreline_m @ turn.T, 1, axis=0), atol=1e-6)


def test_the_same_steps_give_the_same_bits():
    ends = []
    for _ in range(2):
        rod = tier(3, 2e-3, body=BULB, planes=TABLE)
        ends.append(advance(rod, actuation([0, 0]), actuation(0.03 * INWARD), 0.3, 2e-3))
    for name in ("bend_rad", "bend_rate_rad_s", "centreline_m", "finger_force_n"):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name))


def test_centre_lines_are_as_long_as_the_muscle_and_end_in_the_direction_of_the_bend():
    state = at_rest(modes=3).state()
    pieces = np.diff(state.centreline_m, axis=1)
    np.testing.assert_allclose(np.linalg.norm(pieces, axis=2), 0.01, atol=1.5e-4)  # chords of 10 mm of arc
    angle = np.linalg.norm(state.bend_rad, axis=1)
    np.testing.assert_allclose(pieces[:, -1, 2], 0.01 * np.cos(angle), atol=1e-6)


@pytest.mark.parametrize("modes", [0, 7])
def test_a_number_of_modes_that_cannot_be_is_refused(modes):
    with pytest.raises(TierError, match="1 to 6 modes"):
        tier(modes, 1e-3)


def test_modes_are_only_for_the_rod():
    with pytest.raises(TierError, match="tier 'arc' takes no modes"):
        tier(2, 1e-3, name="arc")


@pytest.mark.parametrize("step_s", [1e-5, 1e-3, 1e-2, 0.1, 1.0])
@pytest.mark.parametrize("strength_n_m", [0.04, 0.12, 1.0])
def test_without_damping_bends_beyond_a_turn_end_finite_or_in_a_typed_error(step_s, strength_n_m):
    """0.12 N m wind the muscle up by 460 deg at rest, and up to twice that when it swings."""
    feather = dataclasses.replace(GEOMETRY, mass_per_length_kg_m=0.01 * GEOMETRY.mass_per_length_kg_m)
    for geometry in (GEOMETRY, feather):
        setup = TierSetup(geometry, GRIPPER.finger_base_m, 9.81, None, NO_PLANES, UNDAMPED)
        rod, push = build_tier(setup, Fidelity("rod", 3, step_s)), actuation(strength_n_m * INWARD + [[0.0, 0.01]])
        rod.reset(push)
        try:
            for _ in range(5):
                advance(rod, push, push, 20 * step_s, step_s)
        except PlantDivergedError as error:
            assert "sub_step_s" in str(error)
        state = rod.state()
        assert np.isfinite(state.bend_rad).all() and np.isfinite(state.bend_rate_rad_s).all()
        assert np.isfinite(state.centreline_m).all()


def test_the_bend_goes_on_beyond_half_a_turn():
    moment = 1.2 * np.pi * STIFFNESS / GEOMETRY.active_length_m * INWARD
    bend = at_rest(3, moment, gravity=0.0).state().bend_rad
    np.testing.assert_allclose(bend, 1.2 * np.pi * INWARD, atol=1e-5)


@pytest.mark.parametrize("step_s", [1e-4, 1e-2, 0.3])
@pytest.mark.parametrize("mass_kg", [0.001, 10.0])
@pytest.mark.parametrize("stiffness_n_m", [10.0, 1e8])
def test_a_grasp_with_any_step_mass_and_contact_stiffness_ends_finite_or_in_a_typed_error(
    step_s, mass_kg, stiffness_n_m
):
    kind = dataclasses.replace(CONFIG.finger_object, stiffness_n_m=stiffness_n_m)
    body = dataclasses.replace(BULB, mass_kg=mass_kg)
    rod = tier(3, step_s, body=body, planes=TABLE, config=dataclasses.replace(CONFIG, finger_object=kind))
    try:
        advance(rod, actuation([0, 0]), actuation(0.05 * INWARD), max(0.2, 3 * step_s), step_s)
    except PlantDivergedError as error:
        assert "sub_step_s" in str(error)
    state = rod.state()
    for value in (state.bend_rad, state.centreline_m, state.finger_force_n, state.body.position_m):
        assert np.isfinite(value).all()


@pytest.mark.parametrize("body", [None, BULB], ids=["free", "with the bulb"])
def test_a_span_cut_into_calls_ends_as_it_does_in_one_to_rounding(body):
    push, step_s, ends = actuation(0.03 * INWARD), 2e-3, []
    for calls in (1, 5, 150):
        rod = tier(3, step_s, body=body, planes=NO_PLANES if body is None else TABLE)
        rod.reset(push)
        for _ in range(calls):
            rod.step(push, np.zeros(150 // calls + 1), np.zeros(150 // calls + 1))
            rod.state()  # to look on changes nothing
        ends.append(rod.state())
    for seen in ends[1:]:
        np.testing.assert_allclose(seen.centreline_m, ends[0].centreline_m, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(seen.finger_force_n, ends[0].finger_force_n, rtol=0.0, atol=1e-12)
    assert body is None or np.abs(ends[0].finger_force_n).max() > 0.01
