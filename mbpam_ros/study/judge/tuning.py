"""Fit the weights of the detector's confidence to images of the tuning set.

All hypotheses that the detector weighs count, whichever it answers, each with whether it is right: shape and sizes
within 8 mm of those of an object at its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import minimize

from mbpam_ros.study.judge.judge import Judged
from mbpam_ros.study.judge.score import MATCHED_WITHIN_M, gap_m, is_right
from mbpam_ros.vision.confidence import FEATURES, features
from mbpam_ros.vision.detector import DetectorConfig, Source, described
from mbpam_ros.vision.region_fit import Hypothesis

_RIDGE = 3.0


def fit_weights(hypotheses: Sequence[Hypothesis], right: Sequence[bool]) -> dict[str, float]:
    """Return the weights of the logistic function that makes what was seen most likely.

    Maximum likelihood with a ridge, which keeps the weights of features that hardly vary small.

    Args:
        hypotheses: of all forms, whichever was answered.
        right: whether each is right.
    """
    rows = np.array([[features(item)[name] for name in FEATURES] for item in hypotheses])
    sign = np.where(np.asarray(right), 1.0, -1.0)
    penalty = np.full(len(FEATURES), _RIDGE)
    penalty[0] = 0.0

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margin = sign * (rows @ weights)
        slope = -sign / (1.0 + np.exp(np.clip(margin, -500.0, 500.0)))
        value = np.logaddexp(0.0, -margin).sum() + 0.5 * (penalty * weights**2).sum()
        return float(value), rows.T @ slope + penalty * weights

    weights = minimize(loss, np.zeros(len(FEATURES)), jac=True, method="L-BFGS-B", options={"maxiter": 2000}).x
    return {name: round(float(value), 3) for name, value in zip(FEATURES, weights, strict=True)}


def labelled(judged: Iterable[Judged]) -> tuple[list[Hypothesis], list[bool]]:
    """Return all hypotheses of judged images, and whether each is right."""
    hypotheses, right = [], []
    for item in judged:
        seen = item.seen
        for hypothesis in seen.hypotheses:
            found = described(hypothesis, seen.camera, seen.support_depth_m, seen.source)
            things = item.scene.things
            hypotheses.append(hypothesis)
            right.append(any(gap_m(thing, found) < MATCHED_WITHIN_M and is_right(thing, found) for thing in things))
    return hypotheses, right


def refitted(config: DetectorConfig, judged: Mapping[Source, Sequence[Judged]]) -> DetectorConfig:
    """Return the detector with weights fitted to judged images of each source.

    With and without the empty table the same figures speak for a hypothesis, so these share their weights: twice the
    images for each.
    """
    of_colour = fit_weights(*labelled([*judged["image"], *judged["background"]]))
    of_depth = fit_weights(*labelled(judged["depth"]))
    return replace(config, confidence={"image": of_colour, "background": dict(of_colour), "depth": of_depth})


def with_weights(text: str, config: DetectorConfig) -> str:
    """Return a detector file's text with the weights of ``config`` in place of its own; they stand last."""
    head = text[: text.index("\nconfidence:") + 1]
    return head + yaml.safe_dump({"confidence": config.confidence}, sort_keys=False)
