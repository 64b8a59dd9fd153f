"""Table of the bending law M(p, kappa) of one design, for PDC and PSC: what the rod's law is made from.

With it, the stretch of the axis and the section's stiffness: EA and GJ (:mod:`~mbpam_ros.study.fe.section_stiffness`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbpam_ros.study.fe.design_run import NO_EQUILIBRIUM, S_PER_JOB, Run, settings
from mbpam_ros.study.fe.law import BendingLaw
from mbpam_ros.study.fe.mesh import PATTERNS
from mbpam_ros.study.fe.mesh_error import mesh_error_pct
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

BENDS_DEG = tuple(range(-60, 181, 30))
PRESSURES_KPA = tuple(range(0, 121, 10))

STIFFNESSES = {
    "axial_stiffness_n": "axial_n",
    "torsion_stiffness_n_mm2": "torsion_n_mm2",
    "bend_stiffness_n_mm2": "bend_n_mm2",
    "side_bend_stiffness_n_mm2": "side_bend_n_mm2",
}
"""Columns of the table, and what they are of :class:`~mbpam_ros.study.fe.section_stiffness.SectionStiffness`."""


def law_at_pressure(run: Run, pressure_kpa: float, bends_deg: Sequence[float]) -> dict[str, object]:
    """Return moment, stretch, gas volume and stiffness of the active length at one pressure, held at each bend.

    Bends that have no equilibrium are left out, with the reason under ``missing``.
    """
    cell = run.cell()
    law = BendingLaw(cell, [cell.held_bend(1e-3 * pressure_kpa, 0.0)])
    missing = []
    for bends in ([bend for bend in bends_deg if bend > 0], [bend for bend in reversed(bends_deg) if bend < 0]):
        for bend in bends:
            try:
                law.add(math.radians(bend))
            except LoadStepError as error:
                missing.append({"bend_deg": bend, "reason": str(error)})
                break
    moment, bend_rad = law.moment_n_mm, law.bend_rad
    stiffness = law.section_stiffness()
    slope, offset = np.polyfit(bend_rad, moment, 1) if bend_rad.size > 1 else (math.nan, moment[0])
    straight = float(np.interp(0.0, bend_rad, moment))
    return {
        "pattern": run.pattern,
        "p_kpa": float(pressure_kpa),
        "bend_deg": np.degrees(bend_rad).round(9).tolist(),
        "moment_n_mm": moment.tolist(),
        "axis_stretch": law.axis_stretch.tolist(),
        "gas_volume_mm3": law.gas_volume_mm3.tolist(),
        **{column: [getattr(here, name) for here in stiffness] for column, name in STIFFNESSES.items()},
        "straight_moment_n_mm": -straight,
        "line_stiffness_n_mm2": float(slope) * run.geometry.active_length_mm,
        "line_moment_n_mm": -float(offset),
        "line_rms_n_mm": float(np.sqrt(np.mean((slope * bend_rad + offset - moment) ** 2))),
        "missing": missing,
    }


def law_table(
    run: Run,
    path: Path,
    executor: Executor,
    progress: Progress,
    pressures_kpa: Sequence[float] = PRESSURES_KPA,
    bends_deg: Sequence[float] = BENDS_DEG,
) -> dict:
    """Return M, V, stretch and stiffness over pressure and bend for PDC and PSC, with the straight line through each.

    ``path`` is kept up to date; pressures that it holds whole from the same settings are not run again.

    Raises:
        ResultFileError: ``path`` is no law of this command.
    """
    wanted = {**settings(run), "design": {"a_mm": run.geometry.a_mm, "b_mm": run.geometry.b_mm}}
    results = ResultFile(path, wanted, "tables", _name)
    results.rows = {name: row for name, row in results.rows.items() if STIFFNESSES.keys() <= row.keys()}
    jobs = {}
    for pattern in PATTERNS:
        for pressure in pressures_kpa:
            job = replace(run, pattern=pattern), float(pressure), tuple(bends_deg)
            jobs[_name({"pattern": pattern, "p_kpa": pressure})] = job
    failures = run_jobs(
        jobs, law_at_pressure, results, executor, progress, _name, failing=NO_EQUILIBRIUM, s_per_job=S_PER_JOB
    )
    return results.write(list(jobs), mesh_error_pct=mesh_error_pct(run.resolution), failures=failures)


def _name(row: dict) -> str:
    return f"{row['pattern']} {row['p_kpa']:g} kPa"
