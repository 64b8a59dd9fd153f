"""What a person sees while a command works: lines that stay, one that is redrawn, how long it takes, and tables."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence
from typing import TextIO

BAR_WIDTH = 24
REDRAW_S = 0.1
HEARTBEAT_S = 3.0

PATIENCE_S = 5.0
"""What takes no longer than this is not announced."""

_CLEAR = "\r\x1b[K"


class Progress:
    """Lines that stay and, on a terminal, one below them that is redrawn in place: a bar of jobs, or what happens now.

    Where output goes to a file, each finished job is a line, and of what happens now there is one every 3 s.

    Args:
        stream: where to write; by default the standard output of this moment.
        silent: whether to write nothing at all, for what is done before a person asks.
    """

    def __init__(self, stream: TextIO | None = None, silent: bool = False) -> None:
        self.stream = stream or sys.stdout
        self._silent = silent
        self._terminal = self.stream.isatty()
        self._total = self._done = self._done_before = 0
        self._started_s = time.monotonic()
        self._shown_at_s = -HEARTBEAT_S

    def start(self, total: int, done: int = 0) -> None:
        """Begin to count ``total`` jobs, ``done`` of which an earlier run has finished."""
        self._total, self._done, self._done_before = total, done, done
        self._started_s = time.monotonic()
        self.refresh()

    def job_ended(self, text: str) -> None:
        """Count one more job and keep ``text`` as a line that stays."""
        self._done += 1
        self.say(f"[{self._done}/{self._total}] {text}")
        self.refresh()

    def refresh(self) -> None:
        """Redraw the bar, so that the time it shows goes on."""
        if self._terminal and not self._silent and self._done < self._total:
            self._draw(self._bar())

    def show(self, text: str) -> None:
        """Show ``text`` as what happens now."""
        now_s = time.monotonic()
        if self._silent or now_s - self._shown_at_s < (REDRAW_S if self._terminal else HEARTBEAT_S):
            return
        self._shown_at_s = now_s
        if self._terminal:
            self._draw(text)
        else:
            self.say(text)

    def say(self, text: str) -> None:
        """Print ``text`` as a line that stays."""
        if self._silent:
            return
        self.stream.write((_CLEAR if self._terminal else "") + text + "\n")
        self.stream.flush()

    def _draw(self, text: str) -> None:
        self.stream.write(_CLEAR + text[: shutil.get_terminal_size().columns - 1])
        self.stream.flush()

    def _bar(self) -> str:
        filled = BAR_WIDTH * self._done // self._total
        passed_s = time.monotonic() - self._started_s
        here = self._done - self._done_before
        left = f", {_clock((self._total - self._done) * passed_s / here)} left" if here else ""
        return f"[{'#' * filled}{'.' * (BAR_WIDTH - filled)}] {self._done}/{self._total}  {_clock(passed_s)}{left}"


def announce(what: str, expected_s: float, stream: TextIO | None = None) -> bool:
    """Print that ``what`` takes about ``expected_s``, if that is more than :data:`PATIENCE_S`.

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


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return rows under their heads, in columns as wide as their widest cell."""
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in lines)
    return "\n".join("  ".join(row).rstrip() for row in padded)


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def _duration(seconds: float) -> str:
    for unit, size, enough in (("s", 1.0, 100.0), ("min", 60.0, 100.0 * 60.0), ("h", 3600.0, float("inf"))):
        if seconds < enough:
            return f"{float(f'{seconds / size:.1g}' if seconds / size < 10.0 else f'{seconds / size:.2g}'):g} {unit}"
    raise ValueError(f"no duration: {seconds}")
