"""JSON files of long runs: written whole or not at all, with the versions of what computed them."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path


def write_json(path: Path, content: dict) -> None:
    """Write ``content`` so that an interrupt leaves the old file or the new one.

    Raises:
        ValueError: a number is not finite.
        OSError: the file cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    beside.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    beside.replace(path)


def library_versions() -> dict[str, str | None]:
    """Return the versions of the libraries that the finite elements rest on; None where one is not installed."""
    return {name: _version(name) for name in ("felupe", "numpy", "scipy", "pypardiso")}


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
