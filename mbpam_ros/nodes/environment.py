"""Middleware settings that must stand before the first ROS context: import this module first.

All are defaults; what the user exported wins. Discovery stays on this machine; Fast DDS gets a shared-memory segment
that a raw 640 x 480 image fits into (its own 512 KiB loses most of them); and BLAS runs in one thread, because the
matrices here are small and idle threads cost the other nodes their core.
"""

import os
from contextlib import suppress

from mbpam_ros.configuration import ConfigError, config_path

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
with suppress(ConfigError):  # without it nodes run all the same, or say themselves what they miss
    os.environ.setdefault("FASTDDS_DEFAULT_PROFILES_FILE", str(config_path("fastdds_profile.xml")))
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
