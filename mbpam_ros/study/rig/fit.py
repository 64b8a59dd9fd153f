"""Factors on a muscle's law from the curves of the rig: weighted least squares, and what it cannot tell.

Unknown are, per pattern, the factors on M0 and on B at 100 kPa (:meth:`~mbpam_ros.actuator.rod_law.RodLaw.scaled`), one
on the free stretch, the half width w of the hysteresis, and the gain of each mount, which is 1 to :data:`GAIN_SIGMA`. A
free bend tells the ratio of M0 and B, and each but by the weight; the force on the plate tells M0. The model is the rod
of the pressure that is felt (:mod:`~mbpam_ros.actuator.hysteresis`): p - w on the way up and p + w on the way down, no
more than what was felt at the top;

    minimise  sum_i ((model_i(x) - mean_i) / sigma_i)^2 + sum_k (x_k / prior_k)^2,

with SciPy's ``least_squares`` over the logarithms of the factors. sigma_i is the spread of repeats, pooled over a
curve's pressures, over the root of their number, and what camera and scale err by. The covariance is that of the normal
equations, times chi^2 over the degrees of freedom where that is above 1. The priors are wide (30 %) and keep what the
data do not tell where it was: what is not known better than :data:`DETERMINED` afterwards is not determined.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbpam_ros.actuator.blocked_rod import BlockedTip
from mbpam_ros.actuator.calibration import pattern_loads
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.planar_rod import RodSolutionError, rod_tip_angle
from mbpam_ros.actuator.rod_law import PatternFactors, RodLaw
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.rig.curves import CurvePoint
from mbpam_ros.study.rig.procedure import BEND, DOWN, FORCE, UP

Array = NDArray[np.float64]

PATTERNS = ("psc", "pdc")
GAIN_SIGMA = 0.007
"""What all bends, or all forces, of one mount may be wrong by, as a share: the camera stands aslant, the scale is off,
the muscle sits otherwise in its clamp."""
BEND_SIGMA_DEG, FORCE_SIGMA_N = 0.2, 0.001
"""What a bend from a picture and a scale err by at each pressure."""
DETERMINED = 0.04
"""Relative standard deviation up to which a factor counts as determined."""
LEAST_KPA = 4.0
"""Below it next to nothing bends or pushes, and the rod's solutions are not followed."""

_PRIOR = 0.3
_STRETCH_PRIOR = 0.15
_HYSTERESIS_PRIOR_KPA = 3.0
_GAINS = tuple((pattern, quantity) for pattern in PATTERNS for quantity in (BEND, FORCE))
_NAMES = (
    *(f"{pattern}_{what}" for pattern in PATTERNS for what in ("moment", "stiffness")),
    "stretch",
    "hysteresis",
    *(f"{pattern}_{quantity}" for pattern, quantity in _GAINS),
)
_PRIORS = np.array([_PRIOR] * 4 + [_STRETCH_PRIOR, _HYSTERESIS_PRIOR_KPA] + [GAIN_SIGMA] * len(_GAINS))
_DIFFERENCE = 1e-4
_MOST_STEPS = 25
_LARGEST_MISFIT = 0.2
"""What may be left over of the curves, as a share: more is another muscle's."""
_HYSTERESIS, _FIRST_GAIN = _NAMES.index("hysteresis"), 6


class CalibrationError(MbpamError, ValueError):
    """The curves give no factors; the message says why."""


@dataclass(frozen=True, eq=False)
class FittedMuscle:
    """What the curves of one muscle say of it.

    Args:
        psc, pdc: factors over the drawing's law.
        stretch: factor on its free stretch.
        hysteresis_pa: half width.
        sigma: one standard deviation by name: of the factors relative, of the hysteresis in Pa.
        bend_sigma: relative standard deviation of free bends, root mean square over the measured pressures, by pattern.
        undetermined: what the data do not tell, in words.
        bend_rmse_deg, force_rmse_n: of the fitted curves from the measured ones; NaN where nothing was measured.
        chi2_per_freedom: above 1 where the model does not follow the data within what they err by.
    """

    psc: PatternFactors
    pdc: PatternFactors
    stretch: float
    hysteresis_pa: float
    sigma: dict[str, float]
    bend_sigma: dict[str, float]
    undetermined: tuple[str, ...]
    bend_rmse_deg: float
    force_rmse_n: float
    chi2_per_freedom: float


