"""Fit the constants of a silicone to a tensile test, by least squares on the engineering stress (paper, section 2.3).

Neo-Hooke, Mooney-Rivlin and Yeoh are linear in their constants: one solution, found directly. Ogden's is linear in mu
at given exponents: the exponents are sought by SciPy's trust region from several pairs of guesses, mu follows from each
(variable projection; Golub and Pereyra 1973), kept to mu alpha >= 0, with which the model is stable at every stretch.

Models are set side by side by Akaike's criterion with its correction for few points,

    AICc = n ln(RSS / n) + 2 k + 2 k (k + 1) / (n - k - 1),

k counting the constants and the variance. Points of one pull are not independent, so differences of a few tens say
little; R2 and RMSE stand beside it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.silicone.hyperelastic import DEFORMATIONS, MODELS, Hyperelastic, LinearModel, Ogden, ogden_term
from mbpam_ros.study.silicone.tensile_test import TensileTest

Array = NDArray[np.float64]

FEWEST_POINTS = 10
"""A curve of fewer points is not fitted: three constants would follow its noise."""

GOOD_R2 = 0.995
"""A model below it is called too simple for the test."""

_OGDEN_GUESSES = (-4.0, 1.3, 3.0, 8.0)
_OGDEN_BOUNDS = ((-20.0, 1.0), (20.0, 30.0))
"""Of the lower exponent and of the gap to the higher one: terms of nearly the same exponent cancel each other."""


class FitError(MbpamError, ValueError):
    """No model can be fitted to the test; the message says why, and what would do."""


@dataclass(frozen=True)
class Fit:
    """A model fitted to a test.

    Args:
        model: with its constants.
        points: how many points of the test were fitted.
        stretch_range: least and greatest stretch among them.
        rmse_mpa: root of the mean square difference of the engineering stress [MPa].
        r2: share of the variance of the stress that is explained.
        aicc: Akaike's criterion with its correction; less is better, and only differences mean something.
    """

    model: Hyperelastic
    points: int
    stretch_range: tuple[float, float]
    rmse_mpa: float
    r2: float
    aicc: float

    def unstable(self, low: float, high: float) -> dict[str, tuple[float, float]]:
        """Return the deformations in which the model is not stable all the way from stretch ``low`` to ``high``.

        Returns:
            By the keys of :data:`~mbpam_ros.study.silicone.hyperelastic.DEFORMATIONS`, the stretches between which it
            is stable. Pulled in two directions a sheet gets thinner by the square, so a stretch is looked at as far as
            ``high`` in each deformation and down to ``low`` where one direction alone is pressed.
        """
        found = {}
        for deformation in DEFORMATIONS:
            least, greatest = self.model.stable_stretches(deformation)
            if greatest < high or (deformation == "uniaxial" and least > low):
                found[deformation] = (least, greatest)
        return found

    def as_json(self) -> dict[str, object]:
        """Return what is kept: constants, quality, stable stretches."""
        return {
            "constants": self.model.constants(),
            "shear_modulus_mpa": self.model.shear_modulus_mpa(),
            "points": self.points,
            "stretch_range": list(self.stretch_range),
            "rmse_mpa": self.rmse_mpa,
            "r2": self.r2,
            "aicc": self.aicc,
            "stable_stretches": {name: list(self.model.stable_stretches(name)) for name in DEFORMATIONS},
        }


def fit_all(test: TensileTest, strain_range: tuple[float, float]) -> dict[str, Fit]:
    """Return each model fitted to the part of the test within a range of engineering strain, the best first.

    Raises:
        FitError: too few points lie within the range, or the stress does not rise there.
    """
    stretch, stress_mpa = points_within(test, strain_range)
    fits = [_judge(_fitted(model, stretch, stress_mpa), stretch, stress_mpa) for model in MODELS.values()]
    return {fit.model.name: fit for fit in sorted(fits, key=lambda fit: fit.aicc)}


def points_within(test: TensileTest, strain_range: tuple[float, float]) -> tuple[Array, Array]:
    """Return the stretches and engineering stresses [MPa] of the test within a range of engineering strain.

    Raises:
        FitError: too few points lie within the range, or the stress does not rise there.
    """
    low, high = strain_range
    if not 0.0 <= low < high:
        raise FitError(f"the range of strain must rise from 0 or more, found {low:g} to {high:g}")
    within = (test.strain >= low) & (test.strain <= high)
    stretch, stress_mpa = 1.0 + test.strain[within], test.stress_mpa[within]
    if stretch.size < FEWEST_POINTS:
        raise FitError(
            f"{test.source}: {stretch.size} points lie between strains {low:g} and {high:g}, at least {FEWEST_POINTS} "
            f"are needed; the test goes from {test.strain[0]:.3g} to {test.strain[-1]:.3g}"
        )
    if not np.polyfit(stretch, stress_mpa, 1)[0] > 0.0:
        raise FitError(f"{test.source}: the stress does not rise between strains {low:g} and {high:g}")
    return stretch, stress_mpa


def _fitted(model: type[Hyperelastic], stretch: Array, stress_mpa: Array) -> Hyperelastic:
    if issubclass(model, LinearModel):
        count = len(fields(model))  # type: ignore[arg-type]
        columns = np.column_stack([model(*row).stress_mpa(stretch) for row in np.eye(count)])
        return model(*map(float, np.linalg.lstsq(columns, stress_mpa, rcond=None)[0]))
    return _fitted_ogden(stretch, stress_mpa)


def _fitted_ogden(stretch: Array, stress_mpa: Array) -> Ogden:
    largest = float(np.abs(stress_mpa).max())

    def solved(lower: float, gap: float) -> tuple[Array, Array]:
        signs = np.sign([lower, lower + gap])
        columns = np.column_stack([ogden_term(stretch, lower), ogden_term(stretch, lower + gap)]) * signs
        factors = nnls(columns, stress_mpa)[0]
        return signs * factors, (columns @ factors - stress_mpa) / largest

    tries = [
        least_squares(lambda unknown: solved(*unknown)[1], (low, high - low), bounds=_OGDEN_BOUNDS)
        for low, high in itertools.combinations(_OGDEN_GUESSES, 2)
    ]
    lower, gap = map(float, min(tries, key=lambda each: each.cost).x)
    factors, _ = solved(lower, gap)
    return Ogden(float(factors[0]), lower, float(factors[1]), lower + gap)


def _judge(model: Hyperelastic, stretch: Array, stress_mpa: Array) -> Fit:
    residual = model.stress_mpa(stretch) - stress_mpa
    count, known = stretch.size, len(model.constants()) + 1
    # a curve that is the model's own leaves rounding alone, whose logarithm would tell models apart by chance
    squares = max(float(residual @ residual), count * (1e-9 * float(np.abs(stress_mpa).max())) ** 2)
    return Fit(
        model,
        count,
        (float(stretch[0]), float(stretch[-1])),
        float(np.sqrt(np.mean(residual**2))),
        1.0 - float(residual @ residual) / float(np.sum((stress_mpa - stress_mpa.mean()) ** 2)),
        count * np.log(squares / count) + 2.0 * known + 2.0 * known * (known + 1.0) / max(count - known - 1.0, 1.0),
    )
