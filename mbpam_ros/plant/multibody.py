# ruff: noqa: ANN001, ANN201  (compiled functions: numba infers the types)
r"""Four muscles and one rigid object: the coupled step, compiled.

Unknowns: the velocities v after a sub-step, 8 bend rates and (with an object) its linear and angular velocity, 14 in
all. Each muscle, with k = B / L and the evaluation point theta:

    M (v - v0) / h = M0 - k (beta + theta h v_theta) - eta k v_theta + load + J_c^T F
    v_theta = (1 - theta) v0 + theta v

theta = 1/2 for a body that touches nothing (implicit midpoint, second order: M, load and velocity terms are taken at
the midpoint by a second pass) and 1 for one in contact (first order, and damped where the penalty is stiff).

Stability: elastic, damping and contact terms are implicit, so neither k, eta nor the contact stiffness limits the
step; gravity and velocity terms are explicit and ask for h sqrt(g / l) < 1 and h |beta rate| < 1, which 10 ms meet.
Contact points and normals are those at the start of the sub-step; it is this that sets the error in contact.

The contact equations are solved by Newton's method on the velocities. Where a full step does not halve the residual,
friction is held at its present normal load: what is left is the gradient of a convex function of the velocities, whose
Newton step with an exact line search goes down, but may stall where sticking turns to slip, and loads and slip may
chase each other (jamming). After NEWTON_LIMIT iterations the loads are held at their running mean and every other step
takes the secant of friction, which is never less than its slope. What is then left above SOLVED_M_S is an error.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from mbpam_ros.plant.contact import deepest_near, force_law, force_slope, may_touch, sample_distances
from mbpam_ros.plant.finger import STATIONS, inertia_and_load, station_jacobian
from mbpam_ros.plant.shapes import PLANE, REST_POINTS, rest_points

FINGER_OBJECT, OBJECT_SUPPORT, FINGER_SUPPORT, OBJECT_PALM = 0, 1, 2, 3
"""Rows of the table of contact laws."""

OK, NOT_FINITE, ABSURD, NOT_SOLVED = 0, 1, 2, 3
"""What a step answers."""

FINGER_POINTS = 3
"""The most points at which one finger touches one solid: each local minimum of the distance is one."""

MAX_CONTACTS = 8 * FINGER_POINTS + 3 * REST_POINTS
PLATE_THICKNESS_M = 0.010
"""A support with a footprint is a plate: what is deeper than this below its top has gone past its edge."""

NEWTON_LIMIT = 60
VELOCITY_TOLERANCE = 1e-8
SOLVED_M_S = 1e-4


@njit
def rotation_matrix(q, r):
    """Write the rotation of the quaternion (x, y, z, w) into r (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@njit
def turned(q, wx, wy, wz, result):
    """Write exp((wx, wy, wz)) q, normalised, into ``result``; the turning vector is in the world frame."""
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    scale = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    a, b, c, d = scale * wx, scale * wy, scale * wz, math.cos(0.5 * angle)
    x, y, z, w = q[0], q[1], q[2], q[3]
    rx = d * x + a * w + b * z - c * y
    ry = d * y - a * z + b * w + c * x
    rz = d * z + a * y - b * x + c * w
    rw = d * w - a * x - b * y - c * z
    norm = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz + rw * rw)
    result[0], result[1], result[2], result[3] = rx * norm, ry * norm, rz * norm, rw * norm


