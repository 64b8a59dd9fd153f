"""Where a grasp stands."""

from __future__ import annotations

from enum import Enum


class Phase(Enum):
    """Where a grasp stands."""

    IDLE = "idle"
    CLOSING = "closing"
    HOLDING = "holding"
    RELEASING = "releasing"
    FAULT = "fault"
