"""Blocked force of a design with its tip on a plate: large deflection, friction, stretching axis.

The rod of :mod:`~mbpam_ros.actuator.blocked_rod` with the law of the design's own unit cell at each pressure, the line
through its straight and its free state; weight of the waved part, ends without.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbpam_ros.actuator.blocked_rod import FRICTION_COEFFICIENT, RodLoad, blocked_path
from mbpam_ros.actuator.planar_rod import AxisStretch
from mbpam_ros.study.fe.design_run import Run

PRESSURES_KPA = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0)
"""The way to 100 kPa, on which depends whether the tip slides or sticks."""


def rod_loads(run: Run, pressures_kpa: Sequence[float] = PRESSURES_KPA) -> list[RodLoad]:
    """Return M0 [N m], B [N m2] and stretch of a design at rising pressures.

    Raises:
        LoadStepError: the finite elements found no equilibrium.
    """
    cell = run.cell()
    free, straight, loads = cell.rest(), cell.rest(), []
    for pressure_kpa in pressures_kpa:
        pressure_mpa = 1e-3 * pressure_kpa
        free, straight = cell.free_bend(pressure_mpa, free), cell.held_bend(pressure_mpa, 0.0, straight)
        curvature_per_m = free.angle_rad * cell.angle_per_muscle / (1e-3 * run.geometry.active_length_mm)
        moment_n_m = -1e-3 * straight.moment_n_mm
        slope_m = (free.axis_stretch - straight.axis_stretch) / curvature_per_m
        loads.append(RodLoad(moment_n_m, moment_n_m / curvature_per_m, AxisStretch(straight.axis_stretch, slope_m)))
    return loads


def blocked_force_n(run: Run, friction_coefficient: float = FRICTION_COEFFICIENT) -> float:
    """Return the force [N] on the plate at 100 kPa.

    Raises:
        LoadStepError, RodSolutionError: no equilibrium was found.
    """
    return blocked_path(rod_loads(run), run.muscle_geometry(), friction_coefficient)[-1].push_n
