"""NSGA-II (Deb 2002) by pymoo, the second opinion on the front. Optional extra ``study``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.design.evaluations import Evaluations, OptimisationError

POPULATION = 100
GENERATIONS = 101
"""As many evaluations as the swarm of Table 4: 100 particles at the start and after each of 100 iterations."""


def nsga2(evaluations: Evaluations, seed: int, population: int = POPULATION, generations: int = GENERATIONS) -> None:
    """Maximise both responses; the result is ``evaluations.front()``. Equal seeds give equal bits.

    Raises:
        OptimisationError: pymoo is not installed, or too many evaluations failed.
    """
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError as error:
        raise OptimisationError(
            "NSGA-II needs pymoo: pip install 'mbpam_ros[study]', or leave it out with --algorithms mopso"
        ) from error

    class UnitSquare(Problem):
        def __init__(self) -> None:
            super().__init__(n_var=2, n_obj=2, xl=0.0, xu=1.0)

        def _evaluate(self, x: NDArray[np.float64], out: dict, *args: object, **kwargs: object) -> None:
            out["F"] = -evaluations(x)

    minimize(UnitSquare(), NSGA2(pop_size=population), ("n_gen", generations), seed=seed, verbose=False)
