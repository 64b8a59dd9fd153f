"""Choose how a scene is computed: the cheapest way that keeps within a tolerance, with the reasons.

What is in the scene says which kind it is: with nothing to touch one in the air, with an object a grasp of one of its
shape. A table with promises (:mod:`~mbpam_ros.study.fidelity.calibration`) says what scenes of that kind, drawn at
random, are off by at most in 95 of 100 plans; in one without them the measured cases of the kind stand for it, the
worst of them. In both a fidelity is no nearer than with a shorter step. To that error, of the solution, comes the one
of its equations: how far a rod that only bends, or also stretches and twists, is off the muscle in finite elements. Of
fidelities that cost next to the least the most accurate is taken. Where the equations alone are beyond the tolerance,
those that are off least are taken with a solution that is within it: one that is nearer would not help.

A scene outside what was drawn (in size, mass, friction, pressure or pose) is told how far outside it is, in widths of
the range, each; its errors are taken to be 1 + their sum times as large.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mbpam_ros.configuration import ConfigError, load_config
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
from mbpam_ros.plant.tiers.base import PlantConfig

AIR = "air"
KINDS = (AIR, "sphere", "cylinder", "box")
"""Of scenes: nothing to touch, or the shape of what is grasped."""

AIR_CASES = ("free_bend", "unequal_pressures", "fast_release")
GRASP_CASES = {"sphere": ("sphere", "lift"), "cylinder": ("slender_rod",), "box": ("box",)}
REFERENCE_PNEUMATICS = "iso6358"
SAME_COST = 1.1
"""Costs within this factor count as equal: medians of process times repeat no better."""

SAME_ERROR = 1.1
"""Errors within this factor of the least count as equal where none is within the tolerance."""

_PARTS = ("pneumatics", "tier", "strains", "modes", "sub_step_s")
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
        model_pct: the model's part in the first two.
        solution_excess, model_excess: ``excess`` of either alone.
    """

    static_pct: float
    transient_pct: float
    contact_force_pct: float
    cpu_ms_per_s: float
    excess: float
    model_pct: float = 0.0
    solution_excess: float = 0.0
    model_excess: float = 0.0

    def __str__(self) -> str:
        errors = f"{_figure(self.static_pct)} % at rest, {_figure(self.transient_pct)} % in motion"
        if self.model_pct:
            errors += f" ({_figure(self.model_pct)} of them the model's)"
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
        warnings: what the scene has that none of those was like that the plan is made from.
    """

    fidelity: Fidelity
    contact: bool
    camera: bool
    expected: Expected
    reasons: dict[str, tuple[str, ...]]
    warnings: tuple[str, ...] = ()

    @property
    def within_tolerance(self) -> bool:
        """Whether every error is expected to be within what is allowed."""
        return self.expected.excess <= 1.0

    def __str__(self) -> str:
        chosen = self.fidelity
        values = {
            "pneumatics": str(chosen.pneumatics),
            "tier": chosen.tier,
            "strains": _short(chosen.strains),
            "modes": str(chosen.modes),
            "air_modes": str(chosen.air_modes or chosen.modes),
            "sub_step_s": f"{1e3 * chosen.sub_step_s:g} ms",
            "contact": "yes" if self.contact else "no",
            "camera": "yes" if self.camera else "no",
            "moving_fingers": " ".join(map(str, chosen.moving_fingers)),
        }
        lines = [f"{'expected':<15} {self.expected}: {self._verdict()}"]
        for name, value in values.items():
            first, *others = self.reasons[name]
            lines += [f"{name:<15} {value:<8} {first}", *(f"{'':<24} {other}" for other in others)]
        return "\n".join([*(f"{'warning':<15} {each}" for each in self.warnings), *lines])

    def _verdict(self) -> str:
        if self.within_tolerance:
            return "within the tolerance"
        if self.expected.model_excess > 1.0 >= self.expected.solution_excess:
            return "OUTSIDE the tolerance by the model's error; a nearer solution would not help"
        return "OUTSIDE the tolerance; nothing measured is nearer"


def may_touch(scene: Scene, finger_length_m: float) -> bool:
    """Whether the fingers of that length may touch an object or a table."""
    support = scene.support
    return scene.object is not None or (support is not None and support.planes_m[-1, 0] < finger_length_m)


def kinds_of(scene: Scene, contact: bool) -> tuple[str, ...]:
    """Return the kinds that a scene may be of, with or without contact; all with it where only fingers touch."""
    if not contact:
        return (AIR,)
    return KINDS[1:] if scene.object is None else (scene.object.shape,)


def cases_of(scene: Scene, contact: bool) -> tuple[str, ...]:
    """Return the measured cases that stand for a scene, with or without contact."""
    return _cases_of_kinds(kinds_of(scene, contact))


def _cases_of_kinds(kinds: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(case for kind in kinds for case in (AIR_CASES if kind == AIR else GRASP_CASES[kind]))


def features_of(scene: Scene, pressure_gauge_pa: float | None = None) -> dict[str, float]:
    """Return what tells scenes of a kind apart, each with its unit; the largest pressure where it is known.

    Raises:
        ConfigError: ``plant.yaml``, whose contact acts where the scene gives none, cannot be read.
    """
    found = {} if pressure_gauge_pa is None else {"pressure [kPa]": 1e-3 * pressure_gauge_pa}
    found["tilt [deg]"] = math.degrees(math.acos(min(max(scene.gravity_direction[2], -1.0), 1.0)))
    found["gravity [m/s2]"] = scene.gravity_m_s2
    spec, place = scene.object, scene.object_position_m
    if spec is None or place is None:
        return found
    contact = load_config(PlantConfig, "plant.yaml").finger_object
    own_friction, own_stiffness = scene.friction_coefficient, scene.contact_stiffness_n_m
    sizes = {"sphere": ("diameter",), "cylinder": ("diameter", "", "length"), "box": ("width", "length", "height")}
    found |= {f"{name} [mm]": 1e3 * size for name, size in zip(sizes[spec.shape], spec.size_m, strict=False) if name}
    return found | {
        "mass [g]": 1e3 * spec.mass_kg,
        "friction": contact.friction_coefficient if own_friction is None else own_friction,
        "contact stiffness [N/m]": contact.stiffness_n_m if own_stiffness is None else own_stiffness,
        "depth [mm]": 1e3 * place[2],
        "offset [mm]": 1e3 * math.hypot(place[0], place[1]),
        "yaw [deg]": abs(math.remainder(math.degrees(scene.object_yaw_rad), 180.0)) if spec.shape != "sphere" else 0.0,
        "lift speed [mm/s]": 1e3 * scene.lift.height_m / scene.lift.duration_s,
    }


def _unlike(
    scene: Scene, kinds: tuple[str, ...], table: FidelityTable, pressure_gauge_pa: float | None
) -> tuple[tuple[str, ...], float]:
    """Return what of a scene is outside the ranges of the table, in words, and the factor on its errors."""
    told, factor = [], 1.0
    if scene.others:
        told.append(f"{len(scene.placed)} objects, measured with one")
        factor += len(scene.others)
    elif not table.ranges:
        return (), 1.0
    for name, value in features_of(scene, pressure_gauge_pa).items():
        spans = [table.ranges[kind][name] for kind in kinds if name in table.ranges.get(kind, {})]
        if not spans:
            continue
        low, high = min(span[0] for span in spans), max(span[1] for span in spans)
        width = max(high - low, 0.25 * abs(high), 1e-9)
        distance = max(low - value, value - high, 0.0) / width
        if distance > 1e-6:
            told.append(f"{name.split(' [')[0]} {value:.4g}, measured from {low:.4g} to {high:.4g}{_unit(name)}")
            factor += distance
    if told:
        told.append(
            f"so errors are taken {factor:.2g} times as large; to measure this scene itself: mbpam plan --measure"
        )
    return tuple(told), factor


def _unit(feature: str) -> str:
    return f" {feature[feature.index('[') + 1 : -1]}" if "[" in feature else ""


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
    chosen = _with_strains(
        Fidelity(request.tier, modes, request.sub_step_s, request.pneumatics, request.air_modes),
        request.strains or ("bend",),
    )
    return _with_what_is_not_measured(chosen, request)


def plan(
    scene: Scene,
    finger_length_m: float,
    table: FidelityTable,
    request: FidelityRequest,
    tick_s: float | None = None,
    camera: bool | None = None,
    pressure_gauge_pa: float | None = None,
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
        pressure_gauge_pa: the largest that acts; none for one within the range of the table.

    Raises:
        PlanError: nothing that was measured fits what is decided.
        ConfigError: see :func:`features_of`.
    """
    allowed = request.tolerance or Tolerance()
    touch = may_touch(scene, finger_length_m) if request.contact is None else request.contact
    kinds = kinds_of(scene, touch)
    warnings, factor = _unlike(scene, kinds, table, pressure_gauge_pa)
    candidates = _candidates(table, kinds, allowed, request, tick_s, factor)
    best = _best(candidates)
    seen = scene.object is not None
    chosen = best if request.sub_step_s is None else dataclasses.replace(best, sub_step_s=request.sub_step_s)
    if touch and seen and chosen.tier == "rod":
        air_modes = request.air_modes or _air_modes(chosen, table, allowed)
        if air_modes is not None and air_modes > chosen.modes:
            raise PlanError(f"air_modes {air_modes} are more than the modes in contact, {chosen.modes}: give modes too")
        chosen = dataclasses.replace(chosen, air_modes=air_modes)
    reasons = {part: _reason(part, best, candidates, _decided(request, part)) for part in _PARTS}
    reasons["air_modes"] = ("enough while the object is out of reach" if chosen.air_modes else "the same throughout",)
    within = "forced" if request.contact is not None else None if touch else "nothing is within reach"
    on = _cases_of_kinds(kinds) if not table.promises else tuple(f"drawn scenes: {kind}" for kind in kinds)
    reasons["contact"] = (within or f"measured on {', '.join(on)}",)
    reasons["camera"] = ("forced" if camera is not None else f"{'an' if seen else 'no'} object to see",)
    reasons["moving_fingers"] = ("forced" if request.moving_fingers else "any of their chambers may be filled",)
    return Plan(
        fidelity=_with_what_is_not_measured(chosen, request),
        contact=touch,
        camera=seen if camera is None else camera,
        expected=candidates[best],
        reasons=reasons,
        warnings=warnings,
    )


