"""One design in the paper's posture: bend against pressure.

mbpam fe curve 2.5,2,2.3,14 --pattern psc --json FILE
"""

from __future__ import annotations

import argparse
import time

from mbpam_ros.commands.fe.model import add_mesh, add_model, add_result, run_of
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe.design_run import S_PER_JOB, bend_curve
from mbpam_ros.study.fe.mesh import PATTERNS
from mbpam_ros.study.fe.mesh_error import mesh_error_pct, mesh_error_text
from mbpam_ros.study.fe.paper_comparison import CURVE_KPA
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("design", type=_design, metavar="A,B,C,N", help="lengths a, b, c in mm, number of waves")
    parser.add_argument("--pattern", choices=PATTERNS, default="pdc", help="chambers under pressure (default: pdc)")
    add_result(parser, "where the curve goes")
    add_mesh(parser)
    add_model(parser)
    add_workers(parser, default=1)  # one job


def run(options: argparse.Namespace) -> int:
    """Run the design; say its greatest bend."""
    wanted, progress = run_of(options, options.design, options.pattern), Progress()
    announce("one bend curve", S_PER_JOB, progress.stream)
    begun_s = time.monotonic()
    with executor_for(options, 1) as executor:
        curve = executor.submit(bend_curve, wanted, CURVE_KPA).result()
    write_json(options.json, {**curve, "mesh_error_pct": mesh_error_pct(wanted.resolution)})
    passed_s = time.monotonic() - begun_s
    progress.say(f"{curve['p_kpa'][-1]:g} kPa: {curve['theta_deg'][-1]:.2f} deg; the curve took {passed_s:.1f} s")
    progress.say(mesh_error_text(wanted.resolution))
    return 0


def _design(text: str) -> tuple[float, float, float, float]:
    try:
        a_mm, b_mm, c_mm, waves = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"wants four numbers A,B,C,N, found {text!r}") from error
    return a_mm, b_mm, c_mm, waves
