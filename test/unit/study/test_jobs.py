import io
import json
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.jobs import ResultFile, ResultFileError, run_jobs
from mbpam_ros.terminal import Progress

JOBS = {name: (name, number) for number, name in enumerate("abcd")}


def square(name, number):
    if name == "c":
        raise LoadStepError("stopped at 12 kPa", 12.0)
    return {"job": name, "square": number**2}


def results(path):
    return ResultFile(path, {"mesh": "fine"}, "rows", lambda row: row["job"])


def run(work, path, executor, progress):
    return run_jobs(JOBS, work, results(path), executor, progress, lambda row: row["job"], failing=(LoadStepError,))


def test_rows_are_kept_in_order_and_jobs_without_equilibrium_are_named(tmp_path):
    path, said = tmp_path / "x.json", io.StringIO()
    with ThreadPoolExecutor(2) as executor:
        failures = run_jobs(
            JOBS, square, results(path), executor, Progress(said), lambda row: row["job"], failing=(LoadStepError,)
        )
    assert failures == {"c": "stopped at 12 kPa"}
    stored = json.loads(path.read_text())
    assert stored["settings"] == {"mesh": "fine"}
    assert [row["square"] for row in stored["rows"]] == [0, 1, 9]
    assert "c: stopped at 12 kPa" in said.getvalue()


class InterruptedBar(Progress):
    def job_ended(self, text):
        raise KeyboardInterrupt


def test_an_interrupt_keeps_the_finished_rows_and_the_next_call_runs_the_others(tmp_path):
    path, called = tmp_path / "x.json", []

    def counted(name, number):
        called.append(name)
        return square(name, number)

    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(KeyboardInterrupt):
            run_jobs(
                JOBS, counted, results(path), executor, InterruptedBar(io.StringIO()), str, failing=(LoadStepError,)
            )
    kept = [row["job"] for row in json.loads(path.read_text())["rows"]]
    assert kept and set(kept) < set(JOBS)
    called.clear()
    with ThreadPoolExecutor(1) as executor:
        run(counted, path, executor, Progress(io.StringIO()))
    assert set(called) == set(JOBS) - set(kept)


def test_an_unforeseen_error_is_not_swallowed(tmp_path):
    def broken(name, number):
        raise ZeroDivisionError

    with ThreadPoolExecutor(1) as executor, pytest.raises(ZeroDivisionError):
        run_jobs(JOBS, broken, results(tmp_path / "x.json"), executor, Progress(io.StringIO()), str)


@pytest.mark.parametrize("content", ["no JSON", "[]", '{"settings": {}}', '{"settings": {}, "rows": [{}]}'])
def test_a_file_of_something_else_is_refused(tmp_path, content):
    (tmp_path / "x.json").write_text(content)
    with pytest.raises(ResultFileError, match="give another file"):
        results(tmp_path / "x.json")


def test_a_missing_folder_is_said_before_anything_runs(tmp_path):
    with pytest.raises(ResultFileError, match="there is no folder"):
        results(tmp_path / "none" / "x.json")