def plan_for_kinds(
    kinds: tuple[str, ...], table: FidelityTable, request: FidelityRequest, tick_s: float | None = None
) -> tuple[Fidelity, Expected]:
    """Return how to compute scenes of some of :data:`KINDS`, of which nothing else is known, and what is expected.

    Raises:
        PlanError: nothing that was measured fits what is decided.
    """
    candidates = _candidates(table, kinds, request.tolerance or Tolerance(), request, tick_s)
    best = _best(candidates)
    return best, candidates[best]


def _with_what_is_not_measured(chosen: Fidelity, request: FidelityRequest) -> Fidelity:
    return dataclasses.replace(
        chosen,
        moving_fingers=request.moving_fingers or ALL_FINGERS,
        contact=request.contact is not False,
        largest_jump_pct=(request.tolerance or Tolerance()).static_pct,
    )


def _with_strains(chosen: Fidelity, strains: tuple[str, ...]) -> Fidelity:
    return dataclasses.replace(
        chosen,
        twist_modes=TWIST_MODES if "twist" in strains else 0,
        stretch_modes=STRETCH_MODES if "stretch" in strains else 0,
    )


def _decided(request: FidelityRequest, part: str) -> object:
    """Return what a request says of a part; none where it leaves it open."""
    value: object = getattr(request, part)
    return None if value == AUTO else value


