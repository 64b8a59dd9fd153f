"""Run independent jobs through any executor, keep what is finished in a JSON file, and go on from it next time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path
from typing import TypeVar

from mbpam_ros.study.result_file import ResultFileError, write_json
from mbpam_ros.terminal import Progress, announce

REDRAW_S = 1.0

Result = TypeVar("Result")


class ResultFile:
    """Rows of finished jobs in a JSON file ``{"settings": ..., key: [row, ...], ...}``.

    Args:
        path: the file; its folder must exist. None keeps the rows in memory alone.
        settings: what all rows depend on. Rows made with other settings are not taken over.
        key: name of the list of rows.
        name_of: the name of the job that made a row.

    Raises:
        ResultFileError: ``path`` exists and is no such file, or its folder does not exist.
    """

    def __init__(self, path: Path | None, settings: dict, key: str, name_of: Callable[[dict], str]) -> None:
        self.path = path
        self.rows: dict[str, dict] = {}
        self._settings, self._key = settings, key
        self.other_settings = False
        if path is None:
            return
        if not path.absolute().parent.is_dir():
            raise ResultFileError(f"{path}: there is no folder {path.absolute().parent}")
        if not path.exists():
            return
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            rows = {name_of(row): row for row in found[key]}
            self.other_settings = found["settings"] != settings
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ResultFileError(f"{path} exists and is no such result of this command; give another file") from error
        if not self.other_settings:
            self.rows = rows

    def write(self, order: list[str], **more: object) -> dict:
        """Write the rows in this order with ``more`` before them; return the content."""
        rows = [self.rows[name] for name in order if name in self.rows]
        content = {"settings": self._settings, **more, self._key: rows}
        if self.path is not None:
            write_json(self.path, content)
        return content


def runs_beside(result: Path | None) -> Path | None:
    """Return where the finished runs of a result are kept that is made of all of them.

    Args:
        result: its file; None if it goes to none, and then neither do the runs.
    """
    return None if result is None else result.with_name(f"{result.stem}_runs.json")


def run_jobs(
    jobs: Mapping[str, tuple],
    work: Callable[..., dict],
    results: ResultFile,
    executor: Executor,
    progress: Progress,
    describe: Callable[[dict], str],
    *,
    failing: tuple[type[Exception], ...] = (),
    s_per_job: float = 0.0,
) -> dict[str, str]:
    """Run ``work(*arguments)`` for each job without a row in ``results``, writing the file after each.

    An interrupt (KeyboardInterrupt) passes on; the file holds what has ended.

    Args:
        jobs: arguments by name, plain values.
        work: a function of a module, so that it can be sent to another process or machine; its dict is the job's row.
        executor: any executor whose ``submit`` returns futures of ``concurrent.futures``
            (:mod:`~mbpam_ros.study.executors`).
        describe: the line that tells of a finished row.
        failing: errors that end a job without a row, and not the others.
        s_per_job: CPU of a job [s], a guess; what is expected to take long is announced.

    Returns:
        Reasons of the jobs that failed, by name.
    """
    order = list(jobs)
    if results.other_settings:
        progress.say(f"{results.path} was made with other settings or versions: all jobs are run anew")
    missing = {name: jobs[name] for name in order if name not in results.rows}
    jobs_text = f"{len(missing)} job{'' if len(missing) == 1 else 's'}"
    announce(f"{jobs_text} on one core (the workers share them)", s_per_job * len(missing), progress.stream)
    progress.start(len(order), len(order) - len(missing))
    failures: dict[str, str] = {}
    for name, future in as_they_end(missing, work, executor, progress):
        try:
            results.rows[name] = future.result()
        except failing as error:
            failures[name] = str(error)
            progress.job_ended(f"{name}: {error}")
            continue
        results.write(order)
        progress.job_ended(describe(results.rows[name]))
    return failures


def as_they_end(
    jobs: Mapping[str, tuple], work: Callable[..., Result], executor: Executor, progress: Progress
) -> Iterator[tuple[str, Future[Result]]]:
    """Yield the name and the ended future of each job.

    After an interrupt the others are left to whoever opened the executor, as
    :func:`~mbpam_ros.study.executors.open_executor` throws them away. (To cancel them one by one here would meet the
    pool in the middle of doing so.)

    Args:
        jobs: arguments by name.
        work: as for :func:`run_jobs`.
        executor: likewise.
        progress: is refreshed while one waits.
    """
    names: dict[Future[Result], str] = {}
    for name, arguments in jobs.items():
        future = executor.submit(work, *arguments)
        if future.done():
            yield name, future
        else:
            names[future] = name
    waiting = set(names)
    while waiting:
        done, waiting = wait(waiting, REDRAW_S, FIRST_COMPLETED)
        progress.refresh()
        for future in done:
            yield names[future], future
