"""What answers a fault: every row of the table, as the arbiter does it, and the way back that is the same for all."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.grasp import responses
from mbpam_ros.grasp.arbitration import Arbiter, Phase, load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.responses import RESPONSES, Response, goes_on, respond
from mbpam_ros.grasp.selection import ModeSelector
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.findings import SUPPLY, Fault, Finding

GRIPPER, CONFIG, MODES = load_gripper(), load_grasp_config(), load_modes()
CELLS = [(fault, phase) for fault, row in RESPONSES.items() for phase in row]


class Grasp:
    """An arbiter with its clock, brought to a phase."""

    def __init__(self, phase, config=CONFIG.arbitration):
        selector = ModeSelector(CONFIG.selection, GRIPPER, MODES)
        self.arbiter = Arbiter(config, MODES, selector, GRIPPER.pressure_limit_gauge_pa, 120e3)
        self.time_s = 0.0
        self.pass_time(0.1, np.zeros(16))
        if phase is not Phase.IDLE:
            assert self.arbiter.request_mode("envelope", self.time_s).accepted
        if phase in (Phase.HOLDING, Phase.RELEASING):
            self.pass_time(0.5, self.decision.setpoint_gauge_pa)
        if phase is Phase.RELEASING:
            self.arbiter.release(self.time_s)
        assert self.decision.phase is phase

    @property
    def decision(self):
        return self.arbiter.tick(self.time_s)

    def pass_time(self, duration_s, pressure_pa):
        for _ in range(round(duration_s / 0.01)):
            self.time_s += 0.01
            self.arbiter.observe_pressures(self.time_s, pressure_pa)

    def find(self, *faults):
        channels = {Fault.SUPPLY_LOW: (SUPPLY,)}
        found = [Finding(fault, channels.get(fault, ("finger_1_chamber_1",)), "seen", 0.9) for fault in faults]
        self.arbiter.observe_findings(self.time_s, found)


@pytest.mark.parametrize(("fault", "phase"), CELLS, ids=lambda each: each.name.lower())
def test_every_cell_of_the_table_is_what_the_arbiter_does(fault, phase):
    grasp = Grasp(phase)
    before = grasp.decision
    grasp.find(fault)
    answer, decision = RESPONSES[fault][phase], grasp.decision
    if answer is Response.REGULATE:
        assert (decision.phase, decision.air) == (phase, Air.REGULATE)
        np.testing.assert_array_equal(decision.setpoint_gauge_pa, before.setpoint_gauge_pa)
    else:
        assert (decision.phase, decision.air) == (Phase.FAULT, answer.air)
        assert fault.value in decision.reason
        keeps = answer is not Response.VENT_ALL
        assert decision.setpoint_gauge_pa.any() == (keeps and before.setpoint_gauge_pa.any())

    # While it stands nothing new begins, and nothing is lifted that is latched.
    grasp.arbiter.release(grasp.time_s)
    grasp.pass_time(0.1, np.zeros(16))
    assert not grasp.arbiter.reset(grasp.time_s).accepted or decision.phase is not Phase.FAULT
    refusal = grasp.arbiter.request_mode("envelope", grasp.time_s)
    assert not refusal.accepted and fault.value in refusal.reason

    # Mended, the way back is the same for all.
    grasp.find()
    assert grasp.arbiter.reset(grasp.time_s).accepted
    assert grasp.arbiter.request_mode("envelope", grasp.time_s).accepted


def test_every_fault_has_a_row_and_every_answer_is_explained():
    assert set(RESPONSES) == set(Fault)
    assert all(set(row) == set(Phase) - {Phase.FAULT} for row in RESPONSES.values())
    for answer in Response:
        assert answer.value in responses.__doc__
    for fault in Fault:
        assert fault.value in responses.__doc__
    assert {fault for fault in Fault if goes_on(fault)} == {Fault.LEAK, Fault.LEAK_OR_DRIFT, Fault.NOISY}


def test_what_may_have_been_filled_blind_is_never_trapped():
    for fault, row in RESPONSES.items():
        if not goes_on(fault):
            assert row[Phase.CLOSING] is Response.VENT_ALL


def test_the_gravest_of_several_answers_wins_whatever_their_order():
    leak, rises = (Finding(fault, ("finger_2_chamber_1",), "", 1.0) for fault in (Fault.LEAK, Fault.RISES))
    for order in ((leak, rises), (rises, leak)):
        assert respond(order, Phase.HOLDING) == (Response.CUT_SUPPLY, rises.text)
    assert respond((), Phase.HOLDING) == (Response.REGULATE, "")


@pytest.mark.parametrize(("grip_pa", "harder_pa"), [(60e3, 80e3), (100e3, GRIPPER.pressure_limit_gauge_pa)])
def test_the_other_fingers_take_over_what_one_held_within_the_limit(grip_pa, harder_pa):
    pressures = dataclasses.replace(CONFIG.arbitration.grip_pressure_gauge_pa, envelope=grip_pa)
    grasp = Grasp(Phase.HOLDING, dataclasses.replace(CONFIG.arbitration, grip_pressure_gauge_pa=pressures))
    before_pa = grasp.decision.setpoint_gauge_pa
    grasp.find(Fault.NOT_FOLLOWING)
    for _ in range(2):  # once, however long the finding stands
        after_pa = grasp.decision.setpoint_gauge_pa
        np.testing.assert_allclose(after_pa[1:], np.where(before_pa[1:] > 0.0, harder_pa, 0.0))
        assert after_pa[0] == before_pa[0]
        grasp.find(Fault.NOT_FOLLOWING)
    refusal = grasp.arbiter.reset(grasp.time_s)
    assert not refusal.accepted and "call grasp/release first" in refusal.reason


def test_what_a_fault_keeps_is_closed_or_vented_by_a_graver_one_and_never_opened_again():
    grasp = Grasp(Phase.HOLDING)
    for found, air in (
        ((Fault.NOT_FOLLOWING,), Air.REGULATE),
        ((Fault.NOT_FOLLOWING, Fault.SUPPLY_LOW), Air.HOLD),
        ((Fault.NOT_FOLLOWING,), Air.HOLD),
        ((Fault.NOT_FOLLOWING, Fault.OVER_PRESSURE), Air.VENT),
    ):
        grasp.find(*found)
        assert grasp.decision.air is air


def test_pressure_in_an_idle_chamber_keeps_a_grasp_from_starting():
    grasp = Grasp(Phase.IDLE)
    grasp.pass_time(0.1, np.where(np.arange(16) == 7, 8e3, 0.0))
    refusal = grasp.arbiter.request_mode("envelope", grasp.time_s)
    assert not refusal.accepted and "finger_2_chamber_4 at 8000 Pa" in refusal.reason
    grasp.pass_time(0.1, np.zeros(16))
    assert grasp.arbiter.request_mode("envelope", grasp.time_s).accepted
