"""While a node is built its kernels may have to be compiled: it says so, and a stop signal still ends it."""

from __future__ import annotations

import gc
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


SELDOM = (20_000, 20, 20)
"""Thresholds of Python's garbage collector while kernels are compiled: the compiler makes millions of objects that stay
for a while, and to look through them every 700 took a twelfth of its time. Without a collector it took 1.6 times as
much memory, so 1.1 times."""


@contextmanager
def garbage_collected_seldom() -> Iterator[None]:
    """Leave more garbage about while the block compiles."""
    before = gc.get_threshold()
    gc.set_threshold(*SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def compilation_announced(say: Callable[[str], None]) -> Iterator[None]:
    """Have ``say`` called with a line when the first kernel of the block begins to be compiled, and at the end.

    What is found in the cache on disk is not compiled, and nothing is said.
    """
    if "numba" not in sys.modules:  # nothing that was imported has kernels
        yield
        return
    from numba.core import event

    class FirstOne(event.Listener):
        began_at_s: float | None = None

        def on_start(self, _: event.Event) -> None:
            if self.began_at_s is None:
                self.began_at_s = time.monotonic()
                say(
                    "compiling the kernels of this installation, which takes up to a minute, once; "
                    "'mbpam compile' does it ahead"
                )

        def on_end(self, _: event.Event) -> None:
            pass

    listener = FirstOne()
    with garbage_collected_seldom(), event.install_listener("numba:compile", listener):
        yield
    if listener.began_at_s is not None:
        say(f"compiled in {time.monotonic() - listener.began_at_s:.0f} s")


@contextmanager
def stop_signals_end_the_process(grace_s: float, code: int) -> Iterator[None]:
    """End the process with ``code`` if a stop signal comes in the block and the block lasts ``grace_s`` longer.

    Python calls a signal's handler between two of its own instructions, and a call of the compiler takes seconds. What
    C writes to a socket when the signal comes is read here by a thread.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    left = threading.Event()

    def watch() -> None:
        for number in iter(lambda: reader.recv(1), b""):
            if number[0] in STOP_SIGNALS and not left.wait(grace_s):
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)

    watcher = threading.Thread(target=watch, daemon=True)
    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    watcher.start()
    try:
        yield
    finally:
        left.set()
        signal.set_wakeup_fd(before)
        writer.close()
        watcher.join()
        reader.close()
