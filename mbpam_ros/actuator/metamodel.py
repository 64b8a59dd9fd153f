"""Surrogates of the paper's finite element samples: greatest bend and tip force over the design (a, b).

Metamodels behind one contract (:class:`Metamodel`): polynomial response surface (PRS), radial basis functions (RBF)
and kriging (KRG), each fitted to the 21 samples of Table 1 and judged on the 8 of Table 2. All values are the
paper's: two adjacent chambers (PDC) at 100 kPa gauge.
"""

from __future__ import annotations

import copy
import functools
import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.optimize import OptimizeResult, minimize, minimize_scalar
from scipy.spatial.distance import cdist
from scipy.special import xlogy

from mbpam_ros.actuator.design import PAPER_DOMAIN, DesignDomain, MetamodelName, MuscleDesign
from mbpam_ros.actuator.sample_check import QUADRATIC, MetamodelError, Powers, monomials, require_determining
from mbpam_ros.actuator.tables import read_table

TRAINING_TABLE = "doe_training.csv"
VALIDATION_TABLE = "doe_validation.csv"

REFITTED_SAMPLES = 40
"""Up to so many samples, leaving each out is refitting without it; 5 to 10 s for the five metamodels."""

_BLOCK = 1024
_ROUNDING = 1e-12
"""Share of a response that its rounding may be."""
_SPARED = 1e-9
"""Least share of a sample that the others do not tell, if it can be left out: one minus its leverage."""
_COEFFICIENTS_LOSE = 1e-6
"""Of the responses' standard deviation, when the polynomial is evaluated in mm."""


@dataclass(frozen=True)
class LeftOut:
    """What a metamodel says of each of its samples when that sample is left out.

    Args:
        predicted: shape (n,), in the response's unit.
        sigma: standard deviation that the metamodel states there, shape (n,); None where it states none.
        how: in words, what stayed as all samples gave it.
    """

    predicted: NDArray[np.float64]
    sigma: NDArray[np.float64] | None
    how: str


Fitted = TypeVar("Fitted", bound="Metamodel")


