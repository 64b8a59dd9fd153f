"""The arguments of every verb that has independent runs to spread: over processes, or a Dask cluster."""

from __future__ import annotations

import argparse
import os
from concurrent.futures import Executor
from contextlib import AbstractContextManager

from mbpam_ros.study.executors import LOCAL_CLUSTER, open_executor


def add_workers(parser: argparse.ArgumentParser, default: int | None = None) -> None:
    """Add ``--workers`` and ``--dask``; the default is a worker for each core this process may use."""
    cores = default or len(os.sched_getaffinity(0))
    said = "one a core" if default is None else f"{default}"
    parser.add_argument("--workers", type=int, default=cores, metavar="N", help=f"processes (default: {said})")
    parser.add_argument(
        "--dask", metavar="ADDRESS", help=f"run on a Dask cluster: its scheduler's address, or {LOCAL_CLUSTER!r}"
    )


def executor_for(options: argparse.Namespace, jobs: int) -> AbstractContextManager[Executor]:
    """Return what runs so many jobs, no more workers than those.

    Raises:
        ExecutorError: no worker, or no cluster.
    """
    return open_executor(min(options.workers, max(jobs, 1)), options.dask)
