"""The flowchart of the paper's Fig. 7 as one run that goes on where it was interrupted: a muscle from its drawing.

    drawing -> Latin hypercube -> finite elements of every sample -> metamodels, judged on checks -> Pareto front
            -> a design by a stated rule;   drawing -> finite element law of the rod -> plant and estimator

Everything lands in the muscle's folder: ``samples.json`` (rows of the finite elements), ``law.json``, ``front.json``,
``built.json``; ``front_fe.json`` and ``one_at_a_time.json`` (:mod:`~mbpam_ros.study.muscle.front_check`,
:mod:`~mbpam_ros.study.muscle.one_at_a_time`), and ``ends.json`` where it is asked for. A sample without equilibrium is
kept by name, left out of the fits, and told; more than :data:`MOST_FAILED` of them are too many for a metamodel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mbpam_ros.actuator.built_muscle import ENDS_FILE, LAW_FILE, BuiltMuscle
from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.design import optimise_design
from mbpam_ros.study.design.compare_metamodels import compare
from mbpam_ros.study.design.comparison import Judged
from mbpam_ros.study.design.compromise import Rule
from mbpam_ros.study.design.improvement import reference_design
from mbpam_ros.study.design.latin_hypercube import optimal_latin_hypercube
from mbpam_ros.study.design.pareto import grid_front
from mbpam_ros.study.design.responses import fitted_responses
from mbpam_ros.study.design.samples import RESPONSES, Samples
from mbpam_ros.study.fe.end_effect import PRESSURES_KPA as ENDS_KPA
from mbpam_ros.study.fe.end_effect import end_effect_table
from mbpam_ros.study.fe.law_table import BENDS_DEG, PRESSURES_KPA, law_table
from mbpam_ros.study.fe.loaded_muscle import MuscleModel
from mbpam_ros.study.fe.mesh import Resolution
from mbpam_ros.study.fe.mesh_error import mesh_error_pct
from mbpam_ros.study.fe.versions import library_versions
from mbpam_ros.study.muscle.samples import (
    FeSample,
    MeshedDrawing,
    designs_of,
    ranges_of,
    run_of,
    silicone_of,
    table_designs,
)
from mbpam_ros.terminal import Progress

DRAWN = "drawing"
"""Name of the row of the drawing itself."""

MOST_FAILED = 0.3
"""Share of the samples that may have no equilibrium."""

FEWEST_SAMPLES = 12
"""The paper's polynomial has eight coefficients, and each sample is left out in turn."""

UNKNOWN_MESH_SIGMA = 0.05
"""Relative deviation of a bend where the error of the mesh was not measured."""

VARY = {"a,b": ("a_mm", "b_mm"), "a,b,c,n": ("a_mm", "b_mm", "c_mm", "n")}


class BuildError(MbpamError, RuntimeError):
    """The muscle cannot be built; the message says why, and what to change."""


@dataclass(frozen=True)
class BuildPlan:
    """What is computed.

    Args:
        vary: a key of :data:`VARY`.
        samples, checks: designs to fit and to judge on.
        tables: take the paper's designs (Tables 1, 2 and 5) for samples, checks and optima, made similar to the radius.
        seed: of the designs.
        patterns: that samples are run with.
        resolution, mesh_wall_mm: of the finite elements; see
            :class:`~mbpam_ros.study.muscle.samples.MeshedDrawing`.
        law_kpa, law_bends_deg: where the law is sampled.
        ends_mesh: of the short muscle that tells what the drawing's ends do; None: similar to the paper's muscle's.
        largest_stretch: of the silicone's wall before it tears; designs beyond it are left out. None: not known.
    """

    vary: str = "a,b"
    samples: int = 21
    checks: int = 8
    tables: bool = False
    seed: int = 0
    patterns: tuple[str, ...] = ("pdc", "psc")
    resolution: Resolution = Resolution()
    mesh_wall_mm: float = 0.0
    law_kpa: tuple[int, ...] = PRESSURES_KPA
    law_bends_deg: tuple[int, ...] = BENDS_DEG
    ends_mesh: str | None = None
    largest_stretch: float | None = None

    def meshed(self, drawing: MuscleDrawing) -> MeshedDrawing:
        """Return the drawing on the plan's finite elements."""
        return MeshedDrawing(drawing, self.resolution, self.mesh_wall_mm)


