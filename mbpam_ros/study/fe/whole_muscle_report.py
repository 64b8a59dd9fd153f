"""What the whole muscle does at 100 kPa.

Study ``unit_cell`` sets the weightless muscle beside as many unit cells; ``ends`` compares end pieces under gravity;
``plate`` blocks the tip by a plate, with and without friction and weight, and for three thicknesses b of the cross;
``mesh`` refines the elements.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_loads import UPRIGHT
from mbpam_ros.study.fe.muscle_mesh import EndPieces
from mbpam_ros.study.fe.plate_contact import STICKING, Plate
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.fe.unit_cell import UnitCell
from mbpam_ros.study.fe.versions import library_versions
from mbpam_ros.study.fe.whole_muscle import MuscleState, WholeMuscle
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.pictures import new_figure, save_figure
from mbpam_ros.terminal import Progress

_S_PER_MUSCLE = 200.0
NOMINAL_MPA = 0.1
PAPER_FRICTION = 0.6

MEDIUM = Resolution(wave=8, wall=1, arm=2, spoke=2, sector=2)
"""Mesh of the comparisons: its bend is 2 % from that of the default mesh, at half the cost."""

MESHES = {
    "coarse": Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2),
    "medium": MEDIUM,
    "default": Resolution(),
    "quadratic": Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2, quadratic=True),
}


@dataclass(frozen=True)
class Case:
    """One muscle to run.

    Args:
        friction: of the plate; None: the tip is free.
        gravity_factor: 1 with the muscle's weight, 0 without.
    """

    geometry: CellGeometry = field(default_factory=CellGeometry)
    pattern: str = "pdc"
    resolution: Resolution = MEDIUM
    ends: EndPieces = field(default_factory=EndPieces)
    friction: float | None = None
    gravity_factor: float = 1.0

    def muscle(self) -> WholeMuscle:
        """Return the model of this case."""
        plate = None
        if self.friction is not None:
            plate = Plate(distance_mm=-self.geometry.outer_radius_mm, friction=self.friction)
        return WholeMuscle(self.geometry, self.pattern, self.resolution, ends=self.ends, plate=plate)


def unit_cell_cases() -> dict[str, Case]:
    """Weightless muscles, whose waves bend as unit cells do but near the ends."""
    return {
        "short ends, no weight": Case(ends=EndPieces(3.0, 3.0), gravity_factor=0.0),
        "hollow ends, no weight": Case(ends=EndPieces(15.0, 3.0), gravity_factor=0.0),
    }


def end_cases() -> dict[str, Case]:
    """Muscles in the paper's posture with different end pieces."""
    return {
        "solid ends": Case(),
        "weightless ends": Case(ends=EndPieces(density_factor=0.0)),
        "hollow ends": Case(ends=EndPieces(cap_mm=3.0)),
        "solid ends, psc": Case(pattern="psc"),
    }


def plate_cases() -> dict[str, Case]:
    """Muscles whose tip end stands at a plate."""
    paper = Case(friction=PAPER_FRICTION)
    return {
        "blocked": paper,
        "blocked, b = 1": replace(paper, geometry=CellGeometry(b_mm=1.0)),
        "blocked, b = 3": replace(paper, geometry=CellGeometry(b_mm=3.0)),
        "blocked, psc": replace(paper, pattern="psc"),
        "blocked, no friction": replace(paper, friction=0.0),
        "blocked, held": replace(paper, friction=STICKING),
        "blocked, no weight": replace(paper, gravity_factor=0.0),
        "blocked, weightless ends": replace(paper, ends=EndPieces(density_factor=0.0)),
    }


def mesh_cases(meshes: dict[str, Resolution] | None = None, template: Case | None = None) -> dict[str, Case]:
    """The free and the blocked muscle on each mesh."""
    template = template or Case()
    cases = {}
    for name, resolution in (meshes or MESHES).items():
        cases[f"{name} mesh"] = replace(template, resolution=resolution)
        cases[f"{name} mesh, blocked"] = replace(template, resolution=resolution, friction=PAPER_FRICTION)
    return cases


STUDIES: dict[str, Callable[[], dict[str, Case]]] = {
    "plate": plate_cases,
    "ends": end_cases,
    "unit_cell": unit_cell_cases,
    "mesh": mesh_cases,
}


