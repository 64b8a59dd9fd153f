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
from typing import Any

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.gripper import Gripper
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
from mbpam_ros.study.peers.problem import FingerProblem, finger_problem
from mbpam_ros.study.peers.pyelastica_model import PyelasticaFreeBend
from mbpam_ros.study.peers.search import (
    TIMED_S,
    WINDOWS_S,
    Tried,
    cheapest,
    compare,
    cpu_ms_per_s,
    cpu_ms_per_s_of_starts,
    try_settings,
)
from mbpam_ros.terminal import table

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

PARTS = {BEND: 7, ALL_STRAINS: 6}
"""Into how many parts the comparison of each falls."""


def compare_with_peers(
    gripper: Gripper,
    retardation_s: float,
    runs: int,
    job_ended: Callable[[str], object] = str,
    strains: Collection[str] = (BEND, ALL_STRAINS),
) -> dict[str, Any]:
    """Return the ratios peer / ours and, under ``details``, all settings, errors and times.

    ``job_ended`` is called after each part with a line about it; ``strains`` are the sets that are compared.

    Raises:
        PeerMissingError: a simulator is not installed.
        StrainLawError: the rod's law says nothing of stretch and twist, and they are asked for.
        BoundaryValueError, RodSolutionError: the static problem was not solved.
        ReferenceSolutionError: the reference is not its solution.
        AccuracyError: a simulator was not accurate enough at any setting.
    """
    details: dict[str, Any] = {}
    if BEND in strains:
        details |= _bending(gripper, retardation_s, runs, job_ended)
    if ALL_STRAINS in strains:
        details |= _with_all_strains(gripper, retardation_s, runs, job_ended)
    ratios = {name: of["ratio"] for name, of in details.items() if "ratio" in of}
    return {**ratios, "details": {"conditions": _conditions(), **details}}


def _bending(
    gripper: Gripper, retardation_s: float, runs: int, job_ended: Callable[[str], object]
) -> dict[str, dict[str, Any]]:
    problem = finger_problem(gripper, PRESSURE_PA, retardation_s)
    reference, length = reference_tips(problem), problem.geometry.length_m
    own = try_settings(lambda **setting: OwnFreeBend(problem, **setting), own_settings(), reference, length)
    mujoco = try_settings(lambda **setting: MujocoFreeBend(problem, **setting), mujoco_settings(), reference, length)
    job_ended("settings of ours and MuJoCo tried")
    details: dict[str, dict[str, Any]] = {"problem": _described(problem)}
    for name, limits in _LIMITS.items():
        ours, peer = cheapest(own, *limits), cheapest(mujoco, *limits)
        details[f"free_{name}"] = {
            **_free(ours, peer, runs),
            "ratio_by_window_s": {str(window): _timed(ours, peer, runs, window)["ratio"] for window in WINDOWS_S},
        }
        job_ended(f"free_{name}")
    details["single_call_1ms"] = _single_calls(problem, cheapest(own, 1.0, 1.0), cheapest(mujoco, 1.0, 1.0), runs)
    job_ended("single_call_1ms")
    elastica = try_settings(
        lambda **setting: PyelasticaFreeBend(problem, **setting), pyelastica_settings(), reference, length
    )
    details["pyelastica_1pct"] = _free(cheapest(own, 1.0, float("inf")), cheapest(elastica, 1.0, float("inf")), runs)
    job_ended("pyelastica_1pct")
    grasped = finger_problem(gripper, GRASP_SHARE * PRESSURE_PA, retardation_s)
    details["contact_equal_step"] = _contact(grasped, runs)
    job_ended("contact_equal_step")
    details["contact_equal_accuracy"] = _equally_accurate(Grasp(grasped, friction=_FRICTION, **_SPHERE), runs)
    job_ended("contact_equal_accuracy")
    return details


def _with_all_strains(
    gripper: Gripper, retardation_s: float, runs: int, job_ended: Callable[[str], object]
) -> dict[str, dict[str, Any]]:
    hanging = finger_problem(gripper, PRESSURE_PA, retardation_s, all_strains=True)
    level = dataclasses.replace(hanging, gravity_m_s2=_LEVEL)
    return {
        **_strained(hanging, "hanging", runs, job_ended),
        **_strained(level, "level", runs, job_ended),
    }


def _strained(
    problem: FingerProblem, posture: str, runs: int, job_ended: Callable[[str], object]
) -> dict[str, dict[str, Any]]:
    reference, length = reference_tips(problem), problem.geometry.length_m
    own = try_settings(lambda **setting: OwnFreeBend(problem, **setting), own_strain_settings(), reference, length)
    mujoco = try_settings(
        lambda **setting: MujocoFreeBend(problem, **setting), mujoco_strain_settings(), reference, length
    )
    job_ended(f"settings of ours and MuJoCo tried with all strains, {posture}")
    details: dict[str, dict[str, Any]] = {f"problem_{posture}": _described(problem)}
    for name, limits in _LIMITS.items():
        key = f"strains_{posture}_{name}"
        details[key] = _free(cheapest(own, *limits), cheapest(mujoco, *limits), runs)
        job_ended(key)
    return details


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


def _free(ours: Tried, peer: Tried, runs: int) -> dict[str, Any]:
    return {**_timed(ours, peer, runs), "ours": ours.as_json(), "peer": peer.as_json()}


def _timed(ours: Tried, peer: Tried, runs: int, seconds: float = TIMED_S) -> dict[str, Any]:
    return compare(
        lambda: cpu_ms_per_s_of_starts(ours.simulation, ours.simulation.advance, seconds),
        lambda: cpu_ms_per_s_of_starts(peer.simulation, peer.simulation.advance, seconds),
        runs,
    )


def _single_calls(problem: FingerProblem, ours: Tried, peer: Tried, runs: int) -> dict[str, object]:
    """Time one Python call a step of 1 ms, with the spatial resolution and integrator that have 1 %."""
    own_setting, peer_setting = ({**one.setting, "step_s": _SINGLE_STEP_S} for one in (ours, peer))
    own, other = OwnFreeBend(problem, **own_setting), MujocoFreeBend(problem, **peer_setting)
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


def _conditions() -> dict[str, object]:
    packages = ("mujoco", "pyelastica", "numpy", "numba")
    return {
        "versions": {name: importlib.metadata.version(name) for name in packages},
        "python": platform.python_version(),
        "machine": platform.machine(),
        "load_average": os.getloadavg(),
        "mujoco_cone": CONE,
        "mujoco_impratio": IMPRATIO,
    }


def _described(problem: FingerProblem) -> dict[str, object]:
    return {
        "moment_n_m": problem.moment_n_m,
        "stiffness_n_m2": problem.stiffness_n_m2,
        "retardation_s": problem.retardation_s,
        "gravity_m_s2": problem.gravity_m_s2,
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
