"""Run a case at one fidelity: what was seen at every tick, and the CPU time of the plant's steps.

The valves' commands come from a proportional law, 100 times a second, and are held between; the reference takes many
calls of the plant within each hold, so that its pressures do not run straight from tick to tick.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.study.fidelity.cases import Case

Array = NDArray[np.float64]

TICK_S = 0.01
_FULL_OPENING_PA = 2e4
"""Pressure error from which on a valve is fully open."""

REFERENCE = Fidelity("rod", 6, 1e-4, "iso6358")
_REFERENCE_CALLS_PER_TICK, _REFERENCE_STRAIN_MODES = 20, 4


@dataclass(frozen=True)
class Record:
    """What was seen at the start and after every tick, n instants.

    Args:
        time_s: shape (n,).
        tip_m: of the fingers in ``gripper_base``, shape (n, 4, 3).
        pressure_gauge_pa: shape (n, 16).
        finger_force_n: on the object, shape (n, 4, 3).
        object_m: centre of the object in ``gripper_base``, shape (n, 3); none without one.
        cpu_ms_per_s: process time of the plant's steps for one simulated second.
    """

    time_s: Array
    tip_m: Array
    pressure_gauge_pa: Array
    finger_force_n: Array
    object_m: Array | None
    cpu_ms_per_s: float


def proportional_spool(wanted_gauge_pa: Array, pressure_gauge_pa: Array) -> Array:
    """Return the valves' commands (16,) toward wanted pressures (16,)."""
    return np.clip((wanted_gauge_pa - pressure_gauge_pa) / _FULL_OPENING_PA, -1.0, 1.0)


def run(case: Case, fidelity: Fidelity, gripper: Gripper, calls_per_tick: int = 1) -> Record:
    """Run a case.

    Args:
        calls_per_tick: calls of the plant within each hold of the valves' commands.

    Raises:
        TierError: the tier cannot compute what the scene holds.
        PlantDivergedError: the step is too large for this tier here.
    """
    plant = build_plant(case.scene, fidelity, gripper)
    seen, cpu_s = [plant.observe()], 0.0
    for tick in range(round(case.duration_s / TICK_S)):
        if case.lift_s is not None and tick == round(case.lift_s / TICK_S):
            plant.lift()
        spool = proportional_spool(case.wanted_gauge_pa(tick * TICK_S), seen[-1].pressure_gauge_pa)
        begun_s = time.process_time()
        for _ in range(calls_per_tick):
            plant.step(spool, TICK_S / calls_per_tick)
        cpu_s += time.process_time() - begun_s
        seen.append(plant.observe())
    objects_m = [each.object_in_gripper.position_m for each in seen if each.object_in_gripper is not None]
    return Record(
        time_s=np.array([each.time_s for each in seen]),
        tip_m=np.stack([each.centreline_m[:, -1] for each in seen]),
        pressure_gauge_pa=np.stack([each.pressure_gauge_pa for each in seen]),
        finger_force_n=np.stack([each.finger_force_n for each in seen]),
        object_m=np.stack(objects_m) if objects_m else None,
        cpu_ms_per_s=1e3 * cpu_s / case.duration_s,
    )


def run_reference(case: Case, strains: Sequence[str], gripper: Gripper) -> Record:
    """Run the converged reference of a case, of muscles with these strains."""
    return run(case, _reference(strains, fewer=0), gripper, _REFERENCE_CALLS_PER_TICK)


def run_coarser_reference(case: Case, strains: Sequence[str], gripper: Gripper) -> Record:
    """Run a case with one mode less and steps twice as long; the change says how far the reference is converged."""
    return run(case, _reference(strains, fewer=1), gripper, _REFERENCE_CALLS_PER_TICK // 2)


def _reference(strains: Sequence[str], fewer: int) -> Fidelity:
    return dataclasses.replace(
        REFERENCE,
        modes=REFERENCE.modes - fewer,
        sub_step_s=(1.0 + fewer) * REFERENCE.sub_step_s,
        twist_modes=_REFERENCE_STRAIN_MODES - fewer if "twist" in strains else 0,
        stretch_modes=_REFERENCE_STRAIN_MODES - fewer if "stretch" in strains else 0,
    )
