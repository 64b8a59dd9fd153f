"""What an end piece does to the waves next to it: a turn, a length and a shift of the axis, from a short muscle.

Beside a solid end a wave can neither widen nor warp as the unit cell does, and the gas pushes on the end's face. Away
from it by three waves nothing is left of that. So a muscle of a few waves without weight is enough: its middle is the
unit cell's, and what lies between the middle and the tip's face is, in the plane of the bend,

    the arc of the unit cell's free bend and stretch over the waves, then
    a shift ``shift_mm`` against the bend, a turn ``turn_rad`` of the axis with it,
    a straight piece of the end's length and ``length_mm`` more.

The other end is its mirror image. A small force across the tip, in the plane of the bend, tells how the waves next to
the clamped end yield: what the middle turns by beyond

    the end as a beam of solid silicone, and waves with the unit cell's tangent stiffness,

over the moment where they meet is ``compliance_rad_per_n_mm``. By how much the force turns the chord of a wave in the
middle beyond the mean of the sections at its two crests, over the force across it, is ``shear_per_n``, 1 / GA: of the
waves, not of the end. (Both are taken for bending across the plane, too.)

The shift is there because pressure moves the cross of the waves, the middle of which is the axis, toward the inside of
the bend, and that of the solid end not.

Muscle and unit cell have one mesh, so that its error leaves the difference. Lengths in mm, pressures in MPa.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.elastic_rod import solid_end
from mbpam_ros.study.fe.design_run import Run
from mbpam_ros.study.fe.loaded_muscle import MESHES, MuscleModel
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import PATTERNS, CellGeometry
from mbpam_ros.study.fe.muscle_loads import NOTHING
from mbpam_ros.study.fe.section_stiffness import section_stiffness
from mbpam_ros.study.fe.solve import LoadStepError, StepControl
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell
from mbpam_ros.study.fe.whole_muscle import MuscleState, WholeMuscle
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

WAVES = 4
"""Of the short muscle: an even number, so that a crest is in its middle."""

PRESSURES_KPA = (0.0, 30.0, 50.0, 65.0, 80.0, 90.0, 100.0, 120.0)

S_PER_PATTERN = 120.0
"""CPU of one pattern on the mesh ``medium``, a guess."""

_SMALL_N = 0.02
"""At the end of a short muscle of the paper's size and silicone: some 1 N mm at the clamp, a fortieth of what its
weight may be. For others it is similar: with C10 and the square of the radius."""

_CONTROL = StepControl(residual_n=1e-6, first_step=0.5, largest_step=1.0, smallest_step=0.01)


@dataclass(frozen=True)
class EndEffect:
    """What one end adds to the rod of unit cells at a pressure.

    Args:
        turn_rad: of the axis at the end, with the bend.
        length_mm: of the axis.
        shift_mm: by how much the waves' axis lies nearer to the inside of the bend than the end's.
        compliance_rad_per_n_mm: what a moment adds to the turn.
        shear_per_n: 1 / GA of the waves.
    """

    turn_rad: float
    length_mm: float
    shift_mm: float
    compliance_rad_per_n_mm: float
    shear_per_n: float


class ShortMuscle:
    """A weightless muscle of a few waves beside its unit cell.

    Args:
        model: of the muscle; its waves keep their length.
        pattern: ``pdc`` or ``psc``.
        waves: an even number.

    Raises:
        ValueError: the number of waves is odd.
    """

    def __init__(self, model: MuscleModel, pattern: str, waves: int = WAVES) -> None:
        if waves < 2 or waves % 2:
            raise ValueError(f"a short muscle has an even number of waves, 2 or more, found {waves}")
        geometry, mesh = model.geometry, MESHES[model.mesh]
        self._active_mm = waves * geometry.wave_length_mm
        self._end_mm = model.end_length_mm
        rod = Run(geometry, pattern, end_length_mm=model.end_length_mm).muscle_geometry()
        stiffer = model.silicone.c10_mpa / Silicone().c10_mpa
        self._small_n = _SMALL_N * stiffer * (geometry.outer_radius_mm / CellGeometry().outer_radius_mm) ** 2
        self._end_stiffness_n_mm2 = 1e6 * solid_end(2e6 * model.silicone.c10_mpa, rod).stiffness_n_m2
        short = replace(geometry, wave_count=float(waves), active_length_mm=self._active_mm)
        self._muscle = WholeMuscle(short, pattern, mesh, model.silicone, model.ends)
        self._cell = UnitCell(geometry, pattern, mesh, model.silicone)
        points = self._muscle.mesh.points_mm
        z_mm = self._end_mm + 0.5 * self._active_mm + geometry.wave_length_mm * np.array([-1.0, 0.0, 1.0])
        crests = np.stack([np.zeros(3), np.zeros(3), z_mm], axis=1)
        self._nodes = [int(np.linalg.norm(points - crest, axis=1).argmin()) for crest in crests]
        self._planes = [int(np.abs(self._muscle.frames.z_mm - z).argmin()) for z in z_mm]
        self._at: tuple[MuscleState, CellState] = self._muscle.rest(), self._cell.rest()

    def effect(self, pressure_gauge_mpa: float) -> EndEffect:
        """Return the effect at a pressure; the next one costs least if it is the next higher.

        Raises:
            LoadStepError: an equilibrium could not be reached.
        """
        muscle, cell = self._at
        muscle = self._muscle.moved(muscle, self._muscle.inflated_loads(pressure_gauge_mpa, NOTHING), control=_CONTROL)
        cell = self._cell.free_bend(pressure_gauge_mpa, cell)
        self._at = muscle, cell
        begin_rad = self._middle_angle_rad(muscle)
        bend_rad = 0.5 * self._active_mm * cell.angle_rad / self._cell.mesh.length_mm
        end_rad = begin_rad + bend_rad
        arc = 0.5 * self._active_mm * cell.axis_stretch * np.sinc(0.5 * bend_rad / math.pi)
        along, _ = _directions(begin_rad + 0.5 * bend_rad)
        _, across = _directions(end_rad)
        outward, _ = _directions(muscle.tip_angle_rad)
        way = (muscle.tip.position_mm - muscle.positions_mm[self._nodes[1]])[[0, 2]]
        left = way - arc * along - self._end_mm * outward
        length_mm, shift_mm = np.linalg.solve(np.stack([outward, -across], axis=1), left)
        turn_rad = muscle.tip_angle_rad - end_rad
        return EndEffect(turn_rad, float(length_mm), float(shift_mm), *self._compliances(muscle, cell))

    def _compliances(self, free: MuscleState, cell: CellState) -> tuple[float, float]:
        """Of the clamped end's waves, and in shear, under a force across the free tip, with the bend."""
        _, across = _directions(free.tip_angle_rad)
        force = self._small_n * np.array([across[0], 0.0, across[1]])
        pushed = self._muscle.moved(free, replace(free.loads, tip_force_n=tuple(force.tolist())), control=_CONTROL)
        turned_rad = self._middle_angle_rad(pushed) - self._middle_angle_rad(free)
        middle_mm = self._end_mm + 0.5 * self._active_mm
        z = np.array([0.0, 0.5 * self._end_mm, self._end_mm, 0.5 * (self._end_mm + middle_mm), middle_mm])
        places = self._muscle.frames.centres_mm(free.positions_mm)
        lever = free.tip.position_mm - np.stack(
            [np.interp(z, self._muscle.frames.z_mm, places[:, axis]) for axis in range(3)], axis=1
        )
        moments = lever[:, 2] * -force[0] + lever[:, 0] * force[2]  # about the axis that bends toward -x
        begin, half, joint, quarter, middle = moments.tolist()
        ends = self._end_mm / self._end_stiffness_n_mm2 * (begin + 4.0 * half + joint) / 6.0
        waves = 0.5 * self._active_mm / section_stiffness(self._cell, cell).bend_n_mm2
        compliance = (turned_rad - ends - waves * (joint + 4.0 * quarter + middle) / 6.0) / joint
        before_rad, after_rad = self._aslant_rad(free), self._aslant_rad(pushed)
        chords_rad = self._angles_rad(free).repeat(2)[1:-1].reshape(2, 2).mean(axis=1)
        crosswise = [float(force[[0, 2]] @ _directions(angle)[1]) for angle in chords_rad]
        return float(compliance), float(np.mean((after_rad - before_rad) / crosswise))

    def _aslant_rad(self, state: MuscleState) -> NDArray[np.float64]:
        """Turn of the chords of the two waves in the middle beyond the mean of their crests, shape (2,)."""
        angles = self._angles_rad(state)
        chords = np.diff(state.positions_mm[self._nodes], axis=0)
        return np.arctan2(-chords[:, 0], chords[:, 2]) - 0.5 * (angles[1:] + angles[:-1])

    def _angles_rad(self, state: MuscleState) -> NDArray[np.float64]:
        normals = self._muscle.frames.rotations(state.positions_mm)[self._planes, :, 2]
        return np.arctan2(-normals[:, 0], normals[:, 2])

    def _middle_angle_rad(self, state: MuscleState) -> float:
        return float(self._angles_rad(state)[1])


