"""Every case at every fidelity, beside its reference; what each costs; and what may be promised from both."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeAlias

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import STRETCH_MODES, TWIST_MODES, Fidelity, Measured
from mbpam_ros.plant.planner import AIR, REFERENCE_PNEUMATICS
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.boundary_value import boundary_value_error_pct
from mbpam_ros.study.fidelity.calibration import DrawErrors, draw_errors, draw_row, plain
from mbpam_ros.study.fidelity.cases import Case
from mbpam_ros.study.fidelity.costs import CostLine, Trust, cost_lines, timed
from mbpam_ros.study.fidelity.errors import Errors, errors, table_row
from mbpam_ros.study.fidelity.runs import TICK_S, Record, run, run_coarser_reference, run_reference
from mbpam_ros.study.jobs import ResultFile, as_they_end, run_jobs
from mbpam_ros.terminal import Progress

PNEUMATICS = ("ideal", "lag", "iso6358")
STEPS_S = (0.0005, 0.001, 0.002, 0.005, 0.01)
MODES = (2, 3, 4, 5)
STRAIN_MODES = ((0, STRETCH_MODES), (TWIST_MODES, STRETCH_MODES))
"""Modes of twist and stretch of a rod that stretches besides bending, and of one that does all."""
QUICK_CASES = ("free_bend", "lift")


def fidelities(
    steps_s: Sequence[float] = STEPS_S, modes: Sequence[int] = MODES, pneumatics: Sequence[str] = PNEUMATICS
) -> tuple[Fidelity, ...]:
    """Return all fidelities of a grid; ``static``, exact at any step, is there once."""
    muscles = [("static", 1, TICK_S)]
    muscles += [("arc", 1, step) for step in steps_s]
    muscles += [("rod", count, step) for count in modes for step in steps_s]
    return tuple(Fidelity(*muscle, model) for muscle in muscles for model in pneumatics)


def with_strains(grid: Sequence[Fidelity]) -> tuple[Fidelity, ...]:
    """Return a grid with its rods once more for each of :data:`STRAIN_MODES`.

    The simpler pneumatic models are left to muscles that only bend: what they are off by is the air's.
    """
    rods = [each for each in grid if each.tier == "rod" and each.pneumatics == REFERENCE_PNEUMATICS]
    return tuple(grid) + tuple(
        dataclasses.replace(each, twist_modes=twist, stretch_modes=stretch)
        for twist, stretch in STRAIN_MODES
        for each in rods
    )


def quick_fidelities() -> tuple[Fidelity, ...]:
    """Return a few fidelities that differ much."""
    return fidelities(steps_s=(0.002, 0.005), modes=(2, 3), pneumatics=("lag", "iso6358"))


def can_run(case: Case, fidelity: Fidelity) -> bool:
    """Whether the tier can compute the case."""
    return fidelity.tier != "static" or case.scene.object is None


@dataclass(frozen=True)
class Trade:
    """What the trade measures.

    Args:
        cases: what is run.
        grid: the fidelities; those that cannot run a case are left out for it.
        coarse: whether the reference is the coarser one, whose own convergence is not looked at.
        scenes: how many are drawn at random to make promises from.
    """

    cases: tuple[Case, ...]
    grid: tuple[Fidelity, ...]
    coarse: bool = False
    scenes: int = 0

    @property
    def has_strains(self) -> bool:
        """Whether there are rods that do more than bend."""
        return any(each.strains != ("bend",) for each in self.grid)

    def fidelities(self, case: Case) -> list[Fidelity]:
        """Return those that can run a case."""
        return [fidelity for fidelity in self.grid if can_run(case, fidelity)]

    def runs(self) -> dict[str, Run]:
        """Return each run by name, case by case."""
        return {_name(case, each): Run(case, each) for case in self.cases for each in self.fidelities(case)}

    def representatives(self) -> dict[str, Case]:
        """Return the case that stands for the costs of each kind of scene, the first of its kind."""
        found: dict[str, Case] = {}
        for case in self.cases:
            found.setdefault(kind_of_case(case), case)
        return found


def kind_of_case(case: Case) -> str:
    """Return which of :data:`~mbpam_ros.plant.planner.KINDS` a case is of."""
    return AIR if case.scene.object is None else case.scene.object.shape


class Run(NamedTuple):
    """One run."""

    case: Case
    fidelity: Fidelity


Reference: TypeAlias = tuple[Record, dict[str, float]]
"""A converged run, and how far it is converged."""


def reference_of(case: Case, strains: tuple[str, ...], gripper: Gripper, coarse: bool) -> Reference:
    """Return the reference of a case for these strains with its check, which is empty for the coarser one.

    Raises:
        BoundaryValueError: the problem that it is checked against was not solved.
    """
    if coarse:
        return run_coarser_reference(case, strains, gripper), {}
    reference = run_reference(case, strains, gripper)
    return reference, reference_check(case, strains, reference, gripper)


def reference_check(case: Case, strains: tuple[str, ...], reference: Record, gripper: Gripper) -> dict[str, float]:
    """Return how far the reference of a case is converged, and how far it is off the boundary-value problem [%].

    That problem is solved for muscles that only bend.

    Raises:
        BoundaryValueError: that problem was not solved.
    """
    off = errors(case, run_coarser_reference(case, strains, gripper), reference, gripper.geometry.active_length_m)
    check = {"static_pct": off.static_pct, "transient_pct": off.transient_pct}
    if off.contact_force_pct is not None:
        check["contact_force_pct"] = off.contact_force_pct
    elif strains == ("bend",):
        check["boundary_value_pct"] = boundary_value_error_pct(case, reference, gripper)
    return check


def run_row(name: str, case: Case, fidelity: Fidelity, reference: Reference, gripper: Gripper) -> dict[str, object]:
    """Return the errors of one run under its name, with the check of the reference.

    Raises:
        PlantDivergedError: the step is too large for the tier in this case.
    """
    record, (exact, check) = run(case, fidelity, gripper), reference
    off = errors(case, record, exact, gripper.geometry.active_length_m)
    return {"job": name, **dataclasses.asdict(off), "check": check}


def measure(
    trade: Trade, gripper: Gripper, results: ResultFile, executor: Executor, progress: Progress
) -> dict[str, dict]:
    """Run all cases and all scenes that are drawn; return the rows of the jobs, of which those that diverged have none.

    ``results`` is kept up to date; runs that it holds are not run again.

    Raises:
        BoundaryValueError: see :func:`reference_check`.
        ResultFileError: the file of the results cannot be written.
    """
    runs = trade.runs()
    unfinished = {
        _reference_name(each): (each.case, each.fidelity.strains, gripper, trade.coarse)
        for name, each in runs.items()
        if name not in results.rows
    }
    for name in unfinished:
        progress.say(f"{name}: reference")
    references: dict[str, Reference] = {}
    for name, future in as_they_end(unfinished, reference_of, executor, progress):
        references[name] = future.result()
        figures = [f"{what.removesuffix('_pct')} {value:.2g} %" for what, value in references[name][1].items()]
        if figures:
            progress.say(f"{name}: reference converged to {', '.join(figures)}")
    bending = [each for each in trade.grid if each.strains == ("bend",)]
    jobs: dict[str, tuple] = {  # the longest first
        name: (draw_row, name, number, bending, gripper) for number, name in enumerate(_draw_names(trade))
    }
    for name, each in runs.items():
        jobs[name] = run_row, name, *each, references.get(_reference_name(each)), gripper
    failures = run_jobs(jobs, _row_of, results, executor, progress, _text, failing=(PlantDivergedError,))
    results.write([*jobs, _COSTS], failures=failures)
    return results.rows


def _row_of(task: Callable[..., dict[str, object]], *arguments: object) -> dict[str, object]:
    return task(*arguments)


def _draw_names(trade: Trade) -> list[str]:
    return [f"drawn scene {number}" for number in range(trade.scenes)]


def drawn(trade: Trade, rows: Mapping[str, dict]) -> list[DrawErrors]:
    """Return the errors of the drawn scenes from the rows of the jobs."""
    return [draw_errors(rows[name]) for name in _draw_names(trade) if name in rows]


Cost: TypeAlias = Callable[[str, Fidelity], float]
"""Of a fidelity in a kind of scene [ms per simulated s]."""


def measured_costs(trade: Trade, gripper: Gripper, results: ResultFile, progress: Progress) -> tuple[Cost, Trust]:
    """Time the grid in this process, alone, on one case of each kind of scene; return the cost model and its worth.

    What ``results`` holds is not timed again.

    Raises:
        ResultFileError: the file of the results cannot be written.
    """
    if _COSTS not in results.rows:
        results.rows[_COSTS] = _timed_row(trade, gripper, progress)
        results.write(list(results.rows))
    row = results.rows[_COSTS]
    times = {(each["kind"], Fidelity(**each["fidelity"])): each["cpu_ms_per_s"] for each in row["times"]}
    return _cost_model(trade, times), Trust(row["spread"], row["cpu_share"])


_COSTS = "costs"


def _timed_row(trade: Trade, gripper: Gripper, progress: Progress) -> dict:
    runs: dict[tuple[str, Fidelity], Callable[[], float]] = {}
    for kind, case in trade.representatives().items():
        for each in _timed_fidelities(trade.fidelities(case)):
            runs[kind, each] = partial(_cpu_ms_per_s, case, each, gripper)
    progress.say(f"costs: {len(runs)} timings in this process, nothing beside them")
    # The first run of each compiles, and shows which diverge.
    runs = {key: each for key, each in runs.items() if math.isfinite(each())}
    timings, trust = timed(runs, progress.say)
    return {
        "job": _COSTS,
        "spread": trust.spread,
        "cpu_share": trust.cpu_share,
        "times": [
            {"kind": kind, "fidelity": plain(each), **dataclasses.asdict(timing)}
            for (kind, each), timing in timings.items()
        ],
    }


def _timed_fidelities(grid: Sequence[Fidelity]) -> list[Fidelity]:
    """Return what is timed of a grid: three steps of each number of modes, and each simpler pneumatic model once."""
    steps_s = sorted({each.sub_step_s for each in grid})
    thirds = {steps_s[0], steps_s[len(steps_s) // 2], steps_s[-1]}
    exact = {dataclasses.replace(each, pneumatics=REFERENCE_PNEUMATICS) for each in grid}
    lines = {each for each in exact if each.sub_step_s in thirds or each.tier == "static"}
    cheap = _cheapest(exact)
    models = {each.pneumatics for each in grid} - {REFERENCE_PNEUMATICS}
    return [
        *sorted(lines | {cheap}),
        *(dataclasses.replace(cheap, pneumatics=model) for model in sorted(map(str, models))),
    ]


def _cheapest(grid: Iterable[Fidelity]) -> Fidelity:
    """Return the fidelity at which pneumatic models are set beside each other."""
    rods = [each for each in grid if each.tier == "rod" and each.strains == ("bend",)]
    return min(rods or grid, key=lambda each: (each.modes, -each.sub_step_s))


def _cpu_ms_per_s(case: Case, fidelity: Fidelity, gripper: Gripper) -> float:
    try:
        return run(case, fidelity, gripper).cpu_ms_per_s
    except PlantDivergedError:
        return math.nan


def _cost_model(trade: Trade, times: Mapping[tuple[str, Fidelity], float]) -> Cost:
    lines: dict[tuple[str, str, int, int], dict[int, CostLine]] = {}
    added: dict[tuple[str, str], float] = {}
    for kind in trade.representatives():
        own = {each: value for (of, each), value in times.items() if of == kind and math.isfinite(value)}
        exact = {each: value for each, value in own.items() if each.pneumatics == REFERENCE_PNEUMATICS}
        by_muscle: dict[tuple[str, int, int], dict[int, dict[float, float]]] = {}
        for each, value in exact.items():
            muscle = each.tier, each.twist_modes, each.stretch_modes
            by_muscle.setdefault(muscle, {}).setdefault(each.modes, {})[each.sub_step_s] = value
        for muscle, measured in by_muscle.items():
            lines[(kind, *muscle)] = cost_lines(measured)
        cheap = _cheapest(exact)
        for each, value in own.items():
            if each.pneumatics != REFERENCE_PNEUMATICS:
                added[kind, str(each.pneumatics)] = value - exact[cheap]

    def cost(kind: str, each: Fidelity) -> float:
        line = lines[kind, each.tier, each.twist_modes, each.stretch_modes][each.modes]
        least = 0.1 * line.cpu_ms_per_s(each.sub_step_s)
        return max(line.cpu_ms_per_s(each.sub_step_s) + added.get((kind, str(each.pneumatics)), 0.0), least)

    return cost


def table_rows(
    trade: Trade, rows: Mapping[str, dict], cost: Cost
) -> tuple[list[Measured], dict[str, dict[str, float]]]:
    """Return the rows of the table and the checks of the references; a fidelity that diverges has no row."""
    found: list[Measured] = []
    checks: dict[str, dict[str, float]] = {case.name: {} for case in trade.cases}
    for name, (case, fidelity) in trade.runs().items():
        if name in rows:
            found.append(table_row(case.name, fidelity, _errors(rows[name]), cost(kind_of_case(case), fidelity)))
            for what, value in rows[name]["check"].items():
                checks[case.name][what] = max(value, checks[case.name].get(what, 0.0))
    return found, {name: check for name, check in checks.items() if check}


def row_values(row: Measured) -> dict[str, str | float]:
    """Return a row as JSON has it: to four figures, and without a contact force where nothing touches."""
    return {
        name: float(f"{value:.4g}") if isinstance(value, float) else value
        for name, value in dataclasses.asdict(row).items()
        if value is not None and not (name in ("twist_modes", "stretch_modes") and value == 0)
    }


def _name(case: Case, fidelity: Fidelity) -> str:
    step_ms, besides = 1e3 * fidelity.sub_step_s, "".join(f" and {strain}" for strain in fidelity.strains[1:])
    return f"{case.name}: {fidelity.tier} {fidelity.modes}{besides}, {step_ms:g} ms, {fidelity.pneumatics}"


def _reference_name(each: Run) -> str:
    return ", ".join((each.case.name, *each.fidelity.strains[1:]))


def _text(row: dict) -> str:
    if "strains" not in row:
        return f"{row['job']}: {_errors(row)}"
    strains = ", ".join(row["strains"])
    return f"{row['job']}: {row['kind']}, {strains}, decided to {row['undecided_pct']:.2g} %"


def _errors(row: dict) -> Errors:
    return Errors(**{field.name: row[field.name] for field in dataclasses.fields(Errors)})
