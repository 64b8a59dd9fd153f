"""Compare the plant's tier rod with MuJoCo and PyElastica on one problem: CPU time at equal accuracy.

Four muscles bend freely under a moment that is switched on; each simulator runs at its cheapest setting that keeps the
tips within the static and transient error (over the muscle's length). Then they also stretch and twist, hanging, and
level, where gravity twists them. Costs are of the first 0.6 s, while there is motion. With contact, a sphere is
grasped at 70 % of the pressure and lifted, both at the same step, and each at its cheapest setting that is within 1 %
of its own converged run. Needs the extra ``bench``.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import itertools
import os
import platform
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.gripper import Gripper
from mbpam_ros.study.executors import ThisProcess
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.peers.contact_accuracy import (
    CALL_S,
    ERROR_PCT,
    cost_of_grasp,
    in_calls,
    mujoco_grasps,
    own_grasps,
)
from mbpam_ros.study.peers.grasp import GRASP_S, HELD_SHARE, LIFT_M, Grasp
from mbpam_ros.study.peers.mujoco_model import (
    CONE,
    IMPRATIO,
    INTEGRATORS,
    MujocoFreeBend,
    MujocoGrasp,
    has_integrator,
)
from mbpam_ros.study.peers.own import OwnFreeBend, OwnGrasp, reference_tips
from mbpam_ros.study.peers.problem import Array, FingerProblem, finger_problem
from mbpam_ros.study.peers.pyelastica_model import PyelasticaFreeBend
from mbpam_ros.study.peers.search import (
    TIMED_S,
    WINDOWS_S,
    Simulation,
    Tried,
    cheapest,
    compare,
    cpu_ms_per_s,
    cpu_ms_per_s_of_starts,
    try_settings,
)
from mbpam_ros.terminal import Progress, table

PRESSURE_PA, GRASP_SHARE = 100e3, 0.7
_SPHERE = {"radius_m": 0.030, "mass_kg": 0.046, "depth_m": 0.085}
_FRICTION, _SLIPPERY = 0.6, 0.2
_CONTACT_ELEMENTS, _CONTACT_MODES, _CONTACT_STEP_S = 8, 3, 0.002
_CONTACT_INTEGRATORS = ("discrete", "implicitfast")
_SINGLE_STEP_S = 0.001
_LIMITS = {"1pct": (1.0, 1.0), "0p1pct": (0.1, 0.2)}
_LEVEL = (GRAVITY_M_S2, 0.0, 0.0)

BEND, ALL_STRAINS = "bend", "bend,stretch,twist"
"""Sets of strains that are compared."""

STRAINS = (BEND, ALL_STRAINS)
_S_PER_PART, _S_PER_RUN = 20.0, 2.0


class FreeBends:
    """Muscles that bend freely: the settings of ours and of MuJoCo are tried when a part first asks for them.

    Raises, when asked:
        BoundaryValueError, RodSolutionError: the static problem was not solved.
        ReferenceSolutionError: the reference is not its solution.
    """

    def __init__(self, problem: FingerProblem, ours: list[dict[str, object]], peer: list[dict[str, object]]) -> None:
        self.problem = problem
        self._ours, self._peer = ours, peer

    @cached_property
    def own(self) -> list[Tried]:
        """Ours at each setting."""
        return self.tried(OwnFreeBend, self._ours)

    @cached_property
    def mujoco(self) -> list[Tried]:
        """MuJoCo at each setting."""
        return self.tried(MujocoFreeBend, self._peer)

    def tried(self, simulator: Callable[..., Simulation], settings: list[dict[str, object]]) -> list[Tried]:
        """Return a simulator at each setting."""
        length = self.problem.geometry.length_m
        return try_settings(lambda **setting: simulator(self.problem, **setting), settings, self._reference_m, length)

    @cached_property
    def _reference_m(self) -> Array:
        return reference_tips(self.problem)


def compare_with_peers(
    gripper: Gripper,
    retardation_s: float,
    runs: int,
    kept: Path | None,
    progress: Progress,
    strains: Collection[str] = STRAINS,
) -> dict[str, Any]:
    """Return the ratios peer / ours and, under ``details``, all settings, errors and times.

    Args:
        gripper: of which the fingers are.
        retardation_s: retardation time of the silicone [s].
        runs: interleaved runs of each pair.
        kept: file of the parts that are finished, from which an interrupted comparison goes on; None keeps none.
        progress: told of each part.
        strains: the sets that are compared.

    Raises:
        PeerMissingError: a simulator is not installed.
        StrainLawError: the rod's law says nothing of stretch and twist, and they are asked for.
        BoundaryValueError, RodSolutionError: the static problem was not solved.
        ReferenceSolutionError: the reference is not its solution.
        AccuracyError: a simulator was not accurate enough at any setting.
        ResultFileError: ``kept`` is something else, or cannot be written.
    """
    problems: dict[str, dict[str, object]] = {}
    parts: dict[str, Callable[[], dict[str, Any]]] = {}
    if BEND in strains:
        problem = finger_problem(gripper, PRESSURE_PA, retardation_s)
        problems["problem"] = _described(problem)
        parts |= _bending(problem, finger_problem(gripper, GRASP_SHARE * PRESSURE_PA, retardation_s), runs)
    if ALL_STRAINS in strains:
        hanging = finger_problem(gripper, PRESSURE_PA, retardation_s, all_strains=True)
        for posture, problem in (("hanging", hanging), ("level", replace(hanging, gravity_m_s2=_LEVEL))):
            problems[f"problem_{posture}"] = _described(problem)
            parts |= _with_all_strains(problem, posture, runs)
    settings = {"runs": runs, **problems, **_software()}
    results = ResultFile(kept, settings, "parts", lambda row: row["part"])
    run_jobs(
        {name: (name, part) for name, part in parts.items()},
        _measured,
        results,
        ThisProcess(),  # processor time is measured: one after the other
        progress,
        lambda row: f"{row['part']}: {row['ratio']:.1f}",
        s_per_job=_S_PER_PART + _S_PER_RUN * runs,
    )
    rows = {name: results.rows[name] for name in parts}
    conditions = {**_software(), "load_average": os.getloadavg()}
    return {
        **{name: row["ratio"] for name, row in rows.items()},
        "details": {"conditions": conditions, **problems, **rows},
    }


def _measured(name: str, part: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    return {"part": name, **part()}


def _bending(problem: FingerProblem, grasped: FingerProblem, runs: int) -> dict[str, Callable[[], dict[str, Any]]]:
    bends = FreeBends(problem, own_settings(), mujoco_settings())
    return {
        **{f"free_{name}": partial(_free_by_window, bends, limits, runs) for name, limits in _LIMITS.items()},
        "single_call_1ms": partial(_single_calls, bends, runs),
        "pyelastica_1pct": partial(_free_of_pyelastica, bends, runs),
        "contact_equal_step": partial(_contact, grasped, runs),
        "contact_equal_accuracy": partial(_equally_accurate, Grasp(grasped, friction=_FRICTION, **_SPHERE), runs),
    }


def _with_all_strains(problem: FingerProblem, posture: str, runs: int) -> dict[str, Callable[[], dict[str, Any]]]:
    bends = FreeBends(problem, own_strain_settings(), mujoco_strain_settings())
    return {f"strains_{posture}_{name}": partial(_free, bends, limits, runs) for name, limits in _LIMITS.items()}


def own_settings() -> list[dict[str, object]]:
    """Return the settings of tier rod that are tried."""
    return [
        {"modes": modes, "step_s": step} for modes in (1, 2, 3, 4) for step in (0.03, 0.015, 0.01, 0.006, 0.005, 0.003)
    ]


def mujoco_settings() -> list[dict[str, object]]:
    """Return the settings of MuJoCo that are tried: few elements with long steps, many with short ones.

    Around the best ones only. ``implicit`` costs several times as much as ``implicitfast`` at nearly the same error;
    the explicit ``Euler`` and ``RK4`` are unstable at steps of 1 ms.
    """
    grids = {
        "discrete": [*itertools.product((6, 8), (0.002, 0.0015, 0.001)), *itertools.product((17,), (0.0005, 0.0003))],
        "implicitfast": [
            *itertools.product((6, 7, 8, 10), (0.005, 0.00375, 0.003, 0.0025, 0.002)),
            *itertools.product((17, 18), (0.00075, 0.0006, 0.0005)),
        ],
        "implicit": [(7, 0.003), (17, 0.0005)],
    }
    return _mujoco_settings(grids)


def _mujoco_settings(grids: dict[str, list[tuple[int, float]]]) -> list[dict[str, object]]:
    return [
        {"elements": elements, "step_s": step, "integrator": integrator}
        for integrator in INTEGRATORS
        if integrator in grids and has_integrator(integrator)
        for elements, step in grids[integrator]
    ]


def own_strain_settings() -> list[dict[str, object]]:
    """Return the settings of tier rod that are tried with all strains."""
    return [
        {"modes": modes, "twist_modes": twist, "stretch_modes": stretch, "step_s": step}
        for modes in (2, 3, 4)
        for twist, stretch in ((1, 1), (2, 1), (1, 2), (2, 2))
        for step in (0.03, 0.015, 0.01, 0.0075, 0.006, 0.005, 0.003)
    ]


def mujoco_strain_settings() -> list[dict[str, object]]:
    """Return the settings of MuJoCo that are tried with all strains, around the best ones.

    ``discrete`` is off twice as much as ``implicitfast`` at equal steps.
    """
    grids = {
        "discrete": [(7, 0.0015), (8, 0.001)],
        "implicitfast": [
            *itertools.product((5, 6, 7, 8), (0.00375, 0.003, 0.0025, 0.002)),
            *itertools.product((14, 16, 18), (0.00075, 0.0006, 0.0005)),
        ],
    }
    return _mujoco_settings(grids)


def pyelastica_settings() -> list[dict[str, object]]:
    """Return the settings of PyElastica that are tried; longer steps are unstable."""
    return [{"shares": shares, "step_s": step} for shares in (6, 8, 10) for step in (0.0005, 0.0004, 0.0003)]


def _free(bends: FreeBends, limits: tuple[float, float], runs: int) -> dict[str, Any]:
    return _compared(cheapest(bends.own, *limits), cheapest(bends.mujoco, *limits), runs)


def _free_by_window(bends: FreeBends, limits: tuple[float, float], runs: int) -> dict[str, Any]:
    ours, peer = cheapest(bends.own, *limits), cheapest(bends.mujoco, *limits)
    return {
        **_compared(ours, peer, runs),
        "ratio_by_window_s": {str(window): _timed(ours, peer, runs, window)["ratio"] for window in WINDOWS_S},
    }


def _free_of_pyelastica(bends: FreeBends, runs: int) -> dict[str, Any]:
    """Compare what comes to rest at the right place: its transients are not those of the same damping."""
    elastica = bends.tried(PyelasticaFreeBend, pyelastica_settings())
    return _compared(cheapest(bends.own, 1.0, float("inf")), cheapest(elastica, 1.0, float("inf")), runs)


def _compared(ours: Tried, peer: Tried, runs: int) -> dict[str, Any]:
    return {**_timed(ours, peer, runs), "ours": ours.as_json(), "peer": peer.as_json()}


def _timed(ours: Tried, peer: Tried, runs: int, seconds: float = TIMED_S) -> dict[str, Any]:
    return compare(
        lambda: cpu_ms_per_s_of_starts(ours.simulation, ours.simulation.advance, seconds),
        lambda: cpu_ms_per_s_of_starts(peer.simulation, peer.simulation.advance, seconds),
        runs,
    )


def _single_calls(bends: FreeBends, runs: int) -> dict[str, object]:
    """Time one Python call a step of 1 ms, with the spatial resolution and integrator that have 1 %."""
    own_setting, peer_setting = (
        {**cheapest(tried, 1.0, 1.0).setting, "step_s": _SINGLE_STEP_S} for tried in (bends.own, bends.mujoco)
    )
    own, other = OwnFreeBend(bends.problem, **own_setting), MujocoFreeBend(bends.problem, **peer_setting)
    timed = compare(
        lambda: cpu_ms_per_s_of_starts(own, own.advance_singly),
        lambda: cpu_ms_per_s_of_starts(other, other.advance_singly),
        runs,
    )
    return {**timed, "ours": own_setting, "peer": peer_setting}


def _contact(problem: FingerProblem, runs: int) -> dict[str, object]:
    """Time a grasp and lift at one step; show that the sphere slips out in both with little friction."""

    def lifted(simulation: OwnGrasp | MujocoGrasp) -> float:
        return cpu_ms_per_s(simulation, lambda span: in_calls(simulation.advance, span), GRASP_S)

    def own(friction: float) -> OwnGrasp:
        return OwnGrasp(Grasp(problem, friction=friction, **_SPHERE), _CONTACT_MODES, _CONTACT_STEP_S)

    def peer(friction: float, integrator: str) -> MujocoGrasp:
        grasp = Grasp(problem, friction=friction, **_SPHERE)
        return MujocoGrasp(grasp, _CONTACT_ELEMENTS, _CONTACT_STEP_S, integrator)

    integrators = [name for name in _CONTACT_INTEGRATORS if has_integrator(name)]
    cost = {name: lifted(peer(_FRICTION, name)) for name in integrators}
    integrator = min(cost, key=cost.__getitem__)
    rises = {}
    for friction in (_FRICTION, _SLIPPERY):
        for name, simulation in (("ours", own(friction)), ("mujoco", peer(friction, integrator))):
            lifted(simulation)
            rise = simulation.rise_m()
            rises[f"{name}, mu = {friction}"] = {"rise_m": rise, "held": rise > HELD_SHARE * LIFT_M}
    ours, other = own(_FRICTION), peer(_FRICTION, integrator)
    timed = compare(lambda: lifted(ours), lambda: lifted(other), runs)
    setting = {"step_s": _CONTACT_STEP_S, "call_s": CALL_S, "pressure_share": GRASP_SHARE, **_SPHERE}
    return {
        **timed,
        **setting,
        "ours": {"modes": _CONTACT_MODES},
        "peer": {"elements": _CONTACT_ELEMENTS, "integrator": integrator, "cpu_ms_per_s_by_integrator": cost},
        "lifts": rises,
    }


def _equally_accurate(grasp: Grasp, runs: int) -> dict[str, Any]:
    """Time a grasp and lift, each at its cheapest setting that is near enough to its own converged run."""
    ours, peer = (cheapest(tried(grasp), ERROR_PCT, ERROR_PCT) for tried in (own_grasps, mujoco_grasps))
    timed = compare(lambda: cost_of_grasp(ours.simulation), lambda: cost_of_grasp(peer.simulation), runs)
    return {**timed, "error_pct": ERROR_PCT, "call_s": CALL_S, "ours": ours.as_json(), "peer": peer.as_json()}


def _software() -> dict[str, object]:
    packages = ("mujoco", "pyelastica", "numpy", "numba")
    return {
        "versions": {name: importlib.metadata.version(name) for name in packages},
        "python": platform.python_version(),
        "machine": platform.machine(),
        "mujoco_cone": CONE,
        "mujoco_impratio": IMPRATIO,
    }


def _described(problem: FingerProblem) -> dict[str, object]:
    return {
        "moment_n_m": problem.moment_n_m,
        "stiffness_n_m2": problem.stiffness_n_m2,
        "retardation_s": problem.retardation_s,
        "gravity_m_s2": list(problem.gravity_m_s2),
        "length_m": problem.geometry.length_m,
        "mass_per_length_kg_m": problem.geometry.mass_per_length_kg_m,
        **({} if problem.strains is None else dataclasses.asdict(problem.strains)),
    }


def result_text(result: dict[str, Any]) -> str:
    """Return the ratios with their settings, what holds, and what was measured on."""
    details = result["details"]
    rows = []
    for name, value in result.items():
        if name != "details":
            one = details[name]
            rows.append((name, f"{one['ours_cpu_ms_per_s']:.3f}", f"{one['peer_cpu_ms_per_s']:.3f}", f"{value:.1f}"))
    lines = [table(("CPU ms per simulated second", "ours", "peer", "peer / ours"), rows)]
    for name, *_ in rows:
        lines += [f"{name}: ours {details[name]['ours']}", f"{name}: peer {details[name]['peer']}"]
        for window, ratio in details[name].get("ratio_by_window_s", {}).items():
            lines.append(f"{name} over {window} s: {ratio:.1f}")
    for name, lift in details.get("contact_equal_step", {}).get("lifts", {}).items():
        lines.append(f"{name} rises {1e3 * lift['rise_m']:.1f} mm: {'held' if lift['held'] else 'lost'}")
    return "\n".join([*lines, str(details["conditions"])])
