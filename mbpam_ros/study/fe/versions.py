"""Versions of what a finite element result was computed with."""

from __future__ import annotations

import importlib.metadata


def library_versions() -> dict[str, str | None]:
    """Return the versions of the libraries that the finite elements rest on; None where one is not installed."""
    return {name: _version(name) for name in ("felupe", "numpy", "scipy", "pypardiso")}


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
