"""Tip angle of the muscle in the posture of the paper's tests, with the bending law of finite elements.

Clamped at the base, tip up, weight on; the rod of :mod:`~mbpam_ros.actuator.planar_rod`, but with a bending law that is
not a straight line and an axis that stretches by s(M). With r the unstretched length toward the tip's straight piece
(length l, weight W), w the active part's weight per unstretched length, the weight's moment m and the angle obey

    d theta / dr = -kappa(m),   d m / dr = (W + w r) s(m) sin(theta),

from theta = theta_tip, m = W l/2 sin(theta_tip) at r = 0 to theta = 0 at r = L.
Fourth-order Runge-Kutta; the root theta_tip is followed from the weightless rod by raising gravity.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import newton

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.fe.law import BendingLaw
from mbpam_ros.study.fe.mesh import CellGeometry

SILICONE_DENSITY_KG_M3 = 1070.0
"""Assumed, as in ``config/gripper.yaml``."""

END_LENGTH_MM = 15.0
"""Unwaved length at each end: our reading, as in ``config/gripper.yaml``."""

END_WEIGHT_FACTOR = 0.0
"""Weight per length of the ends over the waved part's mean. The paper does not say how the ends are made. Without
weight the bends of Tables 1 and 2 come back best (on the fast mesh 3.8 % rms; 5.8 % with 1; 8.4 % with 2.1, which is
solid silicone): a choice made on these tables, like that of c and n."""

_STEPS = 40
_GRAVITY_LEVELS = (0.25, 0.5, 0.75, 1.0)
_SAMPLE_STEP_RAD = math.radians(20.0)


class PostureError(MbpamError, RuntimeError):
    """No equilibrium of the upright muscle was found."""


def weight_n_mm(geometry: CellGeometry, density_kg_m3: float = SILICONE_DENSITY_KG_M3) -> float:
    """Return the mean weight per unstretched length [N/mm] of the waved part.

    Mean over a wave of pi r_o^2 minus four chambers; the mean of r_o^2 is (R - a/2)^2 + a^2/8.
    """
    wave = geometry.wave_length_mm * (np.arange(64) + 0.5) / 64
    mean_square = (geometry.outer_radius_mm - 0.5 * geometry.a_mm) ** 2 + geometry.a_mm**2 / 8.0
    area_mm2 = math.pi * mean_square - 4.0 * float(geometry.chamber_area_at(wave).mean())
    return density_kg_m3 * 1e-9 * area_mm2 * GRAVITY_M_S2


def upright_tip_angle_rad(
    law: BendingLaw,
    geometry: CellGeometry,
    end_length_mm: float = END_LENGTH_MM,
    end_weight_factor: float = END_WEIGHT_FACTOR,
    gravity_factor: float = 1.0,
    stretching: bool = True,
    density_kg_m3: float = SILICONE_DENSITY_KG_M3,
) -> float:
    """Return the tip angle [rad]; the law is sampled as far as the weight's moments go.

    Args:
        end_length_mm: straight piece at each end.
        end_weight_factor: its weight per length over the waved part's mean.
        gravity_factor: 0 switches the weight off.
        stretching: let the axis stretch as the law says; else it keeps its length.
        density_kg_m3: of the silicone.

    Raises:
        PostureError: no equilibrium on the branch of the weightless rod.
        LawError, LoadStepError: the law cannot be sampled that far.
    """
    weight = weight_n_mm(geometry, density_kg_m3) * gravity_factor
    ends = end_length_mm, end_weight_factor
    law.cover(-0.5, 0.5, 0.5 * _SAMPLE_STEP_RAD)
    while True:
        march = _March(law, geometry.active_length_mm, ends, stretching)
        tip = march.tip_angle_rad(weight)
        needed = march.moments_n_mm(tip, weight)
        if law.moment_n_mm[0] <= min(needed) and max(needed) <= law.moment_n_mm[-1]:
            return tip
        law.cover(min(needed), max(needed), _SAMPLE_STEP_RAD)


def upright_bends_rad(
    law: BendingLaw,
    geometry: CellGeometry,
    end_length_mm: float,
    end_weight_factor: float,
    stations: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the local bend of the upright muscle: curvature times active length [rad].

    Args:
        stations: distances from the clamped end of the active length over that length, 0 to 1; shape (k,).

    Returns:
        Shape (k,); the mean over the active length is the tip angle.

    Raises:
        As :func:`upright_tip_angle_rad`.
    """
    tip = upright_tip_angle_rad(law, geometry, end_length_mm, end_weight_factor)
    march = _March(law, geometry.active_length_mm, (end_length_mm, end_weight_factor), stretching=True)
    moments = march.moments_n_mm(tip, weight_n_mm(geometry))  # from the tip on
    from_tip = np.linspace(0.0, 1.0, len(moments))
    return law.bend_and_stretch_of_moment()(np.interp(1.0 - stations, from_tip, moments))[:, 0]


class _March:
    """Shooting from the tip. Beyond the samples the law goes on straight, for trial values only."""

    def __init__(self, law: BendingLaw, active_length_mm: float, ends: tuple[float, float], stretching: bool) -> None:
        self._curve = law.bend_and_stretch_of_moment()
        self._slope = self._curve.derivative()
        self._range = float(law.moment_n_mm[0]), float(law.moment_n_mm[-1])
        self._active, (self._end, self._end_weight), self._stretching = active_length_mm, ends, stretching

    def tip_angle_rad(self, weight: float) -> float:
        tip = self._bend_and_stretch(0.0)[0]
        for level in _GRAVITY_LEVELS if weight else ():
            try:
                tip = float(newton(lambda angle, w: self._shoot(angle, w)[0], tip, args=(level * weight,), tol=1e-9))
            except RuntimeError as error:
                raise PostureError(
                    f"no equilibrium of the upright muscle at {level:.0%} of gravity: {error}"
                ) from error
        return tip

    def moments_n_mm(self, tip_angle_rad: float, weight: float) -> list[float]:
        return self._shoot(tip_angle_rad, weight)[1]

    def _shoot(self, tip_angle_rad: float, weight: float) -> tuple[float, list[float]]:
        """Angle at the clamp, and the moments on the way."""
        step = self._active / _STEPS
        tip_weight = weight * self._end_weight * self._end
        angle, moment = tip_angle_rad, 0.5 * tip_weight * self._end * math.sin(tip_angle_rad)
        moments = [moment]

        def slopes(r: float, angle: float, moment: float) -> tuple[float, float]:
            bend, stretch = self._bend_and_stretch(moment)
            return -bend / self._active, (tip_weight + weight * r) * stretch * math.sin(angle)

        for index in range(_STEPS):
            r = index * step
            a1, m1 = slopes(r, angle, moment)
            a2, m2 = slopes(r + 0.5 * step, angle + 0.5 * step * a1, moment + 0.5 * step * m1)
            a3, m3 = slopes(r + 0.5 * step, angle + 0.5 * step * a2, moment + 0.5 * step * m2)
            a4, m4 = slopes(r + step, angle + step * a3, moment + step * m3)
            angle += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            moment += step / 6.0 * (m1 + 2.0 * m2 + 2.0 * m3 + m4)
            moments.append(moment)
        return angle, moments

    def _bend_and_stretch(self, moment: float) -> tuple[float, float]:
        inside = min(max(moment, self._range[0]), self._range[1])
        bend, stretch = self._curve(inside)
        if moment != inside:
            bend += self._slope(inside)[0] * (moment - inside)
        return float(bend), float(stretch) if self._stretching else 1.0
