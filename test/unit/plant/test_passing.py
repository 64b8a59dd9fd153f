"""What is fast, thin or heavy: it ends where it belongs, or in an error that says so; never in or behind anything."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
CONFIG = load_config(PlantConfig, "plant.yaml")
STIFFNESS = np.full(4, 1.5e-3)  # N m2
HANGING = Actuation(np.zeros((4, 2)), STIFFNESS)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
STAND = np.array([[0.115, 0.01, 0.01], [0.315, np.inf, np.inf]])
SPHERE = RigidBody("sphere", (0.06,) * 3, 0.046, np.array([0.0, 0.0, 0.085]), UPRIGHT)


def still(count):
    return np.zeros(count + 1), np.zeros(count + 1)


def built(step_s, body, planes=STAND, tier="rod", touch=True):
    setup = TierSetup(GRIPPER.geometry, GRIPPER.finger_base_m, GRAVITY_M_S2, body, planes, CONFIG, touch)
    tier = build_tier(setup, Fidelity(tier, 3 if tier == "rod" else 1, step_s))
    tier.reset(HANGING)
    return tier


@pytest.mark.parametrize("step_s", [1e-3, 3e-2, 5e-2, 0.1, 1.0])
def test_a_sphere_stays_on_its_thin_stand_at_any_step(step_s):
    tier = built(step_s, SPHERE)
    tier.step(HANGING, *still(max(round(1.0 / step_s), 10)))
    np.testing.assert_allclose(tier.state().body.position_m, SPHERE.position_m, atol=1e-4)
    assert -tier.state().support_force_n[2] == pytest.approx(SPHERE.mass_kg * GRAVITY_M_S2, rel=1e-3)


@pytest.mark.parametrize("step_s", [5e-4, 2e-3, 1e-2, 3e-2])
@pytest.mark.parametrize("speed_m_s", [1.0, 6.0])
def test_a_sphere_that_is_shot_at_its_stand_stays_above_it(step_s, speed_m_s):
    shot = dataclasses.replace(SPHERE, position_m=np.array([0.0, 0.0, 0.060]), velocity_m_s=(0.0, 0.0, speed_m_s))
    tier = built(step_s, shot)
    for _ in range(round(0.5 / step_s)):
        tier.step(HANGING, *still(1))
        assert tier.state().body.position_m[2] < 0.085 + 0.010
    assert tier.state().body.position_m[2] == pytest.approx(0.085, abs=1e-3)


@pytest.mark.parametrize("step_s", [1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
def test_a_finger_does_not_pass_through_a_thin_plate(step_s):
    """Struck at some 2 m/s, a plate of 2 mm is pushed over the table, or tips over; the finger stays on its side."""
    plate = RigidBody("box", (0.002, 0.12, 0.1), 0.3, np.array([0.0, 0.0, 0.085]), UPRIGHT)
    tier = built(step_s, plate, np.array([[0.135, 0.05, 0.05], [0.315, np.inf, np.inf]]))
    push = Actuation(np.array([[-0.06, 0.0], *np.zeros((3, 2))]), STIFFNESS)
    touched = False
    for _ in range(round(0.4 / step_s)):
        tier.step(push, *still(1))
        state = tier.state()
        touched = touched or bool(state.finger_force_n[0].any())
        x, y, z, w = state.body.orientation_xyzw
        across = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])  # the plate's normal
        along = (state.centreline_m[0] - state.body.position_m) @ across
        beside = np.abs(state.centreline_m[0, :, 2] - state.body.position_m[2]) < 0.045
        assert (along[beside] > 0.0).all()
    assert touched


@pytest.mark.parametrize("step_s", [2e-3, 1e-2])
def test_what_is_too_heavy_for_its_stand_is_refused_by_name(step_s):
    tier = built(step_s, dataclasses.replace(SPHERE, mass_kg=1000.0))
    with pytest.raises(PlantDivergedError, match="pushed into something else by more than 10 mm.*contact stiffness"):
        tier.step(HANGING, *still(round(1.0 / step_s)))


@pytest.mark.parametrize("tier", ["arc", "rod"])
def test_fingers_in_the_air_beside_a_resting_object_move_by_the_same_bits_as_without_it(tier):
    aside = np.array([[0.02, 0.005], [0.0, 0.015], [-0.01, -0.01], [0.004, -0.02]])  # outward, and past each other
    swung = Actuation(aside, STIFFNESS)
    alone, beside = built(2e-3, None, np.empty((0, 3)), tier), built(2e-3, SPHERE, tier=tier)
    for _ in range(3):
        for each in (alone, beside):
            each.step(swung, *still(50))
    assert beside.state().support_force_n.any() and not beside.state().finger_force_n.any()
    assert np.abs(alone.state().bend_rad).max() > 0.3
    np.testing.assert_array_equal(alone.state().centreline_m, beside.state().centreline_m)
    np.testing.assert_array_equal(alone.state().bend_rate_rad_s, beside.state().bend_rate_rad_s)


@pytest.mark.parametrize("step_s", [2e-3, 1e-2])
def test_what_muscles_are_known_to_be_clear_of_changes_no_bit(step_s):
    """Once sought anew in every step: fingers close past each other and on a sphere, while another one falls by."""
    falling = dataclasses.replace(SPHERE, position_m=np.array([0.085, 0.0, 0.05]), velocity_m_s=(0.0, 0.0, -0.3))
    setup = TierSetup(
        GRIPPER.geometry, GRIPPER.finger_base_m, GRAVITY_M_S2, SPHERE, STAND, CONFIG, True, others=(falling,)
    )
    known, sought = (build_tier(setup, Fidelity("rod", 3, step_s)) for _ in range(2))
    inward = -0.02 * np.sign(GRIPPER.finger_base_m[:, :2])
    cleared = 0
    for tier in (known, sought):
        tier.reset(HANGING)
        for push in (HANGING, Actuation(inward, STIFFNESS)):
            for _ in range(round(0.3 / step_s)):
                tier.step(push, *still(1))
                clear = tier._parts.work.spots.clear
                cleared += bool(clear[0] > 0.0)
                if tier is sought:
                    clear[:] = 0.0
    assert cleared > 10
    assert known.state().finger_force_n.any()
    for one, other in zip(known.state().bodies, sought.state().bodies, strict=True):
        np.testing.assert_array_equal(one.position_m, other.position_m)
    np.testing.assert_array_equal(known.state().centreline_m, sought.state().centreline_m)


def test_a_finger_that_touches_leaves_the_others_their_bits():
    """Finger 1 presses on a heavy box, 3 swings outward: as if there were no box."""
    moments = np.array([[-0.03, -0.03], [0.0, 0.0], [-0.015, -0.012], [0.0, 0.0]])
    box = RigidBody("box", (0.04,) * 3, 1.0, np.array([0.0, 0.0, 0.095]), UPRIGHT)
    alone, beside = built(2e-3, None, np.empty((0, 3))), built(2e-3, box)
    for each in (alone, beside):
        for _ in range(4):
            each.step(Actuation(moments, STIFFNESS), *still(50))
    assert beside.state().finger_force_n[0].any()
    np.testing.assert_array_equal(alone.state().centreline_m[1:], beside.state().centreline_m[1:])
