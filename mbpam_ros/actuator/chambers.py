"""Chambers, channels and bend directions: the names and angles everything else counts by.

Muscle frame: z along the muscle from clamp to tip, the arms of the cross-shaped base layer along x and y. Chambers
1 to 4 sit at azimuth 45, 135, 225, 315 deg; a pressurised chamber bends the muscle away from itself, toward its
azimuth + 180 deg. One chamber under pressure (PSC) bends along a diagonal, two adjacent ones (PDC) along an axis.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FINGER_COUNT = 4
CHAMBERS_PER_FINGER = 4
CHANNEL_COUNT = FINGER_COUNT * CHAMBERS_PER_FINGER

CHAMBER_AZIMUTH_RAD = np.radians([45.0, 135.0, 225.0, 315.0])
"""Azimuth of chambers 1 to 4 in the muscle frame, shape (4,)."""

CHANNEL_NAMES: tuple[str, ...] = tuple(
    f"finger_{finger}_chamber_{chamber}"
    for finger in range(1, FINGER_COUNT + 1)
    for chamber in range(1, CHAMBERS_PER_FINGER + 1)
)
"""The 16 pressure channels in the order of every 16-vector of this package."""

BEND_NAMES: tuple[str, ...] = tuple(
    f"finger_{finger}_bend_{axis}" for finger in range(1, FINGER_COUNT + 1) for axis in "xy"
)
"""The 8 bend components in the order of a (4, 2) bend array read row by row."""

FINGER_NAMES: tuple[str, ...] = tuple(f"finger_{finger}" for finger in range(1, FINGER_COUNT + 1))


def same_finger(channel: int) -> NDArray[np.bool_]:
    """Return which channels, shape (16,), are of the finger of channel 0 to 15, itself too."""
    of_finger: NDArray[np.bool_] = np.arange(CHANNEL_COUNT) // CHAMBERS_PER_FINGER == channel // CHAMBERS_PER_FINGER
    return of_finger


def pressurised_chambers(bend_azimuth_rad: float) -> NDArray[np.bool_]:
    """Return which chambers, shape (4,), bend a muscle toward ``bend_azimuth_rad``.

    Raises:
        ValueError: the azimuth is none of the eight directions (multiples of 45 deg).
    """
    eighths = bend_azimuth_rad / (math.pi / 4.0)
    if not math.isfinite(eighths) or abs(eighths - round(eighths)) > 1e-6:
        raise ValueError(
            f"bend azimuth {math.degrees(bend_azimuth_rad):.6g} deg is not one of the eight directions "
            "(multiples of 45 deg)"
        )
    away = np.cos(CHAMBER_AZIMUTH_RAD - bend_azimuth_rad)
    # Diagonal: the one chamber exactly opposite (cos = -1). Axis: the two at 135 deg (cos = -0.71).
    return away < (-0.9 if round(eighths) % 2 else -0.5)
