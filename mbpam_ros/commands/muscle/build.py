"""A muscle from its drawing: the paper's Fig. 7 as one run, and the law that plant and estimator run on.

    mbpam muscle build NAME                          21 samples and 8 checks over a and b, front, law, report
    mbpam muscle build NAME --vary a,b,c,n --samples 40      how all four act; no front
    mbpam muscle build NAME --samples 0              the law of the drawing alone
    mbpam muscle build NAME --fast --samples 8 --checks 0    a trial on the fast mesh

NAME is a drawing in config/muscles (copy paper.yaml). The ranges are the paper's, made similar to the radius. All of it
goes to the folder of that name: samples.json, law.json, front.json, built.json and report.html. An interrupt keeps what
is finished; the same command goes on from there. Then `muscle: NAME` and `target: fe` in gripper.yaml.
With --keep-as NEW the chosen design becomes a drawing of its own, to be built in its turn.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import asdict
from pathlib import Path

import yaml

from mbpam_ros.actuator.built_muscle import BuiltMuscle
from mbpam_ros.actuator.drawing import PAPER, MuscleDrawing, drawing_names, load_drawing, muscle_folder
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.design.compromise import Rule, knee, required_force
from mbpam_ros.study.fe.design_run import DEFAULT_MESH, FAST_MESH, FAST_WALL_MM, MESHES
from mbpam_ros.study.fe.law_table import BENDS_DEG, PRESSURES_KPA
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.muscle import build
from mbpam_ros.study.muscle.report import write_report
from mbpam_ros.study.result_file import require_makeable, write_json, write_text
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("name", metavar="NAME", help="of a drawing in config/muscles")
    parser.add_argument("--vary", choices=build.VARY, default="a,b", help="variables of the samples (default: a,b)")
    parser.add_argument("--samples", type=int, default=21, metavar="N", help="designs to fit (default: 21)")
    parser.add_argument(
        "--checks", "--check", type=int, default=8, metavar="N", help="designs to judge on (default: 8)"
    )
    parser.add_argument("--patterns", default="pdc,psc", metavar="NAMES", help="of the samples (default: pdc,psc)")
    parser.add_argument("--seed", type=int, default=0, help="of samples and optimisation (default: 0)")
    mesh = parser.add_mutually_exclusive_group()
    mesh.add_argument("--mesh", choices=MESHES, default=DEFAULT_MESH, help=f"elements (default: {DEFAULT_MESH})")
    mesh.add_argument("--fast", dest="mesh", action="store_const", const=FAST_MESH, help=f"the mesh {FAST_MESH}")
    parser.add_argument(
        "--law-to", type=int, default=PRESSURES_KPA[-1], metavar="KPA", help="highest pressure of the law"
    )
    parser.add_argument("--law-step", type=int, default=10, metavar="KPA", help="between the law's pressures")
    parser.add_argument(
        "--largest-stretch", type=float, metavar="L", help="of the wall before it tears (default: none)"
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
    with executor_for(options, 2 * (1 + plan.samples + plan.checks)) as executor:
        rows, failures = build.run_samples(drawing, plan, folder, executor, progress)
        front = build.front_of(drawing, plan, rows, rule, folder, executor, progress)
        if front is not None:
            write_json(folder / "front.json", front)
        build.build_law(drawing, plan, folder, executor, progress)
    built = build.keep_built(drawing, plan, rows, folder)
    ranks = build.monotony(rows)
    write_report(folder / "report.html", options.name, asdict(drawing), built, rows, failures, front, ranks)
    progress.say(_text(options.name, folder, built, front, ranks))
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
    if not 1 <= options.law_step <= 20 or not 100 <= options.law_to <= 200 or options.law_to % options.law_step:
        raise ConfigError("--law-to must be 100 to 200 kPa, in whole steps of --law-step, 1 to 20 kPa")
    thinner_mm = CellGeometry().c_mm - FAST_WALL_MM if options.mesh == FAST_MESH else 0.0
    return build.BuildPlan(
        vary=options.vary,
        samples=options.samples,
        checks=options.checks if options.samples else 0,
        seed=options.seed,
        patterns=patterns,
        resolution=MESHES[options.mesh],
        mesh_wall_mm=thinner_mm * drawing.outer_radius_mm / CellGeometry().outer_radius_mm,
        law_kpa=tuple(range(0, options.law_to + 1, options.law_step)),
        law_bends_deg=BENDS_DEG,
        largest_stretch=options.largest_stretch,
    )


def _check_new(name: str) -> None:
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) or name in drawing_names():
        raise ConfigError(f"--keep-as {name}: letters, digits and _, and no drawing that there is already")


def _draw_new(name: str, drawing: MuscleDrawing, front: dict) -> None:
    chosen = front["chosen"]
    values = {**asdict(drawing), "a_mm": round(chosen["a_mm"], 4), "b_mm": round(chosen["b_mm"], 4)}
    text = f"# Chosen by mbpam muscle build, {chosen['rule']}, metamodel {front['metamodel']}.\n"
    write_text(Path(f"{muscle_folder(name)}.yaml"), text + yaml.safe_dump(values, sort_keys=False))


def _text(name: str, folder: Path, built: BuiltMuscle, front: dict | None, ranks: dict[str, dict[str, float]]) -> str:
    lines = [f"as drawn: {built.theta_max_deg:.1f} deg, {built.f_max_n:.3f} N (PDC, 100 kPa)"]
    if front is not None:
        chosen = front["chosen"]
        lines.append(
            f"front by {front['metamodel']}; chosen by {chosen['rule']}: a {chosen['a_mm']:.3f}, "
            f"b {chosen['b_mm']:.3f} mm, {chosen['theta_deg']:.1f} deg, {chosen['f_n']:.3f} N"
        )
    for variable, of in ranks.items():
        lines.append(f"{variable}: rank correlation " + ", ".join(f"{what} {value:+.2f}" for what, value in of.items()))
    use = "its values are the paper's, and muscle: paper uses those" if name == PAPER else f"muscle: {name}, target: fe"
    lines.append(f"kept in {folder}; in gripper.yaml: {use}")
    return "\n".join(lines)
