"""Whether a hand that holds something knows it: random grasps with noise, told by air, by camera and by both.

    mbpam judge-holding --json FILE --grasps 200
    mbpam judge-holding --json FILE --grasps 200 --valve-sigma 0.03     valves known to 3 %
    mbpam judge-holding --json FILE --grasps 300 --seed 9 --fit         weights for grasp.yaml, from these grasps

Objects of all modes are gripped as the arbiter grips, or too weakly, or were taken away after they were seen. Printed
is how often full and empty hands are told so, and the opposite; the exit status is 1 where both senses together call
more than 2 % of the empty hands held, or more than 5 % of the full ones empty.

An interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import config_path
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.empty_hand import load_empty_hand
from mbpam_ros.grasp.grip_pressure import TABLE
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.study.grasp import holding_trial, holding_verdict
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import file_digest, simulated_with
from mbpam_ros.terminal import Progress

SEED = 701
_SUB_STEP_S = 0.002


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help="where the figures go")
    parser.add_argument("--grasps", type=int, default=200, metavar="N", help="how many are drawn (default: 200)")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of the draw (default: {SEED})")
    parser.add_argument(
        "--valve-sigma",
        type=float,
        default=holding_trial.VALVE_SIGMA,
        metavar="X",
        help=f"error of a valve's flow, relative (default: {holding_trial.VALVE_SIGMA})",
    )
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help=f"of grip-table (default: {TABLE})")
    parser.add_argument("--tier", choices=("arc", "rod"), default="rod", help="how muscles are computed (default: rod)")
    parser.add_argument("--fit", action="store_true", help="print the weights that these grasps ask for")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Judge, and print the verdict."""
    config, gripper = load_grasp_config(), load_gripper()
    request = FidelityRequest(tier=options.tier, sub_step_s=_SUB_STEP_S)
    settings = {
        **simulated_with(),
        "table": file_digest(config_path(options.table)),
        "seed": options.seed,
        "valve_sigma": options.valve_sigma,
        "fidelity": repr(request),
    }
    kept = ResultFile(options.json, settings, "grasps", lambda row: row["job"])
    empty = load_empty_hand(options.table)
    jobs = {
        name: (name, options.seed, number, options.valve_sigma, request, gripper, config, empty)
        for number, name in enumerate(f"grasp {each}" for each in range(options.grasps))
    }
    with executor_for(options, len(jobs)) as executor:
        run_jobs(
            jobs, holding_trial.felt_row, kept, executor, Progress(), _row_text, s_per_job=holding_trial.S_PER_GRASP
        )
    rows = [kept.rows[name] for name in jobs]
    found = holding_verdict.verdict(rows, config.holding)
    kept.write(list(jobs), verdict=found)
    print(holding_verdict.verdict_text(found))
    if options.fit:
        print(json.dumps(holding_verdict.fitted(rows, config.holding), indent=1))
    return 0 if holding_verdict.reached(found) else 1


def _row_text(row: dict) -> str:
    if row["held"] is None:
        return f"{row['job']}: {row['note']}"
    felt = "-" if row["shortfall_deg"] is None else f"{row['shortfall_deg']:.0f} deg"
    shown = "-" if row["size_ratio"] is None else f"{row['size_ratio']:.2f}"
    outcome = "held" if row["held"] else "empty"
    return f"{row['job']}, {row['mode']}, {row['case']}: {outcome}; shortfall {felt}, size ratio {shown}"
