"""Multi-objective particle swarm optimisation in the setting of the paper's Table 4.

Particles fly over the unit square of the design's domain,

    v <- inertia v + particle_increment r1 (own best - x) + global_increment r2 (leader - x),    x <- x + v,

r1 and r2 uniform in [0, 1] for each particle and variable, each component of v limited. What the paper's table leaves
open is as in MOPSO-CD (Raquel and Naval 2005), without its mutation: an archive of the non-dominated designs found so
far, thinned by crowding distance; leaders drawn from its least crowded tenth; at a bound a particle stops and its
velocity turns round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.design.evaluations import Evaluations
from mbpam_ros.study.design.pareto import non_dominated


@dataclass(frozen=True)
class SwarmSettings:
    """Paper, Table 4. ``max_velocity`` is a share of each variable's range per iteration.

    Raises:
        ValueError: a number that no swarm can fly with.
    """

    iterations: int = 100
    particles: int = 100
    inertia: float = 0.8
    global_increment: float = 0.5
    particle_increment: float = 0.9
    max_velocity: float = 0.1
    archive_size: int = 100

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.particles < 1 or self.archive_size < 2:
            raise ValueError("a swarm needs at least 1 iteration, 1 particle and an archive of 2")
        if not (0.0 <= self.inertia and 0.0 < self.max_velocity <= 1.0):
            raise ValueError("inertia must not be negative, and the largest velocity lies between 0 and 1")


def mopso(evaluations: Evaluations, seed: int, settings: SwarmSettings | None = None) -> None:
    """Maximise both responses; the result is ``evaluations.front()``. Equal seeds give equal bits.

    Raises:
        OptimisationError: too many evaluations failed.
    """
    settings = settings or SwarmSettings()
    generator = np.random.default_rng(seed)
    shape = (settings.particles, 2)
    position = generator.uniform(size=shape)
    velocity = generator.uniform(-settings.max_velocity, settings.max_velocity, size=shape)
    value = evaluations(position)
    best_position, best_value = position.copy(), value.copy()
    archive_position, archive_value = _thinned(position, value, settings.archive_size)
    for _ in range(settings.iterations):
        leader = archive_position[_leaders(archive_value, settings.particles, generator)]
        pull_best, pull_leader = generator.uniform(size=(2, *shape))
        velocity = (
            settings.inertia * velocity
            + settings.particle_increment * pull_best * (best_position - position)
            + settings.global_increment * pull_leader * (leader - position)
        )
        velocity = np.clip(velocity, -settings.max_velocity, settings.max_velocity)
        flown = position + velocity
        position = np.clip(flown, 0.0, 1.0)
        velocity = np.where(position == flown, velocity, -velocity)
        value = evaluations(position)
        better = _takes_over(value, best_value, generator)
        best_position[better], best_value[better] = position[better], value[better]
        archive_position, archive_value = _thinned(
            np.concatenate([archive_position, position]), np.concatenate([archive_value, value]), settings.archive_size
        )


def crowding_distance(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each member of a front, shape (n, 2), how far apart its neighbours are (Deb 2002); infinite at ends.

    Each response counts relative to its range over the front.
    """
    distance = np.zeros(len(values))
    for column in values.T:
        order = np.argsort(column, kind="stable")
        distance[order[[0, -1]]] = np.inf
        spread = column[order[-1]] - column[order[0]]
        if spread > 0.0:
            distance[order[1:-1]] += (column[order[2:]] - column[order[:-2]]) / spread
    return distance


def _leaders(values: NDArray[np.float64], count: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Draw a leader for each particle from the least crowded tenth of the archive; both ends are always in it."""
    least_crowded_first = np.argsort(-crowding_distance(values), kind="stable")
    candidates = min(len(values), max(2, len(values) // 10))
    return least_crowded_first[generator.integers(candidates, size=count)]


def _takes_over(
    value: NDArray[np.float64], best: NDArray[np.float64], generator: np.random.Generator
) -> NDArray[np.bool_]:
    """Which particles have a new own best: a dominating one always, an incomparable one by the toss of a coin."""
    worse_nowhere, better_somewhere = np.all(value >= best, axis=1), np.any(value > best, axis=1)
    coin = generator.uniform(size=len(value)) < 0.5
    return better_somewhere & (worse_nowhere | coin)


def _thinned(
    position: NDArray[np.float64], value: NDArray[np.float64], size: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the non-dominated of these, without the most crowded ones if they are more than ``size``."""
    kept = non_dominated(value)
    while len(kept) > size:
        kept = np.delete(kept, np.argmin(crowding_distance(value[kept])))
    return position[kept], value[kept]
