"""Where the unit cell's walls come near each other, and frictionless contact of a chamber's arms with its wall.

*Folds.* Crest and valley planes are mirror planes, so neighbouring flanks touch where a node crosses one of them.
:func:`fold_opening` is the least distance of a node from a plane over that at rest: 1 as at rest, 0 at touch.

*Chambers.* The arms of the cross bulge into chambers without pressure and may come to rest on their wall. With d the
distance of a node of one surface that has passed through the other from the nearest point of that one's triangles, w
the node's area at rest and k a stiffness, the contact is the potential [N mm]

    E(x) = sum over such nodes of k/2 w d^2,   d^2 = min over lambda of |r|^2,   r = x - a - sum_j lambda_j (v_j - a),

a and v_j the corners of the triangle, edge or corner that is nearest. It is taken both ways, nodes of the arms on the
wall and of the wall on the arms, with half the stiffness each. E has a continuous slope also where a node slides from
one triangle onto the next; its curvature follows from that of |r|^2 by elimination of lambda. The penalty's error is
the penetration p / k under a contact pressure p: 0.02 mm at 100 kPa. Lengths in mm, forces in N.
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
        gaps_mm.append(_nearest(positions_mm, np.setdiff1d(arms, wall), wall).gaps_mm.min())
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
        return sum(0.5 * float(touch.weights @ touch.offsets(x)[1] ** 2) for touch in self._touching(x))

    def forces(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dE/dx [N], shape (nodes, 3)."""
        force = np.zeros_like(x)
        for touch in self._touching(x):
            np.add.at(force, touch.nodes, touch.slope(x))
        return force

    def tangent(self, x: NDArray[np.float64]) -> csr_matrix:
        """Return d2E/dx2 [N/mm] over 3 node + component."""
        values, rows, columns = [np.zeros(0)], [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)]
        for touch in self._touching(x):
            block = touch.curvature(x)
            degrees = (3 * touch.nodes[:, :, None] + np.arange(3)).reshape(len(block), -1)
            values.append(block.ravel())
            rows.append(np.repeat(degrees, degrees.shape[1], axis=1).ravel())
            columns.append(np.tile(degrees, degrees.shape[1]).ravel())
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return coo_matrix(entries, (x.size, x.size)).tocsr()

    def _touching(self, x: NDArray[np.float64]) -> list[_Touch]:
        """The nodes that have passed through, those nearest to triangles, edges and corners apart."""
        found = []
        for nodes, weights, triangles in self._passes:
            nearest = _nearest(x, nodes, triangles)
            touching = (nearest.gaps_mm < 0.0) & (nearest.gaps_mm > -_DEEPEST_MM)
            for count in (1, 2, 3):
                here = touching & (nearest.corner_count == count)
                if here.any():
                    feature = np.column_stack([nodes[here], nearest.corners[here, :count]])
                    found.append(_Touch(feature, weights[here]))
        return found


