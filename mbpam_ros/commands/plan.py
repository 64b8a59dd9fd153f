"""How to compute a scene within a tolerance, and why.

    mbpam plan bulb                                          a scene by name, or its file
    mbpam plan bulb --tolerance 2                            at rest, in motion and of contact force [%]
    mbpam plan empty --tolerance 1 --transient-tolerance 20  each by itself
    mbpam plan bulb --pneumatics lag --step-s 0.002          parts decided by you

A scene file with "tier: auto" is computed so; what it gives itself (sub_step_s, pneumatics, strains, modes,
moving_fingers, contact: false, tolerance) is forced then. What a file with another tier gives is judged below the plan.
Errors and costs come from the table that "mbpam trade" measured; run it on your machine for its CPU times.

The exit status is 1 where the plan is outside the tolerance.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import ALL_FINGERS, AUTO, TABLE, FidelityRequest, Tolerance, load_fidelity_table
from mbpam_ros.plant.planner import PlanError, plan
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.registry import tier_names
from mbpam_ros.pneumatics.registry import pneumatic_model_names
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
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help="measured table")


def run(options: argparse.Namespace) -> int:
    """Print the plan; return 1 where it is outside the tolerance."""
    (scene, request), table = load_scene(options.scene), load_fidelity_table(options.table)
    finger_length_m, tolerance = load_gripper().geometry.length_m, _tolerance(request, options)
    asked = dataclasses.replace(_decided(request, options), tolerance=tolerance)
    found = plan(scene, finger_length_m, table, asked, camera=options.camera)
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
