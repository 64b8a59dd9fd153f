"""Surrogates of the paper's finite element samples: greatest bend and tip force over the design (a, b).

Three metamodels behind one contract (:class:`Metamodel`): polynomial response surface (PRS), radial basis functions
(RBF) and kriging (KRG), each fitted to the 21 samples of Table 1 and judged on the 8 of Table 2. All values are the
paper's: two adjacent chambers (PDC) at 100 kPa gauge.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.actuator.tables import read_table

TRAINING_TABLE = "doe_training.csv"
VALIDATION_TABLE = "doe_validation.csv"


class Metamodel(ABC):
    """One response over the design plane.

    ``fit`` once, then ``predict``; both take designs as rows (a, b) in millimetres, shape (n, 2).
    """

    @abstractmethod
    def fit(self, design_mm: ArrayLike, response: ArrayLike) -> Metamodel:
        """Fit to ``response``, shape (n,), at ``design_mm``, shape (n, 2); return self.

        Raises:
            ValueError: the shapes do not match or there are too few samples.
        """

    @abstractmethod
    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the response at ``design_mm``, shape (n, 2), as shape (n,)."""


class PolynomialResponseSurface(Metamodel):
    """Cubic polynomial without high-order cross terms, least squares (paper, Eq. 3; gives its Eqs. 9 and 10).

    ``coefficients`` belong to 1, a, b, a^2, b^2, a b, a^3, b^3.
    """

    def fit(self, design_mm: ArrayLike, response: ArrayLike) -> PolynomialResponseSurface:
        design, values = _samples(design_mm, response, at_least=8)
        self.coefficients = np.linalg.lstsq(self._basis(design), values, rcond=None)[0]
        return self

    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        return self._basis(_designs(design_mm)) @ self.coefficients

    @staticmethod
    def _basis(design: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = design.T
        return np.column_stack([np.ones_like(a), a, b, a**2, b**2, a * b, a**3, b**3])


class RadialBasisFunctions(Metamodel):
    """Sum of Gaussians exp(-(epsilon r)^2), one on each sample, about the mean response (paper, Eq. 4).

    r is measured in the design scaled to [-1, 1]^2. The shape parameter ``epsilon`` is the one with the smallest
    leave-one-out error (Rippa's formula) between 0.1 and 3. A ridge of 1e-8 on the diagonal keeps flat Gaussians
    solvable; with it the samples come back to 0.4 percent (theta_max) or exactly (F_max).
    """

    _RIDGE = 1e-8
    _EPSILON_RANGE = (0.1, 3.0)

    def fit(self, design_mm: ArrayLike, response: ArrayLike) -> RadialBasisFunctions:
        design, values = _samples(design_mm, response, at_least=3)
        self._centres, self._mean = _unit_square(design), float(values.mean())
        deviation = values - self._mean
        low, high = np.log(self._EPSILON_RANGE)
        scan = np.linspace(low, high, 25)
        errors = [self._leave_one_out(math.exp(x), deviation) for x in scan]
        best, spacing = scan[int(np.argmin(errors))], scan[1] - scan[0]
        refined = minimize_scalar(
            lambda x: self._leave_one_out(math.exp(x), deviation),
            bounds=(max(low, best - spacing), min(high, best + spacing)),
            method="bounded",
        )
        self.epsilon = math.exp(float(refined.x))
        self._weights = np.linalg.solve(self._matrix(self.epsilon), deviation)
        return self

    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        distance2 = _squared_distances(_unit_square(_designs(design_mm)), self._centres).sum(axis=-1)
        return self._mean + np.exp(-(self.epsilon**2) * distance2) @ self._weights

    def _matrix(self, epsilon: float) -> NDArray[np.float64]:
        distance2 = _squared_distances(self._centres, self._centres).sum(axis=-1)
        return np.exp(-(epsilon**2) * distance2) + self._RIDGE * np.eye(len(distance2))

    def _leave_one_out(self, epsilon: float, deviation: NDArray[np.float64]) -> float:
        """Root mean square of the errors at each sample when it is left out: weight / diagonal of the inverse."""
        inverse = np.linalg.inv(self._matrix(epsilon))
        return float(np.sqrt(np.mean((inverse @ deviation / np.diag(inverse)) ** 2)))


class OrdinaryKriging(Metamodel):
    """Ordinary kriging (paper, Eq. 5 with a constant h): constant mean plus a Gaussian process.

    Correlation exp(-sum_k d_k^2 / (2 l_k^2)) of the design scaled to [-1, 1]^2, plus a nugget on the diagonal for what
    no smooth surface explains (meshes differ from sample to sample). Two length scales (0.2 to 5) and the nugget
    (1e-8 to 0.1 of the variance) maximise the concentrated likelihood, from four seeded starts. Without a free nugget
    the variance is wrong: errors on Table 2 then reach 20 standard deviations.
    """

    _LENGTH_RANGE = (0.2, 5.0)
    _NUGGET_RANGE = (1e-8, 0.1)
    _STARTS = 4

    def fit(self, design_mm: ArrayLike, response: ArrayLike) -> OrdinaryKriging:
        design, values = _samples(design_mm, response, at_least=3)
        self._centres, self._values = _unit_square(design), values
        bounds = np.log([self._LENGTH_RANGE, self._LENGTH_RANGE, self._NUGGET_RANGE])
        starts = np.random.default_rng(0).uniform(*bounds.T, size=(self._STARTS, 3))
        runs = [minimize(self._negative_log_likelihood, start, bounds=bounds, method="L-BFGS-B") for start in starts]
        best = np.exp(min(runs, key=lambda run: run.fun).x)
        self.length_scales, self.nugget = best[:2], float(best[2])
        self._factor, self._mean, self._variance = self._concentrate(self.length_scales, self.nugget)
        self._weights = cho_solve(self._factor, values - self._mean)
        return self

    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        return self._mean + self._cross_correlation(design_mm) @ self._weights

    def predict_variance(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the variance of a new sample at ``design_mm``, shape (n, 2), as shape (n,), in squared units.

        The kriging variance (uncertain mean included) plus the nugget.
        """
        cross = self._cross_correlation(design_mm)
        solved = cho_solve(self._factor, cross.T)
        ones = cho_solve(self._factor, np.ones(len(self._values)))
        mean_term = (1.0 - cross @ ones) ** 2 / ones.sum()
        smooth = np.maximum(1.0 - np.einsum("ij,ji->i", cross, solved) + mean_term, 0.0)
        return self._variance * (smooth + self.nugget)

    def _cross_correlation(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        return self._correlation(_unit_square(_designs(design_mm)), self.length_scales)

    def _correlation(self, points: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.exp(-0.5 * (_squared_distances(points, self._centres) / lengths**2).sum(axis=-1))

    def _concentrate(self, lengths: NDArray[np.float64], nugget: float) -> tuple[tuple, float, float]:
        """Return the Cholesky factor, and the mean and variance that are most likely with these parameters."""
        count = len(self._values)
        factor = cho_factor(self._correlation(self._centres, lengths) + nugget * np.eye(count), lower=True)
        ones = cho_solve(factor, np.ones(count))
        mean = float(ones @ self._values / ones.sum())
        deviation = self._values - mean
        return factor, mean, float(deviation @ cho_solve(factor, deviation)) / count

    def _negative_log_likelihood(self, log_parameters: NDArray[np.float64]) -> float:
        parameters = np.exp(log_parameters)
        factor, _, variance = self._concentrate(parameters[:2], parameters[2])
        return 0.5 * len(self._values) * math.log(variance) + float(np.log(np.diag(factor[0])).sum())


@dataclass(frozen=True)
class MusclePerformance:
    """What a metamodel says of a design with two adjacent chambers (PDC) at 100 kPa gauge.

    Args:
        theta_max_rad, f_max_n: greatest bend, and tip force when blocked.
        theta_max_sigma_rad, f_max_sigma_n: root mean square error of the metamodel on Table 2.
    """

    theta_max_rad: float
    f_max_n: float
    theta_max_sigma_rad: float
    f_max_sigma_n: float


@dataclass(frozen=True)
class MuscleMetamodel:
    """Bend and force of a muscle over its design, with their validation errors."""

    theta_max_deg: Metamodel
    f_max_n: Metamodel
    theta_max_rmse_deg: float
    f_max_rmse_n: float

    def predict(self, design: MuscleDesign) -> MusclePerformance:
        """Return the performance of ``design``, which by its construction lies in the sampled domain."""
        point = [[design.a_mm, design.b_mm]]
        return MusclePerformance(
            theta_max_rad=math.radians(self.theta_max_deg.predict(point)[0]),
            f_max_n=float(self.f_max_n.predict(point)[0]),
            theta_max_sigma_rad=math.radians(self.theta_max_rmse_deg),
            f_max_sigma_n=self.f_max_rmse_n,
        )


METAMODELS: dict[str, type[Metamodel]] = {
    "prs": PolynomialResponseSurface,
    "rbf": RadialBasisFunctions,
    "krg": OrdinaryKriging,
}


@functools.cache
def load_metamodel(name: str) -> MuscleMetamodel:
    """Fit the metamodel ``name`` (``prs``, ``rbf`` or ``krg``) to Table 1 and measure its error on Table 2.

    Raises:
        ValueError: unknown name; the message lists the known ones.
        ConfigError: a table is missing or unreadable.
    """
    if name not in METAMODELS:
        raise ValueError(f"unknown metamodel {name!r}; known: {', '.join(METAMODELS)}")
    design, theta, force = read_samples(TRAINING_TABLE)
    checked, checked_theta, checked_force = read_samples(VALIDATION_TABLE)
    theta_model, force_model = METAMODELS[name]().fit(design, theta), METAMODELS[name]().fit(design, force)
    return MuscleMetamodel(
        theta_max_deg=theta_model,
        f_max_n=force_model,
        theta_max_rmse_deg=_rms(theta_model.predict(checked) - checked_theta),
        f_max_rmse_n=_rms(force_model.predict(checked) - checked_force),
    )


def read_samples(table: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return designs (n, 2) [mm], greatest bends (n,) [deg] and forces (n,) [N] of a table of samples.

    Raises:
        ConfigError: the table is missing or unreadable.
    """
    a, b, theta, force = read_table(table, "a_mm", "b_mm", "theta_max_deg", "f_max_n")
    return np.column_stack([a, b]), theta, force


def _designs(design_mm: ArrayLike) -> NDArray[np.float64]:
    design = np.asarray(design_mm, dtype=float)
    if design.ndim != 2 or design.shape[1] != 2:
        raise ValueError(f"expected designs as rows (a, b), found shape {design.shape}")
    return design


def _samples(
    design_mm: ArrayLike, response: ArrayLike, at_least: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    design, values = _designs(design_mm), np.asarray(response, dtype=float)
    if values.shape != (len(design),) or len(design) < at_least:
        raise ValueError(
            f"expected one response for each of at least {at_least} designs, "
            f"found {len(design)} designs and responses of shape {values.shape}"
        )
    return design, values


def _unit_square(design: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale the sampled domain to [-1, 1]^2, so that one length serves a and b."""
    low, high = np.array([MuscleDesign.A_RANGE_MM, MuscleDesign.B_RANGE_MM]).T
    return 2.0 * (design - low) / (high - low) - 1.0


def _squared_distances(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return (left[:, None, :] - right[None, :, :]) ** 2


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error**2)))
