"""The arm's part of a scene: raising and lowering the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.answer import Answer
from mbpam_ros.configuration import require_positive


@dataclass(frozen=True)
class LiftConfig:
    """How far and how fast the hand is raised.

    Args:
        height_m: travel of the hand, up.
        duration_s: time from rest to rest.
    """

    height_m: float
    duration_s: float

    def __post_init__(self) -> None:
        require_positive(self, "height_m", "duration_s")


class HandLift:
    """Height of the hand over time, minimum jerk between its two ends: h = H (10 x^3 - 15 x^4 + 6 x^5), x = t / T.

    Velocity and acceleration are zero at both ends (Flash and Hogan, 1985, Eq. 3).
    """

    def __init__(self, config: LiftConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Put the hand down, at rest."""
        self._start_s, self._from_m, self._to_m = -self._config.duration_s, 0.0, 0.0

    def raise_hand(self, time_s: float) -> Answer:
        """Start raising the hand at ``time_s``; refused while it moves or when it is up."""
        return self._move(time_s, self._config.height_m, "up")

    def lower_hand(self, time_s: float) -> Answer:
        """Start lowering the hand at ``time_s``; refused while it moves or when it is down."""
        return self._move(time_s, 0.0, "down")

    def _move(self, time_s: float, to_m: float, where: str) -> Answer:
        left_s = self._start_s + self._config.duration_s - time_s
        if left_s > 1e-9:
            return Answer(False, f"the hand is moving, for another {left_s:.2f} s")
        if self._to_m == to_m:
            return Answer(False, f"the hand is already {where}")
        self._start_s, self._from_m, self._to_m = time_s, self._to_m, to_m
        return Answer(True, f"moving {where}, {self._config.height_m:g} m in {self._config.duration_s:g} s")

    def motion(self, time_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return height [m] and upward velocity [m/s] of the hand at the given times, of their shape."""
        at_s = np.asarray(time_s, dtype=float)
        if at_s.min() >= self._start_s + self._config.duration_s:  # as nearly always
            return np.full(at_s.shape, self._to_m), np.zeros(at_s.shape)
        x = np.clip((at_s - self._start_s) / self._config.duration_s, 0.0, 1.0)
        travel, left, square = self._to_m - self._from_m, 1.0 - x, x * x
        height = self._from_m + travel * square * x * (10.0 - 15.0 * x + 6.0 * square)
        return height, (30.0 * travel / self._config.duration_s) * square * left * left
