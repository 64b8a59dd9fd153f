import io
import json
import math
import time

import psutil
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.executors import ExecutorError, open_executor
from mbpam_ros.study.fe.design_run import MESHES, NO_EQUILIBRIUM, Run
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.paper_comparison import curve_row
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress


def test_an_interrupt_does_not_wait_for_the_jobs_that_have_begun():
    # As the operating system sees them: multiprocessing's own list keeps a child that somebody else has waited for.
    others = set(psutil.Process().children())
    begun_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt), open_executor(2) as executor:
        executor.submit(time.sleep, 60.0)
        workers = set(psutil.Process().children()) - others
        assert workers
        raise KeyboardInterrupt
    assert time.monotonic() - begun_s < 20.0
    _, alive = psutil.wait_procs(workers, timeout=5.0)
    assert not [worker for worker in alive if worker.status() != psutil.STATUS_ZOMBIE]


def test_the_runs_go_over_a_dask_cluster(tmp_path):
    """Plain values go out, rows and typed errors come back, from another process over loopback."""
    pytest.importorskip("distributed")
    stiff = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc", MESHES["coarse"])
    path = tmp_path / "x.json"
    results = ResultFile(path, {}, "curves", lambda row: row["pattern"])
    jobs = {"psc": (stiff, (0.0, 10.0)), "no load": (stiff, (math.nan,))}  # what is not a number has no equilibrium
    with open_executor(1, "local") as executor:
        failures = run_jobs(jobs, curve_row, results, executor, Progress(io.StringIO()), str, failing=NO_EQUILIBRIUM)
    (row,) = json.loads(path.read_text())["curves"]
    assert row["theta_deg"] == pytest.approx(curve_row(stiff, (0.0, 10.0))["theta_deg"], abs=1e-6)
    assert "free bend stopped at" in failures["no load"]


def test_a_scheduler_that_does_not_answer_is_said(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("mbpam_ros.study.executors._CONNECT_S", 0.2)
    with pytest.raises(ExecutorError, match="tcp://127.0.0.1:1"), open_executor(1, "tcp://127.0.0.1:1"):
        pass
