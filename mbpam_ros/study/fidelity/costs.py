"""CPU times that can be relied upon: repeated until they agree, made monotone by a cost model, and believed only alone.

What else a machine does only ever adds to a CPU time: caches are shared, and where the core's other half or the host of
a virtual machine is busy, the same work takes half as long again, for seconds, while CPU time over wall time stays at
one. So the least of repeated times is the cost. A fidelity is run again and again until three of its times lie within
5 % of the least, or it was run fifteen times. Where they still do not, or where processes of others had more than a
tenth of the core, the machine was too busy to be believed.

What a simulated second costs is then taken to be

    c = c_tick(m) + c_step(m) / h

with the step h and, of every tick and every step, a part that grows with the number of modes m: for each m the line
through them (least squares of the relative residuals, neither part negative), and both parts isotonic in m. So a
cost never falls with more modes or shorter steps, and its noise is that of many runs. The pneumatic models add a
constant of their own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression, nnls

FEWEST_RUNS, MOST_RUNS = 5, 15
LARGEST_SPREAD = 0.05
SMALLEST_CPU_SHARE = 0.9

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Timing:
    """Repeated runs of one thing.

    Args:
        cpu_ms_per_s: least of the CPU times.
        spread: how far the third least lies above it, over it.
        runs: how many.
    """

    cpu_ms_per_s: float
    spread: float
    runs: int


@dataclass(frozen=True)
class Trust:
    """Whether CPU times can be believed.

    Args:
        spread: largest of the timings'.
        cpu_share: CPU time over wall time, of all timings together.
    """

    spread: float
    cpu_share: float

    @property
    def believed(self) -> bool:
        """Whether the machine was left alone."""
        return self.spread <= LARGEST_SPREAD and self.cpu_share >= SMALLEST_CPU_SHARE

    def __str__(self) -> str:
        found = f"times repeat within {100.0 * self.spread:.0f} %, CPU {100.0 * self.cpu_share:.0f} % of wall time"
        return found if self.believed else f"the machine was too busy for its costs to be believed: {found}"


def timed(
    runs: Mapping[Key, Callable[[], float]], turn_ended: Callable[[str], object]
) -> tuple[dict[Key, Timing], Trust]:
    """Run everything in turn until each agrees with itself; return the timings and what they are worth.

    In turn, so that what else the machine does falls upon all alike.

    Args:
        runs: each returns its CPU time [ms per simulated s].
        turn_ended: is called after each turn with a line about it.
    """
    found: dict[Key, list[float]] = {key: [] for key in runs}
    begun_s, begun_cpu_s = time.monotonic(), time.process_time()
    left = list(runs)
    for turn in range(1, MOST_RUNS + 1):
        for key in left:
            found[key].append(runs[key]())
        left = [key for key in left if turn < FEWEST_RUNS or spread(found[key]) > LARGEST_SPREAD]
        turn_ended(f"costs, turn {turn}: {len(left)} of {len(runs)} do not repeat yet")
        if not left:
            break
    share = (time.process_time() - begun_cpu_s) / max(time.monotonic() - begun_s, 1e-9)
    timings = {key: Timing(min(each), spread(each), len(each)) for key, each in found.items()}
    return timings, Trust(max((each.spread for each in timings.values()), default=0.0), min(share, 1.0))


def spread(times: Sequence[float]) -> float:
    """Return how far the third least of some times lies above the least, over that; endless for fewer than three."""
    if len(times) < 3:
        return float("inf")
    least, _, third = sorted(times)[:3]
    return (third - least) / least


@dataclass(frozen=True)
class CostLine:
    """What a simulated second costs at one number of modes [ms]: ``tick + step_ms2 / h`` with the step h in ms."""

    tick_ms_per_s: float
    step_ms2_per_s: float

    def cpu_ms_per_s(self, step_s: float) -> float:
        """Return the cost with a step."""
        return self.tick_ms_per_s + self.step_ms2_per_s / (1e3 * step_s)


def cost_lines(measured: Mapping[int, Mapping[float, float]]) -> dict[int, CostLine]:
    """Return the cost model, by number of modes.

    Args:
        measured: CPU time [ms per simulated s] by step [s], by number of modes; two steps at least.
    """
    modes = sorted(measured)
    parts = np.array([_line(measured[count]) for count in modes])
    ticks, steps = (isotonic_regression(column).x for column in parts.T)
    return {count: CostLine(float(a), float(b)) for count, a, b in zip(modes, ticks, steps, strict=True)}


def _line(costs: Mapping[float, float]) -> NDArray[np.float64]:
    step_ms, cost = 1e3 * np.array(list(costs)), np.array(list(costs.values()))
    return np.asarray(nnls(np.column_stack([1.0 / cost, 1.0 / (step_ms * cost)]), np.ones(len(cost)))[0])
