"""Unit cells of linear tetrahedra, each with a dilatation of its own or 24 with one."""

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.design_run import Run, settings
from mbpam_ros.study.fe.material import Silicone, YeohMaterial
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution, unit_cell_mesh
from mbpam_ros.study.fe.muscle_mesh import muscle_mesh
from mbpam_ros.study.fe.solid_body import SolidBody
from mbpam_ros.study.fe.tetrahedra import CUT, FACES
from mbpam_ros.study.fe.unit_cell import UnitCell

HEXAHEDRA = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
SINGLE, GROUPED = (replace(HEXAHEDRA, tetrahedra=kind) for kind in ("single", "grouped"))
BOTH_KINDS = pytest.mark.parametrize("resolution", [SINGLE, GROUPED], ids=["single", "grouped"])
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])
PRESSURE_MPA = 0.02


def mesh_of(resolution, pattern="pdc"):
    return unit_cell_mesh(CellGeometry(), resolution, pattern)


def tetrahedra_of(mesh):
    return mesh.cells if mesh.cells.shape[1] == 4 else mesh.cells[:, CUT].reshape(-1, 4)


def body_of(mesh, silicone=None):
    return SolidBody(mesh.points_mm, mesh.cells, silicone or Silicone())


def gas_volumes(mesh, points):
    covered = np.vstack([points, [0.0, 0.0, mesh.length_mm]])
    cover = len(points)
    return [ChamberVolume(mesh.faces[c], mesh.rims[c], cover).value(covered) for c in mesh.faces]


@BOTH_PATTERNS
@BOTH_KINDS
def test_solid_and_gas_have_the_volumes_of_the_hexahedra(resolution, pattern):
    mesh, uncut = mesh_of(resolution, pattern), mesh_of(HEXAHEDRA, pattern)
    corner = mesh.points_mm[tetrahedra_of(mesh)]
    volumes = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6.0
    assert volumes.min() > 0.0
    volume = body_of(uncut).nodal_volumes_mm3(np.ones(len(uncut.cells))).sum()
    assert volumes.sum() == pytest.approx(volume, rel=1e-12)
    shares = body_of(mesh).nodal_volumes_mm3(np.ones(len(mesh.cells)))
    quarters = np.bincount(tetrahedra_of(mesh).ravel(), np.repeat(volumes / 4.0, 4))
    assert shares == pytest.approx(quarters, rel=1e-12)
    assert gas_volumes(mesh, mesh.points_mm) == pytest.approx(gas_volumes(uncut, uncut.points_mm), rel=1e-12)


@BOTH_PATTERNS
def test_neighbours_share_whole_triangles_and_the_gas_touches_only_triangles_of_the_surface(pattern):
    mesh, uncut = mesh_of(GROUPED, pattern), mesh_of(HEXAHEDRA, pattern)
    quads = Counter(tuple(sorted(quad)) for cell in uncut.cells for quad in cell[FACES].tolist())
    sides = Counter(tuple(sorted(side)) for cell in tetrahedra_of(mesh).tolist() for side in combinations(cell, 3))
    assert set(sides.values()) == {1, 2}
    alone, alone_quads = (sum(count == 1 for count in shared.values()) for shared in (sides, quads))
    assert alone == 4 * alone_quads
    edges = Counter(edge for side, count in sides.items() if count == 1 for edge in combinations(side, 2))
    assert set(edges.values()) == {2}  # the surface is closed
    for faces in mesh.faces.values():
        for *corners, middle in faces.tolist():
            assert all(sides[tuple(sorted((corners[i], corners[i - 1], middle)))] == 1 for i in range(4))


def test_middles_of_faces_in_the_cells_planes_lie_in_them():
    mesh, uncut = mesh_of(GROUPED), mesh_of(HEXAHEDRA)
    for axis, place in ((1, 0.0), (2, 0.0), (2, mesh.length_mm)):
        corners = (uncut.points_mm[uncut.cells][..., axis] == place).sum(axis=1)
        nodes, cut_nodes = (int((m.points_mm[:, axis] == place).sum()) for m in (uncut, mesh))
        assert cut_nodes == nodes + np.count_nonzero(corners == 4)


