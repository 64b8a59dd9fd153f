"""A plan of a scene in words, beside what the scene's file says."""

from __future__ import annotations

import dataclasses
import math

from mbpam_ros.plant.fidelity import AUTO, FidelityRequest, FidelityTable, Tolerance
from mbpam_ros.plant.planner import Plan, PlanError, plan
from mbpam_ros.plant.scene import Scene
from mbpam_ros.pneumatics.config import load_pneumatics


def plan_text(
    found: Plan,
    scene: Scene,
    request: FidelityRequest,
    finger_length_m: float,
    table: FidelityTable,
    tolerance: Tolerance,
) -> str:
    """Return a plan of a scene as text and, where its file does not leave it open, what the file asks for beside it.

    Raises:
        ConfigError: the pneumatics cannot be read.
    """
    lines = [
        f"scene {scene.name}; allowed: {tolerance.static_pct:g} % at rest, {tolerance.transient_pct:g} % in motion, "
        f"{tolerance.contact_force_pct:g} % of contact force",
        f"measured on: {table.machine.get('processor', 'a machine that is not told')}{_when(table)}",
        "",
        str(found),
    ]
    if request.tier != AUTO:
        asked = dataclasses.replace(request, tolerance=tolerance)
        lines += ["", _as_the_file_says(scene, asked, finger_length_m, table)]
    return "\n".join(lines)


def _when(table: FidelityTable) -> str:
    told = [table.machine[what] for what in ("date", "costs") if what in table.machine]
    return "".join(f", {each}" for each in told)


def _as_the_file_says(scene: Scene, request: FidelityRequest, finger_length_m: float, table: FidelityTable) -> str:
    asked = dataclasses.replace(request, pneumatics=request.pneumatics or load_pneumatics().model)
    step_ms = 1e3 * (asked.sub_step_s or math.nan)
    title = f"as the file says ({asked.tier}, {step_ms:g} ms, {asked.pneumatics} taken for the real one)"
    try:
        return f"{title}: {plan(scene, finger_length_m, table, asked).expected}"
    except PlanError as error:
        return f"{title}: {error}"
