"""``python -m mbpam_ros.commands`` is ``mbpam``."""

import sys

from mbpam_ros.commands.start import mbpam

if __name__ == "__main__":
    sys.exit(mbpam())
