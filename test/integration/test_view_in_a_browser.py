"""``mbpam view`` in a headless browser: it shows fingers that bend, its buttons call services, a hung browser is borne.

Where viser (extra ``view``) or Chromium is not installed there is nothing to try.
"""

import base64
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from importlib.util import find_spec

import cv2
import numpy as np
import pytest

from mbpam_ros.nodes.markers import finger_markers  # isort: skip
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.messages import time_stamp

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.skipif(find_spec("viser") is None, reason="viser is not installed: pip install 'mbpam_ros[view]'"),
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the path"),
    pytest.mark.xdist_group("real_clock"),
]
PAGE_S = 60.0
FLAGS = "--headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --window-size=1000,700"
CLICK = "[...document.querySelectorAll('button')].find(each => each.textContent.trim() == '{}').click()"
TEXT = "document.body.innerText"


class Browser:
    """Chromium, spoken to by its DevTools protocol."""

    def __init__(self, profile, address):
        command = [CHROMIUM, *FLAGS.split(), "--remote-debugging-port=0", f"--user-data-dir={profile}", address]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, start_new_session=True, **quiet)
        port = profile / "DevToolsActivePort"
        until(lambda: port.exists() and port.read_text().count("\n"), "the browser")
        pages = f"http://127.0.0.1:{port.read_text().split()[0]}/json/list"

        def pages_now():
            with urllib.request.urlopen(pages) as answer:
                return [each for each in json.load(answer) if each["type"] == "page"]

        from websockets.sync.client import connect  # comes with viser

        self._socket = connect(until(pages_now, "the page")[0]["webSocketDebuggerUrl"], max_size=None)
        self._numbers = itertools.count(1)

    def ask(self, method, **parameters):
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._socket.recv(timeout=PAGE_S))).get("id") != number:
            pass
        return answer["result"]

    def evaluate(self, script):
        return self.ask("Runtime.evaluate", expression=script)["result"].get("value")

    def picture(self):
        data = base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).astype(int)

    def signal(self, number):
        """Send a signal to all its processes."""
        os.killpg(self.process.pid, number)

    def close(self):
        self.signal(signal.SIGKILL)
        self.process.wait()


def until(found, what, idle=lambda: time.sleep(0.02), limit_s=PAGE_S):
    """Return what is found once it is."""
    end_s = time.monotonic() + limit_s
    while not (answer := found()):
        assert time.monotonic() < end_s, f"{what}: not within {limit_s:g} s"
        idle()
    return answer


def blue(picture):
    """Where the fingers' colour is."""
    b, g, r = np.moveaxis(picture, -1, 0)
    return (b > 90) & (b > r + 40) & (b > g + 15)


def test_the_page_shows_fingers_that_bend_and_its_buttons_call_services(graph, domain, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = ("127.0.0.1", free.getsockname()[1])
    command = [sys.executable, "-m", "mbpam_ros.commands", "view", "--allow-commands", "--port", str(address[1])]
    view = subprocess.Popen(command, env=os.environ | {"ROS_DOMAIN_ID": str(domain)}, stdout=subprocess.PIPE, text=True)
    gripper, called = load_gripper(), []
    rod = gripper.rod_geometry
    served = lambda _, response: called.append("release") or Trigger.Response(success=True, message="so be it")  # noqa: E731
    graph.test_node.create_service(Trigger, "grasp/release", served)
    markers = graph.test_node.create_publisher(MarkerArray, "finger_markers", 5)

    def show(bend):
        lines = centreline((bend, 0.0), rod, np.linspace(0.0, rod.length_m, 14)) + gripper.finger_base_m[:, None, :]
        drawn = finger_markers(time_stamp(1.0), "gripper_base", lines, gripper.geometry.outer_radius_m, (1, 1, 1))
        markers.publish(MarkerArray(markers=drawn))
        graph.executor.spin_once(timeout_sec=0.05)

    browser = None
    try:
        until(lambda: any("http://127.0.0.1" in line for line in view.stdout), "the server")
        browser = Browser(tmp_path / "chromium", "http://{}:{}".format(*address))
        text = lambda: browser.evaluate(TEXT) or ""  # noqa: E731
        until(lambda: "no word of the arbiter" in text() and "release" in text(), "the panel", lambda: show(0.0))
        until(lambda: blue(browser.picture()).sum() > 2000, "fingers", lambda: show(0.0))
        straight = blue(browser.picture())
        moved = lambda: (blue(browser.picture()) != straight).sum() > 0.3 * straight.sum()  # noqa: E731
        until(moved, "bent fingers", lambda: show(1.8))
        browser.evaluate(CLICK.format("release"))
        until(lambda: called, "the service", lambda: show(1.8))
        until(lambda: "so be it" in text(), "its answer on the page", lambda: show(1.8))
        browser.signal(signal.SIGSTOP)
        for number in range(50):  # pictures for a browser that takes none
            show(0.03 * number)
        with urllib.request.urlopen("http://{}:{}".format(*address), timeout=PAGE_S) as another:
            assert another.status == 200
        view.send_signal(signal.SIGINT)
        assert view.wait(timeout=30.0) == 0
    finally:
        view.kill()
        view.wait()
        if browser is not None:
            browser.close()
