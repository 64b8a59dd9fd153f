"""What a stop is answered with: not that it was asked for, but what came of it.

================= ============================ =========================================================
the valves        the pressures                the answer
================= ============================ =========================================================
acknowledged      down, or all falling         stopped
no word           down, or all falling         stopped, though nobody acknowledged it
acknowledged      some do not fall, or unknown not confirmed: which ones stand, at what
no word           some do not fall, or unknown nobody answers: which ones stand, at what
================= ============================ =========================================================

The first is given at once, the others after :data:`ANSWER_WITHIN_S`. The fault is latched in any case.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.answer import Answer

ANSWER_WITHIN_S = 0.25
"""With the way there and back, less than the 0.3 s within which an operator has to know."""

FALL_PA = 500.0
"""A pressure that is lower by this has fallen: several times a filtered reading's noise, 25 ms of a vent at 5 kPa."""

_CHAMBERS_NAMED = 4


class StopConfirmation:
    """Waits for what confirms a stop.

    Args:
        time_s: of the stop, on a clock that nobody can set.
        pressure_gauge_pa: at the stop, shape (16,) [Pa gauge]; NaN where not measured.
        open_below_gauge_pa: below this a chamber counts as vented.
    """

    def __init__(self, time_s: float, pressure_gauge_pa: NDArray[np.float64], open_below_gauge_pa: float) -> None:
        self._time_s = time_s
        self._before_pa = pressure_gauge_pa
        self._open_below_pa = open_below_gauge_pa
        self._acknowledged = False

    def acknowledge(self) -> None:
        """Take the word of the valves that they vent."""
        self._acknowledged = True

    def verdict(self, time_s: float, pressure_gauge_pa: NDArray[np.float64]) -> Answer | None:
        """Return the answer, or None while it may still become a better one.

        Args:
            time_s: now.
            pressure_gauge_pa: now, shape (16,) [Pa gauge]; NaN where not measured.
        """
        down = pressure_gauge_pa < self._open_below_pa  # False for NaN
        standing = ~(down | (pressure_gauge_pa <= self._before_pa - FALL_PA))
        if self._acknowledged and not standing.any():
            return self._stopped("valve_controller vents", pressure_gauge_pa)
        if time_s - self._time_s < ANSWER_WITHIN_S:
            return None
        if not standing.any():
            return self._stopped("valve_controller has not acknowledged it", pressure_gauge_pa)
        who = (
            "valve_controller acknowledged it"
            if self._acknowledged
            else "nobody answers: valve_controller has not acknowledged it"
        )
        return Answer(
            False,
            f"stop latched, but {who}, and after {ANSWER_WITHIN_S:g} s there stand "
            f"{_readings(pressure_gauge_pa, standing)}; shut the air off by hand",
        )

    def _stopped(self, who: str, pressure_gauge_pa: NDArray[np.float64]) -> Answer:
        highest_pa = np.max(pressure_gauge_pa)
        air = "all are down" if highest_pa < self._open_below_pa else f"all fall, the highest is {highest_pa:.0f} Pa"
        return Answer(True, f"stopped, venting: {who}, {air}; call grasp/reset once the pressures are down")


def _readings(pressure_gauge_pa: NDArray[np.float64], channels: NDArray[np.bool_]) -> str:
    index = np.flatnonzero(channels)
    unknown = np.isnan(pressure_gauge_pa[index])
    if unknown.all():
        return f"{len(index)} chambers at pressures that nobody measures"
    order = index[np.argsort(-np.nan_to_num(pressure_gauge_pa[index], nan=np.inf), kind="stable")]
    shown = [
        f"{CHANNEL_NAMES[i]} at {'an unknown pressure' if np.isnan(value) else f'{value:.0f} Pa'}"
        for i, value in zip(order[:_CHAMBERS_NAMED], pressure_gauge_pa[order[:_CHAMBERS_NAMED]], strict=True)
    ]
    more = len(index) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
