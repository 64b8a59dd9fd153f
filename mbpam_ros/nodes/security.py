"""Who may publish, hear and call what, for the access control of SROS2: the interface table as its policy file.

``python -m mbpam_ros.nodes.security [NAMESPACE] > policy.xml`` prints it. Each node has an enclave of its own,
``/mbpam/NODE``; ``bringup``, six nodes in one process, has one for all; operators, who may hear all topics and call all
services but publish nothing, have ``/mbpam/operator``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from xml.sax.saxutils import quoteattr

from mbpam_ros.nodes.gripper_action import ACTIONS
from mbpam_ros.nodes.interface import NODES, SERVICES, TOPICS
from mbpam_ros.nodes.vision_detections import TOPIC as DETECTIONS

OPERATOR = "operator"

TELLING_FRAMES = ("plant", "state_estimator")
"""Who says where frames are, where tf2_msgs is installed."""

WHERE_INSTALLED = {"object_detector": (DETECTIONS,)}
"""What is published where vision_msgs is installed."""

MANAGED = ("valve_controller",)
"""What has a version that a supervisor manages."""

_LIFECYCLE_SERVICES = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
_PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "get_type_description",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)


def policy(namespace: str = "/") -> str:
    """Return the policy file for a gripper in ``namespace``."""
    enclaves = [(node, [node]) for node in NODES] + [("bringup", list(NODES)), (OPERATOR, [OPERATOR])]
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines += ["<!-- Made by: python -m mbpam_ros.nodes.security. A test holds it to the interface table. -->"]
    lines += ['<policy version="0.2.0">', "  <enclaves>"]
    for name, nodes in enclaves:
        lines += [f"    <enclave path={quoteattr(f'/mbpam/{name}')}>", "      <profiles>"]
        for node in nodes:
            lines += [f"        <profile ns={quoteattr(namespace)} node={quoteattr(node)}>"]
            lines += _rules(node, "*" if node == OPERATOR else node)
            lines += ["        </profile>"]
        lines += ["      </profiles>", "    </enclave>"]
    lines += ["  </enclaves>", "</policy>", ""]
    return "\n".join(lines)


def _rules(name: str, node: str) -> list[str]:
    """Return the rules of a node, or of one that may hear and call everything (``*``)."""
    operator = node == "*"
    publishes = [topic for each in TOPICS if node in each.publishers for topic in each.names]
    hears = [topic for each in TOPICS if operator or node in each.subscribers for topic in each.names]
    of_all = ["/diagnostics"] if operator or node == "grasp_arbiter" else []
    tells = ["/rosout", "/parameter_events"] + ([] if operator else ["/diagnostics"])
    tells += ["/clock"] if node == "plant" else []
    tells += ["/tf", "/tf_static"] if node in TELLING_FRAMES else []
    tells += [*WHERE_INSTALLED.get(node, ()), *(["~/transition_event"] if node in MANAGED else [])]
    own = [*_PARAMETER_SERVICES, *(_LIFECYCLE_SERVICES if node in MANAGED else ())]
    serves = [f"~/{service}" for service in own] + [each.name for each in SERVICES if each.node == node]
    calls = [each.name for each in SERVICES if operator or node in each.callers]
    if operator:
        calls += [f"{each}/{service}" for each in MANAGED for service in _LIFECYCLE_SERVICES]
    moves = ACTIONS if operator or node == "grasp_arbiter" else ()
    return [
        *_rule("topics", "publish", "topic", tells + publishes),
        *_rule("topics", "subscribe", "topic", ["/clock", "/parameter_events", *of_all, *hears]),
        *_rule("services", "reply", "service", serves),
        *_rule("services", "request", "service", calls),
        *_rule("actions", "call" if operator else "execute", "action", moves),
    ]


def _rule(kind: str, verb: str, element: str, names: Iterable[str]) -> list[str]:
    inside = [f"            <{element}>{name}</{element}>" for name in names]
    return [f'          <{kind} {verb}="ALLOW">', *inside, f"          </{kind}>"] if inside else []


if __name__ == "__main__":
    print(policy(*sys.argv[1:2]), end="")
