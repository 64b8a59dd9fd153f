"""The muscles' equations of a step, one muscle a lane (:mod:`~mbpam_ros.plant.mechanics.lanes`).

They are those of :mod:`~mbpam_ros.plant.mechanics.step`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.kernel import kernel, piece
from mbpam_ros.plant.mechanics.lanes import Lanes, Place, all_above, load, splat, store
from mbpam_ros.plant.mechanics.parts import Drive, Room, System
from mbpam_ros.plant.mechanics.rod import Motion, Rod, move_rods
from mbpam_ros.plant.mechanics.vectors import Array


@kernel
def take_lanes(values: Array, lanes: Array, fingers: int) -> None:
    """Write the coordinates of all muscles one after another, (4 D, or more), as lanes (D, 4)."""
    size = lanes.shape[0]
    for f in range(fingers):
        for i in range(size):
            lanes[i, f] = values[f * size + i]


@kernel
def move_muscles(system: System, share: float, motion: Motion, room: Room) -> None:
    """Write the motion of the muscles after ``share`` of the step."""
    for i in range(room.at.shape[0]):
        rate = (1.0 - share) * load(room.start, (i,)) + share * load(room.velocity, (i,))
        store(room.rate, (i,), rate)
        store(room.shape, (i,), load(room.at, (i,)) + share * system.step_s * rate)
    move_rods(room.shape, room.rate, system.rod, motion)


@piece
def drive_lanes(drive: Drive, blend: float, rod: Rod, room: Room) -> None:
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
def muscle_equations(system: System, theta: Array, room: Room) -> None:
    """Write the muscles' equations a v = b with the masses, loads and drives in ``room``."""
    h, eta, springs = system.step_s, system.retardation, system.rod.springs
    bends, stretches, size = 2 * system.rod.bends.shape[2], system.rod.stretches.shape[1], room.at.shape[0]
    for f in range(system.bases.shape[0]):
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
def spread_equations(room_a: Array, room_b: Array, fingers: int, a: Array, b: Array) -> None:
    """Write the muscles' equations into rows and columns of all bodies' a v = b."""
    size = room_b.shape[0]
    for f in range(fingers):
        for i in range(size):
            b[f * size + i] = room_b[i, f]
            for j in range(size):
                a[f * size + i, f * size + j] = room_a[i, j, f]


@piece
def solve_muscles(room: Room, fingers: int, island: NDArray[np.int64], velocity: Array) -> tuple[bool, float]:
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
    for f in range(fingers):
        for i in range(size if island[f] < 0 else 0):
            n = f * size + i
            changed = max(changed, abs(b[i, f] - velocity[n]))
            velocity[n] = room.velocity[i, f] = b[i, f]
    return True, changed
