"""The designs that bend furthest and press hardest: optimisers beside the front of a dense grid, and a compromise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mbpam_ros.actuator.metamodel import METAMODELS, REFITTED_SAMPLES
from mbpam_ros.actuator.tables import read_table
from mbpam_ros.study.design.evaluations import Evaluations
from mbpam_ros.study.design.improvement import Reference, gains
from mbpam_ros.study.design.mopso import mopso
from mbpam_ros.study.design.nsga2 import nsga2
from mbpam_ros.study.design.pareto import Front, grid_front, hypervolume_ratio
from mbpam_ros.study.design.responses import Responses, fitted_responses
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.design.uncertainty import kriging_sigma, left_out, uncertain_kriging
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import sources_digest, versions
from mbpam_ros.terminal import Progress

ALGORITHMS: dict[str, Callable[[Evaluations, int], None]] = {"mopso": mopso, "nsga2": nsga2}
LEAST_HYPERVOLUME_RATIO = 0.995
GRID = 401
_COLUMNS = ("a_mm", "b_mm", "theta_deg", "f_n")


@dataclass(frozen=True)
class Run:
    """One run of one algorithm: its front, and the front's hypervolume over that of the dense grid's."""

    algorithm: str
    seed: int
    evaluations: int
    front: Front
    hypervolume_ratio: float


@dataclass(frozen=True)
class Question:
    """What is optimised.

    Args:
        name: of the metamodel.
        samples: that it is fitted to, and the others that it is compared with.
        responses: that it gives.
        truth: front of a dense grid of them.
        initial: design that gains are measured by, if there is one.
    """

    name: str
    samples: Samples
    responses: Responses
    truth: Front
    initial: Reference | None

    def settings(self) -> dict[str, object]:
        """Return what all results depend on."""
        pymoo = ["pymoo"] if find_spec("pymoo") else []
        return {
            "sources": sources_digest(),
            "versions": versions("numpy", "scipy", *pymoo),
            "metamodel": self.name,
            "samples": self.samples.digest(),
            "initial": None if self.initial is None else asdict(self.initial),
        }


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


def run_all(
    question: Question,
    wanted: Sequence[tuple[str, int]],
    executor: Executor,
    progress: Progress,
    kept_in: Path | None = None,
) -> tuple[list[Run], dict[str, dict[str, float | None]]]:
    """Run pairs of algorithm and seed, and compare the metamodels.

    Args:
        question: what is optimised.
        wanted: the pairs.
        executor: where they run.
        progress: told of each.
        kept_in: file of what is finished, which is not run again; none to keep nothing.

    Returns:
        :func:`optimise` of the pairs, in their order, and what the grid front of each metamodel offers over the initial
        design: how far the models disagree. Without an initial design that is empty.

    Raises:
        DesignDomainError, MetamodelError: the samples do not determine a metamodel.
        FrontError, OptimisationError: as :func:`optimise`.
        ResultFileError: ``kept_in`` cannot be written, or is no such file.
    """
    runs = {f"{algorithm}, seed {seed}": (question, algorithm, seed) for algorithm, seed in wanted}
    compared = {} if question.initial is None else {f"gains by {name}": (question, name) for name in METAMODELS}
    jobs: dict[str, tuple] = {
        **{name: (name, _run_values, *arguments) for name, arguments in runs.items()},
        **{name: (name, metamodel_gains, *arguments) for name, arguments in compared.items()},
    }
    kept = ResultFile(kept_in, question.settings(), "runs", _job_of)
    run_jobs(jobs, _row, kept, executor, progress, _job_of)
    rows = {_job_of(row): row["found"] for row in kept.write(list(jobs))["runs"]}
    return [_run_of(rows[name]) for name in runs], {name: rows[f"gains by {name}"] for name in METAMODELS if compared}


def metamodel_gains(question: Question, name: str) -> dict[str, float | None]:
    """Return what the grid front of one metamodel offers over the initial design.

    Raises:
        DesignDomainError, MetamodelError: the samples do not determine it.
    """
    if question.initial is None:
        return {}
    responses = fitted_responses(name, question.samples)
    return asdict(gains(grid_front(responses.objectives, responses.domain, 201), question.initial))


def _row(job: str, work: Callable[..., dict], *arguments: object) -> dict:
    return {"job": job, "found": work(*arguments)}


def _job_of(row: dict) -> str:
    job: str = row["job"]
    return job


def _run_values(question: Question, algorithm: str, seed: int) -> dict:
    run = optimise(question.responses, question.truth, algorithm, seed)
    front = {"design_mm": run.front.design_mm.tolist(), "values": run.front.values.tolist()}
    return {**asdict(run), "front": front}


def _run_of(values: dict) -> Run:
    return Run(**{**values, "front": Front(*(np.array(values["front"][key]) for key in ("design_mm", "values")))})


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
        f"hypervolume over that of the front of a {GRID} x {GRID} grid, both against that front's worst values:",
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


def sigma_values(samples: Samples, chosen: dict) -> dict[str, object]:
    """Return the deviations that kriging states for the chosen design, and whether such deviations cover its errors."""
    kriging = uncertain_kriging(samples)
    sigma = kriging_sigma(kriging, [[chosen["a_mm"], chosen["b_mm"]]])
    _, coverage = left_out(samples, kriging)
    return {
        "theta_sigma_deg": float(sigma["theta_max"][0]),
        "f_sigma_n": float(sigma["f_max"][0]),
        "sigma_coverage": {key: found.as_json() for key, found in coverage.items()},
        "sigma_verdict": {key: found.text() for key, found in coverage.items()},
    }


def _gains_text(offered: dict) -> str:
    force, angle = offered["gain_force_at_equal_angle_pct"], offered["gain_angle_at_equal_force_pct"]
    return f"force at equal angle {_percent(force)}, angle at equal force {_percent(angle)}"


def _percent(value: float | None) -> str:
    return "beyond the front" if value is None else f"{value:+.2f} %"
