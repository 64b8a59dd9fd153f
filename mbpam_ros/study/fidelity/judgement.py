"""The planner judged: random scenes, what it promises for each, what is found, and the cheapest way that holds.

For every drawn scene (:mod:`~mbpam_ros.study.fidelity.draws`, other seeds than those of the calibration) a plan is
asked for with the scene's tolerance on positions at rest and in motion, its strains and its largest pressure. The
tolerance is on the solution: errors of the model are left out, since a reference has the same strains. Then the scene
is run at every fidelity of the grid and set beside its converged reference, in the norms of the trade.

A scene is *undecided* where its reference, with one mode less and twice the step, moves by more than half the
tolerance: an object that slips out in one and not in the other, or tips and rolls off. Nothing can be found out of
such a scene to its tolerance; it is counted, told, and not judged. All others are, also those whose object is lost:
where one run loses it and the reference does not, that distance is the error.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Mapping, Sequence

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest, FidelityTable
from mbpam_ros.plant.planner import plan
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.calibration import LOST_PCT, kind_of, positions_only, with_strains_of
from mbpam_ros.study.fidelity.cases import Case
from mbpam_ros.study.fidelity.costs import LARGEST_SPREAD, spread
from mbpam_ros.study.fidelity.draws import drawn_scene
from mbpam_ros.study.fidelity.errors import errors
from mbpam_ros.study.fidelity.runs import TICK_S, Record, run, run_coarser_reference, run_reference
from mbpam_ros.study.fidelity.trade import can_run, fidelities
from mbpam_ros.terminal import table as text_table

SEED = 1001
KEPT_SHARE, LARGEST_CARE, LARGEST_COST = 0.95, 5.0, 1.3
"""What is to be reached: promises kept, promise over finding in the median, cost over the cheapest that holds."""

_NEXT_TO_CHEAPEST, _MOST_TIMED = 1.5, 5
_FEWEST_RUNS, _MOST_RUNS = 3, 9


def judged_row(name: str, seed: int, number: int, table: FidelityTable, gripper: Gripper) -> dict[str, object]:
    """Return what was promised for one drawn scene and what was found, as plain values, under a job's name.

    Raises:
        PlanError: nothing in the table fits the scene.
    """
    drawn = drawn_scene(seed, number, gripper)
    case, allowed_pct = drawn.case, drawn.tolerance_pct
    request = FidelityRequest(tolerance=positions_only(allowed_pct), strains=drawn.strains)
    solution = dataclasses.replace(table, model_errors=())
    made = plan(
        case.scene,
        gripper.geometry.length_m,
        solution,
        request,
        TICK_S,
        pressure_gauge_pa=drawn.pressure_gauge_pa,
    )
    plain = Fidelity.largest_jump_pct
    chosen = dataclasses.replace(made.fidelity, air_modes=None, largest_jump_pct=plain)  # as the table's rows are
    reference = run_reference(case, drawn.strains, gripper)
    undecided_pct = _off_pct(case, run_coarser_reference(case, drawn.strains, gripper), reference, gripper)
    tried = [each for each in with_strains_of(fidelities(), drawn.strains) if can_run(case, each)]
    if chosen not in tried:
        tried.append(chosen)
    found = {each: _tried(case, each, reference, gripper) for each in tried}
    holding = [each for each, (off_pct, _) in found.items() if off_pct <= allowed_pct]
    costs = _retimed(case, chosen, holding, {each: cost for each, (_, cost) in found.items()}, gripper)
    cheapest = min((each for each in costs if each in holding), key=lambda each: costs[each], default=None)
    return {
        "job": name,
        "kind": kind_of(case.name),
        "strains": list(drawn.strains),
        "scene": repr(case.scene),
        "pressure_kpa": 1e-3 * drawn.pressure_gauge_pa,
        "tolerance_pct": allowed_pct,
        "warnings": list(made.warnings),
        "chosen": _short(chosen),
        "promised_pct": max(made.expected.static_pct, made.expected.transient_pct),
        "promised": made.within_tolerance,
        "undecided_pct": undecided_pct,
        "found_pct": found[chosen][0],
        "cost_ms_per_s": costs[chosen],
        "cheapest": None if cheapest is None else _short(cheapest),
        "cheapest_ms_per_s": None if cheapest is None else costs[cheapest],
        "tried": {_short(each): off_pct for each, (off_pct, _) in found.items()},
    }


def _off_pct(case: Case, found: Record, reference: Record, gripper: Gripper) -> float:
    off = errors(case, found, reference, gripper.geometry.active_length_m)
    return max(off.static_pct, off.transient_pct)


def _tried(case: Case, fidelity: Fidelity, reference: Record, gripper: Gripper) -> tuple[float, float]:
    """Return the error of positions [%] and the CPU time of a run."""
    try:
        found = run(case, fidelity, gripper)
    except PlantDivergedError:
        return LOST_PCT, 0.0
    return _off_pct(case, found, reference, gripper), found.cpu_ms_per_s


def _retimed(
    case: Case, chosen: Fidelity, holding: Sequence[Fidelity], costs: Mapping[Fidelity, float], gripper: Gripper
) -> dict[Fidelity, float]:
    """Return the CPU times of what was chosen and of the cheapest that hold, run in turn until they repeat."""
    near = sorted(holding, key=lambda each: costs[each])
    near = [each for each in near if costs[each] <= _NEXT_TO_CHEAPEST * costs[near[0]]][:_MOST_TIMED]
    times: dict[Fidelity, list[float]] = {each: [costs[each]] for each in dict.fromkeys([chosen, *near])}
    for turn in range(2, _MOST_RUNS + 1):
        for each, taken in times.items():
            if costs[each] > 0.0:
                taken.append(run(case, each, gripper).cpu_ms_per_s)
        if turn >= _FEWEST_RUNS and all(spread(taken) <= LARGEST_SPREAD for taken in times.values()):
            break
    return {each: min(taken) for each, taken in times.items()}


def _short(each: Fidelity) -> str:
    return f"{each.tier} {each.modes}, {1e3 * each.sub_step_s:g} ms, {each.pneumatics}"


def verdict(rows: Sequence[Mapping]) -> dict[str, float]:
    """Return what the rows of drawn scenes come to.

    ``kept_share`` is of the scenes that were promised to be within the tolerance, ``within_share`` of all that are
    decided; ``too_timid_share`` of these were promised nothing though something holds. ``care`` is promise over
    finding, in the median of the promised, ``cost`` that of the choice over that of the cheapest that holds: its
    median, and the share of scenes with no more than :data:`LARGEST_COST`.
    """
    decided = [row for row in rows if row["undecided_pct"] <= 0.5 * row["tolerance_pct"]]
    promised = [row for row in decided if row["promised"]]
    care = [row["promised_pct"] / max(row["found_pct"], 1e-6) for row in promised]
    costs = [
        row["cost_ms_per_s"] / row["cheapest_ms_per_s"] for row in promised if row["cheapest_ms_per_s"] is not None
    ]
    timid = [row for row in decided if not row["promised"] and row["cheapest"] is not None]
    return {
        "scenes": len(rows),
        "undecided": len(rows) - len(decided),
        "promised": len(promised),
        "kept_share": _share([_kept(row) for row in promised]),
        "within_share": _share([_kept(row) for row in decided]),
        "too_timid_share": len(timid) / max(len(decided), 1),
        "care_median": statistics.median(care) if care else 0.0,
        "cost_median": statistics.median(costs) if costs else 0.0,
        "cost_share": _share([cost <= LARGEST_COST for cost in costs]),
    }


def _kept(row: Mapping) -> bool:
    return bool(row["found_pct"] <= row["tolerance_pct"])


def _share(values: Sequence[bool]) -> float:
    return sum(values) / len(values) if values else 1.0


def reached(found: Mapping[str, float]) -> bool:
    """Whether a verdict is all that it should be."""
    return (
        found["kept_share"] >= KEPT_SHARE
        and found["care_median"] <= LARGEST_CARE
        and found["cost_median"] <= LARGEST_COST
    )


def row_text(row: Mapping) -> str:
    """Return the line about one scene."""
    promised = f"{row['promised_pct']:.2g} %{'' if row['promised'] else ' (outside)'}"
    undecided = ", undecided" if row["undecided_pct"] > 0.5 * row["tolerance_pct"] else ""
    return (
        f"{row['job']}: {row['kind']}, {row['tolerance_pct']:.2g} % allowed, {row['chosen']}: promised {promised}, "
        f"found {row['found_pct']:.2g} %{undecided}"
    )


def verdict_text(rows: Sequence[Mapping], found: Mapping[str, float]) -> str:
    """Return the tables: each kind of scene, and all of them beside what is to be reached."""
    lines = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = verdict([row for row in rows if row["kind"] == kind])
        lines.append((kind, *_cells(own)))
    lines.append(("all", *_cells(found)))
    lines.append(
        (
            "to reach",
            "",
            "",
            "",
            f">= {100 * KEPT_SHARE:.0f} %",
            "",
            "",
            f"<= {LARGEST_CARE:g}",
            f"<= {LARGEST_COST:g}",
            "",
        )
    )
    head = ("scenes", "drawn", "undecided", "promised", "kept", "all within", "too timid", "care", "cost", "<= 1.3")
    return text_table(head, lines)


def _cells(found: Mapping[str, float]) -> tuple[str, ...]:
    return (
        f"{found['scenes']:.0f}",
        f"{found['undecided']:.0f}",
        f"{found['promised']:.0f}",
        f"{100 * found['kept_share']:.0f} %",
        f"{100 * found['within_share']:.0f} %",
        f"{100 * found['too_timid_share']:.0f} %",
        f"{found['care_median']:.2g}",
        f"{found['cost_median']:.2f}",
        f"{100 * found['cost_share']:.0f} %",
    )
