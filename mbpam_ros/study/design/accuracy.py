"""How well predictions meet what they predict, and whether a stated deviation covers their errors.

R2, RMSE and MRE are in physical units and in the paper's normalisation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from mbpam_ros.errors import MbpamError


class JudgingError(MbpamError, ValueError):
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


@dataclass(frozen=True)
class Coverage:
    """Whether a stated standard deviation covers the errors at samples that were held back.

    Args:
        rms_score: root mean square of errors over their stated standard deviations; 1 of an honest one.
        within_two: how many errors are at most two of them.
        count: of errors.
        held_back: how, in words.
    """

    rms_score: float
    within_two: int
    count: int
    held_back: str

    @classmethod
    def of(cls, error: NDArray[np.float64], sigma: NDArray[np.float64], held_back: str) -> Coverage:
        """Return the coverage of ``error`` by ``sigma``, each of shape (n,), n at least 1."""
        score = error / sigma
        return cls(float(np.sqrt(np.mean(score**2))), int(np.sum(np.abs(score) <= 2.0)), len(score), held_back)

    @property
    def covers(self) -> bool:
        """Whether the scores are no larger than chance would have them in 39 of 40 cases, were ``sigma`` right.

        Their sum of squares is then that of as many standard normal numbers, with a chi-squared distribution. Errors
        at samples that are left out in turn depend a little on each other, for which no allowance is made.
        """
        quantile = 2.0 * float(gammaincinv(0.5 * self.count, 0.975))
        return self.count * self.rms_score**2 <= quantile

    def as_json(self) -> dict[str, object]:
        """Return the figures as plain values."""
        return {**asdict(self), "covers": self.covers}

    def text(self) -> str:
        """Return the verdict in words."""
        verdict = "it covers" if self.covers else f"do not trust it, count on {self.rms_score:.1f} times as much"
        return (
            f"errors at held-back samples ({self.held_back}) are {self.rms_score:.1f} times sigma (rms), "
            f"{self.within_two} of {self.count} within two: {verdict}"
        )