@BOTH_KINDS
def test_an_affine_deformation_has_the_energy_of_its_gradient_and_no_force_inside(resolution):
    mesh, silicone = mesh_of(resolution), Silicone()
    gradient = np.eye(3) + 0.1 * np.random.default_rng(2).standard_normal((3, 3))
    x = mesh.points_mm @ gradient.T
    body = body_of(mesh, silicone)
    density = YeohMaterial(silicone, with_volume=True).energy(gradient)
    volume = body.nodal_volumes_mm3(np.ones(len(mesh.cells))).sum()
    assert body.energy(x) == pytest.approx(density * volume, rel=1e-9)
    middles = np.unique(tetrahedra_of(mesh)[:, 3])  # of the hexahedra
    forces = body.forces(x)
    assert np.abs(forces[middles]).max() < 1e-9 * np.abs(forces).max()


def disturbed(cell):
    rng = np.random.default_rng(5)
    unknowns = cell.rest().unknowns + 0.01 * rng.standard_normal(cell.unknown_count)
    unknowns[-2:] = 0.03, 0.1
    return unknowns, rng.standard_normal(cell.unknown_count)


@BOTH_PATTERNS
@BOTH_KINDS
def test_forces_and_symmetric_tangent_are_slopes_of_the_potential(resolution, pattern):
    cell = UnitCell(CellGeometry(), pattern, resolution)
    unknowns, direction = disturbed(cell)
    step = 1e-6
    ahead, behind = (unknowns + sign * step * direction for sign in (1.0, -1.0))
    slope = (cell.potential_n_mm(ahead, PRESSURE_MPA) - cell.potential_n_mm(behind, PRESSURE_MPA)) / (2 * step)
    assert slope == pytest.approx(cell.forces(unknowns, PRESSURE_MPA) @ direction, rel=1e-6)
    slope = (cell.forces(ahead, PRESSURE_MPA) - cell.forces(behind, PRESSURE_MPA)) / (2 * step)
    tangent = cell.tangent(unknowns, PRESSURE_MPA)
    assert np.abs(tangent @ direction - slope).max() < 1e-7 * np.abs(slope).max()
    assert abs(tangent - tangent.T).max() < 1e-14 * abs(tangent).max()


@BOTH_PATTERNS
@BOTH_KINDS
def test_without_pressure_nothing_bends(resolution, pattern):
    cell = UnitCell(CellGeometry(), pattern, resolution)
    assert np.abs(cell.forces(cell.rest().unknowns, 0.0)).max() < 1e-12
    assert cell.free_bend(0.0).angle_rad == 0.0


@BOTH_KINDS
def test_pressure_inflates_the_chambers_lengthens_the_muscle_and_bends_it_away(resolution):
    cell = UnitCell(CellGeometry(), "pdc", resolution)
    state = cell.free_bend(PRESSURE_MPA)
    assert np.abs(cell.forces(state.unknowns, PRESSURE_MPA)).max() < 1e-7
    assert state.gas_volume_mm3 > 1.05 * cell.rest().gas_volume_mm3
    assert state.axis_stretch > 1.002
    assert state.angle_rad > 0.0


def test_one_dilatation_for_24_tetrahedra_keeps_them_from_locking():
    """Ten times less compressible, silicone bends as it did; tetrahedra with dilatations of their own do not."""
    kept = {}
    for resolution in (SINGLE, GROUPED):
        soft, stiff = (
            UnitCell(CellGeometry(), "pdc", resolution, Silicone(bulk_mpa=bulk)).free_bend(PRESSURE_MPA).angle_rad
            for bulk in (50.0, 500.0)
        )
        kept[resolution.tetrahedra] = stiff / soft
    assert kept["grouped"] == pytest.approx(1.0, abs=0.03)
    assert kept["single"] < 0.8


def test_the_mesh_is_told_apart_in_settings_and_hexahedra_are_as_before():
    assert settings(Run(CellGeometry(), "pdc", GROUPED))["resolution"]["tetrahedra"] == "grouped"
    assert "tetrahedra" not in settings(Run(CellGeometry(), "pdc", HEXAHEDRA))["resolution"]


@pytest.mark.parametrize(("fields", "word"), [({"tetrahedra": "ten"}, "single, grouped"), ({"quadratic": True}, "cut")])
def test_tetrahedra_that_cannot_be_are_refused(fields, word):
    with pytest.raises(ValueError, match=word):
        replace(SINGLE, **fields)


def test_the_whole_muscle_takes_no_tetrahedra():
    with pytest.raises(ValueError, match="hexahedra only"):
        muscle_mesh(CellGeometry(), GROUPED, "pdc")
