"""The plant's rod under tip loads and gravity from any side, beside the actuator's boundary-value solution."""

import numpy as np
import pytest
from scipy.optimize import root

from mbpam_ros.actuator.elastic_rod import RodLoads, RodSection, rod_at_rest
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.mechanics.kernel import entry
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.rod import (
    build_rod,
    coordinates_of,
    masses_and_loads,
    motion_at_rest,
    move_rods,
    position_weights,
    room_for_loads,
)

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("rod_under_tip_loads")]  # compiled once

GEOMETRY = load_gripper().geometry
LENGTH = GEOMETRY.active_length_m
SECTION = RodSection(0.035, 0.01, 1.5e-3, 0.1, 0.004, 0.001, 1.0 / 25.0, 1.0 / 0.8e-3)
HANGING, LEVEL, UPRIGHT = (0.0, 0.0, 9.81), (0.0, 9.81, 0.0), (0.0, 0.0, -9.81)
LOADS = [
    RodLoads(force, 0.0, gravity)
    for force in ((0.0, 0.0, 0.0), (0.0, 0.05, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, 0.1))
    for gravity in (HANGING, LEVEL)
] + [RodLoads((0.0, 0.0, 0.0), 0.0, UPRIGHT), RodLoads((0.0, 0.05, 0.0), 0.0, (0.0, 0.0, 0.0))]


move, weigh = entry(move_rods.py_func), entry(masses_and_loads.py_func)


class PlantRod:
    """One muscle of the plant, at rest under a dead force on its tip."""

    def __init__(self, modes, twist, stretch):
        segments = max(4, modes + 2)
        self.rod = build_rod(GEOMETRY, modes, segments, 2, twist, stretch)
        self.size, self.ends = coordinates_of(self.rod), [2 * modes, 2 * modes + twist]
        self.motion, self.room = motion_at_rest(self.rod), room_for_loads(self.rod)
        self.mass, self.load = np.empty((self.size, self.size, WIDTH)), np.empty((self.size, WIDTH))
        self.tip = position_weights(GEOMETRY, segments, [GEOMETRY.length_m], stretch > 0)[0]

    def elastic_load(self, q, section):
        bend, twist, stretch = np.split(q, self.ends)
        modes, common = len(bend) // 2, min(len(bend) // 2, len(stretch))
        b, slope = bend.reshape(modes, 2), np.array([section.slope_x_m, section.slope_y_m]) / LENGTH
        on_bend = -section.stiffness_n_m2 * self.rod.springs[:modes, None] * b
        on_bend[0] += section.moment_x_n_m, section.moment_y_n_m
        off = stretch.copy()
        off[:1] -= section.free_stretch
        off[:common] -= b[:common] @ slope
        on_stretch = -self.rod.stretch_springs * off / section.axial_compliance_per_n
        on_bend[:common] -= on_stretch[:common, None] * slope
        on_twist = -self.rod.springs[: len(twist)] * twist / section.torsion_compliance_per_n_m2
        return np.concatenate([on_bend.ravel(), on_twist, on_stretch])

    def out_of_balance(self, q, section, loads, share):
        move(np.repeat(q[:, None], WIDTH, axis=1), np.zeros((self.size, WIDTH)), self.rod, self.motion)
        gravity = tuple(share * np.array(loads.gravity_m_s2))
        weigh(self.rod, self.motion, gravity, self.room, self.mass, self.load)
        at_tip = share * np.einsum("k,kij,i->j", self.tip, self.motion.of(0).slope, loads.tip_force_n)
        return self.load[:, 0] + at_tip + self.elastic_load(q, section)

    def tip_m(self, section, loads):
        q = np.zeros(self.size)
        for share in np.linspace(0.0, 1.0, 9):
            found = root(self.out_of_balance, q, (section, loads, share), tol=1e-12)
            assert np.abs(found.fun).max() < 1e-9
            q = found.x
        move(np.repeat(q[:, None], WIDTH, axis=1), np.zeros((self.size, WIDTH)), self.rod, self.motion)
        return self.tip @ self.motion.of(0).tangent


@pytest.mark.slow
@pytest.mark.parametrize("loads", LOADS)
def test_the_tip_converges_to_the_boundary_value_solution(loads):
    expected = rod_at_rest(SECTION, GEOMETRY, loads).tip_position_m
    coarse, fine = (
        np.linalg.norm(PlantRod(*modes).tip_m(SECTION, loads) - expected) for modes in ((3, 2, 2), (5, 4, 4))
    )
    assert coarse < 2e-3 * LENGTH
    assert fine < 5e-5 * LENGTH


def test_a_force_from_the_side_moves_the_tip_as_the_boundary_value_solution_says_to_a_thousandth():
    aside, nothing = RodLoads((0.0, 0.05, 0.0)), RodLoads()
    expected, found = (
        [solve(loads) for loads in (aside, nothing)]
        for solve in (
            lambda loads: rod_at_rest(SECTION, GEOMETRY, loads).tip_position_m,
            lambda loads: PlantRod(4, 4, 4).tip_m(SECTION, loads),
        )
    )
    way = expected[0] - expected[1]
    assert np.linalg.norm(way) > 0.01
    assert np.linalg.norm(found[0] - found[1] - way) < 1e-3 * np.linalg.norm(way)
