import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from mbpam_ros.actuator.blocked_rod import FRICTION_COEFFICIENT, RodLoad, blocked_path
from mbpam_ros.actuator.calibration import pattern_loads
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import AxisStretch, RodSolutionError, blocked_tip_force_per_moment
from mbpam_ros.actuator.rod_law import finite_element_rod_law
from mbpam_ros.gripper import load_gripper

GEOMETRY = load_gripper().geometry
LAW = finite_element_rod_law()
PATHS = {pattern: pattern_loads(LAW, pattern, np.arange(10e3, 101e3, 5e3)) for pattern in ("pdc", "psc")}
INEXTENSIBLE = [RodLoad(load.moment_n_m, load.stiffness_n_m2) for load in PATHS["pdc"]]
YIELDING = [load._replace(stretch=load.stretch._replace(compliance_per_n=1.0 / 20.0)) for load in PATHS["pdc"]]
WEIGHT = GEOMETRY.mass_per_length_kg_m * GRAVITY_M_S2
L, END, RIM = GEOMETRY.active_length_m, GEOMETRY.end_length_m, GEOMETRY.outer_radius_m


def boundary_value_solution(load, contact, is_sliding):
    """Force, friction and tip angle by collocation from clamp to tip: forces and moments of all that lies above.

    Unknown functions of the unstretched length S from the clamp: theta, x, z and the moment m that bends toward +x.
    """

    def right_hand_side(s, y, p):
        theta, _, _, moment = y
        push, upright = p
        downward = WEIGHT * (L - s + END) - upright  # of everything above
        axial = -push * np.sin(theta) - downward * np.cos(theta)
        curvature = (load.moment_n_m + moment + axial * load.stretch.per_curvature_m) / load.stiffness_n_m2
        stretch = load.stretch.straight + load.stretch.per_curvature_m * curvature
        stretch += load.stretch.compliance_per_n * axial
        x_slope, z_slope = stretch * np.sin(theta), stretch * np.cos(theta)
        return np.stack([curvature, x_slope, z_slope, push * z_slope - downward * x_slope])

    def closing(clamp, tip, p):
        theta, x, z, moment = tip
        push, upright = p
        rim = np.array([END * math.sin(theta) + RIM * math.cos(theta), END * math.cos(theta) - RIM * math.sin(theta)])
        tip_moment = -push * rim[1] - upright * rim[0] + WEIGHT * END * 0.5 * END * math.sin(theta)
        last = upright - math.copysign(FRICTION_COEFFICIENT, contact.friction_n) * push
        if not is_sliding:
            last = z + rim[1] - contact.rim_z_m
        return np.array([clamp[0], clamp[1], clamp[2] - END, moment - tip_moment, x + rim[0] - RIM, last])

    s = np.linspace(0.0, L, 41)
    start = np.stack([contact.tip_angle_rad * (s / L) ** 2, 0.0 * s, END + s, 0.0 * s])
    found = solve_bvp(right_hand_side, closing, s, start, p=[contact.push_n, contact.friction_n], tol=1e-8)
    assert found.success, found.message
    return *found.p, found.y[0, -1]


@pytest.mark.parametrize("pressure_kpa", [40, 70, 100])
@pytest.mark.parametrize(
    "loads", [*PATHS.values(), INEXTENSIBLE, YIELDING], ids=["pdc", "psc", "inextensible", "yielding"]
)
def test_force_friction_and_angle_are_those_of_an_independent_solver(loads, pressure_kpa):
    count = pressure_kpa // 5 - 1
    contact = blocked_path(loads[:count], GEOMETRY)[-1]
    slip = abs(abs(contact.friction_n) / contact.push_n - FRICTION_COEFFICIENT)
    found = boundary_value_solution(loads[count - 1], contact, is_sliding=slip < 1e-9)
    assert (contact.push_n, contact.friction_n, contact.tip_angle_rad) == pytest.approx(found, rel=1e-4, abs=3e-5)


@pytest.mark.parametrize("loads", [*PATHS.values(), INEXTENSIBLE], ids=["pdc", "psc", "inextensible"])
def test_friction_opposes_sliding_and_is_within_its_cone_where_it_sticks(loads):
    shorter = loads[0].stretch.compliance_per_n * WEIGHT * (0.5 * L + END) * L
    heights = [GEOMETRY.length_m - shorter]
    for contact in blocked_path(loads, GEOMETRY):
        share = contact.friction_n / (FRICTION_COEFFICIENT * contact.push_n)
        slip = contact.rim_z_m - heights[-1]
        assert abs(share) <= 1.0 + 1e-9
        assert slip * share <= 0.0
        assert slip == 0.0 or abs(share) == pytest.approx(1.0)
        heights.append(contact.rim_z_m)


def test_the_stretching_tip_slides_up_and_then_sticks_and_the_inextensible_one_slides_down():
    for loads in PATHS.values():
        path = blocked_path(loads, GEOMETRY)
        assert path[0].friction_n == pytest.approx(-FRICTION_COEFFICIENT * path[0].push_n)
        assert path[-1].rim_z_m == path[-2].rim_z_m > GEOMETRY.length_m
    assert all(contact.friction_n > 0.0 for contact in blocked_path(INEXTENSIBLE, GEOMETRY))


def test_a_small_moment_gives_the_propped_rods_force_with_the_frictions_moment():
    """N = k (M0 - mu R N) with the lever k of the straight propped rod: the friction pulls the rim up."""
    load = RodLoad(1e-6, 1.7e-3)
    lever = blocked_tip_force_per_moment(GEOMETRY)
    without = blocked_path([load], GEOMETRY, friction_coefficient=0.0, gravity_m_s2=0.0)[0]
    assert without.push_n == pytest.approx(lever * load.moment_n_m, rel=1e-4)
    contact = blocked_path([load], GEOMETRY, gravity_m_s2=0.0)[0]
    expected = lever * load.moment_n_m / (1.0 + FRICTION_COEFFICIENT * RIM * lever)
    assert contact.push_n == pytest.approx(expected, rel=1e-4)


def test_large_deflection_friction_and_stretch_all_matter_at_100_kpa():
    forces = [
        blocked_path(loads, GEOMETRY, friction)[-1].push_n
        for loads, friction in itertools.product((PATHS["pdc"], INEXTENSIBLE), (0.0, FRICTION_COEFFICIENT))
    ]
    small = blocked_tip_force_per_moment(GEOMETRY) * INEXTENSIBLE[-1].moment_n_m
    assert all(abs(force / small - 1.0) > 0.04 for force in forces)
    assert forces[1] > 1.15 * forces[0] and forces[3] < 0.9 * forces[2]


@pytest.mark.parametrize("pattern", ["pdc", "psc"])
def test_steps_of_5_kpa_are_small_enough_for_the_friction_to_remember(pattern):
    pressures = [np.arange(10e3, 101e3, step) for step in (5e3, 2.5e3)]
    coarse, fine = (blocked_path(pattern_loads(LAW, pattern, p), GEOMETRY)[-1].push_n for p in pressures)
    assert coarse == pytest.approx(fine, rel=2e-3)


def test_a_rod_that_snaps_past_the_plate_is_a_typed_error_that_names_it():
    with pytest.raises(RodSolutionError, match=r"no equilibrium of the blocked rod with M0 = \d+ N mm, B = 1000 N mm2"):
        blocked_path([RodLoad(moment, 1e-3, AxisStretch(1.1)) for moment in np.linspace(0.01, 0.2, 20)], GEOMETRY)
