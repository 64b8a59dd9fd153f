"""Weighted least squares over the few parameters of a primitive, and what these may be."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.vision.solid_fit.outline import BOX, CAPSULE, POST, SPHERE

MOST_PARAMETERS = 6
COUNTS = (3, 5, 4, 6, 5)
"""Parameters of each form."""

DIFFERENCE = 2e-5
"""Step of the finite differences [m, rad]."""

UNOBSERVED = 3e-5
"""Of the largest curvature: keeps what is not seen (a box's height from above) from running away."""

_LARGEST_M = 0.60
_SMALLEST_M = 0.004


@njit(nogil=True)
def has_yaw(form: int) -> bool:
    """Whether the third parameter is an angle."""
    return form != SPHERE and form != POST


@njit(nogil=True)
def keep_possible(form: int, p: NDArray, reach: float) -> None:
    """Keep sizes within what can stand below the eye and be an object."""
    first = 3 if has_yaw(form) else 2
    for i in range(first, COUNTS[form]):
        p[i] = min(max(p[i], 0.5 * _SMALLEST_M), _LARGEST_M)
    tallest = 0.95 * reach
    if form == BOX:
        p[5] = min(p[5], tallest)
    elif form == POST:
        p[3] = min(p[3], tallest)
    else:
        p[first] = min(p[first], 0.5 * tallest)
    if form == CAPSULE:
        p[4] = max(p[4], 2.0 * p[3] + 1e-4)


@njit(nogil=True)
def solve(normal: NDArray, right: NDArray, count: int, damping: float, floor: float, step: NDArray) -> None:
    """Solve the damped normal equations by Cholesky; ``floor`` leaves alone what is not observed."""
    largest = 1e-12
    for i in range(count):
        largest = max(largest, normal[i, i])
    factor = np.zeros((MOST_PARAMETERS, MOST_PARAMETERS))
    for i in range(count):
        for j in range(i + 1):
            value = normal[i, j]
            if i == j:
                value += damping * normal[i, i] + floor * largest
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                factor[i, i] = math.sqrt(max(value, 1e-12 * largest))
            else:
                factor[i, j] = value / factor[j, j]
    substitute(factor, right, count, step)


@njit(nogil=True)
def substitute(factor: NDArray, right: NDArray, count: int, solution: NDArray) -> None:
    """Solve L L^T x = right for a lower factor L; ``solution`` may be ``right``."""
    for i in range(count):
        value = right[i]
        for k in range(i):
            value -= factor[i, k] * solution[k]
        solution[i] = value / factor[i, i]
    for i in range(count - 1, -1, -1):
        value = solution[i]
        for k in range(i + 1, count):
            value -= factor[k, i] * solution[k]
        solution[i] = value / factor[i, i]


@njit(nogil=True)
def add(normal: NDArray, right: NDArray, row: NDArray, residual: float, weight: float, count: int) -> None:
    """Add one residual, with its derivatives ``row``, to the normal equations."""
    for i in range(count):
        wr = weight * row[i]
        right[i] -= wr * residual
        for j in range(i + 1):
            normal[i, j] += wr * row[j]
