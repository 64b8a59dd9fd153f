"""What each part of a scene costs, and that it costs nothing where it is absent.

Scenes that differ from a bare one (four muscles in the air that do not meet, two modes, 2 ms, lag) in one thing each.
CPU times are the medians of several runs of the plant's steps at 100 Hz, and of the images where there is a camera; the
bare scene is run before and after, and the difference is what a figure is worth. What is absent is not even imported:
the last column. The last two scenes show what fewer modes save while an object is out of reach.
"""

from __future__ import annotations

import argparse
import sys

from mbpam_ros.commands.workers import refuse_workers
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.fidelity.absent_costs import REPEATS, S_PER_RUN, costs_text, measured_costs, variants
from mbpam_ros.terminal import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments; what is compared is fixed."""
    refuse_workers(parser)


def run(_: argparse.Namespace) -> int:
    """Print the table."""
    found, progress, turns = variants(), Progress(sys.stderr), 1 + REPEATS
    announce(f"{len(found)} scenes, each {turns} times", S_PER_RUN * len(found) * turns)
    progress.start(turns)
    print(costs_text(found, measured_costs(found, load_gripper(), progress.job_ended)))
    return 0
