"""How each variable acts alone on the drawn muscle: finite elements at levels of it, all else as drawn.

The paper leaves c and n out of its optimisation because the response is monotone in them. A Latin hypercube of a few
samples hardly shows that, for there everything else varies as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.study.fe.effects import trend
from mbpam_ros.study.muscle.samples import FeSample, MeshedDrawing, ranges_of
from mbpam_ros.terminal import Progress

LEVELS = 5
TOLD = ("theta_max_deg", "f_max_n", "stretch_99", "stretch_max", "stress_99_mpa", "stress_max_mpa")


def levels_of(drawing: MuscleDrawing, name: str) -> list[FeSample]:
    """Return the drawing with levels of one variable, rising over its range; n is whole."""
    drawn = FeSample("", drawing.a_mm, drawing.b_mm, drawing.c_mm, drawing.wave_count)
    field = "wave_count" if name == "n" else name
    designs = []
    for value in np.linspace(*ranges_of(drawing)[name], LEVELS).tolist():
        level = float(round(value)) if name == "n" else round(value, 4)
        designs.append(replace(drawn, name=f"{name} {level:g}", **{field: level}))
    return designs


def one_at_a_time(
    meshed: MeshedDrawing, names: Sequence[str], path: Path, executor: Executor, progress: Progress
) -> dict[str, Any]:
    """Return the levels of each variable with what the finite elements say (PDC), and how each response goes with it.

    Keys: ``rows``, ``failures``, and ``trends``: by variable and response "rises", "falls", or where it turns. Levels
    without an equilibrium are left out of a trend.

    Raises:
        ResultFileError: ``path`` cannot be written, or holds something else.
    """
    designs = {name: levels_of(meshed.drawing, name) for name in names}
    every = [design for levels in designs.values() for design in levels]
    rows, failures = meshed.rows(every, ("pdc",), path, executor, progress)
    found = {row["name"]: row for row in rows}
    trends = {}
    for name, levels in designs.items():
        of = [found[key] for key in (f"{design.name} pdc" for design in levels) if key in found]
        if len(of) > 1:
            trends[name] = {what: trend([row[what] for row in of]) for what in TOLD}
    return {"rows": rows, "failures": failures, "trends": trends}
