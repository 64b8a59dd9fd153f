"""The whole finite element muscle in the states that the rod is set beside: pressures, loads on the tip, postures.

mbpam fe states --json FILE

FILE has a row a state, as "mbpam rod --states FILE" reads them. A job is one way: pattern and gravity, pressures
rising, loads on the tip branching off. Finished ones are kept in FILE's neighbour _paths.json, from which the same
command goes on.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_result, status_of
from mbpam_ros.commands.fe.muscle_model import add_muscle_model, muscle_model
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.state_set import PATHS, state_set
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where the states go")
    add_muscle_model(parser)
    parser.add_argument("--path", choices=list(PATHS), action="append", help="one way; may be repeated (default: all)")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the paths that FILE's neighbour does not hold."""
    model, progress = muscle_model(options), Progress()
    paths = {name: PATHS[name] for name in options.path or PATHS}
    with executor_for(options, len(paths)) as executor:
        return status_of(state_set(model, options.json, executor, progress, paths))
