"""Optimal Latin hypercube designs over the muscle's variables (paper, section 4.1), and figures that judge a design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist
from scipy.stats import qmc

from mbpam_ros.errors import MbpamError

RANGES = {"a_mm": (1.5, 3.5), "b_mm": (1.0, 3.0), "c_mm": (1.0, 3.0), "n": (6.0, 14.0)}
"""The paper's four design variables with their ranges (section 3.2); n is a whole number of waves."""


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
    return SpaceFilling(float(qmc.discrepancy(unit_points, method="CD")), float(pdist(unit_points).min()))


def optimal_latin_hypercube(count: int, variables: int, seed: int, restarts: int = 8) -> NDArray[np.float64]:
    """Return ``count`` points in the unit cube, one in each of ``count`` equal levels 0 ... 1 of every variable.

    Latin hypercubes whose centred discrepancy SciPy has lowered by random exchanges within columns; of ``restarts``
    such designs the one whose two closest points are furthest apart. The levels include the ends of the range, as those
    of the paper's 21 points do, so that the samples span the domain in which their metamodel will be asked.

    Args:
        count: at least 2.
        variables: at least 2.
        seed: equal seeds give equal bits.
        restarts: independent designs to choose from.

    Raises:
        SamplingError: too few points, variables or restarts.
    """
    if count < 2 or variables < 2 or restarts < 1:
        raise SamplingError(
            "an optimal design needs at least 2 points, 2 variables and 1 restart, "
            f"found {count}, {variables} and {restarts}"
        )
    generator = np.random.default_rng(seed)
    candidates = []
    for _ in range(restarts):
        # SciPy before 1.15, which ROS 2 Jazzy's system has, knows this argument only as seed.
        sampler = qmc.LatinHypercube(variables, scramble=False, optimization="random-cd", seed=generator)
        # Cell centres (k + 1/2) / count; stretched to k / (count - 1).
        level = np.rint(sampler.random(count) * count - 0.5)
        candidates.append(level / (count - 1))
    return max(candidates, key=lambda points: space_filling(points).smallest_distance)


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
