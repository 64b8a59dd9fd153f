"""Yeoh's silicone for FElupe: distortional energy, first and second derivative in closed form.

With F the deformation gradient, J = det F and I = J^(-2/3) F:F the first invariant of the distortional part,

    W = sum_i C_i0 (I - 3)^i           (the paper's Eq. 1),
    dI/dF = 2 J^(-2/3) (F - F:F/3 G),  G = F^(-T),
    P = W' dI/dF,   A = W'' dI/dF x dI/dF + W' d2I/dF2   [N/mm2].

The volumetric energy is K/2 (J - 1)^2 per volume: J at the point for quadratic elements (reduced integration keeps
them from locking), the mean over the element (or group of tetrahedra) for linear ones (mean dilatation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import require_positive


@dataclass(frozen=True)
class Silicone:
    """Constants of the silicone.

    Args:
        c10_mpa, c20_mpa, c30_mpa: Yeoh's coefficients; defaults from the paper, section 2.3.
        bulk_mpa: bulk modulus K. 50 MPa is nearly incompressible (200 times the shear modulus); our assumption.

    Raises:
        ValueError: C10 or K is not positive.
    """

    c10_mpa: float = 0.1154
    c20_mpa: float = -0.0091
    c30_mpa: float = 0.0055
    bulk_mpa: float = 50.0

    def __post_init__(self) -> None:
        require_positive(self, "c10_mpa", "bulk_mpa")


class YeohMaterial:
    """Yeoh's energy in the form FElupe's solid bodies ask for (``x``, ``gradient``, ``hessian``).

    Args:
        silicone: the constants.
        with_volume: add K/2 (J - 1)^2 at each point.
    """

    def __init__(self, silicone: Silicone, with_volume: bool) -> None:
        self._coefficients = (silicone.c10_mpa, silicone.c20_mpa, silicone.c30_mpa)
        self._bulk = silicone.bulk_mpa if with_volume else 0.0
        self.x = [np.eye(3), np.zeros(0)]

    def energy(self, deformation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return W [N/mm2] of F, shape (3, 3, ...)."""
        jacobian = _determinant(deformation)
        excess = jacobian ** (-2.0 / 3.0) * np.sum(deformation**2, axis=(0, 1)) - 3.0
        c10, c20, c30 = self._coefficients
        return c10 * excess + c20 * excess**2 + c30 * excess**3 + 0.5 * self._bulk * (jacobian - 1.0) ** 2

    def gradient(self, x: list[NDArray[np.float64]]) -> list[NDArray[np.float64] | None]:
        """Return [P, state] of [F, state]; P has the shape of F, (3, 3, ...)."""
        return [self.first_piola(x[0]), x[-1]]

    def first_piola(self, deformation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return P [N/mm2] of F, both of shape (3, 3, ...)."""
        jacobian, cofactor, invariant_slope, slope, _ = self._kinematics(deformation)
        stress: NDArray[np.float64] = slope * invariant_slope + self._bulk * (jacobian - 1.0) * jacobian * cofactor
        return stress

    def hessian(self, x: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return [A] of [F, state]; A has shape (3, 3, 3, 3, ...), A_iJkL = dP_iJ / dF_kL."""
        deformation = x[0]
        jacobian, cofactor, invariant_slope, slope, curvature = self._kinematics(deformation)
        scale = jacobian ** (-2.0 / 3.0)
        norm = np.sum(deformation**2, axis=(0, 1))
        bulk = self._bulk
        # every dyad with G on the right: A = left x G + ... ; the swapped one G_iL G_kJ and the identity apart
        left = -4.0 / 3.0 * slope * scale * (deformation - norm / 3.0 * cofactor)
        left = left + bulk * (2.0 * jacobian - 1.0) * jacobian * cofactor
        swapped = 2.0 / 3.0 * slope * scale * norm - bulk * (jacobian - 1.0) * jacobian
        result = (curvature * invariant_slope)[:, :, None, None] * invariant_slope[None, None]
        result += left[:, :, None, None] * cofactor[None, None]
        result -= (4.0 / 3.0 * slope * scale * cofactor)[:, :, None, None] * deformation[None, None]
        result += (swapped * cofactor)[:, None, None, :] * cofactor.swapaxes(0, 1)[None, :, :, None]
        diagonal = 2.0 * slope * scale
        for i in range(3):
            for j in range(3):
                result[i, j, i, j] += diagonal
        return [result]

    def _kinematics(self, deformation: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """J, G = F^(-T), dI/dF, W' and W''."""
        jacobian = _determinant(deformation)
        f = deformation
        cofactor = np.empty_like(f)
        for i in range(3):
            for j in range(3):
                a, b, c, d = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                cofactor[i, j] = (f[a, c] * f[b, d] - f[a, d] * f[b, c]) / jacobian
        scale = jacobian ** (-2.0 / 3.0)
        norm = np.sum(f**2, axis=(0, 1))
        excess = scale * norm - 3.0
        c10, c20, c30 = self._coefficients
        slope = c10 + 2.0 * c20 * excess + 3.0 * c30 * excess**2
        return jacobian, cofactor, 2.0 * scale * (f - norm / 3.0 * cofactor), slope, 2.0 * c20 + 6.0 * c30 * excess


def _determinant(f: NDArray[np.float64]) -> NDArray[np.float64]:
    return (
        f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
        - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
        + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
    )
