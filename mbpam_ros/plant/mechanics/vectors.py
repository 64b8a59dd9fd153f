"""Vectors in space as three numbers, compiled: no array is made, and the compiler keeps them in registers."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.kernel import kernel, piece

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Number = TypeVar("Number", float, Array)
"""One, or one in each lane (:mod:`~mbpam_ros.plant.mechanics.lanes`)."""

Triple = tuple[Number, Number, Number]


@kernel
def vector(values: Array, first: int) -> Vector:
    """Return three successive numbers of an array (n,)."""
    return values[first], values[first + 1], values[first + 2]


@kernel
def row(values: Array, place: int) -> Vector:
    """Return a row of an array (n, 3)."""
    return values[place, 0], values[place, 1], values[place, 2]


@piece
def dot(a: Triple[Number], b: Triple[Number]) -> Number:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def norm(a: Vector) -> float:
    """Return |a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@piece
def cross(a: Triple[Number], b: Triple[Number]) -> Triple[Number]:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@piece
def plus(a: Triple[Number], b: Triple[Number]) -> Triple[Number]:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def times(s: float, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@piece
def combined(
    r: Number, a: Triple[Number], s: Number, b: Triple[Number], t: Number, c: Triple[Number]
) -> Triple[Number]:
    """Return r a + s b + t c."""
    return r * a[0] + s * b[0] + t * c[0], r * a[1] + s * b[1] + t * c[1], r * a[2] + s * b[2] + t * c[2]


@kernel
def to_body(rotation: Array, a: Vector) -> Vector:
    """Return R^T a for the rotation R (3, 3) from the body: components along its axes."""
    x, y, z = a
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@kernel
def to_world(rotation: Array, a: Vector) -> Vector:
    """Return R a for the rotation R (3, 3) from the body."""
    x, y, z = a
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )
