"""Where bodies touch: fills the table of contacts from a configuration.

A muscle is a row of balls of its radius along its centreline, up to one radius before its end, so that its rounded tip
ends where the muscle ends. Each ball that overlaps a solid is one contact and stands for the length of muscle about
it. So the force is spread along the muscle as depth is, and does not jump where a muscle lies along a face. A gap that
may close within the step is a contact too: what moves fast is met where it comes from.

A search also says how far muscles are from anything at the least. Until they may have moved as far there is no other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry.surfaces import PLANE, REST_POINTS, rest_points, signed_distance
from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts, equations_of
from mbpam_ros.plant.mechanics.finger_contact import Lines, append_finger_contacts, near_ball, write_boxes
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.object_contact import PAIR_CONTACTS, append_object_contacts, object_columns, pair_room
from mbpam_ros.plant.mechanics.outlook import Outlook, ball_velocity, closes, object_velocity, write_rates
from mbpam_ros.plant.mechanics.rod import Motion, Rod, ball_jacobian, ball_position
from mbpam_ros.plant.mechanics.vectors import Array, dot, minus, norm, plus, row, times, to_body, to_world, vector

BALLS = 49
"""Balls along a muscle: 2.5 mm apart."""

CLEAR_M = 0.002
"""How much farther than contacts are sought a muscle is known to be clear."""

PLATE_THICKNESS_M = 0.010
"""A support with a footprint is a plate: what is deeper than this below its top has gone past its edge."""


class Surroundings(NamedTuple):
    """What muscles may touch.

    Args:
        shapes, halves: of the objects, their codes and half sizes, shapes (K,) and (K, 3).
        planes: rows (depth, half size x, half size y) of level supports, the table last.
        table_in_reach: whether a muscle may touch the last plane.
        fingers_touch: whether muscles touch each other, or pass through each other.
    """

    shapes: NDArray[np.int64]
    halves: Array
    planes: Array
    table_in_reach: bool
    fingers_touch: bool = False


class Places(NamedTuple):
    """Where fingers and planes are, and room for what is sought.

    Args:
        base: a clamp, shape (3,).
        plane, level: the table's origin and axes, shapes (3,) and (3, 3).
        points, edges: room for rest points, and for two objects' edges.
        ways: how far fingers, each object and the hand moved in the last sub-step [m], shape (K + 2,).
        clear: least distance of a muscle from an object or another muscle [m]; or less than it is, shape (1,).
        wide: whether fingers, and each object, are looked at from farther away: they moved so far when the sub-step was
            done before, shape (K + 1,).
    """

    base: Array
    plane: Array
    level: Array
    points: Array
    edges: Array
    ways: Array
    clear: Array
    wide: NDArray[np.bool_]


def places(around: Surroundings) -> Places:
    """Return the places of the surroundings; clamp and rest points are to be written."""
    plane = np.zeros(3)
    if around.table_in_reach:
        plane[2] = around.planes[-1, 0]
    bodies = 1 + len(around.shapes)
    points, ways, wide = np.zeros((REST_POINTS, 5)), np.zeros(bodies + 1), np.zeros(bodies, np.bool_)
    return Places(np.zeros(3), plane, np.eye(3), points, pair_room(), ways, np.zeros(1), wide)


def contact_limit(fingers: int, planes: int, fingers_touch: bool = False, objects: int = 1) -> int:
    """Return the most contacts that can be."""
    between = BALLS * fingers * (fingers - 1) if fingers_touch else 0
    pairs = objects * (objects - 1) // 2
    at_rest = REST_POINTS * (planes + 1) * objects
    return (objects + 1) * BALLS * fingers + between + at_rest + PAIR_CONTACTS * pairs


@kernel(inline="always")
def _muscle_contacts(
    rod: Rod, motion: Motion, finger: int, base: Array, body: int, shape: int, half: Array, centre: Array,
    rotation: Array, slot: int, rise: float, outlook: Outlook, clear: Array, contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of one muscle with one solid: an object, or no body.

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
        clear[0] = min(clear[0], -depth)
        if depth <= -outlook.reach:
            nearest = k + math.ceil(-(depth + outlook.reach + CLEAR_M) / rod.farthest)
            continue
        outward = to_world(rotation, (gx, gy, gz))
        arm = times(-0.5 * (distance + rod.radius), outward)  # to the point half-way between the two surfaces
        muscle, solid = plus(ball_velocity(rod, outlook, finger, k), (0.0, 0.0, -rise)), (0.0, 0.0, 0.0)
        if shape != PLANE:
            solid = object_velocity(
                outlook, equations_of(body, contacts.fingers, contacts.coordinates)[0], plus(place, arm)
            )
        if not closes(outlook, depth, outward, solid, muscle):
            continue
        n = contacts.count[0]
        contacts.count[0] = n + 1
        contacts.depth[n], contacts.limit[n], contacts.rise[n] = depth, rod.radius, sign * -rise
        contacts.slot[n], contacts.one[n], contacts.other[n] = slot + k, finger, body
        contacts.kind[n] = ContactKind.FINGER_SUPPORT if shape == PLANE else ContactKind.FINGER_OBJECT
        # The length about the ball, over the radius; the rounded tip counts as one radius more.
        length = rod.spacing if 0 < k < balls - 1 else 0.5 * rod.spacing
        contacts.share[n] = length / rod.radius + (1.0 if k == balls - 1 else 0.0)
        normal, jacobian = contacts.normal[n], contacts.jacobian[n].T
        normal[0], normal[1], normal[2] = times(sign, outward)
        ball_jacobian(rod, motion, finger, k, sign, arm, jacobian)
        if shape != PLANE:
            object_columns(plus(place, arm), contacts.coordinates, jacobian)


@kernel
def _rest_contacts(
    around: Surroundings, k: int, centre: Array, rotation: Array, lift: float, hand_velocity: float, points: Array,
    slot: int, reach: float, contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of object ``k`` with its supports and the palm."""
    shape, half = around.shapes[k], around.halves[k]
    farthest = norm(vector(half, 0)) + reach
    for p in range(around.planes.shape[0] + 1):
        palm = p == around.planes.shape[0]
        if (centre[2] + lift > farthest) if palm else (centre[2] + farthest < around.planes[p, 0]):
            continue
        foot_x = np.inf if palm else around.planes[p, 1]
        foot_y = np.inf if palm else around.planes[p, 2]
        for point in range(rest_points(shape, half, centre, rotation, foot_x, foot_y, points)):
            place = minus(row(points, point), vector(centre, 0))
            if palm:  # all solids are symmetric about their centres: their highest points mirror the lowest
                place = times(-1.0, place)
                depth = -lift - centre[2] - place[2]
            else:
                depth = centre[2] + place[2] - around.planes[p, 0]
            if depth <= -reach or (foot_x < np.inf and depth > PLATE_THICKNESS_M):
                continue
            n = contacts.count[0]
            contacts.count[0] = n + 1
            contacts.depth[n], contacts.share[n], contacts.limit[n] = depth, points[point, 4], PLATE_THICKNESS_M
            contacts.slot[n] = slot + REST_POINTS * p + int(points[point, 3])
            contacts.normal[n, 0], contacts.normal[n, 1] = 0.0, 0.0
            contacts.normal[n, 2] = 1.0 if palm else -1.0
            contacts.rise[n] = hand_velocity if palm else 0.0
            contacts.one[n], contacts.other[n] = -1, contacts.fingers + k
            contacts.kind[n] = ContactKind.OBJECT_PALM if palm else ContactKind.OBJECT_SUPPORT
            object_columns(place, contacts.coordinates, contacts.jacobian[n].T)


