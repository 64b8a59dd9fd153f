"""Node ``valve_controller`` as a managed one: configure, activate (air may flow), deactivate, cleanup, shutdown."""

from __future__ import annotations

import sys

from mbpam_ros.nodes.runtime import run  # isort: skip
from mbpam_ros.nodes.managed import Managed
from mbpam_ros.nodes.valve_controller import PARAMETERS as PARAMETERS
from mbpam_ros.nodes.valve_controller import ValveControllerNode


class ManagedValveControllerNode(Managed, ValveControllerNode):
    """Waits for a supervisor; ``enable_at_start`` has no effect."""


def main() -> int:
    """Run the node until a signal."""
    return run(ManagedValveControllerNode)


if __name__ == "__main__":
    sys.exit(main())
