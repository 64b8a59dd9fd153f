"""The command ``calibrate_fe``: the finite element muscle beside the paper's.

    calibrate_fe --json FILE                                  the paper's 32 designs (Tables 1, 2, 5) and PSC
    calibrate_fe --design A,B,C,N --pattern psc --json FILE   one design: bend against pressure
    calibrate_fe --effects --json FILE                        effect of a, b, c and n, as figure 6
    calibrate_fe --ablations --json FILE                      what each choice of the model does to the error
    calibrate_fe --law FILE                                   M(p, kappa), V(p, kappa), stretch of the initial design

Pictures are written beside FILE. An interrupt (Ctrl-C) keeps what is finished; the same command goes on from there.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, Executor
from pathlib import Path
from typing import NoReturn

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.announcement import announce
from mbpam_ros.study.fe.ablations import SPREAD_POINTS, ablations
from mbpam_ros.study.fe.design_run import MESHES, NO_EQUILIBRIUM, Run, bend_curve
from mbpam_ros.study.fe.effects import effects
from mbpam_ros.study.fe.executors import LOCAL_CLUSTER, ExecutorError, open_executor
from mbpam_ros.study.fe.job_queue import S_PER_JOB
from mbpam_ros.study.fe.law_table import law_table
from mbpam_ros.study.fe.mesh import PATTERNS, CellGeometry
from mbpam_ros.study.fe.paper_comparison import (
    CURVE_KPA,
    PaperPoint,
    compare_with_paper,
    draw_comparison,
    paper_points,
)
from mbpam_ros.study.fe.pictures import PictureError, draw_ablations, draw_effects, require_matplotlib
from mbpam_ros.study.fe.posture import END_LENGTH_MM, END_WEIGHT_FACTOR
from mbpam_ros.study.progress_bar import ProgressBar
from mbpam_ros.study.result_file import ResultFileError, write_json


class CommandError(MbpamError, ValueError):
    """The arguments do not say what to do; the message says what is wrong."""


def run_command(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit status.

    Raises:
        KeyboardInterrupt: what is finished has been written.
    """
    options = _parser().parse_args(arguments)
    progress = ProgressBar()
    try:
        template, points = _template(options), _points(options)
        _check_outputs(options)
        with open_executor(options.workers, options.dask) as executor:
            return _run(options, template, points, executor, progress)
    except BrokenExecutor as error:
        print(f"calibrate_fe: a worker died (out of memory?); give fewer --workers: {error}", file=sys.stderr)
        return 1
    except (*NO_EQUILIBRIUM, ResultFileError, ExecutorError, ValueError, OSError) as error:
        print(f"calibrate_fe: {error}", file=sys.stderr)
        return 1


def _run(
    options: argparse.Namespace, template: Run, points: list[PaperPoint], executor: Executor, progress: ProgressBar
) -> int:
    if options.law is not None:
        return _status(law_table(template, options.law, executor, progress))
    if options.design is not None:
        return _curve(options.json, template, executor, progress)
    pictures = options.pictures and _can_draw(progress)
    if options.effects:
        return _effects(options.json, template, executor, progress, pictures)
    if options.ablations:
        return _ablations(options.json, template, points, executor, progress, pictures)
    result = compare_with_paper(template, options.json, executor, progress, points)
    progress.say(json.dumps(result["errors"], indent=1))
    if pictures and result["points"]:
        _tell(progress, draw_comparison(template, result, options.json, executor, progress))
    return _status(result)


def _curve(path: Path, run: Run, executor: Executor, progress: ProgressBar) -> int:
    announce("one bend curve", S_PER_JOB, sys.stdout)
    begun_s = time.monotonic()
    curve = executor.submit(bend_curve, run, CURVE_KPA).result()
    write_json(path, curve)
    passed_s = time.monotonic() - begun_s
    progress.say(f"{curve['p_kpa'][-1]:g} kPa: {curve['theta_deg'][-1]:.2f} deg; the curve took {passed_s:.1f} s")
    return 0


def _effects(path: Path, template: Run, executor: Executor, progress: ProgressBar, pictures: bool) -> int:
    result = effects(template, path, executor, progress)
    for row in result["trends"]:
        verdict = "agrees" if row["agrees"] else "DISAGREES"
        progress.say(f"{row['parameter']} {row['quantity']}: {row['found']} (paper: {row['paper']}) {verdict}")
    if pictures and result["designs"]:
        picture = path.with_suffix(".png")
        draw_effects(result["designs"], picture)
        _tell(progress, [picture])
    return _status(result)


def _ablations(
    path: Path, template: Run, points: list[PaperPoint], executor: Executor, progress: ProgressBar, pictures: bool
) -> int:
    result = ablations(template, path, executor, progress, points)
    for row in result["variants"]:
        progress.say(
            f"{row['name']}: theta {row['theta_rms_pct']:.1f} % rms, {row['theta_mean_pct']:+.1f} % mean, "
            f"{row['theta_worst_pct']:+.1f} % worst; force {row['force_rms_pct']:.1f} % rms ({row['points']} points); "
            f"folds {row['least_fold_opening']:.2f} open, arm {row['least_arm_gap_mm']:+.2f} mm from the wall"
        )
    if pictures and result["variants"]:
        picture = path.with_suffix(".png")
        draw_ablations(result["variants"], picture)
        _tell(progress, [picture])
    return _status(result)


