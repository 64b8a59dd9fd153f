"""The operator of test_two_hosts.py, a process on the second host: does what it reads, and tells what came of it."""

import json
import math
import sys

from mbpam_ros.commands.system import Operator  # isort: skip
import numpy as np
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.runtime import NEWEST

WAIT_S = 60.0


class SecondHost:
    """What is known of the gripper there."""

    def __init__(self):
        self.operator = Operator("two_hosts_operator")
        self.highest_pa = math.nan
        self.operator.node.create_subscription(JointState, "chamber_states", self._on_pressures, NEWEST)

    def _on_pressures(self, message):
        self.highest_pa = float(np.max(message.effort))

    def wait_for(self, predicate, what):
        self.operator.wait_for(predicate, WAIT_S, what)

    def state(self, **more):
        return {**self.operator.grasp, "highest_pa": self.highest_pa, **more}

    def phase(self):
        return self.operator.grasp.get("phase")

    def enable(self):
        self.operator.wait_for_nodes(NODES, WAIT_S)
        self.operator.enable(WAIT_S)
        return "ready"

    def close(self):
        self.wait_for(lambda: self.accepted("grasp/envelope"), "a grasp accepted")
        self.wait_for(lambda: self.phase() in ("holding", "fault"), "the end of the grasp")
        return self.state()

    def stop(self):
        said = self.operator.call(Trigger, "grasp/stop", timeout_s=WAIT_S).message
        self.wait_for(lambda: self.phase() == "fault", "the fault")
        return self.state(said=said)

    def lost(self):
        self.wait_for(lambda: self.phase() == "fault", "the fault")
        return self.state()

    def found(self):
        self.highest_pa = math.nan
        self.operator.health.clear()
        self.wait_for(lambda: self.highest_pa > 0.0, "pressures again")
        self.operator.wait_for_nodes(NODES, WAIT_S)  # all that was missed comes first, and may be lost once more
        return self.state()

    def back(self):
        self.operator.call(Trigger, "grasp/release", timeout_s=WAIT_S)
        self.wait_for(lambda: self.highest_pa < 5e3, "vented chambers")
        self.wait_for(lambda: self.accepted("grasp/reset"), "a reset accepted")
        self.wait_for(lambda: self.phase() == "idle", "idle")
        self.operator.call(SetBool, "valve_controller/enable", SetBool.Request(data=True), timeout_s=WAIT_S)
        return self.state()

    def accepted(self, service):
        return self.operator.call(Trigger, service, timeout_s=WAIT_S).success


if __name__ == "__main__":
    host = SecondHost()
    for line in sys.stdin:
        print(json.dumps(getattr(host, line.strip())()), flush=True)
