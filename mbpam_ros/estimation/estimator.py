"""Bend, tip and force of the four fingers from their measured chamber pressures, each with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.calibration import Calibration, calibrate
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.actuator.kinematics import centreline, tip_pose
from mbpam_ros.actuator.metamodel import MusclePerformance, load_metamodel
from mbpam_ros.configuration import require_positive
from mbpam_ros.gripper import Gripper

_SLOPE_STEP_PA = 250.0
"""Half width of the central difference of the bend against a pressure."""

# Pressure offsets of a finger whose slopes are wanted: none, then + and - on each chamber; shape (9, 4).
_PROBES_PA = _SLOPE_STEP_PA * np.vstack(
    [np.zeros((1, CHAMBERS_PER_FINGER)), np.eye(CHAMBERS_PER_FINGER), -np.eye(CHAMBERS_PER_FINGER)]
)


@dataclass(frozen=True)
class EstimatorConfig:
    """What a user may change in ``config/estimator.yaml``.

    Args:
        bend_time_constant_s: lag of the bend behind the equilibrium of the measured pressures.
        centreline_points: points per finger of the drawn centre line, at least 2.
    """

    bend_time_constant_s: float
    centreline_points: int

    def __post_init__(self) -> None:
        require_positive(self, "bend_time_constant_s")
        if self.centreline_points < 2:
            raise ValueError(f"centreline_points must be at least 2, found {self.centreline_points}")


@dataclass(frozen=True)
class GripperEstimate:
    """State of the four fingers. NaN in every field of a finger = it has no valid reading now.

    Args:
        bend_rad, bend_rate_rad_s: bend components and their rates, shape (4, 2).
        moment_n_m: intrinsic moment of the chambers in bend components, shape (4, 2).
        bend_sigma_rad: one standard deviation of the bend, shape (4,).
    """

    bend_rad: NDArray[np.float64]
    bend_rate_rad_s: NDArray[np.float64]
    moment_n_m: NDArray[np.float64]
    bend_sigma_rad: NDArray[np.float64]


class BendEstimator:
    """First-order lag of each finger's bend behind the hanging equilibrium of its measured pressures.

    Between two readings the equilibrium is taken to move in a straight line, for which the lag is integrated exactly
    (stable for every step; the same bend however a straight move is divided into steps). The first reading, and the
    first after time ran backwards, finds the fingers at rest in their equilibrium.

    Args:
        calibration: the muscles' rod law and blocked force.
        geometry: of the muscles.
        finger_base_m: clamp points in ``gripper_base``, shape (4, 3).
        performance: of the design; its relative error in theta_max is the model's share of the uncertainty.
        config: what a user may change.

    Raises:
        ValueError: ``finger_base_m`` has another shape.
    """

    def __init__(
        self,
        calibration: Calibration,
        geometry: MuscleGeometry,
        finger_base_m: ArrayLike,
        performance: MusclePerformance,
        config: EstimatorConfig,
    ) -> None:
        self._law, self._tip_force = calibration.law, calibration.tip_force
        self._geometry, self._config = geometry, config
        self._base = np.array(finger_base_m, dtype=float)
        if self._base.shape != (FINGER_COUNT, 3):
            raise ValueError(f"finger_base_m must have shape ({FINGER_COUNT}, 3), found {self._base.shape}")
        self._relative_model_error = performance.theta_max_sigma_rad / performance.theta_max_rad
        self._arc_length = np.linspace(0.0, geometry.length_m, config.centreline_points)
        self.reset()

    @classmethod
    def for_gripper(cls, gripper: Gripper, config: EstimatorConfig) -> BendEstimator:
        """Build the estimator of a gripper with the metamodel and target it names."""
        return cls(
            calibrate(gripper.design, gripper.geometry, gripper.metamodel, gripper.target),
            gripper.geometry,
            gripper.finger_base_m,
            load_metamodel(gripper.metamodel).predict(gripper.design),
            config,
        )

    def reset(self) -> None:
        """Forget the past: the next valid reading of a finger finds it at rest in its equilibrium."""
        self._latest_time_s = -math.inf
        self._valid_time_s = np.full(FINGER_COUNT, np.nan)
        self._bend = np.full((FINGER_COUNT, 2), np.nan)
        self._equilibrium = np.full((FINGER_COUNT, 2), np.nan)

    def update(self, time_s: float, pressure_gauge_pa: ArrayLike, variance_pa2: ArrayLike) -> GripperEstimate:
        """Take one reading of all chambers and return the state of the fingers.

        A finger with a non-finite pressure gets NaN in every field and is not advanced; its next valid reading goes
        on from its last valid state over the time in between. Time running backwards resets the estimator.

        Args:
            time_s: stamp of the reading.
            pressure_gauge_pa: shape (16,), NaN = no valid reading.
            variance_pa2: variance of each pressure, >= 0, shape (16,). NaN makes that finger's sigma NaN.

        Raises:
            ValueError: a wrong shape, a negative variance or a time that is not finite. The state is unchanged.
        """
        pressure, variance = _checked(time_s, pressure_gauge_pa, variance_pa2)
        if time_s < self._latest_time_s:
            self.reset()
        self._latest_time_s = time_s
        valid = np.isfinite(pressure).all(axis=1)
        pressure[~valid] = np.nan

        moment, stiffness = self._law.moment_and_stiffness(pressure + _PROBES_PA[:, None, :])
        probes = hanging_bend(moment, stiffness, self._geometry)
        bend, rate = self._advance(time_s, probes[0], valid)
        return GripperEstimate(
            bend_rad=bend,
            bend_rate_rad_s=rate,
            moment_n_m=moment[0],
            bend_sigma_rad=self._bend_sigma(bend, probes, variance),
        )

    def tips(self, bend_rad: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the tips' positions (4, 3) [m] and orientations (4, 4), x y z w, in ``gripper_base`` for bends (4, 2).

        NaN where the bend is NaN.
        """
        position, orientation = tip_pose(bend_rad, self._geometry)
        return position + self._base, orientation

    def tip_force_n(self, moment_n_m: ArrayLike) -> NDArray[np.float64]:
        """Return the force against plates that block the tips, shape (4,), for intrinsic moments (4, 2)."""
        return self._tip_force.at(moment_n_m)

    def centrelines(self, bend_rad: ArrayLike) -> NDArray[np.float64]:
        """Return the centre lines of the fingers in ``gripper_base`` for bends (4, 2) [rad].

        Shape (4, ``centreline_points``, 3) [m], from clamp to tip; NaN where the bend is NaN.
        """
        return centreline(bend_rad, self._geometry, self._arc_length) + self._base[:, None, :]

    def _advance(
        self, time_s: float, equilibrium: NDArray[np.float64], valid: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Advance the valid fingers to ``time_s``; return bend and rate, NaN for the others.

        With e moving straight from e0 to e1 in dt, h = dt / T and g = 1 - exp(-h):
        x1 = x0 + g (e0 - x0) + (1 - g / h) (e1 - e0).
        """
        lag = self._config.bend_time_constant_s
        fresh = valid & np.isnan(self._valid_time_s)
        start = np.where(fresh[:, None], equilibrium, self._equilibrium)
        before = np.where(fresh[:, None], equilibrium, self._bend)
        elapsed = np.where(fresh, 0.0, time_s - self._valid_time_s)[:, None]
        ratio = np.maximum(elapsed / lag, 1e-12)  # readings with one stamp leave the bend where it is
        gain = -np.expm1(-ratio)
        bend = before + gain * (start - before) + (1.0 - gain / ratio) * (equilibrium - start)
        bend[~valid] = np.nan
        self._bend = np.where(valid[:, None], bend, self._bend)
        self._equilibrium = np.where(valid[:, None], equilibrium, self._equilibrium)
        self._valid_time_s = np.where(valid, time_s, self._valid_time_s)
        return bend, (equilibrium - bend) / lag

    def _bend_sigma(
        self, bend: NDArray[np.float64], probes: NDArray[np.float64], variance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Root sum of squares of pressure noise through the equilibrium's slopes and of the metamodel's error.

        The noise moves the bend vector both ways; its share is the root of the sum over both components and over the
        chambers, taken as independent. The lag's smoothing of the noise is not counted.
        """
        slope = (probes[1 : CHAMBERS_PER_FINGER + 1] - probes[CHAMBERS_PER_FINGER + 1 :]) / (2.0 * _SLOPE_STEP_PA)
        noise = np.einsum("cfk,cfk,fc->f", slope, slope, variance)
        model = self._relative_model_error * np.hypot(bend[:, 0], bend[:, 1])
        return np.sqrt(noise + model**2)


def _checked(
    time_s: float, pressure_gauge_pa: ArrayLike, variance_pa2: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return pressure and variance as copies of shape (4 fingers, 4 chambers)."""
    if not math.isfinite(time_s):
        raise ValueError(f"time must be finite, found {time_s}")
    pressure, variance = np.array(pressure_gauge_pa, dtype=float), np.array(variance_pa2, dtype=float)
    for name, value in (("pressure_gauge_pa", pressure), ("variance_pa2", variance)):
        if value.shape != (CHANNEL_COUNT,):
            raise ValueError(f"{name} must hold {CHANNEL_COUNT} values, found shape {value.shape}")
    if (variance < 0.0).any():
        raise ValueError(f"variance_pa2 must not be negative, found {variance.min():g}")
    return pressure.reshape(FINGER_COUNT, -1), variance.reshape(FINGER_COUNT, -1)
