"""Where bodies touch: fills the table of contacts from a configuration.

A muscle is a row of balls of its radius along its centreline, up to one radius before its end, so that its rounded tip
ends where the muscle ends. Each ball that overlaps a solid is one contact and stands for the length of muscle about
it. So the force is spread along the muscle as depth is, and does not jump where a muscle lies along a face. A gap that
may close within the step is a contact too: what moves fast is met where it comes from.

``forceinline``: handing a dozen arrays to a function that is called for each ball takes as long as its work.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbpam_ros.geometry.surfaces import PLANE, REST_POINTS, rest_points, signed_distance
from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts
from mbpam_ros.plant.mechanics.finger_contact import Lines, append_finger_contacts
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.outlook import Outlook, ball_velocity, closes, object_velocity, write_rates
from mbpam_ros.plant.mechanics.rod import Motion, Rod, ball_jacobian, ball_position
from mbpam_ros.plant.mechanics.vectors import Array, Vector, minus, plus, row, times, to_body, to_world, vector

BALLS = 49
"""Balls along a muscle: 2.5 mm apart."""

PLATE_THICKNESS_M = 0.010
"""A support with a footprint is a plate: what is deeper than this below its top has gone past its edge."""


class Surroundings(NamedTuple):
    """What muscles may touch.

    Args:
        shape: code of the object's; -1 without an object.
        half: half its sizes, shape (3,).
        planes: rows (depth, half size x, half size y) of level supports, the table last.
        table_in_reach: whether a muscle may touch the last plane.
        fingers_touch: whether muscles touch each other, or pass through each other.
    """

    shape: int
    half: Array
    planes: Array
    table_in_reach: bool
    fingers_touch: bool = False


class Places(NamedTuple):
    """Where fingers and planes are: a clamp (3,), the table's origin (3,) and axes (3, 3), and room for rest points."""

    base: Array
    plane: Array
    level: Array
    points: Array


def places(around: Surroundings) -> Places:
    """Return the places of the surroundings; clamp and rest points are to be written."""
    plane = np.zeros(3)
    if around.table_in_reach:
        plane[2] = around.planes[-1, 0]
    return Places(np.zeros(3), plane, np.eye(3), np.zeros((REST_POINTS, 5)))


def contact_limit(fingers: int, planes: int, fingers_touch: bool = False) -> int:
    """Return the most contacts that can be."""
    between = BALLS * fingers * (fingers - 1) if fingers_touch else 0
    return 2 * BALLS * fingers + between + REST_POINTS * (planes + 1)


@kernel
def _object_columns(place: Vector, d: int, jacobian: Array) -> None:
    """Write the velocity at a place from a body's centre into columns D to D + 5 of ``jacobian``."""
    x, y, z = place
    for i in range(6):
        for j in range(6):
            jacobian[i, d + j] = 1.0 if i == j else 0.0
    jacobian[0, d + 4], jacobian[0, d + 5] = z, -y
    jacobian[1, d + 3], jacobian[1, d + 5] = -z, x
    jacobian[2, d + 3], jacobian[2, d + 4] = y, -x


