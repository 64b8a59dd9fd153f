"""Finite elements of one design of a drawing, as a row: what it does at 100 kPa, and how far its wall is stretched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.design.latin_hypercube import RANGES
from mbpam_ros.study.fe.design_run import Run, nominal_values
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.unit_cell import UnitCell
from mbpam_ros.study.silicone.known import yeoh_constants_of

Array = NDArray[np.float64]

PAPER_RADIUS_MM, PAPER_LENGTH_MM = 10.0, 100.0

_CORNER_SLOPES = 0.125 * np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=float
)
"""Slopes of a hexahedron's eight corner functions in its middle."""


class SampleError(MbpamError, ValueError):
    """A design that cannot be sampled; the message says why."""


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
    return Run(geometry, pattern, resolution, silicone, end_length_mm=drawing.end_length_mm)


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
    found = nominal_values(meshed)
    cell = meshed.cell()
    state = cell.free_bend(0.1)
    return {
        "name": name,
        "pattern": run.pattern,
        "a_mm": geometry.a_mm,
        "b_mm": geometry.b_mm,
        "c_mm": geometry.c_mm,
        "n": geometry.wave_count,
        "theta_max_deg": found["theta_deg"],
        "f_max_n": found["force_n"],
        "stretch_max": largest_stretch(cell, state.unknowns),
    }


def largest_stretch(cell: UnitCell, unknowns: Array) -> float:
    """Return the largest principal stretch in the middle of any element of a hexahedral mesh.

    Raises:
        SampleError: the mesh is of tetrahedra.
    """
    corners = cell.mesh.cells[:, :8]
    if cell.mesh.cells.shape[1] not in (8, 20):
        raise SampleError("stretches are told for hexahedra; take another mesh")
    rest = cell.mesh.points_mm[corners]
    now = cell.positions_mm(unknowns)[:-1][corners]
    before, after = (np.einsum("eki,kj->eij", x, _CORNER_SLOPES) for x in (rest, now))
    gradient = after @ np.linalg.inv(before)
    return float(np.linalg.svd(gradient, compute_uv=False).max())
