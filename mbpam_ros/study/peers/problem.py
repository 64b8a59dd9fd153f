"""The problem that all simulators get: four muscles hang straight and at rest, then their moment is switched on.

A muscle is a Kirchhoff rod between two rigid ends, clamped at the top, with the linear law of constant B, M0 and eta

    M = B (kappa + eta dkappa/dt) - M0,

pressures constant from t = 0 on. No simulator needs Python between its steps. Fingers do not touch each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.errors import MbpamError
from mbpam_ros.gripper import Gripper
from mbpam_ros.study.fidelity.boundary_value import hanging_tip_m

Array = NDArray[np.float64]

SAMPLE_S, SAMPLES, SETTLED_S = 0.030, 20, 2.1
"""Tips are compared every 30 ms for 0.6 s, and once more when all has come to rest. Steps divide 30 ms."""


class PeerMissingError(MbpamError, ImportError):
    """A simulator to compare with is not installed."""


class ReferenceSolutionError(MbpamError, RuntimeError):
    """Our converged solution and the boundary value problem do not agree."""


@dataclass(frozen=True)
class FingerProblem:
    """Four muscles under a constant moment toward the palm's axis.

    Args:
        geometry: of the muscles.
        base_m: clamps in ``gripper_base``, z down, shape (4, 3).
        moment_n_m: size of M0.
        stiffness_n_m2: B.
        retardation_s: eta.
        gravity_m_s2: along +z.
    """

    geometry: MuscleGeometry
    base_m: Array
    moment_n_m: float
    stiffness_n_m2: float
    retardation_s: float
    gravity_m_s2: float = GRAVITY_M_S2

    @property
    def inward(self) -> Array:
        """Unit vectors from the clamps toward the palm's axis, shape (4, 2)."""
        across = self.base_m[:, :2]
        return -across / np.linalg.norm(across, axis=1, keepdims=True)


def finger_problem(gripper: Gripper, pressure_gauge_pa: float, retardation_s: float) -> FingerProblem:
    """Return the problem with M0 and B of two adjacent chambers at a pressure, the muscles' strongest pattern."""
    law = calibrated_rod_law(gripper.design, gripper.geometry, gripper.metamodel, gripper.target)
    moment, stiffness = law.of_pattern("pdc", pressure_gauge_pa)
    return FingerProblem(gripper.geometry, gripper.finger_base_m, float(moment), float(stiffness), retardation_s)


@dataclass(frozen=True)
class TipErrors:
    """Errors of the tips over the muscle's length [%]: largest at rest, and rms over the sampled motion."""

    static_pct: float
    transient_pct: float

    def within(self, static_pct: float, transient_pct: float) -> bool:
        """Whether both are."""
        return self.static_pct <= static_pct and self.transient_pct <= transient_pct


def tip_errors(tips_m: Array, reference_m: Array, length_m: float) -> TipErrors:
    """Compare tips (SAMPLES + 1, 4, 3): the moving ones and, last, those at rest. Errors are infinite where not finite.

    The transient error is the worst finger's.
    """
    away = np.linalg.norm(tips_m - reference_m, axis=-1) / length_m * 100.0
    if not np.all(np.isfinite(away)):
        return TipErrors(math.inf, math.inf)
    return TipErrors(float(away[-1].max()), float(np.sqrt((away[:-1] ** 2).mean(axis=0)).max()))


def sample_tips(advance: Callable[[float], None], tips_m: Callable[[], Array]) -> Array:
    """Return tips (SAMPLES + 1, 4, 3) of a simulation at rest at its start.

    Args:
        advance: goes on by some seconds.
        tips_m: the tips now, shape (4, 3).
    """
    seen = []
    for _ in range(SAMPLES):
        advance(SAMPLE_S)
        seen.append(tips_m())
    advance(SETTLED_S - SAMPLES * SAMPLE_S)
    return np.array([*seen, tips_m()])


def static_tips(problem: FingerProblem) -> Array:
    """Return the tips at rest, shape (4, 3), of the boundary-value problem.

    Raises:
        BoundaryValueError: it was not solved.
    """
    moments = problem.moment_n_m * problem.inward
    hanging = [hanging_tip_m(moment, problem.stiffness_n_m2, problem.geometry) for moment in moments]
    return problem.base_m + np.array(hanging)
