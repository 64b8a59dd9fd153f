"""What is found wrong with a channel or the supply, as data and as a line that another node reads back.

======================= ==================================================== ======================================
fault                   what was seen                                        what it may be
======================= ==================================================== ======================================
does not follow         no answer to a valve that fills, or to a test pulse  valve closed, or transducer stuck
does not vent           no answer to a valve that vents                      valve or vent closed, transducer stuck
reading jumped          a step that no valve can make                        transducer or wire
swapped                 each of two channels answers to the other's valve    plugs or tubes exchanged
rises without its valve pressure comes in while the valve is closed          valve stuck open or where it was
leaks in                the same, but no faster than the valve lets it out   valve not tight
leaks                   pressure goes while the valve is closed, fast        leak to ambient
leak or drift           pressure goes, or comes, slowly                      not yet told apart
drifts                  the same, and the chamber did not follow its reading transducer
slow valve              it answers late                                      valve
noisy                   more noise than its data sheet says                  transducer, its supply or ground
supply low              all channels that fill starve together               supply, regulator, its valve
no valid reading        nothing finite within the watchdog's time            transducer, wire, its node
over-pressure           above what a chamber may have                        any of these
======================= ==================================================== ======================================
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.errors import MbpamError

SUPPLY = "supply"
"""What stands for a channel in findings about the supply, and its valve's name among the valve commands."""


class Fault(Enum):
    """What is wrong, as far as it can be told."""

    NOT_FOLLOWING = "does not follow"
    NOT_VENTING = "does not vent"
    JUMPED = "reading jumped"
    SWAPPED = "swapped"
    RISES = "rises without its valve"
    LEAKS_IN = "leaks in"
    LEAK = "leaks"
    LEAK_OR_DRIFT = "leak or drift"
    DRIFT = "drifts"
    SLOW_VALVE = "slow valve"
    NOISY = "noisy"
    SUPPLY_LOW = "supply low"
    NO_READING = "no valid reading"
    OVER_PRESSURE = "over-pressure"


class FindingError(MbpamError, ValueError):
    """A line that is no finding."""


@dataclass(frozen=True)
class Finding:
    """A fault that was found.

    Args:
        fault: which.
        channels: names of the channels, or ``supply``.
        evidence: what was seen, in words and numbers, on one line.
        confidence: probability that a sound machine would not have shown it, as far as the model of it goes, 0 to 1.
    """

    fault: Fault
    channels: tuple[str, ...]
    evidence: str
    confidence: float

    def __str__(self) -> str:
        return f"{self.fault.value} ({100.0 * self.confidence:.0f} %): {self.evidence}"

    @property
    def text(self) -> str:
        """One line with the channels in front."""
        return f"{', '.join(self.channels)}: {self}"

    @classmethod
    def parse(cls, channel: str, line: str) -> Finding:
        """Return the finding of a channel that ``str`` has made a line of, as health reports carry it.

        Raises:
            FindingError: it is none.
        """
        match = _LINE.fullmatch(line)
        if match is None or match["fault"] not in _BY_VALUE or channel not in _CHANNELS:
            raise FindingError(f"{channel}: {line[:80]!r} is no finding")
        return cls(_BY_VALUE[match["fault"]], (channel,), match["evidence"], int(match["percent"]) / 100.0)


_LINE = re.compile(r"(?P<fault>[a-z -]+) \((?P<percent>\d{1,3}) %\): (?P<evidence>.*)")
_BY_VALUE = {fault.value: fault for fault in Fault}
_CHANNELS = {*CHANNEL_NAMES, SUPPLY}
