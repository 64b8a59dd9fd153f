"""How far the free bend of the unit cell is from that of finer meshes.

Four designs are bent freely at 100 kPa on the meshes in use and on one that is finer along the wave,
across the arms, along them and around the chambers. It stands for the limit. (Three elements through the wall instead
of two change the free bend by 0.1 %.)
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.study.fe.design_run import MESHES, NO_EQUILIBRIUM, NOMINAL_KPA, Run, settings
from mbpam_ros.study.fe.mesh import CONVERGED, Resolution
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

DESIGNS = ((2.5, 2.0, "pdc"), (2.5, 2.0, "psc"), (3.5, 2.0, "pdc"), (2.5, 1.0, "pdc"))
"""a [mm], b [mm], pattern: the initial design under both patterns, the deepest wave and the thinnest cross."""

FINEST = "finest"
REFINED = {FINEST: replace(CONVERGED, wave=12, arm=4, spoke=4, sector=4)}
"""What the meshes in use are compared with."""

S_PER_BEND = 60.0

STORED = "data/fe_mesh_error.json"
"""Result of ``mbpam fe mesh`` in the configuration directory: from it others say what their mesh is worth."""


def mesh_error_pct(resolution: Resolution) -> float | None:
    """Return the stored error [%] of a mesh's free bend at 100 kPa, the worst of :data:`DESIGNS`; None if not known.

    Raises:
        ConfigError: the file holds something else.
    """
    try:
        path = config_path(STORED)
    except ConfigError:  # a configuration from before there was such a file
        return None
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        for name, mesh in stored["settings"]["meshes"].items():
            if mesh == resolution.settings() and name != FINEST:
                return stored["errors"][name]["worst_pct"]
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} is no result of mbpam fe mesh: {error!r}") from error
    return None


def mesh_error_text(resolution: Resolution) -> str:
    """Return what is known of a mesh's error, in words."""
    error = mesh_error_pct(resolution)
    if error is None:
        return "error of this mesh: not known (mbpam fe mesh)"
    return f"error of this mesh: {error:+.1f} % of the free bend at 100 kPa, the worst of {len(DESIGNS)} designs"


def free_bend_row(name: str, run: Run) -> dict[str, object]:
    """Return the free bend [deg] of the active length at 100 kPa, and the number of unknowns.

    Raises:
        LoadStepError: no equilibrium was found.
    """
    cell = run.cell()
    bend_rad = cell.free_bend(1e-3 * NOMINAL_KPA).angle_rad * cell.angle_per_muscle
    return {
        "mesh": name,
        "a_mm": run.geometry.a_mm,
        "b_mm": run.geometry.b_mm,
        "pattern": run.pattern,
        "unknowns": cell.unknown_count,
        "free_bend_deg": math.degrees(bend_rad),
    }


def mesh_errors(
    template: Run,
    path: Path,
    executor: Executor,
    progress: Progress,
    meshes: Mapping[str, Resolution] | None = None,
    designs: Sequence[tuple[float, float, str]] = DESIGNS,
) -> dict:
    """Return the free bends, and of each mesh its error [%] against the finest one: of each design, and the worst.

    ``path`` is kept up to date; what it holds from the same settings is not run again.

    Args:
        template: all but a, b, the pattern and the mesh.
        meshes: by name, with one called :data:`FINEST`; by default those in use and :data:`REFINED`.

    Raises:
        ResultFileError: ``path`` is no file of this command.
    """
    meshes = meshes or {**MESHES, **REFINED}
    told = settings(template)
    del told["resolution"]
    wanted = {**told, "meshes": {name: mesh.settings() for name, mesh in meshes.items()}}
    results = ResultFile(path, wanted, "bends", _name)
    jobs = {}
    for mesh, resolution in meshes.items():
        for a_mm, b_mm, pattern in designs:
            geometry = replace(template.geometry, a_mm=a_mm, b_mm=b_mm)
            run = replace(template, geometry=geometry, pattern=pattern, resolution=resolution)
            jobs[_name({"mesh": mesh, "a_mm": a_mm, "b_mm": b_mm, "pattern": pattern})] = mesh, run
    failures = run_jobs(
        jobs, free_bend_row, results, executor, progress, _row_text, failing=NO_EQUILIBRIUM, s_per_job=S_PER_BEND
    )
    rows = [results.rows[job] for job in jobs if job in results.rows]
    errors = {mesh: _errors(rows, mesh) for mesh in meshes if mesh != FINEST}
    return results.write(list(jobs), errors=errors, failures=failures)


def _errors(rows: Sequence[dict], mesh: str) -> dict[str, object]:
    """Errors [%] of a mesh by design, and the one of the largest size; designs without both bends are left out."""
    limit = {_design(row): row["free_bend_deg"] for row in rows if row["mesh"] == FINEST}
    found = {_design(row): row["free_bend_deg"] for row in rows if row["mesh"] == mesh}
    by_design = {design: 100.0 * (found[design] / limit[design] - 1.0) for design in limit if design in found}
    worst = max(by_design.values(), key=abs) if by_design else None
    return {"by_design_pct": by_design, "worst_pct": worst}


def _design(row: dict) -> str:
    return f"a {row['a_mm']:g} b {row['b_mm']:g} {row['pattern']}"


def _name(row: dict) -> str:
    return f"{row['mesh']} | {_design(row)}"


def _row_text(row: dict) -> str:
    return f"{_name(row)}: {row['unknowns']} unknowns, {row['free_bend_deg']:.2f} deg"
