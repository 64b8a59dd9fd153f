"""The cheapest setting that is accurate enough, and fair timing of two rivals."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.peers.problem import Array, TipErrors, sample_tips, tip_errors

TIMED_S = 0.6
"""Simulated time from the start that costs are of: that of the motion. What follows it is mostly rest."""

WINDOWS_S = (0.3, 0.6, 3.0)
"""Where it is shown how the ratio depends on that time."""

SEARCHED_RUNS = 3
"""Of these the least counts in the search: a run of ours takes a tenth of a millisecond, and what disturbs it more."""

_TIMED_TOGETHER_S = 3.0
"""Simulated time of the starts that are timed as one."""


class AccuracyError(MbpamError, RuntimeError):
    """No setting that was tried is accurate enough."""


class Restartable(Protocol):
    """What can be started again."""

    def reset(self) -> None:
        """Go back to the start."""


class Moving(Restartable, Protocol):
    """What goes on in time."""

    def advance(self, seconds: float) -> None:
        """Go on."""


class Simulation(Moving, Protocol):
    """A simulation of four fingers that can be started again."""

    def tips_m(self) -> Array:
        """Return the tips now, shape (4, 3)."""


@dataclass(frozen=True)
class Tried:
    """A setting, its errors, its cost, and the simulation itself."""

    setting: dict[str, Any]
    errors: TipErrors
    cpu_ms_per_s: float
    simulation: Moving

    def as_json(self) -> dict[str, object]:
        """Return what JSON can hold of it."""
        return {
            **self.setting,
            "static_error_pct": self.errors.static_pct,
            "transient_error_pct": self.errors.transient_pct,
            "searched_cpu_ms_per_s": self.cpu_ms_per_s,
        }


def cpu_ms_per_s(
    simulation: Restartable, advance: Callable[[float], None], seconds: float = TIMED_S, starts: int = 1
) -> float:
    """Return the CPU time [ms] per simulated second, from the start on, over several starts."""
    spent = 0.0
    for _ in range(starts):
        simulation.reset()
        start = time.process_time()
        advance(seconds)
        spent += time.process_time() - start
    return 1e3 * spent / (seconds * starts)


def cpu_ms_per_s_of_starts(
    simulation: Restartable, advance: Callable[[float], None], seconds: float = TIMED_S
) -> float:
    """Return it over as many starts as make three seconds: one of ours takes 0.1 ms, and what disturbs it as much."""
    return cpu_ms_per_s(simulation, advance, seconds, max(1, round(_TIMED_TOGETHER_S / seconds)))


def try_settings(
    build: Callable[..., Simulation], settings: Iterable[dict[str, object]], reference_m: Array, length_m: float
) -> list[Tried]:
    """Run every setting: ``build(**setting)`` against the reference tips, and its cost."""
    tried = []
    for setting in settings:
        simulation = build(**setting)
        errors = tip_errors(sample_tips(simulation.advance, simulation.tips_m), reference_m, length_m)
        cost = min(cpu_ms_per_s(simulation, simulation.advance) for _ in range(SEARCHED_RUNS))
        tried.append(Tried(setting, errors, cost, simulation))
    return tried


def cheapest(tried: Iterable[Tried], static_pct: float, transient_pct: float) -> Tried:
    """Return the cheapest of those within both errors.

    Raises:
        AccuracyError: there is none.
    """
    good = [one for one in tried if one.errors.within(static_pct, transient_pct)]
    if not good:
        raise AccuracyError(
            f"no setting reaches a static error of {static_pct} % and a transient one of {transient_pct} %"
        )
    return min(good, key=lambda one: one.cpu_ms_per_s)


def compare(ours: Callable[[], float], peer: Callable[[], float], runs: int) -> dict[str, float | list[float]]:
    """Time the two in turn; return the median cost of each and the median of the ratios peer / ours."""
    pairs = [(ours(), peer()) for _ in range(runs + 1)][1:]  # the first run warms up
    ratios = [other / own for own, other in pairs]
    return {
        "ours_cpu_ms_per_s": statistics.median(own for own, _ in pairs),
        "peer_cpu_ms_per_s": statistics.median(other for _, other in pairs),
        "ratio": statistics.median(ratios),
        "ratios": ratios,
    }
