"""Effect of the lengths a, b and c and of the number of waves n on bend and blocked force, as the paper's figure 6."""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import (
    add_mesh,
    add_model,
    add_pictures,
    add_reading,
    add_result,
    can_draw,
    run_of,
    status_of,
    tell_pictures,
)
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.effects import LEVELS, effects
from mbpam_ros.study.fe.mesh_error import mesh_error_text
from mbpam_ros.study.fe.pictures import draw_effects
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "where designs and trends go")
    add_reading(parser)
    add_mesh(parser)
    add_model(parser)
    add_pictures(parser)
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the levels that FILE does not hold; say each trend beside the paper's."""
    template, progress = run_of(options), Progress()
    with executor_for(options, sum(map(len, LEVELS.values()))) as executor:
        pictures = can_draw(options, progress)
        result = effects(template, options.json, executor, progress)
    for row in result["trends"]:
        verdict = "agrees" if row["agrees"] else "DISAGREES"
        progress.say(f"{row['parameter']} {row['quantity']}: {row['found']} (paper: {row['paper']}) {verdict}")
    progress.say(mesh_error_text(template.resolution))
    if pictures and result["designs"]:
        picture = options.json.with_suffix(".png")
        draw_effects(result["designs"], picture)
        tell_pictures(progress, [picture])
    return status_of(result)
