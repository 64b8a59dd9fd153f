"""The silicone as energy, forces and tangent of nodal positions, by FElupe. Lengths in mm, forces in N.

The number of nodes of a cell says its kind: 8, trilinear hexahedra with mean dilatation; 20, quadratic serendipity
hexahedra with reduced integration; 4, linear tetrahedra; 15, hexahedra cut into 24 linear tetrahedra that share one
mean dilatation (:mod:`~mbpam_ros.study.fe.tetrahedra`).

The dilatation of a linear tetrahedron is constant, so its mean changes nothing and tetrahedra by themselves lock: a
hexahedron brings 24 of them, but only 15 nodal components (one corner, three faces' middles, its own). With one
dilatation for the 24, the nodes in the faces' middles let volume flow between neighbours, as in the stable pair of
Bernardi and Raugel (Math. Comp. 44, 1985).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from mbpam_ros.study.fe.material import Silicone, YeohMaterial
from mbpam_ros.study.fe.tetrahedra import CUT, REFERENCE_NODES

try:
    import felupe
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("the finite elements need FElupe, of the extra fem", name="felupe") from error


class SolidBody:
    """A body of silicone.

    Args:
        points_mm: nodes at rest, shape (nodes, 3).
        cells: node numbers, shape (cells, 4, 8, 15 or 20).
        silicone: the material's constants.
    """

    def __init__(self, points_mm: NDArray[np.float64], cells: NDArray[np.int64], silicone: Silicone) -> None:
        self._points, self._cells = points_mm, cells
        self._bulk = silicone.bulk_mpa
        quadratic = cells.shape[1] == 20
        self._region = _region(points_mm, cells)
        self._field = felupe.FieldContainer([felupe.Field(self._region, dim=3)])
        self._material = YeohMaterial(silicone, with_volume=quadratic)
        self._mean_dilatation = not quadratic
        self._new = True
        if quadratic:
            self._solid = felupe.SolidBody(self._material, self._field)
        else:
            self._solid = felupe.SolidBodyNearlyIncompressible(self._material, self._field, bulk=silicone.bulk_mpa)

    def energy(self, x: NDArray[np.float64]) -> float:
        """Return the elastic energy [N mm] with the nodes at ``x``, shape (nodes, 3)."""
        self._move(x)
        deformation, volume = self._field.extract()[0], self._region.dV
        energy = float(np.sum(self._material.energy(deformation) * volume))
        if self._mean_dilatation:
            jacobian = np.linalg.det(np.moveaxis(deformation, (0, 1), (-2, -1)))
            rest = volume.sum(axis=0)
            energy += float(np.sum(0.5 * self._bulk * ((jacobian * volume).sum(axis=0) / rest - 1.0) ** 2 * rest))
        return energy

    def forces(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return d energy / dx [N], shape (nodes, 3)."""
        self._move(x)
        return self._solid.assemble.vector(self._field).toarray().reshape(-1, 3)

    def tangent(self, x: NDArray[np.float64]) -> csr_matrix:
        """Return d2 energy / dx2 [N/mm] over 3 node + component."""
        self._move(x)
        return csr_matrix(self._solid.assemble.matrix(self._field))

    def largest_principal(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return the largest principal stretch and true stress [MPa], and the volume at rest [mm3], of each point.

        Points are those of the quadrature; the three arrays have the shape (points of a cell, cells). The true stress
        is P F^T / J with the pressure of the volumetric energy.
        """
        self._move(x)
        deformation, volume = self._field.extract()[0], self._region.dV
        f = np.moveaxis(deformation, (0, 1), (-2, -1))
        p = np.moveaxis(self._material.first_piola(deformation), (0, 1), (-2, -1))
        jacobian = np.linalg.det(f)
        stress = p @ np.swapaxes(f, -1, -2) / jacobian[..., None, None]
        principal = np.linalg.eigvalsh(0.5 * (stress + np.swapaxes(stress, -1, -2)))[..., -1]
        if self._mean_dilatation:
            mean = (jacobian * volume).sum(axis=0) / volume.sum(axis=0)
            principal = principal + self._bulk * (mean - 1.0)
        return np.linalg.svd(f, compute_uv=False)[..., 0], principal, volume

    def nodal_volumes_mm3(self, cell_factors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each node's share of the volume at rest, sum over cells of factor int N dV, shape (nodes,)."""
        shares = np.einsum("aqc,qc,c->ca", np.broadcast_to(self._region.h, self._shape), self._region.dV, cell_factors)
        return np.bincount(self._cells.ravel(), shares.ravel(), minlength=len(self._points)).astype(
            np.float64, copy=False
        )

    @property
    def _shape(self) -> tuple[int, int, int]:
        return self._cells.shape[1], *self._region.dV.shape

    def _move(self, x: NDArray[np.float64]) -> None:
        """Set the displacements.

        FElupe's mean dilatation is linear from its last state; told the same displacements twice it is that of the
        displacements themselves, whatever came before.
        """
        displacement = x - self._points
        if np.array_equal(self._field[0].values, displacement) and not self._new:
            return
        self._new = False
        self._field[0].values[:] = displacement
        if self._mean_dilatation:
            self._solid._extract(self._field)


def _region(points_mm: NDArray[np.float64], cells: NDArray[np.int64]) -> felupe.Region:
    """Shape functions and quadrature of the kind of cell."""
    kind = cells.shape[1]
    if kind == 4:
        return felupe.RegionTetra(felupe.Mesh(points_mm, cells, "tetra"))
    if kind == 8:
        return felupe.RegionHexahedron(felupe.Mesh(points_mm, cells, "hexahedron"))
    if kind == 15:
        element = _CutHexahedron()
        return felupe.Region(felupe.Mesh(points_mm, cells), element, element.quadrature)
    mesh = felupe.Mesh(points_mm, cells, "hexahedron20")
    return felupe.RegionQuadraticHexahedron(mesh, quadrature=felupe.GaussLegendre(order=1, dim=3))


class _CutHexahedron:
    """The 24 tetrahedra as one element for FElupe: linear in each of them, a point of quadrature in each middle.

    The map from the reference cube is linear in each, so gradients and volumes are those of the tetrahedra.
    """

    def __init__(self) -> None:
        self.points = REFERENCE_NODES
        corners = REFERENCE_NODES[CUT]
        rows = np.concatenate([np.ones((*CUT.shape, 1)), corners], axis=2)  # (1, r, s, t) of each corner
        self._coordinates = np.linalg.inv(rows)  # barycentric ones are (1, r, s, t) times this
        self.quadrature = felupe.quadrature.Scheme(points=corners.mean(axis=1), weights=np.linalg.det(rows) / 6.0)

    def function(self, rst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shape functions at a point, shape (15,)."""
        index, inside = self._at(rst)
        shape = np.zeros(len(REFERENCE_NODES))
        shape[CUT[index]] = inside
        return shape

    def gradient(self, rst: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return their slopes at a point, shape (15, 3)."""
        index, _ = self._at(rst)
        slope = np.zeros((len(REFERENCE_NODES), 3))
        slope[CUT[index]] = self._coordinates[index, 1:].T
        return slope

    def _at(self, rst: NDArray[np.float64]) -> tuple[int, NDArray[np.float64]]:
        """The tetrahedron a point is in, and its barycentric coordinates there."""
        barycentric = np.array([1.0, *rst]) @ self._coordinates
        index = int(barycentric.min(axis=1).argmax())
        return index, barycentric[index]
