"""How much of the brightness that is seen on a primitive its normals explain."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.vision.solid_fit.normal_equations import substitute
from mbpam_ros.vision.solid_fit.surface import normal_at

_TERMS = 9
_MATT_RIDGE = 1e-3
_SENSOR_VARIANCE = 6.0  # levels^2: variation at the level of noise says nothing


@njit(nogil=True)
def unexplained_shading(
    form: int,
    p: NDArray,
    support: float,
    eye: NDArray,
    rotation: NDArray,
    lens: NDArray,
    pixels: NDArray,
    levels: NDArray,
) -> float:
    """Return the share of the brightness' variation that a matt primitive's normals leave unexplained, 0 to 1.

    Weighted least squares of the nine spherical harmonics of up to second order, twice, so that what is printed on an
    object and highlights count less. 1 where the primitive is not what the pixels show.

    Args:
        pixels: (n, 2) u, v.
        levels: (n,), their brightness.
    """
    terms, found = np.empty((len(pixels), _TERMS)), np.empty(len(pixels))
    normal = np.empty(3)
    count = 0
    for i in range(len(pixels)):
        a, b = (pixels[i, 0] - lens[2]) / lens[0], (pixels[i, 1] - lens[3]) / lens[1]
        norm = math.sqrt(a * a + b * b + 1.0)
        dx = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]) / norm
        dy = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]) / norm
        dz = (rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]) / norm
        if normal_at(form, p, support, eye, dx, dy, dz, normal):
            x, y, z = normal
            row = terms[count]
            row[0], row[1], row[2], row[3] = 1.0, x, y, z
            row[4], row[5], row[6], row[7], row[8] = x * y, x * z, y * z, x * x - y * y, 3.0 * z * z - 1.0
            found[count] = levels[i]
            count += 1
    if count < 30 or count < 0.6 * len(pixels):
        return 1.0
    weights, rest = np.ones(count), np.empty(count)
    factor, right = np.empty((_TERMS, _TERMS)), np.empty(_TERMS)
    for _ in range(3):
        for i in range(_TERMS):
            right[i] = 0.0
            for j in range(i + 1):
                factor[i, j] = 0.0
        total = 0.0
        for k in range(count):
            total += weights[k]
            for i in range(_TERMS):
                wt = weights[k] * terms[k, i]
                right[i] += wt * found[k]
                for j in range(i + 1):
                    factor[i, j] += wt * terms[k, j]
        for i in range(_TERMS):
            factor[i, i] += _MATT_RIDGE * total
            for j in range(i + 1):
                value = factor[i, j]
                for k in range(j):
                    value -= factor[i, k] * factor[j, k]
                factor[i, j] = math.sqrt(max(value, 1e-12)) if i == j else value / factor[j, j]
        substitute(factor, right, _TERMS, right)
        for k in range(count):
            value = found[k]
            for i in range(_TERMS):
                value -= terms[k, i] * right[i]
            rest[k] = value
        scale = max(1.4826 * np.median(np.abs(rest)), 1.0)
        for k in range(count):
            weights[k] = 1.0 / (1.0 + (rest[k] / (2.5 * scale)) ** 2)
    mean, total, left, variation = 0.0, 0.0, 0.0, 0.0
    for k in range(count):
        mean += weights[k] * found[k]
        total += weights[k]
    mean /= total
    for k in range(count):
        left += weights[k] * rest[k] ** 2
        variation += weights[k] * (found[k] - mean) ** 2
    return min(left / (variation + _SENSOR_VARIANCE * total), 1.0)
