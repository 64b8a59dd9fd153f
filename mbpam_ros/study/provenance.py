"""What a figure depends on besides the question: the machine, the libraries, and the package's own sources."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

import mbpam_ros
from mbpam_ros.configuration import config_directory


def machine() -> dict[str, str]:
    """Return what CPU times depend on besides the code."""
    return {"processor": processor(), "cores": str(os.cpu_count()), "system": platform.system()}


def processor() -> str:
    """Return the processor's name, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of Python and of packages that are installed."""
    return {"python": platform.python_version(), **{name: version(name) for name in packages}}


def simulated_with() -> dict[str, object]:
    """Return what figures of the simulated gripper depend on, timings included: sources, machine and libraries."""
    return {
        "sources": sources_digest(),
        "machine": machine(),
        "versions": versions("numpy", "numba", "scipy"),
    }


def file_digest(path: Path) -> str:
    """Return a number for a file's content."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def sources_digest() -> str:
    """Return a number for the package's sources and configuration files: results of others are not taken over."""
    digest = hashlib.sha256()
    package, config = Path(mbpam_ros.__file__).parent, config_directory()
    for folder, pattern in ((package, "*.py"), (config, "*.yaml"), (config, "*.csv")):
        for path in sorted(folder.rglob(pattern)):
            digest.update(path.relative_to(folder).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
