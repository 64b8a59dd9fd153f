r"""Four muscles and one rigid object: the coupled step, compiled.

Unknowns: the velocities v after a sub-step, 8 bend rates and (with an object) its linear and angular velocity, 14 in
all. Each muscle, with k = B / L and the evaluation point theta:

    M (v - v0) / h = M0 - k (beta + theta h v_theta) - eta k v_theta + load + J_c^T F
    v_theta = (1 - theta) v0 + theta v

theta = 1/2 for a body that touches nothing (implicit midpoint, second order: M, load and velocity terms are taken at
the midpoint by a second pass) and 1 for one in contact (first order, and damped where the penalty is stiff).

Stability: elastic, damping and contact terms are implicit, so neither k, eta nor the contact stiffness limits the
step; gravity and velocity terms are explicit and ask for h sqrt(g / l) < 1 and h |beta rate| < 1, which 10 ms meet.
Contact points, normals and friction loads are those at the start of the sub-step; it is this that sets the error in
contact.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.plant.contact import Contacts
from mbpam_ros.plant.contact_search import (
    FINGER_OBJECT,
    FINGER_SUPPORT,
    OBJECT_PALM,
    OBJECT_SUPPORT,
    Surroundings,
    find_contacts,
)
from mbpam_ros.plant.contact_solver import solve_contacts, solve_in_place
from mbpam_ros.plant.finger import Muscle, inertia_and_load

Array = NDArray[np.float64]

OK, NOT_FINITE, ABSURD, NOT_SOLVED = 0, 1, 2, 3
"""What a step answers."""

SOLVED_M_S = 1e-4
"""What may be left of the contact equations."""


class State(NamedTuple):
    """Bends (8,), their rates and the object's linear and angular velocity (8,) or (14,), its position, orientation."""

    bend: Array
    velocity: Array
    position: Array
    orientation: Array


class Drive(NamedTuple):
    """What moves the muscles.

    Args:
        moments, stiffnesses: at the start and the end, shapes (2, 4, 2) and (2, 4); linear between them.
        heights, rates: of the hand at the ends of all sub-steps, shape (n + 1,).
    """

    moments: Array
    stiffnesses: Array
    heights: Array
    rates: Array


class System(NamedTuple):
    """What does not change.

    Args:
        step_s: length of a sub-step.
        gravity: along +z.
        bases: clamp points, shape (4, 3).
        muscle, nodes, retardation: lengths, point masses and damping over stiffness of a muscle.
        mass, inertia: of the object, about its own axes, shape (3,).
        surroundings: what muscles may touch.
        laws: of contact, one row a kind.
    """

    step_s: float
    gravity: float
    bases: Array
    muscle: Muscle
    nodes: Array
    retardation: float
    mass: float
    inertia: Array
    surroundings: Surroundings
    laws: Array


class Forces(NamedTuple):
    """Forces on the object after a step: of the fingers (4, 3), of its support (3,) and of the palm (3,)."""

    finger: Array
    support: Array
    palm: Array


@njit
def rotation_matrix(q: Array, r: Array) -> None:
    """Write the rotation of the quaternion (x, y, z, w) into r (3, 3)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@njit
def turned(q: Array, wx: float, wy: float, wz: float, result: Array) -> None:
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
def _muscle_equations(
    state: State, start: Array, system: System, drive: Drive, blend: float, gravity: float, theta: Array, share: float,
    a: Array, b: Array,
) -> None:  # fmt: skip
    """Write the muscles' rows of a v = b; masses and loads after ``share`` of the step."""
    h = system.step_s
    for f in range(system.bases.shape[0]):
        x, y = 2 * f, 2 * f + 1
        vx = (1.0 - share) * start[x] + share * state.velocity[x]
        vy = (1.0 - share) * start[y] + share * state.velocity[y]
        mxx, mxy, myy, qx, qy = inertia_and_load(
            state.bend[x] + 0.5 * h * vx, state.bend[y] + 0.5 * h * vy, vx, vy, system.muscle, system.nodes, gravity
        )
        k = ((1.0 - blend) * drive.stiffnesses[0, f] + blend * drive.stiffnesses[1, f]) / system.muscle.active_length
        t = theta[f]
        implicit = h * k * (t * system.retardation + t * t * h)
        a[x, x], a[x, y], a[y, x], a[y, y] = mxx + implicit, mxy, mxy, myy + implicit
        explicit = h * k * ((1.0 - t) * system.retardation + t * (1.0 - t) * h)
        for i in range(2):
            moment = (1.0 - blend) * drive.moments[0, f, i] + blend * drive.moments[1, f, i]
            load = qx if i == 0 else qy
            b[x + i] = h * (moment - k * state.bend[x + i] + load) - explicit * start[x + i]
        b[x] += mxx * start[x] + mxy * start[y]
        b[y] += mxy * start[x] + myy * start[y]


