"""What a node's command line says to one node of several."""

import pytest

from mbpam_ros.nodes.command_line import CALLED, answer, rules_of_node

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


def test_help_calls_the_executable_what_the_user_typed(monkeypatch, capsys):
    monkeypatch.setenv(CALLED, "ros2 run mbpam_ros plant")
    assert answer(["/opt/ws/bin/mbpam_plant", "-p", "scene:=tomato"], []) == 2
    assert "; ROS arguments follow --ros-args: ros2 run mbpam_ros plant --ros-args" in capsys.readouterr().err
    monkeypatch.delenv(CALLED)
    assert answer(["/opt/ws/bin/mbpam_plant", "tomato"], []) == 2
    assert "see mbpam_plant -h" in capsys.readouterr().err
