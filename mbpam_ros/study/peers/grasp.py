"""The problem with contact: close on a sphere on its stand, then raise the hand."""

from __future__ import annotations

from dataclasses import dataclass

from mbpam_ros.plant.lift import HandLift, LiftConfig
from mbpam_ros.study.peers.problem import Array, FingerProblem

CLOSE_S, LIFT_S, HOLD_S, LIFT_M = 1.0, 1.0, 0.5, 0.100
"""Time to close, time and height of the lift, and how long the hand then waits."""

GRASP_S = CLOSE_S + LIFT_S + HOLD_S

HELD_SHARE = 0.8
"""Of the lift: a sphere that has risen by more is held."""


@dataclass(frozen=True)
class Grasp:
    """A sphere under the palm.

    Args:
        problem: the muscles, at 0.7 to 0.8 of the full pressure: at all of it they cage the sphere.
        radius_m, mass_kg, depth_m: of the sphere; the depth is its centre's under the palm.
        friction: mu between fingers and sphere.
        stand_half_m: half the width of the square stand under the sphere.
    """

    problem: FingerProblem
    radius_m: float
    mass_kg: float
    depth_m: float
    friction: float
    stand_half_m: float = 0.010


def hand_motion(times_s: Array) -> tuple[Array, Array]:
    """Return rise and upward velocity of the hand at times from the start of closing."""
    lift = HandLift(LiftConfig(LIFT_M, LIFT_S))
    lift.raise_hand(CLOSE_S)
    return lift.motion(times_s)
