r"""Four muscles and one rigid object: the coupled step, compiled.

Unknowns: the velocities v after a sub-step, those of the D coordinates q of each muscle
(:mod:`~mbpam_ros.plant.mechanics.rod`) and (with an object) its linear and angular velocity. With the stiffness B and
the active length L, mode i of a muscle's curvature has the stiffness k_i = B / (L (2 i + 1)), the integral of B P_i^2
over the length; M0 acts on mode 0 only. Twist has GJ for B and no moment. Stretch has the energy per length

    EA / 2 (s - 1 - eps_0 - c . kappa)^2       eps_0 and c: what the air does to a free axis

whose slopes by the curvature act on it too; of modes that only one of the two has nothing is counted. All is quadratic
in q at given pressures. Each muscle, with the evaluation point theta:

    M (v - v0) / h = M0 - k (q + theta h v_theta) - eta k v_theta + load + J_c^T F
    v_theta = (1 - theta) v0 + theta v

theta = 1/2 for a body that touches nothing (implicit midpoint, second order: M, load and velocity terms are taken at
the midpoint, which the first sweep finds and the second uses) and 1 for one in contact (first order, and damped where
the penalty is stiff). Sweeps repeated until nothing changes give the implicit midpoint rule itself, which is symmetric
in time: without damping energy swings by O(h^2) and does not drift (of fourth order it is made by
:mod:`~mbpam_ros.plant.mechanics.composition`). With damping the second sweep is the last: what a third one would change
is less than the error of the step.

Stability: elastic, damping and contact terms are implicit, so neither k, eta nor the contact stiffness limits the
step; gravity and velocity terms are explicit and ask for h sqrt(g / l) < 1 and h |dq/dt| < 1, which 10 ms meet.
Contact points and normals are those at the start of the sub-step; it is this that sets the error in contact.

Sweeps go on from what the sub-step before saw at its midpoint, and the contact solution from where the change of the
velocities before leads; both outlast a call, so that a span cut into calls ends as it does in one, to
rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry import rotations, surfaces
from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts, Grip, contact_table, no_grip, recall, remember
from mbpam_ros.plant.mechanics.contact_search import (
    PLATE_THICKNESS_M,
    Places,
    Surroundings,
    find_contacts,
    places,
)
from mbpam_ros.plant.mechanics.contact_solver import Scratch, find_islands, scratch, solve_contacts, solve_in_place
from mbpam_ros.plant.mechanics.finger_contact import Lines, fingers_near, lines, near_ball, write_boxes
from mbpam_ros.plant.mechanics.kernel import entry, kernel, piece
from mbpam_ros.plant.mechanics.lanes import WIDTH, Lanes, Place, all_above, load, splat, store
from mbpam_ros.plant.mechanics.outlook import Outlook
from mbpam_ros.plant.mechanics.packed_arguments import Block, access, new_block
from mbpam_ros.plant.mechanics.rod import (
    LARGEST_STRETCH,
    Motion,
    Rod,
    coordinates_of,
    masses_and_loads,
    motion_at_rest,
    move_rods,
    room_for_loads,
)
from mbpam_ros.plant.mechanics.vectors import Array, Vector, cross, dot, norm, plus, times, vector
from mbpam_ros.source_digest import source_digest

OK, NOT_FINITE, TOO_FAST, NOT_SOLVED, TOO_BENT, TOO_LONG, TOO_DEEP = 0, 1, 2, 3, 4, 5, 6
"""What a step answers."""

LOOKS = 5
"""How often a step may be done again because something moved farther than what was looked for."""

SEEN_LATE_M = 1e-4
"""What may fall into something within a step before it is a contact."""

SOLVED_M_S = 1e-4
"""What may be left of the contact equations."""

FOUND_RAD_S = 1e-9
"""A sweep that changes the velocities by less was the last."""

LARGEST_BEND_RAD = 8.0
"""Beyond it (460 deg) the polynomials between the points of a rod no longer follow its tangents."""


class State(NamedTuple):
    """What moves.

    Args:
        shape: coordinates q of the muscles [rad], shape (4 D,).
        velocity: their rates and, with an object, its linear and angular velocity, shape (4 D,) or (4 D + 6,).
        position, orientation: of the object, shapes (3,) and (4,).
        held, slots, springs: what the springs of the contacts hold, the three of a
            :class:`~mbpam_ros.plant.mechanics.contact_law.Grip`.
    """

    shape: Array
    velocity: Array
    position: Array
    orientation: Array
    held: NDArray[np.int64]
    slots: NDArray[np.int64]
    springs: Array


def new_state(contacts: Contacts, shape: Array, velocity: Array, position: Array, orientation: Array) -> State:
    """Return the state of these arrays; contacts hold nothing yet."""
    return State(shape, velocity, position, orientation, *no_grip(len(contacts.depth)))


class Drive(NamedTuple):
    """What the air does to the muscles: at the start and the end of a call, linear between them.

    Args:
        moments, stiffnesses: M0 and B, shapes (2, 4, 2) and (2, 4).
        torsions: GJ, shape (2, 4); counts where there is twist, as what follows where there is stretch.
        axials, free_stretches: EA and eps_0, shapes (2, 4).
        couplings: c [m], shape (2, 4, 2).
    """

    moments: Array
    stiffnesses: Array
    torsions: Array
    axials: Array
    free_stretches: Array
    couplings: Array


class System(NamedTuple):
    """What does not change.

    Args:
        step_s: length of a sub-step.
        sweeps: the most evaluations of masses and loads in a step in which nothing touches.
        gravity: as a vector, shape (3,).
        bases: clamp points, shape (4, 3).
        rod, retardation: mechanics of a muscle, and its damping over its stiffness.
        mass, inertia: of the object, about its own axes, shape (3,).
        surroundings: what muscles may touch.
        laws: of contact, one row a kind.
    """

    step_s: float
    sweeps: int
    gravity: Array
    bases: Array
    rod: Rod
    retardation: float
    mass: float
    inertia: Array
    surroundings: Surroundings
    laws: Array


class Forces(NamedTuple):
    """Forces after a step.

    Args:
        finger, support, palm: on the object, of the fingers (4, 3), of its support (3,) and of the palm (3,).
        between: on each finger, of the other fingers, shape (4, 3).
    """

    finger: Array
    support: Array
    palm: Array
    between: Array


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


class Room(NamedTuple):
    """Room for the muscles, one a lane (:mod:`~mbpam_ros.plant.mechanics.lanes`).

    Args:
        at, start, velocity: coordinates and rates before the sub-step, and rates after it, shapes (D, 4).
        shape, rate: coordinates and rates of which a sweep sees the muscles, shapes (D, 4).
        load, mass: shapes (D, 4) and (D, D, 4).
        a, b: of a muscle's equations a v = b, shapes (D, D, 4) and (D, 4).
        drive: what the air does in the middle of the sub-step, a row each of :class:`Drive`, x before y, shape (8, 4).
        theta: shape (1, 4).
        work: of ``masses_and_loads``.
    """

    at: Array
    start: Array
    velocity: Array
    shape: Array
    rate: Array
    load: Array
    mass: Array
    a: Array
    b: Array
    drive: Array
    theta: Array
    work: Array


def room_of(rod: Rod) -> Room:
    """Return the room for muscles with this rod."""
    columns = coordinates_of(rod)
    line, square = (columns, WIDTH), (columns, columns, WIDTH)
    at, start, velocity, shape, rate, load, b = (np.zeros(line) for _ in range(7))
    mass, a, drive, theta = np.zeros(square), np.zeros(square), np.zeros((8, WIDTH)), np.zeros((1, WIDTH))
    return Room(at, start, velocity, shape, rate, load, mass, a, b, drive, theta, room_for_loads(rod))


_SEEN = ("shape", "rate", "load", "mass")
"""What a room has that is another one at the start than in later sweeps."""


class Midpoints(NamedTuple):
    """What a call found known of the muscles' last midpoints: directors, loads and masses, and of which muscles."""

    directors: Array
    load: Array
    mass: Array
    known: NDArray[np.bool_]


