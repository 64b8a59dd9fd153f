"""Files of results, written so that an interrupt leaves the old file or the new one."""

from __future__ import annotations

import json
from pathlib import Path

from mbpam_ros.errors import MbpamError


class ResultFileError(MbpamError, RuntimeError):
    """A result cannot be written, or its file holds something else; the message says where and why."""


def write_json(path: Path, content: dict | list) -> None:
    """Write JSON. Every number in it must be finite.

    Raises:
        ResultFileError: the folder cannot be written.
    """
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text; folders are made.

    Raises:
        ResultFileError: the folder cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    make_folder_of(path)
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except OSError as error:
        raise ResultFileError(f"cannot write {path}: {error.strerror or error}") from error


def make_folder_of(path: Path) -> None:
    """Make the folder that a file goes into, before what it is to hold is worked out.

    Raises:
        ResultFileError: it cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultFileError(f"cannot write {path}: {error.strerror or error}") from error
