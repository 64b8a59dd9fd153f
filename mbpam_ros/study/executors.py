"""Where the jobs of a study run: in this process, in others of this machine, or on a Dask cluster of many.

Any executor whose ``submit`` returns futures of ``concurrent.futures`` will do. Dask's own futures are not of that
kind, but those of ``Client.get_executor()`` are.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from mbpam_ros.errors import MbpamError

LOCAL_CLUSTER = "local"
_CONNECT_S = 10.0
_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
"""The jobs share the cores among themselves; a solver that also did would only make them wait for each other."""


class ExecutorError(MbpamError, RuntimeError):
    """There is nothing to run the jobs with."""


@contextmanager
def open_executor(workers: int, dask: str | None = None) -> Iterator[Executor]:
    """Yield an executor; at its end wait for the jobs, after an error or an interrupt throw them away at once.

    Args:
        workers: number of processes on this machine; 1 is this one, without another.
        dask: address of a running Dask scheduler, or ``local`` for a Dask cluster of ``workers`` processes on this
            machine's loopback; None for plain processes.

    Raises:
        ExecutorError: no worker, Dask is not installed, no scheduler answers at the address, or a worker died.
    """
    if workers < 1:
        raise ExecutorError(f"there must be at least 1 worker, found {workers}")
    os.environ.update({name: os.environ.get(name, value) for name, value in _ONE_THREAD.items()})
    try:
        if dask is not None:
            yield from _dask(workers, dask)
        elif workers == 1:
            yield ThisProcess()
        else:
            yield from _processes(workers)
    except BrokenExecutor as error:
        raise ExecutorError(f"a worker died (out of memory?); give fewer of them: {error}") from error


Result = TypeVar("Result")


class ThisProcess(Executor):
    """Runs each job where and when it is submitted: its future has ended."""

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        future: Future[Result] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # as another process would hand it over
            future.set_exception(error)
        return future


def _processes(workers: int) -> Iterator[Executor]:
    before = set(multiprocessing.active_children())
    executor = ProcessPoolExecutor(workers)
    try:
        with _interrupts_held_back():
            executor.submit(int).result()  # starts all of them
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        # Not by SIGTERM: a worker may have inherited a handler that keeps it.
        for process in set(multiprocessing.active_children()) - before:
            process.kill()  # else the command would wait for the jobs that have begun
        raise
    executor.shutdown()


def _dask(workers: int, address: str) -> Iterator[Executor]:
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError as error:
        raise ExecutorError("Dask is not installed: pip install 'mbpam_ros[cluster]'") from error
    cluster = None
    try:
        if address == LOCAL_CLUSTER:
            with _interrupts_held_back():
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
def _interrupts_held_back() -> Iterator[None]:
    """Start processes that never see Ctrl-C, which reaches all of a terminal: only the parent is to answer it.

    It does so at the end of the block. Half-started, a pool would not come to an end.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # threads and processes inherit it
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
