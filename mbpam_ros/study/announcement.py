"""Say before a command works how long it is going to take, where that is longer than a person waits without asking."""

from __future__ import annotations

import sys
from typing import TextIO

PATIENCE_S = 5.0
"""What takes no longer than this is not announced."""


def announce(what: str, expected_s: float, stream: TextIO | None = None) -> bool:
    """Print that ``what`` takes about ``expected_s``, if more than :data:`PATIENCE_S`.

    Args:
        what: the work, in words.
        expected_s: wall time on one core of a present-day machine [s]; a guess, said as such.
        stream: where to write; by default the standard error of this moment.

    Returns:
        Whether it was said, so that progress is worth showing.
    """
    if not expected_s > PATIENCE_S:
        return False
    print(f"{what}: takes about {_duration(expected_s)}", file=stream or sys.stderr, flush=True)
    return True


def _duration(seconds: float) -> str:
    for unit, size, enough in (("s", 1.0, 100.0), ("min", 60.0, 100.0 * 60.0), ("h", 3600.0, float("inf"))):
        if seconds < enough:
            return f"{float(f'{seconds / size:.1g}' if seconds / size < 10.0 else f'{seconds / size:.2g}'):g} {unit}"
    raise ValueError(f"no duration: {seconds}")
