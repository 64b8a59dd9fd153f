"""Rotations as unit quaternions (x, y, z, w), and their matrices.

Plain arithmetic on single numbers: the mechanics compile the same functions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]
Row = tuple[float, float, float]


def rotation_rows(x: float, y: float, z: float, w: float) -> tuple[Row, Row, Row]:
    """Return the rows of the rotation matrix of a unit quaternion."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


def rotation_matrix(orientation_xyzw: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a unit quaternion (4,); its columns are the turned axes."""
    x, y, z, w = orientation_xyzw
    return np.array(rotation_rows(x, y, z, w))


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the quaternion of turning by ``second``, then by ``first``."""
    a, b, c, d = first
    x, y, z, w = second
    return (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )


def about_z(angle_rad: float) -> Quaternion:
    """Return the quaternion of a turn about z."""
    return 0.0, 0.0, math.sin(0.5 * angle_rad), math.cos(0.5 * angle_rad)
