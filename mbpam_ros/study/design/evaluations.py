"""Everything that an optimiser asked of the responses, kept, so that none of its finds is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import DesignDomain
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.design.pareto import Front, Objectives


class OptimisationError(MbpamError, RuntimeError):
    """The optimiser cannot run or had to stop; the message says why."""


class Evaluations:
    """Responses over the unit square of a domain, with a record of all designs and values.

    Args:
        objectives: to be maximised.
        domain: of the designs.
        max_failed: evaluations that may return something that is not finite (paper, Table 4: "max failed runs").
    """

    def __init__(self, objectives: Objectives, domain: DesignDomain, max_failed: int = 5) -> None:
        self._objectives, self._domain, self._max_failed = objectives, domain, max_failed
        self._designs: list[NDArray[np.float64]] = []
        self._values: list[NDArray[np.float64]] = []
        self._failed = 0

    def __call__(self, unit_points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the responses at points of the unit square, shape (n, 2) each; -inf for both where one failed.

        Raises:
            OptimisationError: more evaluations failed than may.
        """
        low, high = self._domain.bounds_mm
        design = np.clip(low + unit_points * (high - low), low, high)
        values = np.array(self._objectives(design), dtype=float)
        failed = ~np.isfinite(values).all(axis=1)
        values[failed] = -np.inf
        self._designs.append(design)
        self._values.append(values)
        self._failed += int(failed.sum())
        if self._failed > self._max_failed:
            where = design[np.argmax(failed)]
            raise OptimisationError(
                f"{self._failed} evaluations failed, {self._max_failed} may: "
                f"no finite response at a = {where[0]:g}, b = {where[1]:g} mm"
            )
        return values

    @property
    def count(self) -> int:
        """How many designs were evaluated."""
        return sum(len(rows) for rows in self._designs)

    def front(self) -> Front:
        """Return the front of everything evaluated so far."""
        return Front.of(np.concatenate(self._designs), np.concatenate(self._values))
