"""From rig files to a measured muscle: each muscle's factors, their mean, and what they scatter by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Literal

import numpy as np

from mbpam_ros.actuator.measured_muscle import MeasuredMuscle
from mbpam_ros.actuator.rod_law import PatternFactors
from mbpam_ros.study.rig.fit import FittedMuscle

_FACTORS = ("psc_moment", "psc_stiffness", "pdc_moment", "pdc_stiffness", "stretch")


def measured_muscle(
    fitted: Sequence[FittedMuscle], base: Literal["fe", "test"], provenance: dict[str, str]
) -> MeasuredMuscle:
    """Return the mean of the muscles that were measured.

    The factors are geometric means. With two muscles or more their scatter is known, and counts in the deviation of a
    bend: the next muscle is another one. The bend of a muscle goes with M0 / B, and so does its scatter.

    Args:
        fitted: one or more muscles.
        base: target whose law the factors multiply.
        provenance: where it comes from, by name.
    """
    logs = np.log([[factor(each, name) for name in _FACTORS] for each in fitted])
    mean = dict(zip(_FACTORS, map(float, np.exp(logs.mean(axis=0))), strict=True))
    scatter: dict[str, float] = {}
    between = 0.0
    if len(fitted) > 1:
        scatter = dict(zip(_FACTORS, map(float, logs.std(axis=0, ddof=1)), strict=True))
        ratios = logs[:, [0, 2]] - logs[:, [1, 3]]
        between = float(np.sqrt(np.mean(ratios.var(axis=0, ddof=1))))
    own = _rms([value for each in fitted for value in each.bend_sigma.values()])
    sigma = {
        name: math.hypot(_rms([each.sigma.get(name, math.nan) for each in fitted]), scatter.get(name, 0.0))
        / math.sqrt(len(fitted))
        for name in (*_FACTORS, "hysteresis")
        if all(name in each.sigma for each in fitted)
    }
    said = sorted({text for each in fitted for text in each.undetermined})
    if len(fitted) == 1:
        said.append("scatter between muscles: one was measured; bends of others differ by more than is said here")
    return MeasuredMuscle(
        base,
        PatternFactors(mean["psc_moment"], mean["psc_stiffness"]),
        PatternFactors(mean["pdc_moment"], mean["pdc_stiffness"]),
        mean["stretch"],
        float(np.mean([each.hysteresis_pa for each in fitted])),
        min(math.hypot(own, between), 1.0),
        sigma,
        scatter,
        tuple(said),
        provenance,
    )


def as_json(measured: MeasuredMuscle) -> dict[str, object]:
    """Return a measured muscle as plain values."""
    return {**asdict(measured), "not_determined": list(measured.not_determined)}


def factor(fitted: FittedMuscle, name: str) -> float:
    """Return one of the factors of a muscle, by its name in ``sigma``."""
    if name == "stretch":
        return fitted.stretch
    pattern, what = name.split("_")
    return float(getattr(getattr(fitted, pattern), what))


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if len(values) else 0.0
