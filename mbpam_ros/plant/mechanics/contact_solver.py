"""The velocities after a step with contacts: Newton's method on a convex function, with an exact line search.

The function has the bounds of friction as they were last found. Each of the first steps takes them anew, from the
normal forces at its start; from then on each function is minimised before they are. Where all contacts stick they make
no difference. The fixed point is the solution with Coulomb's cone of the same step's normal forces (J. Haslinger et
al., "Solution of variational inequalities in mechanics", 1988).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.contact_law import (
    Contacts,
    bounds_hold,
    contact_force,
    contact_slope,
    equations_of,
    law_of,
)
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array, Vector, cross

NEWTON_LIMIT = 200
LINE_LIMIT = 40
BISECT_FROM = 5
"""Trials along one of Newton's steps after which every other one halves what is left of it. Where a contact closes
further along, the slope is next to nothing before it and huge beyond: false position alone creeps toward it."""
VELOCITY_TOLERANCE = 1e-8
"""Largest residual over diagonal [m/s or rad/s] at which the velocities are found."""
BOUND_TOLERANCE = 5e-4
"""What the bound of a contact that slips may be off by, over itself."""
MINIMISE_FROM = 8
"""Newton's steps after which bounds are taken anew only at a minimum."""
RELAX_FROM, FALL_FROM = 4, 8
"""Minima after which they go half of the way, and only down: where friction pushes what it rubs on into itself, or away
from it, there may be no fixed point, and the cone is kept from inside."""


@kernel
def solve_in_place(a: Array, b: Array, first: NDArray[np.int64], begin: int, end: int) -> bool:
    """Solve rows ``begin`` to ``end`` of a x = b for a symmetric positive definite a; x ends in b. False if it is none.

    L D L^T inside the envelope: row i is zero before column ``first[i]``, and so is that of L. Only the lower half of a
    is read, and overwritten by L and the inverse of D.
    """
    for i in range(begin, end):
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
    for i in range(begin, end):
        b[i] *= a[i, i]
    for i in range(end - 1, begin - 1, -1):
        for k in range(first[i], i):
            b[k] -= a[i, k] * b[i]
    return True


class Scratch(NamedTuple):
    """Room for the solution of one island: of bodies that touch each other, and their n equations one after another.

    Args:
        island: of each body, the lowest number of a body in it; -1 for a body that touches nothing, shape (bodies,).
        place: of each body, its first equation among those of the island, shape (bodies,).
        rows: place of each equation in the system, shape (n,).
        members: rows of the table of contacts, shape (contacts,).
        a, hessian: shapes (n, n).
        v, smooth, pull, residual, step: velocities, a v - b, a times the step, what is left of the equations, and
            Newton's step, (n,).
        slope, trial: of one contact, shapes (2, 3, 3) and (6,).
        first: the envelope of the equations, shape (n,).
    """

    island: NDArray[np.int64]
    place: NDArray[np.int64]
    rows: NDArray[np.int64]
    members: NDArray[np.int64]
    a: Array
    hessian: Array
    v: Array
    smooth: Array
    pull: Array
    residual: Array
    step: Array
    slope: Array
    trial: Array
    first: NDArray[np.int64]


def scratch(size: int, bodies: int, contacts: int) -> Scratch:
    """Return room for ``size`` equations of so many bodies, the fingers first, and contacts."""
    island, place, rows, members, first = (np.zeros(n, np.int64) for n in (bodies, bodies, size, contacts, size))
    v, smooth, pull, residual, step = (np.empty(size) for _ in range(5))
    a, hessian, slope, trial = np.empty((size, size)), np.empty((size, size)), np.empty((2, 3, 3)), np.empty(6)
    return Scratch(island, place, rows, members, a, hessian, v, smooth, pull, residual, step, slope, trial, first)


@kernel
def find_islands(contacts: Contacts, bodies: int, island: NDArray[np.int64]) -> None:
    """Write the island of each body."""
    for body in range(bodies):
        island[body] = -1
    for c in range(contacts.count[0]):
        one, other = _bodies(contacts, c)
        for body in (one, other):
            if island[body] < 0:
                island[body] = body
        low, high = min(island[one], island[other]), max(island[one], island[other])
        if low < high:
            for body in range(bodies):
                if island[body] == high:
                    island[body] = low


@kernel
def _bodies(contacts: Contacts, c: int) -> tuple[int, int]:
    """Return the two bodies of a contact, the lower number first; one twice where it touches what is no body."""
    one, other = contacts.one[c], contacts.other[c]
    return (one if one >= 0 else other), (other if other >= 0 else one)


