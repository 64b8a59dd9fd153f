"""A scene measured by itself: what its fidelities are off by in its own grasp, for a plan that promises nearer.

The scene is closed upon in the mode that suits its object, at a pressure, and lifted; without an object all muscles
bend outward. A rod of five modes at a quarter of a millisecond stands for the reference. Errors in contact fall with
the step (of first order), so that it is itself off by about what twice its step changes: that is added to
:data:`SAFETY` times what a fidelity was off by. Costs are the table's where it has them.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Sequence

from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityTable, Measured
from mbpam_ros.plant.planner import kinds_of
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.calibration import with_strains_of
from mbpam_ros.study.fidelity.cases import Case, grasp_case, grasp_mode, opening_case
from mbpam_ros.study.fidelity.errors import Errors, errors, table_row
from mbpam_ros.study.fidelity.runs import Record, run
from mbpam_ros.study.fidelity.trade import can_run, fidelities

BUDGET_S = 15.0
"""Process time after which no further fidelity is begun."""

SAFETY = 1.5
_NEAR = Fidelity("rod", 5, 0.00025, "iso6358")
_CALLS_PER_TICK = 4


def own_case(scene: Scene, pressure_gauge_pa: float) -> Case:
    """Return what is run to measure a scene.

    Raises:
        ConfigError: the modes cannot be read.
    """
    if scene.object is None:
        return dataclasses.replace(opening_case(pressure_gauge_pa), scene=scene)
    return grasp_case(scene.name, scene, grasp_mode(scene.object), pressure_gauge_pa)


def measured_table(
    scene: Scene,
    contact: bool,
    table: FidelityTable,
    pressure_gauge_pa: float,
    strains: Sequence[tuple[str, ...]],
    gripper: Gripper,
) -> FidelityTable:
    """Return the table with what was measured of a scene in place of what is promised of its kind.

    Fidelities are run from the cheapest on, as far as :data:`BUDGET_S` goes; the rest is left out.

    Args:
        contact: whether anything touches.
        strains: sets of them that may be chosen.

    Raises:
        ConfigError: the scene is of no single kind, or the modes cannot be read.
        PlantDivergedError: the stand-in for the reference does.
    """
    kinds = kinds_of(scene, contact)
    if len(kinds) != 1:
        raise ConfigError(f"scene {scene.name}: nothing to grasp, but a table in reach: there is no case to measure")
    (kind,) = kinds
    begun_s = time.process_time()
    case = own_case(scene, pressure_gauge_pa)
    grid = fidelities(pneumatics=("iso6358", "lag"))
    rows: list[Measured] = []
    for own in strains:
        near = with_strains_of([_NEAR], own)[0]
        reference = run(case, near, gripper, _CALLS_PER_TICK)
        coarser = run(case, dataclasses.replace(near, sub_step_s=2.0 * near.sub_step_s), gripper, _CALLS_PER_TICK // 2)
        known = errors(case, coarser, reference, gripper.geometry.active_length_m)
        for each in _cheapest_first(with_strains_of(grid, own), case):
            if time.process_time() - begun_s > BUDGET_S * (1 + strains.index(own)) / len(strains):
                break
            rows += _row(kind, case, each, reference, known, gripper)
    costs = {row.fidelity: row.cpu_ms_per_s for row in table.promises if row.scene == kind}
    rows = [dataclasses.replace(row, cpu_ms_per_s=costs.get(row.fidelity, row.cpu_ms_per_s)) for row in rows]
    return dataclasses.replace(
        table, rows=(), reference={}, promises=tuple(rows), ranges={}, calibration={"measured_scenes": 1.0}
    )


def _cheapest_first(grid: Iterable[Fidelity], case: Case) -> list[Fidelity]:
    return sorted((each for each in grid if can_run(case, each)), key=lambda each: (-each.sub_step_s, each.modes))


def _row(kind: str, case: Case, each: Fidelity, reference: Record, known: Errors, gripper: Gripper) -> list[Measured]:
    """Return the row of a fidelity; none where it diverges."""
    try:
        found = run(case, each, gripper)
    except PlantDivergedError:
        return []
    off = errors(case, found, reference, gripper.geometry.active_length_m)

    def bound(measured_pct: float | None, known_pct: float | None) -> float | None:
        if measured_pct is None:
            return None
        return SAFETY * measured_pct + (known_pct or 0.0)

    bounds = Errors(
        bound(off.static_pct, known.static_pct) or 0.0,
        bound(off.transient_pct, known.transient_pct) or 0.0,
        off.pressure_pct,
        bound(off.contact_force_pct, known.contact_force_pct),
    )
    return [table_row(kind, each, bounds, found.cpu_ms_per_s)]
