"""Whether calibration finds what is hidden: muscles nobody knows, measured on the simulated rig, then estimated.

Each hidden muscle is measured and fitted; then it hangs in the gripper, where its true tip is that of the full rod
(:mod:`~mbpam_ros.actuator.elastic_rod`) of its own law, and the state estimator is asked from noisy pressures, up and
down between those that were measured, before and after calibration.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.calibration import Calibration, calibrate_measured
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, FINGER_COUNT, pressurised_chambers
from mbpam_ros.actuator.elastic_rod import HANGING, FreeRods
from mbpam_ros.actuator.equilibrium import resting_bend
from mbpam_ros.actuator.hysteresis import felt_pressure
from mbpam_ros.configuration import load_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.rig import HiddenMuscle, MuscleRig, RigConfig, hidden_muscle
from mbpam_ros.study.rig.calibrate import factor, measured_muscle
from mbpam_ros.study.rig.curves import averaged
from mbpam_ros.study.rig.fit import fit_muscle
from mbpam_ros.study.rig.procedure import Plan, characterise, mounts_of
from mbpam_ros.study.rig.simulated import SimulatedRig
from mbpam_ros.terminal import table

S_PER_MUSCLE = 4.0
"""CPU [s]."""

MOST_FACTOR_ERROR, MOST_BEND_RMS_DEG = 0.02, 2.0
LEAST_WITHIN_ONE, LEAST_WITHIN_TWO = 0.68, 0.90

_FACTORS = ("psc_moment", "psc_stiffness", "pdc_moment", "pdc_stiffness")
_FINGER_AZIMUTHS_RAD = np.radians([0.0, 45.0, 180.0, 225.0])
_PRESSURE_NOISE_PA = 100.0
_ESTIMATE_EVERY_S = 2.0
_ASKED_KPA = np.concatenate([np.arange(5.0, 100.1, 5.0), np.arange(95.0, -0.1, -5.0)])


def judged_row(gripper: Gripper, config: RigConfig, repeats: int, step_kpa: float) -> dict[str, Any]:
    """Return what calibration makes of one hidden muscle.

    Args:
        gripper: whose muscles are drawn, with target ``fe`` or ``test``.
        config: of the rig; names the hidden muscle.
        repeats: ramps of each mount.
        step_kpa: between pressures, 0 to 100 kPa.

    Raises:
        RigError: the rig refused.
        CalibrationError: its curves give no factors.
    """
    drawn, geometry, seed = gripper.calibration(), gripper.rod_geometry, config.muscle_seed
    muscle = hidden_muscle(drawn.law, config)
    pressures = tuple(np.arange(0.0, 100.0 + 0.5 * step_kpa, step_kpa).tolist())
    rig = SimulatedRig(MuscleRig(muscle, geometry, config, seed), seed)
    points = averaged(characterise(rig, Plan(mounts_of(("pdc", "psc")), pressures, repeats)))
    fitted = fit_muscle(drawn.law, geometry, points)
    measured = measured_muscle([fitted], "test", {})
    after = calibrate_measured(drawn, gripper.geometry, measured)
    truth = {name: float(getattr(getattr(muscle, name.split("_")[0]), name.split("_")[1])) for name in _FACTORS}
    return {
        "seed": seed,
        "factors": truth,
        "factor_errors": {name: factor(fitted, name) / true - 1.0 for name, true in truth.items()},
        "factor_sigmas": {name: fitted.sigma[name] for name in _FACTORS},
        "hysteresis_pa": muscle.hysteresis_pa,
        "hysteresis_found_pa": fitted.hysteresis_pa,
        "before_errors_deg": _estimates(gripper, drawn, muscle, seed)[0],
        **dict(zip(("errors_deg", "sigmas_deg"), _estimates(gripper, after, muscle, seed), strict=True)),
    }


def _estimates(
    gripper: Gripper, calibration: Calibration, muscle: HiddenMuscle, seed: int
) -> tuple[list[float], list[float]]:
    """Errors and deviations [deg] of the estimated bends of four hanging fingers: one muscle each way round."""
    asked = dataclasses.replace(calibration, bend_sigma=calibration.bend_sigma or 0.0)
    config = load_config(EstimatorConfig, "estimator.yaml")
    geometry = gripper.rod_geometry
    estimator = BendEstimator(asked, geometry, gripper.finger_base_m, asked.bend_sigma or 0.0, config)
    rods, noise = FreeRods(muscle.law, geometry), np.random.default_rng((seed, 0x11))
    pressed = np.array([pressurised_chambers(azimuth) for azimuth in _FINGER_AZIMUTHS_RAD], dtype=float)
    felt = np.zeros((FINGER_COUNT, CHAMBERS_PER_FINGER))
    variance = np.full(felt.size, _PRESSURE_NOISE_PA**2)
    errors: list[float] = []
    sigmas: list[float] = []
    for number, pressure_kpa in enumerate(_ASKED_KPA):
        pressure = 1e3 * pressure_kpa * pressed
        felt = felt_pressure(felt, pressure, muscle.hysteresis_pa)
        reading = np.maximum(pressure + noise.normal(0.0, _PRESSURE_NOISE_PA, felt.shape) * pressed, 0.0)
        estimate = estimator.update(_ESTIMATE_EVERY_S * number, reading.ravel())
        errors += np.degrees(np.hypot(*estimate.bend_rad.T) - _true_angle_rad(rods, muscle, felt, gripper)).tolist()
        sigmas += np.degrees(estimator.bend_sigma_rad(estimate, variance)).tolist()
    return errors, sigmas


def _true_angle_rad(
    rods: FreeRods, muscle: HiddenMuscle, felt_pa: NDArray[np.float64], gripper: Gripper
) -> NDArray[np.float64]:
    moment, stiffness = muscle.law.moment_and_stiffness(felt_pa)
    near = resting_bend(moment, stiffness, gripper.rod_geometry, HANGING)
    tips = rods.at_rest(moment, felt_pa, HANGING, near).tip_orientation_xyzw
    # the angle between the tip's axis and the clamp's, which tells no more than half a turn; the bend says which half
    cosine = 1.0 - 2.0 * (tips[:, 0] ** 2 + tips[:, 1] ** 2)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    true: NDArray[np.float64] = np.where(np.hypot(*near.T) > math.pi, 2.0 * math.pi - angle, angle)
    return true


def verdict(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the figures of the judgement over all muscles."""
    errors = np.array([row["errors_deg"] for row in rows])
    share = np.abs(errors) / np.maximum([row["sigmas_deg"] for row in rows], 1e-9)
    factor_errors = np.abs([[row["factor_errors"][name] for name in _FACTORS] for row in rows])
    factor_share = factor_errors / np.array([[row["factor_sigmas"][name] for name in _FACTORS] for row in rows])
    before = np.array([row["before_errors_deg"] for row in rows])
    return {
        "muscles": len(rows),
        "factor_error_max": float(factor_errors.max()),
        "factor_error_rms": float(np.sqrt(np.mean(factor_errors**2))),
        "factor_within_one_sigma": float(np.mean(factor_share <= 1.0)),
        "factor_within_two_sigma": float(np.mean(factor_share <= 2.0)),
        "bend_before_rms_deg": float(np.sqrt(np.mean(before**2))),
        "bend_rms_deg": float(np.sqrt(np.mean(errors**2))),
        "bend_worst_muscle_rms_deg": float(np.sqrt(np.mean(errors**2, axis=1)).max()),
        "bend_worst_deg": float(np.abs(errors).max()),
        "bend_within_one_sigma": float(np.mean(share <= 1.0)),
        "bend_within_two_sigma": float(np.mean(share <= 2.0)),
    }


