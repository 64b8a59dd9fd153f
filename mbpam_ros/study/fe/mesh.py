"""Structured hexahedral mesh of the muscle's unit cell: half a wave (or more), half or all of the cross-section.

Its octant blocks also make the whole muscle (:mod:`~mbpam_ros.study.fe.muscle_mesh`).

Muscle frame in millimetres: z along the muscle from a crest at z = 0. The outer radius is a cosine wave whose crests
keep the muscle's radius R, the wall has the radial thickness c, the chambers are sharp-cornered sectors between the
arms of a cross of thickness b:

    r_o(z) = R - a/2 (1 - cos(2 pi z / lambda)),   r_i = r_o - c,   chamber 1: x, y > b/2, r < r_i,
    lambda = active length / number of waves.

Crests and valleys may be circular instead, and the chambers' corners rounded (:mod:`~mbpam_ros.study.fe.fillets`).

One octant of the section (0 to 45 deg) is meshed with five blocks - three in the core of the cross, one in the arm,
one in the wall - then mirrored and turned. With an odd number of elements across half an arm the core is one block of
each quarter instead. Of a half section the bending plane is y = 0 and the mesh fills y >= 0. It
holds chambers 1 and 2 for ``pdc`` (4 and 3 are their mirror images); for ``psc`` the muscle is turned by -45 deg and
half of chamber 1, all of chamber 2 and half of chamber 3 are in it (4 is the image of 2). ``full`` is all of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.section import outer_radius
from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.fe.fillets import ChamberOutline, filleted_wave_depth_mm, largest_wave_fillet_mm
from mbpam_ros.study.fe.tetrahedra import CUT, cut_cells

PATTERNS = ("pdc", "psc")
SECTIONS = {"pdc": range(0, 4), "psc": range(1, 5), "full": range(0, 8)}
"""The octants of the section that are meshed; the first one is turned to begin at y = 0."""
TETRAHEDRA = ("single", "grouped")
_SAME_POINT_MM = 1e-7

# Node offsets of a cell, a face and an edge, in the node order of VTK (and FElupe), in half cells.
_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_CELL_MIDDLES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
_CELL_MIDDLES += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]
_FACE_CORNERS = [(0, 0), (2, 0), (2, 2), (0, 2)]
_FACE_MIDDLES = [(1, 0), (2, 1), (1, 2), (0, 1)]


class CellGeometryError(MbpamError, ValueError):
    """These lengths do not make a muscle."""


@dataclass(frozen=True)
class CellGeometry:
    """The muscle's waved part, in the paper's millimetres.

    Args:
        a_mm: full peak-to-valley amplitude of the wave.
        b_mm: thickness of the cross-shaped base layer.
        c_mm: radial thickness of the chamber wall. The paper does not state its value; 2.3 is our reading.
        wave_count: number of waves n over the active length (our reading: 14).
        active_length_mm: waved length.
        outer_radius_mm: radius at the crests.
        wave_fillet_mm: radius of crests and valleys, between which the flanks are straight; None: the cosine.
        corner_fillet_mm: radius of the chambers' corners at the cross and between arm and wall; 0: sharp.

    Raises:
        CellGeometryError: the chambers would vanish in the valleys, or a fillet has no room.
        ValueError: a length is not positive and finite.
    """

    a_mm: float = 2.5
    b_mm: float = 2.0
    c_mm: float = 2.3
    wave_count: float = 14.0
    active_length_mm: float = 100.0
    outer_radius_mm: float = 10.0
    wave_fillet_mm: float | None = None
    corner_fillet_mm: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, "b_mm", "c_mm", "wave_count", "active_length_mm", "outer_radius_mm")
        if not 0.0 <= self.a_mm < self.outer_radius_mm:
            raise CellGeometryError(f"amplitude a = {self.a_mm} mm is not within 0 .. {self.outer_radius_mm} mm")
        valley_mm = self.outer_radius_mm - self.a_mm - self.c_mm
        if valley_mm <= 1.05 * math.sqrt(0.5) * self.b_mm:
            raise CellGeometryError(
                f"no chamber is left in the valleys: inner radius {valley_mm:g} mm, corner of the cross at "
                f"{math.sqrt(0.5) * self.b_mm:g} mm; make a, b or c smaller"
            )
        self._require_room_for_fillets(valley_mm)

    def _require_room_for_fillets(self, valley_mm: float) -> None:
        if self.wave_fillet_mm is not None:
            largest_mm = largest_wave_fillet_mm(self.a_mm, self.wave_length_mm) if self.a_mm else math.inf
            if not 0.0 < self.wave_fillet_mm <= largest_mm:
                raise CellGeometryError(
                    f"wave_fillet_mm = {self.wave_fillet_mm} is not within 0 .. {largest_mm:.4g} mm, above which no "
                    "flank is left between crest and valley"
                )
        if not self.corner_fillet_mm >= 0.0:
            raise CellGeometryError(f"corner_fillet_mm must not be negative, found {self.corner_fillet_mm}")
        side_mm = 0.5 * self.b_mm + self.corner_fillet_mm
        if self.corner_fillet_mm and not math.sqrt(2.0) * side_mm < valley_mm - self.corner_fillet_mm:
            raise CellGeometryError(
                f"corner fillets of {self.corner_fillet_mm} mm meet in the valleys, where the wall's inner radius is "
                f"{valley_mm:g} mm; make them smaller"
            )

    @property
    def wave_length_mm(self) -> float:
        """Length of one wave [mm]."""
        return self.active_length_mm / self.wave_count

    def outer_radius_at(self, z_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the outer radius [mm] at ``z_mm``, a crest being at 0."""
        if self.wave_fillet_mm is not None and self.a_mm:
            return self.outer_radius_mm - filleted_wave_depth_mm(
                z_mm, self.a_mm, self.wave_length_mm, self.wave_fillet_mm
            )
        return outer_radius(z_mm, self.outer_radius_mm, self.a_mm, self.wave_length_mm)

    def chamber_area_at(self, z_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the area [mm2] of one chamber's section: a quarter disc without the arms of the cross."""
        return self.chamber_outline(self.outer_radius_at(z_mm)).area_mm2()

    def chamber_outline(self, outer_mm: NDArray[np.float64]) -> ChamberOutline:
        """Return the outline of a chamber's octant where the outer radius is ``outer_mm``, shape (k,)."""
        return ChamberOutline(0.5 * self.b_mm, outer_mm - self.c_mm, self.corner_fillet_mm)

    def settings(self) -> dict[str, object]:
        """Return what tells this geometry from others; one without fillets says nothing of them."""
        fields = asdict(self)
        if self.wave_fillet_mm is None:
            del fields["wave_fillet_mm"]
        if self.corner_fillet_mm == 0.0:
            del fields["corner_fillet_mm"]
        return fields


@dataclass(frozen=True)
class Resolution:
    """Numbers of elements, and their kind.

    Args:
        wave: along one wave (even).
        wall: through the chamber wall.
        arm: across half an arm of the cross; odd only where whole quarters are meshed (not ``psc``).
        spoke: along an arm, from the core to the wall.
        sector: around half a chamber.
        quadratic: 20-node hexahedra with reduced integration instead of trilinear ones with mean dilatation.
        tetrahedra: cut every trilinear hexahedron into 24 linear tetrahedra; ``single``: with a dilatation of each,
            ``grouped``: with the mean dilatation of the 24.

    Raises:
        ValueError: a number is not positive, or odd where it must be even; tetrahedra of an unknown kind, or quadratic.
    """

    wave: int = 8
    wall: int = 2
    arm: int = 2
    spoke: int = 4
    sector: int = 3
    quadratic: bool = False
    tetrahedra: str | None = None

    def __post_init__(self) -> None:
        require_positive(self, "wave", "wall", "arm", "spoke", "sector")
        if self.wave % 2:
            raise ValueError(f"wave = {self.wave} must be even")
        if self.tetrahedra is not None:
            if self.tetrahedra not in TETRAHEDRA:
                raise ValueError(f"unknown tetrahedra {self.tetrahedra!r}; known: {', '.join(TETRAHEDRA)}")
            if self.quadratic:
                raise ValueError("tetrahedra are cut from trilinear hexahedra; leave quadratic out")

    def settings(self) -> dict[str, object]:
        """Return what tells this mesh from others; hexahedra say nothing of tetrahedra."""
        fields = asdict(self)
        if self.tetrahedra is None:
            del fields["tetrahedra"]
        return fields


CONVERGED = Resolution(wave=10, wall=2, arm=2, spoke=3, sector=3, quadratic=True)
"""The default of the unit cell: within 1 % of the free bend of finer ones (``mbpam fe mesh``)."""

FAST = Resolution(wave=8, wall=2, arm=2, spoke=4, sector=3)
"""Trilinear, five times as fast; with the same wall it bends 5 to 25 % too little."""


@dataclass(frozen=True, eq=False)
class CellMesh:
    """Mesh of a unit cell between the planes z = 0 and z = ``length_mm``.

    Args:
        points_mm: shape (nodes, 3), all in y >= 0 but for the full section.
        cells: node numbers, shape (cells, 8 or 20), VTK order; of tetrahedra (cells, 4 or 15), the latter in groups
            (:mod:`~mbpam_ros.study.fe.tetrahedra`).
        faces: per meshed chamber (1 to 4) the wall faces, shape (faces, 4 or 8), normal pointing out of the gas; of
            tetrahedra (faces, 5), four triangles around the last node.
        on_arm: per chamber whether a face belongs to an arm of the cross; the others belong to the outer wall.
        rims: per chamber the edges around its opening at z = ``length_mm``, shape (edges, 2 or 3; the middle node
            last), counter-clockwise around the gas seen from +z.
        length_mm: of the cell.
    """

    points_mm: NDArray[np.float64]
    cells: NDArray[np.int64]
    faces: dict[int, NDArray[np.int64]]
    on_arm: dict[int, NDArray[np.bool_]]
    rims: dict[int, NDArray[np.int64]]
    length_mm: float


def unit_cell_mesh(geometry: CellGeometry, resolution: Resolution, section: str, half_waves: int = 1) -> CellMesh:
    """Return the mesh of ``half_waves`` half waves, beginning at a crest; ``section`` is ``pdc``, ``psc`` or ``full``.

    Raises:
        ValueError: unknown section, or no half wave.
    """
    if section not in SECTIONS:
        raise ValueError(f"unknown section {section!r}; known: {', '.join(SECTIONS)}")
    if half_waves < 1:
        raise ValueError(f"half_waves must be at least 1, found {half_waves}")
    length = 0.5 * half_waves * geometry.wave_length_mm
    order = 2 if resolution.quadratic else 1
    z = np.linspace(0.0, length, resolution.wave // 2 * half_waves * order + 1)
    outer = geometry.outer_radius_at(z)
    blocks, patches = octant_blocks(geometry, resolution, z, outer)
    nodes = numbered_section(blocks, patches, section, order, quarter_blocks(geometry, resolution, z, outer))
    rims: dict[int, list[NDArray[np.int64]]] = {}
    on_arm: dict[int, list[NDArray[np.bool_]]] = {}
    for index, (chamber, ids) in enumerate(nodes.walls):
        count = math.prod((size - 1) // order for size in ids.shape)
        on_arm.setdefault(chamber, []).append(np.full(count, index % len(patches) == 0))  # the arm's patch comes first
        rim = ids[:, -1]
        ends = [rim[:-1:order], rim[order::order]] + ([rim[1::order]] if order == 2 else [])
        rims.setdefault(chamber, []).append(np.stack(ends, axis=1))
    points, cells, faces = nodes.points_mm, np.concatenate(nodes.cells), nodes.faces()
    if resolution.tetrahedra:
        points, cells, faces = cut_cells(points, cells, faces)
        cells = cells[:, CUT].reshape(-1, 4) if resolution.tetrahedra == "single" else cells
    return CellMesh(
        points_mm=points,
        cells=cells,
        faces=faces,
        on_arm={chamber: np.concatenate(parts) for chamber, parts in on_arm.items()},
        rims={chamber: np.concatenate(parts) for chamber, parts in rims.items()},
        length_mm=length,
    )


def octant_blocks(
    geometry: CellGeometry, resolution: Resolution, z: NDArray[np.float64], outer: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return blocks (i, j, k, 3) of the solid and patches (s, k, 3) of the chamber's boundary in 0 to 45 deg.

    The blocks are three in the core (unless :func:`quarter_blocks` fill it), the arm and the wall; the patches are the
    arm's side and the wall's. Every block's (i, j, k) is right-handed; every patch runs counter-clockwise around the
    gas.

    Args:
        z, outer: node planes and the outer radius on each [mm], shape (planes,).

    Raises:
        CellGeometryError: too few elements for rounded corners.
    """
    order = 2 if resolution.quadratic else 1
    half, inner = 0.5 * geometry.b_mm, outer - geometry.c_mm
    outline = geometry.chamber_outline(outer)
    arm, wall = order * resolution.arm, order * resolution.wall
    if geometry.corner_fillet_mm and min(resolution.spoke, resolution.sector) < 2:
        raise CellGeometryError("rounded corners take two elements or more along the spoke and around the sector")

    corners = np.array([[0.0, 0.0], [half, 0.0], [outline.cross_mm, outline.cross_mm]])
    middle = corners.mean(axis=0)
    blocks = []
    for index in range(0 if arm_is_odd(resolution) else 3):  # a triangle cut into three quadrilaterals
        here, after, before = corners[index], corners[(index + 1) % 3], corners[index - 1]
        flat = bilinear(here, 0.5 * (here + after), middle, 0.5 * (here + before), (arm // 2, arm // 2))
        blocks.append(extruded(np.broadcast_to(flat[:, :, None, :], (*flat.shape[:2], z.size, 2)), z))

    across = np.linspace(0.0, 1.0, arm + 1)[:, None]
    joint = outline.joint_mm
    radius = (1.0 - across) * inner + across * np.hypot(*joint.T)  # of the arm's far side, (j, k)
    y = across * joint[:, 1]
    far_side = np.stack([np.sqrt(radius**2 - y**2), y], axis=-1)
    near_side = np.linspace(np.broadcast_to(corners[1], joint.shape), np.broadcast_to(corners[2], joint.shape), arm + 1)
    arm_side = outline.arm_side_mm(resolution.spoke, order)
    along = np.linspace(0.0, 1.0, len(arm_side))[:, None, None]
    bottom = (1.0 - along[:, 0]) * half + along[:, 0] * inner
    middle_line = np.stack([bottom, np.zeros_like(bottom)], axis=-1)
    arm_block = extruded(coons(middle_line, arm_side, near_side, far_side), z)

    wall_side = np.concatenate([far_side, outline.wall_side_mm(resolution.sector, order)[1:]])
    angle, radius = np.arctan2(wall_side[..., 1], wall_side[..., 0]), np.hypot(wall_side[..., 0], wall_side[..., 1])
    radius = radius + np.linspace(0.0, 1.0, wall + 1)[:, None, None] * (outer - radius)
    wall_block = extruded(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1), z)
    return [*blocks, arm_block, wall_block], [arm_block[:, -1], wall_block[0, arm:]]


def quarter_blocks(
    geometry: CellGeometry, resolution: Resolution, z: NDArray[np.float64], outer: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return the blocks (i, j, k, 3) of the solid in 0 to 90 deg that no octant has: the core, if ``arm`` is odd.

    Args:
        z, outer: as for :func:`octant_blocks`.
    """
    if not arm_is_odd(resolution):
        return []
    half, cross = 0.5 * geometry.b_mm, geometry.chamber_outline(outer).cross_mm
    across = (2 if resolution.quadratic else 1) * resolution.arm
    corners = (np.zeros(2), np.array([half, 0.0]), np.full(2, cross), np.array([0.0, half]))
    flat = bilinear(*corners, (across, across))
    return [extruded(np.broadcast_to(flat[:, :, None, :], (*flat.shape[:2], z.size, 2)), z)]


def arm_is_odd(resolution: Resolution) -> bool:
    """Whether the core of the cross is meshed quarter by quarter instead of octant by octant."""
    return resolution.arm % 2 == 1


def coons(
    bottom: NDArray[np.float64], top: NDArray[np.float64], left: NDArray[np.float64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return Coons' patch of four sides, shape (i, j, ...).

    Bottom and top, (i, ...), go along the first index, left and right, (j, ...), along the second.
    """
    s = np.linspace(0.0, 1.0, len(bottom)).reshape(-1, 1, *(1,) * (bottom.ndim - 1))
    t = np.linspace(0.0, 1.0, len(left)).reshape(1, -1, *(1,) * (left.ndim - 1))
    ruled = (1 - t) * bottom[:, None] + t * top[:, None] + (1 - s) * left[None] + s * right[None]
    corners = (1 - s) * ((1 - t) * bottom[0] + t * top[0]) + s * ((1 - t) * bottom[-1] + t * top[-1])
    return ruled - corners


def bilinear(
    p00: NDArray[np.float64],
    p10: NDArray[np.float64],
    p11: NDArray[np.float64],
    p01: NDArray[np.float64],
    counts: tuple[int, int],
) -> NDArray[np.float64]:
    """Return points of the quadrilateral, shape (counts[0] + 1, counts[1] + 1, 2)."""
    s = np.linspace(0.0, 1.0, counts[0] + 1)[:, None, None]
    t = np.linspace(0.0, 1.0, counts[1] + 1)[None, :, None]
    return (1 - s) * (1 - t) * p00 + s * (1 - t) * p10 + s * t * p11 + (1 - s) * t * p01


def extruded(section: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a section (i, j, k, 2) with z appended."""
    return np.concatenate([section, np.broadcast_to(z[:, None], (*section.shape[:-1], 1))], axis=-1)


def _placed(points: NDArray[np.float64], octant: int, first: int) -> NDArray[np.float64]:
    """Move points of octant 0 to ``octant`` of a muscle turned by ``-45 first`` deg, orientation kept."""
    if octant % 2:  # the mirror image in the line x = y
        points = points[::-1][..., [1, 0, 2]]
    angle = 0.25 * np.pi * (2 * (octant // 2) - first)
    cosine, sine = math.cos(angle), math.sin(angle)
    turned = points.copy()
    turned[..., 0] = cosine * points[..., 0] - sine * points[..., 1]
    turned[..., 1] = sine * points[..., 0] + cosine * points[..., 1]
    return turned


@dataclass(frozen=True, eq=False)
class NumberedBlocks:
    """Blocks and patches of half or all of the muscle, coinciding points numbered once.

    Args:
        points_mm: shape (nodes, 3).
        cells: of each block, in the order given.
        walls: of each patch the chamber and the node numbers, shape (s, t).
        order: 1 or 2, of the elements.
    """

    points_mm: NDArray[np.float64]
    cells: list[NDArray[np.int64]]
    walls: list[tuple[int, NDArray[np.int64]]]
    order: int

    def faces(self) -> dict[int, NDArray[np.int64]]:
        """Return the faces of every chamber, shape (faces, 4 or 8)."""
        offsets = _FACE_CORNERS + (_FACE_MIDDLES if self.order == 2 else [])
        faces: dict[int, list[NDArray[np.int64]]] = {}
        for chamber, ids in self.walls:
            faces.setdefault(chamber, []).append(_elements(ids, offsets, self.order))
        return {chamber: np.concatenate(parts) for chamber, parts in faces.items()}


def numbered_section(
    blocks: list[NDArray[np.float64]],
    patches: list[NDArray[np.float64]],
    section: str,
    order: int,
    quarters: Sequence[NDArray[np.float64]] = (),
) -> NumberedBlocks:
    """Return the octant's blocks and patches placed in all octants of a section (``SECTIONS``), and numbered.

    Nodes no element has are dropped.

    Args:
        quarters: blocks that fill both octants of a quarter.

    Raises:
        CellGeometryError: the section cuts quarters.
    """
    octants = SECTIONS[section]
    if quarters and octants[0] % 2:
        raise CellGeometryError(f"the section {section!r} cuts the core's quarters: make arm even, or mesh all of it")
    solids = [_placed(block, octant, octants[0]) for octant in octants for block in blocks]
    solids += [_placed(block, octant, octants[0]) for octant in octants if octant % 2 == 0 for block in quarters]
    walls = [(octant // 2 + 1, _placed(patch, octant, octants[0])) for octant in octants for patch in patches]
    arrays = [*solids, *(patch for _, patch in walls)]
    points = np.concatenate([array.reshape(-1, 3) for array in arrays])
    _, kept, number = np.unique(
        np.round(points / _SAME_POINT_MM).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    numbers = np.split(number.ravel(), np.cumsum([array[..., 0].size for array in arrays])[:-1])
    numbers = [ids.reshape(array.shape[:-1]) for ids, array in zip(numbers, arrays, strict=True)]
    offsets = _CORNERS + (_CELL_MIDDLES if order == 2 else [])
    cells = [_elements(ids, offsets, order) for ids in numbers[: len(solids)]]
    used = np.unique(np.concatenate(cells))
    new_number = np.full(kept.size, -1)
    new_number[used] = np.arange(used.size)
    positions = points[kept[used]]
    positions[np.abs(positions) < _SAME_POINT_MM] = 0.0
    return NumberedBlocks(
        points_mm=positions,
        cells=[new_number[part] for part in cells],
        walls=[(chamber, new_number[ids]) for (chamber, _), ids in zip(walls, numbers[len(solids) :], strict=True)],
        order=order,
    )


def _elements(ids: NDArray[np.int64], offsets: Sequence[tuple[int, ...]], order: int) -> NDArray[np.int64]:
    """Node numbers of all elements of a block of nodes, shape (elements, len(offsets))."""
    counts = [(size - 1) // order for size in ids.shape]
    columns = []
    for offset in offsets:
        starts = [step * order // 2 for step in offset]
        window = tuple(slice(s, s + order * (n - 1) + 1, order) for s, n in zip(starts, counts, strict=True))
        columns.append(ids[window].ravel())
    return np.stack(columns, axis=1)
