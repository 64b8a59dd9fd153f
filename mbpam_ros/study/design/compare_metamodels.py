"""Metamodels of the muscle beside each other, and beside the paper's Table 3."""

from __future__ import annotations

import functools
from concurrent.futures import Executor
from pathlib import Path

from mbpam_ros.actuator.design import MetamodelName
from mbpam_ros.actuator.metamodel import METAMODELS, REFITTED_SAMPLES
from mbpam_ros.actuator.tables import read_labelled_columns
from mbpam_ros.configuration import config_path
from mbpam_ros.study.design.comparison import Judged, judge
from mbpam_ros.study.design.samples import RESPONSES, Samples
from mbpam_ros.study.executors import ThisProcess
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import machine, sources_digest, versions
from mbpam_ros.terminal import Progress

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
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept_in: Path | None = None,
) -> dict[str, dict[str, Judged]]:
    """Return every metamodel of the package, by its name in capitals, for each response.

    Args:
        training: samples to fit.
        validation: samples to judge on; None leaves each training sample out in turn.
        trend, correlation: of both kriging metamodels.
        executor: where they are fitted; none for this process.
        progress: told of each; none for silence.
        kept_in: file of those that are finished, which are not judged again; none to keep nothing.

    Raises:
        DesignDomainError, MetamodelError, JudgingError: the samples cannot be used so; the message says why.
        ResultFileError: ``kept_in`` cannot be written, or is no such file.
    """
    progress = progress or Progress(silent=True)
    jobs = {name.upper(): (name, training, validation, trend, correlation) for name in METAMODELS}
    settings = {
        "sources": sources_digest(),
        "machine": machine(),  # of the times
        "versions": versions("numpy", "scipy"),
        "training": training.digest(),
        "validation": None if validation is None else validation.digest(),
        "trend": trend,
        "correlation": correlation,
    }
    kept = ResultFile(kept_in, settings, "metamodels", lambda row: row["metamodel"])
    run_jobs(jobs, judge_metamodel, kept, executor or ThisProcess(), progress, _text)
    rows = kept.write(list(jobs))["metamodels"]
    return {row["metamodel"]: {key: Judged.of_row(row["judged"][key]) for key in RESPONSES} for row in rows}


def judge_metamodel(
    name: MetamodelName, training: Samples, validation: Samples | None, trend: str, correlation: str
) -> dict[str, object]:
    """Return one of them for each response, as plain values; arguments and errors as for :func:`compare`."""
    options = {"trend": trend, "correlation": correlation} if name in _KRIGING else {}
    judged = judge(functools.partial(METAMODELS[name], domain=training.domain(), **options), training, validation)
    return {"metamodel": name.upper(), "judged": {key: each.row() for key, each in judged.items()}}


def _text(row: dict) -> str:
    return f"{row['metamodel']} fitted and judged"


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


def _short(value: object) -> str:
    if isinstance(value, list):
        return "(" + ", ".join(f"{item:.4f}" for item in value) + ")"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
