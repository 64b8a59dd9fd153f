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
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.plant.mechanics.contact_law import Contacts
from mbpam_ros.plant.mechanics.rod import Motion, Rod, ball_jacobian, ball_position

Array = NDArray[np.float64]

FINGER_FINGER = 4
"""Row of the table of contact laws."""

_STRIDE, _FINE_STRIDE = 12, 4
"""Balls from one that spans a box to the next, and from one that is compared singly to the next; the last
ball (of 49) is among both."""
_SAME_POINT_M = 1e-9


class Lines(NamedTuple):
    """Room: centreline points of all fingers (4, n, 3), their boxes (4, 2, 3), and two Jacobians of balls (2, 6, D)."""

    points: Array
    boxes: Array
    jacobians: Array


def lines(rod: Rod, fingers: int) -> Lines:
    """Return the room for fingers with this rod."""
    balls, coordinates = rod.balls.shape[0], 2 * rod.bends.shape[2]
    return Lines(np.empty((fingers, balls, 3)), np.empty((fingers, 2, 3)), np.empty((2, 6, coordinates)))


@njit
def fingers_near(bases: Array, rod: Rod, motion: Motion, room: Lines) -> bool:
    """Write the boxes of all fingers; return whether any two overlap."""
    slack = rod.radius + 0.5 * _STRIDE * rod.spacing
    near = False
    for f in range(bases.shape[0]):
        box = room.boxes[f]
        box[0, :], box[1, :] = np.inf, -np.inf
        for ball in range(0, rod.balls.shape[0], _STRIDE):
            place = ball_position(rod, motion.tangent[f], ball)
            for i in range(3):
                box[0, i] = min(box[0, i], bases[f, i] + place[i] - slack)
                box[1, i] = max(box[1, i], bases[f, i] + place[i] + slack)
        for g in range(f):
            near = near or _overlap(room.boxes[g], box)
    return near


@njit
def _overlap(one: Array, other: Array) -> bool:
    for i in range(3):
        if one[0, i] > other[1, i] or other[0, i] > one[1, i]:
            return False
    return True


@njit
def append_finger_contacts(bases: Array, rod: Rod, motion: Motion, room: Lines, contacts: Contacts) -> None:
    """Append the contacts of all fingers with each other."""
    if not fingers_near(bases, rod, motion, room):
        return
    _write_points(bases, rod, motion, _FINE_STRIDE, room.points)
    complete = False
    for g in range(1, bases.shape[0]):
        for f in range(g):
            if _overlap(room.boxes[f], room.boxes[g]) and _may_touch(rod, room.points[f], room.points[g]):
                if not complete:
                    _write_points(bases, rod, motion, 1, room.points)
                    complete = True
                _ball_contacts(bases, rod, motion, f, g, room, contacts)
                _ball_contacts(bases, rod, motion, g, f, room, contacts)


@njit
def _write_points(bases: Array, rod: Rod, motion: Motion, stride: int, points: Array) -> None:
    """Write the places of every ``stride``-th ball of all fingers."""
    for f in range(bases.shape[0]):
        for ball in range(0, rod.balls.shape[0], stride):
            x, y, z = ball_position(rod, motion.tangent[f], ball)
            points[f, ball, 0], points[f, ball, 1], points[f, ball, 2] = (
                bases[f, 0] + x,
                bases[f, 1] + y,
                bases[f, 2] + z,
            )


@njit
def _may_touch(rod: Rod, one: Array, other: Array) -> bool:
    """Whether two muscles may touch, by their compared balls: what is between is within half a stride of one."""
    reach = 2.0 * rod.radius + _FINE_STRIDE * rod.spacing
    for k in range(0, one.shape[0], _FINE_STRIDE):
        for m in range(0, other.shape[0], _FINE_STRIDE):
            x, y, z = one[k, 0] - other[m, 0], one[k, 1] - other[m, 1], one[k, 2] - other[m, 2]
            if x * x + y * y + z * z < reach * reach:
                return True
    return False


