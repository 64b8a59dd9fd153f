"""Run independent jobs through any executor, keep what is finished in a JSON file, and go on from it next time."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path

from mbpam_ros.study.announcement import announce
from mbpam_ros.study.fe.design_run import NO_EQUILIBRIUM
from mbpam_ros.study.progress_bar import ProgressBar
from mbpam_ros.study.result_file import ResultFileError, write_json

REDRAW_S = 1.0

S_PER_JOB = 20.0
"""CPU of a bend curve with the default mesh; 20-node elements take several times as long."""


class ResultFile:
    """Rows of finished jobs in a JSON file ``{"settings": ..., key: [row, ...], ...}``.

    Args:
        path: the file; its folder must exist.
        settings: what all rows depend on. Rows made with other settings are not taken over.
        key: name of the list of rows.
        name_of: the name of the job that made a row.

    Raises:
        ResultFileError: ``path`` exists and is no such file, or its folder does not exist.
    """

    def __init__(self, path: Path, settings: dict, key: str, name_of: Callable[[dict], str]) -> None:
        self.path = path
        self.rows: dict[str, dict] = {}
        self._settings, self._key = settings, key
        self.other_settings = False
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
        write_json(self.path, content)
        return content


def run_jobs(
    jobs: Mapping[str, tuple],
    work: Callable[..., dict],
    results: ResultFile,
    executor: Executor,
    progress: ProgressBar,
    describe: Callable[[dict], str],
) -> dict[str, str]:
    """Run ``work(*arguments)`` for each job without a row in ``results``, writing the file after each.

    An interrupt (KeyboardInterrupt) takes back the jobs that have not begun and passes on; the file holds the rest.

    Args:
        jobs: arguments by name, plain values.
        work: a function of a module, so that it can be sent to another process or machine; its dict is the job's row.
        executor: any executor whose ``submit`` returns futures of ``concurrent.futures``: processes, threads, or a
            Dask cluster's ``Client.get_executor()``. (The futures of Dask's own ``Client.submit`` are of another kind.)
        describe: the line that tells of a finished row.

    Returns:
        Reasons of the jobs that found no equilibrium, by name.
    """
    order = list(jobs)
    if results.other_settings:
        progress.say(f"{results.path} was made with other settings or versions: all jobs are run anew")
    missing = [name for name in order if name not in results.rows]
    announce(f"{len(missing)} jobs on one core (the workers share them)", S_PER_JOB * len(missing), sys.stdout)
    progress.start(len(order), len(order) - len(missing))
    failures: dict[str, str] = {}
    futures: dict[Future, str] = {}
    try:
        for name in missing:
            futures[executor.submit(work, *jobs[name])] = name
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, REDRAW_S, FIRST_COMPLETED)
            progress.refresh()
            for future in done:
                name = futures[future]
                try:
                    results.rows[name] = future.result()
                except NO_EQUILIBRIUM as error:
                    failures[name] = str(error)
                    progress.job_ended(f"{name}: {error}")
                    continue
                results.write(order)
                progress.job_ended(describe(results.rows[name]))
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return failures
