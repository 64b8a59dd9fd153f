"""Homogeneous solids in the convention of ``visualization_msgs/Marker``.

Body frame: sphere (diameters), cylinder with its axis along z (diameter, diameter, length), box (full extents).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def principal_inertia(shape: str, size_m: tuple[float, float, float], mass_kg: float) -> NDArray[np.float64]:
    """Return the principal moments of inertia of the homogeneous solid about its centre, shape (3,) [kg m2]."""
    x, y, z = size_m
    if shape == "sphere":
        return np.full(3, mass_kg * x * x / 10.0)
    if shape == "cylinder":
        across = mass_kg * (3.0 * x * x / 4.0 + z * z) / 12.0
        return np.array([across, across, mass_kg * x * x / 8.0])
    return mass_kg / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])


def half_height(shape: str, size_m: tuple[float, float, float], orientation_xyzw: NDArray[np.float64]) -> float:
    """Return half the vertical (world z) extent of the solid in this orientation [m]."""
    a, b, c, w = orientation_xyzw
    down = np.array([2 * (a * c - b * w), 2 * (b * c + a * w), 1 - 2 * (a * a + b * b)])  # world z in the body
    x, y, z = 0.5 * np.asarray(size_m)
    if shape == "sphere":
        return float(x)
    if shape == "cylinder":
        return float(x * math.hypot(down[0], down[1]) + z * abs(down[2]))
    return float(np.abs(down) @ (x, y, z))
