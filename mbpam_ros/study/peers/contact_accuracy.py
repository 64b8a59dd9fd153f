"""The cheapest setting of each simulator that grasps and lifts as its own converged run does.

Compared are the tips and the sphere, every 50 ms, over the muscle's active length: where they are at the end, and rms
over the time before. What two simulators converge to differs, since their laws of contact do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np

from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.peers.grasp import GRASP_S, Grasp
from mbpam_ros.study.peers.mujoco_model import MujocoGrasp, has_integrator
from mbpam_ros.study.peers.own import OwnGrasp
from mbpam_ros.study.peers.problem import Array, tip_errors
from mbpam_ros.study.peers.search import Moving, Tried, cpu_ms_per_s

CALL_S = 0.010
"""Simulated time of one Python call."""

ERROR_PCT = 1.0

_SAMPLED_CALLS = 5
_OWN_REFERENCE = {"modes": 6, "step_s": 0.00025}
_MUJOCO_REFERENCE = {
    "elements": 16,
    "step_s": 0.00025,
    "integrator": "implicitfast",
    "cone": "elliptic",
    "tolerance": 1e-10,
}


class Grasping(Moving, Protocol):
    """A simulated grasp."""

    def places_m(self) -> Array:
        """Return the tips and the sphere's centre, world frame, shape (5, 3)."""


def in_calls(advance: Callable[[float], None], seconds: float) -> None:
    """Go on in calls of :data:`CALL_S`."""
    for _ in range(round(seconds / CALL_S)):
        advance(CALL_S)


def own_grasp_settings() -> list[dict[str, Any]]:
    """Return the settings of tier rod that are tried."""
    return [{"modes": modes, "step_s": step} for modes in (1, 2, 3, 4) for step in (0.01, 0.005, 0.0025, 0.002, 0.001)]


def mujoco_grasp_settings() -> list[dict[str, Any]]:
    """Return the settings of MuJoCo that are tried; longer steps are unstable."""
    names = ("elements", "step_s", "integrator", "cone", "tolerance")
    integrators = [name for name in ("discrete", "implicitfast") if has_integrator(name)]
    grid = ((4, 6, 8, 12), (0.005, 0.0025, 0.002, 0.001), integrators, ("elliptic", "pyramidal"), (1e-8, 1e-4))
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*grid)]


def places_in_grasp(simulation: Grasping) -> Array:
    """Return the places of a grasp from its start, every 50 ms, shape (n, 5, 3)."""
    simulation.reset()
    seen = []
    for _ in range(round(GRASP_S / (_SAMPLED_CALLS * CALL_S))):
        in_calls(simulation.advance, _SAMPLED_CALLS * CALL_S)
        seen.append(simulation.places_m())
    return np.array(seen)


def try_grasps(
    build: Callable[..., Grasping], settings: Iterable[dict[str, Any]], reference_m: Array, active_length_m: float
) -> list[Tried]:
    """Run every setting, ``build(**setting)``, against the reference; those that leave what can be are left out."""
    tried = []
    for setting in settings:
        simulation = build(**setting)
        try:
            errors = tip_errors(places_in_grasp(simulation), reference_m, active_length_m)
        except PlantDivergedError:
            continue
        tried.append(Tried(setting, errors, cost_of_grasp(simulation), simulation))
    return tried


def cost_of_grasp(simulation: Moving) -> float:
    """Return the CPU time [ms] per simulated second of a grasp."""
    return cpu_ms_per_s(simulation, lambda span: in_calls(simulation.advance, span), GRASP_S)


def own_grasps(grasp: Grasp) -> list[Tried]:
    """Return the settings of tier rod that were tried, against its own converged run."""
    return _against_itself(lambda **setting: OwnGrasp(grasp, **setting), _OWN_REFERENCE, own_grasp_settings(), grasp)


def mujoco_grasps(grasp: Grasp) -> list[Tried]:
    """Return the settings of MuJoCo that were tried, against its own converged run.

    Raises:
        PeerMissingError: it is not installed.
    """
    settings = mujoco_grasp_settings()
    return _against_itself(lambda **setting: MujocoGrasp(grasp, **setting), _MUJOCO_REFERENCE, settings, grasp)


def _against_itself(
    build: Callable[..., Grasping], converged: dict[str, Any], settings: list[dict[str, Any]], grasp: Grasp
) -> list[Tried]:
    reference_m = places_in_grasp(build(**converged))
    return try_grasps(build, settings, reference_m, grasp.problem.geometry.active_length_m)
