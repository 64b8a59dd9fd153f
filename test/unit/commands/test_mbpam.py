"""``mbpam``: its list of verbs, help of each without what it needs, and how it ends."""

import argparse
import importlib
import os
import signal
import subprocess
import sys

import pytest

from mbpam_ros.commands import fe, plan
from mbpam_ros.commands.mbpam import VERBS, main
from mbpam_ros.commands.result_arguments import result_folder

MBPAM = [sys.executable, "-u", "-m", "mbpam_ros.commands"]


def run(*arguments, **options):
    return subprocess.run([*MBPAM, *arguments], capture_output=True, text=True, timeout=60, check=False, **options)


def test_the_list_of_verbs_loads_none_of_them():
    code = "import sys; from mbpam_ros.commands.mbpam import main; sys.argv = ['mbpam', '--help']\ntry: main()\n"
    code += "except SystemExit: print(*sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(f"\n    {verb.name}" in ended.stdout for verb in VERBS)
    assert not {"numpy", "rclpy", "numba", "cv2"} & set(ended.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("verb", [*VERBS, *fe.VERBS], ids=lambda verb: verb.name)
def test_every_verb_has_help(verb, capsys):
    pytest.importorskip("felupe" if verb in fe.VERBS else "psutil" if verb.name == "bench" else "numpy")
    group = ["fe"] if verb in fe.VERBS else []
    with pytest.raises(SystemExit) as ended:
        main([*group, verb.name, "--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: {' '.join(['mbpam', *group, verb.name])} ")
    assert "--help" in said and len(said.splitlines()) > 5
    module = importlib.import_module(f"mbpam_ros.commands.{verb.module}")
    assert module.__doc__.splitlines()[0] in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "mbpam: the following arguments are required: VERB; see mbpam --help"),
        (["pla"], "mbpam: argument VERB: invalid choice: 'pla'"),
        (
            ["plan", "bulb", "--tolerence", "3"],
            "mbpam plan: unrecognized arguments: --tolerence 3; see mbpam plan --help",
        ),
    ],
)
def test_what_is_no_verb_or_argument_is_refused_in_one_line(arguments, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(said) and told.count("\n") == 1


@pytest.mark.parametrize("verb", ["peers", "costs", "bench"])
@pytest.mark.parametrize("argument", [["--workers", "4"], ["--dask", "local"]])
def test_what_measures_time_says_why_it_is_not_spread(verb, argument, capsys):
    pytest.importorskip("psutil" if verb == "bench" else "numpy")
    with pytest.raises(SystemExit) as ended:
        main([verb, *argument])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(f"mbpam {verb}: {argument[0]}: this verb measures time") and told.count("\n") == 1


@pytest.mark.slow
def test_what_a_verb_refuses_is_said_in_one_line_with_status_1():
    ended = run("plan", "piano")
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr.startswith("mbpam plan: ") and "no scene 'piano'" in ended.stderr
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["sample", "--csv"], ["grip-table", "--json"], ["silicone", "--picture"]])
@pytest.mark.parametrize(
    ("path", "why"),
    [("missing/x.json", "there is no folder /"), ("folder", "it is a folder"), ("/proc/x.json", "No such file")],
)
def test_a_result_that_cannot_be_written_is_refused_at_once_and_leaves_nothing(
    arguments, path, why, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(SystemExit) as ended:
        main([*arguments, path])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(f"mbpam {arguments[0]}: argument {arguments[1]}: cannot write {path}: {why}")
    assert told.count("\n") == 1 and list(tmp_path.rglob("*")) == [tmp_path / "folder"]


def test_a_folder_for_results_is_made_later_unless_it_cannot_be(tmp_path):
    assert result_folder(str(tmp_path / "new" / "logs")) == tmp_path / "new" / "logs"
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    for path in ("/proc/logs", str(tmp_path / "file"), str(tmp_path / "file" / "logs")):
        with pytest.raises(argparse.ArgumentTypeError, match="cannot write"):
            result_folder(path)


def test_an_error_that_is_not_ours_is_not_swallowed(monkeypatch):
    def broken(options):
        raise ZeroDivisionError

    monkeypatch.setattr(plan, "run", broken)
    with pytest.raises(ZeroDivisionError):
        main(["plan", "bulb"])


def test_a_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "psutil", None)
    monkeypatch.delitem(sys.modules, "mbpam_ros.commands.bench", raising=False)
    assert main(["bench"]) == 1
    assert "pip install 'mbpam_ros[bench]'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_ends_a_verb_with_130_one_line_and_no_process_left(workers, tmp_path, start_as_from_a_terminal):
    file = tmp_path / "grasps.json"
    command = [*MBPAM, "grasps", "--tier", "arc", "--workers", workers, "--json", str(file)]
    process = start_as_from_a_terminal(command)
    assert "jobs on one core" in process.stdout.readline()
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers get it too
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    kept = "what is finished is kept, the same command goes on from it"
    assert said.strip().splitlines() == [f"mbpam grasps: interrupted; {kept}"]
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
