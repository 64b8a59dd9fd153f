"""A number that changes with source files: part of the key under which compiled code is kept on disk."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path


def source_digest(sources: Iterable[Path]) -> int:
    """Return a number that is another one when a file is."""
    digest = 0
    for source in sources:
        digest = zlib.crc32(source.read_bytes(), digest)
    return digest
