"""The shape of a bent muscle: its unit cells, each bent as the weight lets it, set one on the other.

A cell ends in two plane sections; the next half wave is its mirror image in the end plane. In the frame of a plane
(origin on the axis, x in the bending plane, z along the muscle) a cell's end frame is moved by h along z and turned by
phi about y; seen from its end plane a mirrored cell is turned first and then moved by h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.fe.design_run import Run
from mbpam_ros.study.fe.law import BendingLaw
from mbpam_ros.study.fe.mesh import CellMesh
from mbpam_ros.study.fe.posture import upright_bends_rad
from mbpam_ros.study.fe.unit_cell import UnitCell

_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_END_SECTIONS = 24


@dataclass(frozen=True, eq=False)
class MuscleShape:
    """A muscle in the paper's posture. Lengths in mm; the bending plane is y = 0 and the bend goes toward -x.

    Args:
        pattern: ``pdc`` or ``psc``.
        pressure_kpa: in the pressurised chambers.
        tip_angle_deg: angle between the two straight ends.
        tip_mm, tip_direction: middle of the tip's face, and the unit vector out of it; shape (3,).
        surface_mm: quadrilaterals of the waved part's outer surface, shape (n, 4, 3).
        stretch: largest principal stretch of each, shape (n,).
        ends_mm: quadrilaterals of the straight ends, which do not deform, shape (m, 4, 3).
        sections_mm: element faces of the cell at mid length on its ``crest`` and ``valley`` plane, first at rest then
            deformed, in the plane's own x and y, shape (2, k, 4, 2).
    """

    pattern: str
    pressure_kpa: float
    tip_angle_deg: float
    tip_mm: NDArray[np.float64]
    tip_direction: NDArray[np.float64]
    surface_mm: NDArray[np.float64]
    stretch: NDArray[np.float64]
    ends_mm: NDArray[np.float64]
    sections_mm: dict[str, NDArray[np.float64]]


def muscle_shapes(run: Run, pressures_kpa: list[float]) -> list[MuscleShape]:
    """Return the muscle's shape at each of the rising pressures.

    Raises:
        LoadStepError, LawError, PostureError: no equilibrium was found.
    """
    cell = run.cell()
    state, shapes = cell.rest(), []
    for pressure_kpa in pressures_kpa:
        state = cell.free_bend(1e-3 * pressure_kpa, state)
        law = BendingLaw(cell, [state])
        count = round(cell.angle_per_muscle)
        stations = (np.arange(count) + 0.5) / count
        bends = upright_bends_rad(law, run.geometry, run.end_length_mm, run.end_weight_factor, stations)
        unknowns = [law.unknowns_at(bend) for bend in bends]
        shapes.append(_shape(run, cell, pressure_kpa, unknowns))
    return shapes


def _shape(run: Run, cell: UnitCell, pressure_kpa: float, unknowns: list[NDArray[np.float64]]) -> MuscleShape:
    """Set the cells, given from the clamp to the tip, on each other."""
    faces = outer_faces(cell.mesh)
    rest = cell.mesh.points_mm[faces]
    origin, frame = np.array([0.0, 0.0, run.end_length_mm]), np.eye(3)
    ends = [_straight_end(run, np.zeros(3), np.eye(3))]
    surface, stretch, angle = [], [], 0.0
    for index, values in enumerate(unknowns):
        points = cell.positions_mm(values)
        phi, height = float(values[-2]), float(points[-1, 2])
        turn = np.array([[math.cos(phi), 0, -math.sin(phi)], [0, 1, 0], [math.sin(phi), 0, math.cos(phi)]])
        up = np.array([0.0, 0.0, height])
        if index % 2:  # seen from the end plane, and mirrored in it
            local = (points[:-1] - up) @ turn * (1.0, 1.0, -1.0)
            step = turn @ up
        else:
            local, step = points[:-1], up
        quads = local[faces]
        stretch.append(_largest_stretch(rest, quads))
        surface.append(origin + quads @ frame.T)
        origin, frame, angle = origin + frame @ step, frame @ turn, angle + phi
    ends.append(_straight_end(run, origin, frame))
    half = np.concatenate(surface)
    middle = cell.positions_mm(unknowns[len(unknowns) // 2])
    return MuscleShape(
        pattern=run.pattern,
        pressure_kpa=float(pressure_kpa),
        tip_angle_deg=math.degrees(angle),
        tip_mm=origin + run.end_length_mm * frame[:, 2],
        tip_direction=frame[:, 2],
        surface_mm=np.concatenate([half, half * (1.0, -1.0, 1.0)]),
        stretch=np.tile(np.concatenate(stretch), 2),
        ends_mm=np.concatenate(ends),
        sections_mm=_sections(cell, middle),
    )


def outer_faces(mesh: CellMesh) -> NDArray[np.int64]:
    """Return the corner nodes of the element faces on the muscle's outer surface, shape (n, 4).

    Those of one element only, neither on the cell's planes z = 0, z = length and y = 0 nor on a chamber's wall.
    """
    corners, points = mesh.cells[:, :8], mesh.points_mm
    faces = np.concatenate([corners[:, face] for face in _FACES])
    walls = np.concatenate([wall[:, :4] for wall in mesh.faces.values()])
    both = np.sort(np.concatenate([faces, walls]), axis=1)
    _, number, times = np.unique(both, axis=0, return_inverse=True, return_counts=True)
    alone = times[number.ravel()[: len(faces)]] == 1
    flat = np.zeros(len(faces), dtype=bool)
    for axis, value in ((1, 0.0), (2, 0.0), (2, mesh.length_mm)):
        flat |= np.isclose(points[faces, axis], value).all(axis=1)
    return faces[alone & ~flat]


def _largest_stretch(rest: NDArray[np.float64], deformed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest principal stretch in the middle of quadrilaterals of shape (n, 4, 3).

    Root of the largest eigenvalue of g0^-1 g, with the metrics g = (t_i . t_j) of the middle lines.
    """
    metrics = []
    for quads in (rest, deformed):
        p0, p1, p2, p3 = np.moveaxis(quads, 1, 0)
        lines = np.stack([p1 + p2 - p0 - p3, p2 + p3 - p0 - p1], axis=1)  # (n, 2, 3)
        metrics.append(lines @ lines.swapaxes(1, 2))
    ratio = np.linalg.solve(metrics[0], metrics[1])
    half_trace = 0.5 * np.trace(ratio, axis1=1, axis2=2)
    return np.sqrt(half_trace + np.sqrt(np.maximum(half_trace**2 - np.linalg.det(ratio), 0.0)))


