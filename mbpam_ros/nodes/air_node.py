"""What a node that moves air has to do, so that it can run by itself or be managed (:mod:`mbpam_ros.nodes.managed`)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbpam_ros.answer import Answer
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.runtime import GripperNode, NodeOptions

if TYPE_CHECKING:
    from typing_extensions import Unpack

INACTIVE = "the node is inactive; activate it"


class AirNode(GripperNode):
    """A node that moves air. By itself it is configured when it is built, and active for as long as it runs."""

    def __init__(self, name: str, parameters: Sequence[Parameter], **node_options: Unpack[NodeOptions]) -> None:
        super().__init__(name, parameters, **node_options)
        self.configure()

    @abstractmethod
    def configure(self) -> None:
        """Read the files, and open topics, services and timers.

        Raises:
            ConfigError: a configuration that cannot be used.
        """

    @abstractmethod
    def let_air_flow(self, on: bool) -> Answer:
        """Let air in, or from now on keep it out: what is vented still leaves. Only switching on may be refused."""

    def objection_to_cleanup(self) -> str | None:
        """Return why what the node knows must not be forgotten now, or None."""
        return None
