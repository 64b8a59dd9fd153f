"""Optimal Latin hypercube designs over the muscle's variables (paper, section 4.1), and figures that judge a design."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.executors import ThisProcess
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import versions
from mbpam_ros.terminal import Progress

RANGES = {"a_mm": (1.5, 3.5), "b_mm": (1.0, 3.0), "c_mm": (1.0, 3.0), "n": (6.0, 14.0)}
"""The paper's four design variables with their ranges (section 3.2); n is a whole number of waves."""

S_PER_POINT = 0.025
"""CPU of a restart over its points, a guess."""


class SamplingError(MbpamError, ValueError):
    """No such design of experiments exists; the message says what to change."""


@dataclass(frozen=True)
class SpaceFilling:
    """How evenly points fill the unit cube of their variables.

    Args:
        discrepancy: centred L2 discrepancy; small is even.
        smallest_distance: between any two points; large is even.
    """

    discrepancy: float
    smallest_distance: float


def space_filling(unit_points: NDArray[np.float64]) -> SpaceFilling:
    """Judge points in the unit cube, shape (n, variables), n at least 2.

    Raises:
        SamplingError: fewer than two points, or points outside the unit cube.
    """
    if len(unit_points) < 2:
        raise SamplingError("at least two points are needed to judge how they fill their space")
    if not np.all((unit_points >= 0.0) & (unit_points <= 1.0)):
        raise SamplingError("points outside the ranges of their variables")
    from scipy.stats import qmc  # all of its statistics, which those do without who ask for ranges

    return SpaceFilling(float(qmc.discrepancy(unit_points, method="CD")), float(pdist(unit_points).min()))


def optimal_latin_hypercube(
    count: int,
    variables: int,
    seed: int,
    restarts: int = 8,
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept_in: Path | None = None,
) -> NDArray[np.float64]:
    """Return ``count`` points in the unit cube, one in each of ``count`` equal levels 0 ... 1 of every variable.

    Latin hypercubes whose centred discrepancy SciPy has lowered by random exchanges within columns; of ``restarts``
    such designs the one whose two closest points are furthest apart. The levels include the ends of the range, as those
    of the paper's 21 points do, so that the samples span the domain in which their metamodel will be asked.

    Args:
        count: at least 2.
        variables: at least 2.
        seed: equal seeds give equal bits, wherever the restarts run.
        restarts: independent designs to choose from, each of a random generator of its own.
        executor: where they run; none for this process.
        progress: told of each; none for silence.
        kept_in: file of those that are finished, which are not run again; none to keep nothing.

    Raises:
        SamplingError: too few points, variables or restarts.
        ResultFileError: ``kept_in`` cannot be written, or is no such file.
    """
    if count < 2 or variables < 2 or restarts < 1:
        raise SamplingError(
            "an optimal design needs at least 2 points, 2 variables and 1 restart, "
            f"found {count}, {variables} and {restarts}"
        )
    settings = {"versions": versions("numpy", "scipy"), "count": count, "variables": variables, "seed": seed}
    jobs = {f"restart {restart}": (count, variables, seed, restart) for restart in range(restarts)}
    kept = ResultFile(kept_in, settings, "restarts", _name_of)
    run_jobs(
        jobs,
        _restarted,
        kept,
        executor or ThisProcess(),
        progress or Progress(silent=True),
        _name_of,
        s_per_job=S_PER_POINT * count,
    )
    levels = [np.array(row["levels"], dtype=float) for row in kept.write(list(jobs))["restarts"]]
    return max((each / (count - 1) for each in levels), key=lambda points: space_filling(points).smallest_distance)


def _restarted(count: int, variables: int, seed: int, restart: int) -> dict:
    """Return one design as whole levels 0 ... count - 1, rows of points."""
    from scipy.stats import qmc

    # SciPy before 1.15, which ROS 2 Jazzy's system has, knows this argument only as seed.
    generator = np.random.default_rng((seed, restart))
    sampler = qmc.LatinHypercube(variables, scramble=False, optimization="random-cd", seed=generator)
    # Cell centres (k + 1/2) / count.
    levels = np.rint(sampler.random(count) * count - 0.5).astype(int)
    return {"restart": restart, "levels": levels.tolist()}


def _name_of(row: dict) -> str:
    return f"restart {row['restart']}"


def to_unit(points: NDArray[np.float64], names: tuple[str, ...]) -> NDArray[np.float64]:
    """Scale columns ``names`` of :data:`RANGES` to the unit cube, shape (n, variables)."""
    low, high = np.array([RANGES[name] for name in names]).T
    return (points - low) / (high - low)


def from_unit(unit_points: NDArray[np.float64], names: tuple[str, ...]) -> NDArray[np.float64]:
    """Scale the unit cube to columns ``names`` of :data:`RANGES`; lengths to 1e-3 mm, the number of waves whole."""
    low, high = np.array([RANGES[name] for name in names]).T
    points = low + unit_points * (high - low)
    decimals = [0 if name == "n" else 3 for name in names]
    return np.column_stack([np.round(column, digits) for column, digits in zip(points.T, decimals, strict=True)])
