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
_LARGEST_SCORE = 30.0


def fit_weights(regions: Sequence[Sequence[Hypothesis]], right: Sequence[Sequence[bool]]) -> dict[str, float]:
    """Return the weights of :func:`~mbpam_ros.vision.confidence.probabilities` that make what was seen most likely.

    Maximum likelihood with a ridge, which keeps the weights of features that hardly vary small. Where several readings
    of a region are right, one of them being so is what counts.

    Args:
        regions: the readings of each region, whichever was answered.
        right: whether each is right.
    """
    kept = [(readings, flags) for readings, flags in zip(regions, right, strict=True) if readings]
    rows = np.array([[features(item)[name] for name in FEATURES] for readings, _ in kept for item in readings])
    is_right = np.array([flag for _, flags in kept for flag in flags], dtype=float)
    region = np.repeat(np.arange(len(kept)), [len(readings) for readings, _ in kept])
    some_right = np.bincount(region, weights=is_right) > 0.0
    penalty = np.full(len(FEATURES), _RIDGE)
    penalty[0] = 0.0

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        odds = np.exp(np.clip(rows @ weights, -_LARGEST_SCORE, _LARGEST_SCORE))
        total, of_right = 1.0 + np.bincount(region, weights=odds), np.bincount(region, weights=odds * is_right)
        chosen = np.where(some_right, of_right, 1.0)
        value = (np.log(total) - np.log(chosen)).sum()
        slope = odds / total[region] - some_right[region] * odds * is_right / chosen[region]
        return float(value + 0.5 * (penalty * weights**2).sum()), rows.T @ slope + penalty * weights

    weights = minimize(loss, np.zeros(len(FEATURES)), jac=True, method="L-BFGS-B", options={"maxiter": 2000}).x
    return {name: round(float(value), 3) for name, value in zip(FEATURES, weights, strict=True)}


def labelled(judged: Iterable[Judged]) -> tuple[list[tuple[Hypothesis, ...]], list[list[bool]]]:
    """Return the readings of all regions of judged images, and whether each is right."""
    regions, right = [], []
    for item in judged:
        for readings in item.seen.readings:
            regions.append(readings)
            right.append([_is_right(hypothesis, item) for hypothesis in readings])
    return regions, right


def _is_right(hypothesis: Hypothesis, item: Judged) -> bool:
    seen = item.seen
    found = described(hypothesis, seen.camera, seen.support_depth_m, seen.source)
    return any(gap_m(thing, found) < MATCHED_WITHIN_M and is_right(thing, found) for thing in item.scene.things)


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
