"""The driver of own_driver.py as a managed node: it waits for a supervisor, and lets air flow while it is active alone.

python examples/own_managed_driver.py --ros-args -p address:=127.0.0.1:5020 &
ros2 lifecycle set /driver configure && ros2 lifecycle set /driver activate

What each transition does, and where it fails, is told in mbpam_ros/nodes/managed.py. While the terminal is not there it
cannot be activated.
"""

from own_driver import PARAMETERS as PARAMETERS
from own_driver import DriverNode

from mbpam_ros.nodes.managed import Managed
from mbpam_ros.nodes.runtime import run


class ManagedDriverNode(Managed, DriverNode):
    """Keeps the valves closed until it is active, and tells what the transducers read from when it is configured."""


if __name__ == "__main__":
    raise SystemExit(run(ManagedDriverNode))
