"""The housing with four seats for the muscles of gripper.yaml, to print.

    mbpam palm --out DIR       palm.stl and palm.3mf, in gripper_base

It needs the extra "cad".
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.result_arguments import result_folder
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.muscle.moulds import palm_of
from mbpam_ros.study.muscle.solids import write_3mf, write_stl


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--out", type=result_folder, required=True, metavar="DIR", help="where the files go")
    parser.add_argument("--gripper", default="gripper.yaml", metavar="FILE")


def run(options: argparse.Namespace) -> int:
    """Make and write the housing."""
    palm = palm_of(load_gripper(options.gripper))
    options.out.mkdir(parents=True, exist_ok=True)
    write_stl(palm, options.out / "palm.stl")
    write_3mf(palm, options.out / "palm.3mf")
    print(f"palm: {1e-3 * palm.volume():.0f} cm3, in {options.out}")
    return 0
