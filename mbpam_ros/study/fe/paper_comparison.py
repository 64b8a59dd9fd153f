"""The finite element muscle beside the paper's: 32 designs of Tables 1, 2 and 5, and the measured PSC.

The reading (c, n, active length, weightless ends; not stated by the paper) was chosen on Tables 1 and 2, so the errors
there are those of a fit; Table 5 was kept apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.tables import read_table
from mbpam_ros.study.fe.design_run import (
    NO_EQUILIBRIUM,
    NOMINAL_KPA,
    S_PER_JOB,
    Run,
    bend_curve,
    nominal_values,
    settings,
)
from mbpam_ros.study.fe.mesh import PATTERNS
from mbpam_ros.study.fe.mesh_error import mesh_error_pct
from mbpam_ros.study.fe.muscle_shape import MuscleShape, muscle_shapes
from mbpam_ros.study.fe.pictures import draw_curves, draw_muscles, draw_parity, draw_sections
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

INITIAL_A_MM, INITIAL_B_MM = 2.5, 2.0
"""The paper's initial design: not stated, but its gains come back with these (``config/data/README.md``)."""

MEASURED_PSC_DEG, MEASURED_PSC_N = 120.0, 0.466  # paper, section 3.1
MEASURED_PDC_DEG = 151.0
CURVE_KPA = tuple(np.linspace(0.0, NOMINAL_KPA, 11).tolist())
SHAPE_KPA = (0.0, 50.0, 80.0, 100.0)

_TABLES = {"table_1": "doe_training.csv", "table_2": "doe_validation.csv", "table_5": "pareto_checks.csv"}
_COLUMNS = {"table_5": ("no", "a_mm", "b_mm", "theta_fe_deg", "f_fe_n")}


@dataclass(frozen=True)
class PaperPoint:
    """A design with the paper's values at 100 kPa: finite elements, but for the measured ``psc``."""

    source: str
    a_mm: float
    b_mm: float
    theta_deg: float
    force_n: float
    pattern: str = "pdc"


def paper_points() -> list[PaperPoint]:
    """Return the paper's 32 finite element designs, then the measured initial design under PSC.

    Raises:
        ConfigError: a table is missing or unreadable.
    """
    points = []
    for name, file in _TABLES.items():
        columns = _COLUMNS.get(name, ("no", "a_mm", "b_mm", "theta_max_deg", "f_max_n"))
        for no, a_mm, b_mm, theta_deg, force_n in read_table(file, *columns).T.tolist():
            points.append(PaperPoint(f"{name}:{no:.0f}", a_mm, b_mm, theta_deg, force_n))
    measured = PaperPoint("measured:psc", INITIAL_A_MM, INITIAL_B_MM, MEASURED_PSC_DEG, MEASURED_PSC_N, "psc")
    return [*points, measured]


def point_row(point: PaperPoint, template: Run) -> dict[str, object]:
    """Return the paper's values at ``point``, ours (``fe_...``) and our relative errors [%].

    Args:
        template: all but a, b and the pattern.

    Raises:
        LoadStepError, LawError, PostureError: no equilibrium was found.
    """
    geometry = replace(template.geometry, a_mm=point.a_mm, b_mm=point.b_mm)
    values = nominal_values(replace(template, geometry=geometry, pattern=point.pattern))
    return {
        **asdict(point),
        **{f"fe_{key}": value for key, value in values.items()},
        "theta_error_pct": 100.0 * (values["theta_deg"] / point.theta_deg - 1.0),
        "force_error_pct": 100.0 * (values["force_n"] / point.force_n - 1.0),
    }


def error_summary(rows: Iterable[dict]) -> dict[str, dict[str, float]]:
    """Return rms and worst relative errors [%] of theta and force, for the fit (Tables 1, 2), Table 5 and PSC."""
    groups: dict[str, list[dict]] = {}
    for row in rows:
        table = row["source"].split(":")[0]
        groups.setdefault("tables_1_2" if table in ("table_1", "table_2") else table, []).append(row)
    summary: dict[str, dict[str, float]] = {}
    for name, members in groups.items():
        summary[name] = {"points": len(members)}
        for key in ("theta", "force"):
            errors = np.array([member[f"{key}_error_pct"] for member in members])
            summary[name][f"{key}_rms_pct"] = float(np.sqrt(np.mean(errors**2)))
            summary[name][f"{key}_mean_pct"] = float(errors.mean())
            summary[name][f"{key}_worst_pct"] = float(errors[np.abs(errors).argmax()])
    return summary


