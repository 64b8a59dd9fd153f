"""How late a process gets the processor: what tells a slow computer from a silent sensor."""

from __future__ import annotations

from collections import deque


class Lateness:
    """Watches a timer of the process itself: what it is late by, everything in the process was.

    Args:
        period_s: of the timer; a pause is seen to within one period.
        memory_s: how long a late call is remembered.
    """

    def __init__(self, period_s: float, memory_s: float) -> None:
        self._period_s, self._memory_s = period_s, memory_s
        self._called_s: float | None = None
        self._late: deque[tuple[float, float]] = deque()

    def call(self, now_s: float) -> None:
        """Take one call of the timer, at ``now_s`` [s] of a clock that nobody can set."""
        late_s = self._overdue_s(now_s)
        self._called_s = now_s
        if late_s > 0.0:
            self._late.append((now_s, late_s))

    def worst_s(self, now_s: float) -> float:
        """Return the longest delay of the last ``memory_s`` [s], that of a call which is overdue now included."""
        while self._late and now_s - self._late[0][0] > self._memory_s:
            self._late.popleft()
        return max([self._overdue_s(now_s), *(late_s for _, late_s in self._late)])

    def _overdue_s(self, now_s: float) -> float:
        return 0.0 if self._called_s is None else max(0.0, now_s - self._called_s - self._period_s)