def _directions(angle_rad: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Along an axis turned toward -x, and across it toward the inside of the bend; in x and z."""
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    return np.array([-sine, cosine]), np.array([-cosine, -sine])


def end_rows(model: MuscleModel, pattern: str, waves: int, pressures_kpa: Sequence[float]) -> dict[str, object]:
    """Return a pattern's effects at rising pressures as columns.

    Raises:
        LoadStepError: an equilibrium could not be reached.
    """
    muscle = ShortMuscle(model, pattern, waves)
    effects = [muscle.effect(1e-3 * pressure) for pressure in pressures_kpa]
    return {
        "pattern": pattern,
        "p_kpa": list(pressures_kpa),
        "turn_deg": [round(math.degrees(effect.turn_rad), 5) for effect in effects],
        "length_mm": [round(effect.length_mm, 5) for effect in effects],
        "shift_mm": [round(effect.shift_mm, 5) for effect in effects],
        "compliance_rad_per_n_mm": [round(effect.compliance_rad_per_n_mm, 8) for effect in effects],
        "shear_per_n": [round(effect.shear_per_n, 6) for effect in effects],
    }


def end_effect_table(
    model: MuscleModel,
    path: Path,
    executor: Executor,
    progress: Progress,
    pressures_kpa: Sequence[float] | None = None,
) -> dict:
    """Return the effect of an end over pressure for PDC and PSC.

    ``path`` is kept up to date; a pattern that it holds from the same settings is not run again.

    Args:
        model: of the muscle.
        path: of the file.
        executor, progress: as for :func:`~mbpam_ros.study.jobs.run_jobs`.
        pressures_kpa: rising from 0; by default :data:`PRESSURES_KPA`.

    Raises:
        ResultFileError: ``path`` is no file of this command.
    """
    settings = {**model.settings(), "waves_of_short_muscle": WAVES}
    results = ResultFile(path, settings, "ends", lambda row: row["pattern"])
    if pressures_kpa is not None:
        settings["pressures_kpa"] = list(pressures_kpa)
    jobs = {pattern: (model, pattern, WAVES, tuple(pressures_kpa or PRESSURES_KPA)) for pattern in PATTERNS}
    failures = run_jobs(
        jobs,
        end_rows,
        results,
        executor,
        progress,
        _text,
        failing=(LoadStepError,),
        s_per_job=S_PER_PATTERN,
    )
    return results.write(list(jobs), failures=failures)


def _text(row: dict) -> str:
    return f"{row['pattern']}: turn {row['turn_deg']} deg, length {row['length_mm']}, shift {row['shift_mm']} mm"
