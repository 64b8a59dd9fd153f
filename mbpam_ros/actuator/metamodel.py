"""Surrogates of the paper's finite element samples: greatest bend and tip force over the design (a, b).

Metamodels behind one contract (:class:`Metamodel`): polynomial response surface (PRS), radial basis functions (RBF)
and kriging (KRG), each fitted to the 21 samples of Table 1 and judged on the 8 of Table 2. All values are the
paper's: two adjacent chambers (PDC) at 100 kPa gauge.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar
from scipy.special import xlogy

from mbpam_ros.actuator.design import PAPER_DOMAIN, DesignDomain, MuscleDesign
from mbpam_ros.actuator.tables import read_table

TRAINING_TABLE = "doe_training.csv"
VALIDATION_TABLE = "doe_validation.csv"

_BLOCK = 1024


class MetamodelError(ValueError):
    """These samples do not determine this metamodel; the message says what is missing."""


class Metamodel(ABC):
    """One response over a domain of designs.

    ``fit`` once, then ``predict``; both take designs as rows (a, b) in millimetres, shape (n, 2), and refuse those
    outside the domain.
    """

    least_samples = 3

    def __init__(self, domain: DesignDomain = PAPER_DOMAIN) -> None:
        self.domain = domain

    def fit(self, design_mm: ArrayLike, response: ArrayLike) -> Metamodel:
        """Fit to ``response``, shape (n,), at ``design_mm``, shape (n, 2); return self.

        Raises:
            DesignDomainError: a sample lies outside the domain.
            MetamodelError: the shapes do not match, a response is not finite, or the samples are too few or badly
                placed.
        """
        design, values = _designs(design_mm), np.asarray(response, dtype=float)
        if values.shape != (len(design),) or len(design) < self.least_samples:
            raise MetamodelError(
                f"expected one response for each of at least {self.least_samples} designs, "
                f"found {len(design)} designs and responses of shape {values.shape}"
            )
        if not np.isfinite(values).all():
            raise MetamodelError("expected finite responses")
        self.domain.require_inside(design)
        self._fit(design, values)
        return self

    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the response at ``design_mm``, shape (n, 2), as shape (n,).

        Raises:
            DesignDomainError: a design lies outside the domain. The message names the nearest design inside.
        """
        design = _designs(design_mm)
        self.domain.require_inside(design)
        # In blocks: distances from all designs to all samples at once would fill the memory.
        blocks = [design[start : start + _BLOCK] for start in range(0, len(design), _BLOCK)]
        return np.concatenate([self._predict(block) for block in blocks]) if blocks else np.empty(0)

    def fitted_parameters(self) -> dict[str, object]:
        """Return what the fit chose, as plain values that JSON can hold."""
        return {}

    @abstractmethod
    def _fit(self, design: NDArray[np.float64], values: NDArray[np.float64]) -> None: ...

    @abstractmethod
    def _predict(self, design: NDArray[np.float64]) -> NDArray[np.float64]: ...


