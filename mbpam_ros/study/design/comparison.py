"""Metamodels beside each other: error against time, each fitted to the same samples and judged on the same others."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.metamodel import Metamodel
from mbpam_ros.study.design.accuracy import Accuracy, Coverage
from mbpam_ros.study.design.samples import Samples

_MANY = 10_000
_FEW_SAMPLES = 100


@dataclass(frozen=True)
class Speed:
    """Wall time [s]: of a fit, and of predicting one design and 10 000 designs.

    Medians, but of a fit to more than 100 samples, which is timed once.
    """

    fit_s: float
    one_evaluation_s: float
    ten_thousand_evaluations_s: float


@dataclass(frozen=True)
class Judged:
    """One metamodel of one response.

    Args:
        accuracy: on the judging samples.
        speed: of this process on this machine.
        parameters: what the fit chose.
        predicted: on the judging samples, shape (n,).
        coverage: of the errors by the standard deviation that the metamodel states; None if it states none.
        held_back: how samples were held back, in words.
    """

    accuracy: Accuracy
    speed: Speed
    parameters: dict[str, object]
    predicted: NDArray[np.float64]
    coverage: Coverage | None
    held_back: str

    def as_json(self) -> dict[str, object]:
        """Return figures of error, times and fitted parameters as plain values."""
        return {
            **asdict(self.accuracy),
            **asdict(self.speed),
            "parameters": self.parameters,
            "held_back": self.held_back,
            "sigma_coverage": None if self.coverage is None else self.coverage.as_json(),
        }

    def row(self) -> dict[str, object]:
        """Return everything as plain values, from which :meth:`of_row` makes it again."""
        return {**asdict(self), "predicted": self.predicted.tolist()}

    @classmethod
    def of_row(cls, row: dict) -> Judged:
        """Return what :meth:`row` wrote down."""
        return cls(
            Accuracy(**row["accuracy"]),
            Speed(**row["speed"]),
            row["parameters"],
            np.array(row["predicted"]),
            None if row["coverage"] is None else Coverage(**row["coverage"]),
            row["held_back"],
        )


def judge(make: Callable[[], Metamodel], training: Samples, validation: Samples | None) -> dict[str, Judged]:
    """Fit one kind of metamodel to each response of ``training`` and judge it on ``validation``.

    Args:
        make: returns an unfitted metamodel.
        training: the samples to fit.
        validation: the samples to judge on; None leaves each training sample out in turn instead
            (:meth:`~mbpam_ros.actuator.metamodel.Metamodel.leave_one_out`).

    Raises:
        DesignDomainError: a validation sample lies outside the training samples.
        MetamodelError: the samples do not determine this metamodel.
        JudgingError: the judging responses do not vary.
    """
    judged = {}
    for key, response in training.responses.items():
        start = time.perf_counter()
        model = make().fit(training.design_mm, response)
        fit_s = time.perf_counter() - start
        if len(response) <= _FEW_SAMPLES:

            def refit(response: NDArray[np.float64] = response) -> Metamodel:
                return make().fit(training.design_mm, response)

            fit_s = _median_s(refit, 3)
        if validation is None:
            left_out = model.leave_one_out()
            predicted, sigma, how, expected = left_out.predicted, left_out.sigma, left_out.how, response
        else:
            predicted, sigma = model.predict(validation.design_mm), model.deviation(validation.design_mm)
            how, expected = "samples of their own", validation.responses[key]
        judged[key] = Judged(
            Accuracy.of(predicted, expected),
            _speed(model, fit_s),
            model.fitted_parameters(),
            predicted,
            None if sigma is None else Coverage.of(predicted - expected, sigma, how),
            how,
        )
    return judged


def _speed(model: Metamodel, fit_s: float) -> Speed:
    low, high = model.domain.bounds_mm
    many = np.clip(np.random.default_rng(0).uniform(low, high, size=(_MANY, 2)), low, high)
    return Speed(
        fit_s=fit_s,
        one_evaluation_s=_median_s(lambda: model.predict(many[:1]), 100),
        ten_thousand_evaluations_s=_median_s(lambda: model.predict(many), 3),
    )


def _median_s(action: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times)