def predicted(law: RodLaw, geometry: MuscleGeometry, points: Sequence[CurvePoint], hysteresis_pa: float) -> Array:
    """Return what the rig would measure of a muscle at the points of its curves, shape (n,), [deg] and [N].

    Args:
        law: of the uniform rod.
        geometry: of that rod.
        points: where; their means are not looked at.
        hysteresis_pa: half width of the hysteresis.

    Raises:
        RodSolutionError: the rod has no equilibrium.
    """
    values = np.zeros(len(points))
    curves: dict[tuple[str, str], list[int]] = {}
    for index, point in enumerate(points):
        curves.setdefault((point.pattern, point.quantity), []).append(index)
    for (pattern, quantity), indices in curves.items():
        up = sorted((i for i in indices if points[i].branch == UP), key=lambda i: points[i].pressure_kpa)
        down = sorted((i for i in indices if points[i].branch == DOWN), key=lambda i: -points[i].pressure_kpa)
        order = up + down
        pressure = np.array([1e3 * points[i].pressure_kpa for i in order])
        top = pressure.max() - hysteresis_pa
        felt = pressure + np.where(np.arange(len(order)) < len(up), -hysteresis_pa, hysteresis_pa)
        felt = np.minimum(felt, top)
        solvable = felt >= 1e3 * LEAST_KPA
        loads = pattern_loads(law, pattern, felt[solvable])
        if quantity == FORCE:
            tip = BlockedTip(geometry)
            found = [tip.follow(load).push_n for load in loads]
        else:
            found = [
                math.degrees(rod_tip_angle(load.moment_n_m, load.stiffness_n_m2, geometry, stretch=load.stretch))
                for load in loads
            ]
        values[np.array(order)[solvable]] = found
    return values


def fit_muscle(drawn: RodLaw, geometry: MuscleGeometry, points: Sequence[CurvePoint]) -> FittedMuscle:
    """Return the factors that bring the law of a drawing to the curves of a muscle.

    Args:
        drawn: law of the drawing, of the uniform rod.
        geometry: of that rod.
        points: curves of one muscle.

    Raises:
        CalibrationError: too few points, or a law that cannot follow them.
    """
    used = [point for point in points if point.pressure_kpa >= LEAST_KPA + 1.0]
    patterns = [pattern for pattern in PATTERNS if any(point.pattern == pattern for point in used)]
    if len(used) < 4 or not patterns:
        raise CalibrationError(f"{len(used)} points above {LEAST_KPA + 1.0:g} kPa, at least 4 are needed")
    mean = np.array([point.mean for point in used])
    is_bend = np.array([point.quantity == BEND for point in used])
    for quantity, name in ((is_bend, "bend"), (~is_bend, "force")):
        if quantity.any() and mean[quantity].max() <= 0.0:
            raise CalibrationError(f"no {name} is above 0: is the muscle turned round, or another one under pressure?")
    sigma = _sigmas(used)
    gain_of = np.array([_GAINS.index((point.pattern, point.quantity)) for point in used])
    known = {f"{pattern}_{what}" for pattern in patterns for what in ("moment", "stiffness")}
    known |= {f"{pattern}_{quantity}" for pattern, quantity in {_GAINS[k] for k in gain_of}} | {"stretch", "hysteresis"}
    kept = np.flatnonzero([name in known for name in _NAMES])

    def unknowns(x: Array) -> Array:
        full = np.zeros(len(_NAMES))
        full[kept] = x
        if patterns == ["psc"]:
            full[2:4] = full[:2]
        elif patterns == ["pdc"]:
            full[:2] = full[2:4]
        return full

    def model(x: Array) -> Array:
        full = unknowns(x)
        law = _law(drawn, full)
        gains = np.exp(full[_FIRST_GAIN:][gain_of])
        return gains * predicted(law, geometry, used, 1e3 * full[_HYSTERESIS])

    def residual(x: Array) -> Array:
        try:
            found = model(x)
        except (RodSolutionError, ValueError):
            return np.full(len(used) + x.size, 1e3)  # far from what a muscle does: steps that lead here are taken back
        return np.concatenate([(found - mean) / sigma, x / _PRIORS[kept]])

    def jacobian(x: Array) -> Array:
        """Forward differences; what belongs to one pattern is worked out for that one, and a gain's are known."""
        full = unknowns(x)
        columns = np.zeros((len(used) + x.size, x.size))
        columns[len(used) :] = np.diag(1.0 / _PRIORS[kept])
        gains = np.exp(full[_FIRST_GAIN:][gain_of])
        here = gains * predicted(_law(drawn, full), geometry, used, 1e3 * full[_HYSTERESIS])
        for column, k in enumerate(kept):
            if k >= _FIRST_GAIN:
                columns[: len(used), column] = np.where(gain_of == k - _FIRST_GAIN, here, 0.0) / sigma
                continue
            pattern = "" if len(patterns) == 1 or _NAMES[k] == "pdc_stiffness" else _NAMES[k].split("_")[0]
            rows = [i for i, point in enumerate(used) if pattern not in PATTERNS or point.pattern == pattern]
            moved = x.copy()
            moved[column] += _DIFFERENCE
            there = unknowns(moved)
            law, of = _law(drawn, there), [used[i] for i in rows]
            new = gains[rows] * predicted(law, geometry, of, 1e3 * there[_HYSTERESIS])
            columns[rows, column] = (new - here[rows]) / _DIFFERENCE / sigma[rows]
        return columns

    start = np.where(kept == _HYSTERESIS, 0.3, 0.0)
    lower = np.where(kept == _HYSTERESIS, 0.0, -1.5)
    upper = np.where(kept == _HYSTERESIS, 10.0, 1.5)
    bounds = (lower, upper)
    try:
        found = least_squares(
            residual, start, jacobian, bounds, ftol=1e-5, xtol=1e-5, x_scale=_PRIORS[kept], max_nfev=_MOST_STEPS
        )
    except RodSolutionError as error:
        raise CalibrationError(f"the drawn muscle cannot be brought to these curves: {error}") from error
    data = found.fun[: len(used)]
    if float(np.sqrt(np.mean((data * sigma) ** 2) / np.mean(mean**2))) > _LARGEST_MISFIT:
        raise CalibrationError("no factors within 0.2 to 4.5 bring the drawn muscle to these curves: another one?")
    freedom = max(len(used) - kept.size, 1)
    chi2 = float(data @ data) / freedom
    normal = found.jac.T @ found.jac
    covariance = np.linalg.inv(normal) * max(chi2, 1.0)
    spread = dict(zip([_NAMES[k] for k in kept], np.sqrt(np.diag(covariance)), strict=True))
    full = unknowns(found.x)
    left = data * sigma
    # Gains are of the instruments, not of the muscle: they are no part of what is known of its bends.
    slopes = found.jac[: len(used)] * sigma[:, None] / np.maximum(np.abs(mean + left), 1e-9)[:, None]
    slopes[:, kept >= _FIRST_GAIN] = 0.0
    slopes[:, kept == _HYSTERESIS] = 0.0
    variance = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
    of = {
        pattern: np.array([each.pattern == pattern for each in used]) & is_bend & (mean > 10.0) for pattern in patterns
    }
    law_factors = np.exp(full[:5])
    return FittedMuscle(
        PatternFactors(*map(float, law_factors[:2])),
        PatternFactors(*map(float, law_factors[2:4])),
        float(law_factors[4]),
        1e3 * float(full[_HYSTERESIS]),
        {name: float(value) * (1e3 if name == "hysteresis" else 1.0) for name, value in spread.items()},
        {pattern: math.sqrt(float(variance[rows].mean())) for pattern, rows in of.items() if rows.any()},
        _undetermined(used, patterns, is_bend, spread),
        _rms(left[is_bend]),
        _rms(left[~is_bend]),
        chi2,
    )


