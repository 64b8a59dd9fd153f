"""One grasp from rest to the end of the lift, and what came of it. Nothing but the contact model decides that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.grasp.grip_pressure import NOTHING_EXPECTED, Expected
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest
from mbpam_ros.plant.plant import Observation
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.tiers.base import BodyState, PlantDivergedError
from mbpam_ros.simulation import TICK_S, Simulation

HELD_SHARE = 0.9
"""An object that rose by this part of the hand's rise, and stays there, is held."""

HOLD_S = 1.0
"""How long it must stay up, after the lift."""

STILL_M_S = 2e-3
"""What rests in the hand at the end moves more slowly."""

_REST_S = 0.3


@dataclass(frozen=True)
class Trial:
    """What came of a grasp.

    Args:
        mode: that the arbiter closed in; empty where it refused.
        held: whether the object rose with the hand and rests in it.
        rise_m: of the object, from where it rested to the end; more than the hand's where the fingers drew it in.
        hand_rise_m: of the hand.
        touch_s: from the request to the first touch of a finger; none without one before the lift.
        close_s: from the request to the arbiter's ``holding``; none where it came to a fault.
        finger_force_n: force of all fingers against the object at the end, sum of their magnitudes.
        note: why it did not come to an end, if so.
        grip_gauge_pa: greatest set-point of the grasp [Pa gauge]; 0 where the arbiter refused.
    """

    mode: str
    held: bool
    rise_m: float
    hand_rise_m: float
    touch_s: float | None
    close_s: float | None
    finger_force_n: float
    note: str = ""
    grip_gauge_pa: float = 0.0


def run_trial(
    scene: Scene,
    fidelity: Fidelity | FidelityRequest,
    gripper: Gripper,
    grip_pressure_gauge_pa: float | None = None,
    expected: Expected = NOTHING_EXPECTED,
    mode: str | None = None,
) -> Trial:
    """Let the object rest, close in a mode or in the one the arbiter chooses, lift, hold for :data:`HOLD_S`.

    Args:
        scene: what is there; with an object.
        fidelity: how it is computed, or shall be.
        gripper: the muscles and where they stand.
        grip_pressure_gauge_pa: of every mode; none for those of ``grasp.yaml``.
        expected: what the arbiter is told of the object.
        mode: asked for by name, as the operator does, who need not know whether the object can be reached.

    Raises:
        ConfigError: a file is wrong, the scene has no object, or the pressure is above the gripper's limit.
        TierError: no such tier, or it cannot compute what the scene holds.
        PlantDivergedError: the object at rest already leaves what can be.
    """
    if scene.object is None:
        raise ConfigError(f"scene {scene.name}: nothing to grasp; name an object in it")
    simulation = Simulation(scene, fidelity, gripper, grip_pressure_gauge_pa, expected=expected)
    simulation.run(_REST_S)
    start_m, course = _body(simulation.seen).position_m[2], _Course()
    try:
        _close(simulation, course, mode)
        if course.close_s is not None:
            simulation.lift()
            simulation.run(_whole_ticks(scene.lift.duration_s + HOLD_S))
    except PlantDivergedError as error:
        course.note = str(error)
    seen = simulation.seen
    rise_m = float(start_m - _body(seen).position_m[2])
    up = course.close_s is not None and rise_m >= HELD_SHARE * scene.lift.height_m
    still = float(np.linalg.norm(_body(seen).velocity_m_s)) < STILL_M_S
    return Trial(
        mode=course.mode,
        held=up and still and not course.note,
        rise_m=rise_m,
        hand_rise_m=seen.hand_lift_m,
        touch_s=course.touch_s,
        close_s=course.close_s,
        finger_force_n=float(np.linalg.norm(seen.finger_force_n, axis=1).sum()),
        note=course.note,
        grip_gauge_pa=course.grip_gauge_pa,
    )


@dataclass
class _Course:
    """What has happened so far, as in :class:`Trial`."""

    mode: str = ""
    touch_s: float | None = None
    close_s: float | None = None
    note: str = ""
    grip_gauge_pa: float = 0.0


def _close(simulation: Simulation, course: _Course, mode: str | None) -> None:
    """Ask for a grasp and follow it until the arbiter has closed, refused or given up."""
    asked_s = simulation.seen.time_s
    answer = simulation.grasp(mode)
    if not answer.accepted:
        course.note = answer.reason
        return
    course.mode, course.grip_gauge_pa = simulation.decision.mode, float(simulation.decision.setpoint_gauge_pa.max())
    while simulation.decision.phase is Phase.CLOSING:  # the arbiter's own time limit ends it
        simulation.tick()
        if course.touch_s is None and simulation.seen.finger_force_n.any():
            course.touch_s = simulation.seen.time_s - asked_s
    if simulation.decision.phase is Phase.HOLDING:
        course.close_s = simulation.seen.time_s - asked_s
    else:
        course.note = simulation.decision.reason


def _body(seen: Observation) -> BodyState:
    if seen.object_in_world is None:
        raise ConfigError("nothing to grasp in this scene")
    return seen.object_in_world


def _whole_ticks(duration_s: float) -> float:
    return round(duration_s / TICK_S) * TICK_S
