"""What each choice of the model does to its error against the paper's tables: mesh, wall, fillets, contact, ends."""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import (
    add_comparison,
    can_draw,
    points_of,
    run_of,
    status_of,
    tell_pictures,
)
from mbpam_ros.commands.workers import executor_for
from mbpam_ros.study.fe.ablations import SPREAD_POINTS, ablations, variants
from mbpam_ros.study.fe.pictures import draw_ablations
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_comparison(parser, "where runs and errors go", "six that are far apart")


def run(options: argparse.Namespace) -> int:
    """Run the variants that FILE does not hold; say the errors of each."""
    template, points, progress = run_of(options), points_of(options, SPREAD_POINTS), Progress()
    with executor_for(options, len(points) * len(variants(template))) as executor:
        pictures = can_draw(options, progress)
        result = ablations(template, options.json, executor, progress, points)
    for row in result["variants"]:
        progress.say(
            f"{row['name']}: theta {row['theta_rms_pct']:.1f} % rms, {row['theta_mean_pct']:+.1f} % mean, "
            f"{row['theta_worst_pct']:+.1f} % worst; force {row['force_rms_pct']:.1f} % rms ({row['points']} points); "
            f"folds {row['least_fold_opening']:.2f} open, arm {row['least_arm_gap_mm']:+.2f} mm from the wall"
        )
    if pictures and result["variants"]:
        picture = options.json.with_suffix(".png")
        draw_ablations(result["variants"], picture)
        tell_pictures(progress, [picture])
    return status_of(result)
