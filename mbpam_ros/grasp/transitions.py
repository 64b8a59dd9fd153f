"""What each request does in each state of a grasp, asked of the arbiter itself: the table in the manual.

An arbiter is brought into each state by the observations and requests that lead there, asked, and looked at. So the
table cannot differ from the state machine (:mod:`~mbpam_ros.grasp.arbitration`). Requests that arrive together are
answered one after the other; :func:`together` shows that their order matters only between equals.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.answer import Answer
from mbpam_ros.grasp.arbitration import Arbiter, Phase, build_arbiter, load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.selection import DetectedObject
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air

MODE = "envelope"
_TICK_S = 0.02


class Transition(NamedTuple):
    """What a request does in a state.

    Args:
        state, request: where the grasp stands, and what is asked.
        accepted: whether it is done.
        then: the state after it.
        answer: what is answered.
    """

    state: str
    request: str
    accepted: bool
    then: str
    answer: str


class _Bench:
    """An arbiter with a clock and pressures that follow its set-points at once."""

    def __init__(self) -> None:
        self.arbiter = build_arbiter(load_grasp_config(), load_gripper(), load_modes())
        self.time_s = 0.0
        self.observe(np.zeros(CHANNEL_COUNT))

    def observe(self, pressure_gauge_pa: np.ndarray) -> None:
        ball = DetectedObject("ball", "sphere", (0.06, 0.06, 0.06), (0.0, 0.0, 0.085), (0.0, 0.0, 0.0, 1.0), 0.9)
        self.arbiter.observe_pressures(self.time_s, pressure_gauge_pa)
        self.arbiter.observe_detections(self.time_s, [ball])

    def run_until(self, phase: Phase) -> None:
        while self.arbiter.phase is not phase:
            self.time_s += _TICK_S
            self.observe(self.arbiter.tick(self.time_s).setpoint_gauge_pa)

    def ask(self, request: str) -> Answer:
        return REQUESTS[request](self.arbiter, self.time_s)

    @property
    def state(self) -> str:
        """Phase, and who decided or what the air does where that matters."""
        now = self.arbiter.tick(self.time_s)
        phase: str = now.phase.value
        if now.phase in (Phase.CLOSING, Phase.HOLDING):
            return f"{phase}, {now.source.name.lower()}'s"
        if now.phase is Phase.FAULT:
            return "fault, vents" if now.air is Air.VENT else "fault, keeps the object"
        return phase


Request = Callable[[Arbiter, float], Answer]

REQUESTS: dict[str, Request] = {
    "grasp/<mode>": lambda arbiter, time_s: arbiter.request_mode(MODE, time_s),
    "grasp/auto": lambda arbiter, time_s: arbiter.request_auto(time_s),
    "grasp/release": lambda arbiter, time_s: arbiter.release(time_s),
    "grasp/check": lambda arbiter, time_s: arbiter.check(time_s),
    "grasp/stop": lambda arbiter, time_s: arbiter.stop(time_s),
    "grasp/reset": lambda arbiter, time_s: arbiter.reset(time_s),
}
"""What may be asked, by the name of its service."""


def transitions() -> list[Transition]:
    """Return what every request does in every state."""
    rows = []
    for bring, request in product(_STATES, REQUESTS):
        bench = bring()
        state = bench.state
        answer = bench.ask(request)
        rows.append(Transition(state, request, answer.accepted, bench.state, answer.reason))
    return rows


def together() -> list[Transition]:
    """Return what two requests do that arrive together at an idle gripper; the answer is the second's."""
    rows = []
    for first, second in product(REQUESTS, REQUESTS):
        bench = _Bench()
        state = bench.state
        bench.ask(first)
        answer = bench.ask(second)
        rows.append(Transition(state, f"{first}, then {second}", answer.accepted, bench.state, answer.reason))
    return rows


def _closing(request: str) -> _Bench:
    bench = _Bench()
    bench.ask(request)
    return bench


def _holding(request: str) -> _Bench:
    bench = _closing(request)
    bench.run_until(Phase.HOLDING)
    return bench


def _releasing() -> _Bench:
    bench = _holding("grasp/auto")
    bench.ask("grasp/release")
    return bench


def _vented_fault() -> _Bench:
    bench = _Bench()
    bench.ask("grasp/stop")
    return bench


def _keeping_fault() -> _Bench:
    bench = _holding("grasp/auto")
    bench.arbiter.observe_health(bench.time_s, "pressure_sensor", False, "a channel is stuck")
    bench.arbiter.tick(bench.time_s)
    bench.arbiter.observe_health(bench.time_s, "pressure_sensor", True)
    return bench


_STATES: tuple[Callable[[], _Bench], ...] = (
    _Bench,
    lambda: _closing("grasp/auto"),
    lambda: _closing("grasp/<mode>"),
    lambda: _holding("grasp/auto"),
    lambda: _holding("grasp/<mode>"),
    _releasing,
    _vented_fault,
    _keeping_fault,
)
