"""Read the columns of a data table: one of ``config/data``, or a CSV of the user's."""

from __future__ import annotations

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
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, dtype=float, encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: no such file") from error
    except (ValueError, IndexError) as error:
        raise ConfigError(f"{path}: not a table: {' '.join(str(error).split())}") from error
    missing = [column for column in columns if column not in (table.dtype.names or ())]
    if missing:
        raise ConfigError(f"{path}: missing column {', '.join(missing)}")
    values = np.array([table[column] for column in columns])
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ConfigError(f"{path}: expected finite numbers in {', '.join(columns)}")
    return values
