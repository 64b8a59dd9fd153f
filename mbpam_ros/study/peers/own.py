"""The peers' problem in the plant's tier ``rod``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.actuator.rod_law import StrainLaw
from mbpam_ros.configuration import load_config
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, RigidBody, TierSetup
from mbpam_ros.plant.tiers.rod import RodTier
from mbpam_ros.study.peers.grasp import GRASP_S, Grasp, hand_motion
from mbpam_ros.study.peers.problem import (
    Array,
    FingerProblem,
    ReferenceSolutionError,
    sample_tips,
    static_tips,
    tip_errors,
)

_REFERENCE_MODES, _REFERENCE_STEP_S, _REFERENCE_PCT = 6, 0.00025, 0.01


class OwnFreeBend:
    """Tier ``rod`` with numbers of modes and a step; those of twist and stretch count where the problem has these."""

    def __init__(
        self, problem: FingerProblem, modes: int, step_s: float, twist_modes: int = 0, stretch_modes: int = 0
    ) -> None:
        fidelity = Fidelity("rod", modes, step_s, twist_modes=twist_modes, stretch_modes=stretch_modes)
        self._tier = RodTier(_setup(problem, None, np.empty((0, 3))), fidelity)
        self._on, self._step_s = _actuation(problem), step_s
        self.reset()

    def reset(self) -> None:
        """Hang straight, at rest."""
        self._tier.reset(self._on)

    def advance(self, seconds: float) -> None:
        """Go on, all steps in one Python call."""
        still = np.zeros(round(seconds / self._step_s) + 1)
        self._tier.step(self._on, still, still)

    def advance_singly(self, seconds: float) -> None:
        """Go on, one Python call a step."""
        still, on, step = np.zeros(2), self._on, self._tier.step
        for _ in range(round(seconds / self._step_s)):
            step(on, still, still)

    def tips_m(self) -> Array:
        """Return the tips, shape (4, 3)."""
        return self._tier.state().centreline_m[:, -1]


class OwnGrasp:
    """Tier ``rod`` that closes on a sphere and lifts it."""

    def __init__(self, grasp: Grasp, modes: int, step_s: float) -> None:
        body = RigidBody(
            "sphere", (2.0 * grasp.radius_m,) * 3, grasp.mass_kg, np.array([0.0, 0.0, grasp.depth_m]),
            np.array([0.0, 0.0, 0.0, 1.0]),
        )  # fmt: skip
        plane = np.array(
            [[grasp.depth_m + grasp.radius_m, grasp.stand_half_m, grasp.stand_half_m], [1.0, np.inf, np.inf]]
        )
        self._tier = RodTier(_setup(grasp.problem, body, plane, grasp.friction), Fidelity("rod", modes, step_s))
        self._on, self._step_s, self._grasp = _actuation(grasp.problem), step_s, grasp
        self._height_m, self._rate_m_s = hand_motion(np.arange(round(GRASP_S / step_s) + 1, dtype=np.float64) * step_s)
        self.reset()

    def reset(self) -> None:
        """Open, hand down."""
        self._tier.reset(self._on)
        self._done = 0

    def advance(self, seconds: float) -> None:
        """Go on, all steps in one Python call."""
        first, self._done = self._done, self._done + round(seconds / self._step_s)
        ends = slice(first, self._done + 1)
        self._tier.step(self._on, self._height_m[ends], self._rate_m_s[ends])

    def rise_m(self) -> float:
        """Return how far the sphere has risen."""
        return self._grasp.depth_m - float(self._tier.body_states()[0].position_m[2])

    def places_m(self) -> Array:
        """Return the tips and the sphere's centre, world frame, shape (5, 3)."""
        tips_m = self._tier.centreline_m()[:, -1] - (0.0, 0.0, self._height_m[self._done])
        return np.vstack([tips_m, self._tier.body_states()[0].position_m])


def reference_tips(problem: FingerProblem) -> Array:
    """Return the converged tips (SAMPLES + 1, 4, 3), checked against the boundary value problem.

    Raises:
        ReferenceSolutionError: at rest they differ from its solution by more than 0.01 % of the length.
    """
    of_strain = 0 if problem.strains is None else _REFERENCE_MODES
    fine = OwnFreeBend(problem, _REFERENCE_MODES, _REFERENCE_STEP_S, of_strain, of_strain)
    tips, length = sample_tips(fine.advance, fine.tips_m), problem.geometry.length_m
    error = tip_errors(tips[-1:].repeat(2, 0), static_tips(problem)[None].repeat(2, 0), length).static_pct
    if not error < _REFERENCE_PCT:
        raise ReferenceSolutionError(
            f"tier rod with {_REFERENCE_MODES} modes is {error:g} % off the solved rod at rest"
        )
    return tips


def _actuation(problem: FingerProblem) -> Actuation:
    moments, stiffnesses = problem.moment_n_m * problem.inward, np.full(FINGER_COUNT, problem.stiffness_n_m2)
    of = problem.strains
    if of is None:
        return Actuation(moments, stiffnesses)
    strain = StrainLaw(
        np.full(FINGER_COUNT, of.free_stretch),
        of.slope_m * problem.inward,
        np.full(FINGER_COUNT, of.axial_stiffness_n),
        np.full(FINGER_COUNT, of.torsion_stiffness_n_m2),
    )
    return Actuation(moments, stiffnesses, strain)


def _setup(problem: FingerProblem, body: RigidBody | None, planes: Array, friction: float = 0.6) -> TierSetup:
    config, size = load_config(PlantConfig, "plant.yaml"), float(np.linalg.norm(problem.gravity_m_s2))
    x, y, z = problem.gravity_m_s2
    return TierSetup(
        geometry=problem.geometry,
        finger_base_m=problem.base_m,
        gravity_m_s2=size,
        gravity_direction=(x / size, y / size, z / size),
        body=body,
        planes_m=planes,
        config=replace(
            config,
            retardation_time_s=problem.retardation_s,
            finger_object=replace(config.finger_object, friction_coefficient=friction),
        ),
    )
