"""``python -m mbpam_ros.commands`` is ``mbpam``."""

import sys

from mbpam_ros.commands.mbpam import main

if __name__ == "__main__":
    sys.exit(main())
