"""Command ``plan``: how to compute a scene within a tolerance, and why.

    plan bulb                                          a scene by name, or its file
    plan bulb --tolerance 2                            at rest, in motion and of contact force [%]
    plan empty --tolerance 1 --transient-tolerance 20  each by itself
    plan bulb --pneumatics lag --step-s 0.002          parts decided by you

A scene file with ``tier: auto`` is computed so; what it gives itself (``sub_step_s``, ``pneumatics``, ``modes``,
``moving_fingers``, ``contact: false``, ``tolerance``) is forced then. What a file with another tier gives is judged
below the plan. Errors and costs come from the table that ``fidelity_trade`` measured; run it on your machine for its
CPU times.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import AUTO, TABLE, FidelityTable, Tolerance, load_fidelity_table
from mbpam_ros.plant.planner import Forced, Plan, PlanError, forced_by, plan
from mbpam_ros.plant.scene import ALL_FINGERS, Scene, load_scene
from mbpam_ros.plant.tiers import tier_names
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.registry import pneumatic_model_names

_FORCEABLE = ("tier", "modes", "step_s", "pneumatics", "contact", "camera")


def plan_text(found: Plan, scene: Scene, finger_length_m: float, table: FidelityTable, tolerance: Tolerance) -> str:
    """Return a plan of a scene as text and, where its file does not leave it open, what the file gives beside it.

    Raises:
        ConfigError: the pneumatics cannot be read.
    """
    lines = [
        f"scene {scene.name}; allowed: {tolerance.static_pct:g} % at rest, {tolerance.transient_pct:g} % in motion, "
        f"{tolerance.contact_force_pct:g} % of contact force",
        f"measured on: {table.machine.get('processor', 'a machine that is not told')}",
        "",
        str(found),
    ]
    if scene.config.tier != AUTO:
        lines += ["", _as_the_file_says(scene, finger_length_m, table, tolerance)]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status: 0, or 1 where the plan is outside the tolerance or there is none."""
    options = _parser().parse_args(arguments)
    try:
        scene, table = load_scene(options.scene), load_fidelity_table(options.table)
        finger_length_m, tolerance = load_gripper().geometry.length_m, _tolerance(scene, options)
        found = plan(scene, finger_length_m, table, tolerance, _forced(scene, options))
        print(plan_text(found, scene, finger_length_m, table, tolerance))
    except ValueError as error:  # a ConfigError is one
        print(f"plan: {error}", file=sys.stderr)
        return 1
    return 0 if found.within_tolerance else 1


def _as_the_file_says(scene: Scene, finger_length_m: float, table: FidelityTable, tolerance: Tolerance) -> str:
    given = forced_by(scene)
    given = dataclasses.replace(given, pneumatics=given.pneumatics or load_pneumatics().model)
    step_ms = 1e3 * scene.config.planned_sub_step_s
    title = f"as the file says ({given.tier}, {step_ms:g} ms, {given.pneumatics} taken for the real one)"
    try:
        return f"{title}: {plan(scene, finger_length_m, table, tolerance, given).expected}"
    except PlanError as error:
        return f"{title}: {error}"


def _tolerance(scene: Scene, options: argparse.Namespace) -> Tolerance:
    values = dataclasses.asdict(scene.config.tolerance or Tolerance())
    if options.tolerance is not None:
        values = dict.fromkeys(values, options.tolerance)
    for name, value in (("transient_pct", options.transient_tolerance), ("contact_force_pct", options.force_tolerance)):
        if value is not None:
            values[name] = value
    return Tolerance(**values)


def _forced(scene: Scene, options: argparse.Namespace) -> Forced:
    given = forced_by(scene) if scene.config.tier == AUTO else Forced()
    wanted = {name: getattr(options, name) for name in _FORCEABLE}
    wanted["moving_fingers"] = options.fingers and tuple(options.fingers)
    return dataclasses.replace(given, **{name: value for name, value in wanted.items() if value is not None})


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("plan", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help="name of a scene, or its file")
    parser.add_argument(
        "--tolerance", type=float, metavar="PCT", help="of all errors (default: the scene's, or 5, 5, 10)"
    )
    parser.add_argument("--transient-tolerance", type=float, metavar="PCT", help="of the error in motion")
    parser.add_argument("--force-tolerance", type=float, metavar="PCT", help="of the error of contact forces")
    parser.add_argument("--tier", choices=tier_names())
    parser.add_argument("--modes", type=int, help="modes of curvature a plane")
    parser.add_argument("--step-s", type=float, metavar="S", help="sub-step")
    parser.add_argument("--pneumatics", choices=pneumatic_model_names(), help="taken for the real ones")
    parser.add_argument("--contact", action=argparse.BooleanOptionalAction, help="whether anything touches")
    parser.add_argument("--camera", action=argparse.BooleanOptionalAction, help="whether to render images")
    parser.add_argument("--fingers", type=int, nargs="+", choices=ALL_FINGERS, help="those that move (moving_fingers)")
    parser.add_argument("--table", type=Path, default=TABLE, metavar="FILE", help="measured table")
    return parser


if __name__ == "__main__":
    sys.exit(main())
