"""Settings of all tests."""

import os

# Before numpy is first imported: OpenBLAS's threads wait for one another in a busy loop. Beside another process at full
# load that makes kriging's small matrices ten to seventy times slower, and two workers of xdist are such processes.
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from contextlib import suppress

import pytest
from hypothesis import settings

# The same examples in every run, so that a change is judged by what it changes; no deadline on a machine others use.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")

OWN_PRIORITY = os.getpriority(os.PRIO_PROCESS, 0)
GIVES_WAY = 10


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let what computes give way to the node processes of another worker, whose clock is the wall's.

    Not everybody may take it back; then a worker that has given way once goes on so.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        groups = {mark.args[0] if mark.args else mark.kwargs["name"] for mark in item.iter_markers("xdist_group")}
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, OWN_PRIORITY + GIVES_WAY * ("real_clock" not in groups))
