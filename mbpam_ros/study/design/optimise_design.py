"""Command ``optimise_design``: the designs that bend furthest and press hardest, and a compromise among them.

    optimise_design --json FILE                          the paper's Eqs. 9 and 10, MOPSO as in its Table 4, and NSGA-II
    optimise_design --metamodel krg --json FILE          another metamodel, fitted to Table 1
    optimise_design --training CSV --initial 2.5,2.0     samples of your own (a_mm, b_mm, theta_max_deg, f_max_n)
    optimise_design --required-force 0.6                 choose the design with the largest angle that has 0.6 N
    optimise_design --save-as optimised                  keep the chosen design, for "design: optimised" in gripper.yaml

The front in the JSON file, and the figures drawn from it, are those of the first algorithm and seed; every other run is
judged too, against the front of a dense grid. The command fails if a run covers less than 99.5 % of that.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbpam_ros.actuator.design import INITIAL_DESIGN, DesignDomainError
from mbpam_ros.actuator.metamodel import METAMODELS, REFITTED_SAMPLES, TRAINING_TABLE, VALIDATION_TABLE
from mbpam_ros.actuator.sample_check import MetamodelError
from mbpam_ros.actuator.tables import read_table
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.announcement import announce
from mbpam_ros.study.design.compromise import CompromiseError, Rule, knee, required_force, weighted
from mbpam_ros.study.design.design_file import keep_design
from mbpam_ros.study.design.evaluations import Evaluations, OptimisationError
from mbpam_ros.study.design.improvement import Reference, gains, reference_design
from mbpam_ros.study.design.mopso import mopso
from mbpam_ros.study.design.nsga2 import nsga2
from mbpam_ros.study.design.pareto import Front, FrontError, grid_front, hypervolume_ratio
from mbpam_ros.study.design.pictures import PictureError, draw_optimisation
from mbpam_ros.study.design.responses import PUBLISHED, Responses, fitted_responses, published_responses
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.design.uncertainty import kriging_sigma, left_out, uncertain_kriging
from mbpam_ros.study.progress_bar import ProgressBar
from mbpam_ros.study.result_file import ResultFileError, write_json

ALGORITHMS: dict[str, Callable[[Evaluations, int], None]] = {"mopso": mopso, "nsga2": nsga2}
LEAST_HYPERVOLUME_RATIO = 0.995
_GRID = 401
_COLUMNS = ("a_mm", "b_mm", "theta_deg", "f_n")


@dataclass(frozen=True)
class Run:
    """One run of one algorithm: its front, and the front's hypervolume over that of the dense grid's."""

    algorithm: str
    seed: int
    evaluations: int
    front: Front
    hypervolume_ratio: float


def optimise(responses: Responses, truth: Front, algorithm: str, seed: int) -> Run:
    """Run an algorithm of :data:`ALGORITHMS`; equal seeds give equal bits.

    Raises:
        OptimisationError: the algorithm is not installed or had to stop.
        FrontError: there is no trade-off between the responses.
    """
    evaluations = Evaluations(responses.objectives, responses.domain)
    ALGORITHMS[algorithm](evaluations, seed)
    front = evaluations.front()
    return Run(algorithm, seed, evaluations.count, front, hypervolume_ratio(front, truth))


def check_table_5(responses: Responses) -> list[dict[str, float]]:
    """Return the paper's three optimal designs with its values and with those of these responses.

    Raises:
        ConfigError: ``pareto_checks.csv`` is missing or unreadable.
    """
    names = ("a_mm", "b_mm", "theta_prs_deg", "f_prs_n", "theta_fe_deg", "f_fe_n")
    rows = read_table("pareto_checks.csv", *names).T
    return [
        {**dict(zip(names, row.tolist(), strict=True)), "theta_deg": float(theta), "f_n": float(force)}
        for row, (theta, force) in zip(rows, responses.objectives(rows[:, :2]), strict=True)
    ]


def gains_by_metamodel(
    samples: Samples, initial: Reference, job_ended: Callable[[str], object] = str
) -> dict[str, dict[str, float | None]]:
    """Return what the grid front of each metamodel offers over the initial design: how far the models disagree.

    ``job_ended`` is called after each with a line about it.

    Raises:
        DesignDomainError, MetamodelError: the samples do not determine a metamodel.
    """
    found: dict[str, dict[str, float | None]] = {}
    for name in METAMODELS:
        responses = fitted_responses(name, samples)
        found[name] = asdict(gains(grid_front(responses.objectives, responses.domain, 201), initial))
        job_ended(f"gains by {name}")
    return found


def expected_s(samples: int, runs: int, with_gains: bool) -> float:
    """Return about how long the command takes with so many samples to fit [s]: what it took on one core at 2.5 GHz."""
    fit = 20.0 * (samples / 1000.0) ** 3
    left_out = 0.004 * samples**2 if samples <= REFITTED_SAMPLES else 0.01 * samples
    compared = 0.3 + 0.02 * samples + 2.5 * fit if with_gains else 0.0
    return 0.02 * samples + 2.0 * fit + left_out + (0.4 + 0.002 * samples) * runs + compared


def result_json(
    name: str, runs: Sequence[Run], initial: Reference | None, rule_name: str, chosen: int
) -> dict[str, Any]:
    """Return the results as plain values; ``chosen`` is an index in the first run's front.

    Keys: ``pareto`` (rows a_mm, b_mm, theta_deg, f_n), ``gain_force_at_equal_angle_pct``,
    ``gain_angle_at_equal_force_pct``, ``hypervolume_ratio`` and ``chosen``, all of the first run; ``metamodel``,
    ``initial`` and ``runs``.
    """
    pareto = np.column_stack([runs[0].front.design_mm, runs[0].front.values])

    def offers(front: Front) -> dict[str, float | None]:
        return {} if initial is None else asdict(gains(front, initial))

    return {
        "pareto": pareto.tolist(),
        **offers(runs[0].front),
        "hypervolume_ratio": runs[0].hypervolume_ratio,
        "chosen": {"rule": rule_name, **dict(zip(_COLUMNS, pareto[chosen].tolist(), strict=True))},
        "metamodel": name,
        "initial": None if initial is None else asdict(initial),
        "runs": [
            {
                "algorithm": run.algorithm,
                "seed": run.seed,
                "evaluations": run.evaluations,
                "hypervolume_ratio": run.hypervolume_ratio,
                **offers(run.front),
            }
            for run in runs
        ],
    }


def result_text(result: dict) -> str:
    """Return the results in words and tables."""
    lines = [
        f"front of metamodel {result['metamodel']}: {len(result['pareto'])} designs",
        f"hypervolume over that of the front of a {_GRID} x {_GRID} grid, both against that front's worst values:",
    ]
    for run in result["runs"]:
        lines.append(
            f"  {run['algorithm']:<6} seed {run['seed']}  {run['evaluations']} evaluations  "
            f"{run['hypervolume_ratio']:.4f}"
        )
    if result["initial"] is not None:
        lines.append(
            "initial design a = {a_mm:g}, b = {b_mm:g} mm: {theta_deg:.2f} deg, {f_n:.4f} N ({source})".format(
                **result["initial"]
            )
        )
        lines.append(f"  {'the front':<13} {_gains_text(result)}")
        for name, offered in result.get("gains_by_metamodel", {}).items():
            lines.append(f"  {name:<13} {_gains_text(offered)}")
    for row in result.get("table_5", []):
        lines.append(
            f"Table 5: a = {row['a_mm']:g}, b = {row['b_mm']:g} mm: {row['theta_deg']:.2f} deg "
            f"(paper's PRS {row['theta_prs_deg']:.2f}, FE {row['theta_fe_deg']:.2f}), {row['f_n']:.4f} N "
            f"({row['f_prs_n']:.4f}, {row['f_fe_n']:.4f})"
        )
    lines.append(
        "chosen by {rule}: a = {a_mm:.3f}, b = {b_mm:.3f} mm: {theta_deg:.2f} +- {theta_sigma_deg:.2f} deg, "
        "{f_n:.4f} +- {f_sigma_n:.4f} N (one standard deviation, by kriging)".format(**result["chosen"])
    )
    lines += [f"  sigma of {key}: {verdict}" for key, verdict in result["chosen"]["sigma_verdict"].items()]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _parser().parse_args(arguments)
    try:
        _run(options)
    except (
        ConfigError,
        DesignDomainError,
        MetamodelError,
        OptimisationError,
        FrontError,
        CompromiseError,
        PictureError,
        ResultFileError,
    ) as error:
        print(f"optimise_design: {error}", file=sys.stderr)
        return 1
    return 0


def _run(options: argparse.Namespace) -> None:
    of_the_paper = options.training is None
    name = options.metamodel or (PUBLISHED if of_the_paper else "prs")
    if name == PUBLISHED and not of_the_paper:
        raise ConfigError("the published equations are the paper's; choose another --metamodel for samples of your own")
    rule_name, rule = _rule(options)
    samples = Samples.of_the_paper(TRAINING_TABLE) if of_the_paper else Samples.read(options.training)
    with_initial = of_the_paper or options.initial is not None
    job_ended = _announced(options, len(samples.design_mm), with_initial)
    responses = published_responses() if name == PUBLISHED else fitted_responses(name, samples)
    initial = None
    if with_initial:
        known = [samples, Samples.of_the_paper(VALIDATION_TABLE)] if of_the_paper else [samples]
        a_mm, b_mm = options.initial or astuple(INITIAL_DESIGN)
        initial = reference_design(a_mm, b_mm, known, responses)
    truth = grid_front(responses.objectives, responses.domain, _GRID)
    rule(truth)  # refuses a force that no design has before anything is optimised
    job_ended("front of the grid")
    runs = []
    for algorithm, seed in _runs(options):
        runs.append(optimise(responses, truth, algorithm, seed))
        job_ended(f"{algorithm}, seed {seed}")
    result = result_json(name, runs, initial, rule_name, rule(runs[0].front))
    result["chosen"] |= _sigma_json(samples, result["chosen"])
    job_ended("deviation by kriging")
    if initial is not None:
        result["gains_by_metamodel"] = gains_by_metamodel(samples, initial, job_ended)
    if of_the_paper:
        result["table_5"] = check_table_5(responses)
    print(result_text(result))
    if options.json is not None:
        write_json(options.json, result)
    if options.save_as is not None:
        keep_design(options.save_as, result, "paper, Table 1" if of_the_paper else options.training.name)
    if options.picture is not None:
        fronts = {f"{run.algorithm}, seed {run.seed}": run.front for run in runs if run.seed == options.seed}
        draw_optimisation(responses, truth, fronts, result, options.picture)
    worst = min(runs, key=lambda run: run.hypervolume_ratio)
    if worst.hypervolume_ratio < LEAST_HYPERVOLUME_RATIO:
        raise OptimisationError(
            f"{worst.algorithm} with seed {worst.seed} covers {worst.hypervolume_ratio:.4f} of the grid's front, "
            f"less than {LEAST_HYPERVOLUME_RATIO:g}"
        )


def _runs(options: argparse.Namespace) -> list[tuple[str, int]]:
    seeds = range(options.seed, options.seed + options.seeds)
    return [(algorithm, seed) for algorithm in options.algorithms for seed in seeds]


def _announced(options: argparse.Namespace, samples: int, with_gains: bool) -> Callable[[str], object]:
    """Say how long it will take; return what to call after each job, which shows progress if it was long."""
    runs = len(_runs(options))
    if not announce(f"{runs} optimisations, {samples} samples", expected_s(samples, runs, with_gains)):
        return str
    jobs = ProgressBar(sys.stderr)
    jobs.start(2 + runs + (len(METAMODELS) if with_gains else 0), 0)
    return jobs.job_ended


def _sigma_json(samples: Samples, chosen: dict) -> dict[str, object]:
    kriging = uncertain_kriging(samples)
    sigma = kriging_sigma(kriging, [[chosen["a_mm"], chosen["b_mm"]]])
    _, coverage = left_out(samples, kriging)
    return {
        "theta_sigma_deg": float(sigma["theta_max"][0]),
        "f_sigma_n": float(sigma["f_max"][0]),
        "sigma_coverage": {key: found.as_json() for key, found in coverage.items()},
        "sigma_verdict": {key: found.text() for key, found in coverage.items()},
    }


def _rule(options: argparse.Namespace) -> tuple[str, Rule]:
    if options.required_force is not None:
        return f"required force {options.required_force:g} N", required_force(options.required_force)
    if options.weights is not None:
        return "weights {:g} (angle) and {:g} (force)".format(*options.weights), weighted(*options.weights)
    return "knee", knee


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "optimise_design", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the front and the figures go")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    parser.add_argument("--training", type=Path, metavar="CSV", help="samples to fit (default: the paper's Table 1)")
    parser.add_argument(
        "--metamodel",
        choices=(PUBLISHED, *METAMODELS),
        help="default: published, Eqs. 9 and 10 as printed; prs for samples of your own",
    )
    parser.add_argument(
        "--initial",
        type=_pair,
        metavar="A,B",
        help="design that gains are measured by [mm] (default: the paper's 2.5,2.0; none for samples of your own)",
    )
    parser.add_argument(
        "--algorithms", type=_algorithms, default=list(ALGORITHMS), metavar="NAMES", help="default: mopso,nsga2"
    )
    parser.add_argument("--seed", type=_at_least(0), default=0, help="first seed (default: 0)")
    parser.add_argument(
        "--seeds", type=_at_least(1), default=3, metavar="N", help="seeds of each algorithm (default: 3)"
    )
    parser.add_argument("--save-as", metavar="NAME", help="keep the chosen design under this name for the gripper file")
    rules = parser.add_mutually_exclusive_group()
    rules.add_argument("--required-force", type=float, metavar="N", help="choose the largest angle with this force")
    rules.add_argument("--weights", type=_pair, metavar="ANGLE,FORCE", help="choose by weights (default: the knee)")
    return parser


def _pair(text: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"wants two numbers with a comma between, found {text!r}") from error
    return first, second


def _algorithms(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in ALGORITHMS]:
        raise argparse.ArgumentTypeError(f"unknown {', '.join(unknown)}; known: {', '.join(ALGORITHMS)}")
    return names


def _at_least(least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        if (number := int(text)) < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}")
        return number

    return whole_number


def _gains_text(offered: dict) -> str:
    force, angle = offered["gain_force_at_equal_angle_pct"], offered["gain_angle_at_equal_force_pct"]
    return f"force at equal angle {_percent(force)}, angle at equal force {_percent(angle)}"


def _percent(value: float | None) -> str:
    return "beyond the front" if value is None else f"{value:+.2f} %"


if __name__ == "__main__":
    raise SystemExit(main())
