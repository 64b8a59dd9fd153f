r"""Contact: the table of contacts, and the force law of each.

A contact has a point, a normal N (into the body that is pushed: the object, a finger on the table, or of two fingers
the one of higher number) and a Jacobian J that maps the system's velocities to the relative velocity (3) and relative
turning rate (3) there. With depth d > 0 at the start of a step of length h, the velocity v after it, and |x|_e =
sqrt(x^2 + e^2):

    normal     f = w max(0, k d - (k h + c) v.N)                penalty at the end of the step; never pulls
    tangential F_t = -mu w k d v_t / |v_t|_slip                 Coulomb; sticking below the slip speed
    spin       T_n = -mu w k d l_spin w_n / |w_n|_slip          friction of a soft patch about its normal
    rolling    T_t = -w k d l_roll w_t / |w_t|_slip             hysteresis of a soft patch

w is the share of the law's stiffness that the contact stands for. Friction takes its load from the start of the step,
so that all forces together are minus the gradient of a convex function of v (A. Castro et al., "A theory of
irrotational contact fields", 2023): there is one v, and Newton's method finds it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.contact_config import ContactLaw
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array, dot, vector


class Contacts(NamedTuple):
    """Table with a row for each contact that may be.

    Args:
        count: how many rows are in use, shape (1,).
        depth, share: d and w, shape (n,).
        normal, jacobian: N, shape (n, 3), and J^T, shape (n, D + 6 or 2 D, whichever is more, 6); its rows: the
            finger's D coordinates, then the object's six, or the D of the other finger.
        rise: part of the relative velocity along z that is the hand's, shape (n,).
        finger, other: which take part; -1 for none.
        kind: of :class:`~mbpam_ros.plant.mechanics.contact_config.ContactKind`, the row of the table of laws.
        velocity, force: relative velocity after the step, and the force and torque it makes, shape (n, 6).
        change: of the velocity along a step of its solution, shape (n, 6).
        push: f, shape (n,).
        coordinates: D.
    """

    count: NDArray[np.int64]  # type: ignore[assignment]  # hides tuple.count, which nothing asks for
    depth: Array
    share: Array
    normal: Array
    jacobian: Array
    rise: Array
    finger: NDArray[np.int64]
    other: NDArray[np.int64]
    kind: NDArray[np.int64]
    velocity: Array
    force: Array
    change: Array
    push: Array
    coordinates: int


def contact_table(size: int, coordinates: int) -> Contacts:
    """Return a table with room for ``size`` contacts of fingers with ``coordinates`` D each."""
    return Contacts(
        count=np.zeros(1, np.int64),
        depth=np.zeros(size),
        share=np.zeros(size),
        normal=np.zeros((size, 3)),
        jacobian=np.zeros((size, coordinates + max(coordinates, 6), 6)),
        rise=np.zeros(size),
        finger=np.zeros(size, np.int64),
        other=np.full(size, -1, np.int64),
        kind=np.zeros(size, np.int64),
        velocity=np.zeros((size, 6)),
        force=np.zeros((size, 6)),
        change=np.zeros((size, 6)),
        push=np.zeros(size),
        coordinates=coordinates,
    )


@kernel
def law_of(laws: Array, kind: int) -> ContactLaw:
    """Return a row of the table of laws (kinds, 7)."""
    return ContactLaw(
        laws[kind, 0], laws[kind, 1], laws[kind, 2], laws[kind, 3], laws[kind, 4], laws[kind, 5], laws[kind, 6]
    )


@kernel
def contact_force(
    law: ContactLaw, h: float, depth: float, share: float, normal: Array, v: Array, force: Array
) -> float:
    """Write force and torque (6,) on the pushed body for the relative velocity v (6,) after the step; return f."""
    n, velocity, turning = vector(normal, 0), vector(v, 0), vector(v, 3)
    vn, wn = dot(n, velocity), dot(n, turning)
    f: float = max(share * (law.stiffness * depth - (law.stiffness * h + law.damping) * vn), 0.0)
    load = share * law.stiffness * depth
    slip, roll = law.slip_speed * law.slip_speed, law.slip_rate * law.slip_rate
    for i in range(3):
        slip += (velocity[i] - vn * n[i]) ** 2
        roll += (turning[i] - wn * n[i]) ** 2
    drag, curl = load * law.friction / math.sqrt(slip), load * law.roll / math.sqrt(roll)
    twist = load * law.spin / math.sqrt(wn * wn + law.slip_rate * law.slip_rate)
    for i in range(3):
        force[i] = f * n[i] - drag * (velocity[i] - vn * n[i])
        force[3 + i] = -twist * wn * n[i] - curl * (turning[i] - wn * n[i])
    return f


@kernel
def contact_slope(
    law: ContactLaw, h: float, depth: float, share: float, normal: Array, v: Array, f: float, slope: Array
) -> None:
    """Write -d(force)/d(velocity) and -d(torque)/d(turning rate) into ``slope`` (2, 3, 3): symmetric, positive."""
    n, velocity, turning = vector(normal, 0), vector(v, 0), vector(v, 3)
    vn, wn = dot(n, velocity), dot(n, turning)
    load = share * law.stiffness * depth
    slip, roll = law.slip_speed * law.slip_speed, law.slip_rate * law.slip_rate
    spin = wn * wn + law.slip_rate * law.slip_rate
    for i in range(3):
        slip += (velocity[i] - vn * n[i]) ** 2
        roll += (turning[i] - wn * n[i]) ** 2
    drag, curl = load * law.friction / math.sqrt(slip), load * law.roll / math.sqrt(roll)
    stiff = share * (law.stiffness * h + law.damping) if f > 0.0 else 0.0
    twist = load * law.spin / math.sqrt(spin) * (law.slip_rate * law.slip_rate / spin)
    for i in range(3):
        for j in range(3):
            along = n[i] * n[j]
            across = (1.0 if i == j else 0.0) - along
            vv = (velocity[i] - vn * n[i]) * (velocity[j] - vn * n[j])
            ww = (turning[i] - wn * n[i]) * (turning[j] - wn * n[j])
            slope[0, i, j] = stiff * along + drag * (across - vv / slip)
            slope[1, i, j] = twist * along + curl * (across - ww / roll)
