"""What a person sees while jobs run: a bar that is redrawn in place on a terminal, plain lines elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from typing import TextIO

BAR_WIDTH = 24


class ProgressBar:
    """Counts finished jobs. Where output goes to a file, each finished job is a line and the bar is not drawn.

    Args:
        stream: where to write; by default the standard output of this moment.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._terminal = self._stream.isatty()
        self._total = self._done = self._done_before = 0
        self._started_s = time.monotonic()

    def start(self, total: int, done: int) -> None:
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
        if self._terminal and self._done < self._total:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write("\r\x1b[K" + self._bar()[:width])
            self._stream.flush()

    def say(self, text: str) -> None:
        """Print ``text`` as a line that stays."""
        self._stream.write(("\r\x1b[K" if self._terminal else "") + text + "\n")
        self._stream.flush()

    def _bar(self) -> str:
        filled = BAR_WIDTH * self._done // self._total
        passed_s = time.monotonic() - self._started_s
        here = self._done - self._done_before
        left = f", {_clock((self._total - self._done) * passed_s / here)} left" if here else ""
        return f"[{'#' * filled}{'.' * (BAR_WIDTH - filled)}] {self._done}/{self._total}  {_clock(passed_s)}{left}"


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
