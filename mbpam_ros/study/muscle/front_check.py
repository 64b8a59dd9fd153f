"""What the front of a metamodel is worth: finite elements of designs on it, and what these offer over the drawing.

A metamodel's gains are its own. So a few designs are taken from its front, from the drawing's angle to the drawing's
force and a little beyond, and run; between them their angles and forces are joined by straight lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mbpam_ros.actuator.drawing import PAPER, MuscleDrawing, load_drawing
from mbpam_ros.study.design.improvement import Reference, gains, reference_design
from mbpam_ros.study.design.optimise_design import GRID
from mbpam_ros.study.design.pareto import Front, grid_front
from mbpam_ros.study.design.responses import published_responses
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.fe.paper_comparison import error_summary, paper_points
from mbpam_ros.study.muscle.samples import FeSample, MeshedDrawing
from mbpam_ros.terminal import Progress

DESIGNS = 5
_BEYOND = 0.15
"""Of the range of angles, on either side: the metamodel may be off."""
_TOLD = 101
"""Designs of the paper's front, of the thousands that a grid has."""


def front_designs(front: dict[str, Any], drawing: MuscleDrawing, count: int = DESIGNS) -> list[FeSample]:
    """Return designs along a front between the angle and the force of the reference.

    Args:
        front: of :func:`~mbpam_ros.study.muscle.build.front_of`; its ``initial`` is the reference.
        drawing: of the muscle.
        count: of the designs.
    """
    pareto = np.array(front["pareto"])
    pareto = pareto[np.argsort(pareto[:, 2])]
    whole, reference = Front(pareto[:, :2], pareto[:, 2:]), front["initial"]
    low, high = float(pareto[0, 2]), float(pareto[-1, 2])
    begin = min(max(reference["theta_deg"], low), high)
    reached = whole.first_at_second(reference["f_n"])
    end = high if reached is None else reached
    margin = _BEYOND * abs(end - begin)
    angles = np.linspace(max(min(begin, end) - margin, low), min(max(begin, end) + margin, high), count)
    designs = []
    for angle in angles:
        a_mm, b_mm = (round(float(np.interp(angle, pareto[:, 2], pareto[:, column])), 4) for column in (0, 1))
        name = f"front {a_mm:g}, {b_mm:g}, {drawing.c_mm:g}, {drawing.wave_count:g}"
        designs.append(FeSample(name, a_mm, b_mm, drawing.c_mm, drawing.wave_count))
    return designs


def check_front(
    meshed: MeshedDrawing, front: dict[str, Any], path: Path, executor: Executor, progress: Progress
) -> dict[str, Any]:
    """Return designs of a front with the finite elements' angle and force, and these designs' gains over the reference.

    Keys: ``designs`` (rows of the finite elements), ``failures``, ``gain_force_at_equal_angle_pct``,
    ``gain_angle_at_equal_force_pct``; a gain is None where the designs do not reach it.

    Raises:
        ResultFileError: ``path`` cannot be written, or holds something else.
    """
    rows, failures = meshed.rows(front_designs(front, meshed.drawing), ("pdc",), path, executor, progress)
    offered: dict[str, float | None] = {}
    if len(rows) > 1:
        design, values = _columns(rows)
        offered = asdict(gains(Front.of(design, values), Reference(**front["initial"])))
    return {"designs": rows, "failures": failures, **offered}


def beside_the_paper(drawing: MuscleDrawing, rows: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return errors against the paper's finite elements, its front, and its optima by these; None for another muscle.

    Keys: ``errors`` (:func:`~mbpam_ros.study.fe.paper_comparison.error_summary`), ``front`` (rows a_mm, b_mm,
    theta_deg, f_n of the paper's Eqs. 9 and 10), its gains over the initial design as it prints it, and ``optima`` (its
    Table 5 with these finite elements' values and what they gain over the drawing's).

    Args:
        drawing: of the muscle.
        rows: of finite elements.
    """
    if drawing != load_drawing(PAPER):
        return None
    found = {(row["a_mm"], row["b_mm"]): row for row in rows if row["pattern"] == "pdc"}
    points = [each for each in paper_points() if each.pattern == "pdc" and (each.a_mm, each.b_mm) in found]
    compared = []
    for point in points:
        row = found[point.a_mm, point.b_mm]
        compared.append(
            {
                **asdict(point),
                "fe_theta_deg": row["theta_max_deg"],
                "fe_force_n": row["f_max_n"],
                "theta_error_pct": 100.0 * (row["theta_max_deg"] / point.theta_deg - 1.0),
                "force_error_pct": 100.0 * (row["f_max_n"] / point.force_n - 1.0),
            }
        )
    responses = published_responses()
    published = grid_front(responses.objectives, responses.domain, GRID)
    tables = [Samples.of_the_paper(table) for table in ("doe_training.csv", "doe_validation.csv")]
    initial = reference_design(drawing.a_mm, drawing.b_mm, tables, responses)
    told = np.unique(np.linspace(0, len(published.values) - 1, _TOLD).round().astype(int))
    return {
        "errors": error_summary(compared),
        **asdict(gains(published, initial)),
        "front": np.column_stack([published.design_mm, published.values])[told].tolist(),
        "optima": [row for row in compared if row["source"].startswith("table_5")],
    }


def _columns(rows: Sequence[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Designs and values of rows."""
    design = np.array([[row["a_mm"], row["b_mm"]] for row in rows])
    return design, np.array([[row["theta_max_deg"], row["f_max_n"]] for row in rows])
