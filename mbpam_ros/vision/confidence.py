"""How sure a hypothesis is: the probability that its shape and its size are right.

A logistic function of what speaks for and against it:

    p = 1 / (1 + exp(-(w_0 + sum_i w_i f_i)))

The weights are fitted to images of the set "tune" (:mod:`mbpam_ros.study.judge.tuning`), one set for each source, and
stand in ``config/detector.yaml``; whether p is calibrated is judged on images of the other set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from mbpam_ros.vision.region_fit import Hypothesis
from mbpam_ros.vision.solid_fit.outline import BOX, CAPSULE, POST, ROD, SPHERE

_FORM_NAMES = {SPHERE: "ball", ROD: "rod", POST: "post", BOX: "box", CAPSULE: "capsule"}
_TYPICAL_SIGMA_M = 0.003

FEATURES = (
    "bias",
    "contour",
    "gap",
    "visible",
    "coverage",
    "sharp",
    "blunt",
    "misfit",
    "close",
    "crease_coverage",
    "overlap",
    "beyond",
    "shading",
    "size_sigma",
    "width_sigma",
    "flat",
    "slim",
    "shadowy",
    "ends_hidden",
    "height_hidden",
    "contour_lead",
    "misfit_lead",
    "shading_lead",
    "gap_lead",
    *_FORM_NAMES.values(),
)
"""Names of what is weighed."""


def features(hypothesis: Hypothesis) -> dict[str, float]:
    """Return the figures as they are weighed, each bounded so that none decides alone."""
    figures = hypothesis.figures
    named = {
        "bias": 1.0,
        "contour": min(figures["contour_px"], 6.0) / 3.0,
        "gap": min(figures["gap_sigmas"], 4.0),
        "visible": figures["visible"],
        "coverage": figures["coverage"],
        "sharp": max(figures["coverage"] - 0.8, 0.0) * 5.0,
        "blunt": max(0.6 - figures["coverage"], 0.0) * 3.0,
        "close": math.exp(-figures["misfit_px2"] - 0.2 * figures["contour_px"] ** 2),
        "misfit": min(figures["misfit_px2"], 9.0) / 3.0,
        "crease_coverage": figures["crease_coverage"],
        "overlap": figures["overlap"],
        "beyond": min(figures["beyond"], 0.5) * 4.0,
        "shading": figures["shading"],
        "size_sigma": _bounded(math.log(max(figures["size_sigma_m"], 1e-5) / _TYPICAL_SIGMA_M), 3.0),
        "width_sigma": _bounded(math.log(max(figures["width_sigma_m"], 1e-5) / _TYPICAL_SIGMA_M), 3.0),
        "flat": _bounded((0.02 - figures["height_m"]) / 0.01, 1.5),
        "slim": figures["slim"],
        "shadowy": figures["shadowy"],
        "ends_hidden": float(sum(length > 0.0 for length in hypothesis.hidden_m)),
        "height_hidden": float(hypothesis.height_range_m is not None),
        "contour_lead": _bounded(figures["contour_px_lead"], 3.0),
        "misfit_lead": _bounded(figures["misfit_px2_lead"], 6.0) / 2.0,
        "shading_lead": _bounded(figures["shading_lead"], 0.6) * 3.0,
        "gap_lead": _bounded(figures["gap_sigmas_lead"], 2.0),
    }
    named |= {name: float(hypothesis.form == form) for form, name in _FORM_NAMES.items()}
    return named


def probability(hypothesis: Hypothesis, weights: Mapping[str, float]) -> float:
    """Return the probability that a hypothesis is right, 0 to 1. What ``weights`` does not name weighs nothing."""
    named = features(hypothesis)
    total = sum(weights.get(name, 0.0) * value for name, value in named.items())
    return 1.0 / (1.0 + math.exp(-_bounded(total, 30.0)))


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
