"""ISO 6358 orifices between tank, chambers and ambient, against closed forms and an independent integrator."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbpam_ros.actuator.gas_volume import chamber_bend_rad, gas_volume_tables
from mbpam_ros.pneumatics.chamber import AMBIENT_PA
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.iso6358 import gas_amount, orifice_flow, volume_rows
from mbpam_ros.pneumatics.registry import build_pneumatics

CHAMBER = load_pneumatics().chamber
B = CHAMBER.iso6358.critical_ratio
FULL = np.ones(16)


def model(**changes):
    orifices = dataclasses.replace(CHAMBER.iso6358, **changes)
    return build_pneumatics("iso6358", dataclasses.replace(CHAMBER, iso6358=orifices))


def run(chambers, spool, duration_s):
    """Step by 2 ms, so that the number of steps within one call is never the limit."""
    for _ in range(round(duration_s / 2e-3)):
        pressure_pa = chambers.step(spool, 2e-3)
    return pressure_pa


def gas_j(chambers):
    """All the gas in tank and chambers, p V."""
    return (chambers.supply_gauge_pa + AMBIENT_PA) * CHAMBER.iso6358.supply_volume_m3 + chambers._amount.sum()


def test_what_seeps_leaves_the_pressure_where_it_went():
    """A leak's time constant is that of the pressure, whatever the walls give way."""
    chambers = model()
    chambers.reset(100e3)
    for _ in range(50):
        left_pa = chambers.seep(FULL / 2.0, 0.0 * FULL, 0.01)
        assert chambers.step(0.0 * FULL, 1e-3) == pytest.approx(left_pa, abs=1.0)
    assert left_pa == pytest.approx(100e3 * math.exp(-0.25), rel=1e-6)


def test_flow_below_the_critical_ratio_depends_on_the_upstream_pressure_only():
    assert orifice_flow(B, 300e3, 80e3)[0] == orifice_flow(B, 300e3, 20e3)[0] == pytest.approx(100e3 * 300e3)


def test_subsonic_flow_follows_the_ellipse_of_the_standard():
    ratio = 0.7
    expected = 100e3 * 300e3 * math.sqrt(1.0 - ((ratio - B) / (1.0 - B)) ** 2)
    assert orifice_flow(B, 300e3, ratio * 300e3)[0] == pytest.approx(expected, rel=1e-12)


def test_flow_turns_with_the_pressure_difference_and_vanishes_without_one():
    assert orifice_flow(B, 200e3, 150e3)[0] == -orifice_flow(B, 150e3, 200e3)[0] > 0.0
    assert orifice_flow(B, 150e3, 150e3)[0] == 0.0


@pytest.mark.parametrize("downstream_pa", [50e3, 150e3, 250e3, 299.5e3, 300.4e3, 320e3, 1200e3])
def test_slopes_of_the_flow_are_its_finite_differences(downstream_pa):
    _, with_from, with_to = orifice_flow(B, 300e3, downstream_pa)
    d = 1.0
    first = (orifice_flow(B, 300e3 + d, downstream_pa)[0] - orifice_flow(B, 300e3 - d, downstream_pa)[0]) / (2 * d)
    second = (orifice_flow(B, 300e3, downstream_pa + d)[0] - orifice_flow(B, 300e3, downstream_pa - d)[0]) / (2 * d)
    assert with_from == pytest.approx(first, rel=1e-4, abs=1.0)
    assert with_to == pytest.approx(second, rel=1e-4, abs=1.0)


def test_filling_agrees_with_a_fine_numerical_integration():
    fine = model(sub_step_s=2e-5)
    pressure_pa = run(fine, 0.6 * FULL, 0.2)
    orifices, tables = CHAMBER.iso6358, gas_volume_tables()
    regulated = CHAMBER.supply_gauge_pa + AMBIENT_PA

    def volume(p):
        # All chambers are alike, so each has a neighbour at its own pressure: the two-chamber (PDC) table.
        grid = tables.pressure_start_pa + tables.pressure_step_pa * np.arange(len(tables.pdc))
        straight = round(-tables.bend_start_rad / tables.bend_step_rad)
        return orifices.line_volume_m3 + np.interp(p - AMBIENT_PA, grid, tables.pdc[:, straight])

    def rate(time_s, state):
        p, supply = state
        opening = 0.6 * (1.0 - math.exp(-time_s / CHAMBER.spool_time_constant_s))
        flow = opening * orifices.sonic_conductance_m3_s_pa * orifice_flow(B, supply, p)[0]
        fed = orifices.regulator_conductance_m3_s_pa * orifice_flow(B, regulated, supply)[0]
        slope = ((p + 5.0) * volume(p + 5.0) - (p - 5.0) * volume(p - 5.0)) / 10.0
        return [flow / slope, (fed - 16 * flow) / orifices.supply_volume_m3]

    start = [AMBIENT_PA, regulated]
    solution = solve_ivp(rate, (0.0, 0.2), start, rtol=1e-9, atol=1e-3, max_step=1e-3, method="LSODA")
    assert pressure_pa == pytest.approx(solution.y[0, -1] - AMBIENT_PA, rel=1e-3)
    assert fine.supply_gauge_pa == pytest.approx(solution.y[1, -1] - AMBIENT_PA, rel=1e-3)