@kernel
def _gather(a: Array, contacts: Contacts, label: int, room: Scratch) -> tuple[int, int]:
    """Write what equations and contacts an island has, their envelope and a; return how many of each."""
    n, count, first = 0, 0, room.first
    for body in range(room.island.shape[0]):
        if room.island[body] == label:
            room.place[body] = n
            begin, end = equations_of(body, contacts.fingers, contacts.coordinates)
            for i in range(end - begin):
                room.rows[n + i], first[n + i] = begin + i, n
            n += end - begin
    for c in range(contacts.count[0]):
        one, other = _bodies(contacts, c)
        if room.island[one] == label:
            room.members[count] = c
            count += 1
            start = room.place[other]
            if room.place[one] < first[start]:
                begin, end = equations_of(other, contacts.fingers, contacts.coordinates)
                for i in range(start, start + end - begin):
                    first[i] = room.place[one]
    for i in range(n):
        for j in range(first[i], i + 1):
            room.a[i, j] = a[room.rows[i], room.rows[j]]
    return n, count


@kernel
def _columns(contacts: Contacts, c: int, room: Scratch) -> tuple[int, int, int, int, int]:
    """Return where the rows of J^T begin, change to the other body and end, and what to add to them in the island.

    Two sums: for the rows of one body, and for those of the other.
    """
    fingers, coordinates, one, other = contacts.fingers, contacts.coordinates, contacts.one[c], contacts.other[c]
    split = coordinates if one < fingers else 6
    stop = split if other < 0 else split + (coordinates if other < fingers else 6)
    return (0 if one >= 0 else split), split, stop, room.place[max(one, 0)], room.place[max(other, 0)] - split


@kernel
def _product(a: Array, n: int, v: Array, first: NDArray[np.int64], product: Array) -> None:
    """Write a v of the first n equations, of the lower half of a inside the envelope."""
    for i in range(n):
        total = a[i, i] * v[i]
        for j in range(first[i], i):
            total += a[i, j] * v[j]
            product[j] += a[i, j] * v[i]
        product[i] = total


@kernel
def _relative(contacts: Contacts, count: int, room: Scratch, v: Array, relative: Array) -> None:
    """Write J v of the island's contacts, into rows of shape (6,)."""
    jacobian = contacts.jacobian
    for member in range(count):
        c = room.members[member]
        start, split, stop, one, other = _columns(contacts, c, room)
        x, y, z, turn_x, turn_y, turn_z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(start, stop):
            rate = v[one + j if j < split else other + j]
            x, y, z = x + jacobian[c, j, 0] * rate, y + jacobian[c, j, 1] * rate, z + jacobian[c, j, 2] * rate
            turn_x, turn_y, turn_z = (
                turn_x + jacobian[c, j, 3] * rate,
                turn_y + jacobian[c, j, 4] * rate,
                turn_z + jacobian[c, j, 5] * rate,
            )
        relative[c, 0], relative[c, 1], relative[c, 2] = x, y, z
        relative[c, 3], relative[c, 4], relative[c, 5] = turn_x, turn_y, turn_z


@kernel(forceinline=True)
def _push(h: float, laws: Array, contacts: Contacts, count: int, room: Scratch, fraction: float) -> float:
    """Write the forces at the velocities less ``fraction`` of their change; return their power in the change."""
    velocity, change, force, trial, power = contacts.velocity, contacts.change, contacts.force, room.trial, 0.0
    for member in range(count):
        c = room.members[member]
        for i in range(6):
            trial[i] = velocity[c, i] - fraction * change[c, i]
        contacts.push[c] = contact_force(
            law_of(laws, contacts.kind[c]), h, contacts.depth[c], contacts.share[c], contacts.load[c],
            contacts.normal[c], contacts.springs[c], trial, force[c],
        )  # fmt: skip
        for i in range(6):
            power += force[c, i] * change[c, i]
    return power


@kernel
def _residual(n: int, h: float, contacts: Contacts, count: int, room: Scratch) -> None:
    """Write a v - b - h sum J^T F of the smooth part a v - b and the forces in the table."""
    jacobian, force, residual = contacts.jacobian, contacts.force, room.residual
    for i in range(n):
        residual[i] = room.smooth[i]
    for member in range(count):
        c = room.members[member]
        start, split, stop, one, other = _columns(contacts, c, room)
        x, y, z = h * force[c, 0], h * force[c, 1], h * force[c, 2]
        turn_x, turn_y, turn_z = h * force[c, 3], h * force[c, 4], h * force[c, 5]
        for j in range(start, stop):
            residual[one + j if j < split else other + j] -= (
                jacobian[c, j, 0] * x + jacobian[c, j, 1] * y + jacobian[c, j, 2] * z
                + jacobian[c, j, 3] * turn_x + jacobian[c, j, 4] * turn_y + jacobian[c, j, 5] * turn_z
            )  # fmt: skip


