"""Loops that see what is wrong with the machine: each fault is named, in time, and a sound machine is left in peace."""

import copy
import dataclasses
import functools
import math

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.findings import SUPPLY, Fault, Finding, FindingError
from mbpam_ros.pneumatics.machine_faults import MachineFault, MachineFaults
from mbpam_ros.pneumatics.registry import build_pneumatics, pneumatic_model_names
from mbpam_ros.pneumatics.sensing import PressureSensing
from mbpam_ros.pneumatics.transducer import Transducer
from mbpam_ros.pneumatics.valve_guard import GuardedValves

pytestmark = pytest.mark.xdist_group("valve_guard")  # what begins with a grasp begins with the same one
CONFIG = load_pneumatics()
TICK_S = 0.01
GRIP = np.where(np.arange(CHANNEL_COUNT) % 4 == 0, 100e3, 0.0)
CHANNEL, EMPTY = 4, 5
DATA_SHEET_LEAK_1_S = 0.15e3 / 100e3


class Rig:
    """Guarded valves on a machine without muscles."""

    def __init__(self, config=CONFIG, seed=0, leak_1_s=0.0, assumed="lag"):
        self.chambers = build_pneumatics(config.model, config.chamber)
        self.transducer = Transducer(config.transducer, CHANNEL_COUNT, seed)
        self.sensing = PressureSensing(config.sensing, config.transducer)
        self.faults = MachineFaults(config.transducer, config.chamber.supply_gauge_pa, seed)
        self.valves = GuardedValves(CONFIG, 110e3, 120e3, switched_on=True, model=assumed)
        self.bend_rad = np.zeros((4, 2))
        self.leak_1_s = np.full(CHANNEL_COUNT, leak_1_s)
        self.volts = self.transducer.measure(self.pressure_pa)
        self.ticks, self.highest_pa = 0, 0.0
        self.command = self.valves.parting

    @property
    def pressure_pa(self):
        return self.chambers.pressure_gauge_pa

    @property
    def found(self):
        return {(finding.fault, finding.channels) for finding in self.valves.findings}

    def aim(self, setpoint_pa):
        self.valves.switch.request(setpoint_pa)

    def run(self, duration_s, until=lambda: False):
        """Run for a while, or until something is so, and return how long that took."""
        begun = self.ticks
        for _ in range(round(duration_s / TICK_S)):
            reading = self.sensing.update(self.ticks * TICK_S, self.volts).pressure_gauge_pa
            self.command = self.valves.update(self.ticks * TICK_S, reading)
            self.faults.feed(self.chambers, self.command.supply_open)
            self.chambers.step(self.faults.command(self.command.spool, TICK_S), TICK_S, self.bend_rad)
            self.faults.seep(self.chambers, TICK_S)
            if self.leak_1_s.any():
                self.chambers.seep(self.leak_1_s, np.zeros(CHANNEL_COUNT), TICK_S)
            self.volts = self.faults.measure(self.transducer, self.pressure_pa, TICK_S)
            self.ticks += 1
            self.highest_pa = max(self.highest_pa, self.pressure_pa.max())
            if until():
                break
        return (self.ticks - begun) * TICK_S

    def be_held_up(self, ticks, by_plant):
        """Let a busy computer hold up the plant, which makes up for half of it unseen, or what answers its samples."""
        behind = []
        for passed in range(ticks // 2 if by_plant else ticks):
            spool = self.command.spool if passed < 3 else np.zeros(CHANNEL_COUNT)
            self.chambers.step(spool, TICK_S)
            behind.append(self.transducer.measure(self.pressure_pa))
        for late, volts in zip(range(ticks - 1, -1, -1), behind[-5:], strict=False) if not by_plant else ():
            reading = self.sensing.update((self.ticks + ticks - late) * TICK_S, volts).pressure_gauge_pa
            self.command = self.valves.update((self.ticks + ticks - late) * TICK_S, reading, late * TICK_S)
        self.ticks += ticks + (0 if by_plant else 1)
        self.volts = self.transducer.measure(self.pressure_pa)

    def inject(self, kind, size=0.0, channel=CHANNEL, other=None):
        fault = MachineFault(kind, channel, size, other)
        self.faults.inject(fault, self.chambers.spool, self.pressure_pa, self.volts)


@functools.cache
def gripping(for_s):
    rig = Rig()
    rig.run(0.2)
    rig.aim(GRIP)
    rig.run(for_s)
    return rig


def holding():
    rig = copy.deepcopy(gripping(2.5))
    assert not rig.found
    return rig


def closing():
    return copy.deepcopy(gripping(0.1))


ONE = (CHANNEL_NAMES[CHANNEL],)
BOTH = (CHANNEL_NAMES[CHANNEL], CHANNEL_NAMES[EMPTY])


@pytest.mark.parametrize(
    ("kind", "size", "fault", "channels", "within_s"),
    [
        ("stuck_noisy", 0.0, Fault.NOT_FOLLOWING, ONE, 0.3),
        ("reads_zero", 0.0, Fault.JUMPED, ONE, 0.05),
        ("swapped", 0.0, Fault.SWAPPED, BOTH, 0.1),
        ("valve_closed", 0.0, Fault.NOT_FOLLOWING, ONE, 0.3),
        ("valve_stuck", 0.0, Fault.RISES, ONE, 0.5),
        ("leak", 1.0, Fault.LEAK, ONE, 1.0),
        ("supply", 0.2, Fault.SUPPLY_LOW, (SUPPLY,), 0.3),
    ],
)
def test_while_a_grasp_closes(kind, size, fault, channels, within_s):
    rig = closing()
    rig.inject(kind, size, other=EMPTY if kind == "swapped" else None)
    rig.run(within_s, until=lambda: rig.found)
    assert rig.found == {(fault, channels)}
    rig.run(1.0)
    assert rig.highest_pa < 112.2e3


@pytest.mark.parametrize(
    ("kind", "size", "fault", "channels", "within_s"),
    [
        ("stuck_noisy", 0.0, Fault.NOT_FOLLOWING, ONE, 3.0),
        ("valve_closed", 0.0, Fault.NOT_FOLLOWING, ONE, 3.0),
        ("valve_slow", 0.2, Fault.NOT_FOLLOWING, ONE, 3.0),
        ("reads_zero", 0.0, Fault.JUMPED, ONE, 0.05),
        ("reads_offset", -12e3, Fault.JUMPED, ONE, 0.2),
        ("swapped", 0.0, Fault.SWAPPED, BOTH, 0.05),
        ("valve_open", 1.0, Fault.RISES, ONE, 0.2),
        ("valve_open", 0.1, Fault.RISES, ONE, 0.4),
        ("leaks_in", 4.0, Fault.LEAKS_IN, ONE, 3.0),
        ("leak", 2.0, Fault.LEAK, ONE, 0.5),
        ("drift", 1e3, Fault.LEAK_OR_DRIFT, ONE, 4.0),
        ("drift", -0.4e3, Fault.LEAK_OR_DRIFT, ONE, 8.0),
        ("noise", 8.0, Fault.NOISY, ONE, 1.0),
        ("supply", 0.0, Fault.SUPPLY_LOW, (SUPPLY,), 3.0),
    ],
)
def test_while_a_grasp_is_held(kind, size, fault, channels, within_s):
    rig = holding()
    rig.inject(kind, size, other=EMPTY if kind == "swapped" else None)
    rig.run(within_s, until=lambda: rig.found)
    assert rig.found == {(fault, channels)}
    rig.run(2.0)
    assert rig.highest_pa < (125e3 if kind == "valve_open" else 112.2e3)
    assert rig.pressure_pa.max() < 110e3


@pytest.mark.parametrize("after_s", [0.15, 0.25, 0.3, 0.8])
def test_neighbours_that_fill_alike_and_were_swapped_are_told_by_how_they_part(after_s):
    """One valve fills for the other's reading, the other vents for the first one's: neither leaks."""
    rig = Rig()
    rig.aim(np.where(np.arange(CHANNEL_COUNT) % 4 < 2, 100e3, 0.0))
    rig.run(after_s)
    rig.inject("swapped", other=EMPTY)
    rig.run(3.0, until=lambda: rig.found)
    assert rig.found == {(Fault.SWAPPED, BOTH)}


def test_two_inflated_neighbours_that_were_swapped_are_told_by_their_test_pulses():
    rig = Rig()
    rig.aim(np.where(np.arange(CHANNEL_COUNT) % 4 < 2, 100e3, 0.0))
    rig.run(2.5)
    rig.inject("swapped", other=EMPTY)
    rig.run(3.0, until=lambda: rig.found)
    assert rig.found == {(Fault.SWAPPED, BOTH)}


def test_test_pulses_come_to_their_height_with_valves_that_let_little_through_small_openings():
    rig = Rig(dataclasses.replace(CONFIG, model="iso6358"))
    rig.aim(GRIP)
    rig.run(1.5)

    def highest_pulse_pa():
        rested_pa, highest_pa = rig.pressure_pa[CHANNEL], []
        rig.run(2.1, until=lambda: highest_pa.append(rig.pressure_pa[CHANNEL]))
        return max(highest_pa) - rested_pa

    first_pa = highest_pulse_pa()
    rig.run(10.0)
    assert first_pa < 550.0 < 650.0 < highest_pulse_pa() < 950.0
    assert not rig.found


def bending(rig, over_s, to_rad):
    """Have all fingers bend away from their first chamber, evenly, while the loops run."""
    begun = rig.bend_rad[0, 0]
    for share in np.linspace(0.0, 1.0, round(over_s / TICK_S)):
        rig.bend_rad[:, 0] = begun + share * (to_rad - begun)
        rig.run(TICK_S)


@pytest.mark.parametrize("pressure_pa", [60e3, 105e3])
def test_what_the_bend_of_a_muscle_does_to_its_chambers_is_no_leak_and_a_leak_is_one(pressure_pa):
    rig = Rig(dataclasses.replace(CONFIG, model="iso6358"), assumed="iso6358")
    rig.aim(pressure_pa / 100e3 * GRIP)
    rig.run(2.5)
    before_pa = rig.pressure_pa[CHANNEL]
    bending(rig, 0.06, -math.radians(100.0))
    assert rig.pressure_pa[CHANNEL] < before_pa - 2e3
    bending(rig, 1.0, -math.radians(100.0))
    bending(rig, 0.06, -math.radians(20.0))
    bending(rig, 2.0, -math.radians(20.0))
    assert not rig.found
    rig.inject("leak", 2.0)
    assert rig.run(3.0, until=lambda: rig.found) < 2.5
    assert rig.found == {(Fault.LEAK, ONE)}


def test_a_leak_is_made_up_for_beyond_what_the_integral_may_learn():
    rig = holding()
    rig.inject("leak", 1.0)
    rig.run(3.0)
    assert rig.pressure_pa[CHANNEL] == pytest.approx(100e3, abs=2e3)
    (finding,) = rig.valves.findings
    assert "time constant 1." in finding.evidence or "time constant 0.9" in finding.evidence


@pytest.mark.parametrize("opening", [0.25, 1.0])
def test_a_leak_that_its_valve_cannot_stop_is_a_valve_that_does_not_fill(opening):
    rig = holding()
    rig.inject("valve_vents", opening)
    assert rig.run(1.0, until=lambda: (Fault.NOT_FOLLOWING, ONE) in rig.found) < 0.4


def test_what_no_one_can_vouch_for_is_not_followed_far():
    rig = holding()
    rig.inject("drift", -2e3)
    rig.run(12.0)
    assert rig.found == {(Fault.DRIFT, ONE)}
    assert rig.highest_pa < 110e3 and rig.pressure_pa[CHANNEL] > 100e3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "size"),
    [("stuck_noisy", 0.0), ("valve_closed", 0.0), ("valve_open", 1.0), ("leak", 1.0), ("noise", 10.0), ("supply", 0.0)],
)
def test_mended_and_vented_everything_is_sound_again_and_the_next_grasp_closes(kind, size):
    rig = closing()
    rig.inject(kind, size)
    rig.run(2.0)
    assert rig.found
    rig.faults.repair()
    rig.valves.switch.obey(Air.VENT)
    rig.run(4.0)
    assert not rig.found and not rig.command.supply_open
    rig.aim(np.zeros(CHANNEL_COUNT))
    rig.valves.switch.clear()
    rig.valves.switch.obey(Air.REGULATE)
    rig.run(0.2)
    rig.aim(GRIP)
    rig.run(2.0)
    assert not rig.found
    assert rig.pressure_pa[GRIP > 0.0] == pytest.approx(100e3, rel=0.02)


