"""Choose one design of a front by a stated rule: its knee, weights, or a required force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.design.pareto import Front


class CompromiseError(MbpamError, ValueError):
    """No design of the front obeys the rule; the message says what would."""


Rule = Callable[[Front], int]
"""Index of the chosen design in a front of angle and force."""


def knee(front: Front) -> int:
    """Choose the design furthest beyond the chord between the front's ends, each response over its range (Das 1999)."""
    share = _shares(front)
    return int(np.argmax(share.sum(axis=1)))


def weighted(weight_first: float, weight_second: float) -> Rule:
    """Return the rule that takes the least of the larger weighted shortfall from the best of each response (Chebyshev).

    Unlike a weighted sum it can reach every design of a front, also where that is hollow.

    Raises:
        CompromiseError: a weight is negative or not finite, or both are zero.
    """
    weights = np.array([weight_first, weight_second])
    if not np.isfinite(weights).all() or weights.min() < 0.0 or weights.max() == 0.0:
        raise CompromiseError(
            f"weights must not be negative nor all zero, found {weight_first:g} and {weight_second:g}"
        )

    def rule(front: Front) -> int:
        shortfall = weights * (1.0 - _shares(front))
        # The sum breaks ties, as with a weight of zero.
        return int(np.lexsort((shortfall.sum(axis=1), shortfall.max(axis=1)))[0])

    return rule


def required_force(force_n: float) -> Rule:
    """Return the rule that takes the largest angle among the designs with at least this force [N].

    Raises:
        CompromiseError: no force at all: negative or not finite. By the rule: no design of the front has this force.
    """
    if not 0.0 <= force_n < float("inf"):
        raise CompromiseError(f"the required force must be a number that is not negative, found {force_n:g} N")

    def rule(front: Front) -> int:
        strong = np.flatnonzero(front.values[:, 1] >= force_n)
        if strong.size == 0:
            raise CompromiseError(
                f"no design of the front has {force_n:g} N; the largest force possible is "
                f"{front.values[:, 1].max():.4f} N"
            )
        return int(strong[-1])

    return rule


def _shares(front: Front) -> NDArray[np.float64]:
    """Each response from 0 (its worst on the front) to 1 (its best)."""
    low, spread = front.values.min(axis=0), np.ptp(front.values, axis=0)
    return (front.values - low) / np.where(spread > 0.0, spread, 1.0)
