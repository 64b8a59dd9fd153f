"""What the planner may promise: errors of scenes drawn at random, and from them a bound for every fidelity.

Scenes of a kind (in the air; a sphere, a cylinder or a box grasped) differ in their errors e by more than the
fidelities do, so what a fidelity promises is a quantile over scenes, not what it was off by in one. With the kind k,
the strains S, the tier, the number of modes m and the step h

    log e = c_k(m, h) + d_S + r

c is the median over the drawn scenes of the kind, made monotone (no nearer with a longer step or fewer modes), d what
the strains add in the median, r what is left of each scene. The promise is the q-quantile of r among the drawn scenes
with that step, those of all objects together, upon c and d; the simpler pneumatic models add a quantile of what they
were off by more.

The level q is the least at which the planner keeps its promises (conformal risk control, Angelopoulos and others 2022,
arXiv:2208.02814): for each level it is asked for plans of every kind at tolerances over their range, and with the share
R of plans that broke their promise, averaged over the n scenes,

    (n R + 1) / (n + 1) <= 5 %

holds. A plan for another scene drawn alike then keeps its promise with at least 95 %. A scene is not asked at
tolerances that its reference does not decide: where one mode less and twice the step move it by more than half of them.
Such scenes are chaotic: an object that slips out with one step and not with another, or rolls off.
"""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import (
    STRETCH_MODES,
    TWIST_MODES,
    Fidelity,
    FidelityRequest,
    FidelityTable,
    Measured,
    Tolerance,
)
from mbpam_ros.plant.planner import AIR, KINDS, REFERENCE_PNEUMATICS, PlanError, plan_for_kinds
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.study.fidelity.draws import STRAIN_SETS, TOLERANCE_PCT, drawn_scene
from mbpam_ros.study.fidelity.errors import Errors, errors, table_row
from mbpam_ros.study.fidelity.runs import run, run_coarser_reference, run_reference

Array = NDArray[np.float64]

SEED = 1
"""Of the drawn scenes; the judge draws others."""

SCENES = 60
MISSED_SHARE = 0.05
LEVELS = tuple(round(0.5 + 0.025 * number, 3) for number in range(20))
TOLERANCES_PCT = tuple(float(each) for each in np.geomspace(*TOLERANCE_PCT, 20))

LOST_PCT = 1000.0
"""What counts as the error of a run that diverged."""

LEAST_PCT = 0.01
"""Errors are not told apart below it."""

QUANTITIES = ("static_pct", "transient_pct", "contact_force_pct")
_PROBE_MODES, _PROBE_STEP_S = 2, 0.002
"""At which the simpler pneumatic models are run."""


@dataclass(frozen=True)
class DrawErrors:
    """Errors of one drawn scene.

    Args:
        kind, strains: of the scene.
        undecided_pct: by how much its reference moves with one mode less and twice the step.
        found: errors by fidelity, as :data:`QUANTITIES`; no force in the air.
    """

    kind: str
    strains: tuple[str, ...]
    undecided_pct: float
    found: dict[Fidelity, tuple[float, float, float]]


def kind_of(drawn_name: str) -> str:
    """Return the kind of a drawn scene from its name."""
    return drawn_name.split()[0]


def with_strains_of(grid: Sequence[Fidelity], strains: tuple[str, ...]) -> list[Fidelity]:
    """Return the fidelities of a grid of bending muscles, with these strains instead; without rods' rivals then."""
    if strains == ("bend",):
        return list(grid)
    twist, stretch = TWIST_MODES * ("twist" in strains), STRETCH_MODES * ("stretch" in strains)
    rods = (each for each in grid if each.tier == "rod")
    return [dataclasses.replace(each, twist_modes=twist, stretch_modes=stretch) for each in rods]


def draw_row(name: str, number: int, grid: Sequence[Fidelity], gripper: Gripper) -> dict[str, object]:
    """Return the errors of the drawn scene of that number under a job's name.

    Args:
        grid: fidelities of bending muscles; of those with the simpler pneumatics one each is run.
    """
    drawn = drawn_scene(SEED, number, gripper)
    reference = run_reference(drawn.case, drawn.strains, gripper)
    length_m = gripper.geometry.active_length_m
    coarser = errors(drawn.case, run_coarser_reference(drawn.case, drawn.strains, gripper), reference, length_m)
    found = []
    for each in with_strains_of(grid, drawn.strains):
        if not _is_run(each, kind_of(drawn.case.name)):
            continue
        try:
            off = errors(drawn.case, run(drawn.case, each, gripper), reference, length_m)
        except PlantDivergedError:
            off = Errors(LOST_PCT, LOST_PCT, LOST_PCT, LOST_PCT)
        found.append({**plain(each), **{what: getattr(off, what) or 0.0 for what in QUANTITIES}})
    undecided = max(coarser.static_pct, coarser.transient_pct)
    return {
        "job": name,
        "kind": kind_of(drawn.case.name),
        "strains": list(drawn.strains),
        "undecided_pct": undecided,
        "found": found,
    }


