"""Incompressible hyperelastic models of silicone: stress in uniaxial tension, and where each is stable.

With the principal stretches l1, l2, l3 = 1/(l1 l2) and the invariants I1 = sum l^2, I2 = sum l^-2, the energies are

    neo-Hooke       W = C10 (I1 - 3)
    Mooney-Rivlin   W = C10 (I1 - 3) + C01 (I2 - 3)
    Yeoh            W = sum_i Ci0 (I1 - 3)^i,  i = 1..3              (the paper's Eq. 1)
    Ogden           W = sum_p mu_p / alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3),  p = 1, 2

and the engineering stress of a strip pulled to the stretch l is P = dW/dl along l1 = l, l2 = l3 = l^(-1/2):

    P = 2 (l - l^-2) (dW/dI1 + dW/dI2 / l),   Ogden: P = sum_p mu_p (l^(alpha_p - 1) - l^(-alpha_p/2 - 1)).

A model is stable at (l1, l2) by Drucker's condition if the Hessian of W in (ln l1, ln l2) is positive definite: then a
little more strain, in any direction of the plane, needs a little more true stress.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEFORMATIONS = {
    "uniaxial": lambda stretch: (stretch, stretch**-0.5),
    "equibiaxial": lambda stretch: (stretch, stretch),
    "planar": lambda stretch: (stretch, np.ones_like(stretch)),
}
"""The tests by which stability is told: (l1, l2) of the stretch l1. Pressing is pulling the other way, l1 < 1."""

_LOOKED_AT = np.geomspace(0.2, 8.0, 1200)


class Hyperelastic(ABC):
    """A model with its constants, all of which are in MPa if their name ends so."""

    name: ClassVar[str]

    @abstractmethod
    def stress_mpa(self, stretch: Array) -> Array:
        """Return the engineering stress [MPa] of a strip pulled to ``stretch``, of its shape."""

    @abstractmethod
    def shear_modulus_mpa(self) -> float:
        """Return the shear modulus of small strains [MPa]; Young's modulus is three times that."""

    @abstractmethod
    def curvature_mpa(self, stretch_1: Array, stretch_2: Array) -> tuple[Array, Array, Array]:
        """Return d2W/de1 de1, d2W/de1 de2, d2W/de2 de2 [MPa], e = ln l, each of the shape of the stretches."""

    def constants(self) -> dict[str, float]:
        """Return the constants by their names."""
        return {name: float(value) for name, value in vars(self).items()}

    def stable_stretches(self, deformation: str) -> tuple[float, float]:
        """Return the least and greatest stretch around 1 between which the model is stable.

        Args:
            deformation: a key of :data:`DEFORMATIONS`.

        Returns:
            Within 0.2 to 8, as far as is looked; (1, 1) if it is unstable at rest.
        """
        first, mixed, second = self.curvature_mpa(*DEFORMATIONS[deformation](_LOOKED_AT))
        stable = (first > 0.0) & (first * second > (1.0 - 1e-9) * mixed**2)  # at great stretch they differ by rounding
        rest = int(np.searchsorted(_LOOKED_AT, 1.0))
        if not (stable[rest - 1] and stable[rest]):
            return 1.0, 1.0
        below = np.flatnonzero(~stable[:rest])
        above = np.flatnonzero(~stable[rest:])
        low = _LOOKED_AT[below[-1] + 1] if below.size else _LOOKED_AT[0]
        high = _LOOKED_AT[rest + above[0] - 1] if above.size else _LOOKED_AT[-1]
        return float(low), float(high)


class LinearModel(Hyperelastic):
    """A model of I1 and I2 whose stress is linear in its constants."""

    @abstractmethod
    def slopes_mpa(self, invariant_1: Array) -> tuple[Array, Array, float]:
        """Return dW/dI1, d2W/dI1^2, dW/dI2 [MPa] at I1; no model here has more."""

    def stress_mpa(self, stretch: Array) -> Array:
        """Return the engineering stress [MPa] of a strip pulled to ``stretch``, of its shape."""
        slope_1, _, slope_2 = self.slopes_mpa(stretch**2 + 2.0 / stretch)
        return 2.0 * (stretch - stretch**-2) * (slope_1 + slope_2 / stretch)

    def shear_modulus_mpa(self) -> float:
        """Return the shear modulus of small strains, 2 (dW/dI1 + dW/dI2) at rest [MPa]."""
        slope_1, _, slope_2 = self.slopes_mpa(np.array(3.0))
        return float(2.0 * (slope_1 + slope_2))

    def curvature_mpa(self, stretch_1: Array, stretch_2: Array) -> tuple[Array, Array, Array]:
        """Return d2W/de1 de1, d2W/de1 de2, d2W/de2 de2 [MPa], e = ln l, each of the shape of the stretches."""
        square = np.array([stretch_1, stretch_2, 1.0 / (stretch_1 * stretch_2)]) ** 2
        slope_1, bend_1, slope_2 = self.slopes_mpa(square.sum(axis=0))
        toward = 2.0 * (square[:2] - square[2])  # dI1/de
        own = [
            4.0 * slope_1 * (square[i] + square[2])
            + 4.0 * slope_2 * (1.0 / square[i] + 1.0 / square[2])
            + bend_1 * toward[i] ** 2
            for i in range(2)
        ]
        mixed = 4.0 * slope_1 * square[2] + 4.0 * slope_2 / square[2] + bend_1 * toward[0] * toward[1]
        return own[0], mixed, own[1]


