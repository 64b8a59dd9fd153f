"""Brings what the valves, the pressures and the camera tell of a grasp before the judge of held and empty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.grasp.empty_hand import EmptyHand
from mbpam_ros.grasp.holding import HoldingConfig, HoldingJudge, Verdict
from mbpam_ros.grasp.selection import DetectedObject

if TYPE_CHECKING:
    from mbpam_ros.grasp.air_bend import AirBend

Array = NDArray[np.float64]

OPEN_BELOW_PA = 5e3
"""Chambers under less hold what straight fingers hold, so that an account of the air can begin."""

_SAME_DIRECTION_RAD = 0.2
"""What is seen within this angle of where an object was, from the palm, or within its half width, is the same one."""


class HoldingWatch:
    """Judges one grasp after the other.

    Args:
        config: how the senses are weighed.
        air, empty: account of the air, and bends of an empty hand; none where valves or volumes are not known.
    """

    def __init__(self, config: HoldingConfig, air: AirBend | None = None, empty: EmptyHand | None = None) -> None:
        self._judge, self._air, self._empty = HoldingJudge(config), air, empty
        self._confidence_min = config.camera_confidence_min
        self._pose: tuple[str, int, bool] = ("", 0, False)
        self._grip_pa = np.zeros(0)
        self._target: DetectedObject | None = None

    @property
    def listens_to_air(self) -> bool:
        """Whether it has a use for the openings of the valves."""
        return self._air is not None

    def begin(
        self,
        time_s: float,
        pressure_gauge_pa: Array,
        setpoint_gauge_pa: Array,
        pose: tuple[str, int, bool],
        target: DetectedObject | None,
    ) -> None:
        """Begin with a grasp that closes.

        Args:
            time_s: now.
            pressure_gauge_pa, setpoint_gauge_pa: now and to come, shape (16,).
            pose: the mode's name, its quarter turns, and whether it is mirrored.
            target: what the camera has chosen, if it has.
        """
        self._judge.begin()
        self._pose, self._grip_pa, self._target = pose, setpoint_gauge_pa, target
        if self._air is None:
            return
        if (np.abs(pressure_gauge_pa) < OPEN_BELOW_PA).all():
            self._air.begin(time_s, pressure_gauge_pa)
        else:  # another mode than before: where the air is now is not known
            self._air.forget()

    def valves(self, time_s: float, spool: Array) -> None:
        """Take the openings that the valves are commanded from now on, shape (16,)."""
        if self._air is not None:
            self._air.update(time_s, spool)

    def shortfall_deg(self, pressure_gauge_pa: Array) -> float:
        """Return by how much the fingers are bent less than an empty hand's, in the mean [deg]; NaN: not known."""
        if self._air is None or self._empty is None or not self._air.known or not np.isfinite(pressure_gauge_pa).all():
            return math.nan
        filled = self._grip_pa > 0.0
        bend_deg = np.degrees(self._air.bend_rad(pressure_gauge_pa, filled))
        mode, quarter_turns, mirrored = self._pose
        grip_pa = float(pressure_gauge_pa[filled].mean())
        return float(np.nanmean(self._empty.bend_deg(mode, grip_pa, quarter_turns, mirrored) - bend_deg))

    def feel(self, pressure_gauge_pa: Array) -> Verdict:
        """Return the verdict at these pressures, shape (16,), of a hand that has closed."""
        self._judge.feel(self._pose[0], self.shortfall_deg(pressure_gauge_pa))
        return self._judge.verdict()

    def look(self, objects: Sequence[DetectedObject]) -> None:
        """Take what the camera sees after the hand was raised. It says nothing of what an operator's mode closed on."""
        if self._target is not None:
            self._judge.see(self.size_ratio(objects))

    def size_ratio(self, objects: Sequence[DetectedObject]) -> float | None:
        """Return the size in the image of what shows where the target was, over the target's; None: nothing does."""
        if self._target is None:
            return None
        target = self._target
        sure = (item for item in objects if item.confidence >= self._confidence_min)
        within_rad = max(_SAME_DIRECTION_RAD, 0.5 * _size_rad(target))
        there = [_size_rad(item) for item in sure if _angle_rad(item, target) < within_rad]
        return max(there) / _size_rad(target) if there else None


def _size_rad(item: DetectedObject) -> float:
    """The second of the extents, over the distance from the palm: of rods and boxes that lie, their width or height."""
    return sorted(item.size_m)[1] / math.hypot(*item.position_m)


def _angle_rad(one: DetectedObject, other: DetectedObject) -> float:
    a, b = np.array(one.position_m), np.array(other.position_m)
    cosine = float(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-9))
    return math.acos(min(max(cosine, -1.0), 1.0))
