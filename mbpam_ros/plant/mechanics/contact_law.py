r"""Contact: the table of contacts, and the force law of each.

Bodies are numbered: the fingers, then the objects. A contact has a point, a normal N (into the body that is pushed: the
object, a finger on the table, or of two fingers or two objects the one of higher number) and a Jacobian J that maps the
system's velocities to the relative velocity (3) and relative turning rate (3) there. With depth d at the start of a
step of length h (negative: a gap), the velocity v after it, the share w of the law's stiffness that the contact stands
for, and what the springs of the patch hold at the start, x (tangential), psi (about N) and rho (rolling):

    normal     f   = w max(0, k d - (k h + c) v.N)                     penalty at the end of the step; never pulls
                   = w max(0, (k + c / h) (d - h v.N)) where d < 0     a gap that closes within the step
    tangential F_t = -w s [k (x + h v_t) + c v_t], |F_t| <= mu f       sticks, and slips at Coulomb's cone
    spin       T_n = -w s a^2 [k (psi + h w_n) + c w_n], |T_n| <= mu l_spin f
    rolling    T_t = -w s a^2 [k (rho + h w_t) + c w_t], |T_t| <= l_roll f

s = 2/3 is the stiffness of a patch on an incompressible half-space along its plane over that across (R. D. Mindlin,
"Compliance of elastic bodies in contact", 1949), and s a^2 that against tilting and turning, a its radius. After the
step the springs hold x + h v_t, but no more than what the bound lets them: so a contact that sticks comes to rest for
good, and one that slips goes on from the cone.

The bound is that of the f of the same step. For given bounds all forces are minus the gradient of a convex function of
v (A. Castro et al., "A theory of irrotational contact fields", 2023), which Newton's method minimises; the bounds are
found with it (:mod:`~mbpam_ros.plant.mechanics.contact_solver`). The springs are those of an implicit Euler step:
whatever the step, they give back no more than was put into them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.contact_config import ContactLaw
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array, Vector, combined, dot, minus, norm, plus, times, vector

SHEAR = 2.0 / 3.0
"""s."""

SPRINGS = 7
"""Numbers that the springs of a contact hold: x (3), rho (3), psi."""


class Contacts(NamedTuple):
    """Table with a row for each contact that may be.

    Args:
        count: how many rows are in use, shape (1,).
        slot: what touches what, a number that the contact keeps from step to step and that rises along the table, (n,).
        depth, share: d and w, shape (n,).
        load: f as the bounds have it, shape (n,).
        limit: depth that would come out behind, or beside [m], shape (n,).
        normal, jacobian: N, shape (n, 3), and J^T, shape (n, rows, 6); its rows: the D coordinates of a finger or an
            object's six, then those of the other body. Of what touches no finger but a support they begin at D.
        springs: x, rho, psi at the start of the step, shape (n, 7).
        rise: part of the relative velocity along z that is the hand's, shape (n,).
        one, other: bodies that take part, the lower number first; -1 for none: ``one`` where an object touches a
            support or the palm, ``other`` where a finger does.
        kind: of :class:`~mbpam_ros.plant.mechanics.contact_config.ContactKind`, the row of the table of laws.
        velocity, force: relative velocity after the step, and the force and torque it makes, shape (n, 6).
        change: of the velocity along a step of its solution, shape (n, 6).
        push: f, shape (n,).
        fingers, coordinates: how many muscles, and their D.
    """

    count: NDArray[np.int64]  # type: ignore[assignment]  # hides tuple.count, which nothing asks for
    slot: NDArray[np.int64]
    depth: Array
    share: Array
    load: Array
    limit: Array
    normal: Array
    jacobian: Array
    springs: Array
    rise: Array
    one: NDArray[np.int64]
    other: NDArray[np.int64]
    kind: NDArray[np.int64]
    velocity: Array
    force: Array
    change: Array
    push: Array
    fingers: int
    coordinates: int


def contact_table(size: int, coordinates: int, fingers: int, objects: int = 1) -> Contacts:
    """Return a table with room for ``size`` contacts of so many bodies, the fingers with ``coordinates`` D each."""
    rows = max(coordinates + max(coordinates, 6), 12 if objects > 1 else 0)
    return Contacts(
        count=np.zeros(1, np.int64),
        slot=np.zeros(size, np.int64),
        depth=np.zeros(size),
        share=np.zeros(size),
        load=np.zeros(size),
        limit=np.zeros(size),
        normal=np.zeros((size, 3)),
        jacobian=np.zeros((size, rows, 6)),
        springs=np.zeros((size, SPRINGS)),
        rise=np.zeros(size),
        one=np.zeros(size, np.int64),
        other=np.full(size, -1, np.int64),
        kind=np.zeros(size, np.int64),
        velocity=np.zeros((size, 6)),
        force=np.zeros((size, 6)),
        change=np.zeros((size, 6)),
        push=np.zeros(size),
        fingers=fingers,
        coordinates=coordinates,
    )


@kernel
def equations_of(body: int, fingers: int, coordinates: int) -> tuple[int, int]:
    """Return the first equation of a body, and the first of the next one."""
    if body < fingers:
        return coordinates * body, coordinates * (body + 1)
    first = coordinates * fingers + 6 * (body - fingers)
    return first, first + 6


class Grip(NamedTuple):
    """What the springs hold between two steps: how many contacts, which (n,), and x, rho, psi of each (n, 7)."""

    count: NDArray[np.int64]  # type: ignore[assignment]
    slot: NDArray[np.int64]
    springs: Array


def no_grip(size: int) -> Grip:
    """Return what springs hold where nothing touches, with room for ``size`` contacts."""
    return Grip(np.zeros(1, np.int64), np.zeros(size, np.int64), np.zeros((size, SPRINGS)))


@kernel
def law_of(laws: Array, kind: int) -> ContactLaw:
    """Return a row of the table of laws (kinds, 6)."""
    return ContactLaw(laws[kind, 0], laws[kind, 1], laws[kind, 2], laws[kind, 3], laws[kind, 4], laws[kind, 5])


@kernel(forceinline=True)
def _unbounded(
    law: ContactLaw, h: float, depth: float, share: float, n: Vector, springs: Array, v: Array
) -> tuple[float, Vector, float, Vector]:
    """Return f, and -F_t, -T_n and -T_t without their bounds."""
    velocity, turning = vector(v, 0), vector(v, 3)
    vn, wn = dot(n, velocity), dot(n, turning)
    stiff, slow = law.stiffness, law.stiffness * h + law.damping
    closing = stiff if depth >= 0.0 else stiff + law.damping / h
    f: float = max(share * (closing * depth - slow * vn), 0.0)
    shear, tilt = share * SHEAR, share * SHEAR * law.patch * law.patch
    along, rolling = minus(velocity, times(vn, n)), minus(turning, times(wn, n))
    return (
        f,
        combined(shear * stiff, vector(springs, 0), shear * slow, along, 0.0, n),
        tilt * (stiff * springs[6] + slow * wn),
        combined(tilt * stiff, vector(springs, 3), tilt * slow, rolling, 0.0, n),
    )


@kernel(forceinline=True)
def _part(size: float, bound: float) -> float:
    """Return what part of a force is within its bound."""
    if size <= bound:
        return 1.0
    return bound / size


@kernel
def contact_force(
    law: ContactLaw, h: float, depth: float, share: float, load: float, normal: Array, springs: Array, v: Array,
    force: Array,
) -> float:  # fmt: skip
    """Write force and torque (6,) on the pushed body for the relative velocity v (6,) after the step; return f.

    ``load`` is the f of the bounds; below 0, that which is returned.
    """
    n = vector(normal, 0)
    f, along, spin, rolling = _unbounded(law, h, depth, share, n, springs, v)
    load = load if load >= 0.0 else f
    along = times(-_part(norm(along), law.friction * load), along)
    spin *= -_part(abs(spin), law.spin * load)
    rolling = times(-_part(norm(rolling), law.roll * load), rolling)
    for i in range(3):
        force[i] = f * n[i] + along[i]
        force[3 + i] = spin * n[i] + rolling[i]
    return f


@kernel
def contact_slope(
    law: ContactLaw, h: float, depth: float, share: float, load: float, normal: Array, springs: Array, v: Array,
    slope: Array,
) -> None:  # fmt: skip
    """Write -d(force)/d(velocity) and -d(torque)/d(turning rate) into ``slope`` (2, 3, 3): symmetric, positive."""
    n = vector(normal, 0)
    f, along, spin, rolling = _unbounded(law, h, depth, share, n, springs, v)
    slow = law.stiffness * h + law.damping
    drag, tilt = share * SHEAR * slow, share * SHEAR * slow * law.patch * law.patch
    stiff = share * slow if f > 0.0 else 0.0
    twist = tilt if abs(spin) < law.spin * load else 0.0
    slip, roll = norm(along), norm(rolling)
    # Beyond its bound a force only turns with the velocity.
    along_2 = 0.0 if slip < law.friction * load else 1.0 / max(slip * slip, 1e-300)
    rolling_2 = 0.0 if roll < law.roll * load else 1.0 / max(roll * roll, 1e-300)
    drag *= _part(slip, law.friction * load) if law.friction * load > 0.0 else 0.0
    tilt *= _part(roll, law.roll * load) if law.roll * load > 0.0 else 0.0
    for i in range(3):
        for j in range(3):
            outward = n[i] * n[j]
            across = (1.0 if i == j else 0.0) - outward
            slope[0, i, j] = stiff * outward + drag * (across - along_2 * along[i] * along[j])
            slope[1, i, j] = twist * outward + tilt * (across - rolling_2 * rolling[i] * rolling[j])


@kernel
def bounds_hold(
    law: ContactLaw, h: float, depth: float, share: float, load: float, normal: Array, springs: Array, v: Array,
    push: float, tolerance: float, below: bool,
) -> bool:  # fmt: skip
    """Whether the bounds are those of f = ``push``, to a relative tolerance, or it makes no difference.

    Those ``below`` them will do if so said.
    """
    if abs(load - push) <= tolerance * push or (below and load <= push):
        return True
    _, along, spin, rolling = _unbounded(law, h, depth, share, vector(normal, 0), springs, v)
    least = min(load, push)
    return norm(along) <= law.friction * least and abs(spin) <= law.spin * least and norm(rolling) <= law.roll * least


@kernel
def recall(grip: Grip, contacts: Contacts) -> None:
    """Give the contacts what their springs hold, turned with their normals; those that are new hold nothing."""
    held = 0
    for c in range(contacts.count[0]):
        slot, springs = contacts.slot[c], contacts.springs[c]
        while held < grip.count[0] and grip.slot[held] < slot:
            held += 1
        if held == grip.count[0] or grip.slot[held] != slot:
            for i in range(SPRINGS):
                springs[i] = 0.0
            continue
        before, n = grip.springs[held], vector(contacts.normal[c], 0)
        for first in (0, 3):
            part = vector(before, first)
            springs[first], springs[first + 1], springs[first + 2] = minus(part, times(dot(part, n), n))
        springs[6] = before[6]


@kernel
def remember(h: float, laws: Array, contacts: Contacts, grip: Grip) -> None:
    """Keep what the springs hold after the step; of a step in which a gap closes, only the part after that counts."""
    grip.count[0] = contacts.count[0]
    for c in range(contacts.count[0]):
        law, load, share = law_of(laws, contacts.kind[c]), contacts.push[c], contacts.share[c]
        n, before, after = vector(contacts.normal[c], 0), contacts.springs[c], grip.springs[c]
        velocity, turning = vector(contacts.velocity[c], 0), vector(contacts.velocity[c], 3)
        vn, wn = dot(n, velocity), dot(n, turning)
        way = contacts.depth[c] - h * vn  # the depth after the step
        touched = h if contacts.depth[c] >= 0.0 else h * max(way, 0.0) / max(-h * vn, way, 1e-300)
        along = plus(vector(before, 0), times(touched, minus(velocity, times(vn, n))))
        rolling = plus(vector(before, 3), times(touched, minus(turning, times(wn, n))))
        spin = before[6] + touched * wn
        stiff = share * SHEAR * law.stiffness
        tilt = stiff * law.patch * law.patch
        along = times(_part(stiff * norm(along), law.friction * load), along)
        rolling = times(_part(tilt * norm(rolling), law.roll * load), rolling)
        after[0], after[1], after[2] = along
        after[3], after[4], after[5] = rolling
        after[6] = spin * _part(tilt * abs(spin), law.spin * load)
        grip.slot[c] = contacts.slot[c]
