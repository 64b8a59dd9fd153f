"""The finite element muscle beside the paper's: 32 designs (Tables 1, 2, 5) and the measured PSC."""

from __future__ import annotations

import argparse
import json

from mbpam_ros.commands.fe.model import (
    add_comparison,
    can_draw,
    points_of,
    run_of,
    status_of,
    tell_pictures,
)
from mbpam_ros.commands.workers import executor_for
from mbpam_ros.study.fe.mesh_error import mesh_error_text
from mbpam_ros.study.fe.paper_comparison import compare_with_paper, draw_comparison
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_comparison(parser, "where the comparison goes", "all")


def run(options: argparse.Namespace) -> int:
    """Run the designs that FILE does not hold; print the errors."""
    template, points, progress = run_of(options), points_of(options), Progress()
    with executor_for(options, len(points)) as executor:
        pictures = can_draw(options, progress)
        result = compare_with_paper(template, options.json, executor, progress, points)
        progress.say(json.dumps(result["errors"], indent=1))
        progress.say(mesh_error_text(template.resolution))
        if pictures and result["points"]:
            tell_pictures(progress, draw_comparison(template, result, options.json, executor, progress))
    return status_of(result)
