"""The layouts for Foxglove and RViz show topics that there are, of the types and with the QoS they have."""

import json
import re
from pathlib import Path

import yaml

from mbpam_ros.actuator.chambers import BEND_NAMES, CHANNEL_COUNT
from mbpam_ros.nodes.interface import NODES, TOPICS

VIEWS = Path(__file__).parents[3] / "config" / "views"
TABLE = {name: topic for topic in TOPICS for name in topic.names}

SHOWN_BY = {
    "RobotModel": "std_msgs/msg/String",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PoseArray": "geometry_msgs/msg/PoseArray",
    "Pose": "geometry_msgs/msg/PoseStamped",
    "Image": "sensor_msgs/msg/Image",
}
"""Displays of RViz, and what each can show."""


def test_foxglove_shows_topics_and_fields_that_there_are():
    text = (VIEWS / "foxglove.json").read_text(encoding="utf-8")
    content = json.loads(text)
    named = set(re.findall(r'"/([a-z_/]+)[".]', text))
    assert named - {"diagnostics"} <= set(TABLE)
    assert {"chamber_states", "joint_states", "detections/image", "grasp_state", "robot_description"} <= named
    lengths = {"chamber_states": CHANNEL_COUNT, "valve_commands": CHANNEL_COUNT + 1, "joint_states": len(BEND_NAMES)}
    plotted = re.findall(r'"/([a-z_]+)\.(position|effort)\[(\d+)\]"', text)
    for topic, length in lengths.items():
        assert sorted(int(index) for name, _, index in plotted if name == topic) == list(range(length))
        assert all(field in TABLE[topic].meaning for name, field, _ in plotted if name == topic)
    placed = re.findall(r'"([A-Za-z0-9]+![a-z]+)"', json.dumps(content["layout"]))
    assert sorted(placed) == sorted(content["configById"])


def test_rviz_shows_topics_of_the_types_its_displays_take_and_hears_the_latched_ones():
    content = yaml.safe_load((VIEWS / "gripper.rviz").read_text(encoding="utf-8"))
    shown = 0
    for display in content["Visualization Manager"]["Displays"]:
        heard = display.get("Topic") or display.get("Description Topic")
        if heard is not None:
            topic = TABLE[heard["Value"]]
            assert topic.message_type == SHOWN_BY[display["Class"].partition("/")[2]], display["Name"]
            assert (heard["Durability Policy"] == "Transient Local") == topic.latched, display["Name"]
            shown += 1
    assert shown >= 6


def test_the_aggregator_puts_every_node_under_one_heading_in_any_namespace():
    content = yaml.safe_load((VIEWS / "diagnostics.yaml").read_text(encoding="utf-8"))
    groups = [each for each in content["/**"]["ros__parameters"].values() if isinstance(each, dict)]
    for name in [*NODES, *(f"/left/{node}" for node in NODES), "/driver"]:
        assert sum(any(part in name for part in group["contains"]) for group in groups) == 1, name
    assert {group["type"] for group in groups} == {"diagnostic_aggregator/GenericAnalyzer"}
