"""Finite elements of designs of a drawing, as rows: what each does at 100 kPa, and how far its wall is stretched."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.actuator.tables import read_table
from mbpam_ros.study.design.latin_hypercube import RANGES
from mbpam_ros.study.fe.design_run import NO_EQUILIBRIUM, NOMINAL_KPA, S_PER_JOB, Run, values_at
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CONVERGED, CellGeometry, CellGeometryError, Resolution
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell
from mbpam_ros.study.fe.versions import library_versions
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.silicone.known import yeoh_constants_of
from mbpam_ros.terminal import Progress

Array = NDArray[np.float64]

PAPER_RADIUS_MM, PAPER_LENGTH_MM = 10.0, 100.0

PAPER_TABLES = {"doe_training.csv": "sample", "doe_validation.csv": "check", "pareto_checks.csv": "optimum"}

_SMALL_SHARE = 0.01
"""Of the silicone, that is stretched further than ``stretch_99``."""


@dataclass(frozen=True)
class FeSample:
    """A design to run; a plain value.

    Args:
        name: of its rows.
        a_mm, b_mm, c_mm, wave_count: the design.
    """

    name: str
    a_mm: float
    b_mm: float
    c_mm: float
    wave_count: float


@dataclass(frozen=True)
class MeshedDrawing:
    """A drawing, and the finite elements that designs of it are run on.

    Args:
        drawing: of the muscle.
        resolution: of the mesh.
        mesh_wall_mm: what the mesh's wall is thinner by, for what the mesh lacks in flexibility.
    """

    drawing: MuscleDrawing
    resolution: Resolution = CONVERGED
    mesh_wall_mm: float = 0.0

    def rows(
        self, designs: Sequence[FeSample], patterns: Sequence[str], path: Path, executor: Executor, progress: Progress
    ) -> tuple[list[dict[str, Any]], dict[str, str]]:
        """Run what the file does not hold of the designs under each pattern; return the rows, and what failed by name.

        Rows of other designs and patterns stay in the file.

        Raises:
            ConfigError: the drawing's silicone is not known.
            ResultFileError: ``path`` cannot be written, or holds something else.
        """
        jobs: dict[str, tuple[str, Run, float]] = {}
        failures: dict[str, str] = {}
        silicone = silicone_of(self.drawing)
        for pattern in patterns:
            for design in designs:
                name = f"{design.name} {pattern}"
                try:
                    run = run_of(self.drawing, design, pattern, self.resolution, silicone)
                    jobs[name] = name, run, self.mesh_wall_mm
                except CellGeometryError as error:
                    failures[name] = str(error)
        settings = {
            "drawing": asdict(self.drawing),
            "resolution": self.resolution.settings(),
            "mesh_wall_mm": self.mesh_wall_mm,
            "versions": library_versions(),
        }
        results = ResultFile(path, settings, "samples", lambda row: str(row["name"]))
        failures |= run_jobs(
            jobs,
            sample_row,
            results,
            executor,
            progress,
            _row_text,
            failing=(*NO_EQUILIBRIUM, CellGeometryError),
            s_per_job=S_PER_JOB,
        )
        results.write([*jobs, *(name for name in results.rows if name not in jobs)], failures=failures)
        return [results.rows[name] for name in jobs if name in results.rows], failures


def _row_text(row: dict[str, Any]) -> str:
    performance = f"{row['theta_max_deg']:.1f} deg, {row['f_max_n']:.3f} N"
    return f"{row['name']}: {performance}, wall stretched to {row['stretch_max']:.2f}"


def ranges_of(drawing: MuscleDrawing) -> dict[str, tuple[float, float]]:
    """Return the ranges of a, b, c [mm] and n of a muscle: the paper's, made similar to its radius and length.

    The waves' length goes with the radius, as everything that is similar; n is whole.
    """
    size = drawing.outer_radius_mm / PAPER_RADIUS_MM
    waves = drawing.active_length_mm / PAPER_LENGTH_MM / size
    scales = {"a_mm": size, "b_mm": size, "c_mm": size, "n": waves}
    return {name: (scales[name] * low, scales[name] * high) for name, (low, high) in RANGES.items()}


def designs_of(drawing: MuscleDrawing, unit_points: Array, names: Sequence[str], prefix: str) -> list[FeSample]:
    """Return the designs at points of the unit cube over the variables ``names``; the others are the drawing's.

    Each is named by what it is, so that another set of samples finds those that have been run.
    """
    ranges = ranges_of(drawing)
    designs = []
    for point in unit_points:
        values = {"a_mm": drawing.a_mm, "b_mm": drawing.b_mm, "c_mm": drawing.c_mm, "n": drawing.wave_count}
        for name, share in zip(names, point, strict=True):
            low, high = ranges[name]
            value = low + float(share) * (high - low)
            values[name] = float(round(value)) if name == "n" else round(value, 4)
        name = f"{prefix} " + ", ".join(f"{value:g}" for value in values.values())
        designs.append(FeSample(name, values["a_mm"], values["b_mm"], values["c_mm"], values["n"]))
    return designs


def table_designs(drawing: MuscleDrawing) -> list[FeSample]:
    """Return the paper's designs made similar to the drawing's radius: Table 1 as samples, 2 as checks, 5 as optima.

    Raises:
        ConfigError: a table is missing or unreadable.
    """
    size = drawing.outer_radius_mm / PAPER_RADIUS_MM
    designs = []
    for table, prefix in PAPER_TABLES.items():
        for a_mm, b_mm in (size * read_table(table, "a_mm", "b_mm").T).round(4).tolist():
            name = f"{prefix} {a_mm:g}, {b_mm:g}, {drawing.c_mm:g}, {drawing.wave_count:g}"
            designs.append(FeSample(name, a_mm, b_mm, drawing.c_mm, drawing.wave_count))
    return designs


def silicone_of(drawing: MuscleDrawing) -> Silicone:
    """Return what a muscle is cast of.

    Raises:
        ConfigError: the drawing's silicone is not known.
    """
    return Silicone(**yeoh_constants_of(drawing.silicone).constants())


def run_of(drawing: MuscleDrawing, design: FeSample, pattern: str, resolution: Resolution, silicone: Silicone) -> Run:
    """Return the finite element run of a design of a drawing.

    Raises:
        CellGeometryError: the design is no muscle.
    """
    geometry = CellGeometry(
        a_mm=design.a_mm,
        b_mm=design.b_mm,
        c_mm=design.c_mm,
        wave_count=design.wave_count,
        active_length_mm=drawing.active_length_mm,
        outer_radius_mm=drawing.outer_radius_mm,
    )
    return Run(
        geometry,
        pattern,
        resolution,
        silicone,
        end_length_mm=drawing.end_length_mm,
        density_kg_m3=drawing.density_kg_m3,
    )


def sample_row(name: str, run: Run, mesh_wall_mm: float) -> dict[str, Any]:
    """Return what a design does at 100 kPa, as a row.

    Args:
        name: of the row.
        run: the design, as it is drawn.
        mesh_wall_mm: what the mesh's wall is thinner by, for what the mesh lacks in flexibility.

    Raises:
        LoadStepError, LawError, PostureError, RodSolutionError: no equilibrium was found.
        CellGeometryError: the design is no muscle.
    """
    geometry = run.geometry
    meshed = replace(run, geometry=replace(geometry, c_mm=geometry.c_mm - mesh_wall_mm))
    cell = meshed.cell()
    free = cell.free_bend(1e-3 * NOMINAL_KPA)
    found = values_at(meshed, cell, free)
    return {
        "name": name,
        "pattern": run.pattern,
        "a_mm": geometry.a_mm,
        "b_mm": geometry.b_mm,
        "c_mm": geometry.c_mm,
        "n": geometry.wave_count,
        "theta_max_deg": found["theta_deg"],
        "f_max_n": found["force_n"],
        **wall_load(cell, free),
    }


def wall_load(cell: UnitCell, state: CellState) -> dict[str, float]:
    """Return how far the silicone is stretched, and the true stress in it [MPa].

    ``stretch_max`` and ``stress_max_mpa`` are the largest of all points of quadrature. The chambers' corners are sharp,
    so both rise slowly as the mesh is refined; ``stretch_99`` and ``stress_99_mpa``, which a hundredth of the silicone
    exceeds, do not.
    """
    stretch, stress_mpa, volume = (each.ravel() for each in cell.largest_principal(state))
    found = {}
    for name, values in (("stretch{}", stretch), ("stress{}_mpa", stress_mpa)):
        order = np.argsort(values)
        below = np.cumsum(volume[order]) / volume.sum()
        found[name.format("_max")] = float(values[order[-1]])
        found[name.format("_99")] = float(values[order[np.searchsorted(below, 1.0 - _SMALL_SHARE)]])
    return found
