"""Whether plans keep what they promise: scenes drawn at random, each run at everything that could have been chosen.

    mbpam judge-planner --json FILE --scenes 60
    mbpam judge-planner --json FILE --scenes 60 --seed 7     another draw
    mbpam judge-planner --json FILE --table OTHER            another table than the planner's

Objects, pressures, friction (0.1 to 1), poses, lifts, strains and tolerances (0.5 to 10 % of positions) are drawn. What
is found is the error of the solution, against a converged rod with the same strains. Printed are the share of promises
that are kept, how many times too careful they are in the median, and what the choice costs over the cheapest that
holds; the exit status is 1 where one of them is not what it should be. A scene whose reference itself is not known to
half the tolerance (an object that is lost with one step and held with another) is told and not judged.

An interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import config_path
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import TABLE, load_fidelity_table
from mbpam_ros.study.fidelity import judgement
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import file_digest, simulated_with
from mbpam_ros.terminal import Progress

_S_PER_SCENE = 40.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help="where the figures go")
    parser.add_argument("--scenes", type=int, default=60, metavar="N", help="how many are drawn (default: 60)")
    parser.add_argument("--seed", type=int, default=judgement.SEED, help=f"of the draw (default: {judgement.SEED})")
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help="of the planner")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Judge, and print the verdict."""
    table, gripper, progress = load_fidelity_table(options.table), load_gripper(), Progress()
    settings = {
        **simulated_with(),
        "table": file_digest(config_path(options.table)),
        "seed": options.seed,
    }
    kept = ResultFile(options.json, settings, "judged", lambda row: row["job"])
    jobs = {
        name: (name, options.seed, number, table, gripper)
        for number, name in enumerate(f"scene {each}" for each in range(options.scenes))
    }
    with executor_for(options, len(jobs)) as executor:
        run_jobs(jobs, judgement.judged_row, kept, executor, progress, judgement.row_text, s_per_job=_S_PER_SCENE)
    rows = [kept.rows[name] for name in jobs]
    found = judgement.verdict(rows)
    kept.write(list(jobs), verdict=found)
    print(judgement.verdict_text(rows, found))
    return 0 if judgement.reached(found) else 1
