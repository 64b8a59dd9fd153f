"""The table of least grip pressures: objects of each mode's kind, closed upon and lifted by the simulated gripper.

A row is one mode, width, depth and friction; its masses rise, and so the search for each begins where the lighter one
was held: up in steps of :data:`STEP_PA` to the first pressure that holds, then down to :data:`RESOLUTION_PA` by
bisection. The gripper's limit is put up to :data:`HIGHEST_PA`, so that "needs 118 kPa" can be told of one that may not
have them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.plant.lift import LiftConfig
from mbpam_ros.plant.scene import ObjectSpec, Scene, SupportConfig
from mbpam_ros.study.grasp.trial import run_trial

LOWEST_PA, HIGHEST_PA, STEP_PA, RESOLUTION_PA = 55e3, 125e3, 15e3, 2e3

MASSES_KG = (0.02, 0.06, 0.12, 0.2)
FRICTIONS = (0.4, 0.8)

WIDTHS_M = {
    "envelope": (0.030, 0.050, 0.074),
    "short_rod": (0.018, 0.032, 0.047),
    "slender_rod": (0.012, 0.020, 0.028),
    "mid_rod": (0.018, 0.032, 0.047),
}
DEPTHS_M = {
    "envelope": (0.065, 0.080, 0.095, 0.110),
    "short_rod": (0.050, 0.065, 0.080, 0.095),
    "slender_rod": (0.050, 0.065, 0.080, 0.095),
    "mid_rod": (0.055, 0.075, 0.095, 0.115),
}
"""Widths across the fingers and depths of the centre below the palm, by mode."""

S_PER_JOB = 4.0
"""CPU of a row, a guess."""

_SLENDER, _SHORT = 12.0, 5.0
_LEAST_ROD_M = 0.12
_BOX_M = (0.12, 0.06)
_OVER_PA = 20e3
_STAND_M = 0.2
_STANDS_HALF_M = {
    "envelope": (0.010, 0.010),
    "short_rod": (0.008, 0.030),
    "slender_rod": (0.008, 0.030),
    "mid_rod": (0.010, 0.030),
}
_LIFT = LiftConfig(0.1, 1.0)


def object_for(mode: str, width_m: float, mass_kg: float) -> ObjectSpec:
    """Return an object that gets the mode: a ball, a rod of slenderness 5 or 12, or a box of 60 by 120 mm."""
    shape: Shape = "cylinder"
    size = (width_m, width_m, max(_SHORT * width_m, _LEAST_ROD_M))
    if mode == "envelope":
        shape, size = "sphere", (width_m, width_m, width_m)
    elif mode == "slender_rod":
        size = (width_m, width_m, _SLENDER * width_m)
    elif mode == "mid_rod":
        shape, size = "box", (width_m, *_BOX_M)
    return ObjectSpec(mode, shape, size, mass_kg, (0.5, 0.5, 0.5), mode, mode)


def scene_for(
    mode: str,
    spec: ObjectSpec,
    position_m: tuple[float, float, float],
    yaw_rad: float,
    friction_coefficient: float,
) -> Scene:
    """Return the scene of an object on a slim stand as the shipped scenes have it, to be grasped in a mode."""
    half_height_m = 0.5 * (spec.size_m[2] if spec.shape == "box" else spec.size_m[0])
    return Scene(
        name=f"{mode} {1e3 * spec.mass_kg:.0f} g",
        object=spec,
        object_position_m=position_m,
        object_yaw_rad=yaw_rad,
        gravity_m_s2=9.81,
        support=SupportConfig(position_m[2] + half_height_m, _STANDS_HALF_M[mode], _STAND_M),
        lift=_LIFT,
        friction_coefficient=friction_coefficient,
        fingers_touch=mode != "slender_rod",  # as in the scene tube
    )


def jobs(request: FidelityRequest, gripper: Gripper) -> dict[str, tuple]:
    """Return the arguments of :func:`table_row` of every row, by name."""
    strong = replace(gripper, pressure_limit_gauge_pa=HIGHEST_PA, over_pressure_gauge_pa=HIGHEST_PA + _OVER_PA)
    return {
        row_name(mode, width, depth, friction): (mode, width, depth, friction, request, strong)
        for mode in MODE_NAMES
        for width, depth, friction in product(WIDTHS_M[mode], DEPTHS_M[mode], FRICTIONS)
    }


def row_name(mode: str, width_m: float, depth_m: float, friction_coefficient: float) -> str:
    """Return the name of a row's job."""
    return f"{mode} {1e3 * width_m:g} mm, {1e3 * depth_m:g} mm deep, friction {friction_coefficient:g}"


def table_row(
    mode: str, width_m: float, depth_m: float, friction_coefficient: float, request: FidelityRequest, gripper: Gripper
) -> dict[str, object]:
    """Search the least pressures of all masses; return the row of :class:`~mbpam_ros.grasp.grip_pressure.GripTable`.

    Raises:
        ConfigError, TierError: a file is wrong, or the tier cannot compute the scene.
    """
    least: list[float | None] = []
    begin_pa: float | None = LOWEST_PA
    trials = 0
    for mass_kg in MASSES_KG:
        if begin_pa is not None:
            spec = object_for(mode, width_m, mass_kg)
            scene = scene_for(mode, spec, (0.0, 0.0, depth_m), 0.0, friction_coefficient)
            begin_pa, count = _least(scene, mode, request, gripper, begin_pa)
            trials += count
        least.append(begin_pa)
    return {
        "mode": mode,
        "width_m": width_m,
        "depth_m": depth_m,
        "friction_coefficient": friction_coefficient,
        "mass_kg": list(MASSES_KG),
        "least_gauge_pa": least,
        "trials": trials,
    }


def row_text(row: dict) -> str:
    """Return the line about a row."""
    found = ", ".join("none" if each is None else f"{1e-3 * each:.0f}" for each in row["least_gauge_pa"])
    place = row_name(row["mode"], row["width_m"], row["depth_m"], row["friction_coefficient"])
    return f"{place}: {found} kPa after {row['trials']} grasps"


def _least(
    scene: Scene, mode: str, request: FidelityRequest, gripper: Gripper, begin_pa: float
) -> tuple[float | None, int]:
    """Return the least pressure from ``begin_pa`` on that holds, and how many grasps it took."""
    trials = 0

    def holds(pressure_pa: float) -> bool:
        nonlocal trials
        trials += 1
        found = run_trial(scene, request, gripper, pressure_pa, mode=mode)
        return found.held

    fails_pa, holds_pa = None, begin_pa
    while not holds(holds_pa):
        if holds_pa >= HIGHEST_PA:
            return None, trials
        fails_pa, holds_pa = holds_pa, min(holds_pa + STEP_PA, HIGHEST_PA)
    while fails_pa is not None and holds_pa - fails_pa > RESOLUTION_PA:
        middle_pa = 0.5 * (fails_pa + holds_pa)
        if holds(middle_pa):
            holds_pa = middle_pa
        else:
            fails_pa = middle_pa
    return holds_pa, trials
