"""Pareto fronts of two maximised responses: what is on one, how much it covers, and what it gives at a wanted value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import DesignDomain
from mbpam_ros.errors import MbpamError

Objectives = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Two responses to be maximised, shape (n, 2), of designs (a, b) in millimetres, shape (n, 2)."""


class FrontError(MbpamError, ValueError):
    """There is no trade-off to judge a front by."""


@dataclass(frozen=True)
class Front:
    """Designs none of which another one of them beats in both responses, first response rising, second falling.

    Args:
        design_mm: rows (a, b), shape (n, 2).
        values: rows of the two maximised responses, shape (n, 2).
    """

    design_mm: NDArray[np.float64]
    values: NDArray[np.float64]

    @classmethod
    def of(cls, design_mm: NDArray[np.float64], values: NDArray[np.float64]) -> Front:
        """Return the front of these designs, shapes (n, 2); those with a response that is not finite are left out."""
        kept = non_dominated(values)
        return cls(design_mm[kept], values[kept])

    def hypervolume(self, reference: NDArray[np.float64]) -> float:
        """Return the area between the front and ``reference`` (2,), in the product of the responses' units.

        A design that does not beat the reference in both responses adds nothing.
        """
        inside = self.values[np.all(self.values > reference, axis=1)]
        if inside.size == 0:
            return 0.0
        widths = np.diff(inside[:, 0], prepend=reference[0])
        return float(widths @ (inside[:, 1] - reference[1]))

    def second_at_first(self, first: float) -> float | None:
        """Return the second response where the front has this first one, linear between designs; None off its ends."""
        if not self.values[0, 0] <= first <= self.values[-1, 0]:
            return None
        return float(np.interp(first, self.values[:, 0], self.values[:, 1]))

    def first_at_second(self, second: float) -> float | None:
        """Return the first response where the front has this second one, linear between designs; None off its ends."""
        if not self.values[-1, 1] <= second <= self.values[0, 1]:
            return None
        return float(np.interp(second, self.values[::-1, 1], self.values[::-1, 0]))


def non_dominated(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows of ``values``, shape (n, 2), that no other row beats, first response rising; equal rows once.

    Rows that are not finite are left out.
    """
    finite = np.flatnonzero(np.isfinite(values).all(axis=1))
    falling = finite[np.lexsort((-values[finite, 1], -values[finite, 0]))]
    best_before = np.maximum.accumulate(np.concatenate([[-np.inf], values[falling, 1]]))[:-1]
    return falling[values[falling, 1] > best_before][::-1]


def grid_front(objectives: Objectives, domain: DesignDomain, points: int = 401) -> Front:
    """Return the front of a grid of ``points`` by ``points`` designs over the domain, its ends included."""
    a, b = (np.linspace(low, high, points) for low, high in (domain.a_range_mm, domain.b_range_mm))
    design = np.column_stack([axis.ravel() for axis in np.meshgrid(a, b)])
    return Front.of(design, objectives(design))


def hypervolume_ratio(front: Front, truth: Front) -> float:
    """Return the hypervolume of ``front`` over that of ``truth``, both against the worst of ``truth`` (its nadir).

    The nadir is the strictest usual reference: a point further off would add the same area to both and hide a lack.

    Raises:
        FrontError: ``truth`` has no area, as when one design is best in both responses.
    """
    nadir = truth.values.min(axis=0)
    whole = truth.hypervolume(nadir)
    if whole == 0.0:
        raise FrontError("the true front has no area: one design is best in both responses, there is no trade-off")
    return front.hypervolume(nadir) / whole
