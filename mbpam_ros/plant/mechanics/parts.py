"""What a step reads and writes: the state, what does not change, and room for all between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.contact_law import Contacts, no_grip
from mbpam_ros.plant.mechanics.contact_search import Places, Surroundings, places
from mbpam_ros.plant.mechanics.contact_solver import Scratch, scratch
from mbpam_ros.plant.mechanics.finger_contact import Lines, lines
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.rod import Motion, Rod, coordinates_of, motion_at_rest, room_for_loads
from mbpam_ros.plant.mechanics.vectors import Array


class State(NamedTuple):
    """What moves.

    Args:
        shape: coordinates q of the muscles [rad], shape (4 D,).
        velocity: their rates, then of each of K objects its linear and angular velocity, shape (4 D + 6 K,).
        position, orientation: of the objects, shapes (K, 3) and (K, 4).
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
        masses, inertia: of the objects, about their own axes, shapes (K,) and (K, 3).
        surroundings: what muscles may touch.
        laws: of contact, one row a kind.
    """

    step_s: float
    sweeps: int
    gravity: Array
    bases: Array
    rod: Rod
    retardation: float
    masses: Array
    inertia: Array
    surroundings: Surroundings
    laws: Array


class Forces(NamedTuple):
    """Forces after a step.

    Args:
        finger, support, palm, object: on each object, of the fingers (K, 4, 3), and of its supports, the palm and the
            other objects (K, 3).
        between: on each finger, of the other fingers, shape (4, 3).
    """

    finger: Array
    support: Array
    palm: Array
    object: Array
    between: Array


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
        theta: of the bodies, shape (4 + K,).
        rotation: of the objects, shape (K, 3, 3).
        middle, turn: of one object, shapes (4,) and (3,).
        rates: of the directors at the start, shape (4, N + 1, 3).
        before_ways: the ways of ``spots`` by which contacts were sought.
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
    before_ways: Array
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


def _no_forces(fingers: int, objects: int) -> Forces:
    support, palm, object_ = np.zeros((3, objects, 3))
    return Forces(np.zeros((objects, fingers, 3)), support, palm, object_, np.zeros((fingers, 3)))


def assemble(state: State, system: System, contacts: Contacts) -> Parts:
    """Return the parts with room for the rest; nothing drives the muscles yet."""
    fingers, objects, rod, size = len(system.bases), len(system.masses), system.rod, len(state.velocity)
    room, motion = room_of(rod), motion_at_rest(rod)
    return Parts(
        state,
        new_drive(fingers),
        system,
        contacts,
        motion_at_rest(rod),
        _no_forces(fingers, objects),
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
            theta=np.zeros(fingers + objects),
            rotation=np.zeros((objects, 3, 3)),
            middle=np.zeros(4),
            turn=np.zeros(3),
            rates=np.zeros((fingers, len(rod.levers) + 1, 3)),
            before_ways=np.zeros(objects + 2),
            touch_room=room._replace(**{part: np.zeros_like(getattr(room, part)) for part in _SEEN}),
            room=room,
            spots=places(system.surroundings),
            room_of_lines=lines(rod, fingers),
            equations=scratch(size, fingers + objects, len(contacts.depth)),
        ),
    )


@kernel
def _copy(values: Array, there: Array) -> None:
    for i in range(values.shape[0]):
        there[i] = values[i]


@kernel
def copy_lanes(directors: Array, loads: Array, masses: Array, to: Array, to_loads: Array, to_masses: Array) -> None:
    """Copy what is known of the muscles at a midpoint."""
    for k in range(directors.shape[0]):
        for i in range(3):
            _copy(directors[k, i], to[k, i])
    for i in range(loads.shape[0]):
        _copy(loads[i], to_loads[i])
        for j in range(loads.shape[0]):
            _copy(masses[i, j], to_masses[i, j])


@kernel
def copy_state(state: State, there: State) -> None:
    """Copy all that moves, of the springs those that are held."""
    _copy(state.shape, there.shape)
    _copy(state.velocity, there.velocity)
    for k in range(state.position.shape[0]):
        _copy(state.position[k], there.position[k])
        _copy(state.orientation[k], there.orientation[k])
    there.held[0] = state.held[0]
    for c in range(state.held[0]):
        there.slots[c] = state.slots[c]
        _copy(state.springs[c], there.springs[c])
