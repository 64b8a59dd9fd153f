"""Unit cells with unequal chamber pressures.

What the run-time blend (:mod:`~mbpam_ros.actuator.rod_law`) is measured against: for several ratios of the four
pressures, the moment M0 that holds the section straight and the free bend of the active length, both as vectors in the
muscle frame. A mirror plane of the pressures halves the model; without one the whole section is meshed and its end
plane turns both ways. Sets whose opposite chambers are equal do not bend; of these the stiffness at the straight state
is given, bending along the diagonals at azimuth 45 and 135 deg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.fe.design_run import NO_EQUILIBRIUM, Run, settings
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress

PRESSURES_KPA = (60.0, 80.0, 100.0)
SHARES = (
    (1.0, 0.0, 0.0, 0.0),
    (1.0, 0.0, 0.0, 1.0),
    (1.0, 0.0, 0.5, 0.0),
    (1.0, 0.0, 0.25, 0.0),
    (1.0, 0.0, 0.75, 0.0),
    (1.0, 0.5, 0.0, 0.5),
    (1.0, 1.0, 0.0, 1.0),
    (1.0, 0.5, 0.5, 0.5),
    (1.0, 0.5, 0.5, 1.0),
    (1.0, 0.5, 0.0, 0.0),
    (1.0, 0.75, 0.0, 0.0),
    (1.0, 0.5, 0.25, 0.0),
    (1.0, 0.0, 1.0, 0.0),
    (1.0, 1.0, 1.0, 1.0),
)
"""Pressures of chambers 1 to 4 over the largest one."""

_SMALL_ANGLE_RAD = 1e-3
S_PER_SET = 10.0


@dataclass(frozen=True)
class Section:
    """Which part of the section stands for the whole one, and how its frame lies in the muscle's.

    Args:
        pattern: of the unit cell.
        chambers: those in the mesh.
        azimuth_rad: of the cell's x axis in the muscle frame.
    """

    pattern: str
    chambers: tuple[int, ...]
    azimuth_rad: float

    def in_muscle_frame(self, vector: Sequence[float] | NDArray[np.float64], turn_rad: float) -> NDArray[np.float64]:
        """Return a vector (2,) of the cell's frame in the muscle's, the section being turned by ``turn_rad``."""
        angle = self.azimuth_rad - turn_rad
        cosine, sine = math.cos(angle), math.sin(angle)
        return np.array([[cosine, -sine], [sine, cosine]]) @ vector


def section_for(shares: Sequence[float]) -> Section:
    """Return the smallest section that has the symmetry of four chamber pressures."""
    first, second, third, fourth = shares
    if first == fourth and second == third:
        return Section("pdc", (1, 2), 0.0)
    if second == fourth:
        return Section("psc", (1, 2, 3), 0.25 * math.pi)
    return Section("full", (1, 2, 3, 4), 0.0)


def bend_vector_rad(state: CellState) -> NDArray[np.float64]:
    """Return the cell's bend (2,) in its own frame: size and direction of the end plane's tilt."""
    phi, psi = state.angle_rad, state.side_angle_rad
    toward = -np.array([math.sin(phi) * math.cos(psi), math.sin(psi)])
    tilt = math.atan2(np.hypot(*toward), math.cos(phi) * math.cos(psi))
    return toward / np.sinc(tilt / math.pi)


def unequal_rows(run: Run, shares: Sequence[float]) -> list[dict[str, object]]:
    """Return one row per pressure of ``PRESSURES_KPA``; ``run.pattern`` is not used.

    Raises:
        LoadStepError: an equilibrium could not be reached.
    """
    section = section_for(shares)
    cell = _cell(run, section.pattern, {chamber: shares[chamber - 1] for chamber in section.chambers})
    balanced = shares[0] == shares[2] and shares[1] == shares[3]
    # Bending along azimuth 135 deg is bending along 45 deg with the pressures turned by a quarter.
    planes = [_cell(run, "psc", {1: a, 2: b, 3: a}) for a, b in (shares[:2], shares[1::-1])] if balanced else []
    free, straight, bent = cell.rest(), cell.rest(), [plane.rest() for plane in planes]
    rows = []
    for pressure_kpa in PRESSURES_KPA:
        pressure_mpa = 1e-3 * pressure_kpa
        straight = cell.held_bend(pressure_mpa, 0.0, straight)
        turn = cell.section_turn_rad(straight.unknowns)
        moment = section.in_muscle_frame([straight.moment_n_mm, straight.side_moment_n_mm], turn)
        row = {"shares": list(shares), "p_kpa": pressure_kpa, "section": section.pattern}
        row["straight_moment_n_mm"] = moment.tolist()
        if balanced:
            bent = [
                plane.held_bend(pressure_mpa, _SMALL_ANGLE_RAD, state)
                for plane, state in zip(planes, bent, strict=True)
            ]
            length_mm = run.geometry.active_length_mm
            row["straight_stiffness_n_mm2"] = [
                state.moment_n_mm / (_SMALL_ANGLE_RAD * cell.angle_per_muscle) * length_mm for state in bent
            ]
        else:
            free = cell.free_bend(pressure_mpa, free)
            bend = cell.angle_per_muscle * bend_vector_rad(free)
            turn = cell.section_turn_rad(free.unknowns)
            row["free_bend_deg"] = np.degrees(section.in_muscle_frame(bend, turn)).tolist()
        row["axis_stretch_straight"] = straight.axis_stretch
        rows.append(row)
    return rows


def _cell(run: Run, pattern: str, shares: dict[int, float]) -> UnitCell:
    return UnitCell(run.geometry, pattern, run.resolution, run.silicone, shares=shares, self_contact=run.self_contact)


def unequal_set(run: Run, shares: Sequence[float]) -> dict[str, object]:
    """Return :func:`unequal_rows` of one set of pressures, with the set."""
    return {"shares": list(shares), "rows": unequal_rows(run, shares)}


def unequal_table(run: Run, path: Path, executor: Executor, progress: Progress) -> dict:
    """Run all sets of :data:`SHARES` and return their rows.

    The finished sets are kept in a file beside ``path``, from which the next call goes on.

    Args:
        run: the design; its pattern is not used.

    Raises:
        ResultFileError: that is no file of this command.
    """
    wanted = {**settings(run), "design": {"a_mm": run.geometry.a_mm, "b_mm": run.geometry.b_mm}}
    results = ResultFile(path.with_name(f"{path.stem}_sets.json"), wanted, "sets", lambda row: _name(row["shares"]))
    jobs = {_name(shares): (run, shares) for shares in SHARES}
    failures = run_jobs(
        jobs,
        unequal_set,
        results,
        executor,
        progress,
        lambda row: f"{_name(row['shares'])}: {row['rows'][-1]}",
        failing=NO_EQUILIBRIUM,
        s_per_job=S_PER_SET,
    )
    rows = [row for name in jobs if name in results.rows for row in results.rows[name]["rows"]]
    write_json(path, {"settings": wanted, "rows": rows})
    return {"rows": rows, "failures": failures}


def _name(shares: Sequence[float]) -> str:
    return ", ".join(f"{share:g}" for share in shares)