@dataclass(frozen=True)
class NeoHooke(LinearModel):
    """Neo-Hooke's model: one constant, good for strains of a few tens of per cent."""

    c10_mpa: float

    name: ClassVar[str] = "neo-hooke"

    def slopes_mpa(self, invariant_1: Array) -> tuple[Array, Array, float]:
        """Return dW/dI1, d2W/dI1^2, dW/dI2 [MPa]."""
        return np.full_like(invariant_1, self.c10_mpa), np.zeros_like(invariant_1), 0.0


@dataclass(frozen=True)
class MooneyRivlin(LinearModel):
    """Mooney and Rivlin's model of two constants."""

    c10_mpa: float
    c01_mpa: float

    name: ClassVar[str] = "mooney-rivlin"

    def slopes_mpa(self, invariant_1: Array) -> tuple[Array, Array, float]:
        """Return dW/dI1, d2W/dI1^2, dW/dI2 [MPa]."""
        return np.full_like(invariant_1, self.c10_mpa), np.zeros_like(invariant_1), self.c01_mpa


@dataclass(frozen=True)
class Yeoh(LinearModel):
    """Yeoh's model of three constants, the paper's and the one that the finite elements use."""

    c10_mpa: float
    c20_mpa: float
    c30_mpa: float

    name: ClassVar[str] = "yeoh"

    def slopes_mpa(self, invariant_1: Array) -> tuple[Array, Array, float]:
        """Return dW/dI1, d2W/dI1^2, dW/dI2 [MPa]."""
        excess = invariant_1 - 3.0
        slope = self.c10_mpa + 2.0 * self.c20_mpa * excess + 3.0 * self.c30_mpa * excess**2
        return slope, 2.0 * self.c20_mpa + 6.0 * self.c30_mpa * excess, 0.0


@dataclass(frozen=True)
class Ogden(Hyperelastic):
    """Ogden's model of two terms."""

    mu1_mpa: float
    alpha1: float
    mu2_mpa: float
    alpha2: float

    name: ClassVar[str] = "ogden"

    def _terms(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return (self.mu1_mpa, self.alpha1), (self.mu2_mpa, self.alpha2)

    def stress_mpa(self, stretch: Array) -> Array:
        """Return the engineering stress [MPa] of a strip pulled to ``stretch``, of its shape."""
        return sum((mu * ogden_term(stretch, alpha) for mu, alpha in self._terms()), np.zeros_like(stretch))

    def shear_modulus_mpa(self) -> float:
        """Return the shear modulus of small strains, sum mu alpha / 2 [MPa]."""
        return 0.5 * sum(mu * alpha for mu, alpha in self._terms())

    def curvature_mpa(self, stretch_1: Array, stretch_2: Array) -> tuple[Array, Array, Array]:
        """Return d2W/de1 de1, d2W/de1 de2, d2W/de2 de2 [MPa], e = ln l, each of the shape of the stretches."""
        stretch = np.array([stretch_1, stretch_2, 1.0 / (stretch_1 * stretch_2)])
        first, mixed, second = np.zeros((3, *np.shape(stretch_1)))
        for mu, alpha in self._terms():
            power = mu * alpha * stretch**alpha
            first = first + power[0] + power[2]
            second = second + power[1] + power[2]
            mixed = mixed + power[2]
        return first, mixed, second


def ogden_term(stretch: Array, alpha: float) -> Array:
    """Return the engineering stress of one of Ogden's terms over its mu: l^(alpha - 1) - l^(-alpha/2 - 1)."""
    return stretch ** (alpha - 1.0) - stretch ** (-0.5 * alpha - 1.0)


MODELS: dict[str, type[Hyperelastic]] = {model.name: model for model in (Yeoh, MooneyRivlin, Ogden, NeoHooke)}
