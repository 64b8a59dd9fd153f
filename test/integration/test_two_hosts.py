"""Two hosts, as network namespaces on a wire with delay, jitter and loss: what docs/how-to/two_hosts.md tells to do.

The wire is this process: a TAP device in each namespace, and between them a thread that holds frames back and drops
some. Linux's own ``netem`` does the same where its module is there, which in containers it seldom is.
"""

import fcntl
import heapq
import json
import os
import random
import re
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs/how-to/two_hosts.md"
OPERATOR = Path(__file__).with_name("two_hosts_operator.py")
DELAY_S, JITTER_S, LOSS = 0.005, 0.002, 0.05
WAIT_S = 90.0
ARGUMENTS = {"plant": ["-p", "camera_rate_hz:=0.0"]}

pytestmark = pytest.mark.xdist_group("real_clock")

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000


def told_by_the_page():
    """What the page exports, and which nodes it starts on which host."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    exports = dict(re.findall(r"^export (\w+)=(\S+)", blocks[0], re.MULTILINE))
    first, second = (re.findall(r"^ros2 run mbpam_ros (\w+)", block, re.MULTILINE) for block in blocks[1:3])
    return exports, first, second


class Wire:
    """Two TAP devices, and what passes between them."""

    def __init__(self, names):
        self._ends = [self._open(name) for name in names]
        self._random = random.Random(0)
        self._frames = []
        self.cut = False
        self.passed = self.lost = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self):
        self._ended.set()
        self._thread.join()
        for end in self._ends:
            os.close(end)

    @staticmethod
    def _open(name):
        end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(end, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TAP | _IFF_NO_PI))
        return end

    def _run(self):
        while not self._ended.is_set():
            wait_s = max(0.0, self._frames[0][0] - time.monotonic()) if self._frames else 0.1
            for end in select.select(self._ends, [], [], wait_s)[0]:
                self._take(end)
            while self._frames and self._frames[0][0] <= time.monotonic():
                _, _, end, frame = heapq.heappop(self._frames)
                with suppress(OSError):  # the other end is not up yet, or no longer
                    os.write(end, frame)

    def _take(self, end):
        try:
            frame = os.read(end, 65536)
        except OSError:
            return
        if self.cut or self._random.random() < LOSS:
            self.lost += 1
            return
        self.passed += 1
        due_s = time.monotonic() + DELAY_S + self._random.uniform(-JITTER_S, JITTER_S)
        heapq.heappush(self._frames, (due_s, self.passed, self._ends[1 - self._ends.index(end)], frame))


class Host:
    """A network namespace with an address, and processes in it."""

    def __init__(self, name, device, address, environment, logs):
        self.name, self._logs = name, logs
        self._environment = {**os.environ, **environment}
        for variable in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
            self._environment.pop(variable, None)
        self.processes = []
        ip("netns", "add", name)
        ip("link", "set", device, "netns", name)
        ip("-n", name, "addr", "add", f"{address}/24", "dev", device)
        for each in ("lo", device):
            ip("-n", name, "link", "set", each, "up")

    def start(self, *command, **options):
        log = (self._logs / f"{self.name}_{len(self.processes)}.log").open("wb")
        process = subprocess.Popen(
            ["ip", "netns", "exec", self.name, sys.executable, *command],
            env=self._environment,
            stderr=log,
            **{"stdout": log, **options},
        )
        self.processes.append(process)
        return process

    def close(self):
        for process in self.processes:
            process.send_signal(signal.SIGINT)
        for process in self.processes:
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        ip("netns", "del", self.name)

    def log(self):
        return "\n".join(path.read_text(errors="replace")[-1500:] for path in sorted(self._logs.glob(f"{self.name}_*")))


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


@pytest.fixture
def hosts(domain, log_directory):
    """The wire and two hosts on it, with the page's environment."""
    exports, _, _ = told_by_the_page()
    environment = {**exports, "ROS_DOMAIN_ID": str(domain)}
    log_directory.mkdir(parents=True)
    tag = f"{os.getpid() % 10000}"
    with ExitStack() as stack:
        try:
            devices = [f"mb{tag}a", f"mb{tag}b"]
            wire = Wire(devices)
            stack.callback(wire.close)
            both = []
            for device, address in zip(devices, ("10.78.1.1", "10.78.1.2"), strict=True):
                both.append(Host(f"ns_{device}", device, address, environment, log_directory))
                stack.callback(both[-1].close)
        except (OSError, subprocess.CalledProcessError) as error:
            pytest.skip(f"network namespaces and TAP devices are not permitted here: {error}")
        yield wire, *both


def test_a_grasp_a_stop_and_a_pulled_cable_between_two_hosts_as_the_page_says(hosts):
    wire, first, second = hosts
    exports, on_first, on_second = told_by_the_page()
    assert exports["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    for host, nodes in ((first, on_first), (second, on_second)):
        for node in nodes:
            host.start("-m", "mbpam_ros.nodes", node, "--ros-args", *ARGUMENTS.get(node, ()))
    operator = second.start(str(OPERATOR), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(step):
        """Have the operator do a step; return what came of it."""
        operator.stdin.write(f"{step}\n")
        operator.stdin.flush()
        if not select.select([operator.stdout], [], [], WAIT_S)[0]:
            raise AssertionError(f"{step}: no answer\n{first.log()}\n{second.log()}")
        line = operator.stdout.readline()
        assert line, f"{step}: the operator has ended\n{second.log()}"
        print(step, line.strip())
        return json.loads(line)

    assert ask("enable") == "ready"
    held = ask("close")
    assert held["phase"] == "holding" and held["highest_pa"] > 95e3, (held, first.log(), second.log())
    stopped = ask("stop")
    # A request that the wire loses may come too late for the answer; the valves hear of the stop by the state as well.
    assert stopped["phase"] == "fault"
    assert stopped["said"].startswith(("stopped, venting", "stop latched, but")), stopped
    assert ask("back")["phase"] == "idle"

    assert ask("close")["phase"] == "holding"
    wire.cut = True
    lost = ask("lost")
    assert "no sign of life" in lost["reason"] and lost["air"] == "hold", lost
    wire.cut = False
    found = ask("found")
    assert found["phase"] == "fault" and found["highest_pa"] > 80e3, found
    assert ask("back")["phase"] == "idle"
    assert ask("close")["phase"] == "holding"
    assert wire.lost > 0.02 * wire.passed
