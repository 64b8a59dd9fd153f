"""Distance of a run from the reference, in the norms that :class:`~mbpam_ros.plant.fidelity.Measured` states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.plant.fidelity import Fidelity, Measured
from mbpam_ros.study.fidelity.cases import FULL_PA, Case
from mbpam_ros.study.fidelity.runs import TICK_S, Record

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """In percent, as in :class:`~mbpam_ros.plant.fidelity.Measured`; no force where there is no object."""

    static_pct: float
    transient_pct: float
    pressure_pct: float
    contact_force_pct: float | None

    def __str__(self) -> str:
        force = "" if self.contact_force_pct is None else f", force {self.contact_force_pct:.2g} %"
        return f"static {self.static_pct:.2g} %, transient {self.transient_pct:.2g} %{force}"


def table_row(scene: str, fidelity: Fidelity, off: Errors, cpu_ms_per_s: float) -> Measured:
    """Return the planner's row of a fidelity in a case, or in a kind of scene."""
    return Measured(
        scene=scene,
        tier=fidelity.tier,
        modes=fidelity.modes,
        step_s=fidelity.sub_step_s,
        pneumatics=str(fidelity.pneumatics),
        static_error_pct=off.static_pct,
        transient_error_pct=off.transient_pct,
        pressure_error_pct=off.pressure_pct,
        cpu_ms_per_s=cpu_ms_per_s,
        contact_force_error_pct=off.contact_force_pct,
        twist_modes=fidelity.twist_modes,
        stretch_modes=fidelity.stretch_modes,
    )


def errors(case: Case, found: Record, reference: Record, active_length_m: float) -> Errors:
    """Return how far a run of a case is off its reference."""
    rest = np.rint(np.array(case.rest_s) / TICK_S).astype(int)
    first, last = (round(instant / TICK_S) for instant in case.moving_s)
    moving = slice(first, last + 1)
    distance = _distance_m(found, reference) / active_length_m
    pressure = np.abs(found.pressure_gauge_pa - reference.pressure_gauge_pa)[moving]
    spec = case.scene.object
    return Errors(
        static_pct=100.0 * float(distance[rest].max()),
        transient_pct=100.0 * float(distance[moving].max()),
        pressure_pct=100.0 * float(pressure.max()) / FULL_PA,
        contact_force_pct=None if spec is None else _force_pct(spec.mass_kg, found, reference, rest),
    )


def _distance_m(found: Record, reference: Record) -> Array:
    """Largest distance of a tip, or of the object's centre, at every instant, shape (n,)."""
    distance = np.linalg.norm(found.tip_m - reference.tip_m, axis=2).max(axis=1)
    if reference.object_m is None or found.object_m is None:
        return distance
    return np.maximum(distance, np.linalg.norm(found.object_m - reference.object_m, axis=1))


def _force_pct(mass_kg: float, found: Record, reference: Record, rest: NDArray[np.int64]) -> float:
    off = np.linalg.norm(found.finger_force_n - reference.finger_force_n, axis=2)[rest].max()
    scale = np.linalg.norm(reference.finger_force_n, axis=2)[rest].max()
    return 100.0 * float(off / max(scale, mass_kg * GRAVITY_M_S2))
