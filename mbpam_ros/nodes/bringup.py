"""Executable ``bringup``: all six nodes in one process, for the least CPU and latency."""

from __future__ import annotations

import sys

from mbpam_ros.nodes.runtime import run  # isort: skip
from mbpam_ros.nodes.grasp_arbiter import GraspArbiterNode
from mbpam_ros.nodes.object_detector import ObjectDetectorNode
from mbpam_ros.nodes.plant import PlantNode
from mbpam_ros.nodes.pressure_sensor import PressureSensorNode
from mbpam_ros.nodes.state_estimator import StateEstimatorNode
from mbpam_ros.nodes.valve_controller import ValveControllerNode


def main() -> int:
    """Run the whole gripper until a signal."""
    return run(
        PlantNode,
        PressureSensorNode,
        ValveControllerNode,
        StateEstimatorNode,
        ObjectDetectorNode,
        GraspArbiterNode,
    )


if __name__ == "__main__":
    sys.exit(main())