def mesh_study(
    meshes: dict[str, Resolution] | None = None,
    template: Case | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> list[dict]:
    """Return one row for the free and one for the blocked muscle on each mesh: angle, force, unknowns and seconds.

    Args:
        meshes: by name; default :data:`MESHES`.
        template: all but the mesh and the plate.
        report: told one line per finished muscle.
    """
    rows = []
    for name, case in mesh_cases(meshes, template).items():
        rows.append(run_case(name, case))
        report(row_text(rows[-1]))
    return rows


def run_case(name: str, case: Case) -> dict:
    """Return what one muscle does on the way to 100 kPa, and its shape there.

    ``theta_deg`` is the tip's angle, ``force_n`` the normal force on the plate and ``drag_n`` the one along the muscle;
    ``cut_mm`` the deformed cut y = 0 as quadrilaterals (x, z), ``sections_mm`` those of the crest and the valley in the
    muscle's middle (x, y, in the section's own axes). A muscle that stops earlier has the reason under ``failure`` and
    the values of its last equilibrium.
    """
    began_s = time.process_time()
    muscle, gravity = case.muscle(), (0.0, 0.0, case.gravity_factor * UPRIGHT[2])
    states: list[MuscleState] = []
    failure = None
    try:
        states.append(muscle.standing(gravity))
        muscle.moved(states[0], muscle.inflated_loads(NOMINAL_MPA, gravity), states.append)
    except LoadStepError as error:
        failure = str(error)
    last = states[-1] if states else muscle.rest()
    return {
        "name": name,
        "case": asdict(case),
        "unknowns": muscle.unknown_count,
        "cells": len(muscle.mesh.cells),
        "cpu_s": round(time.process_time() - began_s, 1),
        "weight_n": muscle.mass_kg * GRAVITY_M_S2,
        "p_kpa": _p_kpa(last),
        "theta_deg": math.degrees(last.tip_angle_rad),
        "force_n": -float(last.plate_force_n[0]),
        "drag_n": float(last.plate_force_n[2]),
        "gas_volume_mm3": last.gas_volume_mm3,
        "failure": failure,
        "curve": {
            "p_kpa": [_p_kpa(state) for state in states],
            "theta_deg": [math.degrees(state.tip_angle_rad) for state in states],
            "force_n": [-float(state.plate_force_n[0]) for state in states],
        },
        "cut_mm": _cut(muscle, last).round(3).tolist(),
        "sections_mm": [section.round(3).tolist() for section in _sections(muscle, last)],
    }


def _p_kpa(state: MuscleState) -> float:
    return 1e3 * state.loads.pressures_gauge_mpa[0]


def unit_cells_deg(case: Case) -> float:
    """Return the bend of as many unit cells as the case's muscle has, at 100 kPa without weight."""
    cell = UnitCell(case.geometry, case.pattern, case.resolution)
    return math.degrees(cell.free_bend(NOMINAL_MPA).angle_rad) * cell.angle_per_muscle


def cases_of(names: Iterable[str]) -> dict[str, Case]:
    """Return all cases of studies, by name."""
    return {name: case for study in names for name, case in STUDIES[study]().items()}


def case_row(name: str, case: Case) -> dict:
    """Return :func:`run_case`, beside as many unit cells where the muscle is free and weightless."""
    row = run_case(name, case)
    if case.gravity_factor == 0.0 and case.friction is None:
        row["unit_cells_deg"] = unit_cells_deg(case)
    return row


def run_studies(names: Iterable[str], path: Path, executor: Executor, progress: Progress) -> list[dict]:
    """Run all cases of the studies and keep ``path`` up to date; return every muscle that it then holds.

    What it holds, also of other studies, is not run again.

    Raises:
        ResultFileError: ``path`` is no result of this command.
    """
    results = ResultFile(path, {"versions": library_versions()}, "muscles", lambda row: row["name"])
    cases = cases_of(names)
    for name, case in cases.items():
        if name in results.rows and results.rows[name]["case"] != asdict(case):
            del results.rows[name]
    jobs = {name: (name, case) for name, case in cases.items()}
    held = {name: () for name in results.rows if name not in jobs}
    run_jobs({**held, **jobs}, case_row, results, executor, progress, row_text, s_per_job=_S_PER_MUSCLE)
    return list(results.write([*held, *jobs])["muscles"])


def row_text(row: dict) -> str:
    """Return one line about a muscle."""
    text = f"{row['name']:>24}: {row['unknowns']:6d} unknowns, {row['cpu_s']:6.1f} s, theta {row['theta_deg']:7.2f} deg"
    if row["case"]["friction"] is not None:
        text += f", force {row['force_n']:.4f} N, drag {row['drag_n']:+.4f} N"
    if "unit_cells_deg" in row:
        cells = row["unit_cells_deg"]
        text += f", unit cells {cells:.2f} deg ({100 * (row['theta_deg'] / cells - 1):+.2f} %)"
    return text + (f"; stopped at {row['p_kpa']:.1f} kPa" if row["failure"] else "")


def draw(rows: Sequence[dict], folder: Path) -> list[Path]:
    """Write pictures of the deformed cuts, of sections and of the curves; return their paths.

    Raises:
        PictureError: matplotlib is not installed, or a file cannot be written.
    """
    columns = min(4, len(rows))
    grid = math.ceil(len(rows) / columns), columns
    shapes, sections = (new_figure(4 * columns, height * grid[0]) for height in (4.5, 3.5))
    from matplotlib.collections import PolyCollection

    for index, row in enumerate(rows):
        axes = shapes.add_subplot(*grid, index + 1)
        axes.add_collection(PolyCollection(row["cut_mm"], facecolor="tab:gray", edgecolor="k", linewidth=0.15))
        title = f"{row['name']}\n{row['theta_deg']:.1f} deg"
        if row["case"]["friction"] is not None:
            axes.axvline(-row["case"]["geometry"]["outer_radius_mm"], color="tab:red", linewidth=1.0)
            title += f", {row['force_n']:.3f} N"
        axes.set(xlabel="x [mm]", ylabel="z [mm]", title=title)
        flat = sections.add_subplot(*grid, index + 1)
        for quads, side in zip(row["sections_mm"], (1.0, -1.0), strict=True):
            mirrored = np.array(quads) * (1.0, side)
            flat.add_collection(PolyCollection(list(mirrored), facecolor="tab:gray", edgecolor="k", linewidth=0.3))
        flat.set(xlabel="x [mm]", ylabel="valley   |   crest", title=row["name"])
        for drawn in (axes, flat):
            drawn.set_aspect("equal")
            drawn.autoscale_view()
    curves = new_figure(11, 4.5)
    theta, force = curves.subplots(1, 2)
    for row in rows:
        blocked = row["case"]["friction"] is not None
        curve = row["curve"]
        (force if blocked else theta).plot(
            curve["p_kpa"], curve["force_n" if blocked else "theta_deg"], marker=".", label=row["name"]
        )
    for axes, text in ((theta, "tip angle [deg]"), (force, "force on the plate [N]")):
        axes.set(xlabel="gauge pressure [kPa]", ylabel=text)
        axes.grid(True)
        if axes.lines:
            axes.legend(fontsize="small")
    paths = []
    for name, figure in (("shapes", shapes), ("sections", sections), ("curves", curves)):
        paths.append(folder / f"whole_muscle_{name}.png")
        save_figure(figure, paths[-1])
    return paths


def _cut(muscle: WholeMuscle, state: MuscleState) -> np.ndarray:
    """Deformed faces of cells in the plane y = 0, shape (faces, 4, 2), corners in order around each."""
    corners = muscle.mesh.cells[:, :8]
    on_plane = muscle.mesh.points_mm[corners, 1] == 0.0
    quads = []
    for side in ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)):
        quads.append(corners[on_plane[:, side].all(axis=1)][:, side])
    return state.positions_mm[np.concatenate(quads)][:, :, [0, 2]]


def _sections(muscle: WholeMuscle, state: MuscleState) -> list[np.ndarray]:
    """Faces of cells in the planes of the middle crest and of the valley after it, shapes (faces, 4, 2).

    In the planes' own axes.
    """
    geometry, frames = muscle.geometry, muscle.frames
    crest_mm = muscle.ends.length_mm + (geometry.wave_count // 2) * geometry.wave_length_mm
    corners = muscle.mesh.cells[:, :4]  # the face of a cell that is toward the base
    found = []
    for z_mm in (crest_mm, crest_mm + 0.5 * geometry.wave_length_mm):
        plane = int(np.abs(frames.z_mm - z_mm).argmin())
        along = state.positions_mm @ frames.rotations(state.positions_mm)[plane, :, 0]
        faces = corners[(np.abs(muscle.mesh.points_mm[corners, 2] - frames.z_mm[plane]) < 1e-6).all(axis=1)]
        quads = np.stack([along[faces], state.positions_mm[faces, 1]], axis=-1)
        found.append(quads - (quads[..., 0].mean(), 0.0))
    return found
