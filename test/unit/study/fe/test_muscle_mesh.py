import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.mesh import CellGeometry, CellGeometryError, Resolution
from mbpam_ros.study.fe.muscle_mesh import EndPieces, muscle_mesh

GEOMETRY = CellGeometry(wave_count=2.0, active_length_mm=14.0)
SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
FINE = Resolution(wave=32, wall=1, arm=2, spoke=4, sector=8)
ENDS = {"solid": EndPieces(6.0, 6.0), "hollow": EndPieces(6.0, 2.0)}
BOTH_ENDS = pytest.mark.parametrize("ends", ENDS.values(), ids=ENDS)
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])
BOTH_ELEMENTS = pytest.mark.parametrize("quadratic", [False, True], ids=["trilinear", "quadratic"])
SIDES = (((1, 2, 5, 6), (0, 3, 4, 7)), ((2, 3, 6, 7), (0, 1, 4, 5)), ((4, 5, 6, 7), (0, 1, 2, 3)))


def cell_volumes(mesh):
    """Of the hexahedra of the corner nodes, by the Jacobian in their middle."""
    corner = mesh.points_mm[mesh.cells[:, :8]]
    edge = [corner[:, list(high)].mean(axis=1) - corner[:, list(low)].mean(axis=1) for high, low in SIDES]
    return np.einsum("ei,ei->e", np.cross(edge[0], edge[1]), edge[2])


def divergence_theorem_volume(mesh, chamber):
    """1/3 int x . n dA over flat triangles around each face's middle: another way than the cubic form's."""
    corner = mesh.points_mm[mesh.faces[chamber][:, :4]]
    middle = corner.mean(axis=1)
    return sum(
        float(np.einsum("fi,fi->", middle, np.cross(corner[:, i], corner[:, (i + 1) % 4]))) / 6.0 for i in range(4)
    )


@BOTH_ENDS
@BOTH_PATTERNS
@BOTH_ELEMENTS
def test_cells_have_volume_and_blocks_share_their_nodes(pattern, ends, quadratic):
    mesh = muscle_mesh(GEOMETRY, Resolution(4, 1, 2, 2, 2, quadratic), pattern, ends)
    assert cell_volumes(mesh).min() > 0.0
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points_mm)))
    assert cKDTree(mesh.points_mm).query(mesh.points_mm, k=2)[0][:, 1].min() > 0.05
    assert mesh.length_mm == pytest.approx(26.0)


@BOTH_ENDS
@pytest.mark.parametrize("arm", [1, 2])
@BOTH_ELEMENTS
def test_the_full_section_has_its_chambers_where_they_belong_and_twice_the_halfs_solid(arm, ends, quadratic):
    full, half = (muscle_mesh(GEOMETRY, Resolution(4, 1, arm, 2, 2, quadratic), each, ends) for each in ("full", "pdc"))
    assert cell_volumes(full).min() > 0.0
    assert cell_volumes(full).sum() == pytest.approx(2.0 * cell_volumes(half).sum(), rel=1e-12)
    assert np.array_equal(np.unique(full.cells), np.arange(len(full.points_mm)))
    for chamber, faces in full.faces.items():
        x, y, _ = full.points_mm[faces].mean(axis=(0, 1))
        assert math.degrees(math.atan2(y, x)) % 360.0 == pytest.approx(90.0 * chamber - 45.0)
        volume = ChamberVolume(faces)
        closed = volume.value(full.points_mm + (3.0, 5.0, -7.0))
        assert closed == pytest.approx(volume.value(full.points_mm), rel=1e-9)
        assert closed == pytest.approx(ChamberVolume(half.faces[2]).value(half.points_mm), rel=1e-9)
    tip = full.points_mm[full.tip_face]
    assert np.all(tip[..., 2] == full.length_mm)
    assert len(tip) == 2 * len(half.tip_face)