def _air_modes(chosen: Fidelity, table: FidelityTable, allowed: Tolerance) -> int | None:
    """Return fewer modes that do while an object is out of reach; none if they would not cost less."""
    same = FidelityRequest("rod", chosen.sub_step_s, chosen.pneumatics, strains=chosen.strains)
    try:
        found = _candidates(table, (AIR,), allowed, same, None)
    except PlanError:  # not measured in the air
        return None
    found = {each: expected for each, expected in found.items() if each.modes <= chosen.modes}
    own = [expected.cpu_ms_per_s for each, expected in found.items() if each.modes == chosen.modes]
    if not own:
        return None
    best = _best(found)
    return best.modes if own[0] > SAME_COST * found[best].cpu_ms_per_s else None


def _candidates(
    table: FidelityTable,
    kinds: tuple[str, ...],
    allowed: Tolerance,
    request: FidelityRequest,
    tick_s: float | None,
    factor: float = 1.0,
) -> dict[Fidelity, Expected]:
    """Return what is expected of every fidelity that was measured in all cases and fits what is forced.

    Args:
        factor: on the errors of the solution.
    """
    cases = kinds if table.promises else _cases_of_kinds(kinds)
    measured: dict[Fidelity, list[Measured]] = defaultdict(list)
    alike: dict[tuple[object, ...], list[Measured]] = defaultdict(list)
    for row in table.judging:
        if row.scene in cases:
            measured[row.fidelity].append(row)
            alike[_but_for_the_step(row, row.pneumatics)].append(row)
    everywhere = {each for each, rows in measured.items() if {row.scene for row in rows} == set(cases)}
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
        pneumatics = each.pneumatics if request.pneumatics is None else REFERENCE_PNEUMATICS
        rows = alike.get(_but_for_the_step(each, pneumatics), [])
        # A longer step is nearer by luck only.
        judging = [row for row in rows if row.step_s <= each.sub_step_s] or measured[each]
        model_pct = table.model_error_pct(each.strains, loaded=kinds != (AIR,))
        found[each] = _expected(judging, measured[each], table, allowed, model_pct, factor)
    return found


