"""The valve that observers compare with: the same physics as the simulated machine's."""

import json

import numpy as np
import pytest

from mbpam_ros.configuration import config_directory
from mbpam_ros.pneumatics.assumed_valve import GREATEST_BEND_RAD, assumed_valve, flow_share
from mbpam_ros.pneumatics.chamber import AMBIENT_PA
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.iso6358 import orifice_flow
from mbpam_ros.pneumatics.registry import build_pneumatics

CONFIG = load_pneumatics()
SUPPLY_PA = CONFIG.controller.supply_gauge_pa
PSC = np.arange(16) % 4 == 0
BENT = np.tile([-0.5 * GREATEST_BEND_RAD, 0.0], (4, 1))


def valve(model):
    return assumed_valve(model, CONFIG.chamber, CONFIG.controller)


def test_the_share_of_the_choked_flow_is_the_simulated_orifice_s():
    for ratio in (0.05, 0.3, 0.5, 0.9, 0.99):
        flow, _, _ = orifice_flow(0.3, 300e3, ratio * 300e3)
        assert 100e3 * 300e3 * flow_share(np.array(ratio), 0.3) == pytest.approx(flow, rel=1e-12)
    assert flow_share(np.array([1.0, 1.4]), 0.3).tolist() == [0.0, 0.0]


@pytest.fixture(scope="module")
def gas_law_of_half_the_size(tmp_path_factory):
    """The law of the paper's muscle made half as large: an eighth of the gas."""
    law = json.loads((config_directory() / "data" / "fe_bending_law.json").read_text())
    law["settings"]["geometry"]["active_length_mm"] *= 0.5
    for row in law["tables"]:
        row["gas_volume_mm3"] = [0.125 * volume for volume in row["gas_volume_mm3"]]
    path = tmp_path_factory.mktemp("half") / "law.json"
    path.write_text(json.dumps(law))
    return path


@pytest.mark.parametrize(("model", "half_size"), [("lag", False), ("iso6358", False), ("iso6358", True)])
@pytest.mark.parametrize("gauge_pa", [15e3, 60e3, 100e3])
def test_a_simulated_chamber_fills_and_vents_as_fast(model, half_size, gauge_pa, gas_law_of_half_the_size):
    """Half-way bent, one chamber alone: within a fifth of the mean of alone and paired."""
    gas_law = gas_law_of_half_the_size if half_size else None
    assumed, step_s = assumed_valve(model, CONFIG.chamber, CONFIG.controller, gas_law), 2e-4
    start_pa = np.where(PSC, gauge_pa, 0.0)
    for opening in (1.0, -1.0):
        chambers = build_pneumatics(model, CONFIG.chamber, gas_law)
        chambers.reset(start_pa)
        chambers.step(np.zeros(16), 1e-6, BENT)
        for _ in range(100):  # until the spool stands
            chambers.step(np.where(PSC, opening, 0.0), 2e-4, BENT)
        before_pa = chambers.pressure_gauge_pa[0]
        rate = (chambers.step(np.where(PSC, opening, 0.0), step_s, BENT)[0] - before_pa) / step_s
        here_pa = np.full(16, before_pa)
        expected = assumed.fill_pa_s(here_pa, SUPPLY_PA)[0] if opening > 0.0 else -assumed.vent_pa_s(here_pa)[0]
        assert rate == pytest.approx(expected, rel=0.2)


def test_the_rate_vanishes_as_the_pressure_comes_to_the_supply():
    assumed = valve("iso6358")
    rate = assumed.fill_pa_s(SUPPLY_PA - np.array([100e3, 10e3, 100.0, 0.0]), SUPPLY_PA)
    assert (np.diff(rate) < 0.0).all() and rate[-1] == 0.0


def test_a_tank_is_drawn_down_to_where_regulator_and_choked_valves_agree():
    assumed, orifice = valve("iso6358"), CONFIG.chamber.iso6358
    regulated_pa = SUPPLY_PA + AMBIENT_PA
    assert assumed.drawn_supply_gauge_pa(0.0) == SUPPLY_PA
    for opening in (2.0, 4.0, 16.0, 1000.0):
        tank_pa = assumed.drawn_supply_gauge_pa(opening) + AMBIENT_PA
        fed, _, _ = orifice_flow(orifice.critical_ratio, regulated_pa, tank_pa)
        drawn = opening * orifice.sonic_conductance_m3_s_pa * 100e3 * tank_pa
        assert orifice.regulator_conductance_m3_s_pa * fed == pytest.approx(drawn, rel=1e-9)


@pytest.mark.parametrize("gauge_pa", [30e3, 60e3, 100e3])
def test_a_closed_chamber_moves_with_the_bend_by_as_much(gauge_pa):
    chambers = build_pneumatics("iso6358", CONFIG.chamber)
    chambers.reset(np.where(PSC, gauge_pa, 0.0))
    bent_pa = chambers.step(np.zeros(16), 1e-3, np.tile([-GREATEST_BEND_RAD, 0.0], (4, 1)))[0]
    assert gauge_pa - bent_pa == pytest.approx(valve("iso6358").bend_pa(np.array([gauge_pa]))[0], rel=0.35)
    assert valve("lag").bend_pa(np.array([gauge_pa])) == 0.0
