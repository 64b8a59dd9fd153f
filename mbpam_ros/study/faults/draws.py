"""Which faults are tried, when and how large: each row is a kind of fault in a phase of a grasp."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT
from mbpam_ros.errors import MbpamError
from mbpam_ros.pneumatics.machine_faults import FaultKind, MachineFault

PhaseName = Literal["idle", "closing", "holding"]

SCENES = ("bulb", "tomato", "carton", "banana")
"""Objects of the paper that are held with some margin at their grip pressure."""

SEED = 20


class FaultRowError(MbpamError, ValueError):
    """No such row."""


@dataclass(frozen=True)
class FaultRow:
    """A kind of fault, and how its size is drawn.

    Args:
        name: of the row.
        kind: of the fault.
        smallest, largest: size, drawn evenly in its logarithm; 0 and 0 for none.
        either_sign: whether the size is drawn with either sign.
        phases: in which it is tried.
        any_channel: whether it befalls any of the sixteen; otherwise one that the grasp inflates: what an empty chamber
            that stays empty shows is the same with and without the fault.
        watch_s: for how long it is waited for.
        after_s: for how long the gripper is watched after it was found.
    """

    name: str
    kind: FaultKind
    smallest: float = 0.0
    largest: float = 0.0
    either_sign: bool = False
    phases: tuple[PhaseName, ...] = ("closing", "holding")
    any_channel: bool = False
    watch_s: float = 6.0
    after_s: float = 2.5

    def draw(self, random: np.random.Generator, inflated: NDArray[np.bool_]) -> MachineFault:
        """Return a fault of this row.

        Args:
            inflated: channels that the grasp inflates, shape (16,).
        """
        channels = np.arange(CHANNEL_COUNT) if self.any_channel or not inflated.any() else np.flatnonzero(inflated)
        channel = int(random.choice(channels))
        size = 0.0
        if self.largest > 0.0:
            size = math.exp(random.uniform(math.log(self.smallest), math.log(self.largest)))
        if self.either_sign and random.random() < 0.5:
            size = -size
        other = None
        if self.kind == "swapped":
            first = channel - channel % CHAMBERS_PER_FINGER
            other = first + int((channel + random.integers(1, CHAMBERS_PER_FINGER)) % CHAMBERS_PER_FINGER)
        return MachineFault(self.kind, channel, size, other)


_IDLE: tuple[PhaseName, ...] = ("idle",)
_ALL: tuple[PhaseName, ...] = ("idle", "closing", "holding")

ROWS = (
    FaultRow("transducer stuck", "stuck"),
    FaultRow("stuck but noisy", "stuck_noisy"),
    FaultRow("reads 0 with noise", "reads_zero"),
    FaultRow("reads too much or too little at once", "reads_offset", 5e3, 60e3, either_sign=True, phases=("holding",)),
    FaultRow("drift", "drift", 0.3e3, 3e3, either_sign=True, phases=("holding",), watch_s=12.0, after_s=10.0),
    FaultRow("noise", "noise", 5.0, 20.0),
    FaultRow("two channels swapped", "swapped"),
    FaultRow("broken wire", "wire", any_channel=True),
    FaultRow("valve stuck open", "valve_open", 0.2, 1.0, phases=_ALL, any_channel=True),
    FaultRow("valve stuck venting", "valve_vents", 0.2, 1.0),
    FaultRow("valve stuck where it is", "valve_stuck"),
    FaultRow("valve stuck closed", "valve_closed"),
    FaultRow("valve slow", "valve_slow", 0.1, 0.4),
    FaultRow("leak", "leak", 1.0, 8.0),
    FaultRow("small leak", "leak", 20.0, 200.0, phases=("holding",), watch_s=12.0, after_s=10.0),
    FaultRow("a valve leaks in", "leaks_in", 2.0, 50.0, phases=("idle", "holding"), watch_s=8.0, after_s=6.0),
    FaultRow("supply sags", "supply", 0.1, 0.55, watch_s=120.0),
    FaultRow("supply gone", "supply"),
)


def row_named(name: str) -> FaultRow:
    """Return the row of this name.

    Raises:
        FaultRowError: there is none; the message lists those there are.
    """
    for row in ROWS:
        if row.name == name:
            return row
    raise FaultRowError(f"no row {name!r}; rows: {', '.join(row.name for row in ROWS)}")
