"""Where the fingers are told to be when an image is taken, whatever comes first, the image or the word of them.

Told shapes count by their stamps: those of an image are the last one before its stamp and the first one at or after it.
One topic keeps its order, so once that first one is here, so is all before it: which two they are depends on the stamps
alone, not on what was delivered when. Until then the image waits, unless nothing has been told for
:data:`STALE_S` of the image's own time; then nothing is told of its fingers.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.detector import Detection

STALE_S = 0.5
"""A shape told longer ago, or later by more, says nothing of an image."""

_OPEN_WITHIN_M = 5e-4  # told so near to open, a finger is open: the mask's margin covers it
_STILL_WITHIN_M = 2.5e-4
_KEPT = 32


class ToldFingers:
    """The last shapes that the fingers were told to have.

    Args:
        open_m: (4, 2, 3), clamps and tips of the fingers that hang open, in ``gripper_base``.
    """

    def __init__(self, open_m: NDArray[np.float64]) -> None:
        self._open_m = open_m
        self._told: deque[tuple[float, NDArray[np.float64] | None]] = deque(maxlen=_KEPT)
        self._answered: NDArray[np.float64] | None = None

    def tell(self, stamp_s: float, fingers_m: NDArray[np.float64] | None) -> None:
        """Take their centre lines, (4, n, 3), at a time; None where the state of one is not known."""
        if self._told and stamp_s <= self._told[-1][0]:
            self._told.clear()  # time was set back
        self._told.append((stamp_s, fingers_m))

    def awaited(self, stamp_s: float) -> bool:
        """Whether the shape at ``stamp_s``, of an image, is still to come."""
        return bool(self._told) and 0.0 < stamp_s - self._told[-1][0] <= STALE_S

    def at(self, stamp_s: float) -> NDArray[np.float64] | None:
        """Return centre lines, (4 or 8, n, 3), between which the fingers are at ``stamp_s``.

        Of fingers that move, those before it, and those after it moved on by as much again: what is told is estimated
        with a lag. None where nothing is known of them, or they are open as far as can be told. While they stand still
        the same array is returned.
        """
        near = [each for each in self._told if abs(each[0] - stamp_s) <= STALE_S]
        before = [lines for time_s, lines in near if time_s < stamp_s][-1:]
        after = [lines for time_s, lines in near if time_s >= stamp_s][:1]
        known = [lines for lines in before + after if lines is not None]
        if not after or len(known) < len(before + after) or len({lines.shape for lines in known}) > 1:
            return None
        if all(self._is_open(lines) for lines in known):
            return None
        fingers = known[-1]
        if len(known) == 2 and not _near(known[0], known[1], _STILL_WITHIN_M):
            fingers = np.concatenate([known[0], 2.0 * known[1] - known[0]])
        if self._answered is None or not _near(fingers, self._answered, _STILL_WITHIN_M):
            self._answered = fingers
        return self._answered

    def _is_open(self, lines: NDArray[np.float64]) -> bool:
        shares = np.linspace(0.0, 1.0, lines.shape[1])[:, None]
        straight = self._open_m[:, :1] + shares * (self._open_m[:, 1:] - self._open_m[:, :1])
        return _near(lines, straight, _OPEN_WITHIN_M)


class UnderHand:
    """What the hand may close on, as seen while it was open.

    A finger that meets an object is not where it is told to be: where objects stand under the hand the fingers are not
    masked by what is told of them.

    Args:
        reach_m: from the palm's axis, of the fingers.
    """

    def __init__(self, reach_m: float) -> None:
        self._reach_m = reach_m
        self.is_empty = False

    def seen(self, detections: Iterable[Detection]) -> None:
        """Take what was seen with open fingers."""
        self.is_empty = not any(self._is_within_reach(each) for each in detections)

    def _is_within_reach(self, found: Detection) -> bool:
        return bool(np.hypot(*found.position_m[:2]) - 0.5 * found.size_m.max() < self._reach_m)


def _near(lines: NDArray[np.float64], others: NDArray[np.float64], within_m: float) -> bool:
    return lines.shape == others.shape and bool(np.abs(lines - others).max() <= within_m)
