"""Faults of the simulated machine, between commands and volts: what valves, lines, supply and transducers may do wrong.

A fault acts on what passes by it: a valve's on the spool command, a leak's on the chamber, the supply's on the
regulator, a transducer's on the pressure it shows or on its volts. Without a fault nothing is touched.

============ ======================================================== ===================================
kind         what happens                                             size
============ ======================================================== ===================================
stuck        the transducer's volts stand still                       -
stuck_noisy  it shows the pressure of the moment for ever, with noise -
reads_zero   it shows 0 Pa, with noise                                -
reads_offset it shows too much from one moment to the next            Pa
drift        what it shows moves away                                 Pa/s
noise        its noise grows                                          times the data sheet's
swapped      two transducers show each other's pressure               -
wire         its volts leave the range of the data sheet              -
valve_open   the spool stands open to the supply                      opening, 0 to 1
valve_vents  the spool stands open to ambient                         opening, 0 to 1
valve_stuck  the spool stays where it is                              -
valve_closed the spool stands closed                                  -
valve_slow   the spool follows late                                   time constant [s]
leak         the chamber leaks to ambient                             time constant [s]
leaks_in     the chamber leaks in from the supply                     time constant [s]
supply       the regulator gives less                                 part of what it gave, 0 for nothing
============ ======================================================== ===================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.errors import MbpamError
from mbpam_ros.pneumatics.chamber import PneumaticModel
from mbpam_ros.pneumatics.transducer import Transducer, TransducerConfig

Vector = NDArray[np.float64]

FaultKind = Literal[
    "stuck", "stuck_noisy", "reads_zero", "reads_offset", "drift", "noise", "swapped", "wire", "valve_open",
    "valve_vents", "valve_stuck", "valve_closed", "valve_slow", "leak", "leaks_in", "supply",
]  # fmt: skip

FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)


class MachineFaultError(MbpamError, ValueError):
    """A fault that this machine cannot have. Nothing was changed."""


@dataclass(frozen=True)
class MachineFault:
    """One fault.

    Args:
        kind: as in the table of this module.
        channel: index of the channel it befalls; of no meaning for the supply.
        size: as in the table; of no meaning where that has none.
        other_channel: the second of two that are swapped.

    Raises:
        MachineFaultError: no such kind, channel or size.
    """

    kind: FaultKind
    channel: int = 0
    size: float = 0.0
    other_channel: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in FAULT_KINDS:
            raise MachineFaultError(f"no fault {self.kind!r}; known: {', '.join(FAULT_KINDS)}")
        others = () if self.other_channel is None else (self.other_channel,)
        if not all(0 <= each < CHANNEL_COUNT for each in (self.channel, *others)):
            raise MachineFaultError(f"{self.kind}: channels are 0 to {CHANNEL_COUNT - 1}, found {self.channel}")
        if (self.kind == "swapped") != bool(others) or self.other_channel == self.channel:
            raise MachineFaultError(f"{self.kind}: two channels are swapped, with each other")
        within = math.isfinite(self.size)
        if self.kind in ("valve_slow", "leak", "leaks_in"):
            within = 0.0 < self.size < math.inf
        elif self.kind in ("valve_open", "valve_vents", "supply"):
            within = 0.0 <= self.size <= 1.0
        elif self.kind == "noise":
            within = 1.0 <= self.size < math.inf
        if not within:
            raise MachineFaultError(f"{self.kind}: no such size as {self.size}")


class MachineFaults:
    """The faults a simulated machine has at present.

    Args:
        transducer: data sheet, for the size of the noise.
        regulated_gauge_pa: what the regulator gives.
        seed: of the noise that faults add.
    """

    def __init__(self, transducer: TransducerConfig, regulated_gauge_pa: float, seed: int) -> None:
        self._noise_pa = transducer.noise_v * transducer.gain_pa_v
        self._out_of_range_v = transducer.adc_reference_v
        self._regulated_pa = regulated_gauge_pa
        self._random = np.random.default_rng([seed, 1])
        self._faults: list[MachineFault] = []
        self._age_s: list[float] = []
        self._kept: list[float] = []

    def __bool__(self) -> bool:
        return bool(self._faults)

    def inject(self, fault: MachineFault, spool: Vector, pressure_gauge_pa: Vector, volts: Vector) -> None:
        """Begin a fault in the state the machine is in: spools, pressures and volts, each of shape (16,)."""
        kept = {"stuck": volts, "stuck_noisy": pressure_gauge_pa, "valve_stuck": spool, "valve_slow": spool}
        self._faults.append(fault)
        self._age_s.append(0.0)
        self._kept.append(float(kept[fault.kind][fault.channel]) if fault.kind in kept else 0.0)

    def repair(self) -> None:
        """End all faults."""
        self._faults, self._age_s, self._kept = [], [], []

    def command(self, spool: Vector, dt_s: float) -> Vector:
        """Return what the spools are moved by, shape (16,), for what is commanded."""
        moved = spool.copy()
        for i, fault in enumerate(self._faults):
            here = fault.channel
            if fault.kind == "valve_open":
                moved[here] = fault.size
            elif fault.kind == "valve_vents":
                moved[here] = -fault.size
            elif fault.kind == "valve_closed":
                moved[here] = 0.0
            elif fault.kind == "valve_stuck":
                moved[here] = self._kept[i]
            elif fault.kind == "valve_slow":
                self._kept[i] += -math.expm1(-dt_s / fault.size) * (moved[here] - self._kept[i])
                moved[here] = self._kept[i]
        return moved

    def feed(self, chambers: PneumaticModel, supply_open: bool) -> None:
        """Let the supply's valve, and what ails the regulator, act on the chambers."""
        share = min((fault.size for fault in self._faults if fault.kind == "supply"), default=1.0)
        chambers.feed(supply_open, share * self._regulated_pa)

    def seep(self, chambers: PneumaticModel, dt_s: float) -> None:
        """Let the chambers leak for ``dt_s``."""
        out_1_s, in_1_s = np.zeros(CHANNEL_COUNT), np.zeros(CHANNEL_COUNT)
        for fault in self._faults:
            if fault.kind in ("leak", "leaks_in"):
                (out_1_s if fault.kind == "leak" else in_1_s)[fault.channel] += 1.0 / fault.size
        if out_1_s.any() or in_1_s.any():
            chambers.seep(out_1_s, in_1_s, dt_s)

    def measure(self, transducer: Transducer, pressure_gauge_pa: Vector, dt_s: float) -> Vector:
        """Return the volts, shape (16,), ``dt_s`` after the last ones."""
        shown = pressure_gauge_pa.copy()
        for i, fault in enumerate(self._faults):
            self._age_s[i] += dt_s
            here = fault.channel
            if fault.kind == "stuck_noisy":
                shown[here] = self._kept[i]
            elif fault.kind == "reads_zero":
                shown[here] = 0.0
            elif fault.kind == "reads_offset":
                shown[here] += fault.size
            elif fault.kind == "drift":
                shown[here] += fault.size * self._age_s[i]
            elif fault.kind == "noise":
                more = math.sqrt(fault.size**2 - 1.0) * self._noise_pa
                shown[here] += more * self._random.standard_normal()
            elif fault.kind == "swapped" and fault.other_channel is not None:
                there = fault.other_channel
                shown[here], shown[there] = shown[there], shown[here]
        volts = transducer.measure(shown)
        for i, fault in enumerate(self._faults):
            if fault.kind == "stuck":
                volts[fault.channel] = self._kept[i]
            elif fault.kind == "wire":
                volts[fault.channel] = self._out_of_range_v
        return volts
