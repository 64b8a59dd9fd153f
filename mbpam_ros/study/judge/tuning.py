"""Fit the weights of the detector's confidence to images of the tuning set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from mbpam_ros.vision.confidence import FEATURES, features
from mbpam_ros.vision.region_fit import Hypothesis

_RIDGE = 1e-3


def fit_weights(hypotheses: Sequence[Hypothesis], right: Sequence[bool]) -> dict[str, float]:
    """Return the weights of the logistic function that makes what was seen most likely.

    Maximum likelihood with a ridge of 1e-3 a sample, which keeps the weights of features that hardly vary small.

    Args:
        hypotheses: of all forms, whichever was answered.
        right: whether each is right.
    """
    rows = np.array([[features(item)[name] for name in FEATURES] for item in hypotheses])
    sign = np.where(np.asarray(right), 1.0, -1.0)
    penalty = np.full(len(FEATURES), _RIDGE * len(rows))
    penalty[0] = 0.0

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin = sign * (rows @ weights)
        slope = -sign / (1.0 + np.exp(np.clip(margin, -500.0, 500.0)))
        value = np.logaddexp(0.0, -margin).sum() + 0.5 * (penalty * weights**2).sum()
        return float(value), rows.T @ slope + penalty * weights

    weights = minimize(loss, np.zeros(len(FEATURES)), jac=True, method="L-BFGS-B", options={"maxiter": 2000}).x
    return {name: round(float(value), 3) for name, value in zip(FEATURES, weights, strict=True)}
