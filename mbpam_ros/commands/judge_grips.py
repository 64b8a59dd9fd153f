"""Pressure by object against pressure by mode, on random grasps: what is lost, and how hard objects are squeezed.

    mbpam judge-grips --json FILE --grasps 200
    mbpam judge-grips --json FILE --grasps 200 --seed 7     another draw

Sizes, masses, frictions and places are drawn. The arbiter is told the classes of mass and of friction, the next below.
The exit status is 1 where a grasp that the mode's pressure holds is lost.

An interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import config_path
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.grip_pressure import TABLE
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.study.grasp import compare_grips
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import file_digest, simulated_with
from mbpam_ros.terminal import Progress

_SUB_STEP_S = 0.002


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help="where the figures go")
    parser.add_argument("--grasps", type=int, default=200, metavar="N", help="how many are drawn (default: 200)")
    parser.add_argument("--seed", type=int, default=compare_grips.SEED, help=f"default: {compare_grips.SEED}")
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help=f"of grip-table (default: {TABLE})")
    parser.add_argument("--tier", choices=("arc", "rod"), default="rod", help="how muscles are computed (default: rod)")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Compare, and print the verdict."""
    gripper, grasp = load_gripper(), load_grasp_config()
    grasp = replace(grasp, grip=replace(grasp.grip, table=str(options.table)))
    request = FidelityRequest(tier=options.tier, sub_step_s=_SUB_STEP_S)
    settings = {
        **simulated_with(),
        "table": file_digest(config_path(options.table)),
        "seed": options.seed,
        "fidelity": repr(request),
    }
    kept = ResultFile(options.json, settings, "grasps", lambda row: row["job"])
    jobs = {
        name: (name, options.seed, number, request, gripper, grasp)
        for number, name in enumerate(f"grasp {each}" for each in range(options.grasps))
    }
    with executor_for(options, len(jobs)) as executor:
        run_jobs(
            jobs,
            compare_grips.compared_row,
            kept,
            executor,
            Progress(),
            compare_grips.row_text,
            s_per_job=compare_grips.S_PER_GRASP,
        )
    found = compare_grips.verdict([kept.rows[name] for name in jobs])
    kept.write(list(jobs), verdict=found)
    print(compare_grips.verdict_text(found))
    return 1 if found["lost"] else 0
