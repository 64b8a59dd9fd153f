"""States of one muscle under pressures, loads on its tip and gravity: what describes them, and the rod's answer.

A state is a mapping with the keys ``pattern``, ``pressure_kpa``, ``tip_force_n``, ``tip_torque_n_mm`` and
``gravity_m_s2``; an answer, the rod's or the finite elements', has besides these ``tip_position_mm``,
``tip_direction``, ``tip_roll_deg`` and ``tip_angle_deg``. All in the muscle frame: origin at the clamp, z toward the
tip of the straight muscle. The tip is the centre of its end face; the force on it keeps its direction, the torque turns
right-handed about the tip's own. Roll and angle: :class:`~mbpam_ros.actuator.elastic_rod.RodAtRest`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.elastic_rod import HANGING, NO_JOINT, RIGID, RodLoads, RodSection, rod_at_rest, rod_section
from mbpam_ros.actuator.end_law import EndLaw
from mbpam_ros.actuator.rod_law import RodLaw
from mbpam_ros.errors import MbpamError
from mbpam_ros.terminal import table

Array = NDArray[np.float64]

PATTERN_SHARES = {"pdc": (1.0, 0.0, 0.0, 1.0), "psc": (1.0, 0.0, 0.0, 0.0), "half": (1.0, 0.5, 0.0, 0.0)}
"""Pressures of chambers 1 to 4 over the state's: they bend toward azimuth 180 and 225 deg and, half, near 240."""

KINDS = ("free", "in plane", "sideways", "axial", "torque", "several")
"""Of load: none, a force in the plane of the bend, one across it, one along the unloaded tip, a torque, or more."""

_ALONG = 0.95

_LEAST_DISPLACEMENT_MM = 0.01
"""A torque on a straight muscle moves its tip nowhere: there is nothing to be compared."""


class MuscleStateError(MbpamError, ValueError):
    """Something describes no state of a muscle, or a file holds none; the message says what is wrong, and where."""


