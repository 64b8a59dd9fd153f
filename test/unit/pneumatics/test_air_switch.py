"""Who may open a valve."""

import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air, AirSwitch
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import PressureController, SetpointError

GRIPPER = load_gripper()
GRIP = np.full(16, 50e3)


class Valves:
    """Loops with a switch before them, and pressures in the test's hands."""

    def __init__(self, switched_on=True, pressure_pa=20e3):
        limits = GRIPPER.pressure_limit_gauge_pa, GRIPPER.over_pressure_gauge_pa
        self.controller = PressureController(load_pneumatics().controller, *limits)
        self.switch = AirSwitch(self.controller, switched_on)
        self.pressure_pa, self.time_s = np.full(16, pressure_pa), 0.0

    def openings(self, updates=3):
        for _ in range(updates):
            self.time_s += 0.01
            openings = self.controller.update(self.time_s, self.pressure_pa)
        return openings


def test_without_set_points_the_valves_stay_closed_whatever_is_in_the_chambers():
    valves = Valves()
    assert not valves.openings().any()
    assert valves.switch.request(GRIP)
    assert (valves.openings() > 0.0).all()
    assert not valves.switch.request(GRIP)


def test_without_the_operator_the_valves_stay_closed():
    valves = Valves(switched_on=False)
    valves.switch.request(GRIP)
    assert not valves.openings().any()
    assert valves.switch.switch(True).reason == "air on"
    assert (valves.openings() > 0.0).all()
    assert valves.switch.switch(False).reason == "air off, valves closed"
    assert not valves.openings().any()


def test_hold_closes_and_regulate_goes_on():
    valves = Valves()
    valves.switch.request(GRIP)
    assert valves.switch.obey(Air.HOLD)
    assert not valves.openings().any()
    assert valves.switch.obey(Air.REGULATE)
    assert (valves.openings() > 0.0).all()


@pytest.mark.parametrize("switched_on", [True, False])
def test_vent_opens_all_whoever_has_the_air_off_and_yields_to_a_clear_alone(switched_on):
    valves = Valves(switched_on)
    assert valves.switch.obey(Air.VENT)
    assert not valves.switch.obey(Air.HOLD)
    assert not valves.switch.obey(Air.REGULATE)
    assert (valves.openings() == -1.0).all() and valves.switch.air is Air.VENT
    assert valves.switch.switch(False).reason == "air off, valves vent until grasp/reset"
    assert (valves.openings() == -1.0).all()
    assert valves.switch.clear().accepted
    assert not valves.openings().any()


def test_a_clear_lifts_the_latch_and_the_arbiter_s_word_ends_the_vent():
    valves = Valves()
    valves.switch.obey(Air.VENT, reason="stop requested")
    assert valves.switch.vent_reason == "stop requested"
    valves.switch.clear()
    assert valves.switch.vent_reason == "" and (valves.openings() == -1.0).all()
    valves.switch.obey(Air.VENT, reason="said again, as a fault's text changes")
    assert valves.switch.vent_reason == ""
    assert valves.switch.obey(Air.REGULATE)
    assert not valves.openings().any()


@pytest.mark.parametrize("air", [Air.HOLD, Air.VENT])
def test_the_operator_cannot_switch_on_against_the_arbiter(air):
    valves = Valves(switched_on=False)
    valves.switch.obey(air, reason="stop requested")
    answer = valves.switch.switch(True)
    says = "the arbiter says hold" if air is Air.HOLD else "all is vented (stop requested)"
    assert not answer.accepted and answer.reason == f"{says}; call grasp/reset first"
    valves.switch.clear()
    valves.switch.obey(Air.REGULATE)
    valves.switch.request(GRIP)
    assert not valves.openings().any()


def test_refused_set_points_are_not_the_first():
    valves = Valves()
    with pytest.raises(SetpointError):
        valves.switch.request(np.full(16, 1e9))
    assert not valves.openings().any()


def test_who_leaves_closes_the_valves_or_lets_them_vent():
    valves = Valves()
    assert valves.switch.parting_opening == 0.0
    valves.switch.obey(Air.HOLD)
    assert valves.switch.parting_opening == 0.0
    valves.switch.obey(Air.VENT)
    assert valves.switch.parting_opening == -1.0


def test_an_operator_s_vent_needs_no_arbiter_and_its_clear_lets_nothing_in_again():
    valves = Valves()
    valves.switch.request(GRIP)
    assert valves.switch.vent("asked for").accepted
    assert (valves.openings() == -1.0).all()
    with pytest.raises(SetpointError, match="vented by a stop"):
        valves.switch.request(GRIP)
    valves.switch.clear()
    assert (valves.openings() <= 0.0).all() and not valves.controller.setpoint.any()


def test_a_vent_cleared_while_the_arbiter_holds_leaves_the_valves_closed():
    valves = Valves()
    valves.switch.request(GRIP)
    valves.switch.obey(Air.HOLD)
    valves.switch.vent("asked for")
    valves.switch.clear()
    assert not valves.openings().any()


def test_without_its_arbiter_a_grasp_that_closes_is_vented_and_stays_so():
    valves = Valves()
    valves.switch.request(GRIP)
    valves.switch.obey(Air.REGULATE, closing=True)
    valves.switch.lose_arbiter()
    assert (valves.openings() == -1.0).all()
    valves.switch.find_arbiter()
    valves.switch.obey(Air.HOLD)
    assert (valves.openings() == -1.0).all()
    assert "silent while a grasp closed" in valves.switch.vent_reason


def test_without_its_arbiter_a_grasp_that_holds_is_regulated_on_and_nothing_new_begins():
    valves = Valves()
    valves.switch.request(GRIP)
    valves.switch.obey(Air.REGULATE, closing=True)
    valves.switch.obey(Air.REGULATE, closing=False)
    valves.switch.lose_arbiter()
    assert (valves.openings() > 0.0).all()
    with pytest.raises(SetpointError, match="the arbiter has fallen silent"):
        valves.switch.request(np.full(16, 60e3))
    assert not valves.switch.switch(True).accepted
    valves.switch.find_arbiter()
    valves.switch.request(np.full(16, 60e3))


@pytest.mark.parametrize("closing", [True, False])
def test_where_two_command_valves_close_and_a_grasp_that_closes_is_vented(closing):
    valves = Valves()
    valves.switch.request(GRIP)
    valves.switch.obey(Air.REGULATE, closing=closing)
    valves.switch.contest("arbiters", "two run")
    assert (valves.openings() == (-1.0 if closing else 0.0)).all()
    with pytest.raises(SetpointError, match="two run"):
        valves.switch.request(GRIP)
    assert not valves.switch.switch(True).accepted
    valves.switch.contest("arbiters", None)
    assert (valves.openings() == -1.0).all() if closing else (valves.openings() > 0.0).all()
