"""Watch a gripper, simulated or real, in a browser: nothing else need be installed.

    mbpam view                                   then open http://127.0.0.1:8080
    mbpam view --allow-commands                  with buttons that call the gripper's services
    mbpam view --namespace right --port 8081     another gripper

Shown are the fingers as estimated, the truth of a simulated gripper pale beside them, the object, what the camera
found, its picture, pressures with set-point and limit, the state of the grasp, and what every node says of itself. The
page is served to this machine alone unless --host says otherwise, and shows only, unless --allow-commands. Fingers move
as often as they are told: set marker_rate_hz of state_estimator and plant to 30 for a smooth picture. How many pictures
a second were sent, and what that cost, --measure tells.
"""

from __future__ import annotations

import argparse
import math
import queue
import signal
import time
from typing import TYPE_CHECKING

from mbpam_ros.commands.system import NodeSystemError, Operator

from mbpam_ros.commands.viewer import FRAME_S, Viewer  # isort: skip
import numpy as np
from std_srvs.srv import SetBool, Trigger

from mbpam_ros.errors import MbpamError
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import load_gripper

if TYPE_CHECKING:
    from viser import ViserServer

LOOPBACK = "127.0.0.1"
BUTTONS = {"grasp": ("auto", *MODE_NAMES, "release", "check", "reset"), "plant": ("lift", "lower", "reset")}
"""Services by the node's part of their names."""

AIR, STOP = "valve_controller/enable", "grasp/stop"


class Pace:
    """How many pictures of moving fingers a second are sent, and what this process takes of a core, threads included.

    Args:
        duration_s: it is over so long after the first picture.
    """

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._drawn_s: list[float] = []
        self._cpu_from_s = self._cpu_s = 0.0

    def drew(self) -> None:
        """Take notice that the fingers were drawn anew, now."""
        if not self._drawn_s:
            self._cpu_from_s = time.process_time()
        self._drawn_s.append(time.monotonic())
        self._cpu_s = time.process_time() - self._cpu_from_s

    @property
    def over(self) -> bool:
        """Whether the time is up."""
        return bool(self._drawn_s) and self._drawn_s[-1] - self._drawn_s[0] >= self._duration_s

    def __str__(self) -> str:
        gaps_s = np.diff(self._drawn_s)
        return (
            f"{len(gaps_s) / gaps_s.sum():.1f} pictures/s in {gaps_s.sum():.0f} s, longest pause "
            f"{1e3 * gaps_s.max():.0f} ms, {100.0 * self._cpu_s / gaps_s.sum():.0f} % of a core"
        )


class ViewError(MbpamError, RuntimeError):
    """The page cannot be served; the message says why."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--port", type=int, default=8080, metavar="N", help="of the page (default: 8080)")
    parser.add_argument("--host", default=LOOPBACK, help="address that is served (default: this machine alone)")
    parser.add_argument("--namespace", default="", help="of the gripper (default: none)")
    parser.add_argument("--allow-commands", action="store_true", help="buttons that call services")
    parser.add_argument("--measure", type=float, metavar="S", help="say after S seconds of moving fingers what it cost")
    parser.add_argument("--gripper", default="gripper.yaml", metavar="YAML", help="default: gripper.yaml")


def run(options: argparse.Namespace) -> int:
    """Serve the page until a signal."""
    import viser

    gripper = load_gripper(options.gripper)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stopped.append(received))
    try:
        server = viser.ViserServer(options.host, options.port, label="mbpam_ros", verbose=False)
    except OSError as error:
        raise ViewError(f"{options.host}:{options.port}: {error.strerror or error}; give another --port") from error
    operator = Operator("viewer", options.namespace)
    try:
        asked: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
        if options.allow_commands:
            _add_buttons(server, asked)
        viewer = Viewer(operator, server, gripper)
        print(f"http://{options.host}:{server.get_port()}; Ctrl-C ends it", flush=True)
        pace = Pace(options.measure or math.inf)
        next_s = time.monotonic()
        while not (stopped or pace.over):
            next_s = max(next_s + FRAME_S, time.monotonic())  # pictures that are late are left out
            while (left_s := next_s - time.monotonic()) > 0.0 and not stopped:
                operator.spin(left_s)
            if viewer.draw():
                pace.drew()
            if not asked.empty():
                _ask(operator, server, *asked.get())
        if pace.over:
            print(pace)
    finally:
        operator.close()
        server.stop()
    return 0


def _add_buttons(server: ViserServer, asked: queue.SimpleQueue[tuple[str, bool]]) -> None:
    """Buttons that ask the services any operator asks: these decide, and say why they refuse."""
    gui = server.gui
    with gui.add_folder("Commands", order=1.0):
        for group, names in BUTTONS.items():
            buttons = gui.add_button_group(group, names)
            buttons.on_click(lambda event, group=group: asked.put((f"{group}/{event.target.value}", True)))
        gui.add_button_group("air", ("on", "off")).on_click(lambda event: asked.put((AIR, event.target.value == "on")))
        gui.add_button("stop", color="red").on_click(lambda _: asked.put((STOP, True)))


def _ask(operator: Operator, server: ViserServer, service: str, on: bool) -> None:
    """Call a service and show its answer on every page."""
    try:
        if service == AIR:
            answer = operator.call(SetBool, service, SetBool.Request(data=on), timeout_s=2.0)
        else:
            answer = operator.call(Trigger, service, timeout_s=2.0)
        title, said = (service if answer.success else f"{service} refused"), answer.message
    except NodeSystemError as error:
        title, said = f"{service} failed", str(error)
    print(f"{title}: {said}", flush=True)
    for client in server.get_clients().values():
        client.add_notification(title, said, auto_close_seconds=6.0)
