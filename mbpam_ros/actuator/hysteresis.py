"""The pressure that a muscle has taken notice of: rate-independent hysteresis of its silicone, as a play.

Bends and forces of a real muscle lag behind its pressure by nearly the same pressure w on the way up and on the way
down, whatever the rate. The felt pressure q moves only when it is pushed (Krasnosel'skii's play),

    q <- min(max(q, p - w), p + w),

so q = p - w while p rises and p + w while it falls, after a reversal over 2 w. It is never negative, and stable for any
step: q depends on the turning points of p alone, not on how the way between them is divided.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def felt_pressure(
    felt_pa: NDArray[np.float64], pressure_gauge_pa: NDArray[np.float64], half_width_pa: float
) -> NDArray[np.float64]:
    """Return q after a straight way to ``pressure_gauge_pa``; NaN in ``felt_pa`` begins there, without a past.

    Args:
        felt_pa: q before, any shape.
        pressure_gauge_pa: p, of that shape.
        half_width_pa: w >= 0.
    """
    if half_width_pa == 0.0:
        return pressure_gauge_pa
    before = np.where(np.isnan(felt_pa), pressure_gauge_pa, felt_pa)
    held = np.clip(before, pressure_gauge_pa - half_width_pa, pressure_gauge_pa + half_width_pa)
    felt: NDArray[np.float64] = np.maximum(held, np.minimum(pressure_gauge_pa, 0.0))
    return felt
