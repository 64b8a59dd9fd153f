"""Middleware settings that must stand before the first ROS context: import this module first.

All are defaults; what the user exported wins. Fast DDS speaks UDP alone: with its shared memory, a process that meets a
new peer may hold back all it receives for 333 ms (its issue 6535), ten times what valves wait. While discovery is to
stay on this machine (``ROS_AUTOMATIC_DISCOVERY_RANGE`` is ``LOCALHOST`` or not set), Fast DDS gets a profile that binds
to loopback alone. The range is then left to the profile, because to ``LOCALHOST`` the ROS layer adds shared memory
again, and UDP on all interfaces. A middleware that is not installed is refused here: ROS would end the process on the
spot, with a line of its library. BLAS runs in one thread: the matrices here are small, and idle threads cost the other
nodes their core.
"""

import os
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.errors import MbpamError

MIDDLEWARE = "RMW_IMPLEMENTATION"

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"

PROFILES = {"Fast DDS 2": "FASTRTPS_DEFAULT_PROFILES_FILE", "Fast DDS 3": "FASTDDS_DEFAULT_PROFILES_FILE"}
"""Where Fast DDS looks for its profile."""


def keep_to_udp_on_loopback() -> None:
    """Take shared memory from Fast DDS, and bind it to loopback unless a range, middleware or profile is exported."""
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    local = os.environ.setdefault(RANGE, "LOCALHOST") == "LOCALHOST"
    fast_dds = os.environ.get(MIDDLEWARE, "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
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


class MiddlewareError(MbpamError, RuntimeError):
    """The middleware that was asked for is not installed; the message names what is."""


def require_middleware() -> None:
    """Refuse a middleware that no installation of ROS in sight has; where none can be seen, ROS itself decides.

    Raises:
        MiddlewareError: the one that ``RMW_IMPLEMENTATION`` names is not there.
    """
    wanted, found = os.environ.get(MIDDLEWARE), _installed_middleware()
    if wanted and found and wanted not in found:
        raise MiddlewareError(
            f"{MIDDLEWARE}={wanted}: this middleware is not installed, only {', '.join(sorted(found))}; unset the "
            "variable, or install it"
        )


def _installed_middleware() -> set[str]:
    """By the index of ament, in each prefix that is sourced and in this Python's own, where the wheels keep theirs."""
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    folders = [Path(prefix, "share/ament_index/resource_index/rmw_typesupport") for prefix in prefixes]
    return {path.name for folder in folders if folder.is_dir() for path in folder.iterdir()} - {"rmw_implementation"}


require_middleware()
keep_to_udp_on_loopback()
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
