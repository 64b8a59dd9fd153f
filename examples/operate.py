"""Call a running gripper's services in turn, as an operator without the command ros2 would.

python examples/operate.py enable auto lift release [--namespace /left]
"""

import argparse
import sys

import mbpam_ros.nodes.environment  # noqa: F401  isort: skip - before rclpy: the nodes' settings of the network
import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.nodes.interface import SERVICES, TRIGGER

NAMES = {service.name.rpartition("/")[2]: service for service in SERVICES if service.name != "plant/reset"}


def call(node: Node, word: str) -> bool:
    """Call one service, print its answer, and return whether it was accepted."""
    service = NAMES[word]
    kind, request = (Trigger, Trigger.Request()) if service.service_type == TRIGGER else (SetBool, SetBool.Request(data=True))
    client = node.create_client(kind, service.name)
    if not client.wait_for_service(timeout_sec=10.0):
        print(f"{word}: nobody serves {client.srv_name}")
        return False
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    if not future.done():
        print(f"{word}: no answer")
        return False
    print(f"{word}: {future.result().message}")
    return future.result().success
