r"""Four muscles and rigid objects: the coupled step, compiled.

Unknowns: the velocities v after a sub-step, those of the D coordinates q of each muscle
(:mod:`~mbpam_ros.plant.mechanics.rod`) and the linear and angular velocity of each object. With the stiffness B and
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

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry import surfaces
from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts, Grip, contact_table, equations_of, recall, remember
from mbpam_ros.plant.mechanics.contact_search import Places, Surroundings, closing, find_contacts, look
from mbpam_ros.plant.mechanics.contact_solver import find_islands, solve_contacts
from mbpam_ros.plant.mechanics.finger_contact import fingers_near, near_ball, write_boxes
from mbpam_ros.plant.mechanics.kernel import entry, kernel
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.muscles import (
    drive_lanes,
    move_muscles,
    muscle_equations,
    solve_muscles,
    spread_equations,
    take_lanes,
)
from mbpam_ros.plant.mechanics.packed_arguments import Block, access, new_block
from mbpam_ros.plant.mechanics.parts import (
    Drive,
    Forces,
    Parts,
    Room,
    State,
    System,
    Work,
    assemble,
    copy_lanes,
    copy_state,
    new_state,
)
from mbpam_ros.plant.mechanics.rigid_objects import (
    FOUND_RAD_S,
    move_object_freely,
    object_equations,
    turned,
    write_rotation,
)
from mbpam_ros.plant.mechanics.rod import LARGEST_STRETCH, Rod, masses_and_loads
from mbpam_ros.plant.mechanics.vectors import Array, Vector, dot, norm, row, vector
from mbpam_ros.source_digest import source_digest

OK, NOT_FINITE, TOO_FAST, NOT_SOLVED, TOO_BENT, TOO_LONG, TOO_DEEP = 0, 1, 2, 3, 4, 5, 6
"""What a step answers."""

LOOKS = 5
"""How often a step may be done again because something moved farther than what was looked for."""

SEEN_LATE_M = 1e-4
"""What may fall into something within a step before it is a contact."""

SOLVED_M_S = 1e-4
"""What may be left of the contact equations."""

LARGEST_BEND_RAD = 8.0
"""Beyond it (460 deg) the polynomials between the points of a rod no longer follow its tangents."""


@kernel
def _move(state: State, start: Array, h: float, stretches: int, theta: Array, turn: Array) -> int:
    """Move muscles and objects by the velocities; return OK or what went wrong."""
    shape, v, objects = state.shape, state.velocity, state.position.shape[0]
    n, fingers = shape.shape[0], theta.shape[0] - objects
    for i in range(v.shape[0]):
        if not math.isfinite(v[i]):
            return NOT_FINITE
        if abs(v[i]) > (5000.0 if i < n else (50.0 if (i - n) % 6 < 3 else 1000.0)):
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
    for k in range(objects):
        t, first = theta[fingers + k], n + 6 * k
        for i in range(6):
            way = h * ((1.0 - t) * start[first + i] + t * v[first + i])
            if i < 3:
                state.position[k, i] += way
            else:
                turn[i - 3] = way
        turned(state.orientation[k], vector(turn, 0), state.orientation[k])
    return OK


@kernel
def _sum_forces(contacts: Contacts, forces: Forces) -> None:
    forces.finger[:] = 0.0
    forces.support[:] = 0.0
    forces.palm[:] = 0.0
    forces.object[:] = 0.0
    forces.between[:] = 0.0
    for c in range(contacts.count[0]):
        kind, one, other, fingers = contacts.kind[c], contacts.one[c], contacts.other[c], contacts.fingers
        for i in range(3):
            force = contacts.force[c, i]
            if kind == ContactKind.FINGER_OBJECT:
                forces.finger[other - fingers, one, i] += force
            elif kind == ContactKind.OBJECT_SUPPORT:
                forces.support[other - fingers, i] += force
            elif kind == ContactKind.OBJECT_PALM:
                forces.palm[other - fingers, i] += force
            elif kind == ContactKind.FINGER_FINGER:
                forces.between[one, i] -= force
                forces.between[other, i] += force
            elif kind == ContactKind.OBJECT_OBJECT:
                forces.object[one - fingers, i] -= force
                forces.object[other - fingers, i] += force


@kernel
def _measure_ways(state: State, start: Array, system: System, theta: Array, hand_velocity: float, ways: Array) -> None:
    """Write how far fingers, each object and the hand move in a sub-step, at the most [m].

    No section of a muscle turns faster than the sum of its rates; an object's farthest point is in a corner.
    """
    muscles, objects, h, fastest = state.shape.shape[0], state.position.shape[0], abs(system.step_s), 0.0
    fingers = theta.shape[0] - objects
    size, length = muscles // fingers, system.rod.farthest * system.rod.balls.shape[0]
    for f in range(fingers):
        rates = 0.0
        for i in range(f * size, (f + 1) * size):
            rates += abs((1.0 - theta[f]) * start[i] + theta[f] * state.velocity[i])
        fastest = max(fastest, length * rates)
    ways[0], ways[-1] = h * fastest, h * abs(hand_velocity)
    for k in range(objects):
        v, w = vector(state.velocity, muscles + 6 * k), vector(state.velocity, muscles + 6 * k + 3)
        ways[1 + k] = h * (norm(v) + norm(w) * norm(row(system.surroundings.halves, k)))


@kernel
def _look_wider(spots: Places, before: Array, radius: float, pull: float, hand_m: float) -> bool:
    """Whether any two bodies came nearer by more than what was looked for, with the ``before`` ways; then mark them."""
    wider, bodies = False, spots.wide.shape[0]
    for other in range(bodies):
        for one in range(other + 1):
            if one == other and one > 0:
                continue
            sought = pull + 1.5 * (closing(before, one, other) + hand_m)
            if spots.wide[one] or spots.wide[other]:
                sought = 1.1 * closing(before, one, other)
            if closing(spots.ways, one, other) > max(sought, radius):
                wider = True
                spots.wide[other] = True
                if one > 0:
                    spots.wide[one] = True
    return wider


@kernel
def _use_up_clearance(spots: Places, before: Array, known: bool) -> None:
    """Take off the muscles' clearance what they and objects may have moved in the sub-step, if that is ``known``.

    What moves freely moves at the mean of its velocities ``before`` and after.
    """
    farthest = 0.0
    for i in range(before.shape[0]):
        before[i] = max(before[i], spots.ways[i])
    for other in range(spots.wide.shape[0]):
        farthest = max(farthest, closing(before, 0, other))
    spots.clear[0] = max(spots.clear[0] - farthest, 0.0) if known else 0.0


@kernel
def _near(parts: Parts, lift: float, pull: float, hand_m: float) -> bool:
    """Whether any muscle may touch something: what is as near to where the last sweep saw them as it may come does."""
    system, work, around, spots = parts.system, parts.work, parts.system.surroundings, parts.work.spots
    if around.table_in_reach:
        return True
    if around.shapes.shape[0] == 0 and not around.fingers_touch:
        return False
    widest, _ = look(spots, 0, 0, pull, hand_m)
    for k in range(around.shapes.shape[0]):
        widest = max(widest, look(spots, 0, 1 + k, pull, hand_m)[0])
    if spots.clear[0] > widest:
        return False
    for f in range(work.midpoint_known.shape[0]):
        if not work.midpoint_known[f]:
            return True
    radius = system.rod.radius
    gap = max(look(spots, 0, 0, pull, hand_m)[0], radius) + closing(spots.ways, 0, 0)
    write_boxes(system.bases, system.rod, work.motion, 0.5 * gap, work.room_of_lines)
    if around.fingers_touch and fingers_near(work.room_of_lines):
        return True
    for k in range(around.shapes.shape[0]):
        own_gap = max(look(spots, 0, 1 + k, pull, hand_m)[0], radius) + closing(spots.ways, 0, 1 + k)
        x, y, z = row(parts.state.position, k)
        within = norm(row(around.halves, k)) + own_gap - 0.5 * gap
        for f in range(system.bases.shape[0]):
            if near_ball(work.room_of_lines, f, (x, y, z + lift), within):
                return True
    spots.clear[0] = max(spots.clear[0], radius)
    return False


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
def _all_touch(fingers: int, island: NDArray[np.int64]) -> bool:
    """Whether all muscles touch something."""
    for f in range(fingers):
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
    state: State, system: System, lift: float, hand_velocity: float, near: bool, pull: float, work: Work,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Find the contacts and which bodies they tie to each other, and choose theta for each.

    Where nothing is ``near`` a muscle only the objects and what they rest on are looked at.
    """
    for k in range(state.position.shape[0]):
        write_rotation(state.orientation[k], work.rotation[k])
    find_contacts(
        system.bases, system.rod, work.touch_motion, system.surroundings, state.position, work.rotation, lift,
        hand_velocity, near, system.step_s, pull, work.start, work.rates, work.spots, work.room_of_lines, contacts,
    )  # fmt: skip
    recall(Grip(state.held, state.slots, state.springs), contacts)
    find_islands(contacts, work.theta.shape[0], work.equations.island)
    for body in range(work.theta.shape[0]):
        if work.equations.island[body] >= 0:
            work.theta[body] = 1.0


