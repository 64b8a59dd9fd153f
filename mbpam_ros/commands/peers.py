"""Compare the plant's tier rod with MuJoCo and PyElastica on one problem: CPU time at equal accuracy.

Four muscles bend freely under a moment that is switched on; each simulator runs at its cheapest setting that keeps the
tips within the static and transient error (over the muscle's length). Then they also stretch and twist, hanging, and
level, where gravity twists them. Costs are of the first 0.6 s, while there is motion. With contact, a sphere is
grasped at 70 % of the pressure and lifted, both at the same step, and each at its cheapest setting that is within 1 %
of its own converged run. Needs the extra "bench".
"""

from __future__ import annotations

import argparse
import sys

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import refuse_workers
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.tiers.base import PlantConfig
from mbpam_ros.study.jobs import runs_beside
from mbpam_ros.study.peers.benchmark_peers import STRAINS, compare_with_peers, result_text
from mbpam_ros.study.peers.mujoco_model import load_mujoco
from mbpam_ros.study.peers.pyelastica_model import load_pyelastica
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the ratios and details go")
    parser.add_argument("--runs", type=int, default=7, help="interleaved runs of each pair (default: 7)")
    parser.add_argument(
        "--strains", choices=STRAINS, action="append", help="what the muscles do; may be repeated (default: both)"
    )
    refuse_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the comparison one part after the other, print it, and write JSON if asked."""
    load_mujoco()
    load_pyelastica()
    retardation_s = load_config(PlantConfig, "plant.yaml").retardation_time_s
    result = compare_with_peers(
        load_gripper(),
        retardation_s,
        options.runs,
        runs_beside(options.json),
        Progress(sys.stderr),
        options.strains or STRAINS,
    )
    if options.json is not None:
        write_json(options.json, result)
    print(result_text(result))
    return 0
