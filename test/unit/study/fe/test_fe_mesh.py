import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mbpam_ros.study.fe.chamber_volume import ChamberVolume
from mbpam_ros.study.fe.mesh import CellGeometry, CellGeometryError, Resolution, unit_cell_mesh

GEOMETRY = CellGeometry()
BOTH_ELEMENTS = pytest.mark.parametrize("quadratic", [False, True], ids=["trilinear", "quadratic"])
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])


def simpson(values, length):
    weights = np.ones(values.size)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    return float(weights @ values) * length / (values.size - 1) / 3.0


def exact_chamber_volume(length):
    return simpson(GEOMETRY.chamber_area_at(np.linspace(0.0, length, 201)), length)


def chamber_volume(mesh, chamber):
    points = np.vstack([mesh.points_mm, [0.0, 0.0, mesh.length_mm]])
    return ChamberVolume(mesh.faces[chamber], mesh.rims[chamber], len(points) - 1).value(points)


def cell_volumes(mesh):
    """Of the hexahedra of the corner nodes, by the Jacobian in their middle."""
    corner = mesh.points_mm[mesh.cells[:, :8]]
    edge = [corner[:, list(high)].mean(axis=1) - corner[:, list(low)].mean(axis=1) for high, low in SIDES]
    return np.einsum("ei,ei->e", np.cross(edge[0], edge[1]), edge[2])


SIDES = (((1, 2, 5, 6), (0, 3, 4, 7)), ((2, 3, 6, 7), (0, 1, 4, 5)), ((4, 5, 6, 7), (0, 1, 2, 3)))


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_every_cell_has_positive_volume_and_every_node_belongs_to_one(pattern, quadratic):
    mesh = unit_cell_mesh(GEOMETRY, Resolution(quadratic=quadratic), pattern)
    assert cell_volumes(mesh).min() > 0.0
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points_mm)))


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_blocks_share_their_nodes(pattern, quadratic):
    mesh = unit_cell_mesh(GEOMETRY, Resolution(quadratic=quadratic), pattern)
    nearest = cKDTree(mesh.points_mm).query(mesh.points_mm, k=2)[0][:, 1]
    assert nearest.min() > 0.05


@BOTH_PATTERNS
def test_solid_and_gas_fill_half_the_muscle(pattern):
    mesh = unit_cell_mesh(GEOMETRY, Resolution(wave=32, wall=2, arm=2, spoke=6, sector=12), pattern)
    z = np.linspace(0.0, mesh.length_mm, 201)
    half_muscle = simpson(0.5 * math.pi * GEOMETRY.outer_radius_at(z) ** 2, mesh.length_mm)
    gas = sum(chamber_volume(mesh, chamber) for chamber in mesh.faces)
    assert cell_volumes(mesh).sum() + gas == pytest.approx(half_muscle, rel=2e-3)


def test_a_chamber_holds_the_volume_its_geometry_has():
    coarse, fine = (
        chamber_volume(unit_cell_mesh(GEOMETRY, Resolution(wave=wave, sector=sector), "pdc"), 1)
        for wave, sector in ((16, 6), (32, 12))
    )
    exact = exact_chamber_volume(0.5 * GEOMETRY.wave_length_mm)
    assert abs(fine - exact) < 2e-3 * exact
    assert abs(coarse - exact) == pytest.approx(4.0 * abs(fine - exact), rel=0.1)  # second order


def test_quadratic_faces_follow_the_chamber_much_closer():
    mesh = unit_cell_mesh(GEOMETRY, Resolution(quadratic=True), "pdc")
    assert chamber_volume(mesh, 1) == pytest.approx(exact_chamber_volume(mesh.length_mm), rel=1e-3)


def test_half_chambers_lie_on_the_symmetry_plane_of_a_single_chamber():
    mesh = unit_cell_mesh(GEOMETRY, Resolution(), "psc")
    first, second, third = (chamber_volume(mesh, chamber) for chamber in (1, 2, 3))
    assert first == pytest.approx(0.5 * second, rel=1e-9)
    assert third == pytest.approx(first, rel=1e-9)


@pytest.mark.parametrize(
    "lengths", [{"a_mm": 7.0, "c_mm": 2.0}, {"a_mm": -1.0}, {"b_mm": 8.0}], ids=["deep", "negative", "thick cross"]
)
def test_a_muscle_without_room_for_chambers_is_refused(lengths):
    with pytest.raises(CellGeometryError):
        CellGeometry(**lengths)


@pytest.mark.parametrize("counts", [{"wave": 7}, {"arm": 0}, {"wall": 0}])
def test_a_mesh_that_cannot_be_is_refused(counts):
    with pytest.raises(ValueError):
        Resolution(**counts)


def test_an_unknown_pattern_is_refused():
    with pytest.raises(ValueError, match="pdc, psc"):
        unit_cell_mesh(GEOMETRY, Resolution(), "all")


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_a_mesh_with_fillets_fills_half_the_muscle_with_solid_and_gas(pattern, quadratic):
    geometry = CellGeometry(wave_fillet_mm=1.5, corner_fillet_mm=0.5)
    fine = Resolution(wave=32, wall=2, arm=2, spoke=6, sector=12, quadratic=quadratic)
    mesh = unit_cell_mesh(geometry, fine, pattern)
    assert cell_volumes(mesh).min() > 0.0
    z = np.linspace(0.0, mesh.length_mm, 201)
    half_muscle = simpson(0.5 * math.pi * geometry.outer_radius_at(z) ** 2, mesh.length_mm)
    gas = sum(chamber_volume(mesh, chamber) for chamber in mesh.faces)
    assert gas == pytest.approx(2.0 * simpson(geometry.chamber_area_at(z), mesh.length_mm), rel=5e-3)
    assert cell_volumes(mesh).sum() + gas == pytest.approx(half_muscle, rel=2.5e-3)


def test_rounded_corners_ask_for_elements():
    with pytest.raises(CellGeometryError, match="two elements"):
        unit_cell_mesh(CellGeometry(corner_fillet_mm=0.4), Resolution(sector=1), "pdc")
