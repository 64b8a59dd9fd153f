"""Managed versions of nodes that move air: a supervisor says when each is configured, and when air may flow.

=============== ============================================================ =====================================
transition      what happens                                                 where it fails
=============== ============================================================ =====================================
configure       files are read, topics opened; the valves are kept closed    unconfigured: a file is wrong
activate        the air is switched on                                       inactive: what ``enable`` refuses for
deactivate      the air is switched off: valves closed, what is vented vents never
cleanup         last command (closed, or venting), topics closed             inactive: a vent is latched
shutdown        the same, from any state; the node only reports from then on never
=============== ============================================================ =====================================

An inactive node goes on measuring, vents over-pressure, and refuses whoever would switch the air on. A transition that
breaks down closes the valves and leaves the node unconfigured. Why one failed is in its health report and its log:
the service that was called can only say that it did.

The names of the states and their services are ROS 2's own (https://design.ros2.org/articles/node_lifecycle.html), so
``ros2 lifecycle set /valve_controller configure`` works, and so do the managers of other packages. The package
lifecycle_msgs comes with rclpy, as wheels and in installations of ROS alike.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mbpam_ros.nodes.runtime import Health, NodeOptions  # isort: skip
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.nodes.air_node import AirNode

if TYPE_CHECKING:
    from typing_extensions import Unpack

_Return = TransitionCallbackReturn
_DONE = Answer(True, "")


class Managed(LifecycleNodeMixin, AirNode):
    """Put before the class of a node that moves air, it makes that node a managed one."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        self._configured = False
        self._opening: object | None = None
        self._opened: object | None = None
        self._remark = ""
        self._entities_before: dict[str, list[Any]] = {}
        super(LifecycleNodeMixin, self).__init__(**node_options)  # type: ignore[call-arg]  # of the node's own class
        LifecycleNodeMixin.__init__(self)

    def configure(self) -> None:
        """Do nothing yet: a supervisor says when."""

    @property
    def state(self) -> str:
        """Present state: unconfigured, inactive, active or finalized; or a transition between them."""
        label: str = self._state_machine.current_state[1]
        return label

    def health(self) -> Health:
        """That of the node itself, with its state; WARN while it is not configured."""
        if self._configured:
            health = super().health()  # type: ignore[safe-super]  # of the node's own class
        else:
            health = Health(DiagnosticStatus.WARN, "no valve is commanded", {"enabled": "false"})
        health.values["lifecycle"] = self.state
        health.message = f"{self.state}: {self._remark or health.message}"
        return health

    def rivals_changed(self) -> None:
        """Leave it to the node, once it is configured."""
        if self._configured:
            super().rivals_changed()

    def leave(self) -> None:
        """Give the last command, if there is anything to command."""
        if self._configured:
            super().leave()

    def create_timer(  # type: ignore[override]  # as GripperNode's
        self,
        period_s: float,
        callback: Callable[[], None],
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
    ) -> Timer:
        """Create a timer; one of a configuration is silent after it, though it may have been due before."""
        belongs_to = self._opening

        def call() -> None:
            if belongs_to is None or belongs_to is self._opened:
                callback()

        return super().create_timer(period_s, call, callback_group, clock)

    # Transitions

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the files and open the topics."""
        return self._pass("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let air flow."""
        return self._pass("activate", lambda: self.let_air_flow(True))

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Keep air out."""
        return self._pass("deactivate", lambda: self.let_air_flow(False))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the files and close the topics, unless what is known must be kept."""
        return self._pass("cleanup", self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give the last command and close the topics."""
        return self._pass("shutdown", self._close)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the valves and be unconfigured; finalized where even that fails."""
        remark = self._remark
        try:
            self._close()
        except Exception as error:
            self._remark = f"{remark}; then: {error}"
            return _Return.FAILURE
        self._remark = remark
        return _Return.SUCCESS

    def _pass(self, name: str, transition: Callable[[], Answer]) -> TransitionCallbackReturn:
        """Make a transition, and say what came of it: rclpy keeps it to itself."""
        try:
            answer = transition()
        except ConfigError as error:
            answer = Answer(False, str(error))
        except Exception as error:
            self._remark = f"{name} broke down: {type(error).__name__}: {error}"
            self.get_logger().error(self._remark)
            return _Return.ERROR
        self._remark = "" if answer.accepted else f"{name} refused: {answer.reason}"
        if not answer.accepted:
            self.get_logger().warning(self._remark)
        return _Return.SUCCESS if answer.accepted else _Return.FAILURE

    def _configure(self) -> Answer:
        self._entities_before = {name: list(entities) for name, entities in self._entities().items()}
        self._opening = self._opened = object()
        try:
            super().configure()  # type: ignore[safe-super]  # of the node's own class
        except Exception:
            self._close_topics()
            raise
        finally:
            self._opening = None
        self._configured = True
        self.let_air_flow(False)
        if self.rivals:
            super().rivals_changed()
        return _DONE

    def _clean_up(self) -> Answer:
        objection = self.objection_to_cleanup()
        return self._close() if objection is None else Answer(False, objection)

    def _close(self) -> Answer:
        if self._configured:
            try:
                self.leave()
            finally:
                self._configured = False
                self._close_topics()
        return _DONE

    def _entities(self) -> dict[str, list[Any]]:
        """What a node opens, by the name of what closes it."""
        return {
            "timer": list(self.timers),
            "subscription": list(self.subscriptions),
            "client": list(self.clients),
            "service": list(self.services),
            "publisher": list(self.publishers),
            "answering": self._answering_services,
            "watched": self._watched_nodes,
        }

    def _close_topics(self) -> None:
        """Close what was opened since :attr:`_entities_before` was taken."""
        self._opened = None
        for name, entities in self._entities().items():
            added = [each for each in entities if each not in self._entities_before[name]]
            for each in added:
                if name in ("answering", "watched"):
                    entities.remove(each)
                else:
                    getattr(self, f"destroy_{name}")(each)