class Metamodel(ABC):
    """One response over a domain of designs.

    ``fit`` once, then ``predict``; both take designs as rows (a, b) in millimetres, shape (n, 2), and refuse those
    outside the domain. Within, designs are scaled to [-1, 1]^2 and responses to mean 0 and standard deviation 1, so
    that neither units nor offsets change what a metamodel predicts.
    """

    least_samples = 6
    powers: Powers = QUADRATIC
    chooses = ""
    """What a fit chooses besides weights and trend, in words."""

    def __init__(self, domain: DesignDomain = PAPER_DOMAIN) -> None:
        self.domain = domain

    def fit(self: Fitted, design_mm: ArrayLike, response: ArrayLike) -> Fitted:
        """Fit to ``response``, shape (n,), at ``design_mm``, shape (n, 2); return self.

        Raises:
            DesignDomainError: a sample lies outside the domain.
            MetamodelError: the shapes do not match, a response is not finite, or the samples are too few or badly
                placed (:func:`~mbpam_ros.actuator.sample_check.require_determining`).
        """
        design, values = _designs(design_mm), np.asarray(response, dtype=float)
        if values.shape != (len(design),):
            raise MetamodelError(
                f"expected one response for each design, found {len(design)} designs and responses of shape "
                f"{values.shape}"
            )
        if not np.isfinite(values).all():
            raise MetamodelError("expected finite responses")
        self.domain.require_inside(design)
        require_determining(design, self.domain, self.least_samples, self.powers)
        self._design_mm, self._points = design, self.domain.scale(design)
        # A response that varies by its rounding only has no scale of its own.
        self._middle, spread = float(values.mean()), float(values.std())
        self._spread = spread if spread > _ROUNDING * np.abs(values).max() else 1.0
        self._values = (values - self._middle) / self._spread
        self._fit()
        return self

    def predict(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the response at ``design_mm``, shape (n, 2), as shape (n,).

        Raises:
            DesignDomainError: a design lies outside the domain. The message names the nearest design inside.
        """
        points = self._inside(design_mm)
        # In blocks: distances from all designs to all samples at once would fill the memory.
        blocks = [points[start : start + _BLOCK] for start in range(0, len(points), _BLOCK)]
        values = np.concatenate([self._predict(block) for block in blocks]) if blocks else np.empty(0)
        return self._middle + self._spread * values

    def leave_one_out(self) -> LeftOut:
        """Return what this metamodel predicts for each sample without it.

        Up to :data:`REFITTED_SAMPLES` samples, kriging and Gaussians are fitted anew to the others: so few tell so
        little of length scales and widths that keeping those of all samples would flatter (interpolating kriging of
        the paper's 21 bends: 4.8 instead of 10.6 deg rms). With more, the closed form of the metamodel's kind: weights
        and trend are those of the other samples, what the fit has chosen besides (length scales, nugget and variance;
        width and mean) stays. The cubic and the spline choose nothing else, so their closed form is a refit.

        Raises:
            MetamodelError: a sample cannot be spared, because the others alone do not determine the metamodel.
        """
        if self.chooses and len(self._values) <= REFITTED_SAMPLES:
            return self._refitted_without_each()
        orthogonal, _ = np.linalg.qr(self._basis(self._points))
        leverage = (orthogonal**2).sum(axis=1)
        if leverage.max() > 1.0 - _SPARED:
            a, b = self._design_mm[int(np.argmax(leverage))]
            raise MetamodelError(
                f"the sample a = {a:g}, b = {b:g} mm cannot be left out: the others alone do not determine the "
                "polynomial; add samples, or judge on others"
            )
        errors, deviations = self._left_out(leverage)
        predicted = self._middle + self._spread * (self._values + errors)
        how = f"closed form, with {self.chooses} of all samples" if self.chooses else "closed form, as refits give"
        return LeftOut(predicted, None if deviations is None else self._spread * deviations, how)

    def deviation(self, design_mm: ArrayLike) -> NDArray[np.float64] | None:
        """Return the standard deviation that this metamodel states of a new sample at ``design_mm``, shape (n, 2).

        Returns:
            Shape (n,), in the response's unit; None from a metamodel that states none.

        Raises:
            DesignDomainError: a design lies outside the domain.
        """
        return None

    def fitted_parameters(self) -> dict[str, object]:
        """Return what the fit chose, as plain values that JSON can hold."""
        return {}

    def _refitted_without_each(self) -> LeftOut:
        values = self._middle + self._spread * self._values
        predicted, deviations = [], []
        for row, design in enumerate(self._design_mm):
            kept = np.arange(len(values)) != row
            try:
                other = copy.copy(self).fit(self._design_mm[kept], values[kept])
            except MetamodelError as error:
                raise MetamodelError(
                    f"the sample a = {design[0]:g}, b = {design[1]:g} mm cannot be left out: of the others, {error}"
                ) from error
            predicted.append(other.predict(design[None])[0])
            deviations.append(other.deviation(design[None]))
        stated = [deviation for deviation in deviations if deviation is not None]
        return LeftOut(np.array(predicted), np.concatenate(stated) if stated else None, "refits")

    def _inside(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the scaled designs."""
        design = _designs(design_mm)
        self.domain.require_inside(design)
        return self.domain.scale(design)

    @abstractmethod
    def _basis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the terms of the polynomial part at scaled designs, shape (n, terms)."""

    @abstractmethod
    def _fit(self) -> None:
        """Fit to ``_values`` at ``_points``, both scaled."""

    @abstractmethod
    def _predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]: ...

    @abstractmethod
    def _left_out(self, leverage: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Return errors (prediction minus value) at left out samples and the stated deviations, scaled."""


class PolynomialResponseSurface(Metamodel):
    """Cubic polynomial without high-order cross terms, least squares (paper, Eq. 3; gives its Eqs. 9 and 10).

    Fitted in the scaled box. ``coefficients`` belong to 1, a, b, a^2, b^2, a b, a^3, b^3, with a and b in millimetres:
    ``scaled_coefficients``, multiplied out in exact arithmetic. Where the range is small beside a and b themselves they
    cancel so much that double precision cannot evaluate them; ``predict`` does not use them, and
    :meth:`fitted_parameters` then gives the scaled ones instead.

    Left out: error over one minus leverage, the diagonal of the hat matrix (Allen 1974), which is a refit's.
    """

    least_samples = 8
    powers = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0), (0, 3))

    def _basis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return monomials(points, self.powers)

    def _fit(self) -> None:
        self._weights = np.linalg.lstsq(self._basis(self._points), self._values, rcond=None)[0]
        self.scaled_coefficients = self._spread * self._weights
        self.scaled_coefficients[0] += self._middle
        self.coefficients = self._in_mm()

    def _predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._basis(points) @ self._weights

    def _left_out(self, leverage: NDArray[np.float64]) -> tuple[NDArray[np.float64], None]:
        return (self._predict(self._points) - self._values) / (1.0 - leverage), None

    def fitted_parameters(self) -> dict[str, object]:
        in_mm = monomials(self._design_mm, self.powers) @ self.coefficients
        lost = np.abs(in_mm - self.predict(self._design_mm)).max()
        if lost <= _COEFFICIENTS_LOSE * self._spread:
            return {"coefficients": self.coefficients.tolist()}
        return {
            "coefficients_scaled": self.scaled_coefficients.tolist(),
            "scaled": "a and b to -1 ... 1 over the domain: those in mm lose all digits by cancellation",
        }

    def _in_mm(self) -> NDArray[np.float64]:
        """Return the coefficients of the polynomial in a and b [mm]."""
        low, high = ([Fraction(value) for value in row] for row in self.domain.bounds_mm.tolist())
        # x = shift + slope a, and so for b
        slope = [2 / (top - bottom) for bottom, top in zip(low, high, strict=True)]
        shift = [-1 - factor * bottom for factor, bottom in zip(slope, low, strict=True)]
        total = dict.fromkeys(self.powers, Fraction(0))
        for weight, (i, j) in zip(self.scaled_coefficients.tolist(), self.powers, strict=True):
            for k, m in itertools.product(range(i + 1), range(j + 1)):
                part = [
                    math.comb(power, term) * slope[axis] ** term * shift[axis] ** (power - term)
                    for axis, (power, term) in enumerate(((i, k), (j, m)))
                ]
                total[k, m] += Fraction(weight) * part[0] * part[1]
        return np.array([float(total[power]) for power in self.powers])


