"""Middleware settings that must stand before the first ROS context: import this module first.

All are defaults; what the user exported wins. Fast DDS speaks UDP alone: with its shared memory, a process that meets a
new peer may hold back all it receives for 333 ms (its issue 6535), ten times what valves wait. While discovery is to
stay on this machine (``ROS_AUTOMATIC_DISCOVERY_RANGE`` is ``LOCALHOST`` or not set), Fast DDS gets a profile that binds
to loopback alone. The range is then left to the profile, because to ``LOCALHOST`` the ROS layer adds shared memory
again, and UDP on all interfaces. BLAS runs in one thread: the matrices here are small, and idle threads cost the other
nodes their core.
"""

import os
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from mbpam_ros.configuration import ConfigError, config_path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"

PROFILES = {"Fast DDS 2": "FASTRTPS_DEFAULT_PROFILES_FILE", "Fast DDS 3": "FASTDDS_DEFAULT_PROFILES_FILE"}
"""Where Fast DDS looks for its profile."""


def keep_to_udp_on_loopback() -> None:
    """Take shared memory from Fast DDS, and bind it to loopback unless a range, middleware or profile is exported."""
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    local = os.environ.setdefault(RANGE, "LOCALHOST") == "LOCALHOST"
    fast_dds = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
    if not local or not fast_dds:
        return
    # Where no profile is found, or nobody would read it, LOCALHOST stays.
    with suppress(ConfigError, PackageNotFoundError):
        loopback = str(config_path("fastdds_loopback.xml"))
        # It may have come from a parent process, under which somebody exported LOCALHOST again.
        if any(os.environ.get(name, loopback) != loopback for name in PROFILES.values()):
            return
        kilted_or_later = int(version("rclpy").split(".")[0]) > 7
        variable = PROFILES["Fast DDS 3" if kilted_or_later else "Fast DDS 2"]
        os.environ[variable] = loopback
        os.environ[RANGE] = "SYSTEM_DEFAULT"


keep_to_udp_on_loopback()
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
