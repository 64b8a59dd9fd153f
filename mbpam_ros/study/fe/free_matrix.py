"""The tangent of a body's free components, its pattern worked out once.

Sums and cuts of sparse matrices cost more than to assemble them otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix


class FreeMatrix:
    """Adds entries to a sparse matrix and takes out rows and columns, always the same ones.

    Args:
        pattern: a matrix with the pattern of all that will come, its indices sorted; shape (n, n).
        free: numbers of the rows and columns to keep, rising.
        places: by name, rows and columns of entries that may be added, within the pattern; shapes (m,).
    """

    def __init__(
        self,
        pattern: csr_matrix,
        free: NDArray[np.int64],
        places: Mapping[int, tuple[NDArray[np.int64], NDArray[np.int64]]],
    ) -> None:
        number = np.full(pattern.shape[0], -1, dtype=np.int32)
        number[free] = np.arange(free.size, dtype=np.int32)
        row = np.repeat(np.arange(pattern.shape[0], dtype=np.int32), np.diff(pattern.indptr))
        kept = (number[row] >= 0) & (number[pattern.indices] >= 0)
        self._kept = np.flatnonzero(kept).astype(np.int32)
        self._indices = number[pattern.indices[self._kept]]
        counts = np.bincount(number[row[self._kept]], minlength=free.size)
        self._indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        keys = row.astype(np.int64) * pattern.shape[0] + pattern.indices
        self._added = {}
        for name, (rows, columns) in places.items():
            at, which = np.unique(np.searchsorted(keys, rows * pattern.shape[0] + columns), return_inverse=True)
            self._added[name] = at, which

    def of(self, matrix: csr_matrix, entries: Mapping[int, NDArray[np.float64]]) -> csr_matrix:
        """Return the free rows and columns of ``matrix`` with the values of entries added, by name.

        ``matrix`` is changed: it has the sum afterwards.
        """
        for name, values in entries.items():
            at, which = self._added[name]
            matrix.data[at] += np.bincount(which, values)
        free = csr_matrix((self._indptr.size - 1,) * 2)
        free.data, free.indices, free.indptr = matrix.data[self._kept], self._indices, self._indptr  # not copied
        free.has_canonical_format = True
        return free