@kernel
def _too_deep(h: float, contacts: Contacts) -> bool:
    """Whether anything ends so deep in something else that it would come out behind, or beside."""
    for c in range(contacts.count[0]):
        depth = contacts.depth[c] - h * dot(vector(contacts.normal[c], 0), vector(contacts.velocity[c], 0))
        if depth > contacts.limit[c]:
            return True
    return False


@kernel
def _look_ahead(velocity: Array, start: Array, extrapolate: bool, gain: Array, ahead: Array) -> None:
    """Write how the velocities have changed, and will if they go on as in the last two sub-steps, or in this one."""
    for i in range(velocity.shape[0]):
        change = velocity[i] - start[i]
        ahead[i] = 2.0 * change - gain[i] if extrapolate else change
        gain[i] = change


@kernel
def _solve_touching(parts: Parts, gravity: Vector, anew: bool, ahead: bool) -> tuple[int, int]:
    """Write the velocities of objects and of muscles that touch something; return OK or not, and Newton's steps.

    Where a muscle asks for what it is like at the start, ``anew``, its masses and loads are found there.
    """
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    island, fingers, iterations = work.equations.island, work.midpoint_known.shape[0], 0
    bodies = island.shape[0]
    if anew:
        start = work.touch_room
        masses_and_loads(system.rod, work.touch_motion, gravity, start.work, start.mass, start.load)
        muscle_equations(system, work.theta, start)
        spread_equations(start.a, start.b, fingers, work.a, work.b)
        _keep_masses(work.midpoint_known, island, start, work.room)
    for k in range(bodies - fingers):
        if island[fingers + k] < 0:
            if not move_object_freely(state, system, k, work):
                return NOT_FINITE, iterations
        else:
            object_equations(state, work.start, system, k, 0.0, work.rotation[k], work.middle, work.a, work.b)
    for body in range(bodies if contacts.count[0] > 0 else 0):
        if ahead and island[body] >= 0:
            begin, end = equations_of(body, fingers, contacts.coordinates)
            for i in range(begin, end):
                state.velocity[i] += work.ahead[i]
    for body in range(bodies if contacts.count[0] > 0 else 0):
        if island[body] == body:
            left, count = solve_contacts(
                work.a, work.b, state.velocity, body, system.step_s, system.laws, contacts, work.equations
            )
            iterations = max(iterations, count)
            if not left < SOLVED_M_S:
                return NOT_SOLVED, iterations
    return OK, iterations


