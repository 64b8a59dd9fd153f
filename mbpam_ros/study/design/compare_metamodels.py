"""Command ``compare_metamodels``: metamodels of the muscle beside each other, and beside the paper's Table 3.

    compare_metamodels --json FILE                                     fitted to Table 1, judged on Table 2
    compare_metamodels --training CSV --validation CSV --json FILE     on samples of your own
    compare_metamodels --training CSV --json FILE                      judged by leaving each sample out in turn
    compare_metamodels --map FILE                                      picture of the uncertainty over the domain

Up to 40 samples, each is left out by refitting without it; with more, by the closed form of each metamodel, with length
scales and widths of all samples. The output says which, and beside each stated deviation whether it covers the errors.

A CSV has the columns a_mm, b_mm, theta_max_deg, f_max_n. The names in the table, in small letters, are those of the
estimator's parameter ``metamodel``.
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.design import DesignDomainError
from mbpam_ros.actuator.metamodel import (
    CORRELATIONS,
    METAMODELS,
    REFITTED_SAMPLES,
    TRAINING_TABLE,
    TRENDS,
    VALIDATION_TABLE,
)
from mbpam_ros.actuator.sample_check import MetamodelError
from mbpam_ros.actuator.tables import read_labelled_columns
from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.study.announcement import announce
from mbpam_ros.study.design.accuracy import JudgingError
from mbpam_ros.study.design.comparison import Judged, judge
from mbpam_ros.study.design.pictures import PictureError, draw_comparison, draw_uncertainty
from mbpam_ros.study.design.responses import published_coefficients
from mbpam_ros.study.design.samples import RESPONSES, Samples
from mbpam_ros.study.design.uncertainty import uncertain_kriging, uncertainty_map
from mbpam_ros.study.progress_bar import ProgressBar
from mbpam_ros.study.result_file import ResultFileError, write_json

_KRIGING = ("krg", "krg_nugget")


def published_errors() -> dict[tuple[str, str], dict[str, float]]:
    """Return Table 3 of the paper: ``r2``, ``rmse`` and ``mre`` (both normalised) by metamodel and response.

    Raises:
        ConfigError: the table is missing or unreadable.
    """
    errors = ("r2", "rmse", "mre")
    labels, values = read_labelled_columns(config_path("data/metamodel_errors.csv"), ("metamodel", "response"), *errors)
    return {
        (metamodel, response): dict(zip(errors, row, strict=True))
        for (metamodel, response), row in zip(labels, values.T.tolist(), strict=True)
    }


def compare(
    training: Samples,
    validation: Samples | None,
    trend: str = "constant",
    correlation: str = "gaussian",
    job_ended: Callable[[str], object] = str,
) -> dict[str, dict[str, Judged]]:
    """Return every metamodel of the package, by its name in capitals, for each response.

    Args:
        training: samples to fit.
        validation: samples to judge on; None leaves each training sample out in turn.
        trend, correlation: of both kriging metamodels.
        job_ended: called after each metamodel with a line about it.

    Raises:
        DesignDomainError, MetamodelError, JudgingError: the samples cannot be used so; the message says why.
    """
    domain = training.domain()
    table = {}
    for name, maker in METAMODELS.items():
        options = {"trend": trend, "correlation": correlation} if name in _KRIGING else {}
        table[name.upper()] = judge(functools.partial(maker, domain=domain, **options), training, validation)
        job_ended(f"{name.upper()} fitted and judged")
    return table


def expected_s(samples: int, left_out: bool) -> float:
    """Return about how long :func:`compare` takes with so many samples [s]: what it took on one core at 2.5 GHz."""
    if left_out and samples <= REFITTED_SAMPLES:
        return 0.006 * samples**2
    return 0.5 + 0.015 * samples + 50.0 * (samples / 1000.0) ** 3


def table_text(table: dict[str, dict[str, Judged]], published: dict[tuple[str, str], dict[str, float]]) -> str:
    """Return the table as text: errors in the paper's normalisation and in physical units, then times.

    A line ``paper`` follows each metamodel that ``published`` knows.
    """
    lines = []
    for key, unit in RESPONSES.items():
        lines += [
            f"{key} [{unit}]",
            f"  {'metamodel':<14}{'R2':>9}{'RMSE/range':>12}{'MRE/range':>11}{'RMSE':>10}{'MRE':>10}"
            f"{'fit [ms]':>11}{'1 eval [us]':>13}{'10 000 [ms]':>13}",
        ]
        for name, judged in table.items():
            error, speed = judged[key].accuracy, judged[key].speed
            lines.append(
                f"  {name:<14}{error.r2:>9.4f}{error.rmse_normalised:>12.4f}{error.mre_normalised:>11.4f}"
                f"{error.rmse:>10.4f}{error.mre:>10.4f}{1e3 * speed.fit_s:>11.2f}"
                f"{1e6 * speed.one_evaluation_s:>13.1f}{1e3 * speed.ten_thousand_evaluations_s:>13.2f}"
            )
            if (name, key) in published:
                paper = published[name, key]
                lines.append(f"  {'  paper':<14}{paper['r2']:>9.4f}{paper['rmse']:>12.4f}{paper['mre']:>11.4f}")
    ways = dict.fromkeys(judged[key].held_back for judged in table.values() for key in RESPONSES)
    for way in ways:
        names = [name for name, judged in table.items() if any(judged[key].held_back == way for key in RESPONSES)]
        lines.append(f"held back: {way} ({', '.join(names)})")
    for name, judged in table.items():
        lines += [
            f"  {name:<14}{key:<10} {coverage.text()}"
            for key in RESPONSES
            if (coverage := judged[key].coverage) is not None
        ]
    lines += ["fitted"]
    for name, judged in table.items():
        for key in RESPONSES:
            chosen = ", ".join(f"{what} {_short(value)}" for what, value in judged[key].parameters.items())
            lines.append(f"  {name:<14}{key:<10} {chosen}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _parser().parse_args(arguments)
    try:
        training, validation = _samples(options)
        training.domain()  # refuses before anything is announced
        jobs = ProgressBar(sys.stderr)
        slow = announce(
            f"{len(METAMODELS)} metamodels of {len(training.design_mm)} samples, judged"
            + (" by leaving each out" if validation is None else ""),
            expected_s(len(training.design_mm), validation is None),
        )
        if slow:
            jobs.start(len(METAMODELS), 0)
        table = compare(training, validation, options.trend, options.correlation, jobs.job_ended if slow else str)
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
    except (ConfigError, DesignDomainError, MetamodelError, JudgingError, PictureError, ResultFileError) as error:
        print(f"compare_metamodels: {error}", file=sys.stderr)
        return 1
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "compare_metamodels", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the figures go")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    parser.add_argument("--training", type=Path, metavar="CSV", help="samples to fit (default: the paper's Table 1)")
    parser.add_argument(
        "--validation", type=Path, metavar="CSV", help="samples to judge on (default: leave each sample out)"
    )
    parser.add_argument("--leave-one-out", action="store_true", help="judge the paper's samples so, not on Table 2")
    parser.add_argument("--map", type=Path, metavar="FILE", help="where the map of kriging's uncertainty goes")
    parser.add_argument("--trend", choices=TRENDS, default="constant", help="of kriging")
    parser.add_argument("--correlation", choices=CORRELATIONS, default="gaussian", help="of kriging")
    return parser


def _short(value: object) -> str:
    if isinstance(value, list):
        return "(" + ", ".join(f"{item:.4f}" for item in value) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    raise SystemExit(main())
