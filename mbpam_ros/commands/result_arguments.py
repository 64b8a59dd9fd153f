"""Types of arguments that say where results go: what cannot be written is refused before anything is computed."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from mbpam_ros.study.result_file import ResultFileError, require_makeable, require_writable


def result_file(text: str) -> Path:
    """Return the path of a file that can be written into a folder that there is.

    Raises:
        argparse.ArgumentTypeError: the folder is missing or takes no files, or the path is a folder.
    """
    return _checked(text, require_writable)


def result_folder(text: str) -> Path:
    """Return the path of a folder for many files, which is made when the first is written.

    Raises:
        argparse.ArgumentTypeError: it is a file, takes no files, or cannot be made.
    """
    return _checked(text, require_makeable)


def _checked(text: str, require: Callable[[Path], None]) -> Path:
    try:
        require(Path(text))
    except ResultFileError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(text)