def _can_draw(progress: ProgressBar) -> bool:
    try:
        require_matplotlib()
    except PictureError as error:
        progress.say(str(error))
        return False
    return True


def _tell(progress: ProgressBar, pictures: list[Path]) -> None:
    progress.say("pictures: " + ", ".join(str(picture) for picture in pictures))


def _status(result: dict) -> int:
    return 1 if result["failures"] else 0


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser("calibrate_fe", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = CellGeometry()
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the comparison or the curve goes")
    parser.add_argument("--law", type=Path, metavar="FILE", help="where the law M(p, kappa) goes")
    parser.add_argument("--effects", action="store_true", help="effect of a, b, c and n")
    parser.add_argument("--ablations", action="store_true", help="effect of mesh, wall, fillets, contact, ends")
    parser.add_argument("--design", metavar="A,B,C,N", help="one design: lengths a, b, c in mm, number of waves")
    parser.add_argument("--pattern", choices=PATTERNS, default="pdc", help="of --design")
    parser.add_argument(
        "--points",
        metavar="NAME,...",
        help="designs of the paper to run, such as table_2:1 (default: all; 6 for --ablations)",
    )
    parser.add_argument("--no-pictures", dest="pictures", action="store_false", help="write numbers only")
    parser.add_argument("--mesh", choices=MESHES, default="trilinear", help="elements (default: trilinear)")
    parser.add_argument("--wall", type=float, default=default.c_mm, metavar="C", help="wall c of the 32 designs [mm]")
    parser.add_argument("--waves", type=float, default=default.wave_count, metavar="N", help="waves of the 32 designs")
    parser.add_argument(
        "--wave-fillet", type=float, metavar="MM", help="radius of crests and valleys (default: cosine)"
    )
    parser.add_argument(
        "--corner-fillet", type=float, default=0.0, metavar="MM", help="radius of the chambers' corners"
    )
    parser.add_argument("--self-contact", action="store_true", help="let the arms of the cross rest on the wall")
    parser.add_argument("--active-length", type=float, default=default.active_length_mm, metavar="MM")
    parser.add_argument("--end-length", type=float, default=END_LENGTH_MM, metavar="MM")
    parser.add_argument(
        "--end-weight", type=float, default=END_WEIGHT_FACTOR, metavar="F", help="of the ends, per length, over waves'"
    )
    cores = os.cpu_count() or 1
    parser.add_argument("--workers", type=int, default=cores, help="processes (default: one a core)")
    parser.add_argument(
        "--dask", metavar="ADDRESS", help=f"run on a Dask cluster: its scheduler's address, or {LOCAL_CLUSTER!r}"
    )
    return parser


def _template(options: argparse.Namespace) -> Run:
    a_mm, b_mm, c_mm, waves = CellGeometry().a_mm, CellGeometry().b_mm, options.wall, options.waves
    if options.design is not None:
        try:
            a_mm, b_mm, c_mm, waves = (float(part) for part in options.design.split(","))
        except ValueError as error:
            raise CommandError(f"--design wants four numbers A,B,C,N, found {options.design!r}") from error
    fillets = {"wave_fillet_mm": options.wave_fillet, "corner_fillet_mm": options.corner_fillet}
    geometry = CellGeometry(a_mm, b_mm, c_mm, waves, options.active_length, **fillets)
    ends = {"end_length_mm": options.end_length, "end_weight_factor": options.end_weight}
    return Run(geometry, options.pattern, MESHES[options.mesh], **ends, self_contact=options.self_contact)


def _points(options: argparse.Namespace) -> list[PaperPoint]:
    known = {point.source: point for point in paper_points()}
    if options.points is None:
        return [known[name] for name in (SPREAD_POINTS if options.ablations else known)]
    unknown = [name for name in options.points.split(",") if name not in known]
    if unknown:
        raise CommandError(
            f"--points: unknown {', '.join(unknown)}; known are table_1:1 to :21, table_2:1 to :8, "
            "table_5:1 to :3 and measured:psc"
        )
    return [known[name] for name in options.points.split(",")]


def _check_outputs(options: argparse.Namespace) -> None:
    wanted = [options.design is not None, options.effects, options.ablations, options.law is not None]
    if sum(wanted) > 1:
        raise CommandError("give only one of --design, --effects, --ablations and --law")
    if options.law is not None and options.json is not None:
        raise CommandError("--law has its own FILE; leave --json out")
    path = options.law or options.json
    if path is None:
        raise CommandError("nothing to write: give --json FILE or --law FILE")
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise CommandError(f"cannot write {path}: it is a folder, or its folder does not exist")
