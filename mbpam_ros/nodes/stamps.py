"""One time line from message stamps and the node's own clock."""

from __future__ import annotations

from mbpam_ros.nodes.messages import MessageError

LARGEST_DELAY_S = 0.1
"""No transport on one machine takes longer."""


class StampClock:
    """Time of the samples on one topic, for code that must know how old the last one is.

    Samples count by their stamps, so that what is computed from them does not depend on when they were delivered;
    between samples time goes on with the node's clock. The two differ by the transport's delay, so a stamp a little
    before a moment already reported counts as that moment. A stamp further back, or before the last sample's, is a
    clock set back or a source that paused, and is passed on as it is; the same stamp again is no new sample.
    """

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._stamp_s = 0.0
        self._received_s = 0.0

    def sample(self, stamp_s: float, now_s: float) -> float:
        """Return the time of a sample stamped ``stamp_s`` and received at ``now_s`` [s].

        Raises:
            MessageError: the stamp is that of the last sample, so nobody can say how old this one is.
        """
        last_s = self._time_s
        if last_s is not None and stamp_s == self._stamp_s:
            raise MessageError(f"header.stamp stands still at {stamp_s:.3f} s; stamp every sample with its own time")
        restarted = last_s is None or stamp_s < max(self._stamp_s, last_s - LARGEST_DELAY_S)
        time_s = stamp_s if restarted or last_s is None else max(stamp_s, last_s)
        self._stamp_s, self._received_s, self._time_s = stamp_s, now_s, time_s
        return time_s

    def age(self, now_s: float) -> float:
        """Return how long ago the last sample was received [s]; infinite if there was none."""
        if self._time_s is None:
            return float("inf")
        self._received_s = min(self._received_s, now_s)  # a simulation started anew
        return now_s - self._received_s

    def time(self, now_s: float) -> float:
        """Return the time at ``now_s`` without a new sample [s]; the node's clock if there never was one."""
        if self._time_s is None:
            return now_s
        self._time_s = max(self._time_s, self._stamp_s + self.age(now_s))
        return self._time_s
