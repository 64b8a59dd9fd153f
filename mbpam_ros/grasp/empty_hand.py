"""How far the fingers of an empty hand bend in each mode, over the pressure: what a full hand is compared with.

In the modes in which fingers meet they stop each other, so this is not what free muscles do: it is measured in the
simulated gripper. ``mbpam grip-table`` writes it beside the least pressures.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.grasp.grip_pressure import TABLE
from mbpam_ros.grasp.modes import MODE_NAMES

Array = NDArray[np.float64]


class EmptyHand:
    """Bends of an empty hand.

    Args:
        rows: a dict for each mode: ``mode``, ``pressure_gauge_pa``, rising, and for each of these ``bend_deg``, one a
            finger.

    Raises:
        ValueError: a mode is missing, or its numbers do not fit together.
    """

    def __init__(self, rows: Sequence[Mapping[str, Any]]) -> None:
        self._tables: dict[str, tuple[Array, Array]] = {}
        for row in rows:
            pressure, bend = np.array(row["pressure_gauge_pa"], dtype=float), np.array(row["bend_deg"], dtype=float)
            if bend.shape != (pressure.size, FINGER_COUNT) or (np.diff(pressure) <= 0.0).any():
                raise ValueError(f"{row['mode']}: bends of {FINGER_COUNT} fingers over rising pressures expected")
            self._tables[row["mode"]] = pressure, bend
        missing = [mode for mode in MODE_NAMES if mode not in self._tables]
        if missing:
            raise ValueError(f"no bends of the empty hand in {', '.join(missing)}")

    def bend_deg(self, mode: str, pressure_gauge_pa: float, quarter_turns: int, mirrored: bool) -> Array:
        """Return how far each finger of a mode so posed bends the way it is to, shape (4,) [deg]."""
        pressure, bend = self._tables[mode]
        found = np.array([np.interp(pressure_gauge_pa, pressure, bend[:, finger]) for finger in range(FINGER_COUNT)])
        return np.roll(found[::-1] if mirrored else found, quarter_turns)


def load_empty_hand(name: str | Path = TABLE) -> EmptyHand:
    """Read the bends beside a table of grip pressures.

    Raises:
        ConfigError: no such file, or it has none.
    """
    path = config_path(name)
    try:
        return EmptyHand(json.loads(path.read_text(encoding="utf-8"))["empty"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no bends of an empty hand ({error}); make them with mbpam grip-table") from None
