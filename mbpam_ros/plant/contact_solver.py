"""The velocities after a step with contacts: Newton's method on a convex function, with an exact line search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.plant.contact import Contacts, contact_force, contact_slope
from mbpam_ros.plant.contact_search import FINGER_SUPPORT
from mbpam_ros.plant.finger_contact import FINGER_FINGER

Array = NDArray[np.float64]

NEWTON_LIMIT = 60
LINE_LIMIT = 40
BISECT_FROM = 5
"""Trials along one of Newton's steps after which every other one halves what is left of it. Where a contact closes
further along, the slope is next to nothing before it and huge beyond: false position alone creeps toward it."""
VELOCITY_TOLERANCE = 1e-8
"""Largest residual over diagonal [m/s or rad/s] at which the velocities are found."""


@njit
def solve_in_place(a: Array, b: Array, first: NDArray[np.int64]) -> bool:
    """Solve a x = b for a symmetric positive definite matrix; x ends in b. Returns False if it is none.

    L D L^T inside the envelope: row i is zero before column ``first[i]``, and so is that of L. Only the lower half of a
    is read, and overwritten by L and the inverse of D.
    """
    n = b.shape[0]
    for i in range(n):
        pivot, right = a[i, i], b[i]
        for j in range(first[i], i):
            total = a[i, j]
            for k in range(max(first[i], first[j]), j):
                total -= a[i, k] * a[j, k]  # (L D) of row i, L of row j
            a[i, j] = total
        for j in range(first[i], i):
            scaled = a[i, j] * a[j, j]
            pivot -= a[i, j] * scaled
            right -= scaled * b[j]
            a[i, j] = scaled
        if not pivot > 0.0:
            return False
        a[i, i], b[i] = 1.0 / pivot, right
    for i in range(n):
        b[i] *= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(first[i], i):
            b[k] -= a[i, k] * b[i]
    return True


class Scratch(NamedTuple):
    """Room for the solution: (n, n), three of (n,), (2, 3, 3), and the envelope (n,) of the equations."""

    hessian: Array
    residual: Array
    step: Array
    trial: Array
    slope: Array
    first: NDArray[np.int64]


@njit
def scratch(size: int, coordinates: int, fingers: int) -> Scratch:
    """Return room for ``size`` equations, those of the fingers first; the envelope is that of fingers apart."""
    first = np.zeros(size, np.int64)
    for i in range(fingers * coordinates):
        first[i] = i // coordinates * coordinates
    return Scratch(np.empty((size, size)), np.empty(size), np.empty(size), np.empty(size), np.empty((2, 3, 3)), first)


@njit
def _columns(contacts: Contacts, c: int, size: int) -> tuple[int, int, int, int]:
    """Return the columns of the Jacobian from and to which a contact acts, and where its two parts go in the system."""
    coordinates = contacts.coordinates
    finger = coordinates * contacts.finger[c]
    if contacts.kind[c] == FINGER_FINGER:
        return 0, 2 * coordinates, finger, coordinates * (contacts.other[c] - 1)
    start = 0 if contacts.finger[c] >= 0 else coordinates
    stop = coordinates if contacts.kind[c] == FINGER_SUPPORT else coordinates + 6
    return start, stop, finger, size - 6 - coordinates


@njit
def _residual(
    a: Array, b: Array, v: Array, h: float, laws: Array, contacts: Contacts, first: NDArray[np.int64], residual: Array
) -> None:
    """Write a v - b - h sum J^T F(J v), and velocities and forces of the contacts."""
    size, coordinates = v.shape[0], contacts.coordinates
    for i in range(size):
        residual[i] = a[i, i] * v[i] - b[i]
        for j in range(first[i], i):
            residual[i] += a[i, j] * v[j]
            residual[j] += a[i, j] * v[i]
    for c in range(contacts.count[0]):
        start, stop, finger, body = _columns(contacts, c, size)
        jacobian, force, velocity = contacts.jacobian[c], contacts.force[c], contacts.velocity[c]
        for i in range(6):
            velocity[i] = contacts.rise[c] if i == 2 else 0.0
            for j in range(start, stop):
                velocity[i] += jacobian[i, j] * v[finger + j if j < coordinates else body + j]
        contacts.push[c] = contact_force(
            laws[contacts.kind[c]], h, contacts.depth[c], contacts.share[c], contacts.normal[c], velocity, force
        )
        for j in range(start, stop):
            total = 0.0
            for i in range(6):
                total += jacobian[i, j] * force[i]
            residual[finger + j if j < coordinates else body + j] -= h * total


@njit
def _hessian(
    a: Array, h: float, laws: Array, contacts: Contacts, slope: Array, first: NDArray[np.int64], hessian: Array
) -> None:
    """Write the derivative of the residual; only its lower half."""
    size, coordinates = a.shape[0], contacts.coordinates
    for i in range(size):
        for j in range(first[i], i + 1):
            hessian[i, j] = a[i, j]
    for c in range(contacts.count[0]):
        contact_slope(
            laws[contacts.kind[c]], h, contacts.depth[c], contacts.share[c], contacts.normal[c], contacts.velocity[c],
            contacts.push[c], slope,
        )  # fmt: skip
        start, stop, finger, body = _columns(contacts, c, size)
        jacobian = contacts.jacobian[c]
        for i in range(start, stop):
            row = finger + i if i < coordinates else body + i
            for part in range(2):
                for k in range(3):
                    product = 0.0
                    for m in range(3):
                        product += slope[part, k, m] * jacobian[3 * part + m, i]
                    product *= h
                    for j in range(start, min(i + 1, coordinates)):
                        hessian[row, finger + j] += jacobian[3 * part + k, j] * product
                    for j in range(coordinates, i + 1):
                        hessian[row, body + j] += jacobian[3 * part + k, j] * product


@njit
def solve_contacts(
    a: Array, b: Array, v: Array, h: float, laws: Array, contacts: Contacts, room: Scratch
) -> tuple[float, int]:
    """Solve a v = b + h sum J^T F(J v) for v, from v; the table then has the forces.

    Of a, only what is in the envelope of ``room`` is read. Returns what is left, the largest |residual_i| / a_ii [m/s
    or rad/s], and how many steps it took.
    """
    size = v.shape[0]
    hessian, residual, step, trial, slope, first = room
    _residual(a, b, v, h, laws, contacts, first, residual)
    for iteration in range(NEWTON_LIMIT + 1):
        left = 0.0
        for i in range(size):
            left = max(left, abs(residual[i]) / a[i, i])
        if not left > VELOCITY_TOLERANCE or iteration == NEWTON_LIMIT:
            break
        _hessian(a, h, laws, contacts, slope, first, hessian)
        for i in range(size):
            step[i] = residual[i]
        if not solve_in_place(hessian, step, first):
            return np.inf, iteration
        # The function's slope along the step rises from below zero: seek its root, if that is before 1 (Illinois).
        low, high, low_slope, high_slope, fraction = 0.0, 1.0, 0.0, 0.0, 1.0
        for i in range(size):
            low_slope -= residual[i] * step[i]
        enough = 1e-2 * abs(low_slope)
        side = 0
        for line in range(LINE_LIMIT):
            for i in range(size):
                trial[i] = v[i] - fraction * step[i]
            _residual(a, b, trial, h, laws, contacts, first, residual)
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
            if line < BISECT_FROM or line % 2 == 0:
                fraction = (low * high_slope - high * low_slope) / (high_slope - low_slope)
            else:
                fraction = 0.5 * (low + high)
        for i in range(size):
            v[i] = trial[i]
    return left, iteration
