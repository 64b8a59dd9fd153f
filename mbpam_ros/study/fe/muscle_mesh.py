"""Structured hexahedral mesh of the whole muscle, or of its half: the waves between two unwaved ends.

The octant blocks of :mod:`~mbpam_ros.study.fe.mesh` swept from the base z = 0 to the tip, with whole waves, so that a
crest of radius R meets either end. The chambers go on into the ends with the crest's section up to a cap of solid
silicone. In a cap a chamber's octant sector is filled with three blocks::

        M           C: corner of the cross, A: where arm and wall meet, M: middle of the chamber's wall
       /|           every corner has a block; they share a point in the middle
      / |
     C--A
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import require_positive
from mbpam_ros.study.fe.mesh import (
    SECTIONS,
    CellGeometry,
    CellGeometryError,
    Resolution,
    coons,
    extruded,
    numbered_section,
    octant_blocks,
    quarter_blocks,
)

_END_CELL_PER_WAVE_CELL = 2.0  # length; strains in the ends fall off over the muscle's radius
_TIP_FACE = {8: [4, 5, 6, 7], 20: [4, 5, 6, 7, 12, 13, 14, 15]}  # of a cell; its nodes run from the base to the tip


@dataclass(frozen=True)
class EndPieces:
    """The two unwaved ends, alike.

    Args:
        length_mm: of each.
        cap_mm: solid silicone at the far side of each; the chambers reach through the rest. As long as the end: solid.
        density_factor: density of the ends over the silicone's.

    Raises:
        ValueError: a length is not positive, the cap longer than the end, or the density negative.
    """

    length_mm: float = 15.0
    cap_mm: float = 15.0
    density_factor: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, "length_mm", "cap_mm")
        if self.cap_mm > self.length_mm:
            raise ValueError(f"the cap, {self.cap_mm} mm, is longer than the end, {self.length_mm} mm")
        if not self.density_factor >= 0.0:
            raise ValueError(f"density_factor must not be negative, found {self.density_factor}")


@dataclass(frozen=True, eq=False)
class MuscleMesh:
    """Mesh of the whole muscle or of its half y >= 0, base at z = 0.

    Args:
        points_mm: shape (nodes, 3).
        cells: node numbers, shape (cells, 8 or 20), VTK order.
        cell_in_end: whether a cell belongs to an end piece, shape (cells,).
        faces: per meshed chamber the faces of walls and caps, normal pointing out of the gas; in a half muscle the
            symmetry plane closes those it cuts.
        tip_skin: nodes of the tip end's outer surface.
        tip_face: the element faces of the tip's plane end, shape (faces, 4 or 8).
        length_mm: of the muscle.
    """

    points_mm: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_in_end: NDArray[np.bool_]
    faces: dict[int, NDArray[np.int64]]
    tip_skin: NDArray[np.int64]
    tip_face: NDArray[np.int64]
    length_mm: float


def muscle_mesh(
    geometry: CellGeometry, resolution: Resolution, section: str, ends: EndPieces | None = None
) -> MuscleMesh:
    """Return the mesh of the whole muscle (section ``full``) or of its half (``pdc``, ``psc``; ``SECTIONS``).

    Raises:
        ValueError: unknown section, or a resolution in tetrahedra.
        CellGeometryError: the number of waves is not whole, the mesh too coarse to fill a cap, or its arms cannot be
            meshed in this section.
    """
    ends = ends or EndPieces()
    if section not in SECTIONS:
        raise ValueError(f"unknown section {section!r}; known: {', '.join(SECTIONS)}")
    if resolution.tetrahedra:
        raise ValueError("the whole muscle is meshed with hexahedra only; tetrahedra are for the unit cell")
    if geometry.wave_count != round(geometry.wave_count):
        raise CellGeometryError(f"a muscle between two crests has whole waves, not {geometry.wave_count:g}")
    if min(resolution.spoke, resolution.sector) < 2:
        raise CellGeometryError("filling a cap takes two elements or more along the spoke and around the sector")
    order = 2 if resolution.quadratic else 1
    z, (gas_begin, gas_end) = _planes(geometry, resolution, ends, order)
    length = float(z[-1])
    waved = (z > ends.length_mm) & (z < length - ends.length_mm)
    outer = np.where(waved, geometry.outer_radius_at(z - ends.length_mm), geometry.outer_radius_mm)

    blocks, (arm_side, wall_side) = octant_blocks(geometry, resolution, z, outer)
    base, tip = (
        _filled_chamber(arm_side[:, 0, :2], wall_side[:, 0, :2], resolution, order, planes)
        for planes in (z[: gas_begin + 1], z[gas_end:])
    )
    gas = slice(gas_begin, gas_end + 1)
    patches = [arm_side[:, gas], wall_side[:, gas]]
    patches += [block[::-1, :, -1] for block in base] + [block[:, :, 0] for block in tip]
    quarters = quarter_blocks(geometry, resolution, z, outer)
    nodes = numbered_section([*blocks, *base, *tip], patches, section, order, quarters)
    cells = np.concatenate(nodes.cells)
    points = nodes.points_mm
    middle = points[cells[:, :8], 2].mean(axis=1)
    at_tip = np.isclose(points[cells[:, _TIP_FACE[8]], 2], length).all(axis=1)
    on_skin = np.isclose(np.hypot(points[:, 0], points[:, 1]), geometry.outer_radius_mm)
    return MuscleMesh(
        points_mm=points,
        cells=cells,
        cell_in_end=(middle < ends.length_mm) | (middle > length - ends.length_mm),
        faces=nodes.faces(),
        tip_skin=np.flatnonzero(on_skin & (points[:, 2] > length - ends.length_mm + 1e-6)),
        tip_face=cells[at_tip][:, _TIP_FACE[cells.shape[1]]],
        length_mm=length,
    )


def _planes(
    geometry: CellGeometry, resolution: Resolution, ends: EndPieces, order: int
) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Node planes from base to tip, and the numbers of the first and the last one of the chambers."""
    wave_cells = round(geometry.wave_count) * resolution.wave
    waves = np.linspace(0.0, geometry.active_length_mm, wave_cells * order + 1)
    cell_mm = _END_CELL_PER_WAVE_CELL * geometry.active_length_mm / wave_cells
    hollow_mm = ends.length_mm - ends.cap_mm
    cap = np.linspace(0.0, ends.cap_mm, max(1, round(ends.cap_mm / cell_mm)) * order + 1)
    hollow = np.linspace(0.0, hollow_mm, max(1, round(hollow_mm / cell_mm)) * order + 1) if hollow_mm else np.zeros(1)
    total = geometry.active_length_mm + 2.0 * ends.length_mm
    base = np.concatenate([cap, ends.cap_mm + hollow[1:]])
    z = np.concatenate([base, ends.length_mm + waves[1:-1], total - base[::-1]])
    return z, (cap.size - 1, z.size - cap.size)


