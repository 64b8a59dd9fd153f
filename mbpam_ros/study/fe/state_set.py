"""The validation set: states of the whole muscle in finite elements that the rod is set beside.

Ways of one pattern and gravity each, pressures rising; at a pressure the free state and loads on the tip from it. Loads
are given in the frame of the bend: ahead, where the pattern bends to, and aside, a quarter turn from it about z; and
along the free tip's direction.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.elastic_rod import HANGING
from mbpam_ros.study.fe.loaded_muscle import S_PER_STATE, LoadedMuscle, MuscleModel
from mbpam_ros.study.fe.muscle_loads import LEVEL, NOTHING, UPRIGHT, Vector
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.muscle_states import MuscleState
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress

LEVEL_ASIDE: Vector = (0.0, LEVEL[0], 0.0)

_AHEAD_DEG = {"pdc": 180.0, "psc": 225.0, "half": 240.0}
_FORCE_DIGITS = 5
_PATH_PER_STATE = 2.0  # cost of a way over that of one state from rest


@dataclass(frozen=True)
class TipLoad:
    """A load on the tip.

    Args:
        ahead_n, aside_n: force across z, where the pattern bends to and a quarter turn about z from it.
        along_n: force along the direction that the tip has without load.
        torque_n_mm: about the tip's direction.
    """

    ahead_n: float = 0.0
    aside_n: float = 0.0
    along_n: float = 0.0
    torque_n_mm: float = 0.0

    def on(self, free: MuscleState, direction: NDArray[np.float64]) -> MuscleState:
        """Return the state under this load.

        Args:
            free: the state without it.
            direction: of its tip, shape (3,).
        """
        angle = math.radians(_AHEAD_DEG[free.pattern])
        ahead, aside = (np.array([math.cos(turn), math.sin(turn), 0.0]) for turn in (angle, angle + 0.5 * math.pi))
        force = self.ahead_n * ahead + self.aside_n * aside + self.along_n * direction
        x, y, z = (force.round(_FORCE_DIGITS) + 0.0).tolist()
        return replace(free, tip_force_n=(x, y, z), tip_torque_n_mm=self.torque_n_mm)


@dataclass(frozen=True)
class LoadPath:
    """A way through states of one pattern and gravity.

    Args:
        pattern: of the pressures.
        gravity_m_s2: on all of it.
        stations: pressures [kPa], rising, with the loads at each; the state without load is always there.
    """

    pattern: str
    gravity_m_s2: Vector
    stations: dict[float, tuple[TipLoad, ...]]


_SIDEWAYS, _IN_PLANE, _TORQUE = TipLoad(aside_n=0.05), TipLoad(ahead_n=-0.05), TipLoad(torque_n_mm=5.0)
_EACH = (_SIDEWAYS, _IN_PLANE, TipLoad(along_n=0.05), _TORQUE)
_ALL = (
    *_EACH,
    TipLoad(ahead_n=0.05),
    TipLoad(aside_n=0.02),
    TipLoad(aside_n=0.1),
    TipLoad(along_n=-0.05),
    TipLoad(ahead_n=-0.1),
    TipLoad(torque_n_mm=2.0),
)
_THREE = (_SIDEWAYS, _IN_PLANE, _TORQUE)

PATHS = {
    "pdc hanging": LoadPath("pdc", HANGING, {50.0: (), 80.0: (), 100.0: _ALL}),
    "psc hanging": LoadPath("psc", HANGING, {50.0: (), 80.0: (), 100.0: _EACH}),
    "pdc level": LoadPath("pdc", LEVEL, {50.0: (), 80.0: (), 100.0: _THREE}),
    "pdc upright": LoadPath("pdc", UPRIGHT, {50.0: (), 80.0: (), 100.0: _THREE}),
    "straight": LoadPath("pdc", HANGING, {0.0: (*_EACH, TipLoad(along_n=-0.1), TipLoad(torque_n_mm=1.0))}),
    "pdc hanging, lower pressures": LoadPath("pdc", HANGING, {50.0: _EACH, 80.0: _EACH}),
    "half hanging": LoadPath("half", HANGING, {50.0: (), 80.0: (), 100.0: _EACH}),
    "pdc level aside": LoadPath("pdc", LEVEL_ASIDE, {80.0: (), 100.0: (TipLoad(aside_n=-0.05),)}),
    "psc level aside": LoadPath("psc", LEVEL_ASIDE, {80.0: (), 100.0: (_SIDEWAYS, _TORQUE)}),
    "psc upright": LoadPath("psc", UPRIGHT, {80.0: (_SIDEWAYS,), 100.0: (_TORQUE,)}),
    "half level": LoadPath("half", LEVEL, {80.0: (_SIDEWAYS,), 100.0: (_TORQUE,)}),
    "pdc weightless": LoadPath("pdc", NOTHING, {50.0: (), 80.0: (), 100.0: (_SIDEWAYS,)}),
    "psc weightless": LoadPath("psc", NOTHING, {50.0: (), 80.0: (), 100.0: (_SIDEWAYS,)}),
    "half weightless": LoadPath("half", NOTHING, {50.0: (), 100.0: (_SIDEWAYS,)}),
}
"""The set, the most telling ways first."""


def path_states(name: str, model: MuscleModel, path: LoadPath) -> dict[str, Any]:
    """Return the rows of a way's states, and the reasons of those that were not reached.

    Raises:
        LoadStepError: none was reached.
    """
    muscle, rows, failures = LoadedMuscle(model), [], {}
    for pressure_kpa, loads in path.stations.items():
        free = MuscleState(path.pattern, pressure_kpa, gravity_m_s2=path.gravity_m_s2)
        try:
            rows.append(muscle.row(free))
        except LoadStepError as error:
            if not rows:
                raise
            failures[f"{pressure_kpa:g} kPa"] = str(error)
            break
        direction = np.array(rows[-1]["tip_direction"])
        for load in loads:
            wanted = load.on(free, direction)
            try:
                rows.append(muscle.row(wanted))
            except LoadStepError as error:
                failures[f"{pressure_kpa:g} kPa, {load}"] = str(error)
    return {
        "path": name,
        "unknowns": muscle.unknown_count,
        "mass_kg": muscle.mass_kg,
        "states": rows,
        "not_reached": failures,
    }


def state_set(
    model: MuscleModel, path: Path, executor: Executor, progress: Progress, paths: dict[str, LoadPath] | None = None
) -> dict[str, Any]:
    """Run all ways and return ``states``, flat, with the settings they were made with.

    ``path`` holds the same. The finished ways are kept in a file beside it, from which the next call goes on; an
    interrupted call leaves the states of those in ``path``, too.

    Args:
        paths: by name; default :data:`PATHS`. Others that the file beside it holds are kept.

    Raises:
        ResultFileError: the file beside it is none of this command.
    """
    paths = PATHS if paths is None else paths
    results = ResultFile(path.with_name(f"{path.stem}_paths.json"), model.settings(), "paths", lambda row: row["path"])
    wanted = {name: (name, model, each) for name, each in paths.items()}
    jobs = {**{name: () for name in results.rows if name not in wanted}, **wanted}
    failures: dict[str, str] = {}
    try:
        failures = run_jobs(
            jobs,
            path_states,
            results,
            executor,
            progress,
            _text,
            failing=(LoadStepError,),
            s_per_job=_PATH_PER_STATE * S_PER_STATE[model.mesh],
        )
    finally:
        rows = [results.rows[name] for name in jobs if name in results.rows]
        for row in rows:
            failures |= {f"{row['path']}, {state}": reason for state, reason in row["not_reached"].items()}
        content = {
            "settings": model.settings(),
            **({key: rows[0][key] for key in ("unknowns", "mass_kg")} if rows else {}),
            "not_reached": failures,
            "states": [{"path": row["path"], **state} for row in rows for state in row["states"]],
        }
        write_json(path, content)
    return {**content, "failures": failures}


def _text(row: dict[str, Any]) -> str:
    seconds = sum(state["cpu_s"] for state in row["states"])
    return f"{row['path']}: {len(row['states'])} states, {seconds:.0f} s; not reached: {len(row['not_reached'])}"
