import math

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe import self_contact
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution, unit_cell_mesh
from mbpam_ros.study.fe.self_contact import SelfContact, clearance, fold_opening

THIN = CellGeometry(a_mm=1.8, b_mm=1.0)
UP = np.array([0.0, 0.0, 1.0])
SMALL = Resolution(wave=4, wall=1, arm=2, spoke=3, sector=3)


def positions(mesh):
    return np.vstack([mesh.points_mm, [0.0, 0.0, mesh.length_mm]])


def pressed_through(mesh, depth_mm):
    """The arm between chambers 1 and 2 bulged so far into chamber 2 that its middle is behind the wall."""
    x = positions(mesh)
    arms = np.unique(mesh.faces[2][mesh.on_arm[2]])
    near = arms[(mesh.points_mm[arms, 1] > 3.0) & (mesh.points_mm[arms, 1] < 6.5)]
    wall = np.unique(mesh.faces[2][~mesh.on_arm[2]])
    for node in near:
        level = wall[np.abs(mesh.points_mm[wall, 2] - x[node, 2]) < 1e-9]
        radius = np.hypot(*mesh.points_mm[level, :2].T).max()
        x[node, 0] = -math.sqrt(radius**2 - x[node, 1] ** 2) - depth_mm
    return x


@pytest.mark.parametrize("kind", [{}, {"quadratic": True}, {"tetrahedra": "grouped"}], ids=["8", "20", "tetrahedra"])
def test_arms_are_flat_and_walls_round(kind):
    mesh = unit_cell_mesh(THIN, Resolution(wave=4, wall=1, arm=2, spoke=3, sector=3, **kind), "pdc")
    for chamber, faces in mesh.faces.items():
        off_arm = (
            np.abs(np.abs(mesh.points_mm[faces][:, :4, :2]) - 0.5).min(axis=2).max(axis=1)
        )  # from |x| or |y| = b/2
        assert np.array_equal(off_arm < 1e-9, mesh.on_arm[chamber])
        assert 0 < mesh.on_arm[chamber].sum() < len(faces)


def test_at_rest_folds_are_open_and_the_gap_is_that_of_the_arms_last_node_from_the_wall():
    mesh = unit_cell_mesh(THIN, SMALL, "pdc")
    found = clearance(mesh, positions(mesh), UP, {1})
    assert found.fold_opening == pytest.approx(1.0)
    valley_mm = 10.0 - THIN.a_mm - THIN.c_mm
    spoke_mm = (math.sqrt(valley_mm**2 - 0.25) - 0.5) / SMALL.spoke
    assert 0.5 * spoke_mm < found.arm_gap_mm < 1.05 * spoke_mm


def test_an_arm_that_has_passed_through_the_wall_has_a_gap_as_deep_as_it_is_behind():
    mesh = unit_cell_mesh(THIN, SMALL, "pdc")
    x = pressed_through(mesh, 0.1)
    gap = clearance(mesh, x, UP, {1}).arm_gap_mm
    assert -0.3 < gap < -0.05  # the wall's triangles lie inside its circle
    assert clearance(mesh, x, UP, {1, 2}).arm_gap_mm == math.inf


def test_a_fold_closes_when_a_node_crosses_the_mirror_plane():
    mesh = unit_cell_mesh(THIN, SMALL, "pdc")
    x = positions(mesh)
    x[:-1, 2] *= 0.4
    assert fold_opening(mesh, x, UP) == pytest.approx(0.4)
    tilted = positions(mesh)
    steep = math.atan(2.0 * mesh.length_mm / 10.0)  # the end plane, turned about its middle, reaches the crest at -x
    assert fold_opening(mesh, tilted, np.array([-math.sin(steep), 0.0, math.cos(steep)])) < 0.0


@pytest.mark.parametrize("pattern", ["pdc", "psc"])
def test_nothing_is_felt_before_the_touch(pattern):
    mesh = unit_cell_mesh(THIN, SMALL, pattern)
    contact = SelfContact(mesh, set(mesh.faces))
    x = mesh.points_mm
    assert contact.energy(x) == 0.0
    assert not contact.forces(x).any()
    assert contact.tangent(x).nnz == 0


