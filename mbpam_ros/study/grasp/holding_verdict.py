"""How often held and empty are told rightly by air, camera and both, and the weights with which they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mbpam_ros.grasp.holding import AirWeights, Holding, HoldingConfig, HoldingJudge
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.terminal import table

SENSES: dict[str, tuple[str, ...]] = {"air": ("air",), "camera": ("camera",), "both": ("air", "camera")}

LARGEST_FALSE_HELD, LARGEST_FALSE_EMPTY = 0.02, 0.05
"""What is to be reached by both senses together: of the empty hands called held, of the full ones called empty."""

_RIDGE, _NEWTON_STEPS = 1e-2, 30
_PER_DEG = 0.1
"""A shortfall is fitted in tens of degrees."""


def told(row: Mapping, senses: Sequence[str], config: HoldingConfig) -> Holding:
    """Return what some senses say of a grasp's row."""
    judge = HoldingJudge(config)
    if "air" in senses:
        judge.feel(row["mode"], math.nan if row["shortfall_deg"] is None else row["shortfall_deg"])
    if "camera" in senses and row["seen"]:
        judge.see(row["size_ratio"])
    return judge.verdict().holding


def verdict(rows: Sequence[Mapping], config: HoldingConfig) -> dict[str, object]:
    """Return, for each sense and for both, the shares of full and of empty hands that are told so; all and by mode."""
    known = [row for row in rows if row["held"] is not None]
    groups = {"all": known} | {mode: [row for row in known if row["mode"] == mode] for mode in MODE_NAMES}
    return {
        "grasps": len(rows),
        "diverged": len(rows) - len(known),
        "held": sum(bool(row["held"]) for row in known),
        "told": [
            {"of": group, "by": name, **_shares(each, senses, config)}
            for group, each in groups.items()
            for name, senses in SENSES.items()
        ],
    }


def reached(found: Mapping) -> bool:
    """Return whether both senses together err no more than they may."""
    both = next(each for each in found["told"] if each["of"] == "all" and each["by"] == "both")
    return bool(both["false_held"] <= LARGEST_FALSE_HELD and both["false_empty"] <= LARGEST_FALSE_EMPTY)


def verdict_text(found: Mapping) -> str:
    """Return the figures as a table."""
    head = ("mode", "by", "full", "told held", "false empty", "empty", "told empty", "false held")
    rows = [
        (
            each["of"],
            each["by"],
            str(each["full"]),
            *(f"{each[key]:.1%}" for key in ("true_held", "false_empty")),
            str(each["empty"]),
            *(f"{each[key]:.1%}" for key in ("true_empty", "false_held")),
        )
        for each in found["told"]
    ]
    return f"{found['grasps']} grasps, {found['held']} held; the rest of each is unknown\n" + table(head, rows)


def _shares(rows: Sequence[Mapping], senses: Sequence[str], config: HoldingConfig) -> dict[str, float]:
    answers = {held: [told(row, senses, config) for row in rows if bool(row["held"]) is held] for held in (True, False)}

    def share(held: bool, what: Holding) -> float:
        return answers[held].count(what) / len(answers[held]) if answers[held] else 0.0

    return {
        "full": len(answers[True]),
        "true_held": share(True, Holding.HELD),
        "false_empty": share(True, Holding.EMPTY),
        "empty": len(answers[False]),
        "true_empty": share(False, Holding.EMPTY),
        "false_held": share(False, Holding.HELD),
    }


def fitted(rows: Sequence[Mapping], config: HoldingConfig) -> dict[str, object]:
    """Return the weights that the rows ask for, as ``grasp.yaml`` has them.

    Air: logistic regression a mode, with a small ridge. Camera: logarithms of the ratios of how often an object shows
    in place, farther away or not at all with a full and with an empty hand, one added to each count.
    """
    known = [row for row in rows if row["held"] is not None]
    air = {}
    for mode in MODE_NAMES:
        felt = [row for row in known if row["mode"] == mode and row["shortfall_deg"] is not None]
        if felt:
            weights = _logistic(
                np.array([row["shortfall_deg"] for row in felt]), np.array([bool(row["held"]) for row in felt])
            )
            air[mode] = {"at_zero": round(weights.at_zero, 3), "per_deg": round(weights.per_deg, 4)}
    seen = [row for row in known if row["seen"]]

    def in_place(row: Mapping) -> bool:
        return row["size_ratio"] is not None and row["size_ratio"] >= config.camera_size_ratio

    shows: dict[str, Callable[[Mapping], bool]] = {
        "camera_in_place": in_place,
        "camera_farther": lambda row: row["size_ratio"] is not None and not in_place(row),
        "camera_nothing": lambda row: row["size_ratio"] is None,
    }

    def ratio(shows_so: Callable[[Mapping], bool]) -> float:
        counts = {
            held: (1 + sum(shows_so(row) for row in seen if bool(row["held"]) is held))
            / (len(shows) + sum(bool(row["held"]) is held for row in seen))
            for held in (True, False)
        }
        return round(math.log(counts[True] / counts[False]), 2)

    return {"air": air, **{name: ratio(shows_so) for name, shows_so in shows.items()}}


def _logistic(shortfall_deg: np.ndarray, held: np.ndarray) -> AirWeights:
    """Newton's method for the maximum of the likelihood, its slope held back by a small ridge."""
    features = np.column_stack([np.ones(shortfall_deg.size), _PER_DEG * shortfall_deg])
    weights, ridge = np.zeros(2), np.diag([0.0, _RIDGE]) + 1e-9 * np.eye(2)
    for _ in range(_NEWTON_STEPS):
        likely = 1.0 / (1.0 + np.exp(-np.clip(features @ weights, -30.0, 30.0)))
        slope = features.T @ (held - likely) - ridge @ weights
        curvature = (features * (likely * (1.0 - likely))[:, None]).T @ features + ridge
        step = np.linalg.solve(curvature, slope)
        weights = weights + step * min(1.0, 2.0 / max(float(np.abs(step).max()), 1e-12))
    return AirWeights(float(weights[0]), float(_PER_DEG * weights[1]))
