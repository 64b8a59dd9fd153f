"""Ctrl-C while a verb is being loaded.

An interrupt in the middle of an import is an exception anywhere in other people's modules, and may be lost there.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130


@contextmanager
def interrupt_ends_it(program: str) -> Iterator[None]:
    """Have Ctrl-C end the process with a line and :data:`INTERRUPTED`, where it would raise KeyboardInterrupt."""

    def end(*_: object) -> None:
        os.write(2, f"\n{program}: interrupted\n".encode())
        os._exit(INTERRUPTED)

    raises = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if raises:
        signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        if raises:
            signal.signal(signal.SIGINT, signal.default_int_handler)
