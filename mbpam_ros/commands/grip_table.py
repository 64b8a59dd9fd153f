"""The least pressure that holds, over mode, width, depth, friction and mass: the table that grips are planned with.

    mbpam grip-table --json config/data/grip_pressures.json     make the shipped table anew

Beside it stands how far the fingers of an empty hand bend in each mode, which tells a held object by the air.

Every entry is found by grasps in the simulated gripper: rest, close, lift, hold for 1 s. grasp_arbiter reads the file
(grip.table of grasp.yaml) and grips an object of known mass with the pressure in it and a margin.

An interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.grasp.grip_pressure import made_with
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.study.grasp import grip_table
from mbpam_ros.study.grasp.empty_grasps import empty_rows
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import simulated_with
from mbpam_ros.terminal import Progress

_SUB_STEP_S = 0.002


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help="where the table goes")
    parser.add_argument("--tier", choices=("arc", "rod"), default="rod", help="how muscles are computed (default: rod)")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Search, and write the table."""
    request = FidelityRequest(tier=options.tier, sub_step_s=_SUB_STEP_S)
    gripper = load_gripper()
    settings = {
        "gripper": made_with(gripper),
        "highest_gauge_pa": grip_table.HIGHEST_PA,
        "step_pa": grip_table.STEP_PA,
        "resolution_pa": grip_table.RESOLUTION_PA,
        "fidelity": repr(request),
        **simulated_with(),
    }
    jobs = grip_table.jobs(request, gripper)

    def name_of(row: dict) -> str:
        return grip_table.row_name(row["mode"], row["width_m"], row["depth_m"], row["friction_coefficient"])

    kept = ResultFile(options.json, settings, "rows", name_of)
    with executor_for(options, len(jobs)) as executor:
        run_jobs(
            jobs, grip_table.table_row, kept, executor, Progress(), grip_table.row_text, s_per_job=grip_table.S_PER_JOB
        )
    rows = kept.write(list(jobs), empty=empty_rows(request, gripper))["rows"]
    print(f"{sum(row['trials'] for row in rows)} grasps, {len(rows)} rows in {options.json}")
    return 0
