"""Who may close the gripper, and what the air does: the grasp state machine as pure code, with time handed in.

Sources in order: safety over operator over camera. A higher source preempts, an equal or lower one is refused while an
object is held; every refusal says why and what to do.

========== ============================================================ ==================== ==============
phase      what happens                                                 then                 air
========== ============================================================ ==================== ==============
idle       a mode is requested                                          closing              regulate
closing    all pressures near their set-points for the dwell time       holding              regulate
closing    they are not before the time-out                             fault                vent
closing    sensor or valve fault, stale pressures                       fault                vent
holding    sensor or valve fault, stale pressures, pressure lost        fault                hold
closing    operator asks for a mode while the camera's grasp runs       closing (new mode)   regulate
holding    operator asks for a mode while the camera's grasp runs       closing (new mode)   regulate
closing    release                                                      releasing            regulate to 0
holding    release                                                      releasing            regulate to 0
releasing  all pressures down                                           idle                 regulate to 0
releasing  they are not before the time-out                             fault                vent
any        stop, over-pressure, or a vent latched at the valves         fault                vent
any        a finding at the valves (``grasp/responses.py``)             by its table         by its table
fault      release (lets go of an object a fault has kept)              fault                vent
fault      reset, pressures down and known, no fault reported           idle                 regulate to 0
========== ============================================================ ==================== ==============

The bend estimate comes from pressures alone, so it cannot see an object between the fingers: contact is reported as not
observable, unless a measurement of it is handed in. Whether something is held is judged from the air that the chambers
took and, once the hand is up, from the camera (:mod:`~mbpam_ros.grasp.holding`). It is reported, and decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES, FINGER_COUNT
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import load_config, require_positive
from mbpam_ros.grasp.empty_hand import load_empty_hand
from mbpam_ros.grasp.grip_pressure import (
    NOTHING_EXPECTED,
    Expected,
    GripConfig,
    GripPlanner,
    load_grip_table,
    table_for,
)
from mbpam_ros.grasp.holding import NOTHING_KNOWN, HoldingConfig, Verdict
from mbpam_ros.grasp.holding_watch import HoldingWatch
from mbpam_ros.grasp.modes import MODE_NAMES, GraspMode
from mbpam_ros.grasp.phases import Phase as Phase
from mbpam_ros.grasp.responses import Response, respond
from mbpam_ros.grasp.selection import DetectedObject, GraspChoice, ModeSelector, Refusal, SelectionConfig, WristPose
from mbpam_ros.grasp.sightings import Sightings
from mbpam_ros.gripper import Gripper
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.config import PneumaticsConfig
from mbpam_ros.pneumatics.findings import Finding
from mbpam_ros.pneumatics.registry import HAS_VOLUME


class Source(IntEnum):
    """Who decided; a greater one preempts."""

    NONE = 0
    CAMERA = 1
    OPERATOR = 2
    SAFETY = 3


class Contact(Enum):
    """Whether the fingers touch an object."""

    NOT_OBSERVABLE = "not observable"
    TOUCHING = "touching"
    NOT_TOUCHING = "not touching"


@dataclass(frozen=True)
class GripPressures:
    """Grip pressure of each mode [Pa gauge]."""

    envelope: float
    short_rod: float
    slender_rod: float
    mid_rod: float

    def __post_init__(self) -> None:
        require_positive(self, *MODE_NAMES)


@dataclass(frozen=True)
class ArbitrationConfig:
    """Pressures and times of a grasp, all of ``config/grasp.yaml``.

    Args:
        grip_pressure_gauge_pa: pressure of the inflated chambers, by mode.
        pressure_tolerance_pa: a pressure this near to its set-point has reached it.
        settle_dwell_s: how long all pressures must stay there before a grasp counts as closed.
        close_timeout_s: a grasp that has not closed by then is a fault.
        release_timeout_s: a gripper that has not vented by then is a fault.
        pressure_lost_s: pressures out of tolerance for this long while holding are a fault.
        open_below_gauge_pa: a chamber below this counts as vented.
        pressure_stale_s: a channel without a valid reading for longer is stale.
        detection_stale_s: detections older than this are not used.
        object_moved_m: an object seen farther than this from where it was has moved.
        contact_stale_s: a measured contact older than this is not reported.
    """

    grip_pressure_gauge_pa: GripPressures
    pressure_tolerance_pa: float
    settle_dwell_s: float
    close_timeout_s: float
    release_timeout_s: float
    pressure_lost_s: float
    open_below_gauge_pa: float
    pressure_stale_s: float
    detection_stale_s: float
    contact_stale_s: float
    object_moved_m: float = 0.015

    def __post_init__(self) -> None:
        require_positive(self, "pressure_tolerance_pa", "settle_dwell_s", "close_timeout_s", "release_timeout_s")
        require_positive(self, "pressure_lost_s", "open_below_gauge_pa", "pressure_stale_s", "detection_stale_s")
        require_positive(self, "contact_stale_s", "object_moved_m")
        if self.settle_dwell_s >= self.close_timeout_s:
            raise ValueError("settle_dwell_s must be less than close_timeout_s, or no grasp ever closes")


@dataclass(frozen=True)
class GraspConfig:
    """The file ``config/grasp.yaml``."""

    selection: SelectionConfig
    arbitration: ArbitrationConfig
    grip: GripConfig = GripConfig()
    holding: HoldingConfig = HoldingConfig()


def load_grasp_config(name: str | Path = "grasp.yaml") -> GraspConfig:
    """Read the grasp file ``name``.

    Raises:
        ConfigError: wrong keys or values.
    """
    return load_config(GraspConfig, name)


def build_selector(config: GraspConfig, gripper: Gripper, modes: Mapping[str, GraspMode]) -> ModeSelector:
    """Return what picks modes and grip pressures by the grasp file and its table of pressures.

    Raises:
        ConfigError: there is no such table.
        RodSolutionError: the gripper's design has no rod law.
    """
    grip, table = None, table_for(config.grip.table, gripper)
    if table is not None:
        grip = GripPlanner(config.grip, load_grip_table(table), gripper.pressure_limit_gauge_pa)
    return ModeSelector(config.selection, gripper, modes, grip)


def build_holding_watch(
    config: GraspConfig, gripper: Gripper, pneumatics: PneumaticsConfig, model: str
) -> HoldingWatch:
    """Return what judges whether something is held.

    The air is listened to where the pneumatic ``model`` knows the chambers' volumes, the configuration how to weigh it,
    and the table of pressures how far the fingers of such a hand bend when it is empty.

    Raises:
        ConfigError: a table is missing that the configuration asks for.
        RodSolutionError: the gripper's design has no rod law.
    """
    table = table_for(config.grip.table, gripper)
    if not (model in HAS_VOLUME and config.holding.air and table is not None):
        return HoldingWatch(config.holding)
    from mbpam_ros.grasp.air_bend import AirBend  # compiles a model that others do without

    return HoldingWatch(config.holding, AirBend(gripper, pneumatics.chamber), load_empty_hand(table))


@dataclass(frozen=True)
class _Situation:
    phase: Phase
    source: Source
    air: Air
    reason: str
    mode: str = ""
    quarter_turns: int = 0
    mirrored: bool = False
    object_label: str = ""
    grasp_pose: WristPose | None = None
    grip_gauge_pa: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision(_Situation):
    """What the gripper does now.

    Args:
        phase: where the grasp stands.
        source: who decided it; none while the gripper is idle.
        air: what the valves have to do.
        reason: why, for people.
        mode, quarter_turns, mirrored: the grasp mode and how it is posed; an empty name while there is none.
        object_label: the object the camera chose, ``unknown`` for a mode the operator asked for, else empty.
        grasp_pose: wrist pose that lines the mode up with the object; only for the camera's grasps.
        grip_gauge_pa: pressure chosen for the object; none: that of the mode.
        contact: whether an object is touched, as far as that was measured.
        holding: whether something is held, as far as air and camera tell; not known but while holding.
        setpoint_gauge_pa: shape (16,) [Pa gauge], read-only, always finite and within 0 .. pressure limit.
        informed: all pressures had been read at least once. Before, the rest of the decision means nothing: nobody
            knows whether the chambers hold something, which zeros would drop.
        changed: anything above differs from the previous decision.
    """

    contact: Contact
    holding: Verdict
    setpoint_gauge_pa: NDArray[np.float64]
    informed: bool
    changed: bool

    def key_values(self) -> dict[str, str]:
        """Return the decision as the text fields of the grasp state."""
        return {
            "phase": self.phase.value,
            "mode": self.mode,
            "quarter_turns": str(self.quarter_turns),
            "mirrored": str(self.mirrored).lower(),
            "source": self.source.name.lower(),
            "object": self.object_label,
            "contact": self.contact.value,
            "holding": self.holding.holding.value,
            "holding_confidence": f"{self.holding.confidence:.2f}",
            "holding_by": ", ".join(self.holding.by),
            "air": self.air.value,
            "reason": self.reason,
        }


_SEES_BELOW_PA = 10e3
"""Fingers under less pressure have bent by no more than a few degrees."""

_JUDGE_EVERY_S = 0.5
"""How often the air is asked whether something is held."""

PressureOf = Callable[[str, float], float]
"""Pressure in the place of a mode's [Pa gauge], from the mode's name and the pressure that it would get."""

_OPEN = _Situation(Phase.IDLE, Source.NONE, Air.REGULATE, "open")
_GRASPING = (Phase.CLOSING, Phase.HOLDING)
_AT_THE_VALVES = "vented at the valves: "


class Arbiter:
    """The grasp state machine. Observations, requests and ticks may come in any order.

    ``time_s`` is the caller's clock [s] at the moment of the call. A clock that jumps back (a simulation started
    anew) neither faults nor changes the phase: time goes on from there.

    Args:
        config: pressures and times.
        modes: the grasp modes by name.
        selector: picks the mode of a detected object.
        pressure_limit_gauge_pa: greatest grip pressure.
        over_pressure_gauge_pa: a chamber above it is a fault.
        holding: judges whether something is held; by default by the camera alone.

    Raises:
        ValueError: a mode's grip pressure is above the limit.
    """

    def __init__(
        self,
        config: ArbitrationConfig,
        modes: Mapping[str, GraspMode],
        selector: ModeSelector,
        pressure_limit_gauge_pa: float,
        over_pressure_gauge_pa: float,
        holding: HoldingWatch | None = None,
    ) -> None:
        for name in MODE_NAMES:
            grip_pa = getattr(config.grip_pressure_gauge_pa, name)
            if grip_pa > pressure_limit_gauge_pa:
                raise ValueError(
                    f"grip_pressure_gauge_pa of {name} is {grip_pa:g} Pa, above the limit of "
                    f"{pressure_limit_gauge_pa:g} Pa"
                )
        self._config = config
        self._modes = modes
        self._selector = selector
        self._limit_pa, self._over_pressure_pa = pressure_limit_gauge_pa, over_pressure_gauge_pa
        self._time_s = -math.inf
        self._clock_offset_s = 0.0
        self._pressure_pa = np.full(CHANNEL_COUNT, np.nan)
        self._valid_at_s = np.full(CHANNEL_COUNT, -math.inf)
        self._sightings = Sightings(config.object_moved_m, config.detection_stale_s)
        self._blind = ""
        self._target: DetectedObject | None = None
        self._holding = HoldingWatch(HoldingConfig()) if holding is None else holding
        self._judged, self._judged_at_s, self._raised = NOTHING_KNOWN, -math.inf, False
        self._expected = NOTHING_EXPECTED
        self._touching = False
        self._touched_at_s = -math.inf
        self._unhealthy: dict[str, str] = {}
        self._findings: tuple[Finding, ...] = ()
        self._late_s, self._late_until_s = 0.0, -math.inf
        self._situation = _OPEN
        self._informed = False
        self._since_s = 0.0
        self._settled_changed_s = 0.0
        self._was_settled = False
        self._setpoint_pa = _read_only(np.zeros(CHANNEL_COUNT))
        self._last: tuple[_Situation, Contact, tuple[object, ...], bool] | None = None

    @property
    def phase(self) -> Phase:
        """Where the grasp stands after the last observation, request or tick."""
        return self._situation.phase

    @property
    def pressure_gauge_pa(self) -> NDArray[np.float64]:
        """Pressures observed last, shape (16,) [Pa gauge]; NaN where there was no valid reading."""
        return self._pressure_pa.copy()

    # Observations

    def observe_pressures(self, time_s: float, pressure_gauge_pa: ArrayLike) -> None:
        """Take measured chamber pressures, shape (16,) [Pa gauge]; what is not finite is no valid reading.

        Raises:
            ValueError: wrong shape.
        """
        pressure_pa = np.asarray(pressure_gauge_pa, dtype=float)
        if pressure_pa.shape != (CHANNEL_COUNT,):
            raise ValueError(f"expected {CHANNEL_COUNT} pressures, found an array of shape {pressure_pa.shape}")
        self._advance(time_s)
        valid = np.isfinite(pressure_pa)
        self._pressure_pa = np.where(valid, pressure_pa, np.nan)
        self._valid_at_s[valid] = self._time_s
        if not self._informed and valid.all():
            self._informed = True
            up = self._pressure_pa >= self._config.open_below_gauge_pa
            if up.any() and self._situation.phase is Phase.IDLE:  # an arbiter before this one may hold something
                kept_pa = np.where(up, np.minimum(self._pressure_pa, self._limit_pa), 0.0)
                self._setpoint_pa = _read_only(kept_pa)
                self._fault(f"started with air in {_channels(up)}, which may hold an object", Air.HOLD)
        self._update(time_s)

    def observe_detections(self, time_s: float, objects: Sequence[DetectedObject], age_s: float = 0.0) -> None:
        """Take what the camera saw ``age_s`` ago, nothing included. While the fingers are open it may end a grasp."""
        self._advance(time_s)
        self._sightings.take(self._time_s - age_s, objects)
        self._blind = ""
        now = self._situation
        if self._raised and now.phase is Phase.HOLDING:
            self._holding.look(self._sightings.newest)
        still_open = bool((self._pressure_pa < _SEES_BELOW_PA).all())  # later fingers hide it, or have moved it
        if now.phase is Phase.CLOSING and now.source is Source.CAMERA and self._target is not None and still_open:
            lost = self._sightings.lost(self._target)
            if lost is not None:
                self._enter(replace(_OPEN, reason=f"{lost}; not closed upon"))

    def observe_valves(self, time_s: float, spool: ArrayLike) -> None:
        """Take the spool openings that the valves are commanded, shape (16,), -1 (vent) to 1 (fill)."""
        self._advance(time_s)
        self._holding.valves(self._time_s, np.asarray(spool, dtype=float))

    def forget_detections(self, reason: str) -> None:
        """Have the camera's grasps refused for ``reason`` until it is heard of again."""
        self._sightings.forget()
        self._blind = reason

    def expect(self, expected: Expected) -> None:
        """Take what is known of the objects to come: the camera's grasps of them are as hard as that asks for."""
        self._expected = expected

    def observe_health(self, time_s: float, source: str, ok: bool, message: str = "") -> None:
        """Take the health of a part the grasp depends on (sensor, valves); a fault stands until reported ok."""
        self._advance(time_s)
        if ok:
            self._unhealthy.pop(source, None)
        else:
            self._unhealthy[source] = message

    def observe_findings(self, time_s: float, findings: Sequence[Finding]) -> None:
        """Take what is wrong with channels and supply, all of it; what is not among it any more has gone."""
        self._findings = tuple(findings)
        self._update(time_s)

    def observe_vent(self, time_s: float, reason: str) -> None:
        """Take notice that a vent is latched at the valves: by whoever, or from before this arbiter was started."""
        self._advance(time_s)
        if not (self._situation.phase is Phase.FAULT and self._situation.air is Air.VENT):
            # Valves started anew took it from the word of an arbiter, which had it from the valves before.
            self._fault(f"{_AT_THE_VALVES}{reason.removeprefix(_AT_THE_VALVES)}", Air.VENT)

    def observe_contact(self, time_s: float, touching: bool) -> None:
        """Take a measured contact, should the gripper have a sensor for it. It is reported, and decides nothing."""
        self._advance(time_s)
        self._touching = touching
        self._touched_at_s = self._time_s

    def observe_lateness(self, time_s: float, late_s: float) -> None:
        """Take for how long the computer held up this process [s]. It is named where readings stay out, not more."""
        self._advance(time_s)
        self._late_s, self._late_until_s = late_s, self._time_s + self._config.pressure_stale_s

    # Requests

    def request_mode(self, name: str, time_s: float, pressure_of: PressureOf | None = None) -> Answer:
        """Operator: close in the mode ``name``, at the pressure of its own or the one in its place."""
        self._update(time_s)
        if name not in self._modes:
            return Answer(False, f"no mode {name!r}; modes: {', '.join(self._modes)}")
        objection = self._objection(Source.OPERATOR)
        if objection is not None:
            return Answer(False, objection)
        asked = _Situation(
            Phase.CLOSING, Source.OPERATOR, Air.REGULATE, f"operator asked for {name}", name, object_label="unknown"
        )
        return self._close(self._at_pressure(asked, pressure_of))

    def request_auto(self, time_s: float, pressure_of: PressureOf | None = None) -> Answer:
        """Camera: close in the mode that suits the object in view, at its pressure or the one in its place."""
        self._update(time_s)
        objection = self._objection(Source.CAMERA)
        if objection is not None:
            return Answer(False, objection)
        age_s = self._time_s - self._sightings.time_s
        if age_s == math.inf:
            return Answer(False, self._blind or "no detection yet; is the object detector running?")
        if age_s > self._config.detection_stale_s:
            return Answer(
                False,
                f"last detection is {age_s:.1f} s old, at most {self._config.detection_stale_s:g} s; camera running?",
            )
        choice = self._selector.choose(self._sightings.newest, self._expected)
        if isinstance(choice, Refusal):
            vanished = self._sightings.vanished()
            return Answer(False, choice.reason if vanished is None else f"{choice.reason}: {vanished}")
        unrest = self._sightings.unrest(choice.target)
        if unrest is not None:
            return Answer(False, f"{choice.target.label}: {unrest}")
        return self._close(self._at_pressure(_chosen_by_camera(choice), pressure_of), choice.target)

    def release(self, time_s: float) -> Answer:
        """Operator: open. In a fault it vents what the fault has kept, and the fault stays."""
        self._update(time_s)
        now = self._situation
        if now.phase is Phase.IDLE:
            return Answer(True, "already open")
        if now.phase is Phase.RELEASING:
            return Answer(True, "already releasing")
        if now.phase is Phase.FAULT:
            if now.air is not Air.VENT:
                self._enter(replace(now, air=Air.VENT, reason=f"{now.reason}; released by the operator"))
            return Answer(True, "venting; the fault stays until grasp/reset")
        self._enter(replace(now, phase=Phase.RELEASING, source=Source.OPERATOR, reason="release requested"))
        return Answer(True, "releasing")

    def stop(self, time_s: float) -> Answer:
        """Safety: vent everything at once and latch a fault."""
        self._update(time_s)
        self._fault("stop requested", Air.VENT)
        return Answer(True, "stopped, venting; call grasp/reset once the pressures are down")

    def reset(self, time_s: float) -> Answer:
        """Clear a latched fault, if its cause is gone and the gripper is vented."""
        refusal = self.objection_to_reset(time_s)
        if refusal is not None:
            return Answer(False, refusal)
        if self._situation.phase is Phase.IDLE:
            return Answer(True, "no fault latched")
        self._enter(replace(_OPEN, reason="fault reset"))
        return Answer(True, "fault cleared")

    def objection_to_reset(self, time_s: float) -> str | None:
        """Return why a reset would be refused now, or None."""
        self._update(time_s)
        now = self._situation
        if now.phase is Phase.IDLE:
            return None
        if now.phase is not Phase.FAULT:
            return f"no fault latched, the gripper is {now.phase.value}; grasp/release opens it"
        if now.air is not Air.VENT:
            return f"the fault keeps the object ({now.reason}); call grasp/release first"
        objection = self._ill_health() or self._unreadable() or self._found()
        if objection is not None:
            return f"the cause persists: {objection}"
        up = ~(self._pressure_pa < self._config.open_below_gauge_pa)
        return f"pressure is still up: {self._readings(up)}; wait until vented" if up.any() else None

    def check(self, time_s: float) -> Answer:
        """Operator: the hand is up; say whether it holds something. From now on what the camera sees counts for it."""
        self._update(time_s)
        if self._situation.phase is not Phase.HOLDING:
            return Answer(False, f"the gripper is {self._situation.phase.value}: nothing is closed upon")
        self._raised = True
        if self._time_s - self._sightings.time_s <= self._config.detection_stale_s:
            self._holding.look(self._sightings.newest)
        self._judge()
        found = self._judged
        senses = ", ".join(found.by) or "no sense"
        return Answer(True, f"{found.holding.value}: {found.probability:.0%} that something is held, by {senses}")

    def obstacle(self, time_s: float) -> str | None:
        """Return what keeps any grasp from starting (a fault of a part, no valid pressures), or None."""
        self._update(time_s)
        return self._unready()

    # Decision

    def tick(self, time_s: float) -> Decision:
        """Return what the gripper does now. Call it at a steady rate, and after each request."""
        self._update(time_s)
        if self._situation.phase is not Phase.HOLDING:
            self._judged = NOTHING_KNOWN
        elif not 0.0 <= self._time_s - self._judged_at_s < _JUDGE_EVERY_S:
            self._judge()
        told = self._judged.holding, self._judged.by
        current = (self._situation, self._contact(), told, self._informed)
        changed, self._last = current != self._last, current
        return Decision(
            **vars(self._situation),
            contact=current[1],
            holding=self._judged,
            setpoint_gauge_pa=self._setpoint_pa,
            informed=self._informed,
            changed=changed,
        )

    # Transitions

    def _update(self, time_s: float) -> None:
        """Make the transitions that time and observations call for. Safety first."""
        self._advance(time_s)
        over = self._pressure_pa > self._over_pressure_pa
        if over.any() and not (self._situation.phase is Phase.FAULT and self._situation.air is Air.VENT):
            self._fault(f"over-pressure, above {self._over_pressure_pa:g} Pa: {self._readings(over)}", Air.VENT)
        elif self._answer_findings():
            return
        elif self._situation.phase in _GRASPING:
            self._while_grasping()
        elif self._situation.phase is Phase.RELEASING:
            self._while_releasing()

    def _answer_findings(self) -> bool:
        """Answer what was found of the valves by the table; return whether that changed the phase or the air."""
        if not self._findings:
            return False
        now = self._situation
        answer, cause = respond(self._findings, now.phase)
        if answer is Response.REGULATE or now.air is Air.VENT:
            return False
        if answer is Response.GRIP_HARDER:
            if now.phase is Phase.HOLDING:
                self._grip_harder()
            elif now.phase is Phase.FAULT:  # what is closed already stays so
                return False
        elif now.phase is Phase.FAULT and now.air is answer.air:
            return False
        self._fault(cause, answer.air)
        return True

    def _grip_harder(self) -> None:
        """Let the chambers that nothing was found of take over what a finger held whose chamber is not to be had.

        A grasp presses about in proportion to its pressures: with one of n fingers less, by n / (n - 1) each.
        """
        found = {name for finding in self._findings for name in finding.channels}
        sound = np.array([name not in found for name in CHANNEL_NAMES])
        inflated = self._setpoint_pa > 0.0
        fingers = int(np.count_nonzero(inflated.reshape(FINGER_COUNT, -1).any(axis=1)))
        harder_pa = np.minimum(self._setpoint_pa * fingers / max(fingers - 1, 1), self._limit_pa)
        self._setpoint_pa = _read_only(np.where(inflated & sound, harder_pa, self._setpoint_pa))

    def _while_grasping(self) -> None:
        holding = self._situation.phase is Phase.HOLDING
        cause = self._stale() or self._ill_health()
        if cause is not None:
            self._fault(cause, Air.HOLD if holding else Air.VENT)
            return
        off = ~(np.abs(self._pressure_pa - self._setpoint_pa) <= self._config.pressure_tolerance_pa)
        settled = not off.any()
        if settled is not self._was_settled:
            self._was_settled, self._settled_changed_s = settled, self._time_s
        steady_s = self._time_s - self._settled_changed_s
        if holding and not settled and steady_s > self._config.pressure_lost_s:
            self._fault(f"pressure lost: {self._readings(off)}", Air.HOLD)
        elif not holding and settled and steady_s >= self._config.settle_dwell_s:
            self._enter(replace(self._situation, phase=Phase.HOLDING))
        elif not holding and self._time_s - self._since_s > self._config.close_timeout_s:
            lacking = self._readings(off) if off.any() else "not steady"
            self._fault(f"did not reach pressure in {self._config.close_timeout_s:g} s: {lacking}", Air.VENT)

    def _while_releasing(self) -> None:
        up = ~(self._pressure_pa < self._config.open_below_gauge_pa)
        if not up.any():
            self._enter(replace(_OPEN, reason="released"))
        elif self._time_s - self._since_s > self._config.release_timeout_s:
            cause = self._stale() or self._readings(up)
            self._fault(f"did not vent in {self._config.release_timeout_s:g} s: {cause}", Air.VENT)

    def _judge(self) -> None:
        self._judged, self._judged_at_s = self._holding.feel(self._pressure_pa), self._time_s

    def _grip_pa(self, situation: _Situation) -> float:
        """The pressure that was chosen for the object, or that of the mode [Pa gauge]."""
        chosen_pa = situation.grip_gauge_pa
        own_pa: float = getattr(self._config.grip_pressure_gauge_pa, situation.mode)
        return own_pa if chosen_pa is None else chosen_pa

    def _at_pressure(self, situation: _Situation, pressure_of: PressureOf | None) -> _Situation:
        """Return it with the pressure that is asked for, if any, within the limit."""
        if pressure_of is None:
            return situation
        asked_pa = pressure_of(situation.mode, self._grip_pa(situation))
        return replace(situation, grip_gauge_pa=min(max(asked_pa, 0.0), self._limit_pa))

    def _close(self, situation: _Situation, target: DetectedObject | None = None) -> Answer:
        before = self._situation
        self._enter(situation)
        self._target, self._raised = target, False
        pose = situation.mode, situation.quarter_turns, situation.mirrored
        self._holding.begin(self._time_s, self._pressure_pa, self._setpoint_pa, pose, target)
        preempted = f", preempts the {_words(before)}" if before.phase in _GRASPING else ""
        return Answer(True, f"closing in {situation.mode}: {situation.reason}{preempted}")

    def _fault(self, cause: str, air: Air) -> None:
        """Latch a fault; one that is latched already keeps its cause in the text."""
        before = self._situation.reason
        if self._situation.phase is Phase.FAULT:
            cause = before if before.startswith(cause) else f"{cause}; before: {before}"
        self._enter(replace(self._situation, phase=Phase.FAULT, source=Source.SAFETY, air=air, reason=cause))

    def _enter(self, situation: _Situation) -> None:
        if situation.air is Air.VENT or situation.phase in (Phase.IDLE, Phase.RELEASING):
            self._setpoint_pa = _read_only(np.zeros(CHANNEL_COUNT))
            situation = replace(situation, grasp_pose=None)
        elif situation.phase is Phase.CLOSING:
            posed = situation.quarter_turns, situation.mirrored
            self._setpoint_pa = _read_only(self._modes[situation.mode].setpoints(self._grip_pa(situation), *posed))
            self._was_settled, self._settled_changed_s = False, self._time_s
        if situation.phase is not self._situation.phase or situation.phase is Phase.CLOSING:
            self._since_s = self._time_s
        self._situation = situation

    # Why not

    def _objection(self, source: Source) -> str | None:
        """Return why a grasp asked for by ``source`` must not start now, or None."""
        now = self._situation
        if now.phase is Phase.FAULT:
            cure = "call grasp/release, then grasp/reset" if now.air is not Air.VENT else "call grasp/reset"
            return f"fault latched ({now.reason}); {cure}"
        if now.phase is Phase.RELEASING:
            return "releasing; ask again once idle"
        if now.phase in _GRASPING and source <= now.source:
            return f"{_words(now)} is not preempted by the {source.name.lower()}; call grasp/release first"
        return self._unready()

    def _unready(self) -> str | None:
        """Return what keeps a grasp from starting, or None."""
        return self._ill_health() or self._unreadable() or self._found() or self._pressure_where_none_belongs()

    def _ill_health(self) -> str | None:
        ill = [f"{source}: {message or 'fault'}" for source, message in self._unhealthy.items()]
        return "; ".join(ill) or None

    def _found(self) -> str | None:
        return "; ".join(finding.text for finding in self._findings) or None

    def _pressure_where_none_belongs(self) -> str | None:
        up = self._pressure_pa > self._config.open_below_gauge_pa
        if self._situation.phase is not Phase.IDLE or not up.any():
            return None
        return f"pressure in an idle chamber: {self._readings(up)}; a valve may leak"

    def _unreadable(self) -> str | None:
        """Channels without a valid reading at this moment."""
        missing = np.isnan(self._pressure_pa)
        if missing.any():
            return f"no valid pressure reading from {_channels(missing)}"
        return self._stale()

    def _stale(self) -> str | None:
        """Channels without a valid reading for too long."""
        stale = self._time_s - self._valid_at_s > self._config.pressure_stale_s
        if not stale.any():
            return None
        late = f"this computer ran {1e3 * self._late_s:.0f} ms late: " if self._time_s <= self._late_until_s else ""
        return (
            f"{late}no valid pressure reading for more than {self._config.pressure_stale_s:g} s from {_channels(stale)}"
        )

    def _readings(self, channels: NDArray[np.bool_]) -> str:
        return ", ".join(
            f"{CHANNEL_NAMES[i]} at {self._pressure_pa[i]:.0f} Pa (wanted {self._setpoint_pa[i]:.0f} Pa)"
            for i in np.flatnonzero(channels)
        )

    def _contact(self) -> Contact:
        if self._time_s - self._touched_at_s > self._config.contact_stale_s:
            return Contact.NOT_OBSERVABLE
        return Contact.TOUCHING if self._touching else Contact.NOT_TOUCHING

    def _advance(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise ValueError(f"time must be finite, found {time_s}")
        if time_s + self._clock_offset_s < self._time_s:
            self._clock_offset_s = self._time_s - time_s
        self._time_s = max(self._time_s, time_s + self._clock_offset_s)


def build_arbiter(
    config: GraspConfig, gripper: Gripper, modes: Mapping[str, GraspMode], holding: HoldingWatch | None = None
) -> Arbiter:
    """Return the arbiter of a gripper by the grasp file.

    Raises:
        ConfigError: there is no such table of pressures.
        RodSolutionError: the gripper's design has no rod law.
        ValueError: a mode's grip pressure is above the gripper's limit.
    """
    selector = build_selector(config, gripper, modes)
    limits = gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
    return Arbiter(config.arbitration, modes, selector, *limits, holding)


def _chosen_by_camera(choice: GraspChoice) -> _Situation:
    return _Situation(
        Phase.CLOSING,
        Source.CAMERA,
        Air.REGULATE,
        choice.reason,
        choice.mode,
        choice.quarter_turns,
        choice.mirrored,
        choice.target.label,
        choice.wrist_pose,
        choice.grip_gauge_pa,
    )


def _words(situation: _Situation) -> str:
    return f"{situation.source.name.lower()}'s {situation.mode} grasp ({situation.phase.value})"


def _channels(mask: NDArray[np.bool_]) -> str:
    if mask.all():
        return f"any of the {CHANNEL_COUNT} channels"
    return ", ".join(CHANNEL_NAMES[i] for i in np.flatnonzero(mask))


def _read_only(values: NDArray[np.float64]) -> NDArray[np.float64]:
    values.flags.writeable = False
    return values
