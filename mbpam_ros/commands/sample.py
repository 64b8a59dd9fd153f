"""Where to run finite elements (or build muscles) so that few samples tell most.

    mbpam sample --csv FILE                                 21 designs over (a, b), as many as the paper's
    mbpam sample --variables a,b,c,n --count 40 --csv FILE  over all four design variables

An optimal Latin hypercube: SciPy's, its centred discrepancy lowered by exchanges. How it fills the space is printed
beside the paper's 21 points.

With --json, finished restarts are kept in FILE_runs.json, from which the same command goes on.
"""

from __future__ import annotations

import argparse
import sys

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.design.latin_hypercube import S_PER_POINT
from mbpam_ros.study.design.pictures import draw_sampling
from mbpam_ros.study.design.sample_design import VARIABLES, sampled_design
from mbpam_ros.study.jobs import runs_beside
from mbpam_ros.study.result_file import write_json, write_text
from mbpam_ros.terminal import PATIENCE_S, Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--variables", choices=VARIABLES, default="a,b")
    parser.add_argument("--count", type=int, default=21, metavar="N", help="number of designs (default: 21)")
    parser.add_argument("--seed", type=_seed, default=0, help="equal seeds give equal designs (default: 0)")
    parser.add_argument("--restarts", type=int, default=8, metavar="N", help="designs to choose from (default: 8)")
    parser.add_argument("--csv", type=result_file, metavar="FILE", help="where the designs go")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where designs and figures go")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Print the designs and how they fill their space."""
    with executor_for(options, options.restarts) as executor:
        found = sampled_design(
            options.variables,
            options.count,
            options.seed,
            options.restarts,
            executor,
            Progress(sys.stderr, silent=S_PER_POINT * options.count * options.restarts <= PATIENCE_S),
            runs_beside(options.json),
        )
    print(found.csv_text())
    print(found.figures_text())
    if options.csv is not None:
        write_text(options.csv, found.csv_text())
    if options.json is not None:
        write_json(options.json, found.as_json())
    if options.picture is not None:
        draw_sampling(found.points, found.names, found.paper, options.picture)
    return 0


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError("a seed is not negative")
    return seed
