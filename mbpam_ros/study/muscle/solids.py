"""Solids of a muscle, its moulds and the palm as closed triangle meshes, by manifold3d; files of them.

manifold3d (Apache-2.0, the library of OpenSCAD's and Blender's exact Booleans) is taken because every result of its
Booleans is a closed, oriented manifold by construction, it is one wheel without a CAD kernel behind it, and its volumes
are exact for the mesh; build123d would bring 300 MB of OpenCASCADE for rounds that no mould here has.

Millimetres. The muscle's axis is z, its base at z = 0; chambers lie at 45, 135, 225 and 315 deg.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.stl import binary_stl
from mbpam_ros.study.result_file import write_bytes

if TYPE_CHECKING:
    from manifold3d import Manifold

Array = NDArray[np.float64]

SEGMENTS = 120
"""Sides of what is round: an inscribed polygon of so many has 0.05 % less area than its circle."""

_PER_WAVE = 16


class SolidError(MbpamError, ValueError):
    """No solid can be made of these lengths; the message says what to change."""


def outer_body(drawing: MuscleDrawing, lower_mm: float = 0.0) -> Manifold:
    """Return the muscle without chambers; ``lower_mm`` takes it in by that everywhere but at its ends' faces."""
    z, radius = _profile(drawing)
    points = [(0.0, float(z[0])), *zip((radius - lower_mm).tolist(), z.tolist(), strict=True), (0.0, float(z[-1]))]
    return _revolved(points)


def chamber(drawing: MuscleDrawing, draft_rad: float = 0.0) -> Manifold:
    """Return the chamber at 45 deg: beside the arms of the cross, within the wall, along the waves.

    Args:
        drawing: of the muscle.
        draft_rad: by what its face along the y arm leans back, so that a core comes out along y.
    """
    z, radius = _profile(drawing)
    low, high = drawing.end_length_mm, drawing.end_length_mm + drawing.active_length_mm
    within = (z >= low) & (z <= high)
    rho = radius[within] - drawing.c_mm
    points = [(0.0, low), *zip(rho.tolist(), z[within].tolist(), strict=True), (0.0, high)]
    half = 0.5 * drawing.b_mm
    lean = float(np.tan(draft_rad))
    solid = _revolved(points).trim_by_plane((0.0, 1.0, 0.0), half)
    size = float(np.hypot(1.0, lean))
    return solid.trim_by_plane((1.0, -lean, 0.0), (half - lean * half) / size)


def muscle_solid(drawing: MuscleDrawing) -> Manifold:
    """Return the muscle as it is drawn."""
    solid = outer_body(drawing)
    core = chamber(drawing)
    for turn_deg in (0.0, 90.0, 180.0, 270.0):
        solid -= core.rotate((0.0, 0.0, turn_deg))
    return solid


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Manifold:
    """Return the box between two corners."""
    from manifold3d import Manifold

    size = np.subtract(high, low)
    return Manifold.cube(tuple(float(each) for each in size)).translate(low)


def pin(x: float, z: float, y_from: float, y_to: float, diameter: float) -> Manifold:
    """Return a cylinder along y at (x, z)."""
    from manifold3d import Manifold

    upright = Manifold.cylinder(y_to - y_from, 0.5 * diameter, circular_segments=32)
    return upright.rotate((-90.0, 0.0, 0.0)).translate((x, y_from, z))


def is_sound(solid: Manifold) -> bool:
    """Whether a solid's mesh is closed and oriented, each edge in two triangles, and has a positive volume."""
    triangles = np.asarray(solid.to_mesh().tri_verts, dtype=np.int64)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = (np.sort(a * (edges.max() + 1) + b) for a, b in (edges.T, edges[:, ::-1].T))
    closed = np.array_equal(there, back) and bool((np.diff(there) > 0).all())
    return closed and solid.volume() > 0.0


def write_stl(solid: Manifold, path: Path) -> None:
    """Write binary STL [mm].

    Raises:
        ResultFileError: its folder is missing or cannot be written.
    """
    write_bytes(path, binary_stl(_corners(solid)))


def write_3mf(solid: Manifold, path: Path) -> None:
    """Write 3MF [mm].

    Raises:
        ResultFileError: it cannot be written.
    """
    mesh = solid.to_mesh()
    vertices = "".join(
        f'<vertex x="{x:.5f}" y="{y:.5f}" z="{z:.5f}"/>' for x, y, z in mesh.vert_properties[:, :3].tolist()
    )
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.tri_verts.tolist())
    model = (
        '<?xml version="1.0" encoding="UTF-8"?><model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        '<resources><object id="1" type="model"><mesh>'
        f"<vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    types = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
    )
    relations = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        '<Relationship Id="rel0" Target="/3D/3dmodel.model" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
    )
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as parts:
        for name, text in (("[Content_Types].xml", types), ("_rels/.rels", relations), ("3D/3dmodel.model", model)):
            parts.writestr(name, text)
    write_bytes(path, archive.getvalue())


def _corners(solid: Manifold) -> Array:
    """Corners of the triangles, shape (n, 3, 3)."""
    mesh = solid.to_mesh()
    points = np.asarray(mesh.vert_properties, dtype=float)[:, :3]
    return points[np.asarray(mesh.tri_verts, dtype=np.int64)]


def _profile(drawing: MuscleDrawing) -> tuple[Array, Array]:
    """Heights and outer radii from base to tip; the waves begin and end at a crest."""
    end, length = drawing.end_length_mm, drawing.active_length_mm
    count = int(round(_PER_WAVE * drawing.wave_count)) + 1
    along = np.linspace(0.0, length, count)
    z = np.concatenate([[0.0], end + along, [2.0 * end + length]])
    crest = drawing.outer_radius_mm
    radius = np.concatenate([[crest], drawing.outer_radius_at_mm(along), [crest]])
    return z, radius


def _revolved(points: list[tuple[float, float]]) -> Manifold:
    from manifold3d import CrossSection, Manifold

    return Manifold.revolve(CrossSection([points]), SEGMENTS)
