"""Where fingers touch each other: appends to the table of contacts.

Both muscles are swept spheres: the balls of :mod:`~mbpam_ros.plant.mechanics.contact_search`, and the straight pieces
of centreline between them. Each ball of one that overlaps the other is a contact at the nearest point of the other's
centreline, with half the weight; the balls of the other make the second half. So the force is spread along both, and
exchanging the two muscles changes nothing. Depth is 2 R less the distance of the centrelines. A muscle does not touch
itself.

What cannot meet costs little: muscles are compared by boxes, then by every fourth ball, each widened by how far what
is between may be, before balls are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.lanes import WIDTH, any_above, lane, load
from mbpam_ros.plant.mechanics.outlook import Outlook, ball_velocity, closes
from mbpam_ros.plant.mechanics.rod import Motion, Rod, ball_jacobian, ball_positions, coordinates_of
from mbpam_ros.plant.mechanics.vectors import Array, Vector, combined, dot, minus, norm, plus, row, times

_STRIDE, _FINE_STRIDE = 12, 4
"""Balls from one that spans a box to the next, and from one that is compared singly to the next; the last
ball (of 49) is among both."""
_SAME_POINT_M = 1e-9


class Lines(NamedTuple):
    """Room: centreline points of all fingers, their boxes (4, 2, 3), and two J^T of balls (2, D, 6).

    Points are four to a group, shape (4, 3, n / 4, 4), so that they are compared four at once; what is left of the last
    group is at infinity.
    """

    points: Array
    boxes: Array
    jacobians: Array


def lines(rod: Rod, fingers: int) -> Lines:
    """Return the room for fingers with this rod."""
    balls, coordinates = rod.balls.shape[0], coordinates_of(rod)
    points = np.full((fingers, 3, -(-balls // WIDTH), WIDTH), np.inf)
    return Lines(points, np.empty((fingers, 2, 3)), np.empty((2, coordinates, 6)))


@kernel
def write_boxes(bases: Array, rod: Rod, motion: Motion, margin: float, room: Lines) -> None:
    """Write the boxes of all fingers, widened by a margin."""
    slack = rod.radius + 0.5 * _STRIDE * rod.farthest + margin
    room.boxes[:, 0, :], room.boxes[:, 1, :] = np.inf, -np.inf
    for ball in range(0, rod.balls.shape[0], _STRIDE):
        x, y, z = ball_positions(rod, motion, ball)
        for f in range(bases.shape[0]):
            box, place = room.boxes[f], (lane(x, f), lane(y, f), lane(z, f))
            for i in range(3):
                box[0, i] = min(box[0, i], bases[f, i] + place[i] - slack)
                box[1, i] = max(box[1, i], bases[f, i] + place[i] + slack)


@kernel
def fingers_near(room: Lines) -> bool:
    """Return whether the boxes of any two fingers overlap."""
    for g in range(1, room.boxes.shape[0]):
        for f in range(g):
            if _overlap(room.boxes[g], room.boxes[f]):
                return True
    return False


@kernel
def near_ball(room: Lines, finger: int, centre: Vector, radius: float) -> bool:
    """Return whether a finger's box is within a radius of a place."""
    off, boxes = 0.0, room.boxes
    for i in range(3):
        aside = max(boxes[finger, 0, i] - centre[i], centre[i] - boxes[finger, 1, i], 0.0)
        off += aside * aside
    return off < radius * radius


@kernel
def _overlap(one: Array, other: Array) -> bool:
    for i in range(3):
        if one[0, i] > other[1, i] or other[0, i] > one[1, i]:
            return False
    return True


