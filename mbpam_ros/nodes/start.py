"""What the executables of the nodes call: a stop signal also ends a process that is still loading its node.

That takes a second or two, in which Python would answer with the traceback of some import, and the interrupt may even
be lost in one. Nothing runs yet that has to be ended in order; :func:`~mbpam_ros.nodes.runtime.run` takes over.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from functools import partial

from mbpam_ros.errors import MbpamError

EXECUTABLES = (
    "plant",
    "pressure_sensor",
    "valve_controller",
    "state_estimator",
    "object_detector",
    "grasp_arbiter",
    "bringup",
    "managed_valve_controller",
)


def start(executable: str) -> int:
    """Load and run one of :data:`EXECUTABLES` with the arguments in ``sys.argv``; return its exit code.

    2, with one line on standard error, where it cannot be loaded: the middleware that was asked for is not there.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    try:
        module = importlib.import_module(f"mbpam_ros.nodes.{executable}")
    except MbpamError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    code: int = module.main()
    return code


(
    plant,
    pressure_sensor,
    valve_controller,
    state_estimator,
    object_detector,
    grasp_arbiter,
    bringup,
    managed_valve_controller,
) = (partial(start, executable) for executable in EXECUTABLES)
