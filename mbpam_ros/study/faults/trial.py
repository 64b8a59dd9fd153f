"""One fault in one grasp: inject it, watch what the gripper says and does, mend it, and go back to idle."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.grasp.responses import Response, respond
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.pneumatics.air_switch import Air
from mbpam_ros.pneumatics.findings import SUPPLY
from mbpam_ros.pneumatics.machine_faults import MachineFault
from mbpam_ros.pneumatics.sensing import ChannelStatus
from mbpam_ros.simulation import TICK_S, Simulation
from mbpam_ros.study.faults.draws import SCENES, FaultRow, PhaseName, row_named

LIMIT_PA = 1.02 * 110e3
"""A chamber may be above this for 20 ms."""

SAFE_PA = 110e3
DOWN_PA = 5e3
_REST_S, _LIFT_S, _BACK_S = 0.3, 1.2, 12.0
KEPT_SHARE = 0.9
"""An object that is still up by this part of the hand's rise is kept."""


@dataclass
class Course:
    """What came of a trial; times from the fault's beginning.

    Args:
        fault, phase, tier, pneumatics, scene, channel, size: what was tried.
        detected_by: observer, sensor or arbiter; empty for nobody.
        detect_s: time until somebody said so.
        right_channel: whether those named first are those at fault.
        found: what was said first.
        answer: what the gripper did in the end, by the table, or vent or hold for what others than observers found.
        safe_s: until the answer was in force and every chamber below the limit for good.
        pressure_max_pa: the highest true pressure of any chamber.
        above_limit_s: how long the longest time above :data:`LIMIT_PA` was.
        above_110_kpa_s: how long the longest time above 110 kPa was.
        object_kept: whether the object was still in the hand before it was let go; none where nothing was held.
        back_s: from mending to a grasp being accepted again; none if it was not.
        note: what else.
    """

    fault: str
    phase: str
    tier: str
    pneumatics: str
    scene: str
    channel: str
    size: float
    detected_by: str = ""
    detect_s: float | None = None
    right_channel: bool = False
    found: str = ""
    answer: str = ""
    safe_s: float | None = None
    pressure_max_pa: float = 0.0
    above_limit_s: float = 0.0
    above_110_kpa_s: float = 0.0
    object_kept: bool | None = None
    back_s: float | None = None
    note: str = ""
    findings: list[str] = field(default_factory=list)


def trial_row(name: str, row_name: str, phase: PhaseName, tier: str, seed: int, pneumatics: str = "lag") -> dict:
    """Return what came of one trial as plain values, with its name as ``job``; the same arguments give the same."""
    row = row_named(row_name)
    random = np.random.default_rng([seed, zlib.crc32(f"{row_name}, {phase}".encode())])
    scene_name = str(random.choice(SCENES))
    scene, request = load_scene(scene_name)
    simulation = Simulation(scene, replace(request.in_tier(tier), pneumatics=pneumatics), seed=seed)
    simulation.run(_REST_S)
    start_m = _height_m(simulation)
    if phase != "idle":
        simulation.grasp()
        inflated = simulation.decision.setpoint_gauge_pa > 0.0
    else:
        inflated = np.zeros(len(CHANNEL_NAMES), dtype=bool)
    if phase == "closing":
        simulation.run(TICK_S * round(random.uniform(0.0, 0.35) / TICK_S))
    elif phase == "holding":
        simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING, 4.0)
        simulation.lift()
        simulation.run(TICK_S * round((_LIFT_S + random.uniform(0.0, 2.0)) / TICK_S))
    fault = row.draw(random, inflated)
    channel = SUPPLY if fault.kind == "supply" else CHANNEL_NAMES[fault.channel]
    course = Course(row_name, phase, tier, pneumatics, scene_name, channel, fault.size)
    try:
        _watch(simulation, fault, row, course)
        if phase == "holding":
            course.object_kept = start_m - _height_m(simulation) > KEPT_SHARE * simulation.seen.hand_lift_m
        _go_back(simulation, course)
    except PlantDivergedError as error:
        course.note = str(error)
    return {"job": name, **asdict(course)}


