"""The peers' problem in PyElastica: Cosserat rods of straight elements, explicit in time.

An element of length l = L / N bends at its ends. The rod starts l / 2 before the active part, so that N bending nodes
stand in the middles of N equal shares of it; what is beyond the last one, half a share and the straight end, is as many
elements as fit, what is left over a mass at the last node, and the tip lies on the tangent of the last. The section is
the muscle's circle with the Young's modulus that gives B; its stretch and shear under the weight (0.1 % of the length)
are PyElastica's own.

It has no Kelvin-Voigt damping: only what is at rest is compared, reached under a damping that costs the same as any.
The scheme (position Verlet) needs steps below about l / sqrt(E / rho).
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np

from mbpam_ros.study.peers.problem import Array, FingerProblem, PeerMissingError

_DAMPING_PER_S = 20.0
_ROUNDING = 1e-9


def load_pyelastica() -> ModuleType:
    """Import PyElastica.

    Raises:
        PeerMissingError: it is not installed.
    """
    try:
        import elastica
    except ImportError as error:
        raise PeerMissingError("PyElastica is not installed: pip install 'mbpam_ros[bench]'") from error
    return elastica


def rod_elements(problem: FingerProblem, shares: int) -> tuple[int, float, float]:
    """Return how many elements a rod has, where it starts along the muscle, and how long they are [m].

    They end less than one of them before the muscle does, where a share is shorter than two ends.
    """
    geometry = problem.geometry
    length = geometry.active_length_m / shares
    beyond = max(1, int(0.5 + geometry.end_length_m / length + _ROUNDING))
    return shares + beyond, geometry.end_length_m - 0.5 * length, length


class PyelasticaFreeBend:
    """PyElastica with a number of shares of the active part and a step.

    Raises:
        PeerMissingError: it is not installed.
    """

    def __init__(self, problem: FingerProblem, shares: int, step_s: float) -> None:
        self._elastica = load_pyelastica()
        self._problem, self._shares, self._step_s = problem, shares, step_s
        self._stepper = self._elastica.PositionVerlet()
        self.reset()

    def reset(self) -> None:
        """Hang straight, at rest."""
        ea, problem = self._elastica, self._problem

        class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):  # type: ignore[name-defined]  # imported late
            pass

        self._simulator, self._time_s = Simulator(), 0.0
        self._rods = [self._add_finger(finger) for finger in range(len(problem.base_m))]
        self._simulator.finalize()

    def _add_finger(self, finger: int) -> Any:
        ea, problem = self._elastica, self._problem
        elements, start, length = rod_elements(problem, self._shares)
        radius, toward = problem.geometry.outer_radius_m, problem.inward[finger]
        modulus = problem.stiffness_n_m2 / (0.25 * math.pi * radius**4)
        rod = ea.CosseratRod.straight_rod(
            elements,
            problem.base_m[finger] + (0.0, 0.0, start),
            np.array([0.0, 0.0, 1.0]),
            np.array([-toward[1], toward[0], 0.0]),  # normal to the plane of the moment: d1, which curvature is about
            elements * length,
            radius,
            problem.geometry.mass_per_length_kg_m / (math.pi * radius**2),
            youngs_modulus=modulus,
            shear_modulus=modulus / 3.0,
        )
        rod.mass[-1] += problem.geometry.mass_per_length_kg_m * self._left_m
        rod.rest_kappa[0, : self._shares] = problem.moment_n_m / problem.stiffness_n_m2
        simulator = self._simulator
        simulator.append(rod)
        simulator.constrain(rod).using(
            ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )  # fmt: skip
        simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array(problem.gravity_m_s2))
        simulator.dampen(rod).using(
            ea.AnalyticalLinearDamper, uniform_damping_constant=_DAMPING_PER_S, time_step=self._step_s
        )
        return rod

    def advance(self, seconds: float) -> None:
        """Go on; PyElastica's loop over the steps is in Python."""
        step, simulator, time_s = self._stepper.step, self._simulator, self._time_s
        for _ in range(round(seconds / self._step_s)):
            time_s = step(simulator, time_s, self._step_s)
        self._time_s = time_s

    def tips_m(self) -> Array:
        """Return the tips in ``gripper_base``, shape (4, 3)."""
        return np.array([rod.position_collection[:, -1] + self._left_m * rod.tangents[:, -1] for rod in self._rods])

    @property
    def _left_m(self) -> float:
        elements, start, length = rod_elements(self._problem, self._shares)
        return self._problem.geometry.length_m - start - elements * length
