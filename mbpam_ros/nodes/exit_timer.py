"""End the process in time even while C code that does not return holds the interpreter."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_CLOCK_MONOTONIC = 1
_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of 64-bit Linux: call ``function(value)`` in a thread of its own."""

    _fields_ = [
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("padding", ctypes.c_char * 32),
    ]


class _Times(ctypes.Structure):
    """``struct itimerspec``."""

    _fields_ = [(name, ctypes.c_long) for name in ("interval_s", "interval_ns", "value_s", "value_ns")]


@contextmanager
def exits_after(timeout_s: float, code: int) -> Iterator[None]:
    """End the process with ``code`` if the block lasts longer than ``timeout_s``.

    The timer is the C library's and calls its ``_exit``: no Python code could run while a C function holds the
    interpreter. Does nothing where there is no such timer (other systems than Linux).
    """
    library = _library()
    if library is None:
        yield
        return
    sys.stdout.flush()
    sys.stderr.flush()
    ends_process = ctypes.cast(library._exit, ctypes.c_void_p).value
    event = _Event(value=code, notify=_SIGEV_THREAD, function=ends_process)
    timer = ctypes.c_void_p()
    armed = library.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0
    if armed:
        seconds = int(timeout_s)
        times = _Times(value_s=seconds, value_ns=round(1e9 * (timeout_s - seconds)))
        library.timer_settime(timer, 0, ctypes.byref(times), None)
    try:
        yield
    finally:
        if armed:
            library.timer_delete(timer)


def _library() -> ctypes.CDLL | None:
    """Return the C library, if its timers are the ones declared here."""
    if not sys.platform.startswith("linux") or ctypes.sizeof(ctypes.c_void_p) != 8:
        return None
    for name in (None, "librt.so.1"):  # glibc before 2.34 keeps the timers apart
        try:
            library = ctypes.CDLL(name)
            if hasattr(library, "timer_create"):
                return library
        except OSError:
            continue
    return None