@kernel
def look(room: Places, one: int, other: int, pull: float, hand_m: float) -> tuple[float, float]:
    """Return below which gap of two bodies a contact is sought, and below which it is one however they move.

    ``one`` and ``other``: 0 for a finger, 1 + k for object k. ``pull``: how far gravity lets fall in a sub-step what is
    seen late; ``hand_m``: how far the hand moves.
    """
    way = closing(room.ways, one, other)
    if room.wide[one] or room.wide[other]:
        return 1.1 * way, 1.1 * way
    return pull + 1.5 * (way + hand_m), pull


@kernel
def closing(ways: Array, one: int, other: int) -> float:
    """Return how far two bodies come nearer to each other at the most; a finger to an object as far as to a finger."""
    way: float = ways[0] + max(ways[0], ways[other]) + ways[-1] if one == 0 else ways[one] + ways[other]
    return way


@kernel
def find_contacts(
    bases: Array, rod: Rod, motion: Motion, around: Surroundings, position: Array, rotation: Array,
    lift: float, hand_velocity: float, near: bool, step_s: float, pull: float, velocity: Array, rates: Array,
    room: Places, room_of_lines: Lines, contacts: Contacts,
) -> None:  # fmt: skip
    """Fill the table from the configuration at the start of a sub-step; without muscles if nothing is ``near`` one."""
    base, objects, fingers, hand_m = room.base, around.shapes.shape[0], bases.shape[0], abs(step_s * hand_velocity)
    contacts.count[0] = 0
    widest, _ = look(room, 0, 0, pull, hand_m)
    for k in range(objects):
        widest = max(widest, look(room, 0, 1 + k, pull, hand_m)[0])
    if near:
        write_rates(motion, contacts.coordinates, velocity, rates)
        write_boxes(bases, rod, motion, 0.5 * (widest + CLEAR_M), room_of_lines)
        room.clear[0] = np.inf
    for f in range(fingers if near else 0):
        base[0], base[1], base[2] = bases[f, 0], bases[f, 1], bases[f, 2] - lift
        for k in range(objects + 1):
            on_object = k < objects
            body, shape, half, place, turn = -1, PLANE, room.plane, room.plane, room.level
            reach, own_pull = look(room, 0, 1 + k if on_object else 0, pull, hand_m)
            room.clear[0] = min(room.clear[0], reach + CLEAR_M)
            if on_object:
                body, shape, half, place, turn = (
                    fingers + k,
                    around.shapes[k],
                    around.halves[k],
                    position[k],
                    rotation[k],
                )
                x, y, z = row(position, k)
                if not near_ball(room_of_lines, f, (x, y, z + lift), norm(vector(half, 0)) + 0.5 * (widest + CLEAR_M)):
                    continue
            elif not around.table_in_reach:
                continue
            slot = BALLS * ((objects + 1) * f + k)
            outlook = Outlook(step_s, reach, own_pull, velocity, rates)
            _muscle_contacts(
                rod, motion, f, base, body, shape, half, place, turn, slot, hand_velocity, outlook, room.clear, contacts
            )
    slot = BALLS * (objects + 1) * fingers
    for k in range(objects):
        reach, _ = look(room, 0, 1 + k, pull, hand_m)
        _rest_contacts(around, k, position[k], rotation[k], lift, hand_velocity, room.points, slot, reach, contacts)
        slot += REST_POINTS * (around.planes.shape[0] + 1)
    if around.fingers_touch and near:
        reach, own_pull = look(room, 0, 0, pull, hand_m)
        outlook = Outlook(step_s, reach, own_pull, velocity, rates)
        append_finger_contacts(bases, rod, motion, room_of_lines, slot, outlook, CLEAR_M, room.clear, contacts)
    slot += BALLS * fingers * (fingers - 1)
    for other in range(1, objects):
        for one in range(other):
            reach, own_pull = look(room, 1 + one, 1 + other, pull, 0.0)
            apart = minus(row(position, one), row(position, other))
            touch = norm(row(around.halves, one)) + norm(row(around.halves, other)) + reach
            if dot(apart, apart) < touch * touch:
                outlook = Outlook(step_s, reach, own_pull, velocity, rates)
                append_object_contacts(
                    around.shapes, around.halves, position, rotation, one, other, slot, room.edges, outlook, contacts
                )
            slot += PAIR_CONTACTS
