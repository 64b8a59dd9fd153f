"""The problem that all simulators get: four muscles hang straight and at rest, then their moment is switched on.

A muscle is a Kirchhoff rod between two rigid ends, clamped at the top, with the linear law of constant B, M0 and eta

    M = B (kappa + eta dkappa/dt) - M0,

pressures constant from t = 0 on. With all strains it also stretches and twists, by the energy per unstretched length

    W = B / 2 kappa^2 - M0 . kappa + EA / 2 (epsilon - epsilon_0 - c . kappa)^2 + GJ / 2 tau^2

and eta times the rates of what is squared. No simulator needs Python between its steps. Fingers do not touch each
other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.elastic_rod import HANGING, RodLoads, RodSection, rod_at_rest
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
class Strains:
    """How the muscles stretch and twist, per unstretched length.

    Args:
        free_stretch: epsilon_0, stretch - 1 when held straight without axial force.
        slope_m: c along the bend that the moment makes.
        axial_stiffness_n: EA.
        torsion_stiffness_n_m2: GJ.
    """

    free_stretch: float
    slope_m: float
    axial_stiffness_n: float
    torsion_stiffness_n_m2: float


@dataclass(frozen=True)
class FingerProblem:
    """Four muscles under a constant moment toward the palm's axis.

    Args:
        geometry: of the muscles.
        base_m: clamps in ``gripper_base``, z down, shape (4, 3).
        moment_n_m: size of M0.
        stiffness_n_m2: B.
        retardation_s: eta.
        strains: stretch and twist; none: they only bend.
        gravity_m_s2: as a vector in ``gripper_base``, (3,).
    """

    geometry: MuscleGeometry
    base_m: Array
    moment_n_m: float
    stiffness_n_m2: float
    retardation_s: float
    strains: Strains | None = None
    gravity_m_s2: tuple[float, float, float] = HANGING

    @property
    def inward(self) -> Array:
        """Unit vectors from the clamps toward the palm's axis, shape (4, 2)."""
        across = self.base_m[:, :2]
        return -across / np.linalg.norm(across, axis=1, keepdims=True)


def finger_problem(
    gripper: Gripper, pressure_gauge_pa: float, retardation_s: float, all_strains: bool = False
) -> FingerProblem:
    """Return the problem with the law of two adjacent chambers at a pressure, the muscles' strongest pattern.

    Raises:
        StrainLawError: all strains are asked for, and the law says nothing of stretch and twist.
    """
    law = gripper.rod_law()
    moment, stiffness = law.of_pattern("pdc", pressure_gauge_pa)
    strains = None
    if all_strains:
        both = np.array([0.0, pressure_gauge_pa, pressure_gauge_pa, 0.0])
        of, toward = law.strain_law(both), law.moment_and_stiffness(both)[0]
        slope = of.stretch_per_curvature_m @ toward / np.linalg.norm(toward)
        strains = Strains(
            float(of.free_stretch), float(slope), float(of.axial_stiffness_n), float(of.torsion_stiffness_n_m2)
        )
    return FingerProblem(
        gripper.rod_geometry, gripper.finger_base_m, float(moment), float(stiffness), retardation_s, strains
    )


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

    Hanging muscles that only bend are solved by SciPy's collocation, others by the actuator's rod at rest.

    Raises:
        BoundaryValueError, RodSolutionError: it was not solved.
    """
    moments, of = problem.moment_n_m * problem.inward, problem.strains
    if of is None and problem.gravity_m_s2 == HANGING:
        tips = [hanging_tip_m(moment, problem.stiffness_n_m2, problem.geometry) for moment in moments]
    else:
        loads = RodLoads(gravity_m_s2=problem.gravity_m_s2)
        tips = [
            rod_at_rest(_section(problem, toward), problem.geometry, loads).tip_position_m for toward in problem.inward
        ]
    return problem.base_m + np.array(tips)


def _section(problem: FingerProblem, toward: Array) -> RodSection:
    (x, y), of = toward.tolist(), problem.strains
    only_bends = RodSection(problem.moment_n_m * x, problem.moment_n_m * y, problem.stiffness_n_m2)
    if of is None:
        return only_bends
    return only_bends._replace(
        free_stretch=of.free_stretch,
        slope_x_m=of.slope_m * x,
        slope_y_m=of.slope_m * y,
        axial_compliance_per_n=1.0 / of.axial_stiffness_n,
        torsion_compliance_per_n_m2=1.0 / of.torsion_stiffness_n_m2,
    )
