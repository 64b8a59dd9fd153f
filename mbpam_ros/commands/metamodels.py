"""Metamodels of the muscle beside each other, and beside the paper's Table 3.

    mbpam metamodels --json FILE                                     fitted to Table 1, judged on Table 2
    mbpam metamodels --training CSV --validation CSV --json FILE     on samples of your own
    mbpam metamodels --training CSV --json FILE                      judged by leaving each sample out in turn
    mbpam metamodels --map FILE                                      picture of the uncertainty over the domain

Up to 40 samples, each is left out by refitting without it; with more, by the closed form of each metamodel, with length
scales and widths of all samples. The output says which, and beside each stated deviation whether it covers the errors.

A CSV has the columns a_mm, b_mm, theta_max_deg, f_max_n. The names in the table, in small letters, are those of the
estimator's parameter "metamodel". What is finished is kept in FILE_runs.json, from which the same command goes on.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.metamodel import CORRELATIONS, METAMODELS, TRAINING_TABLE, TRENDS, VALIDATION_TABLE
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.design.compare_metamodels import compare, expected_s, published_errors, table_text
from mbpam_ros.study.design.pictures import draw_comparison, draw_uncertainty
from mbpam_ros.study.design.responses import published_coefficients
from mbpam_ros.study.design.samples import RESPONSES, Samples
from mbpam_ros.study.design.uncertainty import uncertain_kriging, uncertainty_map
from mbpam_ros.study.jobs import runs_beside
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the figures go")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    parser.add_argument("--training", type=Path, metavar="CSV", help="samples to fit (default: the paper's Table 1)")
    parser.add_argument(
        "--validation", type=Path, metavar="CSV", help="samples to judge on (default: leave each sample out)"
    )
    parser.add_argument("--leave-one-out", action="store_true", help="judge the paper's samples so, not on Table 2")
    parser.add_argument("--map", type=result_file, metavar="FILE", help="where the map of kriging's uncertainty goes")
    parser.add_argument("--trend", choices=TRENDS, default="constant", help="of kriging")
    parser.add_argument("--correlation", choices=CORRELATIONS, default="gaussian", help="of kriging")
    add_workers(parser, default=1)  # times are measured too


def run(options: argparse.Namespace) -> int:
    """Fit, judge, and print the table."""
    training, validation = _samples(options)
    training.domain()  # refuses before anything is announced
    slow = announce(
        f"{len(METAMODELS)} metamodels of {len(training.design_mm)} samples, judged"
        + (" by leaving each out" if validation is None else ""),
        expected_s(len(training.design_mm), validation is None),
    )
    progress = Progress(sys.stderr, silent=not slow)
    with executor_for(options, len(METAMODELS)) as executor:
        table = compare(
            training, validation, options.trend, options.correlation, executor, progress, runs_beside(options.json)
        )
    as_the_paper = options.training is None and not options.leave_one_out
    print(table_text(table, published_errors() if as_the_paper else {}))
    if as_the_paper:
        for key, printed in published_coefficients().items():
            found = np.array(table["PRS"][key].parameters["coefficients"])
            print(f"PRS {key}: the paper's coefficients to {np.abs(found / printed - 1.0).max():.1e} of each")
        print(
            "The paper calls its RBF Gaussian, but its row is that of the thin plate spline r^2 ln r with a linear "
            "trend (RBF);\nno width gives Gaussians (RBF_GAUSSIAN) that row."
        )
    if options.json is not None:
        write_json(
            options.json,
            {name: {key: judged[key].as_json() for key in RESPONSES} for name, judged in table.items()},
        )
    if options.picture is not None:
        draw_comparison(table, validation or training, options.picture)
    if options.map is not None:
        drawn = uncertainty_map(training, uncertain_kriging(training, options.trend, options.correlation))
        for key in RESPONSES:
            print(f"map of kriging's sigma of {key}: {drawn.coverage[key].text()}")
        draw_uncertainty(drawn, training, options.map)
    return 0


def _samples(options: argparse.Namespace) -> tuple[Samples, Samples | None]:
    """Return the samples to fit and those to judge on, None for leaving each out."""
    if options.validation is not None and (options.training is None or options.leave_one_out):
        raise ConfigError("--validation needs --training and excludes --leave-one-out")
    if options.training is not None:
        validation = None if options.validation is None else Samples.read(options.validation)
        return Samples.read(options.training), validation
    validation = None if options.leave_one_out else Samples.of_the_paper(VALIDATION_TABLE)
    return Samples.of_the_paper(TRAINING_TABLE), validation
