"""A muscle from its drawing: the paper's Fig. 7 as one run, and the law that plant and estimator run on.

    mbpam muscle build NAME                          21 samples and 8 checks over a and b, front, law, report
    mbpam muscle build NAME --vary a,b,c,n --samples 40      how all four act, together and each alone; no front
    mbpam muscle build NAME --tables                 at the paper's designs (21 + 8 + 3), beside the paper's own values
    mbpam muscle build NAME --samples 0              the law of the drawing alone
    mbpam muscle build NAME --fast --samples 8 --checks 0    a trial on the fast mesh

NAME is a drawing in config/muscles (copy paper.yaml). The ranges are the paper's, made similar to the radius. All of it
goes to the folder of that name: samples.json, law.json, front.json, built.json and report.html. Designs on the front
are run as well, so that what it offers is not the metamodel's word alone. An interrupt keeps what is finished; the same
command goes on from there. Then `muscle: NAME` and `target: fe` in gripper.yaml.
With --keep-as NEW the chosen design becomes a drawing of its own, to be built in its turn.
"""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import asdict
from pathlib import Path

import yaml

from mbpam_ros.actuator.built_muscle import FILE
from mbpam_ros.actuator.drawing import PAPER, MuscleDrawing, drawing_names, load_drawing, muscle_folder
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.design.compromise import Rule, knee, required_force
from mbpam_ros.study.fe.design_run import DEFAULT_MESH, FAST_MESH, FAST_WALL_MM, MESHES
from mbpam_ros.study.fe.law_table import BENDS_DEG, PRESSURES_KPA
from mbpam_ros.study.fe.loaded_muscle import MESHES as END_MESHES
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.muscle import build
from mbpam_ros.study.muscle.findings import Findings
from mbpam_ros.study.muscle.front_check import beside_the_paper, check_front
from mbpam_ros.study.muscle.one_at_a_time import one_at_a_time
from mbpam_ros.study.muscle.report import write_report
from mbpam_ros.study.result_file import require_makeable, write_json, write_text
from mbpam_ros.study.silicone.known import largest_stretch_of
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("name", metavar="NAME", help="of a drawing in config/muscles")
    parser.add_argument("--vary", choices=build.VARY, default="a,b", help="variables of the samples (default: a,b)")
    parser.add_argument("--samples", type=int, default=21, metavar="N", help="designs to fit (default: 21)")
    parser.add_argument(
        "--checks", "--check", type=int, default=8, metavar="N", help="designs to judge on (default: 8)"
    )
    parser.add_argument("--tables", action="store_true", help="the paper's designs instead, made similar to the radius")
    parser.add_argument("--patterns", default="pdc,psc", metavar="NAMES", help="of the samples (default: pdc,psc)")
    parser.add_argument("--seed", type=int, default=0, help="of samples and optimisation (default: 0)")
    mesh = parser.add_mutually_exclusive_group()
    mesh.add_argument("--mesh", choices=MESHES, default=DEFAULT_MESH, help=f"elements (default: {DEFAULT_MESH})")
    mesh.add_argument("--fast", dest="mesh", action="store_const", const=FAST_MESH, help=f"the mesh {FAST_MESH}")
    parser.add_argument(
        "--law-to", type=int, default=PRESSURES_KPA[-1], metavar="KPA", help="highest pressure of the law"
    )
    parser.add_argument("--law-step", type=int, default=10, metavar="KPA", help="between the law's pressures")
    parser.add_argument("--without-law", action="store_true", help="samples and front alone; nothing runs on them")
    parser.add_argument(
        "--ends", choices=END_MESHES, metavar="MESH", help=f"compute what the ends do, on {', '.join(END_MESHES)}"
    )
    parser.add_argument(
        "--largest-stretch",
        type=float,
        metavar="L",
        help="of the wall before it tears (default: the silicone's at break)",
    )
    parser.add_argument("--required-force", type=float, metavar="N", help="choose the largest angle with this force")
    parser.add_argument("--keep-as", metavar="NEW", help="draw the chosen design under this name")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Build what the muscle's folder does not hold."""
    drawing, folder, progress = load_drawing(options.name), muscle_folder(options.name), Progress()
    plan = _plan(options, drawing)
    if options.keep_as is not None:
        _check_new(options.keep_as)
    rule: tuple[str, Rule] = ("knee", knee)
    if options.required_force is not None:
        rule = f"required force {options.required_force:g} N", required_force(options.required_force)
    require_makeable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    names = build.VARY[plan.vary] if plan.vary != "a,b" else ()
    alone = None
    with executor_for(options, 2 * (1 + plan.samples + plan.checks)) as executor:
        rows, failures = build.run_samples(drawing, plan, folder, executor, progress)
        if names:
            alone = one_at_a_time(plan.meshed(drawing), names, folder / "one_at_a_time.json", executor, progress)
        front = build.front_of(drawing, plan, rows, rule, folder, executor, progress)
        if front is not None:
            path = folder / "front_fe.json"
            front["finite_elements"] = check_front(plan.meshed(drawing), front, path, executor, progress)
            front["paper"] = beside_the_paper(drawing, rows)
            write_json(folder / "front.json", front)
        if not options.without_law:
            build.build_law(drawing, plan, folder, executor, progress)
            build.build_ends(drawing, plan, folder, executor, progress)
    built = build.built_muscle(drawing, plan, rows)
    if not options.without_law:
        write_json(folder / FILE, asdict(built))
    ranks = build.monotony(rows)
    found = Findings(rows, failures, front, ranks, alone, plan.largest_stretch)
    write_report(folder / "report.html", options.name, asdict(drawing), built, found)
    progress.say("\n".join(found.lines(built)))
    use = "its values are the paper's, and muscle: paper uses those"
    if options.without_law:
        use = "nothing runs on it without a law"
    elif options.name != PAPER:
        use = f"muscle: {options.name}, target: fe"
    progress.say(f"kept in {folder}; in gripper.yaml: {use}")
    if options.keep_as is not None and front is not None:
        _draw_new(options.keep_as, drawing, front)
        progress.say(
            f"the chosen design is drawn as {options.keep_as}; mbpam muscle build {options.keep_as} --samples 0"
        )
    return 0


