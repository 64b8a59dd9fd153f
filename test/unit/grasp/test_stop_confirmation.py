"""What a stop is answered with."""

import math

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.grasp.confirmation import ANSWER_WITHIN_S, FALL_PA, StopConfirmation

OPEN_PA = 5e3
HELD = np.where(np.arange(16) % 5 == 0, 99.7e3, 0.0)
LATE_S = ANSWER_WITHIN_S + 0.001


def stopped_at(pressure_pa=HELD, acknowledged=True):
    stop = StopConfirmation(10.0, pressure_pa, OPEN_PA)
    if acknowledged:
        stop.acknowledge()
    return stop


def test_acknowledged_and_falling_it_is_answered_at_once():
    stop = stopped_at()
    assert stop.verdict(10.01, HELD) is None
    answer = stop.verdict(10.05, HELD - np.where(HELD > 0.0, 1.1 * FALL_PA, 0.0))
    assert answer.accepted
    assert "valve_controller vents" in answer.reason and "all fall, the highest is 99150 Pa" in answer.reason


def test_with_nothing_in_the_chambers_the_acknowledgement_is_all_it_takes():
    assert "all are down" in stopped_at(np.zeros(16)).verdict(10.0, np.zeros(16)).reason


def test_pressures_that_fall_are_a_stop_that_nobody_acknowledged():
    stop = stopped_at(acknowledged=False)
    assert stop.verdict(10.1, 0.5 * HELD) is None
    answer = stop.verdict(10.0 + LATE_S, 0.5 * HELD)
    assert answer.accepted and "has not acknowledged" in answer.reason


@pytest.mark.parametrize("acknowledged", [True, False])
def test_pressures_that_stand_are_named_and_it_is_no_success(acknowledged):
    now_pa = np.where(np.arange(16) == 5, HELD, 0.5 * HELD)
    answer = stopped_at(acknowledged=acknowledged).verdict(10.0 + LATE_S, now_pa)
    assert not answer.accepted
    assert f"there stand {CHANNEL_NAMES[5]} at 99700 Pa; shut the air off" in answer.reason
    assert ("nobody answers" in answer.reason) == (not acknowledged)


def test_pressures_that_nobody_measures_confirm_nothing():
    answer = stopped_at().verdict(10.0 + LATE_S, np.full(16, math.nan))
    assert not answer.accepted and "16 chambers at pressures that nobody measures" in answer.reason
    some = np.where(np.arange(16) == 3, math.nan, 40e3)
    assert f"{CHANNEL_NAMES[3]} at an unknown pressure" in stopped_at(some).verdict(10.0 + LATE_S, some).reason


def test_many_that_stand_are_counted():
    answer = stopped_at(np.full(16, 80e3)).verdict(10.0 + LATE_S, np.full(16, 80e3))
    assert answer.reason.count("Pa,") + answer.reason.count("Pa and") == 4 and "and 12 more" in answer.reason
