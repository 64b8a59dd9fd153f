"""Where the unit cell's walls come near each other, and frictionless contact of a chamber's arms with its wall.

*Folds.* Crest and valley planes are mirror planes, so neighbouring flanks touch where a node crosses one of them.
:func:`fold_opening` is the least distance of a node from a plane over that at rest: 1 as at rest, 0 at touch.

*Chambers.* The arms of the cross bulge into chambers without pressure and may come to rest on their wall. With g the
gap of a node of one surface from the plane of the nearest triangle of the other (negative: it has passed through), w
the node's area at rest and k a stiffness, the contact is the potential [N mm]

    E(x) = sum over nodes with g < 0 of k/2 w g^2,   g = -(x - a) . n,   n = N / |N|,   N = (b - a) x (c - a),

taken both ways, nodes of the arms on the wall and of the wall on the arms, with half the stiffness each. Its slope and
curvature hold for the triangles that are nearest now: Newton's method on it is a semi-smooth one. The penalty's error
is the penetration p / k under a contact pressure p: 0.02 mm at 100 kPa. Lengths in mm, forces in N.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.study.fe.mesh import CellMesh

STIFFNESS_N_MM3 = 5.0
_DEEPEST_MM = 0.5
"""Nodes farther behind a surface have not passed through it: they lie behind a part of it that faces elsewhere."""

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_j, _i, _k] = 1.0, -1.0

_LOCAL = np.kron(np.array([[1, -1, 0, 0], [0, -1, 1, 0], [0, -1, 0, 1]]), np.eye(3))
"""(x - a, b - a, c - a) of (x, a, b, c), components last."""

_TRIANGLES = {
    4: ((0, 1, 2), (0, 2, 3)),
    5: ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}


@dataclass(frozen=True)
class Clearance:
    """How near to touching a cell is.

    Args:
        fold_opening: see :func:`fold_opening`.
        arm_gap_mm: least distance of an arm's node from the wall of the same chamber, over the chambers without
            pressure; negative: the node has passed through.
    """

    fold_opening: float
    arm_gap_mm: float


def clearance(
    mesh: CellMesh, positions_mm: NDArray[np.float64], end_normal: NDArray[np.float64], pressurised: Set[int]
) -> Clearance:
    """Return the clearance of a deformed cell.

    Args:
        positions_mm: of the nodes, and of the end plane's centre in the last row.
        end_normal: unit normal of the end plane, away from the cell.
        pressurised: chambers whose arms bulge outward.
    """
    gaps_mm = []
    for chamber in set(mesh.faces) - pressurised:
        arms, wall = _arms_and_wall(mesh, chamber)
        gaps_mm.append(_gaps_mm(positions_mm, np.setdiff1d(arms, wall), wall)[2].min())
    return Clearance(fold_opening(mesh, positions_mm, end_normal), float(min(gaps_mm, default=np.inf)))


def fold_opening(mesh: CellMesh, positions_mm: NDArray[np.float64], end_normal: NDArray[np.float64]) -> float:
    """Return the least distance of a node from the crest or valley plane over that at rest; 0: folds touch."""
    now = positions_mm[:-1, 2], (positions_mm[-1] - positions_mm[:-1]) @ end_normal
    rest = mesh.points_mm[:, 2], mesh.length_mm - mesh.points_mm[:, 2]
    off_plane = [distance > 1e-9 * mesh.length_mm for distance in rest]
    return float(min((n[off] / r[off]).min() for n, r, off in zip(now, rest, off_plane, strict=True)))


class SelfContact:
    """Contact of arms and wall in some chambers of a cell.

    Args:
        mesh: of the cell.
        chambers: those without pressure, whose arms may come to rest on the wall.
        stiffness_n_mm3: k.
    """

    def __init__(self, mesh: CellMesh, chambers: Set[int], stiffness_n_mm3: float = STIFFNESS_N_MM3) -> None:
        self._passes = []
        for chamber in sorted(chambers):
            arms, wall = _arms_and_wall(mesh, chamber)
            for own, other in ((arms, wall), (wall, arms)):
                nodes = np.setdiff1d(own, other)
                areas = _nodal_areas_mm2(mesh.points_mm, own)[nodes]
                self._passes.append((nodes, 0.5 * stiffness_n_mm3 * areas, other))

    def energy(self, x: NDArray[np.float64]) -> float:
        """Return E [N mm] of nodes at ``x``, shape (nodes, 3)."""
        return float(sum(0.5 * weights @ gaps**2 for _, weights, gaps in self._touching(x)))

    def forces(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dE/dx [N], shape (nodes, 3)."""
        force = np.zeros_like(x)
        for nodes, weights, gaps in self._touching(x):
            slope, _ = _gap_derivatives(x[nodes])
            np.add.at(force, nodes, (weights * gaps)[:, None, None] * slope.reshape(-1, 4, 3))
        return force

    def tangent(self, x: NDArray[np.float64]) -> csr_matrix:
        """Return d2E/dx2 [N/mm] over 3 node + component."""
        values, rows, columns = [np.zeros(0)], [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)]
        for nodes, weights, gaps in self._touching(x):
            slope, curvature = _gap_derivatives(x[nodes])
            block = weights[:, None, None] * (slope[:, :, None] * slope[:, None] + gaps[:, None, None] * curvature)
            degrees = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1, 12)
            values.append(block.ravel())
            rows.append(np.repeat(degrees, 12, axis=1).ravel())
            columns.append(np.tile(degrees, (1, 12)).ravel())
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return coo_matrix(entries, (x.size, x.size)).tocsr()

    def _touching(self, x: NDArray[np.float64]) -> list[tuple[NDArray, NDArray, NDArray]]:
        """Per pass node and triangle (n, 4), k times area (n,) and gap (n,) of the nodes that have passed through."""
        found = []
        for nodes, weights, triangles in self._passes:
            nearest, gaps, _ = _gaps_mm(x, nodes, triangles)
            touching = (gaps < 0.0) & (gaps > -_DEEPEST_MM)
            quadruples = np.column_stack([nodes, triangles[nearest]])[touching]
            found.append((quadruples, weights[touching], gaps[touching]))
        return found