@njit
def solve_in_place(a, b, n):
    """Solve a x = b by elimination with row pivots; x ends in b. Returns False if a is singular."""
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[p, k]):
                p = i
        if not abs(a[p, k]) > 0.0:
            return False
        if p != k:
            for j in range(k, n):
                a[k, j], a[p, j] = a[p, j], a[k, j]
            b[k], b[p] = b[p], b[k]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            factor = a[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    a[i, j] -= factor * a[k, j]
                b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= a[k, j] * b[j]
        b[k] /= a[k, k]
    return True


@njit
def object_columns(point, centre, jacobian):
    """Write the velocity at ``point`` of a body at ``centre`` into columns 2 to 7 of ``jacobian`` (6, 8)."""
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    for i in range(3):
        jacobian[i, 2 + i] = 1.0
        jacobian[3 + i, 5 + i] = 1.0
    jacobian[0, 6], jacobian[0, 7] = z, -y
    jacobian[1, 5], jacobian[1, 7] = -z, x
    jacobian[2, 5], jacobian[2, 6] = y, -x


@njit
def finger_columns(bend, f, muscle, s, arm, sign, scratch, jacobian):
    """Write sign times the velocity of finger f's material at ``arm`` from its centreline into columns 0 and 1."""
    station_jacobian(bend[2 * f], bend[2 * f + 1], muscle, s, scratch)
    for j in range(2):
        wx, wy, wz = scratch[3, j], scratch[4, j], scratch[5, j]
        jacobian[0, j] = sign * (scratch[0, j] + wy * arm[2] - wz * arm[1])
        jacobian[1, j] = sign * (scratch[1, j] + wz * arm[0] - wx * arm[2])
        jacobian[2, j] = sign * (scratch[2, j] + wx * arm[1] - wy * arm[0])
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = sign * wx, sign * wy, sign * wz


@njit
def find_contacts(
    bend, bases, lift, muscle, body, half, centre, rotation, planes, reach_planes, hand_velocity,
    depth, normal, jacobian, offset, finger, kind,
):  # fmt: skip
    """Fill the contact tables from the configuration at the start of a sub-step; return how many contacts there are.

    ``finger`` is -1 where none takes part; columns of ``jacobian`` are the finger's two, then the object's six.
    """
    n = 0
    point, arm, base, scratch = np.empty(3), np.empty(3), np.empty(3), np.empty((6, 2))
    points, level, plane_centre, found = np.empty((REST_POINTS, 3)), np.eye(3), np.zeros(3), np.empty(7)
    distances = np.empty(STATIONS)
    if reach_planes:
        plane_centre[2] = planes[-1, 0]
    for f in range(bases.shape[0]):
        base[0], base[1], base[2] = bases[f, 0], bases[f, 1], bases[f, 2] - lift
        for target in range(2):  # the object, the table
            on_object = target == 0
            if (on_object and body < 0) or not (on_object or reach_planes):
                continue
            solid = body if on_object else PLANE
            place, turn = (centre, rotation) if on_object else (plane_centre, level)
            bx, by = bend[2 * f], bend[2 * f + 1]
            spacing = sample_distances(bx, by, muscle, base, solid, half, place, turn, found, distances)
            points_here = 0
            for k in range(STATIONS):
                if points_here == FINGER_POINTS or not may_touch(distances, k, muscle[2], spacing):
                    continue
                d, s = deepest_near(bx, by, muscle, base, solid, half, place, turn, k, spacing, found)
                if d <= 0.0:
                    continue
                for i in range(3):
                    normal[n, i] = -found[4 + i] if on_object else found[4 + i]
                    arm[i] = -0.5 * (found[0] + muscle[2]) * found[4 + i]
                    point[i] = found[1 + i] + arm[i]
                    offset[n, i] = 0.0
                # Velocity of the pushed body less that of the other: minus the finger's, or the finger's on the
                # table. The clamps rise along -z.
                sign = -1.0 if on_object else 1.0
                jacobian[n] = 0.0
                if on_object:
                    object_columns(point, centre, jacobian[n])
                finger_columns(bend, f, muscle, s, arm, sign, scratch, jacobian[n])
                offset[n, 2] = -sign * hand_velocity
                depth[n], finger[n], kind[n] = d, f, FINGER_OBJECT if on_object else FINGER_SUPPORT
                n += 1
                points_here += 1
    if body >= 0:
        for p in range(planes.shape[0]):
            footprint = not math.isinf(planes[p, 1])
            for k in range(rest_points(body, half, centre, rotation, planes[p, 1], planes[p, 2], points)):
                d = points[k, 2] - planes[p, 0]
                if d > 0.0 and not (footprint and d > PLATE_THICKNESS_M):
                    jacobian[n] = 0.0
                    object_columns(points[k], centre, jacobian[n])
                    normal[n, 0], normal[n, 1], normal[n, 2] = 0.0, 0.0, -1.0
                    offset[n, 0], offset[n, 1], offset[n, 2] = 0.0, 0.0, 0.0
                    depth[n], finger[n], kind[n] = d, -1, OBJECT_SUPPORT
                    n += 1
        # The palm above: all solids are symmetric about their centres, so their highest points mirror the lowest.
        for k in range(rest_points(body, half, centre, rotation, np.inf, np.inf, points)):
            for i in range(3):
                points[k, i] = 2.0 * centre[i] - points[k, i]
            d = -lift - points[k, 2]
            if d > 0.0:
                jacobian[n] = 0.0
                object_columns(points[k], centre, jacobian[n])
                normal[n, 0], normal[n, 1], normal[n, 2] = 0.0, 0.0, 1.0
                offset[n, 0], offset[n, 1], offset[n, 2] = 0.0, 0.0, hand_velocity
                depth[n], finger[n], kind[n] = d, -1, OBJECT_PALM
                n += 1
    return n


@njit
def contact_residual(
    a, b, v, size, n, h, laws, depth, normal, jacobian, offset, finger, kind, grip, velocity, force, push, residual
):  # fmt: skip
    """Write r = a v - b - h sum J^T F(J v) and all contact forces; return the largest |r_i| / a_ii [m/s or rad/s].

    ``grip``: normal loads of friction (n,); negative for that of the contact itself.
    """
    for i in range(size):
        total = -b[i]
        for j in range(size):
            total += a[i, j] * v[j]
        residual[i] = total
    for c in range(n):
        first = 0 if finger[c] >= 0 else 2
        last = 2 if kind[c] == FINGER_SUPPORT else 8
        for i in range(6):
            total = offset[c, i] if i < 3 else 0.0
            for j in range(first, last):
                total += jacobian[c, i, j] * v[2 * finger[c] + j if j < 2 else 6 + j]
            velocity[c, i] = total
        push[c] = force_law(laws[kind[c]], depth[c], h, normal[c], velocity[c], grip[c], force[c])
        if push[c] > 0.0 or grip[c] > 0.0:
            for j in range(first, last):
                total = 0.0
                for i in range(6):
                    total += jacobian[c, i, j] * force[c, i]
                residual[2 * finger[c] + j if j < 2 else 6 + j] -= h * total
    worst = 0.0
    for i in range(size):
        worst = max(worst, abs(residual[i]) / a[i, i])
    return worst


@njit
def newton_step(
    a, residual, size, n, h, whole, secant, laws, normal, jacobian, finger, kind, velocity, force, push, load,
    system, slope, product, step,
):  # fmt: skip
    """Write the Newton step (to be subtracted from v) into ``step``; return whether it could be solved for."""
    system[:] = a
    for c in range(n):
        if push[c] <= 0.0 and load[c] <= 0.0:
            continue
        force_slope(laws[kind[c]], h, normal[c], velocity[c], push[c], load[c], force[c], whole, secant, slope)
        first = 0 if finger[c] >= 0 else 2
        last = 2 if kind[c] == FINGER_SUPPORT else 8
        for i in range(6):
            for j in range(first, last):
                total = 0.0
                for k in range(6):
                    total += slope[i, k] * jacobian[c, k, j]
                product[i, j] = h * total
        for i in range(first, last):
            row = 2 * finger[c] + i if i < 2 else 6 + i
            for j in range(first, last):
                total = 0.0
                for k in range(6):
                    total += jacobian[c, k, i] * product[k, j]
                system[row, 2 * finger[c] + j if j < 2 else 6 + j] += total
    step[:] = residual
    return solve_in_place(system, step, size)


@njit
def solve_contacts(a, b, v, size, n, h, laws, depth, normal, jacobian, offset, finger, kind, force):
    """Solve a v = b + h sum J^T F(J v) for v, from v; ``force`` (n, 6) is then F. Return what is left and iterations.

    What is left is the largest |r_i| / a_ii [m/s or rad/s].
    """
    system, slope, product = np.empty((size, size)), np.empty((6, 6)), np.empty((6, 8))
    residual, step, trial = np.empty(size), np.empty(size), np.empty(size)
    velocity, push = np.zeros((n, 6)), np.zeros(n)
    own, grip, load, usual = np.full(n, -1.0), np.empty(n), np.empty(n), np.zeros(n)
    iterations, held, secant = 0, False, False
    while True:
        for attempt in range(1 if held else 0, 2):
            whole = attempt == 0
            worst = contact_residual(
                a, b, v, size, n, h, laws, depth, normal, jacobian, offset, finger, kind, own,
                velocity, force, push, residual,
            )  # fmt: skip
            if (whole or held) and (worst <= VELOCITY_TOLERANCE or iterations >= 2 * NEWTON_LIMIT):
                return worst, iterations
            iterations += 1
            secant = held and not secant  # every other step: Newton's can stall where sticking turns to slip
            for c in range(n):
                usual[c] += 0.3 * (push[c] - usual[c])
                load[c] = own[c] if held else push[c]
                grip[c] = own[c] if whole else load[c]
            if not newton_step(
                a, residual, size, n, h, whole, secant, laws, normal, jacobian, finger, kind, velocity, force, push,
                load, system, slope, product, step,
            ):  # fmt: skip
                return np.inf, iterations
            # Along the step: the slope of the convex function, from below zero at 0; Illinois steps to its root.
            low, high, low_slope, high_slope, side, fraction = 0.0, 1.0, 0.0, 0.0, 0, 1.0
            for i in range(size):
                low_slope -= residual[i] * step[i]
            enough = 1e-3 * abs(low_slope)
            for line in range(10):
                for i in range(size):
                    trial[i] = v[i] - fraction * step[i]
                after = contact_residual(
                    a, b, trial, size, n, h, laws, depth, normal, jacobian, offset, finger, kind, grip,
                    velocity, force, push, residual,
                )  # fmt: skip
                here = 0.0
                for i in range(size):
                    here -= residual[i] * step[i]
                if whole or (line == 0 and here <= 0.0) or abs(here) <= enough:
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
            if after <= 0.5 * worst:
                break
        for i in range(size):
            v[i] = trial[i]
        if iterations >= NEWTON_LIMIT and not held:  # load and slip chase each other: hold the loads at their mean
            held = True
            own[:] = usual


@njit
def _advance(
    bend, v, position, orientation, moments, stiffnesses, heights, rates, h,
    bases, muscle, nodes, retardation, gravity,
    body, half, mass, inertia, planes, reach_planes, laws, finger_force, support_force, palm_force,
):  # fmt: skip
    """Advance the state in place by the sub-steps between ``heights``; return OK or what went wrong, and iterations."""
    steps, size = heights.shape[0] - 1, v.shape[0]
    fingers = bases.shape[0]
    a, b = np.zeros((size, size)), np.zeros(size)
    system, start = np.zeros((size, size)), np.zeros(size)
    theta = np.empty(fingers + 1)
    rotation, inertia_world, mid = np.eye(3), np.zeros((3, 3)), np.zeros(4)
    depth, force = np.zeros(MAX_CONTACTS), np.zeros((MAX_CONTACTS, 6))
    normal, offset = np.zeros((MAX_CONTACTS, 3)), np.zeros((MAX_CONTACTS, 3))
    jacobian = np.zeros((MAX_CONTACTS, 6, 8))
    finger, kind = np.zeros(MAX_CONTACTS, dtype=np.int64), np.zeros(MAX_CONTACTS, dtype=np.int64)
    touchable = body >= 0 or reach_planes
    contacts, iterations = 0, 0

    for step in range(steps):
        start[:] = v
        if touchable:
            if body >= 0:
                rotation_matrix(orientation, rotation)
            contacts = find_contacts(
                bend, bases, heights[step], muscle, body, half, position, rotation, planes, reach_planes,
                rates[step + 1], depth, normal, jacobian, offset, finger, kind,
            )  # fmt: skip
        theta[:] = 0.5
        for c in range(contacts):
            if finger[c] >= 0:
                theta[finger[c]] = 1.0
            if kind[c] != FINGER_SUPPORT:
                theta[fingers] = 1.0
        blend = (step + 0.5) / steps
        apparent = gravity + (rates[step + 1] - rates[step]) / h

        for sweep in range(2):  # the second takes masses and loads at the midpoint the first one found
            a[:] = 0.0
            for f in range(fingers):
                x, y = 2 * f, 2 * f + 1
                share = 0.5 * sweep
                vx, vy = (1.0 - share) * start[x] + share * v[x], (1.0 - share) * start[y] + share * v[y]
                mxx, mxy, myy, qx, qy = inertia_and_load(
                    bend[x] + 0.5 * h * vx, bend[y] + 0.5 * h * vy, vx, vy, muscle, nodes, apparent
                )
                k = ((1.0 - blend) * stiffnesses[0, f] + blend * stiffnesses[1, f]) / muscle[1]
                t = theta[f]
                implicit = h * k * (t * retardation + t * t * h)
                a[x, x], a[x, y], a[y, x], a[y, y] = mxx + implicit, mxy, mxy, myy + implicit
                explicit = h * k * ((1.0 - t) * retardation + t * (1.0 - t) * h)
                for i in range(2):
                    moment = (1.0 - blend) * moments[0, f, i] + blend * moments[1, f, i]
                    load = qx if i == 0 else qy
                    b[x + i] = h * (moment - k * bend[x + i] + load) - explicit * start[x + i]
                b[x] += mxx * start[x] + mxy * start[y]
                b[y] += mxy * start[x] + myy * start[y]
            if body >= 0:
                share = 0.5 * sweep
                wx = (1.0 - share) * start[11] + share * v[11]
                wy = (1.0 - share) * start[12] + share * v[12]
                wz = (1.0 - share) * start[13] + share * v[13]
                turned(orientation, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz, mid)
                rotation_matrix(mid, rotation)
                for i in range(3):
                    a[8 + i, 8 + i] = mass
                    b[8 + i] = mass * start[8 + i] + (h * mass * gravity if i == 2 else 0.0)
                    for j in range(3):
                        total = 0.0
                        for k in range(3):
                            total += rotation[i, k] * inertia[k] * rotation[j, k]
                        inertia_world[i, j] = total
                        a[11 + i, 11 + j] = total
                lx = inertia_world[0, 0] * wx + inertia_world[0, 1] * wy + inertia_world[0, 2] * wz
                ly = inertia_world[1, 0] * wx + inertia_world[1, 1] * wy + inertia_world[1, 2] * wz
                lz = inertia_world[2, 0] * wx + inertia_world[2, 1] * wy + inertia_world[2, 2] * wz
                b[11], b[12], b[13] = -h * (wy * lz - wz * ly), -h * (wz * lx - wx * lz), -h * (wx * ly - wy * lx)
                for i in range(3):
                    for j in range(3):
                        b[11 + i] += inertia_world[i, j] * start[11 + j]
            if contacts == 0:
                system[:] = a
                v[:] = b
                if not solve_in_place(system, v, size):
                    return NOT_FINITE, iterations
                continue

            left, count = solve_contacts(
                a, b, v, size, contacts, h, laws, depth, normal, jacobian, offset, finger, kind, force
            )
            iterations = max(iterations, count)
            if not left < SOLVED_M_S:
                return NOT_SOLVED, iterations
            break  # in contact the scheme is of first order: one sweep
        for f in range(fingers):
            for i in range(2 * f, 2 * f + 2):
                bend[i] += h * ((1.0 - theta[f]) * start[i] + theta[f] * v[i])
        if body >= 0:
            t = theta[fingers]
            for i in range(3):
                position[i] += h * ((1.0 - t) * start[8 + i] + t * v[8 + i])
            turned(
                orientation,
                h * ((1.0 - t) * start[11] + t * v[11]),
                h * ((1.0 - t) * start[12] + t * v[12]),
                h * ((1.0 - t) * start[13] + t * v[13]),
                mid,
            )
            orientation[:] = mid
        for i in range(size):
            if not math.isfinite(v[i]):
                return NOT_FINITE, iterations
        for i in range(2 * fingers):
            if not (abs(bend[i]) < 6.0 and abs(v[i]) < 500.0):
                return ABSURD, iterations
        for i in range(8, size):
            if not abs(v[i]) < (50.0 if i < 11 else 1000.0):
                return ABSURD, iterations

    finger_force[:] = 0.0
    support_force[:] = 0.0
    palm_force[:] = 0.0
    for c in range(contacts):
        for i in range(3):
            if kind[c] == FINGER_OBJECT:
                finger_force[finger[c], i] += force[c, i]
            elif kind[c] == OBJECT_SUPPORT:
                support_force[i] += force[c, i]
            elif kind[c] == OBJECT_PALM:
                palm_force[i] += force[c, i]
    return OK, iterations


def _cached(source_digest: int) -> Callable[..., tuple[int, int]]:
    """Compile ``_advance`` into the cache on disk.

    The cache only watches the file of the cached function. A digest of all sources it is built from, being part of
    the closure, is part of the cache's key: no stale machine code after an edit of another file.
    """

    @njit(cache=True)
    def advance(*arguments):
        if source_digest < 0:
            return NOT_SOLVED, 0
        return _advance(*arguments)

    return advance


def _source_digest() -> int:
    digest = 0
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest = zlib.crc32(source.read_bytes(), digest)
    return digest


advance = _cached(_source_digest())