@dataclass(frozen=True)
class MuscleState:
    """Pressures and loads of one muscle, in the units of the files.

    Args:
        pattern: a key of :data:`PATTERN_SHARES`.
        pressure_kpa: the highest chamber's, gauge.
        tip_force_n: on the centre of the tip's end face, (3,); keeps its direction.
        tip_torque_n_mm: about the tip's current direction.
        gravity_m_s2: acceleration as a vector, (3,).

    Raises:
        MuscleStateError: one of these cannot be.
    """

    pattern: str
    pressure_kpa: float
    tip_force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_torque_n_mm: float = 0.0
    gravity_m_s2: tuple[float, float, float] = HANGING

    def __post_init__(self) -> None:
        if self.pattern not in PATTERN_SHARES:
            raise MuscleStateError(f"unknown pattern {self.pattern!r}; known: {', '.join(PATTERN_SHARES)}")
        if not (math.isfinite(self.pressure_kpa) and self.pressure_kpa >= 0.0):
            raise MuscleStateError(f"pressure_kpa must be 0 or more, found {self.pressure_kpa}")
        try:
            self.loads()
        except ValueError as error:
            raise MuscleStateError(str(error)) from error

    @classmethod
    def of_row(cls, row: dict[str, Any]) -> MuscleState:
        """Return the state that a row of a file describes; other keys are left alone.

        Raises:
            MuscleStateError: it describes none.
        """
        try:
            return cls(
                str(row["pattern"]),
                float(row["pressure_kpa"]),
                _three(row["tip_force_n"]),
                float(row["tip_torque_n_mm"]),
                _three(row["gravity_m_s2"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise MuscleStateError(f"no state of a muscle: {error!r}") from error

    @property
    def pressure_gauge_pa(self) -> Array:
        """Pressures of chambers 1 to 4, shape (4,)."""
        return 1e3 * self.pressure_kpa * np.array(PATTERN_SHARES[self.pattern])

    @property
    def is_loaded(self) -> bool:
        """Whether anything but pressure and weight acts on it."""
        return any(self.tip_force_n) or self.tip_torque_n_mm != 0.0

    @property
    def unloaded(self) -> MuscleState:
        """The same without loads on the tip."""
        return replace(self, tip_force_n=(0.0, 0.0, 0.0), tip_torque_n_mm=0.0)

    def loads(self) -> RodLoads:
        """Return the loads in SI units."""
        return RodLoads(self.tip_force_n, 1e-3 * self.tip_torque_n_mm, self.gravity_m_s2)


@dataclass(frozen=True)
class RodModel:
    """Which rod answers.

    Args:
        law: of the active part.
        geometry: of the rod.
        strains: what the active part may do.
        ends: section of the two ends.
        bending: how the active part's moment follows its curvature, ``line`` or ``curve``.
        joints: between the ends and the active part, with its shear; None: it goes on into them, and has none.
        measured_by_m: length that errors are told over; None: the rod's active length.
    """

    law: RodLaw
    geometry: MuscleGeometry
    strains: tuple[str, ...]
    ends: RodSection = RIGID
    bending: str = "line"
    joints: EndLaw | None = None
    measured_by_m: float | None = None


def rod_answer(state: MuscleState, model: RodModel) -> dict[str, Any]:
    """Return the state with the rod's answer, as a row of a file.

    Raises:
        ValueError: unknown strains.
        StrainLawError: the law says nothing of a strain.
        RodSolutionError: the rod has no equilibrium there.
    """
    section = rod_section(model.law, state.pressure_gauge_pa, model.strains, model.bending)
    joint = NO_JOINT
    if model.joints is not None:
        joint = model.joints.joint(state.pressure_gauge_pa)
        section = section._replace(shear_compliance_per_n=model.joints.shear_compliance_per_n(state.pressure_gauge_pa))
    rod = rod_at_rest(section, model.geometry, state.loads(), ends=model.ends, joint=joint)
    return {
        **{name: list(value) if isinstance(value, tuple) else value for name, value in asdict(state).items()},
        "tip_position_mm": (1e3 * rod.tip_position_m).tolist(),
        "tip_direction": rod.tip_direction.tolist(),
        "tip_roll_deg": math.degrees(rod.tip_roll_rad),
        "tip_angle_deg": math.degrees(rod.tip_angle_rad),
    }


class AnsweredStates(NamedTuple):
    """A file of states and someone's answers.

    Args:
        rows: a mapping a state.
        mass_per_length_kg_m: of the muscle that answered, ``settings: mass_per_length_kg_m: waves``; None: not said.
    """

    rows: list[dict[str, Any]]
    mass_per_length_kg_m: float | None


def read_states(path: Path) -> AnsweredStates:
    """Return what a file of answered states holds, ``{"states": [...]}``.

    Raises:
        MuscleStateError: it cannot be read, or a row has no state or no answer; the message says which.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = content["states"]
        mass = content.get("settings", {}).get("mass_per_length_kg_m", {}).get("waves")
        mass_kg_m = None if mass is None else float(mass)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MuscleStateError(f'{path}: no file of muscle states, {{"states": [...]}}: {error!r}') from error
    for number, row in enumerate(rows, 1):
        try:
            MuscleState.of_row(row)
            _three(row["tip_position_mm"]), _three(row["tip_direction"]), float(row["tip_roll_deg"])
        except (MuscleStateError, KeyError, TypeError, ValueError) as error:
            raise MuscleStateError(f"{path}: state {number}: {error}") from error
    return AnsweredStates(rows, mass_kg_m)


def compared(rows: Sequence[dict[str, Any]], model: RodModel) -> list[dict[str, Any]]:
    """Return the rod's answer to each state beside that of ``rows``.

    Each has, besides the rod's answer: ``kind`` of load, ``reference_tip_position_mm``, ``tip_error_mm`` and, over the
    active length or what the model says instead, ``tip_error_pct``, ``roll_error_deg``. Where ``rows`` hold the same
    state without loads, and the loads move the tip at all, also the displacement from it, ``displacement_mm``,
    ``reference_displacement_mm`` (3), ``displacement_error_pct``, the size of their difference over the reference's,
    and ``displacement_ratio``, the component along the reference's over it.

    Raises:
        RodSolutionError: the rod has no equilibrium in a state.
    """
    states = [MuscleState.of_row(row) for row in rows]
    ours = [rod_answer(state, model) for state in states]
    unloaded = {state: (ours[i], rows[i]) for i, state in enumerate(states) if not state.is_loaded}
    over_mm = 1e3 * (model.measured_by_m or model.geometry.active_length_m)
    found = []
    for state, own, row in zip(states, ours, rows, strict=True):
        free = unloaded.get(state.unloaded)
        off = np.subtract(own["tip_position_mm"], row["tip_position_mm"])
        result = {
            **own,
            "kind": kind_of_load(state, model.law, free[1]["tip_direction"] if free else own["tip_direction"]),
            "reference_tip_position_mm": list(row["tip_position_mm"]),
            "tip_error_mm": float(np.linalg.norm(off)),
            "tip_error_pct": 100.0 * float(np.linalg.norm(off)) / over_mm,
            "roll_error_deg": math.remainder(own["tip_roll_deg"] - float(row["tip_roll_deg"]), 360.0),
        }
        if state.is_loaded and free is not None:
            moved, reference = (
                np.subtract(after["tip_position_mm"], before["tip_position_mm"])
                for after, before in ((own, free[0]), (row, free[1]))
            )
            size = float(np.linalg.norm(reference))
            if size > _LEAST_DISPLACEMENT_MM:
                result |= {
                    "displacement_mm": moved.tolist(),
                    "reference_displacement_mm": reference.tolist(),
                    "displacement_error_pct": 100.0 * float(np.linalg.norm(moved - reference)) / size,
                    "displacement_ratio": float(moved @ reference) / size**2,
                }
        found.append(result)
    return found


def kind_of_load(state: MuscleState, law: RodLaw, unloaded_direction: Sequence[float]) -> str:
    """Return which of :data:`KINDS` the load is; the bend's plane is that of the law's moment at 100 kPa."""
    force, has_torque = np.array(state.tip_force_n), state.tip_torque_n_mm != 0.0
    size = float(np.linalg.norm(force))
    if size == 0.0:
        return "torque" if has_torque else "free"
    moment, _ = law.moment_and_stiffness(replace(state, pressure_kpa=100.0).pressure_gauge_pa)
    across = abs(float(np.cross([*moment, 0.0], [0.0, 0.0, 1.0]) @ force)) / (size * math.hypot(*moment))
    if has_torque:
        return "several"
    if across > _ALONG:
        return "sideways"
    if across > math.sqrt(1.0 - _ALONG**2):
        return "several"
    return "axial" if abs(float(np.dot(unloaded_direction, force))) > _ALONG * size else "in plane"


def summary(found: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return, of each kind of load that occurs, how many states there are, and rms and worst of each error."""
    rows = []
    for kind in KINDS:
        of = [each for each in found if each["kind"] == kind]
        if not of:
            continue
        row: dict[str, Any] = {"kind": kind, "states": len(of)}
        for name in ("tip_error_pct", "displacement_error_pct", "roll_error_deg"):
            values = np.array([each[name] for each in of if name in each])
            if values.size:
                row |= {
                    f"{name}_rms": float(np.sqrt(np.mean(values**2))),
                    f"{name}_worst": float(np.abs(values).max()),
                }
        rows.append(row)
    return rows


def answer_text(rows: Sequence[dict[str, Any]]) -> str:
    """Return answers as a table."""
    head = ("pattern", "kPa", "force [N]", "torque [N mm]", "gravity [m/s2]", "tip [mm]", "direction", "roll", "angle")
    cells = [
        (
            *_state_cells(row),
            _vector(row["tip_position_mm"], "8.3f"),
            _vector(row["tip_direction"], "7.4f"),
            f"{row['tip_roll_deg']:.2f} deg",
            f"{row['tip_angle_deg']:.2f} deg",
        )
        for row in rows
    ]
    return table(head, cells)


def comparison_text(found: Sequence[dict[str, Any]]) -> str:
    """Return each state's errors and the summary of them, as two tables."""
    head = (
        "pattern",
        "kPa",
        "force [N]",
        "torque [N mm]",
        "gravity [m/s2]",
        "load",
        "tip off",
        "moved",
        "off",
        "roll off",
    )
    cells = [
        (
            *_state_cells(each),
            each["kind"],
            f"{each['tip_error_mm']:.2f} mm, {each['tip_error_pct']:.1f} %",
            f"x {each['displacement_ratio']:.3f}" if "displacement_ratio" in each else "",
            f"{each['displacement_error_pct']:.1f} %" if "displacement_ratio" in each else "",
            f"{each['roll_error_deg']:+.2f} deg",
        )
        for each in found
    ]
    kinds = [
        (
            row["kind"],
            str(row["states"]),
            *(
                f"{row[f'{name}_rms']:.2f} / {row[f'{name}_worst']:.2f} {unit}" if f"{name}_rms" in row else ""
                for name, unit in (("tip_error_pct", "%"), ("displacement_error_pct", "%"), ("roll_error_deg", "deg"))
            ),
        )
        for row in summary(found)
    ]
    totals = table(("load", "states", "tip off, rms / worst", "displacement off", "roll off"), kinds)
    return f"{table(head, cells)}\n\n{totals}"


def _state_cells(row: dict[str, Any]) -> tuple[str, ...]:
    return (
        row["pattern"],
        f"{row['pressure_kpa']:g}",
        _vector(row["tip_force_n"], "g"),
        f"{row['tip_torque_n_mm']:g}",
        _vector(row["gravity_m_s2"], "g"),
    )


def _vector(values: Sequence[float], form: str) -> str:
    return ",".join(f"{value + 0.0:{form}}".strip() for value in values)


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
