"""What colcon and pip install: every executable and every configuration file, in the place where ROS 2 looks for it."""

import importlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import pytest

from mbpam_ros.nodes.interface import NODES

from mbpam_ros.commands.system import Operator  # isort: skip

pytestmark = pytest.mark.xdist_group("installation")  # its workspace is built once

SOURCE = Path(__file__).parents[2]
NODE_EXECUTABLES = {*NODES, "bringup", "managed_valve_controller"}
FOR_ROS2_RUN = {*NODE_EXECUTABLES, "demo"}
ON_THE_PATH = {"mbpam", *(f"mbpam_{node}" for node in NODE_EXECUTABLES)}
START_S = 60.0
STOP_S = 10.0
COMMAND_S = 300.0


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source tree as a fresh clone has it, in a colcon workspace: nothing is built in the original."""
    copy = tmp_path_factory.mktemp("workspace") / "src" / "mbpam_ros"
    leftovers = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "install", "log", "report")
    shutil.copytree(SOURCE, copy, ignore=leftovers)
    return copy


@pytest.fixture(scope="module")
def workspace(source: Path) -> Path:
    """The workspace after ``colcon build``."""
    root = source.parents[1]
    colcon(root, "build")
    return root


@pytest.fixture(scope="module")
def virtual_environment(source: Path) -> Path:
    """A virtual environment with the packages of this one and the package installed by pip."""
    root = source.parents[1] / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", str(root))
    # Paths alone: site does not read the .pth files in them, so an editable install there stays out.
    packages = ("rclpy", "numpy", "scipy", "numba", "cv2", "yaml", "setuptools")
    folders = {str(Path(importlib.import_module(name).__file__).parents[1]) for name in packages}
    site_packages = next(root.glob("lib/python*/site-packages"))
    (site_packages / "of_the_tests.pth").write_text("\n".join(sorted(folders)) + "\n")
    # setuptools before 70 builds wheels only with the help of a package of that name; pip then fetches its own.
    builds_wheels = any(map(importlib.util.find_spec, ("setuptools.command.bdist_wheel", "wheel")))
    isolation = ["--no-build-isolation"] if builds_wheels else []
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(root / "bin" / "python")]
    run(*pip, "install", "--quiet", "--no-deps", *isolation, str(source))
    return root


def environment() -> dict[str, str]:
    """This process's variables without the way to the original source and its Fast DDS profile."""
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    kept = os.pathsep.join(path for path in paths if path and Path(path).resolve() != SOURCE)
    variables = {name: value for name, value in os.environ.items() if not name.startswith(("FASTDDS_", "FASTRTPS_"))}
    # No kernel is run here, and to compile them takes longer than all else.
    return {**variables, "PYTHONPATH": kept, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "MBPAM_COMPILE": "0"}


def run(*command: str, directory: Path | None = None) -> str:
    ended = subprocess.run(
        command, cwd=directory, env=environment(), capture_output=True, text=True, timeout=COMMAND_S, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def colcon(workspace: Path, *arguments: str) -> str:
    beside = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    executable = shutil.which("colcon", path=beside)
    assert executable is not None, "colcon is missing; it is in requirements-test.txt"
    return run(executable, "--log-base", "log", *arguments, directory=workspace)


def executables_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if os.access(path, os.X_OK)}


def files_under(folder: Path) -> set[Path]:
    return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}


def assert_runs(command: Sequence[str], config: Path, domain: int, log: Path) -> None:
    """Run a node that compiles nothing, on a file that only the installed configuration has, until it has reported."""
    shutil.copy(config / "pneumatics.yaml", config / "only_here.yaml")
    variables = {"ROS_DOMAIN_ID": str(domain)}
    with log.open("wb") as output:
        process = subprocess.Popen(
            [*command, "--ros-args", "-p", "pneumatics:=only_here.yaml"],
            cwd=log.parent,
            env=environment() | variables,
            stdout=output,
            stderr=subprocess.STDOUT,
        )

    def check() -> None:
        assert process.poll() is None, log.read_text()

    operator = Operator("test_operator", idle=check, domain_id=domain)
    try:
        operator.wait_for_nodes(["pressure_sensor"], START_S)
        process.send_signal(signal.SIGINT)
        assert process.wait(STOP_S) == 0, log.read_text()
    finally:
        operator.close()
        if process.poll() is None:
            process.kill()
            process.wait()


def test_colcon_build_installs_every_executable_and_every_configuration_file(workspace):
    prefix = workspace / "install" / "mbpam_ros"
    assert executables_in(prefix / "lib" / "mbpam_ros") == FOR_ROS2_RUN
    assert executables_in(prefix / "bin") == ON_THE_PATH
    assert files_under(prefix / "share" / "mbpam_ros" / "config") >= files_under(SOURCE / "config")
    assert (prefix / "share" / "mbpam_ros" / "package.xml").is_file()
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "mbpam_ros").is_file()


def test_an_executable_of_the_colcon_workspace_runs_with_the_configuration_installed_there(workspace, domain, tmp_path):
    install = workspace / "install"
    sourced = '. "$0/setup.sh" && exec "$0/mbpam_ros/lib/mbpam_ros/pressure_sensor" "$@"'
    config = install / "mbpam_ros" / "share" / "mbpam_ros" / "config"
    assert_runs(["sh", "-c", sourced, str(install)], config, domain, tmp_path / "log")


def test_colcon_test_runs_the_tests(workspace):
    colcon(workspace, "test", "--pytest-args", "test/unit/test_terminal.py")
    results = ElementTree.parse(workspace / "build" / "mbpam_ros" / "pytest.xml").getroot()
    suite = results if results.tag == "testsuite" else results.find("testsuite")
    assert int(suite.get("tests")) > 0
    assert int(suite.get("failures")) == int(suite.get("errors")) == 0


def test_pip_install_puts_console_scripts_in_bin_and_the_configuration_under_the_prefix(virtual_environment):
    scripts = executables_in(virtual_environment / "bin")
    assert scripts >= ON_THE_PATH and not scripts & FOR_ROS2_RUN
    assert executables_in(virtual_environment / "lib" / "mbpam_ros") == FOR_ROS2_RUN
    assert files_under(virtual_environment / "share" / "mbpam_ros" / "config") >= files_under(SOURCE / "config")


def test_a_console_script_runs_with_the_configuration_that_pip_installed(virtual_environment, domain, tmp_path):
    config = virtual_environment / "share" / "mbpam_ros" / "config"
    assert_runs([str(virtual_environment / "bin" / "mbpam_pressure_sensor")], config, domain, tmp_path / "log")
    said = run(str(virtual_environment / "bin" / "mbpam_bringup"), "--help")  # loads all six
    assert "object_detector:" in said
