"""Middleware settings that must stand before the first ROS context: import this module first.

Both are defaults; what the user exported wins. Discovery stays on this machine, and Fast DDS gets a shared-memory
segment that a raw 640 x 480 image fits into (its own 512 KiB loses most of them).
"""

import os

from mbpam_ros.configuration import config_directory

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("FASTDDS_DEFAULT_PROFILES_FILE", str(config_directory() / "fastdds_profile.xml"))
