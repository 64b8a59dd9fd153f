"""Bend and force of one muscle over pressure, measured on the rig of the paper's Fig. 3, as its Fig. 5.

    mbpam characterise --patterns pdc,psc --pressures 0:100:10 --repeats 2 --json FILE
    mbpam characterise --simulated 7 --json FILE       a hidden muscle in simulated time, without nodes

The nodes pressure_sensor and valve_controller run, and no arbiter; the muscle is that of finger 1. It is clamped at its
base, tip up; a camera (--camera) looks at its side and sends camera/image_raw and camera/camera_info; a scale sends
scale/wrench, force.z being the tip's push on its plate. Each pattern is measured free, and with the tip at the plate.
Where nobody hears rig/mount, as the plant's scene rig does, you are asked to turn the muscle and to move the plate.

Every pressure is held until pressure, bend or force have settled. Every sample goes to a CSV beside FILE, the averaged
curves with their spread to FILE, their picture to --picture. What is off ends it with one line, and nothing is written.
"""

from __future__ import annotations

import argparse
import re
import time

from mbpam_ros.actuator.drawing import PAPER, load_drawing
from mbpam_ros.commands.muscle.calibrate import drawn_gripper
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.rig import MuscleRig, hidden_muscle
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.study.pictures import require_matplotlib
from mbpam_ros.study.result_file import write_json, write_text
from mbpam_ros.study.rig.curves import as_json, averaged, csv_text
from mbpam_ros.study.rig.procedure import BEND, QUANTITIES, UP, Plan, Rig, characterise, mounts_of
from mbpam_ros.study.rig.simulated import SimulatedRig
from mbpam_ros.terminal import Progress, table

MOST_KPA = 120.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--patterns", default="pdc,psc", metavar="NAMES", help="pdc, psc or both (default)")
    parser.add_argument("--pressures", type=_pressures, default=_pressures("0:100:10"), metavar="FROM:TO:STEP [kPa]")
    parser.add_argument("--repeats", type=int, default=2, metavar="N", help="ramps of each mount (default 2)")
    parser.add_argument("--measure", default="bend,force", metavar="WHAT", help="bend, force or both (default)")
    parser.add_argument("--all-directions", action="store_true", help="all eight directions instead of one a pattern")
    parser.add_argument("--muscle", default=PAPER, metavar="NAME", help=f"drawing in config/muscles (default {PAPER})")
    parser.add_argument("--sample", default="1", metavar="TEXT", help="which muscle of the kind this one is")
    parser.add_argument("--json", type=result_file, required=True, metavar="FILE", help="where the curves go")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    parser.add_argument("--settle-s", type=float, default=1.0, metavar="S", help="window of settling (default 1)")
    parser.add_argument("--timeout-s", type=float, default=20.0, metavar="S", help="for settling (default 20)")
    parser.add_argument("--camera", default="rig_camera.yaml", metavar="FILE", help="where the camera stands")
    parser.add_argument("--tip-round-mm", type=float, metavar="MM", help="a round tip stands out (default: flat)")
    parser.add_argument(
        "--markers", type=_colour, metavar="R,G,B", help="read the bend from two strips of this colour, 0 to 1"
    )
    parser.add_argument("--namespace", default="", metavar="NAME", help="of the nodes")
    parser.add_argument("--simulated", type=int, metavar="SEED", help="measure the hidden muscle of a seed, no nodes")


def run(options: argparse.Namespace) -> int:
    """Measure, print the curves, and write samples, curves and picture."""
    load_drawing(options.muscle)
    if not (0.05 <= options.settle_s < options.timeout_s):
        raise ConfigError("--settle-s must be 0.05 or more, and less than --timeout-s")
    plan = Plan(
        mounts_of(options.patterns.split(","), options.all_directions, options.measure.split(",")),
        options.pressures,
        options.repeats,
        window_s=options.settle_s,
        timeout_s=options.timeout_s,
    )
    gripper = drawn_gripper(options.muscle, "test" if options.muscle == PAPER else "fe")
    if options.picture is not None:
        require_matplotlib()
    progress = Progress()
    if options.simulated is not None:
        samples = characterise(_simulated(gripper, options.simulated), plan, progress.show)
    else:
        from mbpam_ros.commands.ros_rig import RosRig  # ROS is asked for only where it measures

        with RosRig(gripper, options.camera, options.tip_round_mm, options.markers, options.namespace) as rig:
            samples = characterise(rig, plan, progress.say)
    points = averaged(samples)
    progress.say(_text(points))
    about = {
        "muscle": options.muscle,
        "sample": options.sample,
        "at": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime()),
        "pressures_kpa": list(plan.pressures_kpa),
        "repeats": plan.repeats,
        "directions_deg": sorted({mount.azimuth_deg for mount in plan.mounts}),
        "simulated": options.simulated is not None,
    }
    write_text(options.json.with_suffix(".csv"), csv_text(samples))
    write_json(options.json, as_json(points, about))
    if options.picture is not None:
        from mbpam_ros.study.rig.picture import draw_curves

        models = {f"model ({gripper.target})": (gripper.rod_law(), 0.0)}
        draw_curves(points, models, gripper.rod_geometry, options.picture)
    return 0


def _simulated(gripper: Gripper, seed: int) -> Rig:
    import dataclasses

    config = load_scene("rig")[0].rig
    if config is None or seed < 0:
        raise ConfigError("scene rig has no rig, or the seed is negative")
    config = dataclasses.replace(config, muscle_seed=seed)
    muscle = hidden_muscle(gripper.rod_law(), config)
    return SimulatedRig(MuscleRig(muscle, gripper.rod_geometry, config, seed), seed)


def _text(points: list) -> str:
    rows = []
    for pattern in ("pdc", "psc"):
        for quantity in QUANTITIES:
            of = [p for p in points if (p.pattern, p.quantity, p.branch) == (pattern, quantity, UP)]
            if of:
                top = max(of, key=lambda point: point.pressure_kpa)
                unit = "deg" if quantity == BEND else "N"
                rows.append(
                    (
                        pattern,
                        quantity,
                        f"{top.pressure_kpa:.1f}",
                        f"{top.mean:.4g} +- {top.spread:.2g} {unit}",
                        str(top.samples),
                    )
                )
    return table(("pattern", "quantity", "kPa", "at the top", "samples"), rows)


def _pressures(text: str) -> tuple[float, ...]:
    match = re.fullmatch(r"([0-9.]+):([0-9.]+):([0-9.]+)", text)
    try:
        low, high, step = map(float, match.groups() if match else ())
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected FROM:TO:STEP in kPa, such as 0:100:10, found {text!r}") from None
    if not (0.0 <= low < high <= MOST_KPA and 0.5 <= step <= high - low):
        raise argparse.ArgumentTypeError(
            f"expected 0 <= FROM < TO <= {MOST_KPA:g} kPa and a step of 0.5 kPa or more, found {text!r}; is it in kPa?"
        )
    count = int((high - low) / step + 1e-9)
    return tuple(low + k * step for k in range(count + 1))


def _colour(text: str) -> tuple[float, float, float]:
    try:
        red, green, blue = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected R,G,B, such as 0.1,0.2,0.9, found {text!r}") from None
    if not all(0.0 <= value <= 1.0 for value in (red, green, blue)):
        raise argparse.ArgumentTypeError(f"expected three numbers from 0 to 1, found {text!r}")
    return red, green, blue
