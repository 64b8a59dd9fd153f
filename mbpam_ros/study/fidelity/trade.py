"""Every case at every fidelity, beside its reference."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity, Measured
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.cases import Case
from mbpam_ros.study.fidelity.errors import Errors, errors
from mbpam_ros.study.fidelity.runs import TICK_S, Record, run

PNEUMATICS = ("ideal", "lag", "iso6358")
STEPS_S = (0.0005, 0.001, 0.002, 0.005, 0.01)
MODES = (2, 3, 4, 5)
QUICK_CASES = ("free_bend", "lift")


def fidelities(
    steps_s: Sequence[float] = STEPS_S, modes: Sequence[int] = MODES, pneumatics: Sequence[str] = PNEUMATICS
) -> tuple[Fidelity, ...]:
    """Return all fidelities of a grid; ``static``, exact at any step, is there once."""
    muscles = [("static", 1, TICK_S)]
    muscles += [("arc", 1, step) for step in steps_s]
    muscles += [("rod", count, step) for count in modes for step in steps_s]
    return tuple(Fidelity(*muscle, model) for muscle in muscles for model in pneumatics)


def quick_fidelities() -> tuple[Fidelity, ...]:
    """Return a few fidelities that differ much."""
    return fidelities(steps_s=(0.002, 0.005), modes=(2, 3), pneumatics=("lag", "iso6358"))


def can_run(case: Case, fidelity: Fidelity) -> bool:
    """Whether the tier can compute the case."""
    return fidelity.tier != "static" or case.scene.object is None


def measure(
    case: Case,
    grid: Sequence[Fidelity],
    reference: Record,
    gripper: Gripper,
    repeats: int,
    ended: Callable[[str], None],
) -> list[Measured]:
    """Return the rows of a case; a fidelity that diverges has none, and ``ended`` is told so.

    CPU times are medians of ``repeats`` rounds through the whole grid: what else the machine does in the meantime then
    falls upon all of them alike.

    Args:
        ended: called with a line of text after each run.
    """
    run(case, grid[-1], gripper)  # compiles what is not yet
    off: dict[Fidelity, Errors] = {}
    costs: dict[Fidelity, list[float]] = {fidelity: [] for fidelity in grid}
    for fidelity in (*grid,) * repeats:
        name = f"{case.name}: {fidelity.tier} {fidelity.modes}, {1e3 * fidelity.step_s:g} ms, {fidelity.pneumatics}"
        try:
            record = run(case, fidelity, gripper)
        except PlantDivergedError as error:
            ended(f"{name}: {error}")
            continue
        costs[fidelity].append(record.cpu_ms_per_s)
        off[fidelity] = errors(case, record, reference, gripper.geometry.active_length_m)
        ended(f"{name}: {off[fidelity]}, {record.cpu_ms_per_s:.0f} ms/s")
    return [_row(case, fidelity, found, costs[fidelity]) for fidelity, found in off.items()]


def _row(case: Case, fidelity: Fidelity, off: Errors, costs_ms_per_s: Sequence[float]) -> Measured:
    return Measured(
        scene=case.name,
        tier=fidelity.tier,
        modes=fidelity.modes,
        step_s=fidelity.step_s,
        pneumatics=fidelity.pneumatics,
        static_error_pct=off.static_pct,
        transient_error_pct=off.transient_pct,
        pressure_error_pct=off.pressure_pct,
        cpu_ms_per_s=statistics.median(costs_ms_per_s),
        contact_force_error_pct=off.contact_force_pct,
    )
