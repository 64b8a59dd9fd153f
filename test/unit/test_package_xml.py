"""``package.xml``: as its format asks, with dependencies that rosdep can install, and all that the code imports."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

ROS_PACKAGES = set(
    "builtin_interfaces control_msgs diagnostic_msgs domain_coordinator geometry_msgs rcl_interfaces rclpy "
    "rosgraph_msgs sensor_msgs std_msgs std_srvs tf2_msgs vision_msgs visualization_msgs".split()
)
"""Those in use that the distributions Jazzy and Kilted hold (ros/rosdistro, 8468e88 of 22 August 2026)."""

ROSDEP_KEYS = {
    "python3-numpy": "numpy",
    "python3-scipy": "scipy",
    "python3-numba": "numba",
    "python3-opencv": "cv2",
    "python3-yaml": "yaml",
    "python3-matplotlib": "matplotlib",
    "python3-pytest": "pytest",
    "python3-hypothesis": "hypothesis",
    "python3-pytest-timeout": "pytest_timeout",
}
"""Keys of rosdep's python.yaml of that day, each with a package for Ubuntu, and the module it installs."""

ALWAYS_THERE = {"setuptools"}
EXTRAS = set(
    "_typeshed distributed elastica felupe llvmlite manifold3d mcap mujoco psutil pymoo pypardiso typing_extensions "
    "viser".split()
)
"""Imported where they are asked for alone, by verbs that name the extra; or for types."""


def read():
    package = pytest.importorskip("catkin_pkg.package")
    warnings = []
    found = package.parse_package(str(ROOT / "package.xml"), warnings=warnings)
    found.validate()
    assert not warnings
    return found


def imported():
    """Top names of all that the package imports."""
    found = set()
    for path in (ROOT / "mbpam_ros").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add(node.module.partition(".")[0])
    return found


def test_it_is_as_the_format_asks_and_says_what_setup_py_does():
    found = read()
    said = (ROOT / "setup.py").read_text(encoding="utf-8")
    assert found.package_format == 3 and found.get_build_type() == "ament_python"
    assert f'PACKAGE = "{found.name}"' in said and f'version="{found.version}"' in said
    assert found.licenses[0] in said and found.maintainers[0].email in said


def test_every_dependency_is_a_package_of_ros_or_a_key_of_rosdep():
    found = read()
    names = {each.name for each in (*found.exec_depends, *found.test_depends, *found.build_depends)}
    assert names <= ROS_PACKAGES | set(ROSDEP_KEYS)


@pytest.mark.slow
def test_what_the_code_imports_is_depended_on_and_nothing_else():
    depended = {each.name for each in read().exec_depends}
    modules = {ROSDEP_KEYS.get(name, name) for name in depended}
    of_python = {"mbpam_ros", *sys.stdlib_module_names}
    assert imported() - of_python - EXTRAS - ALWAYS_THERE == modules
