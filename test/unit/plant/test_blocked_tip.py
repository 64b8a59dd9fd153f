"""A muscle of the plant whose tip a plate blocks, beside the blocked rod that the calibration takes."""

import math

import numpy as np
import pytest

from mbpam_ros.actuator.blocked_rod import FRICTION_COEFFICIENT, blocked_path
from mbpam_ros.actuator.calibration import calibrate, pattern_loads
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER, CONFIG = load_gripper(), load_config(PlantConfig, "plant.yaml")
LAW = calibrate(GRIPPER.design, GRIPPER.geometry, GRIPPER.metamodel, GRIPPER.target).law
NEXT_TO_WEIGHTLESS_M_S2 = 1e-9
STEP_S = 2e-3
PATTERNS = {"pdc": ([1.0, 0.0, 0.0, 1.0], 180.0), "psc": ([1.0, 0.0, 0.0, 0.0], 225.0)}
"""Chambers of finger 1, and where it bends to [deg]."""


def pushed_n(pattern):
    """Force on a plate of a million kg that stands at finger 1, after a slow rise to 100 kPa, all strains."""
    shares, azimuth_deg = PATTERNS[pattern]
    turn, thick_m = math.radians(azimuth_deg), 0.02
    toward = np.array([math.cos(turn), math.sin(turn), 0.0])
    center = GRIPPER.finger_base_m[0] + (GRIPPER.geometry.outer_radius_m + 0.5 * thick_m) * toward + [0.0, 0.0, 0.12]
    about_z = np.array([0.0, 0.0, math.sin(0.5 * turn), math.cos(0.5 * turn)])
    plate = RigidBody("box", (thick_m, 0.02, 0.16), 1e6, center, about_z)
    setup = TierSetup(
        GRIPPER.rod_geometry, GRIPPER.finger_base_m, NEXT_TO_WEIGHTLESS_M_S2, plate, np.empty((0, 3)), CONFIG
    )
    assert CONFIG.finger_object.friction_coefficient == FRICTION_COEFFICIENT
    muscles = build_tier(setup, Fidelity("rod", 3, STEP_S, twist_modes=2, stretch_modes=2))
    pressure = np.zeros((4, 4))
    muscles.reset(Actuation(*LAW.moment_and_stiffness(pressure), LAW.strain_law(pressure)))
    still = np.zeros(6)
    for share in np.minimum(np.arange(1, 401) / 300, 1.0):
        pressure[0] = 1e5 * share * np.array(shares)
        muscles.step(Actuation(*LAW.moment_and_stiffness(pressure), LAW.strain_law(pressure)), still, still)
    return float(muscles.state().finger_force_n[0] @ toward)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_blocked_tip_pushes_as_the_calibrated_blocked_rod_within_5_percent(pattern):
    """The rod touches with the rim of its end, the plant with a ball of its radius 10 mm before it: 3 % more."""
    loads = pattern_loads(LAW, pattern, np.arange(10e3, 101e3, 5e3))
    blocked = blocked_path(loads, GRIPPER.rod_geometry, gravity_m_s2=NEXT_TO_WEIGHTLESS_M_S2)[-1].push_n
    assert blocked > 0.4
    assert pushed_n(pattern) == pytest.approx(blocked, rel=0.05)