def _straight_end(run: Run, origin: NDArray[np.float64], frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quadrilaterals of a cylinder of the crest's radius that begins at ``origin``: its skin and its far face."""
    angle = np.linspace(0.0, 2.0 * np.pi, _END_SECTIONS + 1)
    circle = run.geometry.outer_radius_mm * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    top = circle + (0.0, 0.0, run.end_length_mm)
    centre = np.broadcast_to((0.0, 0.0, run.end_length_mm), top[1:].shape)
    skin = np.stack([circle[:-1], circle[1:], top[1:], top[:-1]], axis=1)
    lid = np.stack([top[:-1], top[1:], centre, centre], axis=1)
    return origin + np.concatenate([skin, lid]) @ frame.T


def _sections(cell: UnitCell, points: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    mesh = cell.mesh
    faces = np.concatenate([mesh.cells[:, :8][:, face] for face in _FACES])
    sections = {}
    for name, z in (("crest", 0.0), ("valley", mesh.length_mm)):
        here = faces[np.isclose(mesh.points_mm[faces, 2], z).all(axis=1)]
        rest, moved = mesh.points_mm[here][..., :2], points[here]
        x = moved[..., 0]
        if z:
            x = np.hypot(x, moved[..., 2] - points[-1, 2]) * np.where(x < 0.0, -1.0, 1.0)
        half = np.stack([rest, np.stack([x, moved[..., 1]], axis=-1)])
        sections[name] = np.concatenate([half, half * (1.0, -1.0)], axis=1)
    return sections
