"""Call a running gripper's services, as ``ros2 service call`` would where that is not installed.

python examples/operate.py valve_controller/enable grasp/auto
python examples/operate.py plant/lift --namespace /left
"""

import argparse

from mbpam_ros.commands.system import Operator  # isort: skip
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.nodes.interface import SERVICES, TRIGGER

TYPES = {service.name: service.service_type for service in SERVICES}

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("services", nargs="+", choices=TYPES, metavar="SERVICE", help=", ".join(TYPES))
parser.add_argument("--namespace", default="", help="of the gripper, such as /left")
parser.add_argument("--off", action="store_true", help="switch the air off where it would be switched on")
options = parser.parse_args()

operator = Operator("operator", options.namespace)
for name in options.services:
    if TYPES[name] == TRIGGER:
        answer = operator.call(Trigger, name)
    else:
        answer = operator.call(SetBool, name, SetBool.Request(data=not options.off))
    print(f"{name}: {answer.message}")
    if not answer.success:
        break
operator.close()
raise SystemExit(0 if answer.success else 1)