class PolynomialResponseSurface(Metamodel):
    """Cubic polynomial without high-order cross terms, least squares (paper, Eq. 3; gives its Eqs. 9 and 10).

    ``coefficients`` belong to 1, a, b, a^2, b^2, a b, a^3, b^3, with a and b in millimetres.
    """

    least_samples = 8

    def _fit(self, design: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        self.coefficients, _, rank, _ = np.linalg.lstsq(self._basis(design), values, rcond=None)
        if rank < self.least_samples:
            raise MetamodelError("a cubic needs at least four different values of a and of b, and designs off a line")

    def _predict(self, design: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._basis(design) @ self.coefficients

    def fitted_parameters(self) -> dict[str, object]:
        return {"coefficients": self.coefficients.tolist()}

    @staticmethod
    def _basis(design: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = design.T
        return np.column_stack([np.ones_like(a), a, b, a**2, b**2, a * b, a**3, b**3])


class ThinPlateSpline(Metamodel):
    """Sum of r^2 ln r, one on each sample, plus a plane to which the weights are orthogonal (paper, Eq. 4).

    r is measured in the design scaled to [-1, 1]^2. Nothing is left to choose, and the paper's RBF row of Table 3 comes
    back in every figure to 0.0001; with the Gaussians that the paper names it does not, whatever their width
    (:class:`GaussianRadialBasis`). Duchon's spline: the interpolant of least bending energy.
    """

    def _fit(self, design: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        _require_distinct(design)
        self._centres = self.domain.scale(design)
        plane = _trend(self._centres, "linear")
        if np.linalg.matrix_rank(plane) < 3:
            raise MetamodelError("a thin plate spline needs designs off a line")
        matrix = np.block([[self._kernel(self._centres), plane], [plane.T, np.zeros((3, 3))]])
        solution = np.linalg.solve(matrix, np.concatenate([values, np.zeros(3)]))
        self._weights, self._plane = solution[:-3], solution[-3:]

    def _predict(self, design: NDArray[np.float64]) -> NDArray[np.float64]:
        points = self.domain.scale(design)
        return self._kernel(points) @ self._weights + _trend(points, "linear") @ self._plane

    def fitted_parameters(self) -> dict[str, object]:
        return {"basis": "r^2 ln r", "trend": "linear"}

    def _kernel(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        # r^2 ln r = r^2 ln(r^2) / 2, with its limit 0 at the centre.
        distance2 = _squared_distances(points, self._centres).sum(axis=-1)
        return 0.5 * xlogy(distance2, distance2)


class GaussianRadialBasis(Metamodel):
    """Sum of Gaussians exp(-(epsilon r)^2), one on each sample, about the mean response (paper, Eq. 4).

    r is measured in the design scaled to [-1, 1]^2. The shape parameter ``epsilon`` is the one with the smallest
    leave-one-out error (Rippa's formula) between 0.1 and 3. A ridge of 1e-8 on the diagonal keeps flat Gaussians
    solvable; with it the samples come back to 0.4 percent (theta_max) or exactly (F_max).
    """

    _RIDGE = 1e-8
    _EPSILON_RANGE = (0.1, 3.0)

    def _fit(self, design: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        _require_distinct(design)
        self._centres, self._mean = self.domain.scale(design), float(values.mean())
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

    def _predict(self, design: NDArray[np.float64]) -> NDArray[np.float64]:
        distance2 = _squared_distances(self.domain.scale(design), self._centres).sum(axis=-1)
        return self._mean + np.exp(-(self.epsilon**2) * distance2) @ self._weights

    def fitted_parameters(self) -> dict[str, object]:
        return {"basis": "exp(-(epsilon r)^2)", "trend": "mean", "epsilon": self.epsilon, "ridge": self._RIDGE}

    def _matrix(self, epsilon: float) -> NDArray[np.float64]:
        distance2 = _squared_distances(self._centres, self._centres).sum(axis=-1)
        return np.exp(-(epsilon**2) * distance2) + self._RIDGE * np.eye(len(distance2))

    def _leave_one_out(self, epsilon: float, deviation: NDArray[np.float64]) -> float:
        """Root mean square of the errors at each sample when it is left out: weight / diagonal of the inverse."""
        inverse = np.linalg.inv(self._matrix(epsilon))
        return float(np.sqrt(np.mean((inverse @ deviation / np.diag(inverse)) ** 2)))


class Kriging(Metamodel):
    """Universal kriging (paper, Eq. 5): a polynomial trend h plus a Gaussian process z.

    The design is scaled to [-1, 1]^2. The correlation is a product over a and b of one of :data:`CORRELATIONS`, of
    d_k / l_k; the nugget, a share of the process's variance, stands on its diagonal. The two length scales (0.1 to 20)
    maximise the likelihood concentrated over trend and variance, from four seeded starts.

    Args:
        trend: constant (ordinary kriging), linear or quadratic.
        correlation: a key of :data:`CORRELATIONS`.
        nugget: fixed jitter for an interpolating model; None estimates it (1e-8 to 0.1) with the length scales. The
            paper's kriging row of Table 3 is an interpolating one's. Its variance is wrong, though: finite element
            meshes differ from sample to sample, and errors on Table 2 reach many of its standard deviations. With an
            estimated nugget they stay within three.
        domain: where the samples are.

    After ``fit``: ``length_scales`` (2,), ``nugget``, and the correlation matrix's ``condition_number``.

    Raises:
        ValueError: unknown trend or correlation, or a nugget below 1e-12, with which flat correlations have no
            Cholesky factor in double precision.
    """

    _LENGTH_RANGE = (0.1, 20.0)
    _NUGGET_RANGE = (1e-8, 0.1)
    _LEAST_NUGGET = 1e-12
    _STARTS = 4

    def __init__(
        self,
        trend: str = "constant",
        correlation: str = "gaussian",
        nugget: float | None = 1e-10,
        domain: DesignDomain = PAPER_DOMAIN,
    ) -> None:
        super().__init__(domain)
        for name, known in ((trend, TRENDS), (correlation, CORRELATIONS)):
            if name not in known:
                raise ValueError(f"unknown {name!r}; known: {', '.join(known)}")
        if nugget is not None and not nugget >= self._LEAST_NUGGET:
            raise ValueError(f"the nugget must be at least {self._LEAST_NUGGET:g}, found {nugget:g}")
        self.trend, self.correlation, self._fixed_nugget = trend, correlation, nugget
        self.least_samples = TRENDS[trend] + 2

    def _fit(self, design: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        _require_distinct(design)
        self._centres, self._values = self.domain.scale(design), values
        basis = _trend(self._centres, self.trend)
        weights, _, rank, _ = np.linalg.lstsq(basis, values, rcond=None)
        if rank < TRENDS[self.trend]:
            raise MetamodelError(f"these designs do not determine a {self.trend} trend")
        if np.abs(values - basis @ weights).max() <= 1e-12 * np.abs(values).max():
            raise MetamodelError(f"a {self.trend} trend alone returns these responses: nothing is left for kriging")
        bounds = [self._LENGTH_RANGE, self._LENGTH_RANGE]
        if self._fixed_nugget is None:
            bounds.append(self._NUGGET_RANGE)
        log_bounds = np.log(bounds)
        starts = np.random.default_rng(0).uniform(*log_bounds.T, size=(self._STARTS, len(bounds)))
        runs = [minimize(self._likelihood_loss, x, jac=True, bounds=log_bounds, method="L-BFGS-B") for x in starts]
        self.length_scales, self.nugget = self._parameters(min(runs, key=lambda run: run.fun).x)
        self._state = self._concentrate(self.length_scales, self.nugget)
        self.condition_number = float(np.linalg.cond(self._matrix(self.length_scales, self.nugget)))

    def _predict(self, design: NDArray[np.float64]) -> NDArray[np.float64]:
        points = self.domain.scale(design)
        return _trend(points, self.trend) @ self._state.trend_weights + self._cross(points) @ self._state.weights

    def predict_variance(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the variance of a new sample at ``design_mm``, shape (n, 2), as shape (n,), in squared units.

        The kriging variance (uncertain trend included) plus the nugget.

        Raises:
            DesignDomainError: a design lies outside the domain.
        """
        design = _designs(design_mm)
        self.domain.require_inside(design)
        points = self.domain.scale(design)
        state, cross, basis = self._state, self._cross(points), _trend(self._centres, self.trend)
        solved_basis = cho_solve(state.factor, basis)
        missed = _trend(points, self.trend) - cross @ solved_basis
        trend_term = np.einsum("ij,ji->i", missed, np.linalg.solve(basis.T @ solved_basis, missed.T))
        explained = np.einsum("ij,ji->i", cross, cho_solve(state.factor, cross.T))
        return state.variance * (np.maximum(1.0 - explained + trend_term, 0.0) + self.nugget)

    def fitted_parameters(self) -> dict[str, object]:
        return {
            "trend": self.trend,
            "correlation": self.correlation,
            "length_scales": self.length_scales.tolist(),
            "nugget": self.nugget,
            "condition_number": self.condition_number,
        }

    def _parameters(self, log_parameters: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return length scales and nugget."""
        parameters = np.exp(log_parameters)
        return parameters[:2], float(parameters[2]) if self._fixed_nugget is None else self._fixed_nugget

    def _cross(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._correlate(points, self.length_scales)

    def _correlate(self, points: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
        scaled = np.abs(points[:, None, :] - self._centres) / lengths
        return CORRELATIONS[self.correlation].value(scaled).prod(axis=-1)

    def _matrix(self, lengths: NDArray[np.float64], nugget: float) -> NDArray[np.float64]:
        return self._correlate(self._centres, lengths) + nugget * np.eye(len(self._centres))

    def _concentrate(self, lengths: NDArray[np.float64], nugget: float) -> _KrigingState:
        """Return the trend (generalised least squares) and variance that are most likely with these parameters."""
        basis = _trend(self._centres, self.trend)
        factor = cho_factor(self._matrix(lengths, nugget), lower=True)
        solved = cho_solve(factor, basis)
        trend_weights = np.linalg.solve(basis.T @ solved, solved.T @ self._values)
        deviation = self._values - basis @ trend_weights
        weights = cho_solve(factor, deviation)
        return _KrigingState(factor, trend_weights, weights, float(deviation @ weights) / len(deviation))

    def _likelihood_loss(self, log_parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return the negative logarithm of the concentrated likelihood, and its gradient."""
        lengths, nugget = self._parameters(log_parameters)
        state = self._concentrate(lengths, nugget)
        count = len(self._values)
        loss = 0.5 * count * math.log(state.variance) + float(np.log(np.diag(state.factor[0])).sum())
        # d loss = tr((K^-1 - w w^T / s^2) dK) / 2: the trend and the variance are at their optimum.
        explained = np.outer(state.weights, state.weights) / state.variance
        sensitivity = 0.5 * (cho_solve(state.factor, np.eye(count)) - explained)
        scaled = np.abs(self._centres[:, None, :] - self._centres) / lengths
        smooth = self._correlate(self._centres, lengths)
        slopes = CORRELATIONS[self.correlation].slope(scaled) * smooth[:, :, None]
        gradient = np.einsum("ij,ijk->k", sensitivity, slopes)
        if self._fixed_nugget is None:
            gradient = np.append(gradient, nugget * np.trace(sensitivity))
        return loss, gradient


@dataclass(frozen=True)
class _KrigingState:
    factor: tuple[NDArray[np.float64], bool]
    trend_weights: NDArray[np.float64]
    weights: NDArray[np.float64]
    variance: float


TRENDS = {"constant": 1, "linear": 3, "quadratic": 6}
"""Polynomial trends, each with its number of terms in a and b."""


@dataclass(frozen=True)
class Correlation:
    """Correlation along one variable against d, distance over length scale.

    Args:
        value: of the correlation, one at d = 0.
        slope: its derivative by the logarithm of the length scale, over its value.
    """

    value: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    slope: Callable[[NDArray[np.float64]], NDArray[np.float64]]


_R3, _R5 = math.sqrt(3.0), math.sqrt(5.0)
CORRELATIONS = {
    "gaussian": Correlation(lambda d: np.exp(-0.5 * d**2), lambda d: d**2),
    "exponential": Correlation(lambda d: np.exp(-d), lambda d: d),
    "matern32": Correlation(lambda d: (1.0 + _R3 * d) * np.exp(-_R3 * d), lambda d: 3.0 * d**2 / (1.0 + _R3 * d)),
    "matern52": Correlation(
        lambda d: (1.0 + _R5 * d + 5.0 / 3.0 * d**2) * np.exp(-_R5 * d),
        lambda d: 5.0 * d**2 * (1.0 + _R5 * d) / (3.0 + 3.0 * _R5 * d + 5.0 * d**2),
    ),
}


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


METAMODELS: dict[str, Callable[..., Metamodel]] = {
    "prs": PolynomialResponseSurface,
    "rbf": ThinPlateSpline,
    "krg": Kriging,
    "rbf_gaussian": GaussianRadialBasis,
    "krg_nugget": functools.partial(Kriging, nugget=None),
}
"""Makers of unfitted metamodels, each with an optional ``domain``. The first three are those of the paper's Table 3."""


@functools.cache
def load_metamodel(name: str) -> MuscleMetamodel:
    """Fit the metamodel ``name`` (a key of :data:`METAMODELS`) to Table 1 and measure its error on Table 2.

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
        raise MetamodelError(f"expected designs as rows (a, b), found shape {design.shape}")
    return design


def _require_distinct(design: NDArray[np.float64]) -> None:
    unique, first = np.unique(design, axis=0, return_index=True)
    if len(unique) < len(design):
        row = sorted(set(range(len(design))) - set(first.tolist()))[0]
        raise MetamodelError(f"design a = {design[row, 0]:g}, b = {design[row, 1]:g} mm occurs twice; keep one sample")


def _trend(points: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the polynomials of a trend at scaled designs, shape (n, TRENDS[name])."""
    x, y = points.T
    return np.column_stack([np.ones_like(x), x, y, x**2, y**2, x * y][: TRENDS[name]])


def _squared_distances(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return (left[:, None, :] - right[None, :, :]) ** 2


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error**2)))
