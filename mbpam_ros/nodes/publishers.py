"""Whether a topic that one node is to publish has more."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

_NOT_KNOWN_YET = "_NODE_NAME_UNKNOWN_"


def rival_publishers(node: Node, topics: Sequence[str]) -> str | None:
    """Return which of the topics nodes of different names publish, in words, or None.

    A process that was killed stays in the graph for twenty seconds, so two ends of one name may be a node and what is
    left of it: nodes of one name are told apart by their signs of life (:mod:`~mbpam_ros.nodes.heartbeat`).
    """
    found = []
    for topic in topics:
        if node.count_publishers(topic) < 2:
            continue
        ends = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
        names = {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends if end.node_name != _NOT_KNOWN_YET}
        if len(names) > 1:
            found.append(f"{topic} is published by {' and '.join(sorted(names))}")
    return "; ".join(found) or None
