"""Bend, tip and force of the four fingers from their measured chamber pressures, each with its uncertainty.

The bend is that of a muscle of constant curvature at rest in its posture (:mod:`~mbpam_ros.actuator.equilibrium`),
cheap enough to be asked nine times for its slopes over the pressures. The tip is that of the full rod
(:mod:`~mbpam_ros.actuator.elastic_rod`), which sags, stretches and, where gravity pulls across its plane, twists: a
rod at rest whose chambers push with what would hold the bend, so that at rest it is the rod of the measured pressures,
and in motion as far on its way as the bend is. The stretch follows the pressures at once: its slowest wave takes a
tenth of the lag of the bend.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.calibration import Calibration
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.elastic_rod import HANGING, FreeRods, RodsAtRest
from mbpam_ros.actuator.equilibrium import holding_moment_n_m, resting_bend
from mbpam_ros.actuator.hysteresis import felt_pressure
from mbpam_ros.actuator.metamodel import load_metamodel
from mbpam_ros.actuator.strains import check_strains
from mbpam_ros.configuration import require_positive
from mbpam_ros.gripper import Gripper

_SLOPE_STEP_PA = 250.0
"""Half width of the central difference of the bend against a pressure."""

_HYSTERESIS_SHARE = 0.4
"""Of the half width of a muscle's hysteresis: what it is not known by. Some of it is creep, that is, time."""

# Pressure offsets of a finger for its slopes: + and - on each chamber; shape (8, 4).
_PROBES_PA = _SLOPE_STEP_PA * np.vstack([np.eye(CHAMBERS_PER_FINGER), -np.eye(CHAMBERS_PER_FINGER)])


@dataclass(frozen=True)
class EstimatorConfig:
    """What a user may change in ``config/estimator.yaml``.

    Args:
        bend_time_constant_s: lag of the bend behind the equilibrium of the measured pressures.
        centreline_points: points per finger of the drawn centre line, at least 2.
        strains: what the muscle does besides bending, for tips and centre lines.
    """

    bend_time_constant_s: float
    centreline_points: int
    strains: tuple[Literal["bend", "stretch", "twist"], ...]

    def __post_init__(self) -> None:
        require_positive(self, "bend_time_constant_s")
        check_strains(self.strains)
        if self.centreline_points < 2:
            raise ValueError(f"centreline_points must be at least 2, found {self.centreline_points}")


@dataclass(frozen=True)
class GripperEstimate:
    """State of the four fingers. NaN in every field of a finger = it has no valid reading now.

    Args:
        pressure_gauge_pa: the pressures it comes from, as the muscles feel them
            (:mod:`~mbpam_ros.actuator.hysteresis`), shape (4 fingers, 4 chambers).
        moment_n_m: intrinsic moment of the chambers in bend components, shape (4, 2).
        bend_rad, bend_rate_rad_s: bend components and their rates, shape (4, 2).
        gravity_m_s2: acceleration in ``gripper_base``, of all fingers, shape (3,).
    """

    pressure_gauge_pa: NDArray[np.float64]
    moment_n_m: NDArray[np.float64]
    bend_rad: NDArray[np.float64]
    bend_rate_rad_s: NDArray[np.float64]
    gravity_m_s2: NDArray[np.float64]