def _but_for_the_step(each: Fidelity | Measured, pneumatics: str | None) -> tuple[object, ...]:
    return each.tier, each.modes, pneumatics, each.twist_modes, each.stretch_modes


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
    if isinstance(value, tuple):
        return "+".join(value)
    return f"{value:g}" if isinstance(value, float) else str(value)


def _goes_into(step_s: float, tick_s: float | None) -> bool:
    if tick_s is None:
        return True
    count = round(tick_s / step_s)
    return count >= 1 and abs(count * step_s - tick_s) < 1e-6 * step_s


def _expected(
    judging: list[Measured],
    costing: list[Measured],
    table: FidelityTable,
    allowed: Tolerance,
    model_pct: float,
    factor: float,
) -> Expected:
    def worst(error: Callable[[Measured], float | None], known: str) -> float:
        return factor * max(
            max(error(row) or 0.0, table.reference.get(row.scene, {}).get(known, 0.0)) for row in judging
        )

    static = worst(lambda row: row.static_error_pct, "static_pct")
    transient = worst(lambda row: row.transient_error_pct, "transient_pct")
    force = worst(lambda row: row.contact_force_error_pct, "contact_force_pct")

    def excess(model_pct: float) -> float:
        return max(
            (model_pct + static) / allowed.static_pct,
            (model_pct + transient) / allowed.transient_pct,
            force / allowed.contact_force_pct,
        )

    return Expected(
        static_pct=model_pct + static,
        transient_pct=model_pct + transient,
        contact_force_pct=force,
        cpu_ms_per_s=sum(row.cpu_ms_per_s for row in costing) / len(costing),
        excess=excess(model_pct),
        model_pct=model_pct,
        solution_excess=excess(0.0),
        model_excess=model_pct / min(allowed.static_pct, allowed.transient_pct),
    )


def _best(candidates: dict[Fidelity, Expected]) -> Fidelity:
    """Return the cheapest within the tolerance, of those that cost about the same the nearest; else the nearest."""
    within = {each: expected for each, expected in candidates.items() if expected.excess <= 1.0}
    if not within and all(expected.model_excess > 1.0 for expected in candidates.values()):
        # A solution that is nearer than the tolerance makes up for no model.
        least_pct = min(expected.model_pct for expected in candidates.values())
        candidates = {each: expected for each, expected in candidates.items() if expected.model_pct <= least_pct}
        within = {each: expected for each, expected in candidates.items() if expected.solution_excess <= 1.0}
    if not within:
        nearest = min(expected.excess for expected in candidates.values())
        near = [each for each, expected in candidates.items() if expected.excess <= SAME_ERROR * nearest]
        return min(near, key=lambda each: candidates[each].cpu_ms_per_s)
    limit = SAME_COST * min(expected.cpu_ms_per_s for expected in within.values())
    cheap = [each for each, expected in within.items() if expected.cpu_ms_per_s <= limit]
    return min(cheap, key=lambda each: within[each].excess)


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
        name = f"{1e3 * value:g} ms" if isinstance(value, float) else _short(value)
        told.append(f"not {name}: {expected}{', too far off' if expected.excess > 1.0 else ''}")
    return tuple(told)


def _figure(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
