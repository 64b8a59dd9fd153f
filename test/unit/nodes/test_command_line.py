"""What a node's command line says to one node of several."""

import pytest

from mbpam_ros.nodes.command_line import rules_of_node

LINE = ["bringup", "--ros-args", "-r", "__ns:=/right", "-p", "plant:scene:=c:/tomato.yaml", "--param", "plant:seed:=3"]


@pytest.mark.parametrize(
    ("arguments", "rules"),
    [
        (LINE, ["--ros-args", "-p", "scene:=c:/tomato.yaml", "-p", "seed:=3"]),
        (["plant", "--ros-args", "-p", "scene:=tomato"], []),
        (["bringup", "--ros-args", "-p", "pressure_sensor:seed:=3"], []),
        (["plant", "--ros-args", "-p"], []),
        (["plant"], []),
    ],
)
def test_parameters_with_a_node_s_prefix_are_that_node_s_own(arguments, rules):
    assert rules_of_node(arguments, "plant") == rules