def plain(fidelity: Fidelity) -> dict[str, object]:
    """Return what tells the fidelities of a grid apart, as plain values of the constructor's names."""
    return {key: getattr(fidelity, key) for key in _TOLD_APART}


_TOLD_APART = ("tier", "modes", "sub_step_s", "pneumatics", "twist_modes", "stretch_modes")


def _is_run(fidelity: Fidelity, kind: str) -> bool:
    if fidelity.tier == "static" and kind != AIR:
        return False
    probe = (fidelity.tier, fidelity.modes, fidelity.sub_step_s) == ("rod", _PROBE_MODES, _PROBE_STEP_S)
    return fidelity.pneumatics == REFERENCE_PNEUMATICS or probe


def draw_errors(row: Mapping[str, object]) -> DrawErrors:
    """Return what :func:`draw_row` made, also after a stay in a file."""
    found = {
        Fidelity(**{key: each[key] for key in _TOLD_APART}): tuple(each[what] for what in QUANTITIES)
        for each in row["found"]  # type: ignore[attr-defined]
    }
    return DrawErrors(str(row["kind"]), tuple(row["strains"]), float(row["undecided_pct"]), found)  # type: ignore


class ErrorLaw:
    """The law of the errors of drawn scenes, and the bounds that it gives at a level.

    Args:
        draws: at least one of each kind that is to be bounded.
    """

    def __init__(self, draws: Sequence[DrawErrors]) -> None:
        self._draws = draws
        self._kinds = [kind for kind in KINDS if any(each.kind == kind for each in draws)]
        self._laws = [_QuantityLaw(draws, index) for index in range(len(QUANTITIES))]

    def promises(
        self, grid: Sequence[Fidelity], level: float, cost_ms_per_s: Callable[[str, Fidelity], float]
    ) -> tuple[Measured, ...]:
        """Return a row for each kind and fidelity of a grid, with bounds in place of errors.

        Args:
            cost_ms_per_s: of a fidelity in a kind of scene.
        """
        rows = []
        for kind in self._kinds:
            for each in grid:
                if each.tier == "static" and kind != AIR:
                    continue
                static, transient, force = (law.bound_pct(kind, each, level) for law in self._laws)
                bounds = Errors(static, max(static, transient), 0.0, None if kind == AIR else force)
                rows.append(table_row(kind, each, bounds, cost_ms_per_s(kind, each)))
        return tuple(rows)


Group = tuple[str, int, float]
"""Tier, modes, step."""


class _QuantityLaw:
    """c, d and r of one error."""

    def __init__(self, draws: Sequence[DrawErrors], index: int) -> None:
        logs = [
            {each: float(np.log(max(found[index], LEAST_PCT))) for each, found in draw.found.items()} for draw in draws
        ]
        exact = [
            {_group(f): value for f, value in each.items() if f.pneumatics == REFERENCE_PNEUMATICS} for each in logs
        ]
        self._centre: dict[str, dict[Group, float]] = {}
        for kind in {draw.kind for draw in draws}:
            own = [each for each, draw in zip(exact, draws, strict=True) if draw.kind == kind]
            groups = sorted({group for each in own for group in each})
            medians = {group: float(np.median([each[group] for each in own if group in each])) for group in groups}
            self._centre[kind] = _monotone(medians)
        self._added: dict[tuple[bool, tuple[str, ...]], float] = {}
        self._left: dict[tuple[bool, str, float], list[float]] = {}
        off = [
            {group: value - self._centre[draw.kind][group] for group, value in each.items()}
            for each, draw in zip(exact, draws, strict=True)
        ]
        for air in (True, False):
            for strains in STRAIN_SETS:
                own_off = [
                    value
                    for each, draw in zip(off, draws, strict=True)
                    if (draw.kind == AIR) == air and draw.strains == strains
                    for (tier, _, _), value in each.items()
                    if tier == "rod"
                ]
                self._added[air, strains] = float(np.median(own_off)) if own_off else 0.0
        for each, draw in zip(off, draws, strict=True):
            air = draw.kind == AIR
            for (tier, _, step_s), value in each.items():
                left = value - (self._added[air, draw.strains] if tier == "rod" else 0.0)
                self._left.setdefault((air, tier, step_s), []).append(left)
        self._pneumatics: dict[tuple[str, str], list[float]] = {}
        for draw in draws:
            for simpler, found in draw.found.items():
                same = draw.found.get(dataclasses.replace(simpler, pneumatics=REFERENCE_PNEUMATICS))
                if simpler.pneumatics != REFERENCE_PNEUMATICS and same is not None:
                    more = max(found[index] - same[index], 0.0)
                    self._pneumatics.setdefault((draw.kind, str(simpler.pneumatics)), []).append(more)

    def bound_pct(self, kind: str, fidelity: Fidelity, level: float) -> float:
        air, (tier, modes, step_s) = kind == AIR, _group(fidelity)
        spread = max(
            _quantile(left, level)
            for (in_air, of, step), left in self._left.items()
            if in_air == air and of == tier and step <= step_s
        )
        added = self._added[air, fidelity.strains] if tier == "rod" else 0.0
        bound = float(np.exp(self._centre[kind][tier, modes, step_s] + added + spread))
        more = self._pneumatics.get((kind, str(fidelity.pneumatics)), [])
        return bound + (_quantile(more, level) if more else 0.0)


