"""The arguments of the verbs that run all of the muscle: its mesh, wall, waves and ends."""

from __future__ import annotations

import argparse
from dataclasses import replace

from mbpam_ros.commands.fe.model import ArgumentError
from mbpam_ros.study.fe.loaded_muscle import MESHES, MuscleModel


def add_muscle_model(parser: argparse.ArgumentParser) -> None:
    """Add how the muscle is modelled."""
    default = MuscleModel()
    parser.add_argument("--mesh", choices=MESHES, default=default.mesh, help=f"elements (default: {default.mesh})")
    parser.add_argument("--wall", type=float, default=default.geometry.c_mm, metavar="C", help="wall c [mm]")
    parser.add_argument("--waves", type=int, default=int(default.geometry.wave_count), metavar="N")
    parser.add_argument("--end-length", type=float, default=default.end_length_mm, metavar="MM")
    parser.add_argument(
        "--end-weight",
        type=float,
        default=default.end_weight_factor,
        metavar="F",
        help="of the ends, per length, over waves'",
    )


def muscle_model(options: argparse.Namespace) -> MuscleModel:
    """Return the muscle that the arguments describe.

    Raises:
        ArgumentError: there is no such muscle.
    """
    try:
        geometry = replace(MuscleModel().geometry, c_mm=options.wall, wave_count=float(options.waves))
        return MuscleModel(geometry, options.mesh, options.end_length, options.end_weight)
    except ValueError as error:
        raise ArgumentError(str(error)) from error
