"""Choose how a scene is computed: the cheapest way that was measured to stay within a tolerance, with the reasons.

What is in the scene says which measured cases stand for it: without anything to touch those in the air, with an object
those that grasp one of its shape. A fidelity is as far off as in the worst of them, no nearer than with a shorter step,
and never nearer than their reference is known. CPU times vary from run to run, so of those that cost next to the least
the most accurate is taken.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mbpam_ros.configuration import ConfigError
from mbpam_ros.plant.fidelity import (
    ALL_FINGERS,
    AUTO,
    STRETCH_MODES,
    TWIST_MODES,
    Fidelity,
    FidelityRequest,
    FidelityTable,
    Measured,
    Tolerance,
    load_fidelity_table,
)
from mbpam_ros.plant.scene import Scene

AIR_CASES = ("free_bend", "unequal_pressures", "fast_release")
GRASP_CASES = {"sphere": ("sphere", "lift"), "cylinder": ("slender_rod",), "box": ("box",)}
REFERENCE_PNEUMATICS = "iso6358"
SAME_COST = 1.1
"""Costs within this factor count as equal: medians of process times repeat no better."""

_PARTS = ("pneumatics", "tier", "modes", "sub_step_s")
FREE_MODES, CONTACT_MODES = 2, 3
"""Of a rod for which nothing else is decided, in the air and where there may be contact."""


class PlanError(ConfigError):
    """Nothing that was measured fits what is asked for; the message says what does."""


@dataclass(frozen=True)
class Expected:
    """What a fidelity was measured to be off by, the worst of its cases [%], and to cost, their mean.

    Args:
        static_pct, transient_pct, contact_force_pct: as in :class:`~mbpam_ros.plant.fidelity.Tolerance`.
        cpu_ms_per_s: for one simulated second.
        excess: the largest error over what is allowed; up to 1 is within the tolerance.
    """

    static_pct: float
    transient_pct: float
    contact_force_pct: float
    cpu_ms_per_s: float
    excess: float

    def __str__(self) -> str:
        errors = f"{_figure(self.static_pct)} % at rest, {_figure(self.transient_pct)} % in motion"
        force = f", {_figure(self.contact_force_pct)} % of force" if self.contact_force_pct else ""
        return f"{errors}{force}, {self.cpu_ms_per_s:.0f} ms/s"


@dataclass(frozen=True)
class Plan:
    """How a scene is to be computed.

    Args:
        fidelity: the way that was chosen.
        contact: whether anything can touch.
        camera: whether there is anything to see.
        expected: errors and cost.
        reasons: for each part, by its name, in lines.
    """

    fidelity: Fidelity
    contact: bool
    camera: bool
    expected: Expected
    reasons: dict[str, tuple[str, ...]]

    @property
    def within_tolerance(self) -> bool:
        """Whether every error is expected to be within what is allowed."""
        return self.expected.excess <= 1.0

    def __str__(self) -> str:
        chosen = self.fidelity
        values = {
            "pneumatics": str(chosen.pneumatics),
            "tier": chosen.tier,
            "modes": str(chosen.modes),
            "air_modes": str(chosen.air_modes or chosen.modes),
            "sub_step_s": f"{1e3 * chosen.sub_step_s:g} ms",
            "contact": "yes" if self.contact else "no",
            "camera": "yes" if self.camera else "no",
            "moving_fingers": " ".join(map(str, chosen.moving_fingers)),
        }
        verdict = (
            "within the tolerance" if self.within_tolerance else "OUTSIDE the tolerance; nothing measured is nearer"
        )
        lines = [f"{'expected':<15} {self.expected}: {verdict}"]
        for name, value in values.items():
            first, *others = self.reasons[name]
            lines += [f"{name:<15} {value:<8} {first}", *(f"{'':<24} {other}" for other in others)]
        return "\n".join(lines)


def may_touch(scene: Scene, finger_length_m: float) -> bool:
    """Whether the fingers of that length may touch an object or a table."""
    support = scene.support
    return scene.object is not None or (support is not None and support.planes_m[-1, 0] < finger_length_m)


def cases_of(scene: Scene, contact: bool) -> tuple[str, ...]:
    """Return the measured cases that stand for a scene, with or without contact."""
    if not contact:
        return AIR_CASES
    if scene.object is None:
        return tuple(case for cases in GRASP_CASES.values() for case in cases)
    return GRASP_CASES[scene.object.shape]


def choose_fidelity(
    scene: Scene, request: FidelityRequest, finger_length_m: float, tick_s: float | None = None
) -> Fidelity:
    """Return how a scene is computed: as asked for where a tier and a step are, else as planned. The plan is logged.

    Args:
        scene: what is there.
        request: how a scene file or a user wants it computed.
        finger_length_m, tick_s: as in :func:`plan`.

    Raises:
        PlanError: nothing that was measured fits what is asked for.
        ConfigError: the measured table cannot be read.
    """
    if request.tier == AUTO or request.sub_step_s is None:
        made = plan(scene, finger_length_m, load_fidelity_table(), request, tick_s)
        logging.getLogger(__name__).info("scene %s is computed so:\n%s", scene.name, made)
        return made.fidelity
    contact, modes = request.contact is not False, request.modes
    if modes is None:
        in_contact = contact and may_touch(scene, finger_length_m)
        modes = 1 if request.tier != "rod" else CONTACT_MODES if in_contact else FREE_MODES
    chosen = Fidelity(request.tier, modes, request.sub_step_s, request.pneumatics, request.air_modes)
    return _with_what_is_not_measured(chosen, request)


def plan(
    scene: Scene,
    finger_length_m: float,
    table: FidelityTable,
    request: FidelityRequest,
    tick_s: float | None = None,
    camera: bool | None = None,
) -> Plan:
    """Return how to compute a scene.

    Args:
        scene: what is there.
        finger_length_m: of the muscles, how far down they reach.
        table: measured errors and costs.
        request: what errors are allowed, and what is decided already. Pneumatics that are decided are taken for the
            real ones: what they differ from ISO 6358 is then no error. A step that was not measured counts as the next
            longer one that was.
        tick_s: steps must go into it a whole number of times; none for any.
        camera: whether to render images; none for where there is an object.

    Raises:
        PlanError: nothing that was measured fits what is decided.
    """
    allowed = request.tolerance or Tolerance()
    touch = may_touch(scene, finger_length_m) if request.contact is None else request.contact
    cases = cases_of(scene, touch)
    candidates = _candidates(table, cases, allowed, request, tick_s)
    best = _best(candidates)
    seen = scene.object is not None
    chosen = best if request.sub_step_s is None else dataclasses.replace(best, sub_step_s=request.sub_step_s)
    if touch and seen and chosen.tier == "rod":
        air_modes = request.air_modes or _air_modes(chosen, table, allowed)
        chosen = dataclasses.replace(chosen, air_modes=air_modes)
    reasons = {part: _reason(part, best, candidates, _decided(request, part)) for part in _PARTS}
    reasons["air_modes"] = ("enough while the object is out of reach" if chosen.air_modes else "the same throughout",)
    within = "forced" if request.contact is not None else None if touch else "nothing is within reach"
    reasons["contact"] = (within or f"measured on {', '.join(cases)}",)
    reasons["camera"] = ("forced" if camera is not None else f"{'an' if seen else 'no'} object to see",)
    reasons["moving_fingers"] = ("forced" if request.moving_fingers else "any of their chambers may be filled",)
    return Plan(
        fidelity=_with_what_is_not_measured(chosen, request),
        contact=touch,
        camera=seen if camera is None else camera,
        expected=candidates[best],
        reasons=reasons,
    )


def _with_what_is_not_measured(chosen: Fidelity, request: FidelityRequest) -> Fidelity:
    return dataclasses.replace(
        chosen,
        moving_fingers=request.moving_fingers or ALL_FINGERS,
        contact=request.contact is not False,
        largest_jump_pct=(request.tolerance or Tolerance()).static_pct,
        twist_modes=TWIST_MODES if "twist" in request.strains else 0,
        stretch_modes=STRETCH_MODES if "stretch" in request.strains else 0,
    )


def _decided(request: FidelityRequest, part: str) -> object:
    """Return what a request says of a part; none where it leaves it open."""
    value: object = getattr(request, part)
    return None if value == AUTO else value


def _air_modes(chosen: Fidelity, table: FidelityTable, allowed: Tolerance) -> int | None:
    """Return fewer modes that do while an object is out of reach; none if they would not cost less."""
    same = FidelityRequest(sub_step_s=chosen.sub_step_s, pneumatics=chosen.pneumatics)
    try:
        found = _candidates(table, AIR_CASES, allowed, same, None)
    except PlanError:  # not measured in the air
        return None
    best = _best(found)
    own = [found[each].cpu_ms_per_s for each in found if (each.tier, each.modes) == ("rod", chosen.modes)]
    return best.modes if own and own[0] > SAME_COST * found[best].cpu_ms_per_s else None


def _candidates(
    table: FidelityTable, cases: tuple[str, ...], allowed: Tolerance, request: FidelityRequest, tick_s: float | None
) -> dict[Fidelity, Expected]:
    """Return what is expected of every fidelity that was measured in all cases and fits what is forced."""
    measured = {(row.scene, row.fidelity): row for row in table.rows}
    everywhere = {row.fidelity for row in table.rows if all((case, row.fidelity) in measured for case in cases)}
    fitting = _fitting(everywhere, request, tick_s)
    if not fitting:
        decided = {part: _decided(request, part) for part in _PARTS}
        given = [f"{part} {_short(value)}" for part, value in decided.items() if value is not None]
        given += [] if tick_s is None else [f"a tick of {tick_s:g} s"]
        there = "; ".join(f"{part} {', '.join(map(_short, _values(everywhere, part)))}" for part in _PARTS)
        raise PlanError(
            f"nothing measured on {', '.join(cases)} fits {', '.join(given) or 'it'}; measured there: {there}"
        )
    found = {}
    for each in sorted(fitting):
        costing = [measured[case, each] for case in cases]
        pneumatics = each.pneumatics if request.pneumatics is None else REFERENCE_PNEUMATICS
        judging = [row for row in table.rows if row.scene in cases and _no_longer_step(row, each, pneumatics)]
        found[each] = _expected(judging or costing, costing, table, allowed)
    return found


def _no_longer_step(row: Measured, fidelity: Fidelity, pneumatics: str | None) -> bool:
    """Whether a row differs from a fidelity in no more than a shorter step: a longer one is nearer by luck only."""
    same = (row.tier, row.modes, row.pneumatics) == (fidelity.tier, fidelity.modes, pneumatics)
    return same and row.step_s <= fidelity.sub_step_s


def _fitting(everywhere: Iterable[Fidelity], request: FidelityRequest, tick_s: float | None) -> list[Fidelity]:
    wanted = {part: _decided(request, part) for part in _PARTS}
    if request.sub_step_s is not None:
        longer = (each.sub_step_s for each in everywhere if each.sub_step_s >= request.sub_step_s)
        wanted["sub_step_s"] = min(longer, default=-1.0)
    return [
        each
        for each in everywhere
        if all(value is None or getattr(each, part) == value for part, value in wanted.items())
        and (request.sub_step_s is not None or _goes_into(each.sub_step_s, tick_s))
    ]


def _values(fidelities: Iterable[Fidelity], part: str) -> list[object]:
    return sorted({getattr(each, part) for each in fidelities})


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _goes_into(step_s: float, tick_s: float | None) -> bool:
    if tick_s is None:
        return True
    count = round(tick_s / step_s)
    return count >= 1 and abs(count * step_s - tick_s) < 1e-6 * step_s


def _expected(judging: list[Measured], costing: list[Measured], table: FidelityTable, allowed: Tolerance) -> Expected:
    def worst(error: Callable[[Measured], float | None], known: str) -> float:
        return max(max(error(row) or 0.0, table.reference.get(row.scene, {}).get(known, 0.0)) for row in judging)

    static = worst(lambda row: row.static_error_pct, "static_pct")
    transient = worst(lambda row: row.transient_error_pct, "transient_pct")
    force = worst(lambda row: row.contact_force_error_pct, "contact_force_pct")
    return Expected(
        static_pct=static,
        transient_pct=transient,
        contact_force_pct=force,
        cpu_ms_per_s=sum(row.cpu_ms_per_s for row in costing) / len(costing),
        excess=max(static / allowed.static_pct, transient / allowed.transient_pct, force / allowed.contact_force_pct),
    )


def _best(candidates: dict[Fidelity, Expected]) -> Fidelity:
    """Return the cheapest within the tolerance, of those that cost about the same the nearest; else the nearest."""
    within = {each: expected for each, expected in candidates.items() if expected.excess <= 1.0}
    if within:
        limit = SAME_COST * min(expected.cpu_ms_per_s for expected in within.values())
        candidates = {each: expected for each, expected in within.items() if expected.cpu_ms_per_s <= limit}
    return min(candidates, key=lambda each: candidates[each].excess)


def _reason(part: str, chosen: Fidelity, candidates: dict[Fidelity, Expected], decided: object) -> tuple[str, ...]:
    """Say what else there was for one part, the others being free, and what the best of it would give."""
    if decided is not None:
        return ("forced",)
    others = [value for value in _values(candidates, part) if value != getattr(chosen, part)]
    if not others:
        return ("nothing else was measured with the rest",)
    told = []
    for value in others:
        rivals = {each: expected for each, expected in candidates.items() if getattr(each, part) == value}
        expected = rivals[_best(rivals)]
        name = f"{1e3 * value:g} ms" if isinstance(value, float) else str(value)
        told.append(f"not {name}: {expected}{', too far off' if expected.excess > 1.0 else ''}")
    return tuple(told)


def _figure(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
