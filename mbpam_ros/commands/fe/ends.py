"""What the muscle's two ends add to its rod of unit cells: a turn, a length and a shift of the axis, over pressure.

mbpam fe ends --json FILE

A short muscle without weight is set beside the unit cell on the same mesh, for PDC and PSC. The rod with ends of
silicone reads FILE from the configuration as fe_ends.json.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_result, status_of
from mbpam_ros.commands.fe.muscle_model import add_muscle_model, muscle_model
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.end_effect import end_effect_table
from mbpam_ros.study.fe.mesh import PATTERNS
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where the ends' effect goes")
    add_muscle_model(parser)
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the patterns that FILE does not hold."""
    model, progress = muscle_model(options), Progress()
    with executor_for(options, len(PATTERNS)) as executor:
        return status_of(end_effect_table(model, options.json, executor, progress))