def sound_machine(model, slowness, supply_share):
    chamber = dataclasses.replace(
        CONFIG.chamber,
        lag_time_constant_s=slowness * CONFIG.chamber.lag_time_constant_s,
        supply_gauge_pa=supply_share * CONFIG.chamber.supply_gauge_pa,
    )
    return dataclasses.replace(CONFIG, model=model, chamber=chamber)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "slowness", "supply_share"),
    [*((name, 1.0, 1.0) for name in pneumatic_model_names()), ("lag", 0.6, 1.0), ("lag", 1.7, 1.0), ("lag", 1.0, 0.85)],
)
def test_nothing_is_found_of_a_sound_machine_however_it_is_used(model, slowness, supply_share):
    rig = Rig(sound_machine(model, slowness, supply_share), seed=3, leak_1_s=DATA_SHEET_LEAK_1_S, assumed=model)
    random = np.random.default_rng(5)
    for _ in range(8):
        rig.aim(np.where(random.random(CHANNEL_COUNT) < 0.4, random.uniform(10e3, 110e3, CHANNEL_COUNT), 0.0))
        rig.run(TICK_S * random.integers(5, 600), until=lambda: rig.found)
        assert not rig.found, [finding.text for finding in rig.valves.findings]


@pytest.mark.slow
@pytest.mark.parametrize("model", ["lag", "iso6358"])
@pytest.mark.parametrize("by_plant", [True, False], ids=["plant held up", "valve controller held up"])
def test_nothing_is_found_of_a_sound_machine_on_a_busy_computer(model, by_plant):
    rig = Rig(dataclasses.replace(CONFIG, model=model), seed=4, leak_1_s=DATA_SHEET_LEAK_1_S, assumed=model)
    random = np.random.default_rng(6)
    for _ in range(10):
        rig.aim(np.where(random.random(CHANNEL_COUNT) < 0.4, random.uniform(10e3, 110e3, CHANNEL_COUNT), 0.0))
        for _ in range(25):
            rig.run(TICK_S * random.integers(1, 15), until=lambda: rig.found)
            rig.be_held_up(int(random.integers(3, 11)), by_plant)
            assert not rig.found, [finding.text for finding in rig.valves.findings]


