"""While a node is built: a stop signal ends it although C code runs, and what is compiled is announced once."""

import gc
import signal
import subprocess
import sys

import pytest
from numba import njit

from mbpam_ros.nodes.compiling import compilation_announced, garbage_collected_seldom

IN_C_CODE_FOR_A_MINUTE = """
import ctypes, signal
from mbpam_ros.nodes.compiling import STOP_SIGNALS, stop_signals_end_the_process

for number in STOP_SIGNALS:
    signal.signal(number, lambda *_: None)
with stop_signals_end_the_process(0.1, 7):
    print("building", flush=True)
    libc = ctypes.CDLL(None)
    while libc.sleep(60):  # which a signal cuts short
        pass
"""

BUILT_IN_TIME = """
import os, signal
from mbpam_ros.nodes.compiling import stop_signals_end_the_process

received = []
signal.signal(signal.SIGTERM, lambda number, _: received.append(number))
with stop_signals_end_the_process(30.0, 7):
    os.kill(os.getpid(), signal.SIGTERM)
assert received == [signal.SIGTERM] and signal.set_wakeup_fd(-1) == -1
"""


@pytest.mark.timeout(30)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_signal_ends_a_process_that_is_in_c_code(number):
    process = subprocess.Popen([sys.executable, "-c", IN_C_CODE_FOR_A_MINUTE], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "building\n"
    process.send_signal(number)
    assert process.wait() == 7


def test_a_block_that_ends_in_time_leaves_the_signal_to_its_own_handler():
    assert subprocess.run([sys.executable, "-c", BUILT_IN_TIME], check=False).returncode == 0


def test_what_is_compiled_is_announced_once_and_its_end_too():
    @njit
    def twice(value):
        return 2 * value

    said = []
    with compilation_announced(said.append):
        twice(1)
        twice(1.0)
    assert [line.split()[0] for line in said] == ["compiling", "compiled"]


def test_nothing_is_said_where_nothing_is_compiled():
    @njit
    def thrice(value):
        return 3 * value

    thrice(1)
    said = []
    with compilation_announced(said.append):
        thrice(2)
    assert said == []


def test_garbage_is_collected_as_before_once_all_is_compiled():
    before = gc.get_threshold()
    with pytest.raises(ZeroDivisionError), garbage_collected_seldom():
        assert gc.get_threshold()[0] > before[0]
        raise ZeroDivisionError
    assert gc.get_threshold() == before
