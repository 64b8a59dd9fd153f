"""Which report, or silence, of a part that a grasp depends on is a fault.

=============================== ==========================================================================
the part                        counts as
=============================== ==========================================================================
has not reported yet            a fault: no grasp begins
reports that it is not well     a fault
reports that its air is off     a fault, unless one is latched: a reset comes before the air is on again
is silent for :data:`SILENCE_S` a fault, until its next report
gives no sign of life any more  a fault, until it gives one and reports
there is more than once         a fault, until there is one
=============================== ==========================================================================

What a fault does is the arbiter's (:mod:`~mbpam_ros.grasp.arbitration`).
"""

from __future__ import annotations

from collections.abc import Mapping

from mbpam_ros.grasp.arbitration import Arbiter, Phase

SILENCE_S = 3.5
"""A part that misses three of its reports, one a second, counts as ended."""


class HealthWatch:
    """Tells an arbiter of the health of what it depends on.

    Args:
        arbiter: who is told.
        sources: the parts, each with what to say until its first report.
        time_s: the arbiter's time now.
    """

    def __init__(self, arbiter: Arbiter, sources: Mapping[str, str], time_s: float) -> None:
        self._arbiter = arbiter
        self._reported_s: dict[str, float] = {}
        self._wrong: dict[str, str] = {}
        for source, reason in sources.items():
            arbiter.observe_health(time_s, source, False, reason)

    def report(self, time_s: float, source: str, well: bool, message: str, air_on: bool = True) -> None:
        """Take a report of a part: whether it is well, in words, and whether its air is on, if it has any."""
        self._reported_s[source] = time_s
        if source in self._wrong:
            return
        ok = well and (air_on or self._arbiter.phase is Phase.FAULT)
        self._arbiter.observe_health(time_s, source, ok, message)

    def find_wrong(self, time_s: float, source: str, reason: str) -> None:
        """Take notice that a part gives no sign of life, or that there are two; its reports count for nothing now."""
        self._wrong[source] = reason
        self._arbiter.observe_health(time_s, source, False, reason)

    def find_right(self, source: str) -> None:
        """Take notice that there is one again, and that it lives; what it reports next counts."""
        self._wrong.pop(source, None)

    def look(self, time_s: float) -> None:
        """Find the parts that have fallen silent; call it before each tick of the arbiter."""
        for source, reported_s in self._reported_s.items():
            if source not in self._wrong and time_s - reported_s > SILENCE_S:
                self._arbiter.observe_health(time_s, source, False, f"no health report for {SILENCE_S:g} s")
