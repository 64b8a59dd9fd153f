import argparse
import json
import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip("felupe")

from mbpam_ros.commands.fe import curve, paper
from mbpam_ros.commands.fe.model import run_of
from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.fe.design_run import MESHES, Run, settings
from mbpam_ros.study.fe.mesh import CONVERGED, FAST, CellGeometry
from mbpam_ros.study.fe.solve import LoadStepError

COMMAND = [sys.executable, "-u", "-m", "mbpam_ros.commands", "fe"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["curve", "9,2,2,14", "--json", "x"],
        ["curve", "2.5,nan,2.1,14", "--json", "x"],
        ["paper", "--points", "table_9:1", "--json", "x"],
        ["paper", "--workers", "0", "--json", "x"],
        ["paper", "--end-length", "-1", "--json", "x"],
        ["paper", "--wave-fillet", "3", "--json", "x"],
        ["paper", "--corner-fillet", "-1", "--json", "x"],
    ],
)
def test_what_cannot_be_run_is_said_in_one_line(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["fe", *arguments]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"mbpam fe {arguments[0]}: ") and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "VERB"),
        (["paper"], "--json"),
        (["curve", "--json", "x"], "A,B,C,N"),
        (["curve", "2.5,2.0", "--json", "x"], "'2.5,2.0'"),
        (["curve", "2.5,2.0,thick,14", "--json", "x"], "thick"),
        (["curve", "2.5,2,2.1,14", "--pattern", "all", "--json", "x"], "'all'"),
        (["curve", "2.5,2,2.1,14", "--wall", "2", "--json", "x"], "--wall"),
        (["curve", "2.5,2,2.1,14", "--json", "/nowhere/x"], "no folder /nowhere"),
        (["curve", "2.5,2,2.1,14", "--json", "."], "is a folder"),
        (["law", "x", "--json", "y"], "x"),
        (["law", "--fast", "--mesh", "coarse", "--json", "y"], "--mesh"),
    ],
)
def test_arguments_that_mean_nothing_are_refused_in_one_line(arguments, named, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["fe", *arguments])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert named in said and said.count("\n") == 1


def test_a_design_without_equilibrium_fails_and_leaves_no_file(monkeypatch, tmp_path, capsys):
    def stopped(run, pressures_kpa):
        raise LoadStepError("free bend stopped at 42.00 kPa", 42.0)

    monkeypatch.setattr(curve, "bend_curve", stopped)
    assert main(["fe", "curve", "2.5,2,2.1,14", "--json", str(tmp_path / "x.json")]) == 1
    assert capsys.readouterr().err == "mbpam fe curve: free bend stopped at 42.00 kPa\n"
    assert not list(tmp_path.iterdir())


def test_a_design_gives_its_curve_and_nothing_else(monkeypatch, tmp_path, capsys):
    """The real one, on a mesh that is quick; only the pressures are fewer."""
    monkeypatch.setattr(curve, "CURVE_KPA", (0.0, 20.0))
    path = tmp_path / "x.json"
    assert main(["fe", "curve", "1.5,2,3,14", "--pattern", "psc", "--mesh", "coarse", "--json", str(path)]) == 0
    found = json.loads(path.read_text())
    assert set(found) == {"p_kpa", "theta_deg", "mesh_error_pct"}
    assert found["p_kpa"] == [0.0, 20.0]
    assert found["theta_deg"][0] == pytest.approx(0.0, abs=1e-6) and found["theta_deg"][1] > 1.0
    assert "the curve took" in capsys.readouterr().out


def test_fillets_and_contact_reach_the_run_and_its_settings(monkeypatch, tmp_path):
    seen = {}

    def compare(template, path, executor, progress, points):
        seen["run"] = template
        return {"errors": {}, "points": [], "failures": {}}

    monkeypatch.setattr(paper, "compare_with_paper", compare)
    options = ["--wave-fillet", "1.4", "--corner-fillet", "0.3", "--self-contact", "--json", str(tmp_path / "x.json")]
    assert main(["fe", "paper", *options]) == 0
    run = seen["run"]
    assert (run.geometry.wave_fillet_mm, run.geometry.corner_fillet_mm, run.self_contact) == (1.4, 0.3, True)
    told, default = settings(run), settings(Run(CellGeometry(), "pdc"))
    assert told["geometry"]["wave_fillet_mm"] == 1.4 and "arcs" in told["convention"]
    assert "self-contact" in default["not_modelled"] and "self-contact" not in told["not_modelled"]


@pytest.mark.parametrize(
    ("arguments", "resolution", "wall_mm"),
    [
        ([], CONVERGED, 2.3),
        (["--fast"], FAST, 2.1),
        (["--mesh", "trilinear"], FAST, 2.1),
        (["--fast", "--wall", "2.2"], FAST, 2.2),
        (["--mesh", "coarse"], MESHES["coarse"], 2.3),
    ],
)
def test_the_fast_mesh_comes_with_its_wall(arguments, resolution, wall_mm):
    parser = argparse.ArgumentParser()
    paper.add_arguments(parser)
    run = run_of(parser.parse_args([*arguments, "--json", "x"]))
    assert (run.resolution, run.geometry.c_mm) == (resolution, wall_mm)


@pytest.mark.parametrize("workers", ["2"])
def test_an_interrupt_keeps_what_is_finished_and_the_same_command_goes_on(workers, tmp_path, start_as_from_a_terminal):
    path = tmp_path / "x.json"
    designs = ["table_1:9", "table_2:7", "table_1:14"]  # two more: the interrupt cannot come too late
    command = [
        *COMMAND,
        "paper",
        "--mesh",
        "coarse",
        "--points",
        ",".join(designs),
        "--workers",
        workers,
        "--no-pictures",
    ]
    command += ["--json", str(path)]
    run = start_as_from_a_terminal(command)
    assert "3 jobs" in run.stdout.readline()  # what it costs, said beforehand
    assert run.stdout.readline().startswith("[1/3]")
    os.killpg(run.pid, signal.SIGINT)  # as a terminal does: the workers get it too
    _, said = run.communicate(timeout=30)
    assert run.returncode == 130
    assert said.strip().splitlines() == [
        "mbpam fe paper: interrupted; what is finished is kept, the same command goes on from it"
    ]
    kept = {row["source"]: row for row in json.loads(path.read_text())["points"]}
    assert 1 <= len(kept) < 3 and set(kept) < set(designs)

    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not [name for name in kept if name in again.stdout] and "[3/3]" in again.stdout
    rows = json.loads(path.read_text())["points"]
    assert [row["source"] for row in rows] == designs
    assert [row for row in rows if row["source"] in kept] == [kept[name] for name in designs if name in kept]


def test_without_felupe_the_extra_is_named(monkeypatch, capsys):
    for name in [
        name for name in sys.modules if name.startswith(("felupe", "mbpam_ros.study.fe.", "mbpam_ros.commands.fe."))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "felupe", None)
    assert main(["fe", "paper", "--json", "x"]) == 1
    said = capsys.readouterr().err
    assert said.endswith("; pip install 'mbpam_ros[fem]'\n") and said.count("pip install") == 1
