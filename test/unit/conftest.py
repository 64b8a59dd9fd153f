"""What unit tests of commands share."""

import signal
import subprocess
from collections.abc import Callable, Sequence

import pytest


@pytest.fixture
def start_as_from_a_terminal() -> Callable[[Sequence[str]], subprocess.Popen[str]]:
    """Starts a command that Ctrl-C reaches, in a process group of its own with its workers."""

    def start(command: Sequence[str]) -> subprocess.Popen[str]:
        return subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # It is ignored where the tests run in a background.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    return start