def _arms_and_wall(mesh: CellMesh, chamber: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    on_arm = mesh.on_arm[chamber]
    return _triangles(mesh.faces[chamber][on_arm]), _triangles(mesh.faces[chamber][~on_arm])


def _triangles(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Flat triangles of faces of any kind, the same sides up, shape (triangles, 3)."""
    return np.concatenate([faces[:, list(corners)] for corners in _TRIANGLES[faces.shape[1]]])


def _nodal_areas_mm2(x: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (x[triangles[:, corner]] for corner in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(triangles.ravel(), np.repeat(third, 3), minlength=len(x))


def _gaps_mm(
    x: NDArray[np.float64], nodes: NDArray[np.int64], triangles: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The triangle nearest to each node, and the node's distances from its plane and from the triangle itself.

    Both count from the gas and are negative behind the triangle. Of triangles that share the nearest edge the one
    whose plane is farther is taken, so that the plane's distance does not jump where the nearest triangle changes.
    """
    points = x[nodes][:, None]
    a, b, c = (x[triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = np.sum((points - a) * normal, axis=2)  # (nodes, triangles), outward
    foot = points - height[:, :, None] * normal
    inside = np.ones(height.shape, dtype=bool)
    to_edges = np.full(height.shape, np.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        edge = end - begin
        inside &= np.sum((foot - begin) * np.cross(normal, edge), axis=2) >= 0.0
        part = np.clip(np.sum((points - begin) * edge, axis=2) / np.sum(edge**2, axis=1), 0.0, 1.0)
        to_edges = np.minimum(to_edges, np.linalg.norm(points - begin - part[:, :, None] * edge, axis=2))
    distance = np.where(inside, np.abs(height), to_edges)
    nearest = (distance - 1e-6 * np.abs(height)).argmin(axis=1)
    chosen = np.arange(nodes.size), nearest
    return nearest, -height[chosen], -np.copysign(distance[chosen], height[chosen])


def _gap_derivatives(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slope (n, 12) and curvature (n, 12, 12) of g over (x, a, b, c), positions (n, 4, 3).

    With p, u, v = x - a, b - a, c - a: g = -V / A, V = p . N, N = u x v, A = |N|.
    """
    p, u, v = corners[:, 0] - corners[:, 1], corners[:, 2] - corners[:, 1], corners[:, 3] - corners[:, 1]
    count = len(corners)
    n_vector = np.cross(u, v)
    area = np.linalg.norm(n_vector, axis=1)
    unit = n_vector / area[:, None]
    volume = np.sum(p * n_vector, axis=1)

    def turned(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.einsum("ijk,nk->nij", _LEVI_CIVITA, vector)

    d_volume = np.concatenate([n_vector, np.cross(v, p), np.cross(p, u)], axis=1)
    d_area = np.concatenate([np.zeros((count, 3)), np.cross(v, unit), np.cross(unit, u)], axis=1)
    d2_volume, d2_area = np.zeros((count, 9, 9)), np.zeros((count, 9, 9))
    for first, second, block in ((0, 3, turned(v)), (6, 0, turned(u)), (3, 6, turned(p))):
        d2_volume[:, first : first + 3, second : second + 3] += block
        d2_volume[:, second : second + 3, first : first + 3] += block.swapaxes(1, 2)
    d_normal = np.concatenate([turned(v), -turned(u)], axis=2)  # dN / d(u, v), (n, 3, 6)
    flat = (np.eye(3) - unit[:, :, None] * unit[:, None]) / area[:, None, None]
    d2_area[:, 3:, 3:] = np.einsum("nia,nij,njb->nab", d_normal, flat, d_normal)
    d2_area[:, 3:6, 6:] += turned(unit)
    d2_area[:, 6:, 3:6] += turned(unit).swapaxes(1, 2)

    ratio = volume / area
    slope = (d_volume - ratio[:, None] * d_area) / area[:, None]
    mixed = slope[:, :, None] * d_area[:, None]
    curvature = (d2_volume - ratio[:, None, None] * d2_area - mixed - mixed.swapaxes(1, 2)) / area[:, None, None]
    return -slope @ _LOCAL, -_LOCAL.T @ curvature @ _LOCAL