@dataclass(frozen=True, eq=False)
class _Touch:
    """Nodes x and the corners a, v_1, ... of what is nearest to each, shape (n, 2 to 4); k times area, shape (n,)."""

    nodes: NDArray[np.int64]
    weights: NDArray[np.float64]

    def offsets(self, x: NDArray[np.float64]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """R (n, 3), its length d (n,), the factors of x, a, v_j in r (n, 2 to 4), and v_j - a (n, 0 to 2, 3)."""
        points = x[self.nodes]
        sides = points[:, 2:] - points[:, 1:2]
        from_corner = points[:, 0] - points[:, 1]
        metric = sides @ sides.swapaxes(1, 2)
        part = np.linalg.solve(metric, sides @ from_corner[:, :, None])[:, :, 0]
        r = from_corner - np.sum(part[:, :, None] * sides, axis=1)
        factors = np.column_stack([np.ones(len(r)), part.sum(axis=1) - 1.0, -part])
        return r, np.linalg.norm(r, axis=1), factors, sides

    def slope(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """DE over the nodes, shape (n, 2 to 4, 3)."""
        r, _, factors, _ = self.offsets(x)
        return self.weights[:, None, None] * factors[:, :, None] * r[:, None]

    def curvature(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """d2E over the nodes' components, shape (n, 6 to 12, 6 to 12)."""
        r, _, factors, sides = self.offsets(x)
        count, size = factors.shape
        whole = np.einsum("na,nb,ij->naibj", factors, factors, np.eye(3)).reshape(count, 3 * size, 3 * size)
        if size > 2:  # minus what the nearest point gives way by
            mixed = np.einsum("na,nmi->nmai", factors, sides)
            for index in range(size - 2):
                mixed[:, index, 2 + index] += r
                mixed[:, index, 1] -= r
            mixed = mixed.reshape(count, size - 2, -1)
            whole -= mixed.swapaxes(1, 2) @ np.linalg.solve(sides @ sides.swapaxes(1, 2), mixed)
        return self.weights[:, None, None] * whole


def _arms_and_wall(mesh: CellMesh, chamber: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    on_arm = mesh.on_arm[chamber]
    return _triangles(mesh.faces[chamber][on_arm]), _triangles(mesh.faces[chamber][~on_arm])


def _triangles(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Flat triangles of faces of any kind, the same sides up, shape (triangles, 3)."""
    return np.concatenate([faces[:, list(corners)] for corners in _TRIANGLES[faces.shape[1]]])


def _nodal_areas_mm2(x: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (x[triangles[:, corner]] for corner in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(triangles.ravel(), np.repeat(third, 3), minlength=len(x)).astype(np.float64, copy=False)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """What is nearest to some nodes.

    Args:
        gaps_mm: distance, counted from the gas: negative behind the surface, shape (n,).
        corners: of the nearest triangle, those of the nearest feature first, shape (n, 3).
        corner_count: 3: the triangle, 2: an edge of it, 1: a corner; shape (n,).
    """

    gaps_mm: NDArray[np.float64]
    corners: NDArray[np.int64]
    corner_count: NDArray[np.int64]


def _nearest(x: NDArray[np.float64], nodes: NDArray[np.int64], triangles: NDArray[np.int64]) -> _Nearest:
    """Find what is nearest. Of triangles that share it, that with the farthest plane says on which side a node is."""
    points = x[nodes][:, None]
    a, b, c = (x[triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = np.sum((points - a) * normal, axis=2)  # (nodes, triangles), out of the gas
    foot = points - height[:, :, None] * normal
    inside = np.ones(height.shape, dtype=bool)
    to_edges, parts = [], []
    for begin, end in ((a, b), (b, c), (c, a)):
        edge = end - begin
        inside &= np.sum((foot - begin) * np.cross(normal, edge), axis=2) >= 0.0
        part = np.clip(np.sum((points - begin) * edge, axis=2) / np.sum(edge**2, axis=1), 0.0, 1.0)
        to_edges.append(np.linalg.norm(points - begin - part[:, :, None] * edge, axis=2))
        parts.append(part)
    distance = np.where(inside, np.abs(height), np.min(to_edges, axis=0))
    triangle = (distance - 1e-6 * np.abs(height)).argmin(axis=1)
    chosen = np.arange(nodes.size), triangle
    edge = np.argmin([lengths[chosen] for lengths in to_edges], axis=0)
    part = np.stack([part[chosen] for part in parts])[edge, chosen[0]]
    at_end = part >= 1.0
    first = np.where(inside[chosen], 0, edge + at_end)
    corners = triangles[triangle][chosen[0][:, None], (first[:, None] + np.arange(3)) % 3]
    on_edge = np.where((part > 0.0) & ~at_end, 2, 1)
    return _Nearest(
        gaps_mm=-np.copysign(distance[chosen], height[chosen]),
        corners=corners,
        corner_count=np.where(inside[chosen], 3, on_edge),
    )
