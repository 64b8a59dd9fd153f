"""Where the jobs run: processes of this machine, or a Dask cluster of many.

Any executor whose ``submit`` returns futures of ``concurrent.futures`` will do. Dask's own futures are not of that
kind, but those of ``Client.get_executor()`` are.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from mbpam_ros.errors import MbpamError

LOCAL_CLUSTER = "local"
_CONNECT_S = 10.0
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""The jobs share the cores among themselves; a solver that also did would only make them wait for each other."""


class ExecutorError(MbpamError, RuntimeError):
    """There is nothing to run the jobs with."""


@contextmanager
def open_executor(workers: int, dask: str | None = None) -> Iterator[Executor]:
    """Yield an executor; at its end wait for the jobs, after an error or an interrupt throw them away at once.

    Args:
        workers: number of processes on this machine.
        dask: address of a running Dask scheduler, or ``local`` for a Dask cluster of ``workers`` processes on this
            machine's loopback; None for plain processes.

    Raises:
        ExecutorError: Dask is not installed, or no scheduler answers at the address.
    """
    os.environ.update({name: os.environ.get(name, value) for name, value in _ONE_THREAD.items()})
    if dask is None:
        yield from _processes(workers)
    else:
        yield from _dask(workers, dask)


def _processes(workers: int) -> Iterator[Executor]:
    before = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(workers, initializer=_leave_interrupts_to_the_parent)
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        # Not by SIGTERM: a worker may have inherited a handler that keeps it.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()  # else the command would wait for the jobs that have begun
        raise
    executor.shutdown()


def _leave_interrupts_to_the_parent() -> None:
    """Ctrl-C reaches all processes of a terminal; only the parent is to answer it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _dask(workers: int, address: str) -> Iterator[Executor]:
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError as error:
        raise ExecutorError("Dask is not installed: pip install 'mbpam_ros[cluster]'") from error
    cluster = None
    try:
        if address == LOCAL_CLUSTER:
            with _interrupts_ignored():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",  # None would take Dask's fixed port, dashboard or not
                    scheduler_kwargs={"dashboard": False},
                    silence_logs=logging.CRITICAL,
                )
        client = Client(cluster or address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:  # a TimeoutError is an OSError
        raise ExecutorError(f"no Dask scheduler answers at {address}: {error}") from error
    try:
        with client, client.get_executor() as executor:
            try:
                yield executor
            except BaseException:
                executor.shutdown(wait=False)
                raise
    finally:
        if cluster is not None:
            cluster.close()


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Start processes that inherit this, and leave Ctrl-C to the parent as :func:`_leave_interrupts_to_the_parent`."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers, and only it is interrupted
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