def _plan(options: argparse.Namespace, drawing: MuscleDrawing) -> build.BuildPlan:
    patterns = tuple(options.patterns.split(","))
    if not set(patterns) <= {"pdc", "psc"} or "pdc" not in patterns:
        raise ConfigError(f"--patterns {options.patterns}: pdc, or pdc,psc")
    if options.samples < 0 or options.checks < 0 or options.seed < 0:
        raise ConfigError("--samples, --checks and --seed must not be negative")
    if options.tables and options.vary != "a,b":
        raise ConfigError("--tables varies a and b alone")
    if options.largest_stretch is not None and not 1.0 < options.largest_stretch < math.inf:
        raise ConfigError(
            f"--largest-stretch must be above 1, at rest, found {options.largest_stretch:g}; an elongation at "
            "break of 400 % is a stretch of 5"
        )
    if not 1 <= options.law_step <= 20 or not 100 <= options.law_to <= 200 or options.law_to % options.law_step:
        raise ConfigError("--law-to must be 100 to 200 kPa, in whole steps of --law-step, 1 to 20 kPa")
    thinner_mm = CellGeometry().c_mm - FAST_WALL_MM if options.mesh == FAST_MESH else 0.0
    return build.BuildPlan(
        vary=options.vary,
        samples=options.samples,
        checks=options.checks if options.samples else 0,
        tables=options.tables,
        seed=options.seed,
        patterns=patterns,
        resolution=MESHES[options.mesh],
        mesh_wall_mm=thinner_mm * drawing.outer_radius_mm / CellGeometry().outer_radius_mm,
        law_kpa=tuple(range(0, options.law_to + 1, options.law_step)),
        law_bends_deg=BENDS_DEG,
        ends_mesh=options.ends,
        largest_stretch=options.largest_stretch or largest_stretch_of(drawing.silicone),
    )


def _check_new(name: str) -> None:
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or name in drawing_names():
        raise ConfigError(f"--keep-as {name}: letters, digits and _, and no drawing that there is already")


def _draw_new(name: str, drawing: MuscleDrawing, front: dict) -> None:
    chosen = front["chosen"]
    values = {**asdict(drawing), "a_mm": round(chosen["a_mm"], 4), "b_mm": round(chosen["b_mm"], 4)}
    text = f"# Chosen by mbpam muscle build, {chosen['rule']}, metamodel {front['metamodel']}.\n"
    write_text(Path(f"{muscle_folder(name)}.yaml"), text + yaml.safe_dump(values, sort_keys=False))
