"""Action servers by which MoveIt and behaviour trees use the hand as any gripper: where control_msgs is installed.

========================== =========================================
action                     type
========================== =========================================
grasp/gripper_cmd          control_msgs/action/GripperCommand
grasp/parallel_gripper_cmd control_msgs/action/ParallelGripperCommand
========================== =========================================

The position of a goal is the opening between the tips [m], 0 to close upon whatever is there; its effort is the force
of a tip that must not be exceeded [N], 0 or none for the mode's own. What they mean for a hand of air is told in
:mod:`~mbpam_ros.grasp.opening`. A goal is rejected where a service would refuse (the log says why), succeeds when the
hand holds or is open, and is aborted by a fault, a stop, or whoever else moves the hand meanwhile; a goal that follows
takes the place of the one before. A goal that is cancelled opens the hand.

No wheel holds the type of any action: with the wheels there is no server, and the services stay.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from sensor_msgs.msg import JointState

from mbpam_ros.answer import Answer
from mbpam_ros.grasp.opening import Command, HandState, Outcome
from mbpam_ros.nodes.messages import MessageError, floats
from mbpam_ros.nodes.runtime import GripperNode

FEEDBACK_PERIOD_S = 0.1
JOINT = "tip_opening"
"""Name of the joint in the states of a ParallelGripperCommand; a goal may leave it out."""

_PREEMPTED = Outcome(True, reason="another goal has taken its place")
_CANCELLED = Outcome(True, reason="cancelled; the hand opens")


class Hand(Protocol):
    """What the servers ask of the hand."""

    def begin_command(self, opening_m: float, force_n: float) -> tuple[Answer, Command]:
        """Start toward an opening with no more than a force; the command means something if that is accepted."""

    def outcome_of(self, command: Command) -> Outcome:
        """Return how far a command has come."""

    def let_go(self) -> None:
        """Let go."""

    def hand_state(self) -> HandState:
        """Return where the hand is."""


class _GripperCommand:
    """Goals, feedback and results of the action of two numbers."""

    @staticmethod
    def read(goal: Any) -> tuple[float, float]:
        """Return opening [m] and force [N]."""
        return goal.command.position, goal.command.max_effort

    @staticmethod
    def filled(message: Any, state: HandState, outcome: Outcome) -> Any:
        """Return the feedback or result with the state in it."""
        message.position, message.effort = state
        message.stalled, message.reached_goal = outcome.stalled, outcome.reached
        return message


class _ParallelGripperCommand:
    """Goals, feedback and results of the action of a JointState."""

    @staticmethod
    def read(goal: Any) -> tuple[float, float]:
        """Return opening [m] and force [N].

        Raises:
            MessageError: not one position, or more than one effort.
        """
        command = goal.command
        if len(command.position) != 1 or len(command.effort) > 1:
            raise MessageError(
                f"one position and at most one effort are wanted, found {len(command.position)} and "
                f"{len(command.effort)}"
            )
        return command.position[0], command.effort[0] if len(command.effort) else 0.0

    @staticmethod
    def filled(message: Any, state: HandState, outcome: Outcome) -> Any:
        """Return the feedback or result with the state in it."""
        message.state = JointState(name=[JOINT], position=floats([state.opening_m]), effort=floats([state.force_n]))
        if hasattr(message, "stalled"):  # a result
            message.stalled, message.reached_goal = outcome.stalled, outcome.reached
        return message


_Form = type[_GripperCommand] | type[_ParallelGripperCommand]
_ACTIONS: tuple[tuple[str, str, _Form], ...] = (
    ("grasp/gripper_cmd", "GripperCommand", _GripperCommand),
    ("grasp/parallel_gripper_cmd", "ParallelGripperCommand", _ParallelGripperCommand),
)


ACTIONS = tuple(name for name, _, _ in _ACTIONS)
"""Their names, relative to the namespace."""


def action_type(name: str) -> Any:
    """Return a type of ``control_msgs.action``, or None where it is not installed."""
    try:
        from control_msgs import action
    except ImportError:
        return None
    return getattr(action, name, None)


@dataclass
class _Goal:
    """A goal that was accepted; its handle, and what publishes its feedback, come when it is executed."""

    command: Command
    end: Future[Outcome]
    handle: Any = None
    tell: Callable[[HandState, Outcome], None] | None = None
    told_at_s: float = -math.inf


class GripperActions:
    """The servers of one hand; without the types there are none, and ``active`` is false.

    Args:
        node: whose servers they are. It has to call :meth:`look` after each of its decisions.
        hand: what moves.
    """

    def __init__(self, node: GripperNode, hand: Hand) -> None:
        self._node, self._hand = node, hand
        self._now: _Goal | None = None
        self._accepted: deque[_Goal] = deque()
        self._servers = [
            self._serve(name, form, kind)
            for name, type_name, form in _ACTIONS
            if (kind := action_type(type_name)) is not None
        ]

    @property
    def active(self) -> bool:
        """Whether any type is installed."""
        return bool(self._servers)

    def look(self) -> None:
        """End the goal that is done with, and tell how far one is that is not."""
        goal, now_s = self._now, self._node.now_s()
        if goal is None:
            return
        if goal.handle is not None and goal.handle.is_cancel_requested:
            self._end(_CANCELLED)
            self._hand.let_go()
            return
        found = self._hand.outcome_of(goal.command)
        if found.done:
            self._end(found)
        elif goal.tell is not None and not 0.0 <= now_s - goal.told_at_s < FEEDBACK_PERIOD_S:
            goal.told_at_s = now_s
            goal.tell(self._hand.hand_state(), found)

    def _serve(self, name: str, form: _Form, kind: Any) -> ActionServer:
        return ActionServer(
            self._node,
            kind,
            name,
            partial(self._execute, form, kind),  # rclpy awaits what it sees to be a coroutine, as in no lambda
            goal_callback=partial(self._on_goal, form),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _on_goal(self, form: _Form, goal: Any) -> GoalResponse:
        """Begin at once, so that a refusal is a rejection; the goal before is done with then."""
        try:
            opening_m, force_n = form.read(goal)
            if not (math.isfinite(opening_m) and math.isfinite(force_n) and force_n >= 0.0):
                raise MessageError(f"an opening of {opening_m:g} m with a force of {force_n:g} N cannot be")
        except MessageError as error:
            self._node.refuse("gripper goal", error)
            return GoalResponse.REJECT
        answer, command = self._hand.begin_command(opening_m, force_n)
        if not answer.accepted:
            return GoalResponse.REJECT
        self._end(_PREEMPTED)
        self._now = _Goal(command, Future())
        self._accepted.append(self._now)
        return GoalResponse.ACCEPT

    def _end(self, outcome: Outcome) -> None:
        if self._now is not None:
            goal, self._now = self._now, None
            goal.end.set_result(outcome)

    async def _execute(self, form: _Form, kind: Any, handle: Any) -> Any:
        """Wait for the end of the goal, and return its result. Goals come here in the order of their acceptance."""
        goal = self._accepted.popleft()
        goal.handle = handle
        goal.tell = lambda state, found: handle.publish_feedback(form.filled(kind.Feedback(), state, found))
        found = await goal.end
        assert found is not None  # as of a future that was cancelled, which nobody does
        if found is _CANCELLED:
            handle.canceled()
        elif found.succeeded:
            handle.succeed()
        else:
            handle.abort()
        self._node.get_logger().info(f"gripper goal: {found.reason}")
        return form.filled(kind.Result(), self._hand.hand_state(), found)