@kernel(forceinline=True)
def _muscle_contacts(
    rod: Rod, motion: Motion, finger: int, base: Array, shape: int, half: Array, centre: Array, rotation: Array,
    slot: int, rise: float, outlook: Outlook, contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of one muscle with one solid.

    The distance changes by no more than the arc length: far from the solid, balls are left out.
    """
    balls = rod.balls.shape[0]
    sign = 1.0 if shape == PLANE else -1.0  # what is pushed: the muscle by a plane, or the object by the muscle
    nearest = 0  # the next ball that may touch
    for k in range(balls):
        if k < nearest:
            continue
        place = minus(plus(ball_position(rod, motion, finger, k), vector(base, 0)), vector(centre, 0))
        x, y, z = to_body(rotation, place)
        distance, gx, gy, gz = signed_distance(shape, half, x, y, z)
        depth = rod.radius - distance
        if depth <= -outlook.reach:
            nearest = k + math.ceil(-(depth + outlook.reach) / rod.farthest)
            continue
        outward = to_world(rotation, (gx, gy, gz))
        arm = times(-0.5 * (distance + rod.radius), outward)  # to the point half-way between the two surfaces
        muscle, solid = plus(ball_velocity(rod, outlook, finger, k), (0.0, 0.0, -rise)), (0.0, 0.0, 0.0)
        if shape != PLANE:
            solid = object_velocity(outlook, plus(place, arm))
        if not closes(outlook, depth, outward, solid, muscle):
            continue
        n = contacts.count[0]
        contacts.count[0] = n + 1
        contacts.depth[n], contacts.slot[n], contacts.finger[n], contacts.rise[n] = (
            depth,
            slot + k,
            finger,
            sign * -rise,
        )
        contacts.kind[n] = ContactKind.FINGER_SUPPORT if shape == PLANE else ContactKind.FINGER_OBJECT
        # The length about the ball, over the radius; the rounded tip counts as one radius more.
        length = rod.spacing if 0 < k < balls - 1 else 0.5 * rod.spacing
        contacts.share[n] = length / rod.radius + (1.0 if k == balls - 1 else 0.0)
        normal, jacobian = contacts.normal[n], contacts.jacobian[n].T
        normal[0], normal[1], normal[2] = times(sign, outward)
        ball_jacobian(rod, motion, finger, k, sign, arm, jacobian)
        if shape != PLANE:
            _object_columns(plus(place, arm), contacts.coordinates, jacobian)


@kernel
def _rest_contacts(
    around: Surroundings, centre: Array, rotation: Array, lift: float, hand_velocity: float, points: Array,
    slot: int, reach: float, contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of the object with its supports and the palm."""
    for p in range(around.planes.shape[0] + 1):
        palm = p == around.planes.shape[0]
        foot_x = np.inf if palm else around.planes[p, 1]
        foot_y = np.inf if palm else around.planes[p, 2]
        for k in range(rest_points(around.shape, around.half, centre, rotation, foot_x, foot_y, points)):
            place = minus(row(points, k), vector(centre, 0))
            if palm:  # all solids are symmetric about their centres: their highest points mirror the lowest
                place = times(-1.0, place)
                depth = -lift - centre[2] - place[2]
            else:
                depth = centre[2] + place[2] - around.planes[p, 0]
            if depth <= -reach or (foot_x < np.inf and depth > PLATE_THICKNESS_M):
                continue
            n = contacts.count[0]
            contacts.count[0] = n + 1
            contacts.depth[n], contacts.share[n] = depth, points[k, 4]
            contacts.slot[n] = slot + REST_POINTS * p + int(points[k, 3])
            contacts.normal[n, 0], contacts.normal[n, 1] = 0.0, 0.0
            contacts.normal[n, 2] = 1.0 if palm else -1.0
            contacts.rise[n] = hand_velocity if palm else 0.0
            contacts.finger[n], contacts.kind[n] = -1, ContactKind.OBJECT_PALM if palm else ContactKind.OBJECT_SUPPORT
            _object_columns(place, contacts.coordinates, contacts.jacobian[n].T)


@kernel(inline="always")
def find_contacts(
    bases: Array, rod: Rod, motion: Motion, around: Surroundings, centre: Array, rotation: Array,
    lift: float, hand_velocity: float, near: bool, outlook: Outlook, room: Places, room_of_lines: Lines,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Fill the table from the configuration at the start of a sub-step; without muscles if nothing is ``near`` one."""
    base = room.base
    contacts.count[0] = 0
    if near:
        write_rates(motion, contacts.coordinates, outlook)
    for f in range(bases.shape[0] if near else 0):
        base[0], base[1], base[2] = bases[f, 0], bases[f, 1], bases[f, 2] - lift
        for kind in (ContactKind.FINGER_OBJECT, ContactKind.FINGER_SUPPORT):
            on_object = kind == ContactKind.FINGER_OBJECT
            if (on_object and around.shape < 0) or not (on_object or around.table_in_reach):
                continue
            shape, place, turn = around.shape, centre, rotation
            if not on_object:
                shape, place, turn = PLANE, room.plane, room.level
            slot = BALLS * (2 * f + (0 if on_object else 1))
            _muscle_contacts(
                rod, motion, f, base, shape, around.half, place, turn, slot, hand_velocity, outlook, contacts
            )
    rest = 2 * BALLS * bases.shape[0]
    if around.shape >= 0:
        _rest_contacts(around, centre, rotation, lift, hand_velocity, room.points, rest, outlook.reach, contacts)
    if around.fingers_touch and near:
        between = rest + REST_POINTS * (around.planes.shape[0] + 1)
        append_finger_contacts(bases, rod, motion, room_of_lines, between, outlook, contacts)
