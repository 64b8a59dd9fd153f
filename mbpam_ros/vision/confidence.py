"""How sure a hypothesis is: the probability that its shape and its size are right.

The readings of one region exclude each other, and all may be wrong: a conditional logit with one alternative more,
that none is right (McFadden, in Zarembka (ed.), Frontiers in Econometrics, 1974),

    p_k = exp(s_k) / (1 + sum_j exp(s_j)),   s_k = w_0 + sum_i w_i f_ki.

The weights are fitted to images of the set "tune" (:mod:`mbpam_ros.study.judge.tuning`), for depth apart, and stand
in ``config/detector.yaml``; whether p is calibrated is judged on images of the other set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from mbpam_ros.vision.region_fit import Hypothesis
from mbpam_ros.vision.solid_fit.outline import BOX, CAPSULE, POST, ROD, SPHERE

_FORM_NAMES = {SPHERE: "ball", ROD: "rod", POST: "post", BOX: "box", CAPSULE: "capsule"}
_TYPICAL_SIGMA_M = 0.003

_BY_FORM = {"good": ("ball", "post", "box"), "fills": ("ball", "post", "box")}
"""What means more for some forms than for others."""

FEATURES = (
    "bias",
    "misfit",
    "good",
    "sharp",
    "blunt",
    "fills",
    "good_and_fills",
    "contour",
    "contour_close",
    "gap",
    "visible",
    "beyond",
    "shading",
    "good_but_shading",
    "size_sigma",
    "size_unsure",
    "width_sigma",
    "flat",
    "sheet",
    "slim",
    "shadowy",
    "ends_hidden",
    "height_hidden",
    "misfit_lead",
    "good_lead",
    "contour_lead",
    "shading_lead",
    "good_shading_lead",
    "gap_lead",
    "box_without_creases",
    "poor_box_without_creases",
    "post_without_rim",
    *_FORM_NAMES.values(),
    *(f"{name}_{form}" for name, forms in _BY_FORM.items() for form in forms),
)
"""Names of what is weighed."""


def features(hypothesis: Hypothesis) -> dict[str, float]:
    """Return the figures as they are weighed, each bounded so that none decides alone.

    ``good`` is near 1 where nearly all of the outline lies at an edge; what else speaks for a hypothesis is weighed
    once more by it, since being better than the others says little where all are bad.
    """
    figures = hypothesis.figures
    misfit, contour, coverage = min(figures["misfit_px2"], 9.0), min(figures["contour_px"], 6.0), figures["coverage"]
    good, fills = math.exp(-misfit) * coverage, max(figures["overlap"] - 0.7, 0.0) / 0.3
    size_sigma, width_sigma = _sigma_log(figures["size_sigma_m"]), _sigma_log(figures["width_sigma_m"])
    misfit_lead = _bounded(figures["misfit_px2_lead"], 4.0) / 2.0
    shading_lead = _bounded(figures["shading_lead"], 0.6) * 3.0
    no_creases, height_m = 1.0 - figures["crease_coverage"], figures["height_m"]
    is_form = {name: float(hypothesis.form == form) for form, name in _FORM_NAMES.items()}
    named = {
        "bias": 1.0,
        "misfit": misfit / 3.0,
        "good": good,
        "sharp": max(coverage - 0.8, 0.0) * 5.0,
        "blunt": max(0.6 - coverage, 0.0) * 3.0,
        "fills": fills,
        "good_and_fills": good * fills,
        "contour": contour / 3.0,
        "contour_close": math.exp(-0.3 * contour**2),
        "gap": min(figures["gap_sigmas"], 4.0),
        "visible": figures["visible"],
        "beyond": min(figures["beyond"], 0.5) * 4.0,
        "shading": figures["shading"],
        "good_but_shading": good * figures["shading"],
        "size_sigma": size_sigma,
        "size_unsure": max(size_sigma, 0.0),
        "width_sigma": width_sigma,
        "flat": _bounded((0.02 - height_m) / 0.01, 1.5),
        "sheet": min(max((0.012 - height_m) / 0.006, 0.0), 2.0),
        "slim": figures["slim"],
        "shadowy": figures["shadowy"],
        "ends_hidden": float(sum(length > 0.0 for length in hypothesis.hidden_m)),
        "height_hidden": float(hypothesis.height_range_m is not None),
        "misfit_lead": misfit_lead,
        "good_lead": misfit_lead * good,
        "contour_lead": _bounded(figures["contour_px_lead"], 3.0),
        "shading_lead": shading_lead,
        "good_shading_lead": shading_lead * good,
        "gap_lead": _bounded(figures["gap_sigmas_lead"], 2.0),
        "box_without_creases": is_form["box"] * no_creases,
        "poor_box_without_creases": is_form["box"] * no_creases * (1.0 - good),
        "post_without_rim": is_form["post"] * no_creases,
    }
    named |= is_form
    of_all = {"good": good, "fills": fills}
    named |= {f"{name}_{form}": of_all[name] * is_form[form] for name, forms in _BY_FORM.items() for form in forms}
    return named


def probabilities(readings: Sequence[Hypothesis], weights: Mapping[str, float]) -> list[float]:
    """Return the probability that each of a region's readings is right, 0 to 1; what is left is that none is.

    What ``weights`` does not name weighs nothing.
    """
    scores = [
        math.exp(_bounded(sum(weights.get(name, 0.0) * value for name, value in features(item).items()), 30.0))
        for item in readings
    ]
    total = 1.0 + sum(scores)
    return [score / total for score in scores]


def _sigma_log(sigma_m: float) -> float:
    return _bounded(math.log(max(sigma_m, 1e-5) / _TYPICAL_SIGMA_M), 3.0)


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