class Work(NamedTuple):
    """Room for a step, and what the next one goes on from.

    Args:
        midpoint_known: of each muscle, whether ``motion`` and ``room`` are those at its last midpoint, shape (4,).
        ahead_known: whether ``ahead`` holds, shape (1,).
        before, midpoints: the state at the start of the call, and what went with it.
        motion: where the last sweep saw the muscles.
        touch_motion: where the search for contacts saw them: at the start.
        gain, ahead: of the velocities in the last sub-step, and in the next one if they go on as in the last two.
        a, b, start: of the equations a v = b, and the velocities before, shapes (n, n), (n,) and (n,).
        theta, rotation, middle, turn: of the bodies (5,) and of the object, (3, 3), (4,) and (3,).
        rates: of the directors at the start, shape (4, N + 1, 3).
        way: how far anything moved in the last sub-step at the most [m], shape (1,).
        touch_room: of the muscles at the start.
        room, spots, room_of_lines, equations: of the muscles, the contact search and the contact solution.
    """

    midpoint_known: NDArray[np.bool_]
    ahead_known: NDArray[np.bool_]
    before: State
    midpoints: Midpoints
    motion: Motion
    touch_motion: Motion
    gain: Array
    ahead: Array
    a: Array
    b: Array
    start: Array
    theta: Array
    rotation: Array
    middle: Array
    turn: Array
    rates: Array
    way: Array
    touch_room: Room
    room: Room
    spots: Places
    room_of_lines: Lines
    equations: Scratch


class Parts(NamedTuple):
    """All that a call of :func:`advance` reads and writes but the hand's motion.

    Args:
        motion: that of the state when it was last shown.
    """

    state: State
    drive: Drive
    system: System
    contacts: Contacts
    motion: Motion
    forces: Forces
    work: Work


