"""The timer that ends a process whose interpreter is held by C code."""

import subprocess
import sys
import time

HELD = """
import ctypes
from mbpam_ros.nodes.exit_timer import exits_after
with exits_after(0.2, {code}):
    ctypes.PyDLL(None).sleep(30)  # PyDLL keeps the interpreter locked meanwhile
"""
DONE = """
import signal
from mbpam_ros.nodes.exit_timer import exits_after
with exits_after(0.2, 3):
    print("printed before")
with exits_after(0.4, 5):
    signal.pause()  # until the second timer; the first would have been sooner
"""


def run(program):
    began = time.monotonic()
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    return ended, time.monotonic() - began


def test_a_process_held_by_c_code_ends_with_the_given_code():
    for code in (0, 2):
        ended, elapsed_s = run(HELD.format(code=code))
        assert ended.returncode == code
        assert elapsed_s < 20.0


def test_a_block_that_ends_in_time_is_left_alone():
    ended, _ = run(DONE)
    assert ended.returncode == 5, ended.stderr
    assert ended.stdout == "printed before\n"
