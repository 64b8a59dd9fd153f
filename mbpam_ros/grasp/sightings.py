"""What the camera has shown lately, and whether an object that is to be grasped still lies where it was seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mbpam_ros.grasp.selection import DetectedObject


class Sightings:
    """The last two looks at the scene.

    Args:
        moved_m: an object that is seen farther than this from where it was has moved.
        stale_s: a look older than this tells nothing of the next.
    """

    def __init__(self, moved_m: float, stale_s: float) -> None:
        self._moved_m, self._stale_s = moved_m, stale_s
        self._before: tuple[DetectedObject, ...] = ()
        self._before_s = -math.inf
        self.newest: tuple[DetectedObject, ...] = ()
        self.time_s = -math.inf

    def take(self, time_s: float, objects: Sequence[DetectedObject]) -> None:
        """Take what is seen at ``time_s`` [s], nothing included. Looks of one time are one; an older one is none."""
        if time_s < self.time_s:
            return
        if time_s > self.time_s:
            self._before, self._before_s = self.newest, self.time_s
        self.newest, self.time_s = tuple(objects), time_s

    def forget(self) -> None:
        """Know of no look."""
        self._before, self._before_s = (), -math.inf
        self.newest, self.time_s = (), -math.inf

    def vanished(self) -> str | None:
        """Return what was there in the look before and is not in the newest, if that shows nothing at all."""
        if self.newest or not self._before or self.time_s - self._before_s > self._stale_s:
            return None
        return f"{self._before[0].words} was seen {self.time_s - self._before_s:.1f} s before, and is not any more"

    def unrest(self, target: DetectedObject) -> str | None:
        """Return by how much an object of the newest look has moved since the look before, or None.

        One that was not seen before has not moved, unless one like it is missing from where it was.
        """
        if self.time_s - self._before_s > self._stale_s:
            return None
        before = [item for item in self._before if item.shape == target.shape]
        gone = [item for item in before if not any(_apart_m(item, now) <= self._moved_m for now in self.newest)]
        if any(_apart_m(item, target) <= self._moved_m for item in before) or not gone:
            return None
        apart_m = min(_apart_m(item, target) for item in gone)
        return f"it moved by {1e3 * apart_m:.0f} mm between the last two looks; wait until it rests"

    def lost(self, target: DetectedObject) -> str | None:
        """Return why ``target``, chosen earlier, is not where it was in the newest look, or None."""
        alike = [_apart_m(item, target) for item in self.newest if item.shape == target.shape]
        if not alike:
            return f"{target.label} has vanished since it was chosen"
        if min(alike) > self._moved_m:
            return f"{target.label} has moved by {1e3 * min(alike):.0f} mm since it was chosen"
        return None


def _apart_m(one: DetectedObject, other: DetectedObject) -> float:
    """Level distance, less what is open in centres of objects seen in part. The depth is told less well."""
    open_m = 0.5 * max(*one.hidden_m, *other.hidden_m)
    return max(math.dist(one.position_m[:2], other.position_m[:2]) - open_m, 0.0)
