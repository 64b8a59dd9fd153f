"""Homogeneous solids in the convention of ``visualization_msgs/Marker``.

Body frame: sphere (diameters), cylinder with its axis along z (diameter, diameter, length), box (full extents).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry.rotations import rotation_matrix

Shape = Literal["sphere", "cylinder", "box"]
SHAPES: tuple[Shape, ...] = get_args(Shape)

Size = Sequence[float] | NDArray[np.float64]

BOX_CORNERS = np.array([[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)])
"""Of the box with half sizes 1, shape (8, 3); corners that differ in one bit of their row share an edge."""


def principal_inertia(shape: Shape, size_m: Size, mass_kg: float) -> NDArray[np.float64]:
    """Return the principal moments of inertia of the homogeneous solid about its centre, shape (3,) [kg m2]."""
    x, y, z = size_m
    if shape == "sphere":
        return np.full(3, mass_kg * x * x / 10.0)
    if shape == "cylinder":
        across = mass_kg * (3.0 * x * x / 4.0 + z * z) / 12.0
        return np.array([across, across, mass_kg * x * x / 8.0])
    return mass_kg / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])


def half_height(shape: Shape, size_m: Size, orientation_xyzw: Sequence[float] | NDArray[np.float64]) -> float:
    """Return half the vertical (world z) extent of the solid in this orientation [m]."""
    down = rotation_matrix(orientation_xyzw)[2]  # world z in the body
    x, y, z = 0.5 * np.asarray(size_m)
    if shape == "sphere":
        return float(x)
    if shape == "cylinder":
        return float(x * math.hypot(down[0], down[1]) + z * abs(down[2]))
    return float(np.abs(down) @ (x, y, z))


def surface_points_m(shape: Shape, size_m: Size, count: int = 17) -> NDArray[np.float64]:
    """Return points of the surface, edges and corners too, body frame, shape (n, 3): ``count`` by count a face."""
    across = np.linspace(-1.0, 1.0, count)
    u, v = (part.ravel() for part in np.meshgrid(across, across))
    angle = np.pi * u
    if shape == "box":
        square = np.column_stack([u, v])
        parts = [np.insert(square, axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
    elif shape == "sphere":
        ring = np.cos(0.5 * np.pi * v)
        parts = [np.column_stack([ring * np.cos(angle), ring * np.sin(angle), np.sin(0.5 * np.pi * v)])]
    else:
        disc = np.column_stack([v * np.cos(angle), v * np.sin(angle), np.ones_like(v)])
        parts = [np.column_stack([np.cos(angle), np.sin(angle), v]), disc, -disc]
    points: NDArray[np.float64] = np.concatenate(parts) * (0.5 * np.asarray(size_m))
    return points


def distance_m(shape: Shape, size_m: Size, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points (n, 3) in the body frame are from the surface, shape (n,); negative inside.

    :func:`~mbpam_ros.geometry.surfaces.signed_distance` is the same of one point, compiled, with its gradient.
    """
    half = 0.5 * np.asarray(size_m)
    if shape == "sphere":
        beyond = np.linalg.norm(points_m, axis=1, keepdims=True) - half[0]
    elif shape == "cylinder":
        across = np.hypot(points_m[:, 0], points_m[:, 1])
        beyond = np.column_stack([across - half[0], np.abs(points_m[:, 2]) - half[2]])
    else:
        beyond = np.abs(points_m) - half
    distance: NDArray[np.float64] = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    distance += np.minimum(beyond.max(axis=1), 0.0)
    return distance


def distance_from_m(
    shape: Shape,
    size_m: Size,
    position_m: Size,
    orientation_xyzw: Sequence[float] | NDArray[np.float64],
    points_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how far points (..., 3) are from the surface of a solid that lies so, shape (...); negative inside."""
    local = (points_m - np.asarray(position_m)) @ rotation_matrix(orientation_xyzw)
    return distance_m(shape, size_m, local.reshape(-1, 3)).reshape(points_m.shape[:-1])
