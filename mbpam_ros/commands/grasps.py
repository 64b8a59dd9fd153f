"""The paper's five grasps, the least pressure that holds each, and what holds it.

    mbpam grasps --json FILE                              the designs initial and optimised, in tier rod
    mbpam grasps --tier arc --design initial              another tier, one design
    mbpam grasps --strains bend stretch twist             muscles that stretch and twist, tier rod
    mbpam grasps --objects bulb own_scene.yaml            other scenes, by name or file

Each grasp runs without ROS through the gripper's own sensing, mode selection, arbitration and pressure loops: rest,
close, lift, hold for 1 s. An object is held if it rose with the hand and rests in it; only the contact model decides.
What still holds with next to no friction (0.05) is held by caging, what does not, by friction.

With --json, an interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

from mbpam_ros.actuator.named_designs import INITIAL, load_design
from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.plant.scene import PAPER_SCENES, Scene, load_scene
from mbpam_ros.study.grasp.grasp_study import S_PER_STUDY, grasp_row, grasp_values, result_text, row_text, settings
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the figures go")
    parser.add_argument(
        "--design",
        nargs="+",
        default=[INITIAL, "optimised"],
        metavar="NAME",
        help="designs by name, side by side (default: initial optimised)",
    )
    parser.add_argument("--tier", choices=("arc", "rod"), default="rod", help="how muscles are computed (default: rod)")
    parser.add_argument(
        "--strains", nargs="+", choices=STRAINS, help="what the muscles do (default: as the scenes have it)"
    )
    parser.add_argument(
        "--objects", nargs="+", default=PAPER_SCENES, metavar="NAME", help="scenes, by name or file (default: the five)"
    )
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Search, and print the table."""
    gripper = load_gripper()
    grippers = {name: replace(gripper, design=load_design(name)) for name in options.design}
    scenes = _scenes(options.objects, options.tier, options.strains)
    jobs = {
        f"{scene.name}, {design}": (scene, request, each, design)
        for scene, request in scenes
        for design, each in grippers.items()
    }
    kept = ResultFile(
        options.json, settings(options.tier, scenes), "grasps", lambda row: f"{row['scene']}, {row['design']}"
    )
    started_s = time.monotonic()
    with executor_for(options, len(jobs)) as executor:
        run_jobs(jobs, grasp_values, kept, executor, Progress(), row_text, s_per_job=S_PER_STUDY[options.tier])
    rows = [grasp_row(row) for row in kept.write(list(jobs))["grasps"]]
    print(result_text(rows))
    trials = sum(row.trials for row in rows)
    print(f"{trials} grasps in {time.monotonic() - started_s:.0f} s, tier {options.tier}")
    return 0


def _scenes(names: list[str], tier: str, strains: Sequence[str] | None) -> list[tuple[Scene, FidelityRequest]]:
    scenes = [load_scene(name) for name in names]
    for scene, _ in scenes:
        if scene.object is None:
            raise ConfigError(f"scene {scene.name}: nothing to grasp; name an object in it")
        if sum(each.name == scene.name for each, _ in scenes) > 1:
            raise ConfigError(f"scene {scene.name}: there are two of this name; rename the file of one")
    found = [(scene, request.in_tier(tier)) for scene, request in scenes]
    return found if strains is None else [(scene, replace(request, strains=tuple(strains))) for scene, request in found]