def test_a_reading_that_comes_late_is_no_fault_of_the_machine():
    rig = holding()
    for gap in (3, 15, 60):
        rig.ticks += gap
        rig.run(0.5)
    assert not rig.found


def test_a_finding_is_read_back_from_its_line():
    finding = Finding(Fault.LEAK, (CHANNEL_NAMES[3],), "falls 12.0 kPa/s (measured): at 98 kPa", 0.99)
    assert Finding.parse(CHANNEL_NAMES[3], str(finding)) == finding
    for channel, line in ((CHANNEL_NAMES[3], "all is well"), ("finger_9", str(finding)), (SUPPLY, "rust (10 %): x")):
        with pytest.raises(FindingError):
            Finding.parse(channel, line)


ORIFICES = dataclasses.replace(CONFIG, model="iso6358")


@pytest.mark.parametrize(
    ("kind", "size", "fault", "channels", "within_s"),
    [
        ("reads_offset", 6e3, Fault.JUMPED, ONE, 0.1),
        ("reads_offset", -6e3, Fault.JUMPED, ONE, 0.1),
        ("leaks_in", 4.0, Fault.LEAKS_IN, ONE, 3.0),
        ("valve_slow", 0.14, Fault.NOT_FOLLOWING, ONE, 5.0),
        ("drift", -1.35e3, Fault.DRIFT, ONE, 10.0),
    ],
)
def test_with_orifices_a_held_grasp_is_watched_as_closely_and_no_chamber_goes_far_above(
    kind, size, fault, channels, within_s
):
    rig = Rig(ORIFICES, assumed="iso6358")
    rig.aim(GRIP)
    rig.run(5.0)
    rig.inject(kind, size)
    rig.run(within_s, until=lambda: (fault, channels) in rig.found)
    assert rig.found == {(fault, channels)}
    rig.run(5.0)
    assert rig.highest_pa < 112.2e3


