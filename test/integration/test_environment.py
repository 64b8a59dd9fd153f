"""What the nodes ask of the middleware: UDP on loopback alone, unless the user exported something else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbpam_ros.commands.system import NodeProcesses, Operator
from mbpam_ros.nodes.environment import PROFILES, RANGE, keep_to_udp_on_loopback

LOOPBACK = "0100007F"
"""127.0.0.1 as ``/proc/net/udp`` writes it."""

PEER = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("peer")
heard = []
node.create_subscription(JointState, "chamber_states", heard.append, qos_profile_sensor_data)
zero = node.create_client(Trigger, "pressure_sensor/zero")
while not (heard and zero.service_is_ready()):
    rclpy.spin_once(node, timeout_sec=0.1)
answer = zero.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, answer)
print("heard", len(heard[0].effort), "answer", answer.result().success)
"""


@pytest.fixture
def exported(monkeypatch):
    """Start from nothing exported, and set these variables."""
    for name in ("FASTDDS_BUILTIN_TRANSPORTS", "RMW_IMPLEMENTATION", RANGE, *PROFILES.values()):
        monkeypatch.delenv(name, raising=False)

    def export(**variables: str) -> None:
        for name, value in variables.items():
            monkeypatch.setenv(name, value)

    return export


def profile() -> str | None:
    return next((os.environ[name] for name in PROFILES.values() if name in os.environ), None)


@pytest.mark.parametrize("variables", [{}, {RANGE: "LOCALHOST"}, {"RMW_IMPLEMENTATION": "rmw_fastrtps_dynamic_cpp"}])
def test_on_this_machine_fast_dds_gets_the_loopback_profile_and_the_range_is_left_to_it(exported, variables):
    exported(**variables)
    keep_to_udp_on_loopback()
    assert Path(profile()).name == "fastdds_loopback.xml"
    assert os.environ[RANGE] == "SYSTEM_DEFAULT"
    assert os.environ["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv4"


def test_settings_handed_down_to_a_child_stay(exported):
    exported()
    keep_to_udp_on_loopback()
    before = dict(os.environ)
    keep_to_udp_on_loopback()
    assert dict(os.environ) == before


def test_a_range_that_is_exported_again_below_a_process_with_the_profile_is_left_to_it_too(exported, monkeypatch):
    exported()
    keep_to_udp_on_loopback()
    before = dict(os.environ)
    monkeypatch.setenv(RANGE, "LOCALHOST")  # with which the ROS layer would bind to all interfaces
    keep_to_udp_on_loopback()
    assert dict(os.environ) == before


@pytest.mark.parametrize(
    ("variables", "range_", "profile_"),
    [
        ({RANGE: "SUBNET"}, "SUBNET", None),
        ({RANGE: "OFF"}, "OFF", None),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "LOCALHOST", None),
        ({PROFILES["Fast DDS 3"]: "mine.xml"}, "LOCALHOST", "mine.xml"),
        ({PROFILES["Fast DDS 2"]: "mine.xml"}, "LOCALHOST", "mine.xml"),
    ],
)
def test_what_the_user_exported_wins(exported, variables, range_, profile_):
    exported(**variables)
    keep_to_udp_on_loopback()
    assert os.environ[RANGE] == range_
    assert profile() == profile_


@pytest.mark.parametrize("program", [["mbpam_ros.nodes", "pressure_sensor"], ["mbpam_ros.commands", "first-grasps"]])
def test_a_middleware_that_is_not_installed_is_refused_in_a_line_that_names_what_is(program):
    ended = subprocess.run(
        [sys.executable, "-m", *program],
        env=os.environ | {"RMW_IMPLEMENTATION": "rmw_of_nobody"},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert ended.returncode in (1, 2)
    (line,) = ended.stderr.splitlines()
    assert "RMW_IMPLEMENTATION=rmw_of_nobody: this middleware is not installed, only rmw_fastrtps_cpp" in line


@pytest.mark.usefixtures("compiled_plant")
def test_nodes_bind_to_loopback_alone_and_peers_with_the_middlewares_own_settings_reach_them(domain, log_directory):
    environment = {"ROS_DOMAIN_ID": str(domain)}
    with NodeProcesses(log_directory, None, (), ("plant", "pressure_sensor"), environment) as processes:
        operator = Operator("test_operator", idle=processes.check, domain_id=domain)
        operator.wait_for_nodes(("plant", "pressure_sensor"))
        operator.close()
        for process in processes.processes.values():
            addresses = udp_addresses(process.pid)
            assert addresses and set(addresses) == {LOOPBACK}
            assert "/dev/shm/fastdds" not in Path(f"/proc/{process.pid}/maps").read_text()

        stripped = {name: value for name, value in os.environ.items() if not name.startswith(("FASTDDS_", "FASTRTPS_"))}
        peer = subprocess.run(
            [sys.executable, "-c", PEER],
            env=stripped | environment | {RANGE: "LOCALHOST"},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        assert peer.stdout.strip() == "heard 16 answer True", peer.stderr


def udp_addresses(pid: int) -> list[str]:
    """Return the local address of each UDP socket that a process has open."""
    links = [os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()]
    inodes = {link.removeprefix("socket:[").removesuffix("]") for link in links if link.startswith("socket:[")}
    rows = [
        line.split() for table in ("udp", "udp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]
    ]
    return [row[1].split(":")[0] for row in rows if row[9] in inodes]