def _group(fidelity: Fidelity) -> Group:
    return fidelity.tier, fidelity.modes, fidelity.sub_step_s


def _quantile(values: Sequence[float], level: float) -> float:
    return float(np.quantile(values, level, method="higher"))


def _monotone(errors: Mapping[Group, float]) -> dict[Group, float]:
    """Raise errors so that none is smaller than with a shorter step or more modes of the same tier."""
    return {
        (tier, modes, step_s): max(
            value for (of, more, shorter), value in errors.items() if of == tier and more >= modes and shorter <= step_s
        )
        for tier, modes, step_s in errors
    }


def calibrated(
    draws: Sequence[DrawErrors], grid: Sequence[Fidelity], cost_ms_per_s: Callable[[str, Fidelity], float]
) -> tuple[tuple[Measured, ...], dict[str, float]]:
    """Return the planner's promises and how they were chosen: level, broken share, scenes.

    The greatest level is taken where none keeps them often enough.
    """
    law = ErrorLaw(draws)

    def tried(level: float) -> tuple[tuple[Measured, ...], float, int]:
        promises = law.promises(grid, level, cost_ms_per_s)
        return promises, *broken_share(draws, promises)

    def kept(level: float) -> bool:
        _, broken, asked = tried(level)
        return (asked * broken + 1.0) / (asked + 1.0) <= MISSED_SHARE

    level = LEVELS[min(bisect.bisect_left(LEVELS, True, key=kept), len(LEVELS) - 1)]
    promises, broken, asked = tried(level)
    return promises, {"level": level, "broken_share": broken, "scenes": float(asked), "seed": float(SEED)}


def broken_share(draws: Sequence[DrawErrors], promises: tuple[Measured, ...]) -> tuple[float, int]:
    """Return the share of broken promises, averaged over scenes, and how many scenes were promised anything."""
    table = FidelityTable(rows=(), reference={}, machine={}, versions={}, promises=promises)
    chosen: dict[tuple[str, tuple[str, ...], float], Fidelity | None] = {}
    shares = []
    for draw in draws:
        kept = []
        for allowed_pct in TOLERANCES_PCT:
            key = draw.kind, draw.strains, allowed_pct
            if key not in chosen:
                chosen[key] = _chosen(table, *key)
            fidelity = chosen[key]
            if fidelity is not None and draw.undecided_pct <= 0.5 * allowed_pct:
                kept.append(_found_pct(draw, fidelity) <= allowed_pct)
        if kept:
            shares.append(1.0 - sum(kept) / len(kept))
    return float(np.mean(shares)) if shares else 0.0, len(shares)


def _chosen(table: FidelityTable, kind: str, strains: tuple[str, ...], allowed_pct: float) -> Fidelity | None:
    request = FidelityRequest(tolerance=positions_only(allowed_pct), strains=strains)
    try:
        fidelity, expected = plan_for_kinds((kind,), table, request)
    except PlanError:
        return None
    return fidelity if expected.excess <= 1.0 else None


def positions_only(allowed_pct: float) -> Tolerance:
    """Return a tolerance of positions at rest and in motion that leaves contact forces free."""
    return Tolerance(allowed_pct, allowed_pct, 1e6)


def _found_pct(draw: DrawErrors, fidelity: Fidelity) -> float:
    """Return the largest error of positions; of simpler pneumatics what they were off by more where they were run."""
    if fidelity in draw.found:
        return max(draw.found[fidelity][:2])
    exact = max(draw.found[dataclasses.replace(fidelity, pneumatics=REFERENCE_PNEUMATICS)][:2])
    probes = [each for each in draw.found if each.pneumatics == fidelity.pneumatics]
    if not probes:
        return exact
    same = max(draw.found[dataclasses.replace(probes[0], pneumatics=REFERENCE_PNEUMATICS)][:2])
    return exact + max(max(draw.found[probes[0]][:2]) - same, 0.0)
