"""Trials of faults side by side: which runs there are, what each row of the table says, and whether it is enough."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from mbpam_ros.grasp.responses import Response
from mbpam_ros.study.faults.draws import ROWS, SEED, FaultRow, PhaseName
from mbpam_ros.study.provenance import sources_digest, versions

TIERS = ("arc", "rod")
S_PER_TRIAL = 3.0
"""CPU of a trial, a guess."""

LETS_GO = (Response.VENT_ALL.value, Response.VENT_CHANNEL.value, Response.CUT_SUPPLY.value)
"""Answers after which an object need not be in the hand any more."""

HIGHEST_KPA, OPEN_HIGHEST_KPA, OPEN_ABOVE_S, ABOVE_S = 112.2, 125.0, 0.5, 0.02


def settings(seed: int = SEED) -> dict[str, object]:
    """Return what all trials depend on."""
    return {"sources": sources_digest(), "versions": versions("numpy", "numba", "scipy"), "seed": seed}


def trial_jobs(
    rows: Sequence[FaultRow], tiers: Sequence[str], trials: int, pneumatics: str, seed: int = SEED
) -> dict[str, tuple[str, str, PhaseName, str, int, str]]:
    """Return what :func:`~mbpam_ros.study.faults.trial.trial_row` is given for each trial, by name."""
    return {
        name: (name, row.name, phase, tier, seed + number, pneumatics)
        for row in rows
        for phase in row.phases
        for tier in tiers
        for number in range(trials)
        for name in (f"{row.name}, {phase}, {tier}, {pneumatics}, {number}",)
    }


def table_rows(trials: Sequence[dict]) -> list[dict]:
    """Return a row for each fault and phase, tiers together."""
    keys = dict.fromkeys((trial["fault"], trial["phase"]) for trial in trials)
    return [
        _table_row(fault, phase, [each for each in trials if (each["fault"], each["phase"]) == (fault, phase)])
        for fault, phase in keys
    ]


def _table_row(fault: str, phase: str, trials: Sequence[dict]) -> dict:
    found = [each for each in trials if each["detected_by"]]
    detect_s = sorted(each["detect_s"] for each in found)
    safe_s = sorted(each["safe_s"] for each in trials if each["safe_s"] is not None)
    kept = [each["object_kept"] for each in trials if each["object_kept"] is not None]
    answers = {each["answer"] for each in trials}
    lost = [each for each in trials if each["object_kept"] is False and each["answer"] not in LETS_GO]
    by = [each["detected_by"] for each in found]
    return {
        "fault": fault,
        "phase": phase,
        "trials": len(trials),
        "detected": len(found) / len(trials),
        "right_channel": sum(each["right_channel"] for each in found) / len(found) if found else 0.0,
        "detect_s_worst": detect_s[-1] if detect_s else None,
        "pressure_max_kpa": 1e-3 * max(each["pressure_max_pa"] for each in trials),
        "seconds_above_limit": max(each["above_limit_s"] for each in trials),
        "object_kept": sum(kept) / len(kept) if kept else None,
        "back_to_idle": sum(each["back_s"] is not None for each in trials) / len(trials),
        "detect_s_median": statistics.median(detect_s) if detect_s else None,
        "safe_s_median": statistics.median(safe_s) if safe_s else None,
        "safe_s_worst": safe_s[-1] if len(safe_s) == len(trials) else None,
        "detected_by": {name: by.count(name) for name in dict.fromkeys(by)},
        "answers": {name: sum(each["answer"] == name for each in trials) for name in sorted(answers)},
        "lost_though_not_vented": len(lost),
        "above_110_kpa_s": max(each["above_110_kpa_s"] for each in trials),
    }


def shortcomings(row: dict) -> list[str]:
    """Return what a row of the table does not reach."""
    open_valve = row["fault"] == "valve stuck open"
    checks = {
        f"detected {row['detected']:.0%}": row["detected"] == 1.0,
        f"right channel {row['right_channel']:.0%}": row["right_channel"] >= 0.95,
        f"{row['pressure_max_kpa']:.1f} kPa": row["pressure_max_kpa"] <= OPEN_HIGHEST_KPA
        if open_valve
        else row["seconds_above_limit"] <= ABOVE_S + 1e-9,
        f"above 110 kPa for {row['above_110_kpa_s']:.2f} s": not open_valve or row["above_110_kpa_s"] <= OPEN_ABOVE_S,
        f"{row['lost_though_not_vented']} objects lost": row["lost_though_not_vented"] == 0,
        f"back to idle {row['back_to_idle']:.0%}": row["back_to_idle"] == 1.0,
    }
    return [words for words, reached in checks.items() if not reached]


def table_text(rows: Sequence[dict]) -> str:
    """Return the table as text, in Markdown, with what is not reached below it."""
    head = (
        "fault", "phase", "trials", "detected", "right channel", "found after (median, worst) [s]",
        "safe after (median, worst) [s]", "highest [kPa]", "above 112.2 kPa [s]", "answers", "kept", "back",
    )  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for row in rows:
        answers = ", ".join(f"{name} {count}" for name, count in row["answers"].items())
        cells = (
            row["fault"], row["phase"], str(row["trials"]), f"{row['detected']:.0%}", f"{row['right_channel']:.0%}",
            f"{_s(row['detect_s_median'])}, {_s(row['detect_s_worst'])}",
            f"{_s(row['safe_s_median'])}, {_s(row['safe_s_worst'])}", f"{row['pressure_max_kpa']:.1f}",
            f"{row['seconds_above_limit']:.2f}", answers,
            "" if row["object_kept"] is None else f"{row['object_kept']:.0%}", f"{row['back_to_idle']:.0%}",
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    missed = [f"{row['fault']}, {row['phase']}: {'; '.join(short)}" for row in rows if (short := shortcomings(row))]
    return "\n".join([*lines, "", *(missed or ["every row is as it should be"])])


def trial_text(trial: dict) -> str:
    """Return the line of a finished trial."""
    said = f"{trial['detected_by']} after {trial['detect_s']:.2f} s: {trial['found']}" if trial["detected_by"] else "-"
    return f"{trial['job']}: {said}"


def _s(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


ROW_NAMES = tuple(row.name for row in ROWS)