@kernel
def _solve_free(parts: Parts, gravity: Vector) -> int:
    """Write the velocities of the muscles that touch nothing, sweep by sweep; return OK or what went wrong."""
    state, system, work = parts.state, parts.system, parts.work
    room, island, fingers = work.room, work.equations.island, work.midpoint_known.shape[0]
    if parts.contacts.count[0] > 0:
        take_lanes(state.velocity, room.velocity, fingers)
    for sweep in range(system.sweeps):
        if sweep > 0:
            move_muscles(system, 0.5, work.motion, room)
            masses_and_loads(system.rod, work.motion, gravity, room.work, room.mass, room.load)
        muscle_equations(system, work.theta, room)
        solved, changed = solve_muscles(room, fingers, island, state.velocity)
        if not solved:
            return NOT_FINITE
        if changed < FOUND_RAD_S:
            break
    return OK


@kernel
def _find_velocities(parts: Parts, heights: Array, rates: Array, step: int, ahead: bool) -> tuple[int, int]:
    """Write the velocities after a sub-step; return OK or what went wrong, and Newton's steps.

    Bodies that touch are solved island by island, at the start. Each other one is solved alone: the first sweep has
    what the step before saw at its midpoint, later ones are at the midpoint that the one before found. If then
    something moved farther than what was looked for, all is done again with a wider look.
    """
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    island, known, iterations = work.equations.island, work.midpoint_known, 0
    lift, hand, radius = heights[step], rates[step + 1], system.rod.radius
    drive_lanes(parts.drive, (step + 0.5) / (heights.shape[0] - 1), system.rod, work.room)
    gravity = (
        system.gravity[0],
        system.gravity[1],
        system.gravity[2] + (rates[step + 1] - rates[step]) / system.step_s,
    )
    pull, hand_m = max(system.step_s * system.step_s * norm(gravity) - SEEN_LATE_M, 0.0), abs(system.step_s * hand)
    spots, before = work.spots, work.before_ways
    spots.wide[:] = False
    wider = False
    for _ in range(LOOKS):
        for i in range(before.shape[0]):
            before[i] = spots.ways[i]
        near = _near(parts, lift, pull, hand_m)
        _let_go(island, work.theta, contacts)
        for i in range(state.velocity.shape[0]):
            state.velocity[i] = work.start[i]
        if near or not _all_known(known, island):
            move_muscles(system, 0.0, work.touch_motion, work.touch_room)
        if near or state.position.shape[0] > 0:
            _touch(state, system, lift, hand, near, pull, work, contacts)
        answer, count = _solve_touching(parts, gravity, not _all_known(known, island), ahead)
        iterations = max(iterations, count)
        if answer == OK and not _all_touch(known.shape[0], island):
            answer = _solve_free(parts, gravity)
        if answer != OK:
            return answer, iterations
        _measure_ways(state, work.start, system, work.theta, hand, spots.ways)
        if not _look_wider(spots, before, radius, pull, hand_m):
            break
        wider = True
    for f in range(known.shape[0]):
        known[f] = island[f] < 0
    _use_up_clearance(spots, before, ahead and not wider)
    return TOO_DEEP if _too_deep(system.step_s, contacts) else OK, iterations