@pytest.fixture(scope="module")
def touching():
    mesh = unit_cell_mesh(THIN, SMALL, "pdc")
    x = pressed_through(mesh, 0.05)[:-1]
    x = x + 0.01 * np.random.default_rng(3).standard_normal(x.shape)
    return SelfContact(mesh, {2}), x


def test_the_contacts_forces_are_the_slope_of_its_energy(touching):
    contact, x = touching
    direction = np.random.default_rng(4).standard_normal(x.shape)
    ahead, behind = (contact.energy(x + sign * 1e-6 * direction) for sign in (1.0, -1.0))
    assert contact.energy(x) > 1e-3
    assert (ahead - behind) / 2e-6 == pytest.approx(np.sum(contact.forces(x) * direction), rel=1e-6)


def test_the_contacts_tangent_is_the_slope_of_its_forces_and_symmetric(touching):
    contact, x = touching
    direction = np.random.default_rng(5).standard_normal(x.shape)
    ahead, behind = (contact.forces(x + sign * 1e-6 * direction) for sign in (1.0, -1.0))
    slope = (ahead - behind).ravel() / 2e-6
    tangent = contact.tangent(x)
    assert tangent @ direction.ravel() == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())
    assert abs(tangent - tangent.T).max() < 1e-12 * abs(tangent).max()


def test_contact_pushes_apart_without_force_or_moment_on_the_whole(touching):
    contact, x = touching
    force = -contact.forces(x)
    assert np.abs(force).max() > 0.01
    assert force.sum(axis=0) == pytest.approx(0.0, abs=1e-12)
    assert np.cross(x, force).sum(axis=0) == pytest.approx(0.0, abs=1e-11)


def test_the_nearest_feature_and_the_gap_are_those_of_plain_geometry():
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.array([[0.7, 0.2, -0.3], [0.2, 0.7, 0.1], [1.3, 0.5, -0.4], [1.3, -0.4, 1.2]])
    nearest = self_contact._nearest(np.vstack([square, points]), np.arange(4, 8), np.array([[0, 1, 2], [0, 2, 3]]))
    assert nearest.gaps_mm == pytest.approx([0.3, -0.1, 0.5, -1.3])  # the normal, out of the gas, is +z
    features = [set(row[:n]) for row, n in zip(nearest.corners.tolist(), nearest.corner_count, strict=True)]
    assert features == [{0, 1, 2}, {0, 2, 3}, {1, 2}, {1}]


def test_the_contacts_slope_does_not_jump_where_a_node_slides_over_an_edge():
    """Onto a roof's other side and past its ridge, from behind; on the ridge the planes' distances have a kink."""
    roof = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, -0.5], [0.0, 1.0, -0.5], [1.0, -1.0, -0.5], [0.0, -1.0, -0.5]]
    )
    contact = object.__new__(SelfContact)
    contact._passes = [(np.array([6]), np.array([5.0]), np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 5, 4]]))]
    ways = [np.vstack([roof, [0.4, y, 0.05]]) for y in np.linspace(-0.05, 0.05, 201)]
    kinds = {touch.nodes.shape[1] for x in ways for touch in contact._touching(x)}
    forces = np.array([contact.forces(x) for x in ways])
    assert kinds == {3, 4}  # the ridge, and the triangles beside it
    assert np.abs(forces).max() > 0.1
    assert np.abs(np.diff(forces, axis=0)).max() < 0.01
    middle, direction = ways[100], np.random.default_rng(1).standard_normal((7, 3))
    ahead, behind = (contact.forces(middle + sign * 1e-6 * direction) for sign in (1.0, -1.0))
    assert contact.tangent(middle) @ direction.ravel() == pytest.approx((ahead - behind).ravel() / 2e-6, abs=1e-5)
