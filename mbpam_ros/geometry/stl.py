"""Surfaces as files that printers and viewers read."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_HEADER = b"mbpam_ros".ljust(80)


def binary_stl(corners: NDArray[np.float64]) -> bytes:
    """Return a binary STL file of triangles, shape (n, 3, 3), anticlockwise from outside, in the corners' unit."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    rows = np.zeros(len(corners), dtype=[("floats", "<f4", (4, 3)), ("attribute", "<u2")])
    rows["floats"] = np.concatenate([normals[:, None], corners], axis=1)
    return _HEADER + struct.pack("<I", len(rows)) + rows.tobytes()