def new_drive(fingers: int) -> Drive:
    """Return a drive that does nothing to muscles of unit stiffness."""
    line, plane = (2, fingers), (2, fingers, 2)
    return Drive(np.zeros(plane), np.ones(line), np.ones(line), np.ones(line), np.zeros(line), np.zeros(plane))


def assemble(state: State, system: System, contacts: Contacts) -> Parts:
    """Return the parts with room for the rest; nothing drives the muscles yet."""
    fingers, rod, size = len(system.bases), system.rod, len(state.velocity)
    room, motion = room_of(rod), motion_at_rest(rod)
    return Parts(
        state,
        new_drive(fingers),
        system,
        contacts,
        motion_at_rest(rod),
        Forces(np.zeros((fingers, 3)), np.zeros(3), np.zeros(3), np.zeros((fingers, 3))),
        Work(
            midpoint_known=np.zeros(fingers, np.bool_),
            ahead_known=np.zeros(1, np.bool_),
            before=state._replace(**{name: part.copy() for name, part in state._asdict().items()}),
            midpoints=Midpoints(motion.tangent.copy(), room.load.copy(), room.mass.copy(), np.zeros(fingers, np.bool_)),
            motion=motion,
            touch_motion=motion_at_rest(rod),
            gain=np.zeros(size),
            ahead=np.zeros(size),
            a=np.zeros((size, size)),
            b=np.zeros(size),
            start=np.zeros(size),
            theta=np.zeros(fingers + 1),
            rotation=np.eye(3),
            middle=np.zeros(4),
            turn=np.zeros(3),
            rates=np.zeros((fingers, len(rod.levers) + 1, 3)),
            way=np.zeros(1),
            touch_room=room._replace(**{part: np.zeros_like(getattr(room, part)) for part in _SEEN}),
            room=room,
            spots=places(system.surroundings),
            room_of_lines=lines(rod, fingers),
            equations=scratch(size, fingers + 1, len(contacts.depth)),
        ),
    )


@kernel
def _take_lanes(values: Array, lanes: Array, fingers: int) -> None:
    """Write the coordinates of all muscles one after another, (4 D, or more), as lanes (D, 4)."""
    size = lanes.shape[0]
    for f in range(fingers):
        for i in range(size):
            lanes[i, f] = values[f * size + i]


@kernel
def _move_muscles(system: System, share: float, motion: Motion, room: Room) -> None:
    """Write the motion of the muscles after ``share`` of the step."""
    for i in range(room.at.shape[0]):
        rate = (1.0 - share) * load(room.start, (i,)) + share * load(room.velocity, (i,))
        store(room.rate, (i,), rate)
        store(room.shape, (i,), load(room.at, (i,)) + share * system.step_s * rate)
    move_rods(room.shape, room.rate, system.rod, motion)


@piece
def _drive_lanes(drive: Drive, blend: float, rod: Rod, room: Room) -> None:
    """Write what the air does to the muscles into ``room``; of what only absent strains ask for, nothing."""
    for f in range(drive.stiffnesses.shape[1]):
        room.drive[0, f] = (1.0 - blend) * drive.stiffnesses[0, f] + blend * drive.stiffnesses[1, f]
        room.drive[1, f] = (1.0 - blend) * drive.moments[0, f, 0] + blend * drive.moments[1, f, 0]
        room.drive[2, f] = (1.0 - blend) * drive.moments[0, f, 1] + blend * drive.moments[1, f, 1]
        if rod.twists.shape[2] > 0:
            room.drive[3, f] = (1.0 - blend) * drive.torsions[0, f] + blend * drive.torsions[1, f]
        if rod.stretches.shape[1] > 0:
            room.drive[4, f] = (1.0 - blend) * drive.axials[0, f] + blend * drive.axials[1, f]
            room.drive[5, f] = (1.0 - blend) * drive.free_stretches[0, f] + blend * drive.free_stretches[1, f]
            room.drive[6, f] = (1.0 - blend) * drive.couplings[0, f, 0] + blend * drive.couplings[1, f, 0]
            room.drive[7, f] = (1.0 - blend) * drive.couplings[0, f, 1] + blend * drive.couplings[1, f, 1]


@kernel
def _muscle_equations(system: System, theta: Array, room: Room) -> None:
    """Write the muscles' equations a v = b with the masses, loads and drives in ``room``."""
    h, eta, springs = system.step_s, system.retardation, system.rod.springs
    bends, stretches, size = 2 * system.rod.bends.shape[2], system.rod.stretches.shape[1], room.at.shape[0]
    for f in range(theta.shape[0] - 1):
        room.theta[0, f] = theta[f]
    t, stiffness, torsion = load(room.theta, (0,)), h * load(room.drive, (0,)), h * load(room.drive, (3,))
    implicit, explicit = t * (eta + t * h), (1.0 - t) * (eta + t * h)
    for i in range(size):
        k = splat(0.0)  # stretch has its own terms
        if i < bends:
            k = stiffness * springs[i >> 1]
        elif i < size - stretches:
            k = torsion * springs[i - bends]
        total = h * load(room.load, (i,)) - k * (load(room.at, (i,)) + explicit * load(room.start, (i,)))
        if i < 2:
            total = total + h * load(room.drive, (1 + i,))
        for j in range(size):
            mass = load(room.mass, (i, j))
            store(room.a, (i, j), mass)
            total = total + mass * load(room.start, (j,))
        store(room.a, (i, i), load(room.a, (i, i)) + k * implicit)
        store(room.b, (i,), total)
    if stretches > 0:
        _stretch_equations(system, implicit, explicit, room)


