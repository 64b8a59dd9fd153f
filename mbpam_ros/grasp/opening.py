"""The hand as a gripper with two jaws: an opening between the tips and a force at them, for whoever knows no modes.

The opening g of a mode at a pressure p is that of free fingers, hanging, of constant curvature
(:mod:`~mbpam_ros.actuator.equilibrium`): with t_i the tips, o_i the way in which a finger stands off the object and R
the muscle's radius,

    g(p) = max(2 mean_i (t_i(p) . o_i) - 2 R, 0),

o_i pointing away from the palm's axis where all fingers bend toward it, and across the rod where a rod is held. The
force F(p) is the mean over the fingers of what a blocked tip pushes with (:mod:`~mbpam_ros.actuator.tip_force`).

Air pushes and knows no place: fingers that an object stops push with F(p) and would close to g(p) without it. So a
command of an opening and of a greatest force becomes the pressure that exceeds neither,

    p = min(g^-1(opening), F^-1(force)),

and to close upon an object is to ask for the opening 0, which sets no limit of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, FINGER_COUNT
from mbpam_ros.actuator.elastic_rod import HANGING
from mbpam_ros.actuator.equilibrium import resting_bend
from mbpam_ros.actuator.kinematics import tip_pose
from mbpam_ros.answer import Answer
from mbpam_ros.grasp.arbitration import Arbiter, Decision
from mbpam_ros.grasp.holding import Holding
from mbpam_ros.grasp.modes import GraspMode
from mbpam_ros.grasp.phases import Phase
from mbpam_ros.gripper import Gripper

Array = NDArray[np.float64]

OPEN_WITHIN_M = 0.002
"""A command so little short of the widest opening, or wider, opens the hand."""

_STEP_PA = 1e3


AUTO = "auto"
"""In the place of a mode: the camera chooses."""


class HandState(NamedTuple):
    """Opening between the tips [m] and force of a tip [N], as of free fingers at the pressures of now."""

    opening_m: float
    force_n: float


class _Path(NamedTuple):
    """Of a mode, over the pressures: the opening, which falls, and the force, which rises."""

    opening_m: Array
    force_n: Array


class TipOpening:
    """What openings and forces stand for what pressures.

    Args:
        gripper: the muscles, and where they stand.
        modes: the grasp modes by name.

    Raises:
        RodSolutionError: the design has no rod law.
    """

    def __init__(self, gripper: Gripper, modes: Mapping[str, GraspMode]) -> None:
        self._limit_pa = gripper.pressure_limit_gauge_pa
        self._pressure_pa = np.linspace(0.0, self._limit_pa, 1 + math.ceil(self._limit_pa / _STEP_PA))
        self._paths = {name: self._path(gripper, mode) for name, mode in modes.items()}

    def widest_m(self, mode: str) -> float:
        """Return the opening of the straight fingers in the sense of a mode, or of all that there are [m]."""
        paths = self._paths.values() if mode == AUTO else [self._paths[mode]]
        return max(float(path.opening_m[0]) for path in paths)

    def at(self, mode: str, pressure_gauge_pa: float) -> HandState:
        """Return where free fingers are at the pressure of the inflated chambers [Pa gauge]."""
        path = self._paths[mode]
        opening_m = np.interp(pressure_gauge_pa, self._pressure_pa, path.opening_m)
        return HandState(float(opening_m), float(np.interp(pressure_gauge_pa, self._pressure_pa, path.force_n)))

    def pressure_gauge_pa(self, mode: str, opening_m: float, force_n: float, grip_gauge_pa: float) -> float:
        """Return the pressure that exceeds neither an opening nor a force, within the gripper's limit [Pa gauge].

        Args:
            mode: how the fingers close.
            opening_m: not to be closed farther; 0 or less: as far as it goes.
            force_n: not to be exceeded by a tip; 0: not told.
            grip_gauge_pa: what a closed hand gets of which no force is told.
        """
        path = self._paths[mode]
        most_pa = self._limit_pa if force_n > 0.0 else grip_gauge_pa
        if opening_m > 0.0:
            most_pa = min(self._limit_pa, float(np.interp(-opening_m, -path.opening_m, self._pressure_pa)))
        if force_n > 0.0:
            most_pa = min(most_pa, float(np.interp(force_n, path.force_n, self._pressure_pa)))
        return most_pa

    def _path(self, gripper: Gripper, mode: GraspMode) -> _Path:
        calibration = gripper.calibration()
        shape = (len(self._pressure_pa), FINGER_COUNT, CHAMBERS_PER_FINGER)
        pressures = np.outer(self._pressure_pa, mode.setpoints(1.0)).reshape(shape)
        moment, stiffness = calibration.law.moment_and_stiffness(pressures)
        bend = resting_bend(moment, stiffness, gripper.rod_geometry, np.array(HANGING))
        tips_m = gripper.finger_base_m + tip_pose(bend, gripper.rod_geometry)[0]
        reach_m = np.einsum("pfk,fk->pf", tips_m, _off_the_object(gripper, mode)).mean(axis=1)
        opening_m = np.maximum(2.0 * (reach_m - gripper.geometry.outer_radius_m), 0.0)
        force_n = calibration.tip_force.at(moment).mean(axis=1)
        # Strongly bent, tips go back a little: what they have reached counts.
        return _Path(np.minimum.accumulate(opening_m), np.maximum.accumulate(force_n))


def _off_the_object(gripper: Gripper, mode: GraspMode) -> Array:
    """Return the way in which each finger stands off the object, unit vectors (4, 3)."""
    base_m = gripper.finger_base_m
    outward: Array = base_m / np.linalg.norm(base_m, axis=1, keepdims=True)
    azimuth = np.radians(mode.bend_azimuth_deg)
    if np.allclose(np.column_stack([np.cos(azimuth), np.sin(azimuth)]), -outward[:, :2]):
        return outward
    across: Array = np.sign(base_m) * (1.0, 0.0, 0.0)
    return across


class TwoJaws:
    """An arbiter's hand as a gripper with two jaws.

    Args:
        arbiter: decides, and may refuse.
        gripper, modes: as those of the arbiter.

    Raises:
        RodSolutionError: the design has no rod law.
    """

    def __init__(self, arbiter: Arbiter, gripper: Gripper, modes: Mapping[str, GraspMode]) -> None:
        self._arbiter, self._modes = arbiter, modes
        self._tips = TipOpening(gripper, modes)

    def opens(self, mode: str, opening_m: float) -> bool:
        """Return whether a commanded opening is that of an open hand."""
        return mode in (*self._modes, AUTO) and opening_m >= self._tips.widest_m(mode) - OPEN_WITHIN_M

    def request(self, time_s: float, mode: str, opening_m: float, force_n: float) -> Answer:
        """Ask the arbiter to open the hand, or to close it in a mode or as the camera chooses."""
        if self.opens(mode, opening_m):
            return self._arbiter.release(time_s)

        def pressure_of(chosen: str, grip_gauge_pa: float) -> float:
            return self._tips.pressure_gauge_pa(chosen, opening_m, force_n, grip_gauge_pa)

        if mode == AUTO:
            return self._arbiter.request_auto(time_s, pressure_of)
        return self._arbiter.request_mode(mode, time_s, pressure_of)

    def state(self, mode: str) -> HandState:
        """Return where the hand is: its inflated chambers are those of the greatest pressure."""
        measured_pa = self._arbiter.pressure_gauge_pa
        pressure_pa = float(np.max(measured_pa, initial=0.0, where=np.isfinite(measured_pa)))
        return self._tips.at(mode if mode in self._modes else next(iter(self._modes)), pressure_pa)


@dataclass(frozen=True)
class Command:
    """A command that was accepted.

    Args:
        opens: whether it opens the hand.
        grasp: mode and source of the grasp that it began; what differs later is another one.
    """

    opens: bool
    grasp: tuple[str, str] = ("", "")


class Outcome(NamedTuple):
    """What became of a command.

    Args:
        done: as far as it goes; the rest means nothing before.
        succeeded: it closed or opened as it was told.
        stalled: something between the fingers stopped them: it is held.
        reached: the fingers are where they were told.
        reason: for people.
    """

    done: bool
    succeeded: bool = False
    stalled: bool = False
    reached: bool = False
    reason: str = ""


def grasp_of(decision: Decision) -> tuple[str, str]:
    """Return what tells the grasp of a decision from another: its mode and who asked for it."""
    return decision.mode, decision.source.name


def outcome(command: Command, now: Decision) -> Outcome:
    """Return how far a command has come, by what the gripper does now.

    Whether something is held is for air and camera to tell (:mod:`~mbpam_ros.grasp.holding`). Where they do not know,
    a closed hand counts as one that is where it was told.
    """
    if command.opens:
        if now.phase is Phase.RELEASING:
            return Outcome(done=False)
        opened = now.phase is Phase.IDLE
        return Outcome(True, opened, reached=opened, reason=f"{now.phase.value}: {now.reason}")
    if now.phase in (Phase.CLOSING, Phase.HOLDING) and grasp_of(now) == command.grasp:
        if now.phase is Phase.CLOSING:
            return Outcome(done=False)
        held = now.holding.holding is Holding.HELD
        return Outcome(True, True, stalled=held, reached=not held, reason=f"holding: {now.reason}")
    return Outcome(True, reason=f"{now.phase.value}: {now.reason}")
