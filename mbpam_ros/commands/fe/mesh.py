"""Error of the meshes: free bend at 100 kPa of four designs on each mesh, against that of the finest one."""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_model, add_reading, add_result, run_of, status_of
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.design_run import DEFAULT_MESH, MESHES
from mbpam_ros.study.fe.mesh_error import DESIGNS, REFINED, mesh_errors
from mbpam_ros.terminal import Progress, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where bends and errors go")
    add_reading(parser)
    add_model(parser)
    parser.set_defaults(mesh=DEFAULT_MESH)  # whose wall all take
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the bends that FILE does not hold; say the error of each mesh."""
    template, progress = run_of(options), Progress()
    with executor_for(options, len(DESIGNS) * (len(MESHES) + len(REFINED))) as executor:
        result = mesh_errors(template, options.json, executor, progress)
    designs = list(dict.fromkeys(design for found in result["errors"].values() for design in found["by_design_pct"]))
    rows = [
        [mesh, *(f"{found['by_design_pct'].get(design, float('nan')):+.2f} %" for design in designs)]
        for mesh, found in result["errors"].items()
    ]
    progress.say(table(["mesh", *designs], rows))
    return status_of(result)
