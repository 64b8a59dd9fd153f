"""The arguments of every study: spread its independent runs over processes, or a Dask cluster, or say why not."""

from __future__ import annotations

import argparse
import os
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from typing import NoReturn

from mbpam_ros.study.executors import LOCAL_CLUSTER, open_executor


def add_workers(parser: argparse.ArgumentParser, default: int | None = None) -> None:
    """Add ``--workers`` and ``--dask``; the default is a worker for each core this process may use."""
    cores = default or len(os.sched_getaffinity(0))
    said = "one a core" if default is None else f"{default}"
    parser.add_argument("--workers", type=int, default=cores, metavar="N", help=f"processes (default: {said})")
    parser.add_argument(
        "--dask", metavar="ADDRESS", help=f"run on a Dask cluster: its scheduler's address, or {LOCAL_CLUSTER!r}"
    )


class _Refused(argparse.Action):
    """Says in one line why an argument is not taken: what it is called with."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        parser.error(f"{self.option_strings[0]}: {self.const}")


def refuse_workers(parser: argparse.ArgumentParser) -> None:
    """Refuse ``--workers`` and ``--dask`` with the reason, where processor time is what is measured."""
    why = "this verb measures time, so its runs follow each other at once, in one process, on this machine"
    for argument in ("--workers", "--dask"):
        parser.add_argument(argument, action=_Refused, const=why, metavar="X", help=f"refused: {why}")


def executor_for(options: argparse.Namespace, jobs: int) -> AbstractContextManager[Executor]:
    """Return what runs so many jobs, no more workers than those.

    Raises:
        ExecutorError: no worker, or no cluster.
    """
    return open_executor(min(options.workers, max(jobs, 1)), options.dask)
