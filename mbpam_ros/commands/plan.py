"""How to compute a scene within a tolerance, and why.

    mbpam plan bulb                                          a scene by name, or its file
    mbpam plan bulb --tolerance 2                            at rest, in motion and of contact force [%]
    mbpam plan empty --tolerance 1 --transient-tolerance 20  each by itself
    mbpam plan bulb --pneumatics lag --step-s 0.002          parts decided by you
    mbpam plan bulb --pressure-kpa 80 --measure              errors measured in this scene itself, in 20 s of CPU

A scene file with "tier: auto" is computed so; what it gives itself (sub_step_s, pneumatics, strains, modes,
moving_fingers, contact: false, tolerance) is forced then. What a file with another tier gives is judged below the plan.
Errors and costs come from the table that "mbpam trade" measured; run it on your machine for its CPU times. A scene
outside what was measured (in size, mass, friction, pressure or pose) is warned of, and its errors are taken to be the
larger the further outside it is; --measure runs the scene itself instead, closed upon at the pressure and lifted.

The exit status is 1 where the plan is outside the tolerance.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import ALL_FINGERS, AUTO, TABLE, FidelityRequest, Tolerance, load_fidelity_table
from mbpam_ros.plant.planner import PlanError, may_touch, plan
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.registry import tier_names
from mbpam_ros.pneumatics.registry import pneumatic_model_names
from mbpam_ros.study.fidelity.cases import FULL_PA
from mbpam_ros.study.fidelity.draws import STRAIN_SETS
from mbpam_ros.study.fidelity.own_measurement import measured_table
from mbpam_ros.study.fidelity.plan import plan_text

_DECIDED = ("tier", "modes", "sub_step_s", "pneumatics", "contact", "strains")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("scene", help="name of a scene, or its file")
    parser.add_argument(
        "--tolerance", type=float, metavar="PCT", help="of all errors (default: the scene's, or 5, 5, 10)"
    )
    parser.add_argument("--transient-tolerance", type=float, metavar="PCT", help="of the error in motion")
    parser.add_argument("--force-tolerance", type=float, metavar="PCT", help="of the error of contact forces")
    parser.add_argument("--tier", choices=tier_names())
    parser.add_argument("--strains", nargs="+", choices=STRAINS, help="what the muscles do, bend always")
    parser.add_argument("--modes", type=int, help="modes of curvature a plane")
    parser.add_argument("--step-s", dest="sub_step_s", type=float, metavar="S", help="sub-step")
    parser.add_argument("--pneumatics", choices=pneumatic_model_names(), help="taken for the real ones")
    parser.add_argument("--contact", action=argparse.BooleanOptionalAction, help="whether anything touches")
    parser.add_argument("--camera", action=argparse.BooleanOptionalAction, help="whether to render images")
    parser.add_argument("--fingers", type=int, nargs="+", choices=ALL_FINGERS, help="those that move (moving_fingers)")
    parser.add_argument(
        "--pressure-kpa",
        type=float,
        default=1e-3 * FULL_PA,
        metavar="P",
        help="the largest gauge pressure (default: 100)",
    )
    parser.add_argument("--measure", action="store_true", help="measure errors in this scene itself")
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help="measured table")


def run(options: argparse.Namespace) -> int:
    """Print the plan; return 1 where it is outside the tolerance."""
    (scene, request), table = load_scene(options.scene), load_fidelity_table(options.table)
    gripper, tolerance = load_gripper(), _tolerance(request, options)
    finger_length_m, pressure_gauge_pa = gripper.geometry.length_m, 1e3 * options.pressure_kpa
    asked = dataclasses.replace(_decided(request, options), tolerance=tolerance)
    if options.measure:
        touch = may_touch(scene, finger_length_m) if asked.contact is None else asked.contact
        strains = STRAIN_SETS if asked.strains is None and table.model_errors else (asked.strains or ("bend",),)
        table = measured_table(scene, touch, table, pressure_gauge_pa, strains, gripper)
    found = plan(scene, finger_length_m, table, asked, camera=options.camera, pressure_gauge_pa=pressure_gauge_pa)
    print(plan_text(found, scene, request, finger_length_m, table, tolerance))
    return 0 if found.within_tolerance else 1


def _tolerance(request: FidelityRequest, options: argparse.Namespace) -> Tolerance:
    values = dataclasses.asdict(request.tolerance or Tolerance())
    if options.tolerance is not None:
        values = dict.fromkeys(values, options.tolerance)
    for name, value in (("transient_pct", options.transient_tolerance), ("contact_force_pct", options.force_tolerance)):
        if value is not None:
            values[name] = value
    try:
        return Tolerance(**values)
    except ValueError as error:
        raise PlanError(f"tolerance: {error}") from error


def _decided(request: FidelityRequest, options: argparse.Namespace) -> FidelityRequest:
    given = request if request.tier == AUTO else FidelityRequest()
    wanted = {name: getattr(options, name) for name in _DECIDED}
    wanted["strains"] = options.strains and tuple(options.strains)
    wanted["moving_fingers"] = options.fingers and tuple(options.fingers)
    try:
        return dataclasses.replace(given, **{name: value for name, value in wanted.items() if value is not None})
    except ValueError as error:
        raise PlanError(str(error)) from error
