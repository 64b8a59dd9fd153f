"""Metamodels beside each other: error against time, each fitted to the same samples and judged on the same others."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.metamodel import Metamodel
from mbpam_ros.study.design.accuracy import Accuracy, leave_one_out
from mbpam_ros.study.design.samples import Samples

_MANY = 10_000


@dataclass(frozen=True)
class Speed:
    """Wall time [s], medians: of a fit, and of predicting one design and 10 000 designs."""

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
    """

    accuracy: Accuracy
    speed: Speed
    parameters: dict[str, object]
    predicted: NDArray[np.float64]

    def as_json(self) -> dict[str, object]:
        """Return figures of error, times and fitted parameters as plain values."""
        return {**asdict(self.accuracy), **asdict(self.speed), "parameters": self.parameters}


def judge(make: Callable[[], Metamodel], training: Samples, validation: Samples | None) -> dict[str, Judged]:
    """Fit one kind of metamodel to each response of ``training`` and judge it on ``validation``.

    Args:
        make: returns an unfitted metamodel.
        training: the samples to fit.
        validation: the samples to judge on; None leaves each training sample out in turn instead.

    Raises:
        DesignDomainError: a validation sample lies outside the training samples.
        MetamodelError: the samples do not determine this metamodel.
        JudgingError: the judging responses do not vary.
    """
    judged = {}
    for key, response in training.responses.items():
        model = make().fit(training.design_mm, response)
        if validation is None:
            predicted, expected = leave_one_out(make, training.design_mm, response), response
        else:
            predicted, expected = model.predict(validation.design_mm), validation.responses[key]
        speed = _speed(make, model, training.design_mm, response)
        judged[key] = Judged(Accuracy.of(predicted, expected), speed, model.fitted_parameters(), predicted)
    return judged


def _speed(
    make: Callable[[], Metamodel], model: Metamodel, design_mm: NDArray[np.float64], response: NDArray[np.float64]
) -> Speed:
    low, high = model.domain.bounds_mm
    many = np.clip(np.random.default_rng(0).uniform(low, high, size=(_MANY, 2)), low, high)
    return Speed(
        fit_s=_median_s(lambda: make().fit(design_mm, response), 3),
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