@kernel
def _add_object(
    stiff: tuple[Vector, Vector, Vector], turning: tuple[Vector, Vector, Vector], arm: Vector, o: int, hessian: Array
) -> None:
    """Add to the object's own block, from o on, of the slopes at the arm from its centre; only its lower half.

    Forces there have the moment arm x force about the centre, and turning makes it move by turning x arm.
    """
    x, y, z = cross(arm, stiff[0]), cross(arm, stiff[1]), cross(arm, stiff[2])  # moments of unit velocities
    for i in range(3):
        for j in range(i + 1):
            hessian[o + i, o + j] += stiff[i][j]
        hessian[o + 3 + i, o] += x[i]
        hessian[o + 3 + i, o + 1] += y[i]
        hessian[o + 3 + i, o + 2] += z[i]
        around = cross(arm, (x[i], y[i], z[i]))
        for j in range(i + 1):
            hessian[o + 3 + i, o + 3 + j] += around[j] + turning[i][j]


@kernel
def _hessian(n: int, h: float, laws: Array, contacts: Contacts, count: int, room: Scratch) -> None:
    """Write the derivative of the residual; only its lower half.

    An object's columns of J are those of a rigid body: they are not multiplied out, but for two objects on each other.
    """
    fingers, jacobian = contacts.fingers, contacts.jacobian
    hessian, slope, first = room.hessian, room.slope, room.first
    for i in range(n):
        for j in range(first[i], i + 1):
            hessian[i, j] = room.a[i, j]
    for member in range(count):
        c = room.members[member]
        contact_slope(
            law_of(laws, contacts.kind[c]), h, contacts.depth[c], contacts.share[c], contacts.load[c],
            contacts.normal[c], contacts.springs[c], contacts.velocity[c], slope,
        )  # fmt: skip
        start, split, stop, one, other = _columns(contacts, c, room)
        vxx, vxy, vxz = h * slope[0, 0, 0], h * slope[0, 0, 1], h * slope[0, 0, 2]
        vyy, vyz, vzz = h * slope[0, 1, 1], h * slope[0, 1, 2], h * slope[0, 2, 2]
        wxx, wxy, wxz = h * slope[1, 0, 0], h * slope[1, 0, 1], h * slope[1, 0, 2]
        wyy, wyz, wzz = h * slope[1, 1, 1], h * slope[1, 1, 2], h * slope[1, 2, 2]
        on_object = contacts.other[c] >= fingers > contacts.one[c]  # and on no other one
        o, arm = other + split, (0.0, 0.0, 0.0)
        if on_object:
            arm = (  # as the search wrote it into the columns of turning
                jacobian[c, split + 5, 1],
                jacobian[c, split + 3, 2],
                jacobian[c, split + 4, 0],
            )
            stiff = ((vxx, vxy, vxz), (vxy, vyy, vyz), (vxz, vyz, vzz))
            turning = ((wxx, wxy, wxz), (wxy, wyy, wyz), (wxz, wyz, wzz))
            _add_object(stiff, turning, arm, o, hessian)
        for i in range(start, split if on_object else stop):
            row = one + i if i < split else other + i
            x, y, z = jacobian[c, i, 0], jacobian[c, i, 1], jacobian[c, i, 2]
            x, y, z = vxx * x + vxy * y + vxz * z, vxy * x + vyy * y + vyz * z, vxz * x + vyz * y + vzz * z
            p, q, r = jacobian[c, i, 3], jacobian[c, i, 4], jacobian[c, i, 5]
            p, q, r = wxx * p + wxy * q + wxz * r, wxy * p + wyy * q + wyz * r, wxz * p + wyz * q + wzz * r
            if on_object:
                moment = cross(arm, (x, y, z))
                hessian[o, row] += x
                hessian[o + 1, row] += y
                hessian[o + 2, row] += z
                hessian[o + 3, row] += moment[0] + p
                hessian[o + 4, row] += moment[1] + q
                hessian[o + 5, row] += moment[2] + r
            for j in range(start, min(i + 1, split)):
                hessian[row, one + j] += (
                    x * jacobian[c, j, 0] + y * jacobian[c, j, 1] + z * jacobian[c, j, 2]
                    + p * jacobian[c, j, 3] + q * jacobian[c, j, 4] + r * jacobian[c, j, 5]
                )  # fmt: skip
            for j in range(split, i + 1):
                hessian[row, other + j] += (
                    x * jacobian[c, j, 0] + y * jacobian[c, j, 1] + z * jacobian[c, j, 2]
                    + p * jacobian[c, j, 3] + q * jacobian[c, j, 4] + r * jacobian[c, j, 5]
                )  # fmt: skip


