"""Package the gripper for colcon (ament_python) and for pip alike."""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.develop import develop
from setuptools.command.install import install

PACKAGE = "mbpam_ros"
NODES = (
    "plant",
    "pressure_sensor",
    "valve_controller",
    "managed_valve_controller",
    "state_estimator",
    "object_detector",
    "grasp_arbiter",
    "bringup",
)
ROS_WHEELS = [
    "ros-rclpy",
    "ros-rmw-fastrtps-cpp",
    "ros-rmw-fastrtps-shared-cpp",
    "ros-common-interfaces",
    "ros-domain-coordinator",
]
TEST = ["pytest", "pytest-timeout", "hypothesis"]


def shared_files() -> list[tuple[str, list[str]]]:
    """Return data_files: the package index marker, package.xml, what ros2 run finds, and ``config/`` folder by folder.

    What ros2 run finds lies in ``lib/<package>`` under short names and hands over to the console scripts: these are on
    everybody's path, where ``plant`` or ``demo`` may be anything.
    """
    files = [
        (f"lib/{PACKAGE}", [str(path) for path in sorted(Path("executables").iterdir())]),
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ]
    folders = [Path("config"), *(path for path in sorted(Path("config").rglob("*")) if path.is_dir())]
    for folder in folders:
        names = [str(path) for path in sorted(folder.iterdir()) if path.is_file()]
        files.append((f"share/{PACKAGE}/{folder}", names))
    return files


def compile_kernels(library: str | None) -> None:
    """Fill the cache of compiled kernels beside what was installed; where that fails, the first node to start does.

    ``MBPAM_COMPILE=0`` leaves it out, for builds that nobody runs.
    """
    if os.environ.get("MBPAM_COMPILE") == "0":
        return
    path = os.pathsep.join(filter(None, [library, os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", f"{PACKAGE}.commands", "compile"]
    if subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, cwd=os.sep, check=False).returncode:
        print("warning: no kernels compiled; the first node to start compiles them", file=sys.stderr)


class InstallCompiled(install):
    """``setup.py install``, which is what colcon calls."""

    def run(self) -> None:
        """Install, then compile; not while a wheel is made, which goes to other machines."""
        super().run()
        if self.root is None:
            compile_kernels(self.install_lib)


class DevelopCompiled(develop):
    """``setup.py develop``, which is what colcon calls with ``--symlink-install``."""

    def run(self) -> None:
        """Link, then compile."""
        super().run()
        compile_kernels(str(Path(__file__).parent))


setup(
    cmdclass={"install": InstallCompiled, "develop": DevelopCompiled},
    name=PACKAGE,
    version="0.1.0",
    description="Run and simulate a four-finger gripper of multi-directional bending pneumatic artificial muscles",
    license="Apache-2.0",
    maintainer="mbpam_ros maintainers",
    maintainer_email="mbpam_ros@example.org",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=shared_files(),
    python_requires=">=3.10",
    install_requires=["setuptools", "numpy", "scipy", "numba", "opencv-python-headless", "pyyaml"],
    # Where ROS 2 is installed by the system, rclpy comes with it; elsewhere it comes as wheels: pip install .[ros]
    extras_require={
        "ros": ROS_WHEELS,
        "report": ["matplotlib"],
        "study": ["matplotlib", "pymoo"],  # pictures and NSGA-II of the design study; all else needs no extra
        "fem": ["felupe>=11", "pypardiso", "matplotlib"],  # offline finite elements; without pypardiso SciPy solves
        "cad": ["manifold3d", "matplotlib"],  # solids of muscle, moulds and palm, with pictures of them
        "cluster": ["distributed"],  # their many runs on many machines
        "view": ["viser"],  # a page of its own for the browser; 150 MB with what it brings
        "record": ["mcap"],  # recordings; the messages in them are as ROS serialised them, so nothing else is needed
        "bench": ["psutil", "mujoco>=3", "pyelastica"],  # CPU of the nodes; the simulators to compare with
        "test": TEST,
    },
    tests_require=TEST,
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"mbpam = {PACKAGE}.commands.start:mbpam",
            *(f"mbpam_{node} = {PACKAGE}.nodes.start:{node}" for node in NODES),
        ]
    },
)