@kernel(inline="always")
def _advance(parts: Parts, heights: Array, rates: Array) -> tuple[int, int]:
    """Do the work of ``advance``."""
    state, system, contacts, work = parts.state, parts.system, parts.contacts, parts.work
    steps, fingers = heights.shape[0] - 1, work.midpoint_known.shape[0]
    if steps == 0:
        take_lanes(state.shape, work.room.at, fingers)
        take_lanes(state.velocity, work.room.start, fingers)
        move_muscles(system, 0.0, parts.motion, work.room)
        _hold(parts.drive)
        return OK, 0
    iterations, ahead = 0, work.ahead_known[0]
    work.ahead_known[0] = False  # unless all goes well
    copy_state(state, work.before)
    midpoints = work.midpoints
    directors, load, mass, known = midpoints.directors, midpoints.load, midpoints.mass, midpoints.known
    copy_lanes(work.motion.tangent, work.room.load, work.room.mass, directors, load, mass)
    for f in range(fingers):
        known[f] = work.midpoint_known[f]
    for step in range(steps):
        for i in range(state.velocity.shape[0]):
            work.start[i] = state.velocity[i]
        take_lanes(state.shape, work.room.at, fingers)
        take_lanes(work.start, work.room.start, fingers)
        answer, count = _find_velocities(parts, heights, rates, step, ahead)
        iterations = max(iterations, count)
        if answer == OK:
            answer = _move(state, work.start, system.step_s, system.rod.stretches.shape[1], work.theta, work.turn)
        if answer != OK:
            copy_state(work.before, state)
            copy_lanes(directors, load, mass, work.motion.tangent, work.room.load, work.room.mass)
            for f in range(fingers):
                work.midpoint_known[f] = known[f]
            work.spots.clear[0] = 0.0
            return answer, iterations
        remember(system.step_s, system.laws, contacts, Grip(state.held, state.slots, state.springs))
        _look_ahead(state.velocity, work.start, ahead, work.gain, work.ahead)
        ahead = True
    work.ahead_known[0] = ahead
    _hold(parts.drive)
    _sum_forces(contacts, parts.forces)
    return OK, iterations


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
    work.spots.ways[:], work.spots.clear[:] = 0.0, 0.0


def _sample() -> Parts:
    """Return parts of the types that all have: of one muscle with one segment and one ball."""
    one, square, pair, none = np.ones(1), np.ones((1, 1)), np.ones((1, 2)), np.ones((2, 0))
    rod = Rod(
        np.ones((1, 2, 1)), np.ones((1, 2, 0)), none, one, none[0], 1.0, square, none[0], one, pair, pair, 1.0, 1.0, 1.0
    )
    nothing, line, plane = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    around = Surroundings(np.zeros(0, np.int64), line, plane, False, False)
    system = System(1.0, 1, np.zeros(3), np.zeros((1, 3)), rod, 0.0, nothing, line, around, np.zeros((6, 6)))
    contacts = contact_table(1, 2, 1)
    state = new_state(contacts, np.zeros(2), np.zeros(2), line, np.zeros((0, 4)))
    return assemble(state, system, contacts)


_SAMPLE = _sample()
_read = access(_SAMPLE)


def _cached(digest: int) -> Callable[[Block, Array, Array], tuple[int, int]]:
    """Compile ``advance`` into the cache on disk.

    The cache only watches the file of the cached function. A digest of all sources it is built from, being part of
    the closure, is part of the cache's key: no stale machine code after an edit of another file.
    """

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

    return advance


def kernel_sources() -> list[Path]:
    """Return all files that hold compiled code of the step."""
    folders = (Path(__file__).parent, Path(surfaces.__file__).parent)
    return [source for folder in folders for source in sorted(folder.glob("*.py"))]


advance = _cached(source_digest(kernel_sources()))


def bind(parts: Parts) -> Block:
    """Return the parts for :func:`advance`; changes of their arrays are seen on both sides. Keep them as long as this.

    Raises:
        TypeError: an array is not contiguous or not of its type.
    """
    return new_block(parts, _SAMPLE)