@pytest.mark.parametrize("time_constant_s", [2.5, 3.0])
def test_a_valve_that_seems_not_to_vent_is_closed_and_its_supply_cut_where_air_comes_in(time_constant_s):
    rig = Rig(ORIFICES, assumed="iso6358")
    rig.aim(GRIP)
    rig.run(5.0)
    rig.inject("leaks_in", time_constant_s)
    rig.run(2.0, until=lambda: (Fault.NOT_VENTING, ONE) in rig.found)
    rig.run(0.2, until=lambda: (Fault.RISES, ONE) in rig.found)
    assert not rig.command.supply_open
    rig.run(5.0)
    assert rig.highest_pa < 112.2e3


def test_with_orifices_a_valve_that_vents_the_neighbour_it_was_swapped_with_is_no_valve_that_does_not_vent():
    rig = Rig(ORIFICES, seed=2, assumed="iso6358")
    rig.aim(np.where(np.arange(CHANNEL_COUNT) % 4 < 2, 100e3, 0.0))
    rig.run(0.15)
    rig.inject("swapped", other=EMPTY)
    rig.run(3.0, until=lambda: rig.found)
    assert rig.found == {(Fault.SWAPPED, BOTH)}


BENDS = {
    "lifted, and past what it held": [(0.25, 92.0), (1.0, 92.0), (0.25, 185.0)],
    "quickly there, slowly back": [(0.2, 100.0), (2.0, 10.0)] * 4,
    "slowly there, quickly back": [(2.0, 100.0), (0.2, 10.0)] * 4,
    "to and fro": [(0.2, 100.0), (0.2, 10.0)] * 10,
}