@kernel
def append_finger_contacts(
    bases: Array, rod: Rod, motion: Motion, room: Lines, slot: int, outlook: Outlook, margin: float, clear: Array,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of all fingers with each other, in slots from ``slot`` on; their boxes are those now.

    They are ``clear`` (1,) unless any two may be nearer than what is looked for and a margin.
    """
    if not fingers_near(room):
        return
    _write_points(bases, rod, motion, _FINE_STRIDE, room.points)
    complete = False
    for g in range(1, bases.shape[0]):
        for f in range(g):
            if _overlap(room.boxes[f], room.boxes[g]) and _may_touch(
                rod, room.points[f], room.points[g], outlook.reach + margin
            ):
                clear[0] = 0.0
                if not complete:
                    _write_points(bases, rod, motion, 1, room.points)
                    complete = True
                pair = slot + (g * (g - 1) + 2 * f) * rod.balls.shape[0]
                for turn in range(2):
                    one, other, first = (f, g, pair) if turn == 0 else (g, f, pair + rod.balls.shape[0])
                    _ball_contacts(bases, rod, motion, one, other, room, first, outlook, contacts)


@kernel
def _write_points(bases: Array, rod: Rod, motion: Motion, stride: int, points: Array) -> None:
    """Write the places of every ``stride``-th ball of all fingers."""
    for ball in range(0, rod.balls.shape[0], stride):
        x, y, z = ball_positions(rod, motion, ball)
        group, k = ball // WIDTH, ball % WIDTH
        for f in range(bases.shape[0]):
            points[f, 0, group, k] = bases[f, 0] + lane(x, f)
            points[f, 1, group, k] = bases[f, 1] + lane(y, f)
            points[f, 2, group, k] = bases[f, 2] + lane(z, f)


@kernel
def _point(points: Array, ball: int) -> Vector:
    """Return a point of one finger."""
    group, k = ball // WIDTH, ball % WIDTH
    return points[0, group, k], points[1, group, k], points[2, group, k]


@kernel
def _may_touch(rod: Rod, one: Array, other: Array, gap: float) -> bool:
    """Whether two muscles may touch, by their compared balls: what is between is within half a stride of one.

    The tips come first: they touch most.
    """
    reach = 2.0 * rod.radius + _FINE_STRIDE * rod.farthest + gap
    for k in range(rod.balls.shape[0] - 1, -1, -_FINE_STRIDE):
        place = _point(one, k)
        for m in range(rod.balls.shape[0] - 1, -1, -_FINE_STRIDE):
            between = minus(place, _point(other, m))
            if dot(between, between) < reach * reach:
                return True
    return False


@kernel
def _nearest_point(points: Array, balls: int, place: Vector, guess: int) -> tuple[float, float]:
    """Return the ball and fraction along a centreline that is nearest to a place, and its distance.

    From the ``guess`` on, few balls are nearer than the nearest before: four are compared at once with that.
    """
    off = minus(place, _point(points, guess))
    square, nearest = dot(off, off), guess
    for group in range(points.shape[1]):
        x = place[0] - load(points, (0, group))
        y = place[1] - load(points, (1, group))
        z = place[2] - load(points, (2, group))
        squares = x * x + y * y + z * z
        if any_above(square - squares, 0.0):
            for k in range(WIDTH):
                if lane(squares, k) < square:
                    square, nearest = lane(squares, k), WIDTH * group + k
    best, along = math.sqrt(square), float(nearest)
    for k in range(max(nearest - 1, 0), min(nearest + 1, balls - 1)):
        start = _point(points, k)
        piece, way = minus(_point(points, k + 1), start), minus(place, start)
        t = min(max(dot(way, piece) / dot(piece, piece), 0.0), 1.0)
        distance = norm(minus(way, times(t, piece)))
        if distance < best:
            best, along = distance, k + t
    return along, best


@kernel(inline="always")
def _ball_contacts(
    bases: Array, rod: Rod, motion: Motion, one: int, other: int, room: Lines, slot: int, outlook: Outlook,
    contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of the balls of finger ``one`` with the centreline of the ``other``."""
    balls, line = rod.balls.shape[0], room.points[other]
    next_ball, guess = 0, 0  # the next that may touch, and what was nearest to the one before
    for k in range(balls):
        if k < next_ball:
            continue
        centre = _point(room.points[one], k)
        along, distance = _nearest_point(line, balls, centre, guess)
        guess = int(along)
        depth = 2.0 * rod.radius - distance
        if depth <= -outlook.reach:
            next_ball = k + math.ceil(-(depth + outlook.reach) / rod.farthest)
            continue
        j = min(int(along), balls - 2)
        t = along - j
        # From the finger of lower number into the other, which is the one that is pushed.
        toward, start = 1.0 if one < other else -1.0, _point(line, j)
        across = combined(1.0, start, t, minus(_point(line, j + 1), start), -1.0, centre)
        if distance < _SAME_POINT_M:  # centrelines cross: apart as the clamps are
            across = minus(row(bases, other), row(bases, one))
        outward = times(1.0 / norm(across), across)
        theirs = plus(
            times(1.0 - t, ball_velocity(rod, outlook, other, j)), times(t, ball_velocity(rod, outlook, other, j + 1))
        )
        if not closes(outlook, depth, outward, ball_velocity(rod, outlook, one, k), theirs):
            continue
        n = contacts.count[0]
        contacts.count[0] = n + 1
        contacts.depth[n], contacts.rise[n], contacts.kind[n] = depth, 0.0, ContactKind.FINGER_FINGER
        contacts.slot[n] = slot + k
        # Half the length about the ball, over the radius; the rounded tip counts as one radius more.
        length = rod.spacing if 0 < k < balls - 1 else 0.5 * rod.spacing
        contacts.share[n] = 0.5 * (length / rod.radius + (1.0 if k == balls - 1 else 0.0))
        contacts.one[n], contacts.other[n] = min(one, other), max(one, other)
        contacts.limit[n] = rod.radius
        normal = times(toward, outward)
        contacts.normal[n, 0], contacts.normal[n, 1], contacts.normal[n, 2] = normal
        coordinates, jacobian = contacts.coordinates, contacts.jacobian[n].T
        arm = times(0.5 * toward * distance, normal)  # to the point half-way between the centrelines
        back = times(-1.0, arm)
        own, others = (0, coordinates) if one < other else (coordinates, 0)
        near, far = room.jacobians[0].T, room.jacobians[1].T
        ball_jacobian(rod, motion, one, k, -toward, arm, near)
        for i in range(6):
            for c in range(coordinates):
                jacobian[i, own + c] = near[i, c]
        ball_jacobian(rod, motion, other, j, toward * (1.0 - t), back, near)
        ball_jacobian(rod, motion, other, j + 1, toward * t, back, far)
        for i in range(6):
            for c in range(coordinates):
                jacobian[i, others + c] = near[i, c] + far[i, c]