def _filled_chamber(
    arm_side: NDArray[np.float64],
    wall_side: NDArray[np.float64],
    resolution: Resolution,
    order: int,
    z: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Blocks (i, j, k, 3) that fill the chamber's octant sector, whose sides have the nodes of (n, 2) arrays."""
    near_c = min((resolution.sector + 1) // 2, resolution.spoke - 1, resolution.sector - 1)
    c, a, m = order * near_c, order * (resolution.spoke - near_c), order * (resolution.sector - near_c)
    diagonal = np.linspace(wall_side[-1], arm_side[0], m + a + 1)
    on_arm, on_wall, on_diagonal = arm_side[c], wall_side[m], diagonal[a]
    middle = (on_arm + on_wall + on_diagonal) / 3.0

    def to_middle(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        return np.linspace(start, middle, count + 1)

    quarters = [
        coons(arm_side[: c + 1], to_middle(on_diagonal, c), diagonal[a:][::-1], to_middle(on_arm, m)),
        coons(wall_side[: m + 1], to_middle(on_arm, m), arm_side[c:][::-1], to_middle(on_wall, a)),
        coons(diagonal[: a + 1], to_middle(on_wall, a), wall_side[m:][::-1], to_middle(on_diagonal, c)),
    ]
    return [extruded(np.repeat(flat[:, :, None], z.size, axis=2), z) for flat in quarters]
