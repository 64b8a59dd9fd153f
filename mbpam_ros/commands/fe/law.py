"""Moment, gas volume, stretch, EA and GJ of the initial design: what the rod's law is made from."""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_mesh, add_model, add_reading, add_result, run_of, status_of
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.law_table import PRESSURES_KPA, law_table
from mbpam_ros.study.fe.mesh import PATTERNS
from mbpam_ros.study.fe.mesh_error import mesh_error_text
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where the law goes")
    add_reading(parser)
    add_mesh(parser)
    add_model(parser)
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the pressures that FILE does not hold."""
    template, progress = run_of(options), Progress()
    with executor_for(options, len(PATTERNS) * len(PRESSURES_KPA)) as executor:
        result = law_table(template, options.json, executor, progress)
    progress.say(mesh_error_text(template.resolution))
    return status_of(result)