def compare_with_paper(
    template: Run, path: Path, executor: Executor, progress: Progress, points: Sequence[PaperPoint]
) -> dict:
    """Run all points and keep ``path`` up to date; points that it holds from the same settings are not run again.

    Args:
        template: all but a, b and the pattern.
        executor: see :func:`~mbpam_ros.study.jobs.run_jobs`.

    Raises:
        ResultFileError: ``path`` is no file of this command.
    """
    results = ResultFile(path, settings(template), "points", lambda row: row["source"])
    jobs = {point.source: (point, template) for point in points}
    failures = run_jobs(
        jobs, point_row, results, executor, progress, _row_text, failing=NO_EQUILIBRIUM, s_per_job=S_PER_JOB
    )
    wanted = [point.source for point in points]
    rows = [results.rows[source] for source in wanted if source in results.rows]
    return results.write(
        wanted,
        errors=error_summary(rows),
        mesh_error_pct=mesh_error_pct(template.resolution),
        failures=failures,
    )


def draw_comparison(template: Run, comparison: dict, path: Path, executor: Executor, progress: Progress) -> list[Path]:
    """Draw sections, muscles, curves and parity beside ``path``; return the pictures' paths.

    The bend curves are kept in a JSON file of their own, the shapes of the muscles are not kept.

    Raises:
        LoadStepError, LawError, PostureError: the initial design has no equilibrium on the way to 100 kPa.
    """
    geometry = replace(template.geometry, a_mm=INITIAL_A_MM, b_mm=INITIAL_B_MM)
    runs = [replace(template, geometry=geometry, pattern=pattern) for pattern in PATTERNS]
    shapes = [executor.submit(muscle_shapes, run, list(SHAPE_KPA)) for run in runs]
    curves = _curves(runs, path.with_name(f"{path.stem}_curves.json"), executor, progress)
    series: list[list[MuscleShape]] = [future.result() for future in shapes]
    pictures = [path.with_name(f"{path.stem}_{name}.png") for name in ("sections", "muscle", "curves", "parity")]
    draw_sections([shapes[-1] for shapes in series], pictures[0])
    draw_muscles(series, pictures[1])
    paper_fe_deg = next(p.theta_deg for p in paper_points() if (p.a_mm, p.b_mm) == (INITIAL_A_MM, INITIAL_B_MM))
    references = (
        ("pdc", NOMINAL_KPA, MEASURED_PDC_DEG, "paper, PDC measured"),
        ("pdc", NOMINAL_KPA, paper_fe_deg, "paper, PDC finite elements"),
        ("psc", NOMINAL_KPA, MEASURED_PSC_DEG, "paper, PSC measured"),
    )
    draw_curves(curves, references, pictures[2])
    draw_parity(comparison["points"], comparison["errors"], pictures[3])
    return pictures


def curve_row(run: Run, pressures_kpa: Sequence[float]) -> dict[str, object]:
    """Return the bend curve of a run with its pattern."""
    return {"pattern": run.pattern, **bend_curve(run, pressures_kpa)}


def _curves(runs: Sequence[Run], path: Path, executor: Executor, progress: Progress) -> list[dict]:
    results = ResultFile(path, settings(runs[0]), "curves", lambda row: row["pattern"])
    jobs = {run.pattern: (run, CURVE_KPA) for run in runs}
    run_jobs(
        jobs,
        curve_row,
        results,
        executor,
        progress,
        lambda row: f"bend curve {row['pattern']}",
        failing=NO_EQUILIBRIUM,
        s_per_job=S_PER_JOB,
    )
    return results.write(list(jobs))["curves"]


def _row_text(row: dict) -> str:
    return (
        f"{row['source']:>13} {row['pattern']} a {row['a_mm']:.2f} b {row['b_mm']:.2f}: "
        f"theta {row['fe_theta_deg']:6.1f} deg ({row['theta_error_pct']:+5.1f} %), "
        f"force {row['fe_force_n']:.3f} N ({row['force_error_pct']:+5.1f} %)"
    )