class BendEstimator:
    """First-order lag of each finger's bend behind the equilibrium of its measured pressures in its posture.

    Between two readings the equilibrium is taken to move in a straight line, for which the lag is integrated exactly
    (stable for every step; the same bend however a straight move is divided into steps). The first reading, and the
    first after time ran backwards, finds the fingers at rest in their equilibrium.

    Args:
        calibration: the muscles' rod law and blocked force.
        geometry: of the muscles.
        finger_base_m: clamp points in ``gripper_base``, shape (4, 3).
        bend_sigma: the model's share of the uncertainty: relative standard deviation of a bend.
        config: what a user may change.

    Raises:
        ValueError: ``finger_base_m`` has another shape.
    """

    def __init__(
        self,
        calibration: Calibration,
        geometry: MuscleGeometry,
        finger_base_m: ArrayLike,
        bend_sigma: float,
        config: EstimatorConfig,
    ) -> None:
        self._law, self._tip_force = calibration.law, calibration.tip_force
        self._geometry, self._config = geometry, config
        self._base = np.array(finger_base_m, dtype=float)
        if self._base.shape != (FINGER_COUNT, 3):
            raise ValueError(f"finger_base_m must have shape ({FINGER_COUNT}, 3), found {self._base.shape}")
        self._relative_model_error, self._least_model_error_rad = bend_sigma, calibration.least_bend_sigma_rad
        self._hysteresis_pa = calibration.hysteresis_pa
        self._rods = FreeRods(self._law, geometry, config.strains)
        self._solved: tuple[GripperEstimate, RodsAtRest] | None = None
        self._arc_length = np.linspace(0.0, geometry.length_m, config.centreline_points)
        self.reset()

    @classmethod
    def for_gripper(cls, gripper: Gripper, config: EstimatorConfig) -> BendEstimator:
        """Build the estimator of a gripper with the metamodel and target it names."""
        calibration = gripper.calibration()
        bend_sigma = calibration.bend_sigma
        if bend_sigma is None:
            performance = load_metamodel(gripper.metamodel).predict(gripper.design)
            bend_sigma = performance.theta_max_sigma_rad / performance.theta_max_rad
        return cls(calibration, gripper.rod_geometry, gripper.finger_base_m, bend_sigma, config)

    def reset(self) -> None:
        """Forget the past: the next valid reading of a finger finds it at rest in its equilibrium."""
        self._latest_time_s = -math.inf
        self._felt_pa = np.full((FINGER_COUNT, CHAMBERS_PER_FINGER), np.nan)
        bends = (FINGER_COUNT, 2)
        self._followed = _Followed(np.full(FINGER_COUNT, np.nan), np.full(bends, np.nan), np.full(bends, np.nan))

    def update(self, time_s: float, pressure_gauge_pa: ArrayLike, gravity_m_s2: ArrayLike = HANGING) -> GripperEstimate:
        """Take one reading of all chambers and return the state of the fingers.

        A finger with a non-finite pressure gets NaN in every field and is not advanced; its next valid reading goes
        on from its last valid state over the time in between. Time running backwards resets the estimator.

        Args:
            time_s: stamp of the reading.
            pressure_gauge_pa: shape (16,), NaN = no valid reading.
            gravity_m_s2: acceleration in ``gripper_base``, whose axes the muscle frames have, shape (3,).

        Raises:
            ValueError: a wrong shape, a time or gravity that is not finite. The state is unchanged.
        """
        if not math.isfinite(time_s):
            raise ValueError(f"time must be finite, found {time_s}")
        pressure = _by_finger("pressure_gauge_pa", pressure_gauge_pa)
        gravity = np.array(gravity_m_s2, dtype=float)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise ValueError(f"gravity_m_s2 must be three finite numbers, found {gravity}")
        if time_s < self._latest_time_s:
            self.reset()
        self._latest_time_s = time_s
        is_known = np.isfinite(pressure).all(axis=1)
        pressure[~is_known] = np.nan
        pressure = felt_pressure(self._felt_pa, pressure, self._hysteresis_pa)
        self._felt_pa[is_known] = pressure[is_known]
        moment, stiffness = self._law.moment_and_stiffness(pressure)
        equilibrium = resting_bend(moment, stiffness, self._geometry, gravity)
        bend, rate = _follow(self._followed, time_s, equilibrium, self._config.bend_time_constant_s)
        return GripperEstimate(pressure, moment, bend, rate, gravity)

    def bend_sigma_rad(self, estimate: GripperEstimate, variance_pa2: ArrayLike) -> NDArray[np.float64]:
        """Return one standard deviation of the bend [rad], shape (4,): pressure noise and the model's error.

        Root sum of squares of the noise, and of a share of the hysteresis, through the equilibrium's slopes and of the
        model's error. The noise moves
        the bend vector both ways; its share is the root of the sum over both components and over the chambers, taken as
        independent. The lag's smoothing of the noise is not counted.

        Args:
            estimate: what :meth:`update` returned.
            variance_pa2: variance of each pressure, >= 0, shape (16,). NaN makes that finger's sigma NaN.

        Raises:
            ValueError: a wrong shape or a negative variance.
        """
        variance = _by_finger("variance_pa2", variance_pa2)
        if (variance < 0.0).any():
            raise ValueError(f"variance_pa2 must not be negative, found {variance.min():g}")
        moment, stiffness = self._law.moment_and_stiffness(estimate.pressure_gauge_pa + _PROBES_PA[:, None, :])
        probes = resting_bend(moment, stiffness, self._geometry, estimate.gravity_m_s2)
        slope = (probes[:CHAMBERS_PER_FINGER] - probes[CHAMBERS_PER_FINGER:]) / (2.0 * _SLOPE_STEP_PA)
        variance += (_HYSTERESIS_SHARE * self._hysteresis_pa) ** 2 * (estimate.pressure_gauge_pa > 0.0)
        noise = np.einsum("cfk,cfk,fc->f", slope, slope, variance)
        bend = estimate.bend_rad
        model = self._relative_model_error * np.hypot(bend[:, 0], bend[:, 1])
        sigma: NDArray[np.float64] = np.sqrt(noise + model**2 + self._least_model_error_rad**2)
        return sigma

    def tips(self, estimate: GripperEstimate) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the tips' positions (4, 3) [m] and orientations (4, 4), x y z w, in ``gripper_base``.

        NaN where the finger's state is not known.
        """
        rods = self._resting_rods(estimate)
        return self._base + rods.tip_position_m, rods.tip_orientation_xyzw

    def tip_force_n(self, moment_n_m: ArrayLike) -> NDArray[np.float64]:
        """Return the force against plates that block the tips, shape (4,), for intrinsic moments (4, 2)."""
        return self._tip_force.at(moment_n_m)

    def centrelines(self, estimate: GripperEstimate) -> NDArray[np.float64]:
        """Return the centre lines of the fingers in ``gripper_base``.

        Shape (4, ``centreline_points``, 3) [m], from clamp to tip, evenly spaced before the muscle stretches; NaN where
        the finger's state is not known.
        """
        rods = self._resting_rods(estimate)
        lines = np.empty((FINGER_COUNT, self._arc_length.size, 3))
        for finger, axis in np.ndindex(FINGER_COUNT, 3):
            lines[finger, :, axis] = np.interp(self._arc_length, rods.arc_length_m, rods.centreline_m[finger, :, axis])
        lines += self._base[:, None, :]
        return lines

    def _resting_rods(self, estimate: GripperEstimate) -> RodsAtRest:
        """The rods whose chambers push with what would hold the bends, at the estimate's pressures.

        Those of the last estimate are kept: tips and centre lines are asked for one after the other.
        """
        if self._solved is not None and self._solved[0] is estimate:
            return self._solved[1]
        gravity = estimate.gravity_m_s2
        stiffness = self._law.moment_and_stiffness(estimate.pressure_gauge_pa)[1]
        moment = holding_moment_n_m(estimate.bend_rad, stiffness, self._geometry, gravity)
        rods = self._rods.at_rest(moment, estimate.pressure_gauge_pa, gravity.tolist(), estimate.bend_rad)
        self._solved = estimate, rods
        return rods


class _Followed(NamedTuple):
    """What the lag remembers of each finger: when it was last valid (NaN = never), its bend and equilibrium then."""

    valid_time_s: NDArray[np.float64]
    bend_rad: NDArray[np.float64]
    equilibrium_rad: NDArray[np.float64]


@njit(cache=True)
def _follow(
    followed: _Followed, time_s: float, equilibrium: NDArray[np.float64], lag_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Let each finger's bend follow its equilibrium to ``time_s``; return bend and rate, NaN where that is NaN.

    With e moving straight from e0 to e1 in dt, h = dt / T and g = 1 - exp(-h):
    x1 = x0 + g (e0 - x0) + (1 - g / h) (e1 - e0).
    """
    bend = equilibrium.copy()
    for i in range(equilibrium.shape[0]):
        if np.isnan(equilibrium[i]).any():
            continue
        if not np.isnan(followed.valid_time_s[i]):
            # Readings with one stamp leave the bend where it is.
            ratio = max((time_s - followed.valid_time_s[i]) / lag_s, 1e-12)
            gain = -np.expm1(-ratio)
            before, start = followed.bend_rad[i], followed.equilibrium_rad[i]
            bend[i] = before + gain * (start - before) + (1.0 - gain / ratio) * (equilibrium[i] - start)
        followed.valid_time_s[i] = time_s
        followed.bend_rad[i] = bend[i]
        followed.equilibrium_rad[i] = equilibrium[i]
    return bend, (equilibrium - bend) / lag_s


def _by_finger(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return one value a channel as a copy of shape (4 fingers, 4 chambers)."""
    array = np.array(values, dtype=float)
    if array.shape != (CHANNEL_COUNT,):
        raise ValueError(f"{name} must hold {CHANNEL_COUNT} values, found shape {array.shape}")
    return array.reshape(FINGER_COUNT, -1)
