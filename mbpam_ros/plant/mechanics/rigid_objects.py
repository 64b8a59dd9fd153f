"""Free rigid objects: where they turn, and their equations of a step."""

from __future__ import annotations

import math

from mbpam_ros.geometry import rotations
from mbpam_ros.plant.mechanics.contact_solver import solve_in_place
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.parts import State, System, Work
from mbpam_ros.plant.mechanics.vectors import Array, Vector, cross, dot, norm, plus, times, vector

FOUND_RAD_S = 1e-9
"""A sweep that changes the velocities by less was the last."""

_rotation_rows, _product = kernel(rotations.rotation_rows), kernel(rotations.product)


@kernel
def write_rotation(q: Array, r: Array) -> None:
    """Write the rotation of the quaternion (x, y, z, w) into r (3, 3)."""
    rows = _rotation_rows(q[0], q[1], q[2], q[3])
    for i in range(3):
        r[i, 0], r[i, 1], r[i, 2] = rows[i]


@kernel
def turned(q: Array, turn: Vector, result: Array) -> None:
    """Write exp(turn) q, normalised, into ``result``; the turning vector is in the world frame."""
    angle = norm(turn)
    scale = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    x, y, z = times(scale, turn)
    rx, ry, rz, rw = _product((x, y, z, math.cos(0.5 * angle)), (q[0], q[1], q[2], q[3]))
    unit = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz + rw * rw)
    result[0], result[1], result[2], result[3] = rx * unit, ry * unit, rz * unit, rw * unit


@kernel
def object_equations(
    state: State, start: Array, system: System, k: int, share: float, rotation: Array, middle: Array, a: Array, b: Array
) -> None:
    """Write the rows of a v = b of object ``k``; its inertia and velocity terms after ``share`` of the step."""
    h, n, inertia = system.step_s, state.shape.shape[0] + 6 * k, system.inertia[k]
    w = plus(times(1.0 - share, vector(start, n + 3)), times(share, vector(state.velocity, n + 3)))
    turned(state.orientation[k], times(0.5 * h, w), middle)
    write_rotation(middle, rotation)
    for i in range(3):
        a[n + i, n + i] = system.masses[k]
        b[n + i] = system.masses[k] * (start[n + i] + h * system.gravity[i])
        for j in range(3):
            total = 0.0
            for m in range(3):
                total += rotation[i, m] * inertia[m] * rotation[j, m]
            a[n + 3 + i, n + 3 + j] = total
    spin = (dot(vector(a[n + 3], n + 3), w), dot(vector(a[n + 4], n + 3), w), dot(vector(a[n + 5], n + 3), w))
    b[n + 3], b[n + 4], b[n + 5] = times(-h, cross(w, spin))
    for i in range(n + 3, n + 6):
        for j in range(n + 3, n + 6):
            b[i] += a[i, j] * start[j]


@kernel
def move_object_freely(state: State, system: System, k: int, work: Work) -> bool:
    """Write the velocities of object ``k``, which touches nothing."""
    velocity, first, n = state.velocity, work.equations.first, state.shape.shape[0] + 6 * k
    for sweep in range(system.sweeps):
        share = 0.5 if sweep > 0 else 0.0
        object_equations(state, work.start, system, k, share, work.rotation[k], work.middle, work.a, work.b)
        for i in range(n, n + 6):
            first[i] = n
        if not solve_in_place(work.a, work.b, first, n, n + 6):
            return False
        changed = 0.0
        for i in range(n, n + 6):
            changed = max(changed, abs(work.b[i] - velocity[i]))
            velocity[i] = work.b[i]
        if changed < FOUND_RAD_S:
            break
    return True
