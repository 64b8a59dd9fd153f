"""Faults of the simulated machine: each does what its name says, and nothing else."""

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.machine_faults import FAULT_KINDS, MachineFault, MachineFaultError, MachineFaults
from mbpam_ros.pneumatics.registry import build_pneumatics, pneumatic_model_names
from mbpam_ros.pneumatics.transducer import Transducer

CONFIG = load_pneumatics()
CHANNEL, OTHER = 5, 6
DT_S = 0.01


class Machine:
    """Valves, chambers and transducers of a model, half full."""

    def __init__(self, model="lag"):
        self.chambers = build_pneumatics(model, CONFIG.chamber)
        self.chambers.reset(80e3)
        self.transducer = Transducer(CONFIG.transducer, CHANNEL_COUNT, seed=1)
        self.faults = MachineFaults(CONFIG.transducer, CONFIG.chamber.supply_gauge_pa, seed=1)
        self.volts = self.transducer.measure(self.chambers.pressure_gauge_pa)

    def inject(self, kind, size=0.0):
        other = OTHER if kind == "swapped" else None
        fault = MachineFault(kind, CHANNEL, size, other)
        self.faults.inject(fault, self.chambers.spool, self.chambers.pressure_gauge_pa, self.volts)

    def step(self, spool, ticks=1, supply_open=True):
        """Return the true pressures and what the transducers show, both (16,) [Pa]."""
        for _ in range(ticks):
            self.faults.feed(self.chambers, supply_open)
            self.chambers.step(self.faults.command(np.full(CHANNEL_COUNT, float(spool)), DT_S), DT_S)
            self.faults.seep(self.chambers, DT_S)
            self.volts = self.faults.measure(self.transducer, self.chambers.pressure_gauge_pa, DT_S)
        shown = (self.volts - CONFIG.transducer.zero_v) * CONFIG.transducer.gain_pa_v
        return self.chambers.pressure_gauge_pa, shown


@pytest.mark.parametrize(
    ("kind", "size", "spool", "low_pa", "high_pa"),
    [
        ("valve_open", 0.5, -1.0, 95e3, 105e3),  # 80 -> 200 kPa with tau / s = 0.5 s for 0.1 s: 101.8 kPa
        ("valve_vents", 0.5, 1.0, 60e3, 70e3),
        ("valve_closed", 0.0, 1.0, 80e3, 80e3),
        ("valve_stuck", 0.0, 1.0, 80e3, 80e3),
        ("valve_slow", 0.5, 1.0, 80e3, 90e3),
        ("leak", 0.1, 0.0, 29e3, 30e3),  # 80 exp(-1) = 29.4 kPa
        ("leaks_in", 0.1, 0.0, 155e3, 156e3),
        ("supply", 0.4, 1.0, 80e3, 90e3),  # what was in the manifold, then 80 kPa
    ],
)
def test_what_befalls_valves_and_chambers(kind, size, spool, low_pa, high_pa):
    machine = Machine()
    machine.inject(kind, size)
    pressure_pa, _ = machine.step(spool, ticks=10)
    sound = Machine().step(spool, ticks=10)[0]
    assert low_pa <= pressure_pa[CHANNEL] <= high_pa
    if kind != "supply":
        np.testing.assert_array_equal(np.delete(pressure_pa, CHANNEL), np.delete(sound, CHANNEL))
    machine.faults.repair()
    assert not machine.faults


@pytest.mark.parametrize(
    ("kind", "size", "shown_pa"),
    [
        ("stuck", 0.0, 80e3),
        ("stuck_noisy", 0.0, 80e3),
        ("reads_zero", 0.0, 0.0),
        ("reads_offset", -20e3, None),
        ("drift", 10e3, None),
        ("swapped", 0.0, None),
    ],
)
def test_what_befalls_transducers_leaves_the_pressures_alone(kind, size, shown_pa):
    machine, sound = Machine(), Machine()
    machine.inject(kind, size)
    pressure_pa, shown = machine.step(-1.0, ticks=20)
    np.testing.assert_array_equal(pressure_pa, sound.step(-1.0, ticks=20)[0])
    wanted = {"reads_offset": pressure_pa[CHANNEL] - 20e3, "drift": pressure_pa[CHANNEL] + 2e3}
    wanted["swapped"] = pressure_pa[OTHER]
    assert shown[CHANNEL] == pytest.approx(shown_pa if shown_pa is not None else wanted[kind], abs=500.0)
    assert np.abs(np.delete(shown - pressure_pa, [CHANNEL, OTHER])).max() < 500.0


def test_noise_grows_by_its_factor_and_a_wire_leaves_the_range():
    machine = Machine()
    machine.inject("noise", 10.0)
    shown = np.array([machine.step(0.0)[1] for _ in range(400)])
    ratio = shown[:, CHANNEL].std() / shown[:, OTHER].std()
    assert 8.0 < ratio < 12.0
    machine.inject("wire")
    machine.step(0.0)
    assert machine.volts[CHANNEL] > CONFIG.sensing.valid_high_v


@pytest.mark.parametrize("model", pneumatic_model_names())
def test_a_supply_that_is_shut_is_dumped_and_what_stands_open_to_it_goes_back(model):
    machine = Machine(model)
    machine.inject("valve_open", 1.0)
    assert machine.step(0.0, ticks=2)[0][CHANNEL] > 80e3
    pressure_pa, _ = machine.step(0.0, ticks=40, supply_open=False)
    assert machine.chambers.supply_gauge_pa < 20e3
    assert pressure_pa[CHANNEL] < 40e3
    assert np.delete(pressure_pa, CHANNEL) == pytest.approx(80e3, rel=1e-9)
    machine.faults.repair()
    assert (machine.step(1.0, ticks=40)[0] > 100e3).all()


@pytest.mark.parametrize("model", pneumatic_model_names())
def test_a_supply_that_is_never_shut_changes_no_bit(model):
    fed, left_alone = (build_pneumatics(model, CONFIG.chamber) for _ in range(2))
    random = np.random.default_rng(0)
    for _ in range(20):
        spool = random.uniform(-1.0, 1.0, CHANNEL_COUNT)
        fed.feed(supply_open=True)
        np.testing.assert_array_equal(fed.step(spool, DT_S), left_alone.step(spool, DT_S))


def test_a_fault_that_cannot_be_is_refused_by_name():
    assert len(FAULT_KINDS) == 16
    for wrong in (
        {"kind": "rust"},
        {"kind": "stuck", "channel": 16},
        {"kind": "leak", "size": 0.0},
        {"kind": "valve_open", "size": 1.5},
        {"kind": "noise", "size": 0.5},
        {"kind": "swapped"},
        {"kind": "swapped", "channel": 3, "other_channel": 3},
        {"kind": "drift", "size": float("nan")},
    ):
        with pytest.raises(MachineFaultError, match=wrong["kind"]):
            MachineFault(**wrong)