class ThinPlateSpline(Metamodel):
    """Sum of r^2 ln r, one on each sample, plus a plane to which the weights are orthogonal (paper, Eq. 4).

    r is measured in the design scaled to [-1, 1]^2. Nothing is left to choose, and the paper's RBF row of Table 3 comes
    back in every figure to 0.0001; with the Gaussians that the paper names it does not, whatever their width
    (:class:`GaussianRadialBasis`). Duchon's spline: the interpolant of least bending energy.

    Left out: weight over the diagonal of the inverse of the whole system, plane included (Rippa 1999, Eq. 13, whose
    proof holds for it), which is a refit's.
    """

    def _basis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return _trend(points, "linear")

    def _fit(self) -> None:
        solution = np.linalg.solve(self._matrix(), np.concatenate([self._values, np.zeros(3)]))
        self._weights, self._plane = solution[:-3], solution[-3:]

    def _predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._kernel(points) @ self._weights + self._basis(points) @ self._plane

    def _left_out(self, leverage: NDArray[np.float64]) -> tuple[NDArray[np.float64], None]:
        return -self._weights / np.diag(np.linalg.inv(self._matrix()))[:-3], None

    def fitted_parameters(self) -> dict[str, object]:
        return {"basis": "r^2 ln r", "trend": "linear"}

    def _matrix(self) -> NDArray[np.float64]:
        plane = self._basis(self._points)
        return np.block([[self._kernel(self._points), plane], [plane.T, np.zeros((3, 3))]])

    def _kernel(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        # r^2 ln r = r^2 ln(r^2) / 2, with its limit 0 at the centre.
        distance2 = _squared_distances(points, self._points)
        kernel: NDArray[np.float64] = 0.5 * xlogy(distance2, distance2)
        return kernel


class GaussianRadialBasis(Metamodel):
    """Sum of Gaussians exp(-(epsilon r)^2), one on each sample, about the mean response (paper, Eq. 4).

    r is measured in the design scaled to [-1, 1]^2. The shape parameter ``epsilon`` is the one with the smallest
    leave-one-out error (Rippa's formula) between 0.1 and 3. A ridge of 1e-8 on the diagonal keeps flat Gaussians
    solvable; with it the samples come back to 0.4 percent (theta_max) or exactly (F_max).

    Left out: weight over the diagonal of the inverse (Rippa 1999, Eq. 13), with the epsilon and mean of all samples.
    """

    chooses = "width and mean"
    _RIDGE = 1e-8
    _EPSILON_RANGE = (0.1, 3.0)

    def _basis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return _trend(points, "constant")

    def _fit(self) -> None:
        self._distance2 = _squared_distances(self._points, self._points)
        low, high = np.log(self._EPSILON_RANGE)
        scan = np.linspace(low, high, 25)
        errors = [self._leave_one_out_rms(math.exp(x)) for x in scan]
        best, spacing = scan[int(np.argmin(errors))], scan[1] - scan[0]
        refined = minimize_scalar(
            lambda x: self._leave_one_out_rms(math.exp(x)),
            bounds=(max(low, best - spacing), min(high, best + spacing)),
            method="bounded",
        )
        self.epsilon = math.exp(float(refined.x))
        self._weights = np.linalg.solve(self._matrix(self.epsilon), self._values)

    def _predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        kernel = np.exp(-(self.epsilon**2) * _squared_distances(points, self._points))
        values: NDArray[np.float64] = kernel @ self._weights
        return values

    def _left_out(self, leverage: NDArray[np.float64]) -> tuple[NDArray[np.float64], None]:
        return self._left_out_errors(self.epsilon), None

    def fitted_parameters(self) -> dict[str, object]:
        return {"basis": "exp(-(epsilon r)^2)", "trend": "mean", "epsilon": self.epsilon, "ridge": self._RIDGE}

    def _matrix(self, epsilon: float) -> NDArray[np.float64]:
        return np.exp(-(epsilon**2) * self._distance2) + self._RIDGE * np.eye(len(self._distance2))

    def _left_out_errors(self, epsilon: float) -> NDArray[np.float64]:
        inverse = _inverse(cho_factor(self._matrix(epsilon), lower=True, overwrite_a=True)[0])
        return -(inverse @ self._values) / np.diag(inverse)

    def _leave_one_out_rms(self, epsilon: float) -> float:
        return _rms(self._left_out_errors(epsilon))


class Kriging(Metamodel):
    """Universal kriging (paper, Eq. 5): a polynomial trend h plus a Gaussian process z.

    The design is scaled to [-1, 1]^2. The correlation is a product over a and b of one of :data:`CORRELATIONS`, of
    d_k / l_k; the nugget, a share of the process's variance, stands on its diagonal. The two length scales (0.1 to 20)
    maximise the likelihood concentrated over trend and variance, from four seeded starts; with more than 150 samples
    the starts compete on 150 of them, and the best goes on with all.

    Left out: Dubrule, Cross validation of kriging in a unique neighborhood (1983), which is a refit of trend and
    weights with the length scales, the nugget and the variance of all samples.

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

    chooses = "length scales, nugget and variance"
    _LENGTH_RANGE = (0.1, 20.0)
    _NUGGET_RANGE = (1e-8, 0.1)
    _LEAST_NUGGET = 1e-12
    _STARTS = 4
    _MOST_FOR_STARTS = 150

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
        self.least_samples = max(Metamodel.least_samples, TRENDS[trend] + 2)

    def _basis(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return _trend(points, self.trend)

    def _fit(self) -> None:
        basis = self._basis(self._points)
        weights = np.linalg.lstsq(basis, self._values, rcond=None)[0]
        if np.abs(self._values - basis @ weights).max() <= _ROUNDING:
            raise MetamodelError(f"a {self.trend} trend alone returns these responses: nothing is left for kriging")
        self._apart = _apart(self._points, self._points)
        self.length_scales, self.nugget = self._parameters(self._most_likely())
        self._state = self._concentrate(self.length_scales, self.nugget)
        self.condition_number = float(np.linalg.cond(self._matrix(self.length_scales, self.nugget)))

    def _most_likely(self) -> NDArray[np.float64]:
        """Return the logarithms of the most likely length scales (and nugget)."""
        bounds = [self._LENGTH_RANGE, self._LENGTH_RANGE]
        if self._fixed_nugget is None:
            bounds.append(self._NUGGET_RANGE)
        log_bounds = np.log(bounds)
        low, high = log_bounds.T
        starts = np.random.default_rng(0).uniform(low, high, size=(self._STARTS, len(bounds)))
        some = self._with_some_samples()
        best = min((some._climb(start, log_bounds) for start in starts), key=lambda run: run.fun)
        found: NDArray[np.float64] = best.x if some is self else self._climb(best.x, log_bounds).x
        return found

    def _climb(self, start: NDArray[np.float64], log_bounds: NDArray[np.float64]) -> OptimizeResult:
        return minimize(self._likelihood_loss, start, jac=True, bounds=log_bounds, method="L-BFGS-B")

    def _with_some_samples(self) -> Kriging:
        """Return this metamodel with as many samples, drawn once, as the starts need to tell which is best."""
        count = len(self._values)
        if count <= self._MOST_FOR_STARTS:
            return self
        drawn = np.sort(np.random.default_rng(0).choice(count, self._MOST_FOR_STARTS, replace=False))
        some = copy.copy(self)
        some._points, some._values = self._points[drawn], self._values[drawn]
        some._apart = _apart(some._points, some._points)
        return some

    def _predict(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._basis(points) @ self._state.trend_weights + self._cross(points) @ self._state.weights

    def predict_variance(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the variance of a new sample at ``design_mm``, shape (n, 2), as shape (n,), in squared units.

        The kriging variance (uncertain trend included) plus the nugget.

        Raises:
            DesignDomainError: a design lies outside the domain.
        """
        points = self._inside(design_mm)
        state, cross, basis = self._state, self._cross(points), self._basis(self._points)
        solved_basis = cho_solve(state.factor, basis)
        missed = self._basis(points) - cross @ solved_basis
        trend_term = np.einsum("ij,ji->i", missed, np.linalg.solve(basis.T @ solved_basis, missed.T))
        explained = np.einsum("ij,ji->i", cross, cho_solve(state.factor, cross.T))
        share = np.maximum(1.0 - explained + trend_term, 0.0) + self.nugget
        variance: NDArray[np.float64] = self._spread**2 * state.variance * share
        return variance

    def deviation(self, design_mm: ArrayLike) -> NDArray[np.float64]:
        return np.sqrt(self.predict_variance(design_mm))

    def _left_out(self, leverage: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        # Dubrule 1983: with Q the inverse of K without what the trend takes, error (Q y)_i / Q_ii, variance 1 / Q_ii.
        basis = self._basis(self._points)
        solved = cho_solve(self._state.factor, basis)
        inverse = _inverse(self._state.factor[0])
        diagonal = np.diag(inverse) - np.einsum("ij,ji->i", solved, np.linalg.solve(basis.T @ solved, solved.T))
        return -self._state.weights / diagonal, np.sqrt(self._state.variance / diagonal)

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
        return self._correlate(_apart(points, self._points), self.length_scales)

    def _correlate(self, apart: NDArray[np.float64], lengths: NDArray[np.float64]) -> NDArray[np.float64]:
        value = CORRELATIONS[self.correlation].value
        return value(apart[0] / lengths[0]) * value(apart[1] / lengths[1])

    def _matrix(self, lengths: NDArray[np.float64], nugget: float) -> NDArray[np.float64]:
        matrix = self._correlate(self._apart, lengths)
        np.fill_diagonal(matrix, 1.0 + nugget)
        return matrix

    def _concentrate(self, lengths: NDArray[np.float64], nugget: float) -> _KrigingState:
        """Return the trend (generalised least squares) and variance that are most likely with these parameters."""
        basis = self._basis(self._points)
        try:
            factor = cho_factor(self._matrix(lengths, nugget), lower=True, overwrite_a=True)
        except np.linalg.LinAlgError as error:
            raise MetamodelError(
                f"the correlations of {len(basis)} samples are singular in double precision with a nugget of "
                f"{nugget:g}: estimate the nugget (krg_nugget), or leave out samples that are close together"
            ) from error
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
        sensitivity = _inverse(state.factor[0])
        sensitivity -= np.outer(state.weights / state.variance, state.weights)
        sensitivity *= 0.5
        weighted = sensitivity * self._correlate(self._apart, lengths)
        slope = CORRELATIONS[self.correlation].slope
        gradient = np.array([np.vdot(weighted, slope(self._apart[k] / lengths[k])) for k in range(2)])
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


METAMODELS: dict[MetamodelName, Callable[..., Metamodel]] = {
    "prs": PolynomialResponseSurface,
    "rbf": ThinPlateSpline,
    "krg": Kriging,
    "rbf_gaussian": GaussianRadialBasis,
    "krg_nugget": functools.partial(Kriging, nugget=None),
}
"""Makers of unfitted metamodels, each with an optional ``domain``. The first three are those of the paper's Table 3."""


def metamodel_name(name: str) -> MetamodelName:
    """Return ``name`` as a key of :data:`METAMODELS`.

    Raises:
        ValueError: unknown name; the message lists the known ones.
    """
    for known in METAMODELS:
        if known == name:
            return known
    raise ValueError(f"unknown metamodel {name!r}; known: {', '.join(METAMODELS)}")


@functools.cache
def load_metamodel(name: str) -> MuscleMetamodel:
    """Fit the metamodel ``name`` (a key of :data:`METAMODELS`) to Table 1 and measure its error on Table 2.

    Raises:
        ValueError: unknown name; the message lists the known ones.
        ConfigError: a table is missing or unreadable.
    """
    make = METAMODELS[metamodel_name(name)]
    design, theta, force = read_samples(TRAINING_TABLE)
    checked, checked_theta, checked_force = read_samples(VALIDATION_TABLE)
    theta_model, force_model = make().fit(design, theta), make().fit(design, force)
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


def _trend(points: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return the polynomials of a trend at scaled designs, shape (n, TRENDS[name])."""
    return monomials(points, QUADRATIC[: TRENDS[name]])


def _squared_distances(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    distances: NDArray[np.float64] = cdist(left, right, "sqeuclidean")
    return distances


def _apart(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in a and in b of rows of ``left`` (n, 2) and ``right`` (m, 2), shape (2, n, m)."""
    apart: NDArray[np.float64] = np.abs(left.T[:, :, None] - right.T[:, None, :])
    return apart


def _inverse(lower_factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of the matrix with this lower Cholesky factor: a third of the work of solving for it."""
    inverse, _ = dpotri(lower_factor, lower=True)
    below = np.tril(inverse, -1)
    whole: NDArray[np.float64] = below + below.T + np.diag(np.diag(inverse))
    return whole


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error**2)))