def sampled_designs(drawing: MuscleDrawing, plan: BuildPlan) -> list[FeSample]:
    """Return the drawing, the samples and the checks.

    Raises:
        SamplingError: too few of them.
        BuildError: the drawing lies outside what is sampled.
    """
    names = VARY[plan.vary]
    ranges = ranges_of(drawing)
    drawn = FeSample(DRAWN, drawing.a_mm, drawing.b_mm, drawing.c_mm, drawing.wave_count)
    for name in names:
        value = getattr(drawn, "wave_count" if name == "n" else name)
        low, high = ranges[name]
        if plan.samples and not low - 1e-9 <= value <= high + 1e-9:
            raise BuildError(
                f"the drawing's {name} = {value:g} is outside {low:g} to {high:g}, which are the paper's ranges made "
                "similar to this radius; draw it within, or build it with --samples 0"
            )
    designs = [drawn]
    if plan.tables:
        return designs + table_designs(drawing)
    for count, prefix, seed in ((plan.samples, "sample", plan.seed), (plan.checks, "check", plan.seed + 1)):
        if count:
            points = optimal_latin_hypercube(count, len(names), seed)
            if prefix == "check":  # within the samples, not on their edges
                points = 0.05 + 0.9 * points
            designs += designs_of(drawing, points, names, prefix)
    return designs


