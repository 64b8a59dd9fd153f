"""Parameters of all nodes: described, ranged, read-only where a change would lie, and unknown ones refused."""

import math

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters

from mbpam_ros.configuration import ConfigError
from mbpam_ros.nodes import grasp_arbiter, object_detector, plant, pressure_sensor, state_estimator, valve_controller

NODES = {
    "plant": (plant.PlantNode, plant.PARAMETERS),
    "pressure_sensor": (pressure_sensor.PressureSensorNode, pressure_sensor.PARAMETERS),
    "valve_controller": (valve_controller.ValveControllerNode, valve_controller.PARAMETERS),
    "state_estimator": (state_estimator.StateEstimatorNode, state_estimator.PARAMETERS),
    "object_detector": (object_detector.ObjectDetectorNode, object_detector.PARAMETERS),
    "grasp_arbiter": (grasp_arbiter.GraspArbiterNode, grasp_arbiter.PARAMETERS),
}
each_node = pytest.mark.parametrize("name", NODES)
RANGED = [
    (name, parameter)
    for name, (_, parameters) in NODES.items()
    for parameter in parameters
    if not isinstance(parameter.default, (str, bool))
]
CHANGEABLE = [
    (name, parameter) for name, (_, parameters) in NODES.items() for parameter in parameters if parameter.changeable
]
UNITS = ("_hz", "_s", "_pa", "_m", "_rad", "_v", "_kg")


def labels(pairs):
    return [f"{name}-{parameter.name}" for name, parameter in pairs]


def change(graph, node, name, value):
    """Set a parameter as ``ros2 param set`` does; return the result."""
    kind = {float: "DOUBLE", int: "INTEGER", str: "STRING", bool: "BOOL"}[type(value)]
    field = {float: "double_value", int: "integer_value", str: "string_value", bool: "bool_value"}[type(value)]
    message = ParameterValue(type=getattr(ParameterType, f"PARAMETER_{kind}"), **{field: value})
    request = SetParameters.Request(parameters=[ParameterMessage(name=name, value=message)])
    return graph.call(SetParameters, f"{node}/set_parameters", request).results[0]


@each_node
def test_every_parameter_has_a_description_and_numbers_a_range_and_a_unit(graph, name):
    node_class, parameters = NODES[name]
    graph.add(node_class)
    names = [parameter.name for parameter in parameters]
    listed = graph.call(ListParameters, f"{name}/list_parameters").result.names
    assert set(names) <= set(listed)
    descriptors = graph.call(
        DescribeParameters, f"{name}/describe_parameters", DescribeParameters.Request(names=names)
    ).descriptors
    for parameter, descriptor in zip(parameters, descriptors, strict=True):
        assert len(descriptor.description) > 10, parameter.name
        assert descriptor.read_only is not parameter.changeable
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if isinstance(parameter.default, (str, bool)):
            assert not ranges
        else:
            (bounds,) = ranges
            assert bounds.from_value <= parameter.default <= bounds.to_value
        if isinstance(parameter.default, float):
            assert parameter.name.endswith((*UNITS, "friction")), parameter.name  # a coefficient has none
            assert "[" in descriptor.description, parameter.name


@each_node
def test_the_values_in_force_are_the_defaults(graph, name):
    node_class, parameters = NODES[name]
    graph.add(node_class)
    names = [parameter.name for parameter in parameters]
    values = graph.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=names)).values
    for parameter, value in zip(parameters, values, strict=True):
        field = {float: "double_value", int: "integer_value", str: "string_value", bool: "bool_value"}
        assert getattr(value, field[type(parameter.default)]) == parameter.default, parameter.name


@each_node
def test_an_unknown_parameter_is_a_configuration_error_that_lists_the_known(graph, name):
    node_class, parameters = NODES[name]
    with pytest.raises(ConfigError, match=f"{name}: unknown parameter colour; known: {parameters[0].name}, "):
        graph.add(node_class, colour="blue")
    with pytest.raises(ConfigError, match="unknown parameter use_sim_timee"):
        graph.add(node_class, use_sim_timee=True)


@pytest.mark.parametrize("name, parameter", RANGED, ids=labels(RANGED))
def test_a_number_out_of_its_range_or_of_another_type_is_a_configuration_error(graph, name, parameter):
    node_class, _ = NODES[name]
    kind = type(parameter.default)
    if kind is bool:
        assert not change(graph, name, parameter.name, "much").successful
        assert change(graph, name, parameter.name, not parameter.default).successful
        return
    wrong = [kind(parameter.low - 1), kind(parameter.high + 1), "much", True]
    if kind is float:
        wrong += [math.nan, math.inf]
    for value in wrong:
        with pytest.raises(ConfigError, match=f"{name}: parameter {parameter.name}"):
            graph.add(node_class, **{parameter.name: value})


@each_node
def test_a_read_only_parameter_cannot_be_set_while_the_node_runs(graph, name):
    node_class, parameters = NODES[name]
    node = graph.add(node_class)
    for parameter in parameters:
        if parameter.changeable:
            continue
        result = change(graph, name, parameter.name, parameter.default)
        assert not result.successful, parameter.name
        assert "read-only" in result.reason
    assert all(node.get_parameter(parameter.name).value == parameter.default for parameter in parameters)


@pytest.mark.parametrize("name, parameter", CHANGEABLE, ids=labels(CHANGEABLE))
def test_a_changeable_parameter_is_set_within_its_range_only(graph, name, parameter):
    node = graph.add(NODES[name][0])
    kind = type(parameter.default)
    if kind is bool:
        assert not change(graph, name, parameter.name, "much").successful
        assert change(graph, name, parameter.name, not parameter.default).successful
        return
    if kind is str:
        assert not change(graph, name, parameter.name, 1.0).successful
        assert change(graph, name, parameter.name, "light").successful
        return
    wrong = [kind(parameter.low - 1), kind(parameter.high + 1), "much"]
    if kind is float:
        wrong += [math.nan, math.inf]
    for value in wrong:
        result = change(graph, name, parameter.name, value)
        assert not result.successful, value
        assert result.reason
        assert node.get_parameter(parameter.name).value == parameter.default
    for value in (kind(parameter.low), kind(parameter.high)):
        assert change(graph, name, parameter.name, value).successful
        assert node.get_parameter(parameter.name).value == value


@each_node
def test_a_parameter_that_does_not_exist_cannot_be_set(graph, name):
    graph.add(NODES[name][0])
    assert not change(graph, name, "colour", "blue").successful


@each_node
def test_use_sim_time_is_known_to_every_node(graph, name):
    node = graph.add(NODES[name][0], use_sim_time=True)
    graph.set_time(12.5)
    assert node.now_s() == pytest.approx(12.5)
