"""Unit cells with unequal chamber pressures: the moment that holds the section straight, and the free bend."""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_mesh, add_model, add_reading, add_result, run_of, status_of
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.unequal_pressures import SHARES, unequal_table
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where the rows go")
    add_reading(parser)
    add_mesh(parser)
    add_model(parser)
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the sets of pressures that FILE does not hold."""
    template = run_of(options)
    with executor_for(options, len(SHARES)) as executor:
        return status_of(unequal_table(template, options.json, executor, Progress()))