@njit
def _nearest_point(points: Array, spacing: float, x: float, y: float, z: float) -> tuple[float, float]:
    """Return the place (ball and fraction) on a centreline that is nearest to a point, and its distance.

    The distance to the balls changes by no more than the arc length: those that cannot be the nearest are left out.
    """
    balls, best, nearest, k = points.shape[0], np.inf, 0, 0
    while k < balls:
        distance = math.sqrt((x - points[k, 0]) ** 2 + (y - points[k, 1]) ** 2 + (z - points[k, 2]) ** 2)
        if distance < best:
            best, nearest = distance, k
        k += max(1, int((distance - best) / spacing))
    place = float(nearest)
    for k in range(max(nearest - 1, 0), min(nearest + 1, balls - 1)):
        ax, ay, az = points[k, 0], points[k, 1], points[k, 2]
        ux, uy, uz = points[k + 1, 0] - ax, points[k + 1, 1] - ay, points[k + 1, 2] - az
        t = ((x - ax) * ux + (y - ay) * uy + (z - az) * uz) / (ux * ux + uy * uy + uz * uz)
        t = min(max(t, 0.0), 1.0)
        distance = math.sqrt((x - ax - t * ux) ** 2 + (y - ay - t * uy) ** 2 + (z - az - t * uz) ** 2)
        if distance < best:
            best, place = distance, k + t
    return place, best


@njit
def _ball_contacts(
    bases: Array, rod: Rod, motion: Motion, one: int, other: int, room: Lines, contacts: Contacts
) -> None:
    """Append the contacts of the balls of finger ``one`` with the centreline of the ``other``."""
    balls, line = rod.balls.shape[0], room.points[other]
    next_ball = 0  # the next that may touch
    for k in range(balls):
        if k < next_ball:
            continue
        x, y, z = room.points[one, k, 0], room.points[one, k, 1], room.points[one, k, 2]
        place, distance = _nearest_point(line, rod.spacing, x, y, z)
        depth = 2.0 * rod.radius - distance
        if depth <= 0.0:
            next_ball = k + math.ceil(-depth / rod.spacing)
            continue
        j = min(int(place), balls - 2)
        t = place - j
        n = contacts.count[0]
        contacts.count[0] = n + 1
        contacts.depth[n], contacts.rise[n], contacts.kind[n] = depth, 0.0, FINGER_FINGER
        # Half the length about the ball, over the radius; the rounded tip counts as one radius more.
        length = rod.spacing if 0 < k < balls - 1 else 0.5 * rod.spacing
        contacts.share[n] = 0.5 * (length / rod.radius + (1.0 if k == balls - 1 else 0.0))
        contacts.finger[n], contacts.other[n] = min(one, other), max(one, other)
        # From the finger of lower number into the other, which is the one that is pushed.
        toward, normal = 1.0 if one < other else -1.0, contacts.normal[n]
        for i in range(3):
            along = line[j, i] + t * (line[j + 1, i] - line[j, i]) - room.points[one, k, i]
            if distance < _SAME_POINT_M:  # centrelines cross: apart as the clamps are
                along = bases[other, i] - bases[one, i]
            normal[i] = toward * along
        size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for i in range(3):
            normal[i] /= size
        coordinates, jacobian = contacts.coordinates, contacts.jacobian[n].T
        arm = 0.5 * toward * distance  # to the point half-way between the centrelines
        own, across = (0, coordinates) if one < other else (coordinates, 0)
        arm_x, arm_y, arm_z = arm * normal[0], arm * normal[1], arm * normal[2]
        near, far = room.jacobians[0], room.jacobians[1]
        ball_jacobian(rod, motion, one, k, -toward, (arm_x, arm_y, arm_z), near)
        for i in range(6):
            for c in range(coordinates):
                jacobian[i, own + c] = near[i, c]
        ball_jacobian(rod, motion, other, j, toward * (1.0 - t), (-arm_x, -arm_y, -arm_z), near)
        ball_jacobian(rod, motion, other, j + 1, toward * t, (-arm_x, -arm_y, -arm_z), far)
        for i in range(6):
            for c in range(coordinates):
                jacobian[i, across + c] = near[i, c] + far[i, c]