def bent_away_deg(degrees):
    """Return the bend in the frame's x that is so much away from the first chamber, at 45 deg."""
    return -math.radians(degrees) * math.sqrt(2.0)


def bending_by(rig, bends):
    """Have the finger of the channel bend away from it, evenly to each place in its time."""
    bend_rad = rig.bend_rad[CHANNEL // 4]
    for over_s, degrees in bends:
        begun, to = bend_rad[0], bent_away_deg(degrees)
        for share in np.linspace(0.0, 1.0, round(over_s / TICK_S)):
            bend_rad[0] = begun + share * (to - begun)
            rig.run(TICK_S)


@pytest.mark.slow
@pytest.mark.parametrize("bends", BENDS.values(), ids=BENDS)
def test_a_sound_reading_does_not_drift_however_a_finger_bends(bends):
    rig = Rig(ORIFICES, assumed="iso6358", leak_1_s=DATA_SHEET_LEAK_1_S)
    rig.bend_rad[:, 0] = bent_away_deg(10.0)
    rig.aim(GRIP)
    rig.run(2.5)
    bending_by(rig, bends)
    rig.run(5.0)
    assert not rig.found


@pytest.mark.slow
@pytest.mark.parametrize("bends", [BENDS["lifted, and past what it held"], BENDS["to and fro"]])
@pytest.mark.parametrize("drift_pa_s", [-0.6e3, -1.35e3, -2.9e3])
def test_what_a_finger_has_bent_hides_no_drift(bends, drift_pa_s):
    rig = Rig(ORIFICES, assumed="iso6358")
    rig.bend_rad[:, 0] = bent_away_deg(10.0)
    rig.aim(GRIP)
    rig.run(2.5)
    bending_by(rig, bends)
    rig.inject("drift", drift_pa_s)
    rig.run(15.0)
    assert rig.found == {(Fault.DRIFT, ONE)}
    assert rig.highest_pa < 112.2e3


@pytest.mark.parametrize("left", [0.1, 0.5])
def test_a_tank_that_is_no_longer_filled_shows_in_test_pulses_before_it_wants(left):
    rig = Rig(ORIFICES, assumed="iso6358")
    rig.inject("supply", left)
    rig.aim(GRIP)
    rig.run(8.0, until=lambda: rig.found)
    assert rig.found == {(Fault.SUPPLY_LOW, (SUPPLY,))}
    assert rig.pressure_pa[CHANNEL] == pytest.approx(100e3, abs=2e3)


def test_pulses_that_something_else_moves_say_nothing_of_the_supply():
    rig = Rig(ORIFICES, assumed="iso6358")
    rig.aim(GRIP)
    rig.run(5.0)
    for _ in range(6):
        bending(rig, over_s=0.3, to_rad=math.radians(12.0))
        bending(rig, over_s=0.3, to_rad=0.0)
        rig.run(1.0)
    assert not rig.found
