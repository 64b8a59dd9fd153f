"""One time line from message stamps and the node's own clock, and how old a message is by its stamp."""

from __future__ import annotations

import math

from mbpam_ros.nodes.messages import MessageError
from mbpam_ros.nodes.parameters import Parameter

LARGEST_DELAY_S = 0.1
"""No transport on one machine takes longer."""

CLOCK_TOLERANCE = Parameter(
    "clock_tolerance_s",
    0.1,
    "by how much clocks of other hosts may differ from this one [s]; 0: stamps are of another clock, never compared",
    0.0,
    10.0,
)


class StampError(MessageError):
    """The stamp says that the message is too old, or comes from a clock that is not this one."""

    repeat_s = 60.0
    """Clocks that differ go on differing: said once a minute."""


def stamp_age(stamp_s: float, clock_s: float, oldest_s: float, tolerance_s: float) -> float:
    """Return how old a message is by its stamp [s], never negative.

    Args:
        stamp_s: its stamp.
        clock_s: this host's time of the same kind; 0 before simulated time has begun, then the age is not known: 0.
        oldest_s: above this age it is of no use.
        tolerance_s: by how much the clocks may differ; 0 for a stamp of some other clock: then its age is 0.

    Raises:
        StampError: too old, or from the future.
    """
    if tolerance_s == 0.0 or clock_s == 0.0:
        return 0.0
    age_s = clock_s - stamp_s
    if stamp_s == 0.0 and age_s > oldest_s + tolerance_s:
        raise StampError("it has no stamp (1970): stamp every message with the time of what it tells")
    cure = "synchronise the clocks of the hosts (chrony), or set clock_tolerance_s"
    if age_s > oldest_s + tolerance_s:
        raise StampError(
            f"stamped {_span(age_s)} ago by this computer's clock, at most {oldest_s:g} s may be: it is late, "
            f"or its sender's clock is behind; {cure}"
        )
    if age_s < -tolerance_s:
        raise StampError(f"stamped {_span(-age_s)} in the future: its sender's clock is ahead; {cure}")
    return max(age_s, 0.0)


def _span(span_s: float) -> str:
    return f"{span_s:.2f} s" if span_s < 100.0 else f"{span_s / 3600.0:.2f} h"


class Waiting:
    """For how long samples have waited to be taken, beyond the least of late: no clocks need to agree for that."""

    _SPAN_S = 5.0

    def __init__(self) -> None:
        self._least_s = self._least_before_s = math.inf
        self._until_s = -math.inf

    def late_s(self, stamp_s: float, now_s: float) -> float:
        """Return by how much more than the least within the last 5 to 10 s a sample is late [s].

        Args:
            stamp_s: its stamp.
            now_s: of a clock that nobody sets.
        """
        if now_s >= self._until_s:
            self._least_before_s, self._least_s, self._until_s = self._least_s, math.inf, now_s + self._SPAN_S
        self._least_s = min(self._least_s, now_s - stamp_s)
        return now_s - stamp_s - min(self._least_s, self._least_before_s)


class StampClock:
    """Time of the samples on one topic, for code that must know how old the last one is.

    Samples count by their stamps, so that what is computed from them does not depend on when they were delivered;
    between samples time goes on with the node's clock. The two differ by the transport's delay, so a stamp a little
    before a moment already reported counts as that moment. A stamp further back is a clock set back or a source that
    paused, and is passed on as it is; the same stamp again is no new sample.

    With the clock that stamps are of beside it, a sample that is too old is refused, and one whose stamp is before the
    last one's is told apart: if the last one's lies in the future now, the clock was set back; else it was overtaken.

    Args:
        oldest_s: above this age by its stamp a sample is of no use.
        tolerance_s: by how much clocks may differ; 0: stamps are not compared with any clock.
    """

    def __init__(self, oldest_s: float = math.inf, tolerance_s: float = 0.0) -> None:
        self._oldest_s, self._tolerance_s = oldest_s, tolerance_s
        self._time_s: float | None = None
        self._stamp_s = 0.0
        self._received_s = 0.0

    def sample(self, stamp_s: float, now_s: float, clock_s: float = 0.0) -> float:
        """Return the time of a sample stamped ``stamp_s`` and received at ``now_s`` [s].

        Args:
            stamp_s: its stamp.
            now_s: the node's time, of a clock that nobody sets.
            clock_s: the time that stamps are of; 0 where there is none.

        Raises:
            StampError: the sample is too old, or from the future.
            MessageError: the stamp is that of the last sample, so nobody can say how old this one is; or it was
                overtaken by a later one.
        """
        stamp_age(stamp_s, clock_s, self._oldest_s, self._tolerance_s)
        last_s = self._time_s
        if last_s is not None and stamp_s == self._stamp_s:
            raise MessageError(f"header.stamp stands still at {stamp_s:.3f} s; stamp every sample with its own time")
        if last_s is not None:
            self._refuse_overtaken(stamp_s, clock_s)
        restarted = last_s is None or stamp_s < max(self._stamp_s, last_s - LARGEST_DELAY_S)
        time_s = stamp_s if restarted or last_s is None else max(stamp_s, last_s)
        self._stamp_s, self._received_s, self._time_s = stamp_s, now_s, time_s
        return time_s

    def order(self, stamp_s: float, clock_s: float) -> None:
        """Take a message of which only the order counts.

        Raises:
            MessageError: it was overtaken by a later one.
        """
        self._refuse_overtaken(stamp_s, clock_s)
        self._stamp_s = stamp_s

    def age(self, now_s: float) -> float:
        """Return how long ago the last sample was received [s]; infinite if there was none."""
        if self._time_s is None:
            return math.inf
        self._received_s = min(self._received_s, now_s)  # a simulation started anew
        return now_s - self._received_s

    def time(self, now_s: float) -> float:
        """Return the time at ``now_s`` without a new sample [s]; the node's clock if there never was one."""
        if self._time_s is None:
            return now_s
        self._time_s = max(self._time_s, self._stamp_s + self.age(now_s))
        return self._time_s

    def _refuse_overtaken(self, stamp_s: float, clock_s: float) -> None:
        compared = self._tolerance_s > 0.0 and clock_s > 0.0
        if compared and stamp_s < self._stamp_s <= clock_s + self._tolerance_s:
            raise MessageError(f"it comes {1e3 * (self._stamp_s - stamp_s):.0f} ms behind a later one: overtaken")
