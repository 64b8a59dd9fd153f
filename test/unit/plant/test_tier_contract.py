"""What every tier promises: the actuation of the present instant is its own, and each step leads on from there."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
CONFIG = load_config(PlantConfig, "plant.yaml")
UNDAMPED = dataclasses.replace(CONFIG, retardation_time_s=0.0)
INWARD = -GRIPPER.finger_base_m[:, :2] / np.linalg.norm(GRIPPER.finger_base_m[:, :2], axis=1, keepdims=True)
BULB = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), np.array([0.0, 0.0, 0.0, 1.0]))
STAND = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
STEP_S = 2e-3
GRASP = {"body": BULB, "planes_m": STAND}
TIERS = {
    "static": ({}, Fidelity("static", 1, STEP_S)),
    "arc": ({}, Fidelity("arc", 1, STEP_S)),
    "rod": ({}, Fidelity("rod", 3, STEP_S)),
    "rod, undamped": ({"config": UNDAMPED}, Fidelity("rod", 2, STEP_S)),
    "adaptive": (GRASP, Fidelity("rod", 3, STEP_S, air_modes=2)),
    "some fingers": ({}, Fidelity("rod", 2, STEP_S, moving_fingers=(3, 1))),
    "no contact": (GRASP, Fidelity("arc", 1, STEP_S, contact=False)),
}


def tier_of(case):
    there, fidelity = TIERS[case]
    setup = TierSetup(GRIPPER.geometry, GRIPPER.finger_base_m, 9.81, None, np.empty((0, 3)), CONFIG)
    return build_tier(dataclasses.replace(setup, **there), fidelity)


def inward(case, strength_n_m):
    """Moments of the fingers that move."""
    moving = np.isin([[1], [2], [3], [4]], TIERS[case][1].moving_fingers)
    return Actuation(np.where(moving, strength_n_m * INWARD, 0.0), np.full(4, 1.5e-3))


def advance(tier, actuation, steps):
    tier.step(actuation, np.zeros(steps + 1), np.zeros(steps + 1))


def assert_same_bits(one, other):
    for field in ("bend_rad", "bend_rate_rad_s", "centreline_m", "finger_force_n"):
        np.testing.assert_array_equal(getattr(one.state(), field), getattr(other.state(), field))


@pytest.mark.parametrize("case", TIERS)
def test_a_reset_forgets_and_starts_with_the_actuation_it_is_given(case):
    used, new = tier_of(case), tier_of(case)
    used.reset(inward(case, 0.0))
    advance(used, inward(case, 0.03), 20)
    for tier in (used, new):
        tier.reset(inward(case, 0.01))
        assert not tier.state().bend_rad.any()
        advance(tier, inward(case, 0.02), 20)
    assert_same_bits(used, new)
    new.reset(inward(case, 0.0))
    advance(new, inward(case, 0.02), 20)
    assert (np.abs(new.state().bend_rad).max()) < 0.95 * np.abs(used.state().bend_rad).max()


@pytest.mark.parametrize("case", TIERS)
def test_arrays_that_were_given_may_be_used_again(case):
    used, new = tier_of(case), tier_of(case)
    again = inward(case, 0.01)
    for tier in (used, new):
        tier.reset(again if tier is used else inward(case, 0.01))
    for strength_n_m in (0.01, 0.03, 0.01, 0.03, 0.03):
        again.moment_n_m[:] = inward(case, strength_n_m).moment_n_m
        advance(used, again, 5)
        advance(new, inward(case, strength_n_m), 5)
    assert_same_bits(used, new)


@pytest.mark.parametrize("case", TIERS)
def test_without_a_sub_step_the_actuation_jumps_and_nothing_moves(case):
    jumped, started = tier_of(case), tier_of(case)
    jumped.reset(inward(case, 0.0))
    advance(jumped, inward(case, 0.02), 0)
    started.reset(inward(case, 0.02))
    assert_same_bits(jumped, started)
    for tier in (jumped, started):
        advance(tier, inward(case, 0.02), 20)
    assert_same_bits(jumped, started)


@pytest.mark.parametrize("case", [case for case in TIERS if case != "static"])
def test_after_a_step_that_diverged_the_next_leads_on_from_the_actuation_before_it(case):
    refused, spared = tier_of(case), tier_of(case)
    for tier in (refused, spared):
        tier.reset(inward(case, 0.0))
        advance(tier, inward(case, 0.01), 20)
    with pytest.raises(PlantDivergedError):
        advance(refused, inward(case, 50.0), 20)
    for tier in (refused, spared):
        advance(tier, inward(case, 0.01), 20)
    np.testing.assert_allclose(refused.state().centreline_m, spared.state().centreline_m, rtol=0.0, atol=1e-6)
