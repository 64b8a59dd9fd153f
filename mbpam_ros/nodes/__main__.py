"""``python -m mbpam_ros.nodes plant ...`` is ``mbpam_plant ...``, and so are the other executables."""

import sys

from mbpam_ros.nodes.start import EXECUTABLES, start

if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in EXECUTABLES:
        del sys.argv[0]
        sys.exit(start(sys.argv[0]))
    print(f"error: python -m mbpam_ros.nodes wants one of {', '.join(EXECUTABLES)}", file=sys.stderr)
    sys.exit(2)