@BOTH_ENDS
@BOTH_PATTERNS
def test_solid_and_gas_fill_half_the_muscle(pattern, ends):
    mesh = muscle_mesh(GEOMETRY, FINE, pattern, ends)
    gas = sum(ChamberVolume(faces).value(mesh.points_mm) for faces in mesh.faces.values())
    z = GEOMETRY.active_length_mm * (np.arange(200) + 0.5) / 200
    waves = 0.5 * math.pi * np.mean(GEOMETRY.outer_radius_at(z) ** 2) * GEOMETRY.active_length_mm
    assert cell_volumes(mesh).sum() + gas == pytest.approx(waves + 0.5 * math.pi * 100.0 * 12.0, rel=3e-3)


@BOTH_ENDS
@BOTH_PATTERNS
def test_a_chambers_cubic_form_is_the_volume_its_surface_encloses_wherever_the_muscle_stands(pattern, ends):
    mesh = muscle_mesh(GEOMETRY, SMALL, pattern, ends)
    for chamber, faces in mesh.faces.items():
        volume = ChamberVolume(faces)
        assert volume.value(mesh.points_mm) == pytest.approx(divergence_theorem_volume(mesh, chamber), rel=1e-9)
        along_the_plane = mesh.points_mm + (3.0, 0.0, -7.0)
        assert volume.value(along_the_plane) == pytest.approx(volume.value(mesh.points_mm), rel=1e-9)


@BOTH_PATTERNS
def test_hollow_ends_hold_more_gas_by_the_crests_section(pattern):
    solid, hollow = (muscle_mesh(GEOMETRY, FINE, pattern, ends) for ends in ENDS.values())
    gas = [ChamberVolume(mesh.faces[2]).value(mesh.points_mm) for mesh in (solid, hollow)]
    section = float(GEOMETRY.chamber_area_at(np.zeros(1))[0])
    assert gas[1] - gas[0] == pytest.approx(8.0 * section, rel=5e-3)
    assert solid.cell_in_end.sum() > hollow.cell_in_end.sum() > 0


def test_the_tips_skin_is_the_tip_ends_outer_surface():
    mesh = muscle_mesh(GEOMETRY, SMALL, "pdc", ENDS["solid"])
    skin = mesh.points_mm[mesh.tip_skin]
    assert np.hypot(skin[:, 0], skin[:, 1]) == pytest.approx(10.0)
    assert skin[:, 2].min() > 20.0 and skin[:, 2].max() == pytest.approx(26.0)


@pytest.mark.parametrize("wrong", [{"cap_mm": 20.0}, {"length_mm": 0.0}, {"density_factor": -1.0}])
def test_ends_that_cannot_be_are_refused(wrong):
    with pytest.raises(ValueError):
        EndPieces(**wrong)


def test_a_muscle_that_does_not_end_in_a_crest_is_refused_and_so_is_a_mesh_that_cannot_fill_a_cap():
    with pytest.raises(CellGeometryError, match="whole waves"):
        muscle_mesh(CellGeometry(wave_count=2.5), SMALL, "pdc")
    with pytest.raises(CellGeometryError, match="filling a cap"):
        muscle_mesh(GEOMETRY, Resolution(spoke=1), "pdc")
    with pytest.raises(CellGeometryError, match="cuts the core's quarters"):
        muscle_mesh(GEOMETRY, Resolution(arm=1), "psc")
    with pytest.raises(ValueError, match="pdc, psc, full"):
        muscle_mesh(GEOMETRY, SMALL, "all")


@BOTH_ENDS
def test_a_muscle_with_fillets_has_cells_of_positive_volume(ends):
    geometry = CellGeometry(wave_count=2.0, active_length_mm=14.0, wave_fillet_mm=1.5, corner_fillet_mm=0.5)
    mesh = muscle_mesh(geometry, Resolution(wave=4), "pdc", ends)
    assert cell_volumes(mesh).min() > 0.0
    assert cKDTree(mesh.points_mm).query(mesh.points_mm, k=2)[0][:, 1].min() > 0.05