def _law(drawn: RodLaw, full: Array) -> RodLaw:
    factors = np.exp(full[:5])
    psc, pdc = PatternFactors(factors[0], factors[1]), PatternFactors(factors[2], factors[3])
    return drawn.scaled(psc, pdc).stretched(float(factors[4]))


def _sigmas(points: Sequence[CurvePoint]) -> Array:
    """Standard deviations of the points' means, shape (n,): spreads pooled, because two repeats tell little of one."""
    found = np.empty(len(points))
    for pattern in PATTERNS:
        for quantity, floor in ((BEND, BEND_SIGMA_DEG), (FORCE, FORCE_SIGMA_N)):
            rows = [i for i, point in enumerate(points) if (point.pattern, point.quantity) == (pattern, quantity)]
            if not rows:
                continue
            share = [points[i].spread / max(abs(points[i].mean), 1e-9) for i in rows if points[i].repeats > 1]
            pooled = math.sqrt(float(np.mean(np.square(share)))) if share else 0.0
            for i in rows:
                found[i] = math.hypot(floor, pooled * abs(points[i].mean) / math.sqrt(points[i].repeats))
    return found


def _undetermined(
    points: Sequence[CurvePoint], patterns: list[str], is_bend: NDArray[np.bool_], spread: dict[str, float]
) -> tuple[str, ...]:
    said = []
    for pattern in PATTERNS:
        if pattern not in patterns:
            said.append(f"{pattern}: not measured; it takes the other pattern's factors")
            continue
        rows = np.array([point.pattern == pattern for point in points])
        unknown = [what for what in ("moment", "stiffness") if spread[f"{pattern}_{what}"] > DETERMINED]
        if unknown:
            why = "" if (rows & ~is_bend).any() else ": without forces only the weight tells them apart"
            said.append(f"{pattern}: {' and '.join(unknown)} not determined{why}")
        pressures = [point.pressure_kpa for point, of in zip(points, rows, strict=True) if of]
        if min(pressures) > 15.0 or max(pressures) < 95.0:
            said.append(
                f"{pattern}: measured from {min(pressures):.0f} to {max(pressures):.0f} kPa; beyond that the shape of "
                "the drawing's law stands"
            )
    if spread["stretch"] > DETERMINED:
        said.append("stretch: not determined better than the drawing's")
    return tuple(said)


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2))) if values.size else math.nan