def test_the_error_falls_in_proportion_to_the_step():
    def filled_pa(sub_step_s):
        orifices = dataclasses.replace(CHAMBER.iso6358, sub_step_s=sub_step_s, supply_volume_m3=1.0)
        config = dataclasses.replace(CHAMBER, spool_time_constant_s=1e-9, iso6358=orifices)
        return build_pneumatics("iso6358", config).step(np.eye(16)[0], 0.16)[0]

    exact = filled_pa(4e-4)
    errors = [abs(filled_pa(h) - exact) for h in (8e-3, 4e-3)]
    assert errors[0] / errors[1] == pytest.approx((8.0 - 0.4) / (4.0 - 0.4), rel=0.05)


@pytest.mark.parametrize("step_s", [1e-4, 1e-3, 1e-2, 0.1, 1.0])
def test_filling_rises_to_the_supply_and_venting_falls_to_ambient_without_overshoot_at_any_step(step_s):
    chambers = model(sub_step_s=step_s, sonic_conductance_m3_s_pa=2e-9)
    steps = max(4, round(0.3 / step_s))
    filling = np.array([chambers.step(FULL, step_s) for _ in range(steps)])
    assert (np.diff(filling, axis=0) >= -1e-3).all() and filling.max() <= CHAMBER.supply_gauge_pa
    chambers.step(-FULL, 0.1)  # the spools have turned
    venting = np.array([chambers.step(-FULL, step_s) for _ in range(steps)])
    assert (np.diff(venting, axis=0) <= 1e-3).all() and venting.min() >= -1e-3


def test_gas_is_neither_made_nor_lost_between_a_tank_that_is_not_refilled_and_its_chambers():
    chambers = model(regulator_conductance_m3_s_pa=0.0)
    before_j = gas_j(chambers)
    rng = np.random.default_rng(2)
    for _ in range(100):
        chambers.step(rng.uniform(0.0, 1.0, 16), 0.01, rng.uniform(-1.0, 1.0, (4, 2)))
        assert gas_j(chambers) == pytest.approx(before_j, rel=1e-8)
    chambers.step(FULL, 30.0)  # chambers and tank meet
    assert chambers.pressure_gauge_pa == pytest.approx(chambers.supply_gauge_pa, abs=1.0)
    assert gas_j(chambers) == pytest.approx(before_j, rel=1e-8)


def test_a_chamber_above_an_exhausted_tank_flows_back_through_an_open_valve():
    chambers = model(regulator_conductance_m3_s_pa=0.0)
    first = np.where(np.arange(16) == 0, 1.0, 0.0)
    chambers.step(first, 5.0)
    held_pa = chambers.pressure_gauge_pa[0]
    chambers.step(np.where(np.arange(16) > 0, 1.0, 0.0), 5.0)
    assert chambers.supply_gauge_pa < chambers.pressure_gauge_pa[0] == pytest.approx(held_pa, rel=0.05)
    chambers.step(first, 30.0)
    assert chambers.pressure_gauge_pa[0] == pytest.approx(chambers.supply_gauge_pa, abs=10.0)


def test_many_valves_at_once_draw_the_supply_down_and_fill_more_slowly():
    one, all_of_them = model(), model()
    alone_pa = one.step(np.where(np.arange(16) == 0, 1.0, 0.0), 0.1)[0]
    assert all_of_them.step(FULL, 0.1)[0] < alone_pa
    assert all_of_them.supply_gauge_pa < one.supply_gauge_pa < CHAMBER.supply_gauge_pa


def test_a_leak_empties_a_closed_chamber_and_a_tight_one_keeps_its_gas():
    tight, leaking = model(), model(leak_conductance_m3_s_pa=2e-12)
    for chambers in (tight, leaking):
        chambers.reset(80e3)
    assert tight.step(0 * FULL, 5.0) == pytest.approx(80e3, rel=1e-9)
    falling = [leaking.step(0 * FULL, 5.0)[0] for _ in range(3)]
    assert 80e3 > falling[0] > falling[1] > falling[2] > 0.0


def test_bending_a_closed_chamber_changes_its_pressure_as_boyle_says():
    chambers = model()
    chambers.reset(np.where(np.arange(16) % 4 == 0, 80e3, 0.0))
    toward = np.tile(math.radians(90.0) * -np.array([1.0, 1.0]) / math.sqrt(2.0), (4, 1))
    bent_pa = chambers.step(0 * FULL, 0.01, toward) + AMBIENT_PA
    tables = gas_volume_tables()
    for bend, pressure in ((0.0, 80e3 + AMBIENT_PA), (math.radians(90.0), bent_pa[0])):
        row = volume_rows(tables, np.full(1, pressure), np.full(1, bend), CHAMBER.iso6358.line_volume_m3)[0]
        assert gas_amount(tables, row, pressure)[0] == pytest.approx(chambers._amount[0], rel=1e-9)
    assert bent_pa[0] < 80e3 + AMBIENT_PA  # bent away from it, a chamber is larger


def test_a_chamber_sees_the_bend_away_from_itself():
    toward_diagonal = np.array([[-1.0, -1.0]]) / math.sqrt(2.0)
    assert chamber_bend_rad(toward_diagonal)[0] == pytest.approx([1.0, 0.0, -1.0, 0.0], abs=1e-12)


def test_the_same_steps_give_the_same_bits():
    runs = []
    for _ in range(2):
        rng, chambers = np.random.default_rng(5), model()
        runs.append([chambers.step(rng.uniform(-1.0, 1.0, 16), 0.01).tobytes() for _ in range(50)])
    assert runs[0] == runs[1]
