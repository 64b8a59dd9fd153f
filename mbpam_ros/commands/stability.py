"""Where the plant's steps are stable, over step size, contact stiffness and tier.

    mbpam stability                     steps from 0.01 ms to 1 s, stiffnesses from 100 N/m to 1e8 N/m; two minutes
    mbpam stability --quick             a coarse map, in seconds
    mbpam stability --json FILE         the map as a list of cells; the same command goes on from an interrupted one

In each cell the four muscles close on a sphere (60 mm, 46 g) that stands between them: the air rises to 80 kPa in 0.3 s
and stays for 0.5 s (free 2 s), or five steps where that is longer. The stiffness is that of muscles on the object and
on each other; the column "free" has no object, and fingers that pass through each other. What is printed:

    3.1     at rest where it belongs; what is left of the forces on the object is 3.1 % of its weight
    8 mm off  at rest, but so far from where steps of 0.5 ms leave it; up to 1 mm is where it belongs
    moving  finite, but not at rest when the time is over
    stop N  a typed error, which says what to change; N is its line below the map

A number that is not finite, or an error of another kind, is a fault of the plant: the command then fails.
"""

from __future__ import annotations

import argparse
import sys

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study import stability_map
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import PATIENCE_S, Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the cells go")
    parser.add_argument("--quick", action="store_true", help="a coarse map")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Print the map; return 1 if the plant has a fault."""
    jobs = stability_map.cell_jobs(
        stability_map.QUICK_STEPS_S if options.quick else stability_map.STEPS_S,
        stability_map.QUICK_STIFFNESSES_N_M if options.quick else stability_map.STIFFNESSES_N_M,
    )
    kept = ResultFile(options.json, stability_map.settings(), "cells", stability_map.row_name)
    progress = Progress(sys.stderr, silent=stability_map.S_PER_CELL * len(jobs) <= PATIENCE_S)
    with executor_for(options, len(jobs)) as executor:
        run_jobs(
            jobs,
            stability_map.cell_row,
            kept,
            executor,
            progress,
            stability_map.row_name,
            s_per_job=stability_map.S_PER_CELL,
        )
    cells = [stability_map.Cell(**row) for row in kept.write(list(jobs))["cells"]]
    print(stability_map.map_text(cells), end="")
    faults = [cell for cell in cells if cell.outcome == "fault"]
    if faults:
        print(f"mbpam stability: {len(faults)} cells ended neither finite nor in a typed error", file=sys.stderr)
    return 1 if faults else 0