@piece
def _add(values: Array, place: Place, more: Lanes) -> None:
    store(values, place, load(values, place) + more)


@piece
def _stretch_equations(system: System, implicit: Lanes, explicit: Lanes, room: Room) -> None:
    """Add what the energy of the stretch gives to the muscles' equations.

    Mode i has L EA / (2 (2 i + 1)) (e_i - [eps_0] - c . q_i / L)^2, with eps_0 for i = 0.
    """
    rod, springs, size = system.rod, system.rod.stretch_springs, room.at.shape[0]
    axial, free = system.step_s * load(room.drive, (4,)), load(room.drive, (5,))
    cx, cy = load(room.drive, (6,)) / rod.active_length, load(room.drive, (7,)) / rod.active_length
    for i in range(springs.shape[0]):
        k = axial * springs[i]
        e, x, y = size - springs.shape[0] + i, 2 * i, 2 * i + 1
        off = load(room.at, (e,)) + explicit * load(room.start, (e,))
        if i == 0:
            off = off - free
        _add(room.a, (e, e), k * implicit)
        if i < rod.bends.shape[2]:
            along_x = cx * (load(room.at, (x,)) + explicit * load(room.start, (x,)))
            off = off - (along_x + cy * (load(room.at, (y,)) + explicit * load(room.start, (y,))))
            _add(room.b, (x,), k * cx * off)
            _add(room.b, (y,), k * cy * off)
            _add(room.a, (x, x), k * implicit * cx * cx)
            _add(room.a, (y, y), k * implicit * cy * cy)
            _add(room.a, (x, y), k * implicit * cx * cy)
            _add(room.a, (y, x), k * implicit * cx * cy)
            _add(room.a, (e, x), -(k * implicit * cx))
            _add(room.a, (x, e), -(k * implicit * cx))
            _add(room.a, (e, y), -(k * implicit * cy))
            _add(room.a, (y, e), -(k * implicit * cy))
        _add(room.b, (e,), -(k * off))


@kernel
def _spread_equations(room_a: Array, room_b: Array, fingers: int, a: Array, b: Array) -> None:
    """Write the muscles' equations into rows and columns of all bodies' a v = b."""
    size = room_b.shape[0]
    for f in range(fingers):
        for i in range(size):
            b[f * size + i] = room_b[i, f]
            for j in range(size):
                a[f * size + i, f * size + j] = room_a[i, j, f]


@kernel
def _object_equations(
    state: State, start: Array, system: System, share: float, rotation: Array, middle: Array, a: Array, b: Array
) -> None:
    """Write the object's rows of a v = b; its inertia and velocity terms after ``share`` of the step."""
    h, n = system.step_s, state.shape.shape[0]
    w = plus(times(1.0 - share, vector(start, n + 3)), times(share, vector(state.velocity, n + 3)))
    turned(state.orientation, times(0.5 * h, w), middle)
    write_rotation(middle, rotation)
    for i in range(3):
        a[n + i, n + i] = system.mass
        b[n + i] = system.mass * (start[n + i] + h * system.gravity[i])
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += rotation[i, k] * system.inertia[k] * rotation[j, k]
            a[n + 3 + i, n + 3 + j] = total
    spin = (dot(vector(a[n + 3], n + 3), w), dot(vector(a[n + 4], n + 3), w), dot(vector(a[n + 5], n + 3), w))
    b[n + 3], b[n + 4], b[n + 5] = times(-h, cross(w, spin))
    for i in range(n + 3, n + 6):
        for j in range(n + 3, n + 6):
            b[i] += a[i, j] * start[j]


@kernel
def _move(state: State, start: Array, h: float, stretches: int, theta: Array, turn: Array) -> int:
    """Move muscles and object by the velocities; return OK or what went wrong."""
    shape, v = state.shape, state.velocity
    n, fingers = shape.shape[0], theta.shape[0] - 1
    for i in range(v.shape[0]):
        if not math.isfinite(v[i]):
            return NOT_FINITE
        if abs(v[i]) > (5000.0 if i < n else (50.0 if i < n + 3 else 1000.0)):
            return TOO_FAST
    size = n // fingers
    for f in range(fingers):
        t = theta[f]
        for i in range(f * size, (f + 1) * size):
            shape[i] += h * ((1.0 - t) * start[i] + t * v[i])
            if abs(shape[i]) > LARGEST_BEND_RAD:
                return TOO_BENT
    if stretches > 0:
        for f in range(fingers):
            last, longer = (f + 1) * size, 0.0
            for i in range(last - stretches, last):
                longer += abs(shape[i])
            if longer > LARGEST_STRETCH:
                return TOO_LONG
    if v.shape[0] > n:
        t = theta[-1]
        for i in range(6):
            way = h * ((1.0 - t) * start[n + i] + t * v[n + i])
            if i < 3:
                state.position[i] += way
            else:
                turn[i - 3] = way
        turned(state.orientation, vector(turn, 0), state.orientation)
    return OK


