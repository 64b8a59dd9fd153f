"""How well predictions meet what they predict: R2, RMSE and MRE, in physical units and in the paper's normalisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.metamodel import Metamodel


class JudgingError(ValueError):
    """These samples cannot judge a metamodel; the message says why."""


@dataclass(frozen=True)
class Accuracy:
    """Errors of predictions on judging samples.

    The paper's Table 3 is not made with its Eqs. 6 and 8 as printed: both figures there are divided by the range of the
    judging responses, and MRE is the largest absolute error over that range.

    Args:
        r2: coefficient of determination (paper, Eq. 7).
        rmse_normalised, mre_normalised: RMSE and largest absolute error over the range of the judging responses.
        rmse, mre: the same in the response's unit.
        mre_relative: largest error relative to its own response, Eq. 6 as printed; None where a response is zero.
    """

    r2: float
    rmse_normalised: float
    mre_normalised: float
    rmse: float
    mre: float
    mre_relative: float | None

    @classmethod
    def of(cls, predicted: NDArray[np.float64], expected: NDArray[np.float64]) -> Accuracy:
        """Return the errors of ``predicted`` against ``expected``, each of shape (n,).

        Raises:
            JudgingError: ``expected`` does not vary, so that neither R2 nor the normalisation means anything.
        """
        spread = float(np.ptp(expected)) if expected.size else 0.0
        if spread == 0.0:
            raise JudgingError("the judging responses do not vary; at least two different ones are needed")
        error = predicted - expected
        rmse, largest = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
        return cls(
            r2=1.0 - float(error @ error) / float(np.sum((expected - expected.mean()) ** 2)),
            rmse_normalised=rmse / spread,
            mre_normalised=largest / spread,
            rmse=rmse,
            mre=largest,
            mre_relative=float(np.max(np.abs(error / expected))) if np.all(expected) else None,
        )


def leave_one_out(
    make: Callable[[], Metamodel], design_mm: NDArray[np.float64], response: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what metamodels fitted anew without each sample predict for it, shape (n,).

    Args:
        make: returns an unfitted metamodel whose domain holds all samples.
        design_mm: rows (a, b), shape (n, 2).
        response: shape (n,).

    Raises:
        MetamodelError: a sample cannot be spared.
    """
    everyone = np.arange(len(response))
    predictions = np.empty(len(response))
    for left_out in everyone:
        kept = everyone != left_out
        model = make().fit(design_mm[kept], response[kept])
        predictions[left_out] = model.predict(design_mm[left_out : left_out + 1])[0]
    return predictions
