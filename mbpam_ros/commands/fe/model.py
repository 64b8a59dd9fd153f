"""The arguments of the verbs that run the unit cell: its model, the designs, where results go."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.fe.design_run import DEFAULT_MESH, FAST_MESH, FAST_WALL_MM, MESHES, Run
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.paper_comparison import PaperPoint, paper_points
from mbpam_ros.study.fe.posture import END_LENGTH_MM, END_WEIGHT_FACTOR
from mbpam_ros.study.pictures import PictureError, require_matplotlib
from mbpam_ros.study.silicone.known import yeoh_constants_of
from mbpam_ros.terminal import Progress


class ArgumentError(MbpamError, ValueError):
    """The arguments describe no muscle; the message says what is wrong."""


def add_result(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help=what)


def add_mesh(parser: argparse.ArgumentParser) -> None:
    """Add which elements a muscle is made of."""
    mesh = parser.add_mutually_exclusive_group()
    mesh.add_argument("--mesh", choices=MESHES, default=DEFAULT_MESH, help=f"elements (default: {DEFAULT_MESH})")
    mesh.add_argument(
        "--fast",
        dest="mesh",
        action="store_const",
        const=FAST_MESH,
        help=f"the mesh {FAST_MESH}: fast, bends 5 to 25 %% too little, so the wall is {FAST_WALL_MM:g} mm",
    )


def add_model(parser: argparse.ArgumentParser) -> None:
    """Add how a muscle is modelled, but for its elements."""
    default = CellGeometry()
    parser.add_argument(
        "--wave-fillet", type=float, metavar="MM", help="radius of crests and valleys (default: cosine)"
    )
    parser.add_argument(
        "--corner-fillet", type=float, default=0.0, metavar="MM", help="radius of the chambers' corners"
    )
    parser.add_argument(
        "--silicone",
        metavar="NAME",
        help="of config/silicones.yaml, or a file of mbpam silicone (default: the paper's)",
    )
    parser.add_argument("--self-contact", action="store_true", help="let the arms of the cross rest on the wall")
    parser.add_argument("--active-length", type=float, default=default.active_length_mm, metavar="MM")
    parser.add_argument("--end-length", type=float, default=END_LENGTH_MM, metavar="MM")
    parser.add_argument(
        "--end-weight", type=float, default=END_WEIGHT_FACTOR, metavar="F", help="of the ends, per length, over waves'"
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add what the paper does not state of its designs."""
    default = CellGeometry()
    parser.add_argument(
        "--wall",
        type=float,
        metavar="C",
        help=f"wall c of the designs [mm] (default: {default.c_mm:g}; of the mesh {FAST_MESH} {FAST_WALL_MM:g})",
    )
    parser.add_argument("--waves", type=float, default=default.wave_count, metavar="N", help="waves of the designs")


def add_points(parser: argparse.ArgumentParser, default: str) -> None:
    """Add which of the paper's designs are run."""
    parser.add_argument(
        "--points", metavar="NAME,...", help=f"designs of the paper to run, such as table_2:1 (default: {default})"
    )


def add_pictures(parser: argparse.ArgumentParser) -> None:
    """Add whether pictures are drawn."""
    parser.add_argument("--no-pictures", dest="pictures", action="store_false", help="write numbers only")


def add_comparison(parser: argparse.ArgumentParser, what: str, points: str) -> None:
    """Add all arguments of a verb that sets designs of the paper beside it: ``what`` it writes, the default points."""
    add_result(parser, what)
    add_points(parser, points)
    add_reading(parser)
    add_mesh(parser)
    add_model(parser)
    add_pictures(parser)
    add_workers(parser)


def run_of(options: argparse.Namespace, design: Sequence[float] | None = None, pattern: str = "pdc") -> Run:
    """Return the run that the arguments describe.

    Args:
        options: of :func:`add_mesh`, :func:`add_model` and, without a design, :func:`add_reading`.
        design: a, b, c [mm] and the number of waves; none for the initial a and b with the reading's c and waves.
        pattern: of the pressures.

    Raises:
        ArgumentError: there is no such muscle.
    """
    geometry = CellGeometry()
    a_mm, b_mm, c_mm, waves = design or (geometry.a_mm, geometry.b_mm, _wall_mm(options), options.waves)
    try:
        geometry = replace(
            geometry,
            a_mm=a_mm,
            b_mm=b_mm,
            c_mm=c_mm,
            wave_count=waves,
            active_length_mm=options.active_length,
            wave_fillet_mm=options.wave_fillet,
            corner_fillet_mm=options.corner_fillet,
        )
        return Run(
            geometry,
            pattern,
            MESHES[options.mesh],
            end_length_mm=options.end_length,
            end_weight_factor=options.end_weight,
            self_contact=options.self_contact,
            silicone=Silicone(**yeoh_constants_of(options.silicone).constants()) if options.silicone else Silicone(),
        )
    except ValueError as error:
        raise ArgumentError(str(error)) from error


def _wall_mm(options: argparse.Namespace) -> float:
    """The wall that is asked for, or the one of the reading on the mesh."""
    if options.wall is not None:
        return options.wall
    return FAST_WALL_MM if options.mesh == FAST_MESH else CellGeometry().c_mm


def points_of(options: argparse.Namespace, default: Sequence[str] | None = None) -> list[PaperPoint]:
    """Return the paper's designs that are asked for; ``default`` of them without ``--points``, none for all.

    Raises:
        ArgumentError: there is no design of that name.
    """
    known = {point.source: point for point in paper_points()}
    names = list(default or known) if options.points is None else options.points.split(",")
    if unknown := [name for name in names if name not in known]:
        raise ArgumentError(
            f"--points: unknown {', '.join(unknown)}; known are table_1:1 to :21, table_2:1 to :8, "
            "table_5:1 to :3 and measured:psc"
        )
    return [known[name] for name in names]


def can_draw(options: argparse.Namespace, progress: Progress) -> bool:
    """Whether pictures are wanted and can be drawn; says why not."""
    if not options.pictures:
        return False
    try:
        require_matplotlib()
    except PictureError as error:
        progress.say(str(error))
        return False
    return True


def tell_pictures(progress: Progress, pictures: Sequence[Path]) -> None:
    """Say where pictures are."""
    progress.say("pictures: " + ", ".join(str(picture) for picture in pictures))


def status_of(result: dict) -> int:
    """Return the exit status: 1 if a job of the result failed."""
    return 1 if result["failures"] else 0
