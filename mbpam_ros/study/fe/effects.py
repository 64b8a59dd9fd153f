"""Effect of each parameter on bend and force at 100 kPa: figure 6 of the paper, with the signs its text gives.

Three levels of each of a, b, c and n, the others as in the initial design, two chambers under pressure. The force
stands there twice: of the straight propped rod (``force_n``), and with the tip on a plate (``blocked_force_n``,
:mod:`~mbpam_ros.study.fe.blocked_muscle`), as in the paper's finite elements; the trends are those of the latter.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from mbpam_ros.study.fe.blocked_muscle import blocked_force_n
from mbpam_ros.study.fe.design_run import NO_EQUILIBRIUM, S_PER_JOB, Run, nominal_values, settings
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.mesh_error import mesh_error_pct
from mbpam_ros.study.fe.paper_comparison import INITIAL_A_MM, INITIAL_B_MM, paper_points
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

LEVELS = {"a": (1.5, 2.5, 3.5), "b": (1.0, 2.0, 3.0), "c": (1.0, 2.0, 3.0), "n": (6.0, 10.0, 14.0)}
"""Lengths in mm. The ranges of section 3.2; the levels within them are our reading of "three levels"."""

PAPER_TRENDS = {
    ("a", "theta"): "rises",
    ("a", "force"): "falls",
    ("b", "theta"): "rises, then falls",
    ("b", "force"): "rises, then falls",
    ("c", "theta"): "falls",
    ("c", "force"): "falls",
    ("n", "theta"): "rises",
    ("n", "force"): "rises",
}
"""Section 3.2. Of n it says "its growth can effectively improve the bending ability", which section 4.1 calls bending
angle and output force, both monotonous in n."""

_FIELDS = {"a": "a_mm", "b": "b_mm", "c": "c_mm", "n": "wave_count"}
_VALUES = {"theta": "theta_deg", "force": "blocked_force_n"}
_REPORTED = ("theta_deg", "force_n", "blocked_force_n")


def trend(values: Sequence[float]) -> str:
    """Return in words how values at rising levels go."""
    rising = [after > before for before, after in zip(values, values[1:], strict=False)]
    turns = [rising[0]] + [now for before, now in zip(rising, rising[1:], strict=False) if now != before]
    return ", then ".join("rises" if up else "falls" for up in turns)


def effects(template: Run, path: Path, executor: Executor, progress: Progress) -> dict:
    """Run all levels and return the designs, and each trend beside the paper's.

    ``path`` is kept up to date; designs that it holds from the same settings are not run again.

    Raises:
        ResultFileError: ``path`` is no file of this command.
    """
    initial = replace(template.geometry, a_mm=INITIAL_A_MM, b_mm=INITIAL_B_MM)
    template = replace(template, geometry=initial, pattern="pdc")
    designs = {
        (parameter, level): replace(initial, **{_FIELDS[parameter]: level})
        for parameter, levels in LEVELS.items()
        for level in levels
    }
    jobs = {_name(geometry): (replace(template, geometry=geometry),) for geometry in designs.values()}
    results = ResultFile(path, settings(template), "runs", lambda row: row["design"])
    failures = run_jobs(
        jobs, design_row, results, executor, progress, _row_text, failing=NO_EQUILIBRIUM, s_per_job=S_PER_JOB
    )
    rows = []
    for (parameter, level), geometry in designs.items():
        if _name(geometry) in results.rows:
            values = results.rows[_name(geometry)]
            known = _paper_values(geometry, initial)
            rows.append({"parameter": parameter, "level": level, **known, **{name: values[name] for name in _REPORTED}})
    return results.write(
        list(jobs),
        trends=_trends(rows),
        mesh_error_pct=mesh_error_pct(template.resolution),
        failures=failures,
        designs=rows,
    )


def design_row(run: Run) -> dict[str, object]:
    """Return what a design does at 100 kPa, with its name.

    Raises:
        LoadStepError, LawError, PostureError, RodSolutionError: no equilibrium was found.
    """
    return {"design": _name(run.geometry), **nominal_values(run), "blocked_force_n": blocked_force_n(run)}


def _trends(rows: Sequence[dict]) -> list[dict]:
    """Each trend with the paper's; None where a level has no equilibrium."""
    trends = []
    for (parameter, quantity), wanted in PAPER_TRENDS.items():
        members = sorted((row for row in rows if row["parameter"] == parameter), key=lambda row: row["level"])
        whole = len(members) == len(LEVELS[parameter])
        found = trend([row[_VALUES[quantity]] for row in members]) if whole else None
        trends.append(
            {"parameter": parameter, "quantity": quantity, "paper": wanted, "found": found, "agrees": found == wanted}
        )
    return trends


def _paper_values(geometry: CellGeometry, initial: CellGeometry) -> dict[str, float | None]:
    """The tables' finite elements for this design; c and n of the tables are those of the initial design."""
    for point in paper_points():
        if point.pattern == "pdc" and replace(initial, a_mm=point.a_mm, b_mm=point.b_mm) == geometry:
            return {"paper_theta_deg": point.theta_deg, "paper_force_n": point.force_n}
    return {"paper_theta_deg": None, "paper_force_n": None}


def _name(geometry: CellGeometry) -> str:
    return f"a {geometry.a_mm:g} b {geometry.b_mm:g} c {geometry.c_mm:g} n {geometry.wave_count:g}"


def _row_text(row: dict) -> str:
    return (
        f"{row['design']}: theta {row['theta_deg']:6.1f} deg, "
        f"force {row['blocked_force_n']:.3f} N (propped {row['force_n']:.3f} N)"
    )
