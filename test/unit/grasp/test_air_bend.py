"""How far fingers are bent, told from the air that was let into their chambers."""

import math

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.grasp.air_bend import LONGEST_ACCOUNT_S, LONGEST_GAP_S, AirBend
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.iso6358 import IsoChambers

CHAMBER = load_pneumatics().chamber
TICK_S = 0.01
FILL_S = 0.25


@pytest.fixture(scope="module")
def air():
    return AirBend(load_gripper(), CHAMBER)


def toward(azimuth_deg, bend_deg):
    return np.array([math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))]) * math.radians(bend_deg)


def filled(air, azimuths_deg, bends_deg, gain=1.0):
    """Fill the chambers of four fingers that are held in a bend, and return what the air tells of it [deg]."""
    chambers = np.array([pressurised_chambers(math.radians(each)) for each in azimuths_deg]).ravel()
    bend = np.array([toward(azimuth, each) for azimuth, each in zip(azimuths_deg, bends_deg, strict=True)])
    real = IsoChambers(CHAMBER)
    air.begin(0.0, real.pressure_gauge_pa)
    for tick in range(round(FILL_S / TICK_S) + 2):
        spool = 0.8 * chambers * (tick < round(FILL_S / TICK_S))
        air.update(tick * TICK_S, spool)
        moving = min(1.0, tick * TICK_S / (0.6 * FILL_S))
        real.step(gain * spool, TICK_S, moving * bend)
    air.update((tick + 1) * TICK_S, np.zeros(16))
    assert 60e3 < real.pressure_gauge_pa[chambers].min() and real.pressure_gauge_pa.max() < 130e3
    return np.degrees(air.bend_rad(real.pressure_gauge_pa, chambers))


@pytest.mark.parametrize("mode", ["envelope", "short_rod", "mid_rod"])
def test_the_bend_of_fingers_that_are_held_comes_back_from_the_air(air, mode):
    bends = (30.0, 50.0, 70.0, 90.0)
    told = filled(air, load_modes()[mode].bend_azimuth_deg, bends)
    assert told == pytest.approx(bends, abs=6.0)


def test_valves_that_let_in_more_than_they_are_taken_for_make_the_fingers_seem_straighter(air):
    azimuths, bends = load_modes()["envelope"].bend_azimuth_deg, (60.0,) * 4
    right, more, less = (filled(air, azimuths, bends, gain) for gain in (1.0, 1.01, 0.99))
    assert (more < right - 2.0).all() and (less > right + 2.0).all()
    assert (np.abs(np.array([more, less]) - right) < 12.0).all()


def test_fingers_without_pressure_are_not_told(air):
    azimuths = load_modes()["envelope"].bend_azimuth_deg
    chambers = np.array([pressurised_chambers(math.radians(each)) for each in azimuths]).ravel()
    chambers[4:8] = False
    air.begin(0.0, np.zeros(16))
    told = air.bend_rad(np.full(16, 50e3), chambers)
    assert list(np.isnan(told)) == [False, True, False, False]


@pytest.mark.parametrize("gap_s", [LONGEST_GAP_S + 0.01, -0.01])
def test_openings_that_are_not_known_for_a_while_leave_the_bend_unknown(air, gap_s):
    air.begin(1.0, np.zeros(16))
    air.update(1.0 + gap_s, np.zeros(16))
    assert not air.known and np.isnan(air.bend_rad(np.full(16, 50e3), np.ones(16, dtype=bool))).all()
    air.begin(2.0, np.zeros(16))
    assert air.known


def test_an_account_of_the_air_ends_before_its_errors_have_added_up(air):
    air.begin(0.0, np.zeros(16))
    for tick in range(1, 2 + int(LONGEST_ACCOUNT_S / 0.08)):
        assert air.known
        air.update(0.08 * tick, np.zeros(16))
    assert not air.known


def test_an_opening_that_is_no_number_leaves_the_bend_unknown(air):
    air.begin(1.0, np.zeros(16))
    air.update(1.01, np.full(16, np.nan))
    assert not air.known