def run_samples(
    drawing: MuscleDrawing, plan: BuildPlan, folder: Path, executor: Executor, progress: Progress
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Run the finite elements of all designs that the folder does not hold; return their rows, and what failed.

    Raises:
        BuildError: too many have no equilibrium, or the drawing itself has none.
        ResultFileError: the folder cannot be written, or holds something else.
    """
    designs = sampled_designs(drawing, plan)
    rows, failures = plan.meshed(drawing).rows(designs, plan.patterns, folder / "samples.json", executor, progress)
    for name, reason in failures.items():
        progress.say(f"warning: {name} is left out: {reason}")
    lost = [name for name in failures if name.startswith(DRAWN)]
    if lost:
        raise BuildError(f"the drawing itself has no equilibrium at 100 kPa ({lost[0]}: {failures[lost[0]]})")
    if len(failures) > MOST_FAILED * (len(rows) + len(failures)):
        raise BuildError(
            f"{len(failures)} of {len(rows) + len(failures)} samples have no equilibrium, more than "
            f"{100 * MOST_FAILED:.0f} %: take a stiffer silicone or a finer mesh"
        )
    return rows, failures


def samples_of(rows: Sequence[dict[str, Any]], prefix: str, largest_stretch: float | None) -> Samples:
    """Return the rows (PDC) of one kind as samples over (a, b), without those whose wall tears."""
    kept = [
        row
        for row in rows
        if row["pattern"] == "pdc"
        and row["name"].startswith(prefix)
        and (largest_stretch is None or row["stretch_max"] <= largest_stretch)
    ]
    design = np.array([[row["a_mm"], row["b_mm"]] for row in kept]).reshape(-1, 2)
    responses = {"theta_max": "theta_max_deg", "f_max": "f_max_n"}
    return Samples(design, {key: np.array([row[column] for row in kept]) for key, column in responses.items()})


def front_of(
    drawing: MuscleDrawing,
    plan: BuildPlan,
    rows: Sequence[dict[str, Any]],
    rule: tuple[str, Rule],
    folder: Path,
    executor: Executor,
    progress: Progress,
) -> dict[str, Any] | None:
    """Return metamodels beside each other, the front of the best, and the design that ``rule`` chooses.

    None where too few samples were asked for to tell.

    Raises:
        BuildError: too few of the samples are left.
        FrontError, MetamodelError, OptimisationError: there is no front.
    """
    training = samples_of(rows, "sample", plan.largest_stretch)
    if plan.vary != "a,b" or plan.samples < FEWEST_SAMPLES:
        return None
    if len(training.design_mm) < FEWEST_SAMPLES:
        raise BuildError(f"{len(training.design_mm)} samples are left, a metamodel takes {FEWEST_SAMPLES}")
    checks = samples_of(rows, "check", plan.largest_stretch)
    domain = training.domain()
    low, high = domain.bounds_mm
    inside = np.all((low <= checks.design_mm) & (checks.design_mm <= high), axis=1)
    checks = Samples(checks.design_mm[inside], {key: values[inside] for key, values in checks.responses.items()})
    judge = partial(compare, training, executor=executor, progress=progress)
    judged = {"left out": judge(None, kept_in=folder / "left_out_runs.json")}
    if len(checks.design_mm) >= 3:
        judged["checks"] = judge(checks, kept_in=folder / "checks_runs.json")
    best = min(judged["left out"], key=lambda name: _error(judged, name)).lower()
    responses = fitted_responses(best, training)
    truth = grid_front(responses.objectives, responses.domain, optimise_design.GRID)
    initial = reference_design(drawing.a_mm, drawing.b_mm, [samples_of(rows, DRAWN, None), training], responses)
    question = optimise_design.Question(best, training, responses, truth, initial)
    runs, _ = optimise_design.run_all(question, [("mopso", plan.seed)], executor, progress, folder / "front_runs.json")
    rule_name, choose = rule
    result = optimise_design.result_json(best, runs, initial, rule_name, choose(runs[0].front))
    result["judged"] = {
        way: {name: {key: asdict(of[key].accuracy) for key in RESPONSES} for name, of in table.items()}
        for way, table in judged.items()
    }
    return result


def _error(judged: dict[str, dict[str, dict[str, Judged]]], name: str) -> float:
    """Mean error of a metamodel over its ranges, over both responses and both ways of judging."""
    errors = [of[name][key].accuracy.rmse_normalised for of in judged.values() for key in RESPONSES]
    return float(np.mean(errors))


def monotony(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return partial rank correlations of bend, force and stretch (PDC) with each variable that the samples vary.

    The part of the ranks that the other variables do not explain: with R the correlations of the ranks of a response
    and of all variables, -P_0i / sqrt(P_00 P_ii), P = R^-1. Near +1 and -1 the response is monotone in the variable,
    whatever the others do; near 0 it is not, or hardly depends on it.
    """
    from scipy.stats import rankdata

    of = [row for row in rows if row["pattern"] == "pdc" and row["name"].startswith("sample")]
    varied = [name for name in ("a_mm", "b_mm", "c_mm", "n") if len({row[name] for row in of}) > 2]
    if len(of) <= len(varied) + 2:
        return {}
    found: dict[str, dict[str, float]] = {name: {} for name in varied}
    for what in ("theta_max_deg", "f_max_n", "stretch_max"):
        ranks = [rankdata([row[key] for row in of]) for key in (what, *varied)]
        inverse = np.linalg.pinv(np.corrcoef(ranks))
        for place, name in enumerate(varied, start=1):
            found[name][what] = float(-inverse[0, place] / math.sqrt(inverse[0, 0] * inverse[place, place]))
    return found


def build_law(
    drawing: MuscleDrawing, plan: BuildPlan, folder: Path, executor: Executor, progress: Progress
) -> dict[str, Any]:
    """Compute the rod's law of the drawing (bend, stretch, twist, gas volume), or what the folder lacks of it.

    Raises:
        BuildError: pressures or bends are missing.
    """
    drawn = FeSample(DRAWN, drawing.a_mm, drawing.b_mm, drawing.c_mm - plan.mesh_wall_mm, drawing.wave_count)
    run = run_of(drawing, drawn, "pdc", plan.resolution, silicone_of(drawing))
    law = law_table(
        run, folder / LAW_FILE, executor, progress, pressures_kpa=plan.law_kpa, bends_deg=plan.law_bends_deg
    )
    missing = [row for row in law["tables"] if row["missing"]]
    if law["failures"] or missing:
        first = next(iter(law["failures"].values()), None) or missing[0]["missing"][0]["reason"]
        raise BuildError(f"the law has no equilibrium everywhere ({first}); lower --law-to, or take a stiffer silicone")
    return law


def build_ends(
    drawing: MuscleDrawing, plan: BuildPlan, folder: Path, executor: Executor, progress: Progress
) -> dict[str, Any] | None:
    """Compute what the drawing's ends do, if the plan names a mesh for it.

    Raises:
        BuildError: a short muscle of the drawing has no equilibrium.
    """
    if plan.ends_mesh is None:
        return None
    drawn = FeSample(DRAWN, drawing.a_mm, drawing.b_mm, drawing.c_mm, drawing.wave_count)
    run = run_of(drawing, drawn, "pdc", plan.resolution, silicone_of(drawing))
    model = MuscleModel(run.geometry, plan.ends_mesh, drawing.end_length_mm, silicone=run.silicone)
    pressures = tuple(pressure for pressure in ENDS_KPA if pressure <= plan.law_kpa[-1])
    ends = end_effect_table(model, folder / ENDS_FILE, executor, progress, pressures)
    if ends["failures"]:
        raise BuildError(f"the ends have no equilibrium: {next(iter(ends['failures'].values()))}; lower --law-to")
    return ends


def built_muscle(drawing: MuscleDrawing, plan: BuildPlan, rows: Sequence[dict[str, Any]]) -> BuiltMuscle:
    """Return what plant and estimator need to know of a muscle that was built."""
    drawn = next(row for row in rows if row["name"] == f"{DRAWN} pdc")
    error_pct = mesh_error_pct(plan.resolution)
    sigma = UNKNOWN_MESH_SIGMA if error_pct is None else abs(error_pct) / 100.0
    versions = {name: str(value) for name, value in library_versions().items()}
    return BuiltMuscle(
        float(drawn["theta_max_deg"]),
        float(drawn["f_max_n"]),
        min(math.hypot(sigma, 0.01), 1.0),
        drawing,
        {"command": "mbpam muscle build", "silicone": drawing.silicone, **versions},
    )
