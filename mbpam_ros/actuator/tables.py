"""Read the columns of a data table: one of ``config/data``, or a CSV of the user's."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import ConfigError, config_path


def read_table(name: str, *columns: str) -> NDArray[np.float64]:
    """Return the named columns of ``config/data/<name>``, shape (columns, rows), in the file's own units.

    Raises:
        ConfigError: the file is missing, lacks a column, or holds something that is not a finite number there.
    """
    return read_columns(config_path(f"data/{name}"), *columns)


def read_columns(path: Path, *columns: str) -> NDArray[np.float64]:
    """Return the named columns of a CSV with a header, shape (columns, rows).

    Raises:
        ConfigError: the file is missing, lacks a column, or holds something that is not a finite number there.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of an empty file, which is refused below
            table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, dtype=float, encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: no such file") from error
    except IndexError as error:
        raise ConfigError(f"{path}: empty; expected a line of column names and rows of numbers") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not a table: {' '.join(str(error).split())}") from error
    missing = [column for column in columns if column not in (table.dtype.names or ())]
    if missing:
        raise ConfigError(f"{path}: missing column {', '.join(missing)}")
    values = np.array([table[column] for column in columns])
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ConfigError(f"{path}: expected finite numbers in {', '.join(columns)}")
    return values
