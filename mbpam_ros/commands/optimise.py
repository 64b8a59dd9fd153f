"""The designs that bend furthest and press hardest, and a compromise among them.

    mbpam optimise --json FILE                          the paper's Eqs. 9 and 10, MOPSO as in its Table 4, and NSGA-II
    mbpam optimise --metamodel krg --json FILE          another metamodel, fitted to Table 1
    mbpam optimise --training CSV --initial 2.5,2.0     samples of your own (a_mm, b_mm, theta_max_deg, f_max_n)
    mbpam optimise --required-force 0.6                 choose the design with the largest angle that has 0.6 N
    mbpam optimise --save-as optimised                  keep the chosen design, for "design: optimised" in gripper.yaml

The front in the JSON file, and the figures drawn from it, are those of the first algorithm and seed; every other run is
judged too, against the front of a dense grid. The command fails if a run covers less than 99.5 % of that.
Finished runs are kept in FILE_runs.json, from which the same command goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

from mbpam_ros.actuator.design import INITIAL_DESIGN
from mbpam_ros.actuator.metamodel import METAMODELS, TRAINING_TABLE, VALIDATION_TABLE
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.design import optimise_design
from mbpam_ros.study.design.compromise import Rule, knee, required_force, weighted
from mbpam_ros.study.design.design_file import keep_design
from mbpam_ros.study.design.evaluations import OptimisationError
from mbpam_ros.study.design.improvement import Reference, reference_design
from mbpam_ros.study.design.pareto import grid_front
from mbpam_ros.study.design.pictures import draw_optimisation
from mbpam_ros.study.design.responses import PUBLISHED, Responses, fitted_responses, published_responses
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.jobs import runs_beside
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the front and the figures go")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where the picture goes (png, pdf or svg)")
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
        "--algorithms",
        type=_algorithms,
        default=list(optimise_design.ALGORITHMS),
        metavar="NAMES",
        help="default: mopso,nsga2",
    )
    parser.add_argument("--seed", type=_at_least(0), default=0, help="first seed (default: 0)")
    parser.add_argument(
        "--seeds", type=_at_least(1), default=3, metavar="N", help="seeds of each algorithm (default: 3)"
    )
    parser.add_argument("--save-as", metavar="NAME", help="keep the chosen design under this name for the gripper file")
    rules = parser.add_mutually_exclusive_group()
    rules.add_argument("--required-force", type=float, metavar="N", help="choose the largest angle with this force")
    rules.add_argument("--weights", type=_pair, metavar="ANGLE,FORCE", help="choose by weights (default: the knee)")
    add_workers(parser, default=1)


def run(options: argparse.Namespace) -> int:
    """Optimise, print and write what is asked for."""
    of_the_paper = options.training is None
    name = options.metamodel or (PUBLISHED if of_the_paper else "prs")
    if name == PUBLISHED and not of_the_paper:
        raise ConfigError("the published equations are the paper's; choose another --metamodel for samples of your own")
    rule_name, rule = _rule(options)
    samples = Samples.of_the_paper(TRAINING_TABLE) if of_the_paper else Samples.read(options.training)
    with_initial = of_the_paper or options.initial is not None
    wanted = _wanted(options)
    progress = _announced(len(wanted), len(samples.design_mm), with_initial)
    responses = published_responses() if name == PUBLISHED else fitted_responses(name, samples)
    initial = _initial(options, samples, responses) if with_initial else None
    truth = grid_front(responses.objectives, responses.domain, optimise_design.GRID)
    rule(truth)  # refuses a force that no design has before anything is optimised
    progress.say("front of the grid")
    question = optimise_design.Question(name, samples, responses, truth, initial)
    with executor_for(options, len(wanted)) as executor:
        runs, compared = optimise_design.run_all(question, wanted, executor, progress, runs_beside(options.json))
    result = optimise_design.result_json(name, runs, initial, rule_name, rule(runs[0].front))
    result["chosen"] |= optimise_design.sigma_values(samples, result["chosen"])
    progress.say("deviation by kriging")
    if initial is not None:
        result["gains_by_metamodel"] = compared
    if of_the_paper:
        result["table_5"] = optimise_design.check_table_5(responses)
    print(optimise_design.result_text(result))
    if options.json is not None:
        write_json(options.json, result)
    if options.save_as is not None:
        keep_design(options.save_as, result, "paper, Table 1" if of_the_paper else options.training.name)
    if options.picture is not None:
        fronts = {f"{run.algorithm}, seed {run.seed}": run.front for run in runs if run.seed == options.seed}
        draw_optimisation(responses, truth, fronts, result, options.picture)
    worst, least = min(runs, key=lambda run: run.hypervolume_ratio), optimise_design.LEAST_HYPERVOLUME_RATIO
    if worst.hypervolume_ratio < least:
        raise OptimisationError(
            f"{worst.algorithm} with seed {worst.seed} covers {worst.hypervolume_ratio:.4f} of the grid's front, "
            f"less than {least:g}"
        )
    return 0


def _wanted(options: argparse.Namespace) -> list[tuple[str, int]]:
    seeds = range(options.seed, options.seed + options.seeds)
    return [(algorithm, seed) for algorithm in options.algorithms for seed in seeds]


def _initial(options: argparse.Namespace, samples: Samples, responses: Responses) -> Reference:
    known = [samples, *([Samples.of_the_paper(VALIDATION_TABLE)] if options.training is None else [])]
    a_mm, b_mm = options.initial or astuple(INITIAL_DESIGN)
    return reference_design(a_mm, b_mm, known, responses)


def _announced(runs: int, samples: int, with_gains: bool) -> Progress:
    """Say how long it will take; return what shows its progress if that is long."""
    expected_s = optimise_design.expected_s(samples, runs, with_gains)
    slow = announce(f"{runs} optimisations, {samples} samples", expected_s)
    return Progress(sys.stderr, silent=not slow)


def _rule(options: argparse.Namespace) -> tuple[str, Rule]:
    if options.required_force is not None:
        return f"required force {options.required_force:g} N", required_force(options.required_force)
    if options.weights is not None:
        return "weights {:g} (angle) and {:g} (force)".format(*options.weights), weighted(*options.weights)
    return "knee", knee


def _pair(text: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"wants two numbers with a comma between, found {text!r}") from error
    return first, second


def _algorithms(text: str) -> list[str]:
    names = text.split(",")
    if unknown := [name for name in names if name not in optimise_design.ALGORITHMS]:
        raise argparse.ArgumentTypeError(
            f"unknown {', '.join(unknown)}; known: {', '.join(optimise_design.ALGORITHMS)}"
        )
    return names


def _at_least(least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        if (number := int(text)) < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}")
        return number

    return whole_number
