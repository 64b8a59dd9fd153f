"""Every case at every fidelity, beside its reference."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import STRETCH_MODES, TWIST_MODES, Fidelity, Measured
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.boundary_value import boundary_value_error_pct
from mbpam_ros.study.fidelity.cases import Case
from mbpam_ros.study.fidelity.errors import Errors, errors
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
    """Return a grid with its rods once more for each of :data:`STRAIN_MODES`."""
    rods = [each for each in grid if each.tier == "rod"]
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
        rounds: through a case's grid. CPU times are their medians: what else the machine does then falls upon all
            fidelities alike.
        coarse: whether the reference is the coarser one, whose own convergence is not looked at.
    """

    cases: tuple[Case, ...]
    grid: tuple[Fidelity, ...]
    rounds: int
    coarse: bool = False

    def fidelities(self, case: Case) -> list[Fidelity]:
        """Return those that can run a case."""
        return [fidelity for fidelity in self.grid if can_run(case, fidelity)]

    def runs(self) -> dict[str, Run]:
        """Return each run by name, round by round through each case."""
        return {
            f"{_name(case, each)}, round {turn}": Run(case, each)
            for case in self.cases
            for turn in range(1, self.rounds + 1)
            for each in self.fidelities(case)
        }


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


def run_row(
    name: str, case: Case, fidelity: Fidelity, finest: Fidelity, reference: Reference, gripper: Gripper
) -> dict[str, object]:
    """Return the errors and the CPU time of one run under its name, with the check of the reference.

    Args:
        finest: is run once before in each process, so that what is not yet compiled is.

    Raises:
        PlantDivergedError: the step is too large for the tier in this case.
    """
    if case.name not in _COMPILED_CASES:
        run(case, finest, gripper)
        _COMPILED_CASES.add(case.name)
    record, (exact, check) = run(case, fidelity, gripper), reference
    off = errors(case, record, exact, gripper.geometry.active_length_m)
    return {"job": name, **dataclasses.asdict(off), "cpu_ms_per_s": record.cpu_ms_per_s, "check": check}


_COMPILED_CASES: set[str] = set()
"""By this process."""


def measure(
    trade: Trade, gripper: Gripper, results: ResultFile, executor: Executor, progress: Progress
) -> tuple[list[Measured], dict[str, dict[str, float]]]:
    """Return the rows of the table and the checks of the references; a fidelity that diverges has no row.

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
    jobs = {
        name: (name, *each, trade.fidelities(each.case)[-1], references.get(_reference_name(each)), gripper)
        for name, each in runs.items()
    }
    failures = run_jobs(jobs, run_row, results, executor, progress, _text, failing=(PlantDivergedError,))
    results.write(list(jobs), failures=failures)
    rows: list[Measured] = []
    checks: dict[str, dict[str, float]] = {case.name: {} for case in trade.cases}
    for case in trade.cases:
        for fidelity in trade.fidelities(case):
            found = [
                results.rows[name]
                for name, each in runs.items()
                if each.case is case and each.fidelity == fidelity and name in results.rows
            ]
            if found:
                rows.append(_row(case, fidelity, found))
                for what, value in found[0]["check"].items():
                    checks[case.name][what] = max(value, checks[case.name].get(what, 0.0))
    return rows, {name: check for name, check in checks.items() if check}


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
    return f"{row['job']}: {_errors(row)}, {row['cpu_ms_per_s']:.0f} ms/s"


def _errors(row: dict) -> Errors:
    return Errors(**{field.name: row[field.name] for field in dataclasses.fields(Errors)})


def _row(case: Case, fidelity: Fidelity, runs: Sequence[dict]) -> Measured:
    off = _errors(runs[-1])
    return Measured(
        scene=case.name,
        tier=fidelity.tier,
        modes=fidelity.modes,
        step_s=fidelity.sub_step_s,
        pneumatics=str(fidelity.pneumatics),
        static_error_pct=off.static_pct,
        transient_error_pct=off.transient_pct,
        pressure_error_pct=off.pressure_pct,
        cpu_ms_per_s=statistics.median(each["cpu_ms_per_s"] for each in runs),
        contact_force_error_pct=off.contact_force_pct,
        twist_modes=fidelity.twist_modes,
        stretch_modes=fidelity.stretch_modes,
    )
