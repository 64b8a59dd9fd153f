"""The hand as a gripper with two jaws: openings and forces against pressures, and what becomes of a command."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.actuator.kinematics import tip_pose
from mbpam_ros.grasp.arbitration import build_arbiter, load_grasp_config
from mbpam_ros.grasp.holding import Holding, Verdict
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.opening import AUTO, Command, TipOpening, TwoJaws, grasp_of, outcome
from mbpam_ros.grasp.phases import Phase
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air

GRIPPER, MODES = load_gripper(), load_modes()
TIPS = TipOpening(GRIPPER, MODES)
LIMIT_PA, GRIP_PA = GRIPPER.pressure_limit_gauge_pa, 100e3
EACH_MODE = pytest.mark.parametrize("mode", MODES)


@EACH_MODE
def test_straight_fingers_are_as_far_apart_as_they_stand_and_close_with_the_pressure(mode):
    across_m = 2.0 * GRIPPER.finger_circle_radius_m * (1.0 if mode == "envelope" else math.sqrt(0.5))
    assert TIPS.widest_m(mode) == pytest.approx(across_m - 2.0 * GRIPPER.geometry.outer_radius_m)
    states = np.array([TIPS.at(mode, pressure_pa) for pressure_pa in np.linspace(0.0, LIMIT_PA, 50)])
    assert (np.diff(states[:, 0]) <= 0.0).all() and states[-1, 0] < 0.5 * states[0, 0]
    assert (np.diff(states[:, 1]) >= 0.0).all() and states[0, 1] == 0.0


def test_the_opening_is_that_of_arcs_which_bend_toward_each_other():
    pressure_pa, half_m = 40e3, GRIPPER.finger_circle_radius_m * math.sqrt(0.5)
    chambers = MODES["mid_rod"].setpoints(pressure_pa).reshape(4, 4)
    bend = hanging_bend(*GRIPPER.calibration().law.moment_and_stiffness(chambers), GRIPPER.rod_geometry)
    inward_m = np.abs(tip_pose(bend, GRIPPER.rod_geometry)[0][:, 0])
    np.testing.assert_allclose(inward_m, inward_m[0])
    opening_m = 2.0 * (half_m - inward_m[0] - GRIPPER.geometry.outer_radius_m)
    assert TIPS.at("mid_rod", pressure_pa).opening_m == pytest.approx(opening_m) and opening_m > 0.0


@EACH_MODE
def test_a_command_gets_the_pressure_that_exceeds_neither_its_opening_nor_its_force(mode):
    pressure = lambda opening_m, force_n: TIPS.pressure_gauge_pa(mode, opening_m, force_n, GRIP_PA)  # noqa: E731
    assert pressure(0.0, 0.0) == GRIP_PA
    assert pressure(0.0, 100.0) == LIMIT_PA
    assert pressure(TIPS.widest_m(mode), 0.0) == pytest.approx(0.0, abs=1.0)
    half_m, force_n = 0.5 * TIPS.widest_m(mode), 0.1
    for_opening_pa, for_force_pa = pressure(half_m, 0.0), pressure(0.0, force_n)
    assert TIPS.at(mode, for_opening_pa).opening_m == pytest.approx(half_m)
    assert TIPS.at(mode, for_force_pa).force_n == pytest.approx(force_n)
    assert pressure(half_m, force_n) == min(for_opening_pa, for_force_pa)


class Hand:
    """An arbiter whose pressures follow its set-points."""

    def __init__(self):
        self.arbiter = build_arbiter(load_grasp_config(), GRIPPER, MODES)
        self.jaws, self.time_s = TwoJaws(self.arbiter, GRIPPER, MODES), 0.0
        self.wait()

    def wait(self, ticks=50):
        for _ in range(ticks):
            self.time_s += 0.02
            self.decision = self.arbiter.tick(self.time_s)
            self.arbiter.observe_pressures(self.time_s, self.decision.setpoint_gauge_pa)
        self.decision = self.arbiter.tick(self.time_s)

    def ask(self, opening_m, force_n=0.0, mode="mid_rod"):
        answer = self.jaws.request(self.time_s, mode, opening_m, force_n)
        self.decision = self.arbiter.tick(self.time_s)
        return answer, Command(self.jaws.opens(mode, opening_m), grasp_of(self.decision))


def test_a_hand_closes_as_far_and_as_hard_as_it_is_told_and_opens_again():
    hand = Hand()
    answer, closing = hand.ask(0.0, 0.15)
    assert answer.accepted and not outcome(closing, hand.decision).done
    hand.wait()
    found = outcome(closing, hand.decision)
    assert found.done and found.succeeded and found.reached and not found.stalled
    assert hand.jaws.state("mid_rod").force_n == pytest.approx(0.15)
    assert not hand.ask(0.01)[0].accepted  # as any operator's request: it holds something
    answer, opening = hand.ask(0.08)
    assert answer.accepted and opening.opens and not outcome(opening, hand.decision).done
    # The grasp that is let go of was not what it was told to be.
    assert outcome(closing, hand.decision)[:2] == (True, False)
    hand.wait()
    assert outcome(opening, hand.decision)[:4] == (True, True, False, True)
    assert hand.jaws.state("mid_rod").opening_m == pytest.approx(TIPS.widest_m("mid_rod"))


def test_what_is_held_stalls_the_hand_and_a_fault_or_another_grasp_ends_the_command():
    hand = Hand()
    _, closing = hand.ask(0.0)
    hand.wait()
    held = replace(hand.decision, holding=Verdict(Holding.HELD, 0.98, ("air",)))
    assert outcome(closing, held)[1:4] == (True, True, False)
    others = (replace(held, phase=Phase.FAULT, air=Air.HOLD), replace(held, mode="envelope"))
    assert all(outcome(closing, each)[:2] == (True, False) for each in others)
    assert outcome(Command(opens=True), replace(held, phase=Phase.FAULT))[:2] == (True, False)


def test_the_camera_s_choice_and_unknown_modes_answer_as_the_services_do():
    hand = Hand()
    assert "no detection yet" in hand.ask(0.0, mode=AUTO)[0].reason
    assert "no mode 'hug'" in hand.ask(0.0, mode="hug")[0].reason
    assert hand.ask(0.08, mode=AUTO)[1].opens