@kernel
def _sum_forces(contacts: Contacts, forces: Forces) -> None:
    forces.finger[:] = 0.0
    forces.support[:] = 0.0
    forces.palm[:] = 0.0
    forces.between[:] = 0.0
    for c in range(contacts.count[0]):
        for i in range(3):
            if contacts.kind[c] == ContactKind.FINGER_OBJECT:
                forces.finger[contacts.finger[c], i] += contacts.force[c, i]
            elif contacts.kind[c] == ContactKind.OBJECT_SUPPORT:
                forces.support[i] += contacts.force[c, i]
            elif contacts.kind[c] == ContactKind.OBJECT_PALM:
                forces.palm[i] += contacts.force[c, i]
            elif contacts.kind[c] == ContactKind.FINGER_FINGER:
                forces.between[contacts.finger[c], i] -= contacts.force[c, i]
                forces.between[contacts.other[c], i] += contacts.force[c, i]


@kernel
def _farthest(state: State, start: Array, system: System, theta: Array, hand_velocity: float) -> float:
    """Return how far two bodies may come nearer to each other in a sub-step, at the most [m].

    No section of a muscle turns faster than the sum of its rates; an object's farthest point is in a corner.
    """
    muscles, fingers, fastest = state.shape.shape[0], theta.shape[0] - 1, 0.0
    size, length = muscles // fingers, system.rod.farthest * system.rod.balls.shape[0]
    for f in range(fingers):
        rates = 0.0
        for i in range(f * size, (f + 1) * size):
            rates += abs((1.0 - theta[f]) * start[i] + theta[f] * state.velocity[i])
        fastest = max(fastest, length * rates)
    other = fastest
    if state.velocity.shape[0] > muscles:
        v, w, half = vector(state.velocity, muscles), vector(state.velocity, muscles + 3), system.surroundings.half
        other = max(fastest, norm(v) + norm(w) * norm(vector(half, 0)))
    return abs(system.step_s) * (fastest + other + abs(hand_velocity))


@piece
def _solve_muscles(room: Room, island: NDArray[np.int64], velocity: Array) -> tuple[bool, float]:
    """Solve each muscle's equations, by L D L^T in place, for those that touch nothing.

    Returns whether it could be, and the largest change.
    """
    a, b, size = room.a, room.b, room.b.shape[0]
    for i in range(size):
        pivot, right = load(a, (i, i)), load(b, (i,))
        for j in range(i):
            total = load(a, (i, j))
            for k in range(j):
                total = total - load(a, (i, k)) * load(a, (j, k))  # (L D) of row i, L of row j
            store(a, (i, j), total)
        for j in range(i):
            raw = load(a, (i, j))
            scaled = raw * load(a, (j, j))
            pivot = pivot - raw * scaled
            right = right - scaled * load(b, (j,))
            store(a, (i, j), scaled)
        if not all_above(pivot, 0.0):
            return False, 0.0
        store(a, (i, i), 1.0 / pivot)
        store(b, (i,), right)
    for i in range(size):
        store(b, (i,), load(b, (i,)) * load(a, (i, i)))
    for i in range(size - 1, -1, -1):
        solved = load(b, (i,))
        for k in range(i):
            store(b, (k,), load(b, (k,)) - load(a, (i, k)) * solved)
    changed = 0.0
    for f in range(island.shape[0] - 1):
        for i in range(size if island[f] < 0 else 0):
            n = f * size + i
            changed = max(changed, abs(b[i, f] - velocity[n]))
            velocity[n] = room.velocity[i, f] = b[i, f]
    return True, changed


@kernel
def _near(parts: Parts, lift: float, gap: float) -> bool:
    """Whether anything may touch: what is nearer than ``gap`` to where the last sweep saw the muscles may."""
    system, work, around = parts.system, parts.work, parts.system.surroundings
    if around.table_in_reach:
        return True
    if around.shape < 0 and not around.fingers_touch:
        return False
    for f in range(work.midpoint_known.shape[0]):
        if not work.midpoint_known[f]:
            return True
    write_boxes(system.bases, system.rod, work.motion, 0.5 * gap, work.room_of_lines)
    if around.fingers_touch and fingers_near(work.room_of_lines):
        return True
    x, y, z = vector(parts.state.position, 0)
    radius = norm(vector(around.half, 0)) + 0.5 * gap
    return around.shape >= 0 and near_ball(work.room_of_lines, (x, y, z + lift), radius)


@kernel
def _let_go(island: NDArray[np.int64], theta: Array, contacts: Contacts) -> None:
    """Let nothing touch."""
    for body in range(island.shape[0]):
        island[body], theta[body] = -1, 0.5
    contacts.count[0] = 0


