"""Whether the rig and its calibration find hidden muscles: factors, bends before and after, and their deviations.

    mbpam judge-rig --json FILE                   20 hidden muscles
    mbpam judge-rig --muscles 100 --json FILE

Each is drawn from its seed, measured on the simulated rig (scene rig: noise of pressures, camera and scale, tilt of
the camera, remounting, creep, hysteresis), fitted, and then estimated hanging in the gripper. Exit code 1 unless all
factors are within 2 %, bends within 2 deg rms, and the deviations cover 68 and 90 % of the errors.
"""

from __future__ import annotations

import argparse
import dataclasses

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.study.provenance import simulated_with
from mbpam_ros.study.rig import judge
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the result goes")
    parser.add_argument("--muscles", type=int, default=20, metavar="N", help="hidden muscles (default 20)")
    parser.add_argument("--seed", type=int, default=0, help="of the first one (default 0)")
    parser.add_argument("--repeats", type=int, default=2, metavar="N", help="ramps of each mount (default 2)")
    parser.add_argument("--step-kpa", type=float, default=10.0, metavar="P", help="between pressures (default 10)")
    parser.add_argument("--gripper", default="gripper.yaml", metavar="FILE")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Judge, print the table, and return 1 if it does not keep what is promised."""
    if options.muscles < 1 or options.repeats < 1 or not 1.0 <= options.step_kpa <= 50.0 or options.seed < 0:
        raise ConfigError("give one muscle or more, one repeat or more, 1 to 50 kPa between pressures, a seed from 0")
    gripper, config = load_gripper(options.gripper), load_scene("rig")[0].rig
    if config is None:
        raise ConfigError("scene rig has no rig")
    if gripper.target == "measured":
        gripper = dataclasses.replace(gripper, target="test")
    jobs = {}
    for seed in range(options.seed, options.seed + options.muscles):
        hidden = dataclasses.replace(config, muscle_seed=seed)
        jobs[str(seed)] = (gripper, hidden, options.repeats, options.step_kpa)
    settings = {"repeats": options.repeats, "step_kpa": options.step_kpa, **simulated_with()}
    kept = ResultFile(options.json, settings, "muscles", lambda row: str(row["seed"]))
    with executor_for(options, len(jobs)) as executor:
        run_jobs(jobs, judge.judged_row, kept, executor, Progress(), judge.row_text, s_per_job=judge.S_PER_MUSCLE)
    found = judge.verdict([kept.rows[name] for name in jobs])
    kept.write(list(jobs), verdict=found)
    print(judge.verdict_text(found))
    return 0 if judge.is_good(found) else 1
