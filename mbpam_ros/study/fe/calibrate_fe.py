"""Command ``calibrate_fe``: where it begins and how it ends (see :mod:`~mbpam_ros.study.fe.commands`)."""

from __future__ import annotations

import sys
from collections.abc import Sequence

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status: 0, 1 if something has no result, 2 for bad usage, 130 if interrupted."""
    try:
        from mbpam_ros.study.fe.commands import run_command  # takes a second, and FElupe may be missing

        return run_command(arguments)
    except KeyboardInterrupt:
        print(
            "\ncalibrate_fe: interrupted; what is finished is kept, the same command goes on from it", file=sys.stderr
        )
        return INTERRUPTED
    except ModuleNotFoundError as error:
        if error.name != "felupe":
            raise
        print(f"calibrate_fe: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    raise SystemExit(main())
