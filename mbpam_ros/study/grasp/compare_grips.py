"""Pressure by object against pressure by mode: the same random grasps, run with both."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from mbpam_ros.grasp.grip_pressure import GripConfig
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.study.grasp.drawn_grasps import drawn_grasp
from mbpam_ros.study.grasp.trial import run_trial
from mbpam_ros.terminal import table

SEED = 501

S_PER_GRASP = 0.8
"""CPU of both runs of a grasp, a guess."""


def compared_row(
    name: str, seed: int, number: int, request: FidelityRequest, gripper: Gripper, config: GripConfig
) -> dict[str, object]:
    """Return what came of one drawn grasp with the pressure of its mode, and with that for the object."""
    drawn = drawn_grasp(seed, number, gripper, config)
    by_mode = run_trial(drawn.scene, request, gripper)
    by_object = run_trial(drawn.scene, request, gripper, expected=drawn.expected)
    spec = drawn.scene.object
    assert spec is not None
    return {
        "job": name,
        "mode": drawn.mode,
        "width_m": spec.size_m[0],
        "mass_kg": spec.mass_kg,
        "friction_coefficient": drawn.scene.friction_coefficient,
        "position_m": drawn.scene.object_position_m,
        "told_mass_kg": drawn.expected.mass_kg,
        "told_friction_coefficient": drawn.expected.friction_coefficient,
        **{
            f"{which}_{what}": value
            for which, trial in (("by_mode", by_mode), ("by_object", by_object))
            for what, value in (
                ("held", trial.held),
                ("grip_gauge_pa", trial.grip_gauge_pa),
                ("force_n", trial.finger_force_n),
                ("note", trial.note),
            )
        },
    }


def row_text(row: dict) -> str:
    """Return the line about one grasp."""

    def told(which: str) -> str:
        return f"{1e-3 * row[f'{which}_grip_gauge_pa']:.0f} kPa {'held' if row[f'{which}_held'] else 'not held'}"

    return (
        f"{row['job']}, {row['mode']}, {1e3 * row['mass_kg']:.0f} g: {told('by_mode')}, by object {told('by_object')}"
    )


def verdict(rows: Sequence[dict]) -> dict[str, object]:
    """Return the figures of all grasps: how many were held, lost, won; forces on the objects held with both."""
    both = [row for row in rows if row["by_mode_held"] and row["by_object_held"]]
    return {
        "grasps": len(rows),
        "held_by_mode": sum(row["by_mode_held"] for row in rows),
        "held_by_object": sum(row["by_object_held"] for row in rows),
        "lost": [row["job"] for row in rows if row["by_mode_held"] and not row["by_object_held"]],
        "won": [row["job"] for row in rows if row["by_object_held"] and not row["by_mode_held"]],
        "force": [_forces("all", both)]
        + [
            _forces(mode, [row for row in both if row["mode"] == mode])
            for mode in dict.fromkeys(r["mode"] for r in both)
        ]
        + [
            _forces(f"up to {1e3 * kg:.0f} g", [row for row in both if row["told_mass_kg"] == kg])
            for kg in sorted({row["told_mass_kg"] for row in both})
        ],
    }


def _forces(name: str, rows: Sequence[dict]) -> dict[str, object]:
    def median(key: str) -> float:
        return statistics.median(row[key] for row in rows)

    return {
        "of": name,
        "grasps": len(rows),
        **{
            f"{which}_{what}": median(f"{which}_{what}")
            for which in ("by_mode", "by_object")
            for what in ("grip_gauge_pa", "force_n")
        },
    }


def verdict_text(found: dict) -> str:
    """Return the figures as a table."""
    head = ("held by both", "grasps", "by mode [kPa]", "by object [kPa]", "force [N]", "by object [N]")
    rows = [
        (
            each["of"],
            str(each["grasps"]),
            f"{1e-3 * each['by_mode_grip_gauge_pa']:.0f}",
            f"{1e-3 * each['by_object_grip_gauge_pa']:.0f}",
            f"{each['by_mode_force_n']:.2f}",
            f"{each['by_object_force_n']:.2f}",
        )
        for each in found["force"]
    ]
    return (
        f"{found['grasps']} grasps: {found['held_by_mode']} held by the pressure of the mode, "
        f"{found['held_by_object']} by that for the object; {len(found['lost'])} lost, {len(found['won'])} won\n"
        + table(head, rows)
    )
