"""A stop signal at any moment while an executable is being loaded: it ends at once, without a word of Python's."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Sequence

import pytest

from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.start import EXECUTABLES

AT_ONCE_S = 10.0
"""Far above the second that it may take, for a busy machine, and far below what a node that goes on would."""

NODE = [sys.executable, "-m", "mbpam_ros.nodes"]
VERB = [sys.executable, "-m", "mbpam_ros.commands"]
MODULES = {"bringup": 1000, "object_detector": 600, "first-grasps": 900, "grasps": 600}
"""Each loads more than so many modules, after which it would be silent."""


def stopped_while_loading(command: Sequence[str], first: str, more: int, number: int) -> tuple[int, list[str]]:
    """Exit code, and what was said, of a process that got a signal ``more`` modules after ``first`` was loaded."""
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"},  # a line on stderr after each module
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while not process.stderr.readline().rstrip().endswith(first):
        assert process.poll() is None
    for _ in range(more):
        process.stderr.readline()
    process.send_signal(number)
    _, said = process.communicate(timeout=AT_ONCE_S)
    return process.returncode, [line for line in said.splitlines() if line and not line.startswith("import time:")]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("executable", ["bringup", "object_detector"])
@pytest.mark.parametrize("seed", range(2))
def test_a_node_that_is_being_loaded_ends_with_0_and_says_nothing(executable, number, seed):
    moment = random.Random(f"{executable} {number} {seed}").randrange(MODULES[executable])
    ended = stopped_while_loading([*NODE, executable], "mbpam_ros.nodes.start", moment, number)
    assert ended == (0, [])


@pytest.mark.parametrize("verb", ["first-grasps", "grasps"])
@pytest.mark.parametrize("seed", range(2))
def test_a_verb_that_is_being_loaded_ends_with_130_and_one_line(verb, seed):
    moment = random.Random(f"{verb} {seed}").randrange(MODULES[verb])
    code, said = stopped_while_loading([*VERB, verb], "mbpam_ros.commands.start", moment, signal.SIGINT)
    assert (code, len(said)) == (130, 1)
    assert said[0] in ("mbpam: interrupted", f"mbpam {verb}: interrupted")


def test_every_node_has_an_executable():
    assert EXECUTABLES == (*NODES, "bringup", "managed_valve_controller")


@pytest.mark.parametrize("given", [[], ["plan"]])
def test_what_is_no_executable_is_refused_in_one_line(given):
    ended = subprocess.run([*NODE, *given], capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ") and "plant, pressure_sensor" in ended.stderr
    assert ended.stderr.count("\n") == 1