@kernel
def _all_known(known: NDArray[np.bool_], island: NDArray[np.int64]) -> bool:
    """Whether no muscle asks for what it is like at the start: they touch nothing, and their last midpoint is known."""
    for f in range(known.shape[0]):
        if island[f] >= 0 or not known[f]:
            return False
    return True


@kernel
def _all_touch(island: NDArray[np.int64]) -> bool:
    """Whether all muscles touch something."""
    for f in range(island.shape[0] - 1):
        if island[f] < 0:
            return False
    return True


@kernel
def _keep_masses(known: NDArray[np.bool_], island: NDArray[np.int64], start: Room, room: Room) -> None:
    """Let the first sweep have masses and loads of the start of those muscles whose last midpoint is not known."""
    for f in range(WIDTH):  # lanes without a muscle too
        if f >= known.shape[0] or island[f] >= 0 or not known[f]:
            for i in range(start.load.shape[0]):
                room.load[i, f] = start.load[i, f]
                for j in range(start.load.shape[0]):
                    room.mass[i, j, f] = start.mass[i, j, f]


@kernel(inline="always")
def _touch(
    state: State, system: System, lift: float, hand_velocity: float, near: bool, outlook: Outlook, work: Work,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Find the contacts and which bodies they tie to each other, and choose theta for each.

    Where nothing is ``near`` a muscle only the object and what it rests on are looked at.
    """
    write_rotation(state.orientation, work.rotation)
    find_contacts(
        system.bases, system.rod, work.touch_motion, system.surroundings, state.position, work.rotation, lift,
        hand_velocity, near, outlook, work.spots, work.room_of_lines, contacts,
    )  # fmt: skip
    recall(Grip(state.held, state.slots, state.springs), contacts)
    find_islands(contacts, work.theta.shape[0], work.equations.island)
    for body in range(work.theta.shape[0]):
        if work.equations.island[body] >= 0:
            work.theta[body] = 1.0


@kernel
def _too_deep(h: float, radius: float, contacts: Contacts) -> bool:
    """Whether anything ends so deep in something else that it would come out behind, or beside."""
    for c in range(contacts.count[0]):
        depth = contacts.depth[c] - h * dot(vector(contacts.normal[c], 0), vector(contacts.velocity[c], 0))
        most = PLATE_THICKNESS_M if contacts.finger[c] < 0 else radius
        if depth > most:
            return True
    return False


@kernel
def _move_object_freely(state: State, start: Array, system: System, work: Work) -> bool:
    """Write the velocities of an object that touches nothing."""
    n, size, first = state.shape.shape[0], state.velocity.shape[0], work.equations.first
    for sweep in range(system.sweeps):
        share = 0.5 if sweep > 0 else 0.0
        _object_equations(state, start, system, share, work.rotation, work.middle, work.a, work.b)
        for i in range(n, size):
            first[i] = n
        if not solve_in_place(work.a, work.b, first, n, size):
            return False
        changed = 0.0
        for i in range(n, size):
            changed = max(changed, abs(work.b[i] - state.velocity[i]))
            state.velocity[i] = work.b[i]
        if changed < FOUND_RAD_S:
            break
    return True


@kernel
def _look_ahead(velocity: Array, start: Array, extrapolate: bool, gain: Array, ahead: Array) -> None:
    """Write how the velocities have changed, and will if they go on as in the last two sub-steps, or in this one."""
    for i in range(velocity.shape[0]):
        change = velocity[i] - start[i]
        ahead[i] = 2.0 * change - gain[i] if extrapolate else change
        gain[i] = change


@kernel(inline="always")
def _solve_touching(parts: Parts, gravity: Vector, anew: bool, ahead: bool) -> tuple[int, int]:
    """Write the velocities of the object and of the muscles that touch something; return OK or not, and Newton's steps.

    Where a muscle asks for what it is like at the start, ``anew``, its masses and loads are found there.
    """
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    island, fingers = work.equations.island, work.midpoint_known.shape[0]
    muscles, rows, size, iterations = state.shape.shape[0], state.velocity.shape[0], contacts.coordinates, 0
    if anew:
        start = work.touch_room
        masses_and_loads(system.rod, work.touch_motion, gravity, start.work, start.mass, start.load)
        _muscle_equations(system, work.theta, start)
        _spread_equations(start.a, start.b, fingers, work.a, work.b)
        _keep_masses(work.midpoint_known, island, start, work.room)
    if rows > muscles and island[fingers] < 0:
        if not _move_object_freely(state, work.start, system, work):
            return NOT_FINITE, iterations
    elif rows > muscles:
        _object_equations(state, work.start, system, 0.0, work.rotation, work.middle, work.a, work.b)
    for body in range(fingers + 1 if contacts.count[0] > 0 else 0):
        if ahead and island[body] >= 0:
            for i in range(body * size, (body + 1) * size if body < fingers else rows):
                state.velocity[i] += work.ahead[i]
    for body in range(fingers + 1 if contacts.count[0] > 0 else 0):
        if island[body] == body:
            left, count = solve_contacts(
                work.a, work.b, state.velocity, body, system.step_s, system.laws, contacts, work.equations
            )
            iterations = max(iterations, count)
            if not left < SOLVED_M_S:
                return NOT_SOLVED, iterations
    return OK, iterations


@kernel(inline="always")
def _solve_free(parts: Parts, gravity: Vector) -> int:
    """Write the velocities of the muscles that touch nothing, sweep by sweep; return OK or what went wrong."""
    state, system, work = parts.state, parts.system, parts.work
    room, island = work.room, work.equations.island
    if parts.contacts.count[0] > 0:
        _take_lanes(state.velocity, room.velocity, work.midpoint_known.shape[0])
    for sweep in range(system.sweeps):
        if sweep > 0:
            _move_muscles(system, 0.5, work.motion, room)
            masses_and_loads(system.rod, work.motion, gravity, room.work, room.mass, room.load)
        _muscle_equations(system, work.theta, room)
        solved, changed = _solve_muscles(room, island, state.velocity)
        if not solved:
            return NOT_FINITE
        if changed < FOUND_RAD_S:
            break
    return OK


@kernel(inline="always")
def _find_velocities(parts: Parts, heights: Array, rates: Array, step: int, ahead: bool) -> tuple[int, int]:
    """Write the velocities after a sub-step; return OK or what went wrong, and Newton's steps.

    Bodies that touch are solved island by island, at the start. Each other one is solved alone: the first sweep has
    what the step before saw at its midpoint, later ones are at the midpoint that the one before found. If then
    something moved farther than what was looked for, all is done again with a wider look.
    """
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    island, known, iterations = work.equations.island, work.midpoint_known, 0
    lift, hand, radius = heights[step], rates[step + 1], system.rod.radius
    _drive_lanes(parts.drive, (step + 0.5) / (heights.shape[0] - 1), system.rod, work.room)
    gravity = (
        system.gravity[0],
        system.gravity[1],
        system.gravity[2] + (rates[step + 1] - rates[step]) / system.step_s,
    )
    pull = max(system.step_s * system.step_s * norm(gravity) - SEEN_LATE_M, 0.0)
    reach = pull + 1.5 * (work.way[0] + abs(system.step_s * hand))
    for _ in range(LOOKS):
        near = _near(parts, lift, max(reach, radius) + work.way[0])
        _let_go(island, work.theta, contacts)
        for i in range(state.velocity.shape[0]):
            state.velocity[i] = work.start[i]
        if near or not _all_known(known, island):
            _move_muscles(system, 0.0, work.touch_motion, work.touch_room)
        if near or system.surroundings.shape >= 0:
            outlook = Outlook(system.step_s, reach, pull, work.start, state.shape.shape[0], work.rates)
            _touch(state, system, lift, hand, near, outlook, work, contacts)
        answer, count = _solve_touching(parts, gravity, not _all_known(known, island), ahead)
        iterations = max(iterations, count)
        if answer == OK and not _all_touch(island):
            answer = _solve_free(parts, gravity)
        if answer != OK:
            return answer, iterations
        work.way[0] = _farthest(state, work.start, system, work.theta, hand)
        if work.way[0] <= max(reach, radius):
            break
        reach = 1.1 * work.way[0]
        pull = reach
    for f in range(known.shape[0]):
        known[f] = island[f] < 0
    return TOO_DEEP if _too_deep(system.step_s, radius, contacts) else OK, iterations


@kernel(inline="always")
def _advance(parts: Parts, heights: Array, rates: Array) -> tuple[int, int]:
    """Do the work of ``advance``.

    ``inline``: to hand sixty arrays on takes longer than what is done with them, in the compiler too. Where an array or
    two are handed on, or there is more than one caller, a function of its own is compiled faster.
    """
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    steps, fingers = heights.shape[0] - 1, work.theta.shape[0] - 1
    if steps == 0:
        _take_lanes(state.shape, work.room.at, fingers)
        _take_lanes(state.velocity, work.room.start, fingers)
        _move_muscles(system, 0.0, parts.motion, work.room)
        _hold(parts.drive)
        return OK, 0
    iterations, ahead = 0, work.ahead_known[0]
    work.ahead_known[0] = False  # unless all goes well
    _copy_state(state, work.before)
    directors, load, mass, known = work.midpoints
    _copy_lanes(work.motion.tangent, work.room.load, work.room.mass, directors, load, mass)
    for f in range(fingers):
        known[f] = work.midpoint_known[f]
    for step in range(steps):
        for i in range(state.velocity.shape[0]):
            work.start[i] = state.velocity[i]
        _take_lanes(state.shape, work.room.at, fingers)
        _take_lanes(work.start, work.room.start, fingers)
        answer, count = _find_velocities(parts, heights, rates, step, ahead)
        iterations = max(iterations, count)
        if answer == OK:
            answer = _move(state, work.start, system.step_s, system.rod.stretches.shape[1], work.theta, work.turn)
        if answer != OK:
            _copy_state(work.before, state)
            _copy_lanes(directors, load, mass, work.motion.tangent, work.room.load, work.room.mass)
            for f in range(fingers):
                work.midpoint_known[f] = known[f]
            return answer, iterations
        remember(system.step_s, system.laws, contacts, Grip(state.held, state.slots, state.springs))
        _look_ahead(state.velocity, work.start, ahead, work.gain, work.ahead)
        ahead = True
    work.ahead_known[0] = ahead
    _hold(parts.drive)
    _sum_forces(contacts, parts.forces)
    return OK, iterations


@kernel
def _copy(values: Array, there: Array) -> None:
    for i in range(values.shape[0]):
        there[i] = values[i]


@kernel
def _copy_lanes(directors: Array, loads: Array, masses: Array, to: Array, to_loads: Array, to_masses: Array) -> None:
    """Copy what is known of the muscles at a midpoint."""
    for k in range(directors.shape[0]):
        for i in range(3):
            _copy(directors[k, i], to[k, i])
    for i in range(loads.shape[0]):
        _copy(loads[i], to_loads[i])
        for j in range(loads.shape[0]):
            _copy(masses[i, j], to_masses[i, j])


@kernel
def _copy_state(state: State, there: State) -> None:
    _copy(state.shape, there.shape)
    _copy(state.velocity, there.velocity)
    _copy(state.position, there.position)
    _copy(state.orientation, there.orientation)
    there.held[0] = state.held[0]
    for c in range(state.held[0]):
        there.slots[c] = state.slots[c]
        _copy(state.springs[c], there.springs[c])


@kernel
def _hold(drive: Drive) -> None:
    """Let what drives the muscles at the end of the call be what drives them from then on."""
    for f in range(drive.stiffnesses.shape[1]):
        drive.stiffnesses[0, f], drive.torsions[0, f] = drive.stiffnesses[1, f], drive.torsions[1, f]
        drive.axials[0, f], drive.free_stretches[0, f] = drive.axials[1, f], drive.free_stretches[1, f]
        for i in range(2):
            drive.moments[0, f, i], drive.couplings[0, f, i] = drive.moments[1, f, i], drive.couplings[1, f, i]


def forget(work: Work) -> None:
    """Let the next step go on from the state alone."""
    work.midpoint_known[:] = False
    work.ahead_known[0] = False
    work.way[0] = 0.0


def _sample() -> Parts:
    """Return parts of the types that all have: of one muscle with one segment and one ball."""
    one, square, pair, none = np.ones(1), np.ones((1, 1)), np.ones((1, 2)), np.ones((2, 0))
    rod = Rod(
        np.ones((1, 2, 1)), np.ones((1, 2, 0)), none, one, none[0], 1.0, square, none[0], one, pair, pair, 1.0, 1.0, 1.0
    )
    around = Surroundings(-1, np.zeros(3), np.zeros((0, 3)), False, False)
    system = System(1.0, 1, np.zeros(3), np.zeros((1, 3)), rod, 0.0, 0.0, np.zeros(3), around, np.zeros((5, 6)))
    contacts = contact_table(1, 2)
    state = new_state(contacts, np.zeros(2), np.zeros(2), np.zeros(3), np.zeros(4))
    return assemble(state, system, contacts)


_write, _read = access(_sample())


def _cached(
    digest: int,
) -> tuple[Callable[[Block, Parts], None], Callable[[Block, Array, Array], tuple[int, int]]]:
    """Compile ``_bind`` and ``advance`` into the cache on disk.

    The cache only watches the file of the cached function. A digest of all sources it is built from, being part of
    the closure, is part of the cache's key: no stale machine code after an edit of another file.
    """

    @entry(cache=True)
    def _bind(bound: Block, parts: Parts) -> None:
        if digest >= 0:
            _write(bound, parts)

    @entry(cache=True, nogil=True)
    def advance(bound: Block, heights: Array, rates: Array) -> tuple[int, int]:
        """Advance the state in place by all sub-steps; return OK or what went wrong, and the most Newton steps.

        Then the drive's end is its start too. If something went wrong, the state is that before the call.
        Without a sub-step this shows the state: it writes ``motion``. Python's lock is not held.

        Args:
            bound: the parts, from :func:`bind`.
            heights, rates: of the hand at the ends of all sub-steps, shape (n + 1,).
        """
        if digest < 0:
            return NOT_SOLVED, 0
        return _advance(_read(bound), heights, rates)

    return _bind, advance


def kernel_sources() -> list[Path]:
    """Return all files that hold compiled code of the step."""
    folders = (Path(__file__).parent, Path(surfaces.__file__).parent)
    return [source for folder in folders for source in sorted(folder.glob("*.py"))]


_bind, advance = _cached(source_digest(kernel_sources()))


def bind(parts: Parts) -> Block:
    """Return the parts for :func:`advance`; changes of their arrays are seen on both sides. Keep them as long as this.

    Raises:
        numba.TypingError: an array is not contiguous or not of its type.
    """
    bound = new_block(parts)
    _bind(bound, parts)
    return bound