@njit
def _object_equations(
    state: State, start: Array, system: System, share: float, rotation: Array, middle: Array, a: Array, b: Array
) -> None:
    """Write the object's rows of a v = b; its inertia and velocity terms after ``share`` of the step."""
    h = system.step_s
    wx = (1.0 - share) * start[11] + share * state.velocity[11]
    wy = (1.0 - share) * start[12] + share * state.velocity[12]
    wz = (1.0 - share) * start[13] + share * state.velocity[13]
    turned(state.orientation, 0.5 * h * wx, 0.5 * h * wy, 0.5 * h * wz, middle)
    rotation_matrix(middle, rotation)
    for i in range(3):
        a[8 + i, 8 + i] = system.mass
        b[8 + i] = system.mass * (start[8 + i] + (h * system.gravity if i == 2 else 0.0))
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += rotation[i, k] * system.inertia[k] * rotation[j, k]
            a[11 + i, 11 + j] = total
    lx = a[11, 11] * wx + a[11, 12] * wy + a[11, 13] * wz
    ly = a[12, 11] * wx + a[12, 12] * wy + a[12, 13] * wz
    lz = a[13, 11] * wx + a[13, 12] * wy + a[13, 13] * wz
    b[11], b[12], b[13] = -h * (wy * lz - wz * ly), -h * (wz * lx - wx * lz), -h * (wx * ly - wy * lx)
    for i in range(11, 14):
        for j in range(11, 14):
            b[i] += a[i, j] * start[j]


@njit
def _move(state: State, start: Array, h: float, theta: Array, turn: Array) -> int:
    """Move bends and object by the velocities; return OK or what went wrong."""
    bend, v = state.bend, state.velocity
    for i in range(v.shape[0]):
        if not math.isfinite(v[i]):
            return NOT_FINITE
        if abs(v[i]) > (500.0 if i < 8 else (50.0 if i < 11 else 1000.0)):
            return ABSURD
    for i in range(bend.shape[0]):
        t = theta[i // 2]
        bend[i] += h * ((1.0 - t) * start[i] + t * v[i])
        if abs(bend[i]) > 6.0:
            return ABSURD
    if v.shape[0] > bend.shape[0]:
        t = theta[-1]
        for i in range(6):
            way = h * ((1.0 - t) * start[8 + i] + t * v[8 + i])
            if i < 3:
                state.position[i] += way
            else:
                turn[i - 3] = way
        turned(state.orientation, turn[0], turn[1], turn[2], state.orientation)
    return OK


@njit
def _sum_forces(contacts: Contacts, forces: Forces) -> None:
    forces.finger[:] = 0.0
    forces.support[:] = 0.0
    forces.palm[:] = 0.0
    for c in range(contacts.count[0]):
        for i in range(3):
            if contacts.kind[c] == FINGER_OBJECT:
                forces.finger[contacts.finger[c], i] += contacts.force[c, i]
            elif contacts.kind[c] == OBJECT_SUPPORT:
                forces.support[i] += contacts.force[c, i]
            elif contacts.kind[c] == OBJECT_PALM:
                forces.palm[i] += contacts.force[c, i]


@njit(inline="always")  # compiled as part of its one caller only
def _advance(state: State, drive: Drive, system: System, contacts: Contacts, forces: Forces) -> tuple[int, int]:
    """Advance the state in place by all sub-steps; return OK or what went wrong, and the most Newton steps."""
    steps, size, fingers = drive.heights.shape[0] - 1, state.velocity.shape[0], system.bases.shape[0]
    h, around, v = system.step_s, system.surroundings, state.velocity
    a, b, start = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    theta, rotation, middle, turn = np.empty(fingers + 1), np.eye(3), np.zeros(4), np.zeros(3)
    iterations = 0
    contacts.count[0] = 0
    for step in range(steps):
        for i in range(size):
            start[i] = v[i]
        if around.shape >= 0 or around.table_in_reach:
            rotation_matrix(state.orientation, rotation)
            find_contacts(
                state.bend, system.bases, system.muscle, around, state.position, rotation, drive.heights[step],
                drive.rates[step + 1], contacts,
            )  # fmt: skip
        touching = contacts.count[0] > 0
        theta[:] = 0.5
        for c in range(contacts.count[0]):
            theta[contacts.finger[c]] = 1.0  # -1, none: the object's, which is the last
            if contacts.kind[c] != FINGER_SUPPORT:
                theta[fingers] = 1.0
        blend = (step + 0.5) / steps
        gravity = system.gravity + (drive.rates[step + 1] - drive.rates[step]) / h
        # The second sweep takes masses and loads at the midpoint the first one found; in contact one is as good.
        for sweep in range(1 if touching else 2):
            _muscle_equations(state, start, system, drive, blend, gravity, theta, 0.5 * sweep, a, b)
            if size > 2 * fingers:
                _object_equations(state, start, system, 0.5 * sweep, rotation, middle, a, b)
            if touching:
                left, count = solve_contacts(a, b, v, h, system.laws, contacts)
                iterations = max(iterations, count)
                if not left < SOLVED_M_S:
                    return NOT_SOLVED, iterations
            else:
                for i in range(size):
                    v[i] = b[i]
                if not solve_in_place(a, v):
                    return NOT_FINITE, iterations
        answer = _move(state, start, h, theta, turn)
        if answer != OK:
            return answer, iterations
    _sum_forces(contacts, forces)
    return OK, iterations


def _cached(source_digest: int) -> Callable[[State, Drive, System, Contacts, Forces], tuple[int, int]]:
    """Compile ``_advance`` into the cache on disk.

    The cache only watches the file of the cached function. A digest of all sources it is built from, being part of
    the closure, is part of the cache's key: no stale machine code after an edit of another file.
    """

    @njit(cache=True)
    def advance(state: State, drive: Drive, system: System, contacts: Contacts, forces: Forces) -> tuple[int, int]:
        if source_digest < 0:
            return NOT_SOLVED, 0
        return _advance(state, drive, system, contacts, forces)

    return advance


def _source_digest() -> int:
    digest = 0
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest = zlib.crc32(source.read_bytes(), digest)
    return digest


advance = _cached(_source_digest())
