"""The velocities after a step with contacts: Newton's method on a convex function, with an exact line search."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.plant.contact import Contacts, contact_force, contact_slope
from mbpam_ros.plant.contact_search import FINGER_SUPPORT

Array = NDArray[np.float64]

NEWTON_LIMIT = 60
VELOCITY_TOLERANCE = 1e-8
"""Largest residual over diagonal [m/s or rad/s] at which the velocities are found."""


@njit
def solve_in_place(a: Array, b: Array) -> bool:
    """Solve a x = b for a symmetric positive definite matrix; x ends in b. Returns False if it is none.

    Cholesky's L L^T; only the lower half of a is read, and overwritten by L.
    """
    n = b.shape[0]
    for j in range(n):
        for i in range(j, n):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                a[j, j] = math.sqrt(total)
            else:
                a[i, j] = total / a[j, j]
        total = b[j]
        for k in range(j):
            total -= a[j, k] * b[k]
        b[j] = total / a[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            b[j] -= a[k, j] * b[k]
        b[j] /= a[j, j]
    return True


@njit
def _residual(a: Array, b: Array, v: Array, h: float, laws: Array, contacts: Contacts, residual: Array) -> None:
    """Write a v - b - h sum J^T F(J v), and velocities and forces of the contacts."""
    for i in range(v.shape[0]):
        residual[i] = -b[i]
        for j in range(v.shape[0]):
            residual[i] += a[i, j] * v[j]
    for c in range(contacts.count[0]):
        first = 0 if contacts.finger[c] >= 0 else 2
        last = 2 if contacts.kind[c] == FINGER_SUPPORT else 8
        finger, jacobian, force = 2 * contacts.finger[c], contacts.jacobian[c], contacts.force[c]
        velocity = contacts.velocity[c]
        for i in range(6):
            velocity[i] = contacts.rise[c] if i == 2 else 0.0
            for j in range(first, last):
                velocity[i] += jacobian[i, j] * v[finger + j if j < 2 else 6 + j]
        contacts.push[c] = contact_force(
            laws[contacts.kind[c]], h, contacts.depth[c], contacts.share[c], contacts.normal[c], velocity, force
        )
        for j in range(first, last):
            total = 0.0
            for i in range(6):
                total += jacobian[i, j] * force[i]
            residual[finger + j if j < 2 else 6 + j] -= h * total


@njit
def _hessian(a: Array, h: float, laws: Array, contacts: Contacts, slope: Array, hessian: Array) -> None:
    """Write the derivative of the residual; only its lower half."""
    for i in range(a.shape[0]):
        for j in range(i + 1):
            hessian[i, j] = a[i, j]
    for c in range(contacts.count[0]):
        contact_slope(
            laws[contacts.kind[c]], h, contacts.depth[c], contacts.share[c], contacts.normal[c], contacts.velocity[c],
            contacts.push[c], slope,
        )  # fmt: skip
        first = 0 if contacts.finger[c] >= 0 else 2
        last = 2 if contacts.kind[c] == FINGER_SUPPORT else 8
        finger, jacobian = 2 * contacts.finger[c], contacts.jacobian[c]
        for j in range(first, last):
            for part in range(2):
                for k in range(3):
                    product = 0.0
                    for m in range(3):
                        product += slope[part, k, m] * jacobian[3 * part + m, j]
                    product *= h
                    for i in range(j, last):
                        row = finger + i if i < 2 else 6 + i
                        hessian[row, finger + j if j < 2 else 6 + j] += jacobian[3 * part + k, i] * product


@njit
def solve_contacts(a: Array, b: Array, v: Array, h: float, laws: Array, contacts: Contacts) -> tuple[float, int]:
    """Solve a v = b + h sum J^T F(J v) for v, from v; the table then has the forces.

    Returns what is left, the largest |residual_i| / a_ii [m/s or rad/s], and how many steps it took.
    """
    size = v.shape[0]
    hessian, slope = np.empty((size, size)), np.empty((2, 3, 3))
    residual, step, trial = np.empty(size), np.empty(size), np.empty(size)
    _residual(a, b, v, h, laws, contacts, residual)
    for iteration in range(NEWTON_LIMIT + 1):
        left = 0.0
        for i in range(size):
            left = max(left, abs(residual[i]) / a[i, i])
        if not left > VELOCITY_TOLERANCE or iteration == NEWTON_LIMIT:
            break
        _hessian(a, h, laws, contacts, slope, hessian)
        for i in range(size):
            step[i] = residual[i]
        if not solve_in_place(hessian, step):
            return np.inf, iteration
        # The function's slope along the step rises from below zero: Illinois steps to its root, if that is before 1.
        low, high, low_slope, high_slope, fraction = 0.0, 1.0, 0.0, 0.0, 1.0
        for i in range(size):
            low_slope -= residual[i] * step[i]
        enough = 1e-2 * abs(low_slope)
        side = 0
        for line in range(10):
            for i in range(size):
                trial[i] = v[i] - fraction * step[i]
            _residual(a, b, trial, h, laws, contacts, residual)
            here = 0.0
            for i in range(size):
                here -= residual[i] * step[i]
            if abs(here) <= enough or (line == 0 and here < 0.0):
                break
            if here > 0.0:
                high, high_slope = fraction, here
                low_slope *= 0.5 if side > 0 else 1.0
                side = 1
            else:
                low, low_slope = fraction, here
                high_slope *= 0.5 if side < 0 else 1.0
                side = -1
            fraction = (low * high_slope - high * low_slope) / (high_slope - low_slope)
        for i in range(size):
            v[i] = trial[i]
    return left, iteration
