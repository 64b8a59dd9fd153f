"""The policy file for SROS2 is that of the interface table."""

import xml.etree.ElementTree as ElementTree

from mbpam_ros.configuration import config_path
from mbpam_ros.nodes.interface import NODES, SERVICES, TOPICS
from mbpam_ros.nodes.security import policy


def rules(enclave, kind, verb, node=None):
    """What a node of an enclave may do."""
    tree = ElementTree.fromstring(policy())
    profile = tree.find(f".//enclave[@path='/mbpam/{enclave}']/profiles/profile[@node='{node or enclave}']")
    return {item.text for each in profile.findall(kind) if each.get(verb) == "ALLOW" for item in each}


def test_the_shipped_policy_is_the_one_made_from_the_interface_table():
    shipped = config_path("security/policy.xml").read_text(encoding="utf-8")
    assert shipped == policy(), "run: python -m mbpam_ros.nodes.security > config/security/policy.xml"


def test_each_node_may_publish_hear_and_serve_what_the_table_says_and_no_more():
    ours = {name for topic in TOPICS for name in topic.names} | {service.name for service in SERVICES}
    for node in NODES:
        for where in (node, "bringup"):
            publishes = {name for topic in TOPICS if node in topic.publishers for name in topic.names}
            hears = {name for topic in TOPICS if node in topic.subscribers for name in topic.names}
            assert rules(where, "topics", "publish", node) & ours == publishes
            assert rules(where, "topics", "subscribe", node) & ours == hears
            serves = {service.name for service in SERVICES if service.node == node}
            assert rules(where, "services", "reply", node) & ours == serves


def test_only_the_valve_controller_commands_valves_and_an_operator_publishes_nothing_of_ours():
    may = [node for node in (*NODES, "operator") if "valve_commands" in rules(node, "topics", "publish")]
    assert may == ["valve_controller"]
    assert rules("operator", "topics", "publish") == {"/rosout", "/parameter_events"}
    managing = {"valve_controller/change_state", "valve_controller/get_state"}
    asked = rules("operator", "services", "request")
    assert asked >= managing and {name for name in asked if "state" not in name and "transition" not in name} == {
        service.name for service in SERVICES
    }


def test_the_arbiter_alone_executes_gripper_actions_and_an_operator_sends_goals():
    assert [node for node in (*NODES, "operator") if rules(node, "actions", "execute")] == ["grasp_arbiter"]
    assert rules("grasp_arbiter", "actions", "execute") == rules("operator", "actions", "call") != set()


def test_a_gripper_in_a_namespace_has_its_profiles_there():
    tree = ElementTree.fromstring(policy("/left"))
    assert {profile.get("ns") for profile in tree.iter("profile")} == {"/left"}
