"""Files of results, written so that an interrupt leaves the old file or the new one."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryFile

from mbpam_ros.errors import MbpamError


class ResultFileError(MbpamError, RuntimeError):
    """A result cannot be written, or its file holds something else; the message says where and why."""


def write_json(path: Path, content: dict | list) -> None:
    """Write JSON. Every number in it must be finite.

    Raises:
        ResultFileError: its folder is missing or cannot be written.
    """
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text.

    Raises:
        ResultFileError: its folder is missing or cannot be written.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole, or leave the one before it.

    Raises:
        ResultFileError: its folder is missing or cannot be written.
    """
    beside = path.with_name(path.name + ".part")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError as error:
        raise ResultFileError(f"cannot write {path}: {error.strerror or error}") from error


def require_writable(path: Path) -> None:
    """Check that a file can be written, before what it is to hold is worked out.

    Folders are not made: a mistyped path would leave one, with the result where nobody looks.

    Raises:
        ResultFileError: it cannot, and why.
    """
    if path.is_dir():
        raise ResultFileError(f"cannot write {path}: it is a folder")
    _require_folder(path.absolute().parent, path)


def require_makeable(folder: Path) -> None:
    """Check that a folder for many files is there and takes files, or can be made.

    Raises:
        ResultFileError: neither, and why.
    """
    _require_folder(next(each for each in (folder.absolute(), *folder.absolute().parents) if each.exists()), folder)


def _require_folder(folder: Path, wanted: Path) -> None:
    """By writing a file without a name, which also finds full and read-only file systems."""
    if not folder.is_dir():
        raise ResultFileError(f"cannot write {wanted}: there is no folder {folder}")
    try:
        with TemporaryFile(dir=folder) as probe:
            probe.write(b" ")
    except OSError as error:
        raise ResultFileError(f"cannot write {wanted}: {error.strerror or error}") from error