@kernel
def _take_bounds(contacts: Contacts, count: int, room: Scratch, share: float, falling: bool) -> None:
    """Let the bounds go by ``share`` of the way to those of the normal forces found; if ``falling``, only down."""
    for member in range(count):
        c = room.members[member]
        if falling and contacts.push[c] > contacts.load[c]:
            continue
        contacts.load[c] = share * contacts.push[c] + (1.0 - share) * contacts.load[c]


@kernel
def _bounds_hold(h: float, laws: Array, contacts: Contacts, count: int, room: Scratch, below: bool) -> bool:
    for member in range(count):
        c = room.members[member]
        if not bounds_hold(
            law_of(laws, contacts.kind[c]), h, contacts.depth[c], contacts.share[c], contacts.load[c],
            contacts.normal[c], contacts.springs[c], contacts.velocity[c], contacts.push[c], BOUND_TOLERANCE, below,
        ):  # fmt: skip
            return False
    return True


@kernel
def solve_contacts(
    a: Array, b: Array, v: Array, label: int, h: float, laws: Array, contacts: Contacts, room: Scratch
) -> tuple[float, int]:
    """Solve a v = b + h sum J^T F(J v) for the v of an island, from v; the table then has its forces.

    Along one of Newton's steps all but the forces is linear, so a trial there costs these only. Of a, only what is in
    the blocks of the bodies is read. Returns what is left, the largest |residual_i| / a_ii [m/s or rad/s], and how many
    steps it took.
    """
    velocity, change, first = contacts.velocity, contacts.change, room.first
    own, smooth, pull, residual, step = room.v, room.smooth, room.pull, room.residual, room.step
    n, count = _gather(a, contacts, label, room)
    for i in range(n):
        own[i] = v[room.rows[i]]
    _product(room.a, n, own, first, smooth)
    for i in range(n):
        smooth[i] -= b[room.rows[i]]
    _relative(contacts, count, room, own, velocity)
    for member in range(count):
        c = room.members[member]
        velocity[c, 2] += contacts.rise[c]
        contacts.load[c] = -1.0
        for i in range(6):
            change[c, i] = 0.0
    _push(h, laws, contacts, count, room, 0.0)
    _take_bounds(contacts, count, room, 1.0, False)
    left, minima = np.inf, 0
    for iteration in range(NEWTON_LIMIT + 1):
        _residual(n, h, contacts, count, room)
        left = 0.0
        for i in range(n):
            left = max(left, abs(residual[i]) / room.a[i, i])
        minimal = left <= VELOCITY_TOLERANCE
        last = iteration == NEWTON_LIMIT
        if (minimal or last) and _bounds_hold(h, laws, contacts, count, room, minima >= FALL_FROM):
            break
        if last or not left < np.inf:
            return np.inf, iteration
        if minimal or 0 < iteration < MINIMISE_FROM:
            minima += 1 if minimal else 0
            _take_bounds(contacts, count, room, 0.5 if RELAX_FROM <= minima < FALL_FROM else 1.0, minima > FALL_FROM)
            _push(h, laws, contacts, count, room, 0.0)
            _residual(n, h, contacts, count, room)
        _hessian(n, h, laws, contacts, count, room)
        for i in range(n):
            step[i] = residual[i]
        if not solve_in_place(room.hessian, step, first, 0, n):
            return np.inf, iteration
        _product(room.a, n, step, first, pull)
        _relative(contacts, count, room, step, change)
        # The function's slope along the step rises from below zero: seek its root, if that is before 1 (Illinois).
        low, high, low_slope, high_slope, fraction = 0.0, 1.0, 0.0, 0.0, 1.0
        smooth_slope, smooth_rise = 0.0, 0.0
        for i in range(n):
            low_slope -= residual[i] * step[i]
            smooth_slope -= smooth[i] * step[i]
            smooth_rise += pull[i] * step[i]
        enough = 1e-2 * abs(low_slope)
        side, taken = 0, fraction
        for line in range(LINE_LIMIT):
            taken = fraction
            here = smooth_slope + taken * smooth_rise + h * _push(h, laws, contacts, count, room, taken)
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
        for i in range(n):
            own[i] -= taken * step[i]
            smooth[i] -= taken * pull[i]
        for member in range(count):
            c = room.members[member]
            for i in range(6):
                velocity[c, i] -= taken * change[c, i]
    for i in range(n):
        v[room.rows[i]] = own[i]
    return left, iteration