def _watch(simulation: Simulation, fault: MachineFault, row: FaultRow, course: Course) -> None:
    """Inject the fault and follow the gripper for a while after it was found."""
    begun_s = simulation.seen.time_s
    end_s = begun_s + row.watch_s
    above_s = high_s = 0.0
    unsafe_until_s = begun_s
    simulation.inject(fault)
    while simulation.seen.time_s < end_s - 1e-9:
        simulation.tick()
        since_s = simulation.seen.time_s - begun_s
        highest_pa = float(simulation.seen.pressure_gauge_pa.max())
        course.pressure_max_pa = max(course.pressure_max_pa, highest_pa)
        above_s = above_s + TICK_S if highest_pa > LIMIT_PA else 0.0
        high_s = high_s + TICK_S if highest_pa > SAFE_PA else 0.0
        course.above_limit_s, course.above_110_kpa_s = (
            max(course.above_limit_s, above_s),
            max(course.above_110_kpa_s, high_s),
        )
        if not course.detected_by:
            _look_for_a_word(simulation, fault, since_s, course)
            if course.detected_by:
                end_s = simulation.seen.time_s + row.after_s
        if not course.detected_by or highest_pa > SAFE_PA:
            unsafe_until_s = simulation.seen.time_s
        said = {each.split(" (")[0] for each in course.findings}
        course.findings += [each.text for each in simulation.findings if each.text.split(" (")[0] not in said]
    if course.detected_by and unsafe_until_s < simulation.seen.time_s - 1e-9:
        course.safe_s = unsafe_until_s - begun_s
    course.answer = _answer(simulation)


def _look_for_a_word(simulation: Simulation, fault: MachineFault, since_s: float, course: Course) -> None:
    at_fault = {SUPPLY} if fault.kind == "supply" else {CHANNEL_NAMES[fault.channel]}
    if fault.other_channel is not None:
        at_fault.add(CHANNEL_NAMES[fault.other_channel])
    silent = {
        name
        for name, status in zip(CHANNEL_NAMES, simulation.channel_status, strict=True)
        if status is not ChannelStatus.OK
    }
    if simulation.findings:
        first = simulation.findings[0]
        course.detected_by, course.found = "observer", first.text
        named = {name for finding in simulation.findings for name in finding.channels}
    elif silent:
        named = silent
        course.detected_by, course.found = "sensor", f"{', '.join(sorted(silent))}: no valid reading"
    elif simulation.decision.phase is Phase.FAULT:
        course.detected_by, course.found = "arbiter", simulation.decision.reason
        named = {name for name in CHANNEL_NAMES if name in simulation.decision.reason}
    else:
        return
    course.detect_s = since_s
    course.right_channel = named == at_fault


def _answer(simulation: Simulation) -> str:
    """Return what the gripper does now, in the words of the table."""
    decision = simulation.decision
    if decision.phase is not Phase.FAULT:
        return Response.REGULATE.value
    if decision.air is Air.VENT:
        return Response.VENT_ALL.value
    if decision.air is Air.REGULATE:
        return Response.GRIP_HARDER.value
    answer, _ = respond(simulation.findings, Phase.FAULT)
    return answer.value if answer.air is Air.HOLD else Response.HOLD.value


def _go_back(simulation: Simulation, course: Course) -> None:
    """Mend the machine and go the way that the manual tells: release, reset, grasp."""
    simulation.repair()
    mended_s = simulation.seen.time_s
    simulation.run(0.1)
    while simulation.seen.time_s - mended_s < _BACK_S:
        simulation.release()
        simulation.reset()
        if simulation.decision.phase is Phase.IDLE and simulation.grasp("mid_rod").accepted:
            down = simulation.seen.pressure_gauge_pa.max() < DOWN_PA
            course.back_s = simulation.seen.time_s - mended_s if down else None
            course.note = "" if down else "a grasp was accepted while a chamber is up"
            return
        simulation.run(0.1)
    course.note = f"not back: {simulation.decision.reason}; {'; '.join(each.text for each in simulation.findings)}"


def _height_m(simulation: Simulation) -> float:
    body = simulation.seen.object_in_world
    return float(body.position_m[2]) if body is not None else 0.0