def is_good(found: dict[str, float]) -> bool:
    """Whether the judgement keeps what is promised."""
    return (
        found["factor_error_max"] <= MOST_FACTOR_ERROR
        and found["bend_rms_deg"] <= MOST_BEND_RMS_DEG
        and found["bend_within_one_sigma"] >= LEAST_WITHIN_ONE
        and found["bend_within_two_sigma"] >= LEAST_WITHIN_TWO
    )


def row_text(row: dict[str, Any]) -> str:
    """Return the line of one muscle."""
    worst = max(row["factor_errors"].values(), key=abs)
    before, after = (math.sqrt(float(np.mean(np.square(row[key])))) for key in ("before_errors_deg", "errors_deg"))
    return f"muscle {row['seed']}: factors within {100 * worst:+.2f} %, bend {before:.1f} -> {after:.2f} deg rms"


def verdict_text(found: dict[str, float]) -> str:
    """Return the figures as a table."""
    percent = lambda name: f"{100.0 * found[name]:.1f} %"  # noqa: E731
    rows = [
        ("factors, worst", percent("factor_error_max"), f"{100 * MOST_FACTOR_ERROR:g} %"),
        ("factors, rms", percent("factor_error_rms"), ""),
        (
            "factors within 1, 2 sigma",
            f"{percent('factor_within_one_sigma')}, {percent('factor_within_two_sigma')}",
            "",
        ),
        ("bend before, rms", f"{found['bend_before_rms_deg']:.2f} deg", ""),
        ("bend after, rms", f"{found['bend_rms_deg']:.2f} deg", f"{MOST_BEND_RMS_DEG:g} deg"),
        ("bend after, worst muscle's rms", f"{found['bend_worst_muscle_rms_deg']:.2f} deg", ""),
        ("bend after, worst", f"{found['bend_worst_deg']:.2f} deg", ""),
        ("bends within 1 sigma", percent("bend_within_one_sigma"), f"at least {100 * LEAST_WITHIN_ONE:g} %"),
        ("bends within 2 sigma", percent("bend_within_two_sigma"), f"at least {100 * LEAST_WITHIN_TWO:g} %"),
    ]
    return table((f"{found['muscles']:g} hidden muscles", "found", "asked"), rows)
