"""What a person sees while a command runs: a live line on a terminal, plain lines elsewhere, and tables."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence

REDRAW_S = 0.1
HEARTBEAT_S = 3.0


class LiveLine:
    """One line that is redrawn in place on a terminal; where output goes to a file, it is printed every 3 s."""

    def __init__(self) -> None:
        self._terminal = sys.stdout.isatty()
        self._shown_at_s = -HEARTBEAT_S

    def show(self, text: str) -> None:
        """Show ``text`` as the present state."""
        now_s = time.monotonic()
        if now_s - self._shown_at_s < (REDRAW_S if self._terminal else HEARTBEAT_S):
            return
        self._shown_at_s = now_s
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            sys.stdout.write("\r\x1b[K" + text[:width])
        else:
            sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def say(self, text: str) -> None:
        """Print ``text`` as a line that stays."""
        sys.stdout.write(("\r\x1b[K" if self._terminal else "") + text + "\n")
        sys.stdout.flush()


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows under their heads, in columns as wide as their widest cell."""
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in lines)
