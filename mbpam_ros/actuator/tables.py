"""Read the columns of a data table in ``config/data``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import ConfigError, config_path


def read_table(name: str, *columns: str) -> NDArray[np.float64]:
    """Return the named columns of ``config/data/<name>``, shape (columns, rows), in the file's own units.

    Raises:
        ConfigError: the file is missing, lacks a column, or holds something that is not a finite number there.
    """
    path = config_path(f"data/{name}")
    try:
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, dtype=float, encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: not a table: {error}") from error
    missing = [column for column in columns if column not in (table.dtype.names or ())]
    if missing:
        raise ConfigError(f"{path}: missing column {', '.join(missing)}")
    values = np.array([table[column] for column in columns])
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise ConfigError(f"{path}: expected finite numbers in {', '.join(columns)}")
    return values
