"""Parameters as data: each with default, range, unit and description, read-only where a change would lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from mbpam_ros.configuration import ConfigError

ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")
ROS_PREFIX = "qos_overrides."


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Args:
        name: its ROS name, with the unit as suffix.
        default: its value and thereby its type.
        description: one line for ``ros2 param describe``.
        low, high: inclusive range of a number (ROS then refuses NaN too); None for text and switches.
        changeable: whether it may be set while the node runs.
    """

    name: str
    default: bool | int | float | str
    description: str
    low: float | None = None
    high: float | None = None
    changeable: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the ROS descriptor, range included."""
        descriptor = ParameterDescriptor(description=self.description, read_only=not self.changeable)
        if self.low is not None and self.high is not None:
            if isinstance(self.default, float):
                bounds = FloatingPointRange(from_value=float(self.low), to_value=float(self.high))
                descriptor.floating_point_range = [bounds]
            else:
                descriptor.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)]
        return descriptor


def declare_parameters(node: Node, parameters: Sequence[Parameter]) -> None:
    """Declare the parameters of a node and refuse what the user gave under a name the node does not know.

    Raises:
        ConfigError: an unknown name, a value of the wrong type, outside its range or not finite.
    """
    known = {parameter.name: parameter for parameter in parameters}
    given = node._parameter_overrides  # rclpy has no public view of overrides that were never declared
    unknown = sorted(
        name for name in given if name not in (*known, *ROS_PARAMETERS) and not name.startswith(ROS_PREFIX)
    )
    if unknown:
        raise ConfigError(f"{node.get_name()}: unknown parameter {', '.join(unknown)}; known: {', '.join(known)}")
    for parameter in parameters:
        try:
            node.declare_parameter(parameter.name, parameter.default, parameter.descriptor())
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ConfigError(f"{node.get_name()}: parameter {parameter.name}: {error}") from error
