"""The paper's grasps: the least pressure that holds each object, and what holds it.

Each grasp runs without ROS through the gripper's own sensing, mode selection, arbitration and pressure loops: rest,
close, lift, hold for 1 s. An object is held if it rose with the hand and rests in it; only the contact model decides.
What still holds with next to no friction (0.05) is held by caging, what does not, by friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.plant.scene import PAPER_SCENES, Scene
from mbpam_ros.study.grasp.least_pressure import LeastPressure, least_pressure
from mbpam_ros.study.grasp.trial import HELD_SHARE, HOLD_S, Trial, run_trial
from mbpam_ros.study.provenance import sources_digest
from mbpam_ros.terminal import table

NOMINAL_PA = 100e3
"""The paper's pressure."""

SLIPPERY = 0.05
"""Coefficient of friction that leaves next to nothing of friction, as of ice on steel."""

S_PER_STUDY = {"arc": 25.0, "rod": 40.0}
"""CPU of one object with one design, by tier."""

LEAST_PA, STEP_PA, RESOLUTION_PA = 40e3, 10e3, 1e3


@dataclass(frozen=True)
class GraspRow:
    """One object in one design.

    Args:
        scene, object, mass_kg, papers_mode: what is grasped, and the mode the paper used.
        design, a_mm, b_mm, tier: of the muscles, and how they are computed.
        at_nominal, slippery_at_nominal: what happens at :data:`NOMINAL_PA`, with friction as it is and without.
        least, slippery_least: least pressures that hold, likewise.
        trials: how many grasps were run.
    """

    scene: str
    object: str
    mass_kg: float
    papers_mode: str
    design: str
    a_mm: float
    b_mm: float
    tier: str
    at_nominal: Trial
    slippery_at_nominal: Trial
    least: LeastPressure
    slippery_least: LeastPressure
    trials: int

    @property
    def held_by(self) -> str:
        """What holds the object at the nominal pressure: friction, caging, or nothing."""
        if not self.at_nominal.held:
            return "-"
        return "caging" if self.slippery_at_nominal.held else "friction"


def study_grasp(scene: Scene, request: FidelityRequest, gripper: Gripper, design: str) -> GraspRow:
    """Search the least pressures that hold the object of a scene, with its friction and without.

    Args:
        scene: with an object.
        request: how to compute it.
        gripper: with the design in it.
        design: its name, for the record.

    Raises:
        ConfigError, TierError: the scene or a file is wrong.
    """
    spec = scene.object
    if spec is None:
        raise ConfigError(f"scene {scene.name}: nothing to grasp; name an object in it")
    grid = [*np.arange(LEAST_PA, gripper.pressure_limit_gauge_pa - 1.0, STEP_PA), gripper.pressure_limit_gauge_pa]
    trials: dict[tuple[str, float], Trial] = {}

    def trial(scene: Scene, pressure_pa: float) -> Trial:
        if (scene.name, pressure_pa) not in trials:
            trials[scene.name, pressure_pa] = run_trial(scene, request, gripper, pressure_pa)
        return trials[scene.name, pressure_pa]

    def search(scene: Scene) -> LeastPressure:
        return least_pressure(lambda pressure: trial(scene, pressure).held, [float(p) for p in grid], RESOLUTION_PA)

    slippery = replace(scene, friction_coefficient=SLIPPERY, name=f"{scene.name}, slippery")
    return GraspRow(
        scene=scene.name,
        object=spec.name,
        mass_kg=spec.mass_kg,
        papers_mode=spec.expected_mode,
        design=design,
        a_mm=gripper.design.a_mm,
        b_mm=gripper.design.b_mm,
        tier=request.tier,
        at_nominal=trial(scene, NOMINAL_PA),
        slippery_at_nominal=trial(slippery, NOMINAL_PA),
        least=search(scene),
        slippery_least=search(slippery),
        trials=len(trials),
    )


def result_text(rows: Sequence[GraspRow]) -> str:
    """Return the table: the paper's object and mode, and what this gripper does with it."""
    head = (
        "object",
        "mass [g]",
        "paper",
        "design",
        "mode",
        "at 100 kPa",
        "by",
        "rise [mm]",
        "touch [s]",
        "close [s]",
        "least [kPa]",
        "slippery [kPa]",
    )
    lines = [table(head, [_cells(row) for row in rows])]
    for row in rows:
        for name, found in (("", row.least), (" with friction 0.05", row.slippery_least)):
            if found.gaps_pa:
                missed = ", ".join(f"{1e-3 * pressure:g}" for pressure in found.gaps_pa)
                lines.append(f"{row.object}, {row.design}{name}: held at less, but not at {missed} kPa")
        for trial in (row.at_nominal, row.slippery_at_nominal):
            if trial.note:
                lines.append(f"{row.object}, {row.design}: {trial.note}")
    return "\n".join(lines)


def settings(tier: str, scenes: Sequence[tuple[Scene, FidelityRequest]]) -> dict[str, object]:
    """Return what all rows depend on, as JSON has it."""
    return {
        "nominal_gauge_pa": NOMINAL_PA,
        "slippery_friction": SLIPPERY,
        "resolution_pa": RESOLUTION_PA,
        "held_share_of_lift": HELD_SHARE,
        "hold_s": HOLD_S,
        "tier": tier,
        "scenes": {scene.name: repr((scene, request)) for scene, request in scenes},
        "sources": sources_digest(),
    }


def grasp_values(scene: Scene, request: FidelityRequest, gripper: Gripper, design: str) -> dict[str, object]:
    """Return :func:`study_grasp` as plain values: the fields of the row, and ``held_by``."""
    row = study_grasp(scene, request, gripper, design)
    return {**asdict(row), "held_by": row.held_by}


def grasp_row(values: dict) -> GraspRow:
    """Return the row that :func:`grasp_values` made, also after a stay in a file."""
    values = {name: value for name, value in values.items() if name != "held_by"}
    for name in ("at_nominal", "slippery_at_nominal"):
        values[name] = Trial(**values[name])
    for name in ("least", "slippery_least"):
        values[name] = LeastPressure(**{**values[name], "gaps_pa": tuple(values[name]["gaps_pa"])})
    return GraspRow(**values)


def row_text(values: dict) -> str:
    """Return the line about one row."""
    row = grasp_row(values)
    return f"{row.scene}, {row.design}: least pressure {_kilopascals(row.least)} kPa after {row.trials} grasps"


def _cells(row: GraspRow) -> tuple[str, ...]:
    at = row.at_nominal
    return (
        row.object,
        f"{1e3 * row.mass_kg:.0f}",
        f"held, {row.papers_mode}" if row.scene in PAPER_SCENES else "-",
        row.design,
        at.mode or "refused",
        "held" if at.held else "not held",
        row.held_by,
        f"{1e3 * at.rise_m:.0f}",
        "-" if at.touch_s is None else f"{at.touch_s:.2f}",
        "-" if at.close_s is None else f"{at.close_s:.2f}",
        _kilopascals(row.least),
        _kilopascals(row.slippery_least),
    )


def _kilopascals(found: LeastPressure) -> str:
    return "none" if found.holds_pa is None else f"{1e-3 * found.holds_pa:.1f}" + ("*" if found.gaps_pa else "")
