"""Where objects touch each other: appends to the table of contacts.

A solid is a core with a rounding: of a sphere its centre and radius, of a box or cylinder the solid drawn in by
:data:`LARGEST_ROUNDING_M` at the most, so that faces are where they are and edges are round. What is on the core of one
is set beside the core of the other, whose distance is smooth there until they are deeper in each other than both are
rounded: a sphere's centre, a box's edges, and of a cylinder its side along the line toward the other and, the more its
end is turned to it, points of its rims. Both solids are looked at from both sides, but spheres have no edges.

Along an edge the distance is convex. Its contacts are the two ends of the part whose depth is at least half of the
deepest: they are the corners where a face lies on a face, and run together where only a point touches; all is
continuous in the poses. Solids whose spheres are apart are not compared.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry.surfaces import CYLINDER, SPHERE, signed_distance
from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.outlook import Outlook, closes, object_velocity
from mbpam_ros.plant.mechanics.vectors import Array, Vector, dot, minus, plus, row, times, to_body, to_world

LARGEST_ROUNDING_M = 0.002
"""Radius of the edges of boxes and cylinders where they touch each other; of thin ones half of half the thickness."""

EDGES = 12
"""The most edges, lines and points of one solid that are set beside another."""

PAIR_CONTACTS = 4 * EDGES
"""The most contacts of two objects."""

_HALVINGS = 20
_EDGE_SHARE = 1.0 / 3.0
"""Three edges meet in a corner."""

_LEAST_SHARE = 1e-3
"""What is less is left out."""

_LEVEL_M = 1e-6
"""What along an edge is nearer to the other solid than this and its nearest point is as near."""

_ON_END = 0.1
"""Sine of the angle between a cylinder's axis and the way to the other solid below which its rim begins to touch."""


@kernel
def object_columns(place: Vector, first: int, jacobian: Array) -> None:
    """Write the velocity at a place from a body's centre into columns ``first`` to ``first`` + 5 of ``jacobian``."""
    x, y, z = place
    for i in range(6):
        for j in range(6):
            jacobian[i, first + j] = 1.0 if i == j else 0.0
    jacobian[0, first + 4], jacobian[0, first + 5] = z, -y
    jacobian[1, first + 3], jacobian[1, first + 5] = -z, x
    jacobian[2, first + 3], jacobian[2, first + 4] = y, -x


@kernel
def _rounding(shape: int, half: Array) -> float:
    """Return by how much a solid is rounded."""
    rounding: float = half[0] if shape == SPHERE else min(LARGEST_ROUNDING_M, 0.5 * min(half[0], half[1], half[2]))
    return rounding


@kernel
def _write_edges(shape: int, half: Array, toward: Vector, edges: Array) -> int:
    """Write the edges of a core with half sizes ``half`` in its own frame, and return how many there are.

    A row of ``edges`` (12, 7) has both ends and a share of the stiffness; where they are one, it is a point.
    ``toward``: of a cylinder, the unit vector to the other solid.
    """
    if shape == SPHERE:
        edges[0, :] = 0.0
        edges[0, 6] = 1.0
        return 1
    if shape == CYLINDER:
        across = math.sqrt(toward[0] * toward[0] + toward[1] * toward[1])
        side = min(across / _ON_END, 1.0)
        side *= side * (3.0 - 2.0 * side)
        x, y = (half[0] * toward[0] / across, half[0] * toward[1] / across) if across > 1e-12 else (half[0], 0.0)
        edges[0, 0], edges[0, 1], edges[0, 2], edges[0, 3], edges[0, 4], edges[0, 5] = x, y, -half[2], x, y, half[2]
        edges[0, 6] = side
        for k in range(8):
            edge, along, way = edges[1 + k], k % 2, half[0] if k % 4 < 2 else -half[0]
            edge[0], edge[1], edge[2] = way * (1.0 - along), way * along, half[2] if k < 4 else -half[2]
            edge[3], edge[4], edge[5], edge[6] = edge[0], edge[1], edge[2], 1.0 - side
        return 9
    for k in range(EDGES):
        along, edge = k // 4, edges[k]
        for end in range(2):
            for i in range(3):
                bit = end if i == along else ((k % 4) >> (0 if i == (along + 1) % 3 else 1)) & 1
                edge[3 * end + i] = half[i] if bit else -half[i]
        edge[6] = _EDGE_SHARE
    return EDGES


@kernel
def _on_edge(edge: Array, t: float) -> Vector:
    """Return the place at a fraction of an edge."""
    start = (edge[0], edge[1], edge[2])
    return plus(start, times(t, (edge[3] - edge[0], edge[4] - edge[1], edge[5] - edge[2])))


@kernel
def _distance(shape: int, core: Array, at: Vector) -> tuple[float, Vector]:
    """Return the distance of a place in its frame from a core, and its gradient."""
    distance, x, y, z = signed_distance(shape, core, at[0], at[1], at[2])
    return distance, (x, y, z)


@kernel
def _nearest(shape: int, core: Array, edge: Array) -> tuple[float, float]:
    """Return the fraction of an edge at which it is nearest to a core, and the distance there."""
    along = (edge[3] - edge[0], edge[4] - edge[1], edge[5] - edge[2])
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS if dot(along, along) > 0.0 else 0):
        middle = 0.5 * (low + high)
        slope = dot(_distance(shape, core, _on_edge(edge, middle))[1], along)
        if slope < 0.0:
            low = middle
        elif slope > 0.0:
            high = middle
        else:
            low, high = middle, middle
            break
    t = 0.0 if high < 1e-5 else (1.0 if low > 1.0 - 1e-5 else 0.5 * (low + high))
    return t, _distance(shape, core, _on_edge(edge, t))[0]


@kernel
def _last(shape: int, core: Array, edge: Array, t: float, end: float, level: float) -> float:
    """Return the fraction of an edge between t and ``end`` up to which it is nearer to a core than ``level``."""
    if _distance(shape, core, _on_edge(edge, end))[0] <= level:
        return end
    near, far = t, end
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        if _distance(shape, core, _on_edge(edge, middle))[0] <= level:
            near = middle
        else:
            far = middle
    return near


@kernel
def append_object_contacts(
    shapes: NDArray[np.int64], halves: Array, position: Array, rotation: Array, one: int, other: int, slot: int,
    room: Array,
    outlook: Outlook, contacts: Contacts,
) -> None:  # fmt: skip
    """Append the contacts of two objects, ``one`` the lower of their numbers, in slots from ``slot`` on.

    Args:
        shapes, halves, position, rotation: of all objects, shapes (K,), (K, 3), (K, 3) and (K, 3, 3).
        room: shape (14, 7).
    """
    core, edges = room[EDGES, :3], room[:EDGES]
    spheres = (shapes[one] == SPHERE) or (shapes[other] == SPHERE)
    for turn in range(2):
        own, solid = (one, other) if turn == 0 else (other, one)
        # A sphere is compared with the solid as it is, and that not with it.
        if (spheres and shapes[own] != SPHERE) or (turn == 1 and shapes[one] == SPHERE):
            continue
        rounded = 0.0 if spheres else _rounding(shapes[solid], halves[solid])
        ball = _rounding(shapes[own], halves[own])
        for i in range(3):
            core[i] = halves[solid, i] - rounded
            room[EDGES + 1, i] = halves[own, i] - ball
        turned, between = rotation[own], minus(row(position, own), row(position, solid))
        centre = to_body(rotation[solid], between)
        toward = (0.0, 0.0, 0.0)
        if shapes[own] == CYLINDER:
            axis = edges[0]
            half = times(room[EDGES + 1, 2], to_body(rotation[solid], to_world(turned, (0.0, 0.0, 1.0))))
            axis[0], axis[1], axis[2] = minus(centre, half)
            axis[3], axis[4], axis[5] = plus(centre, half)
            t, _ = _nearest(shapes[solid], core, axis)
            outward = _distance(shapes[solid], core, _on_edge(axis, t))[1]
            toward = times(-1.0, to_body(turned, to_world(rotation[solid], outward)))
        for k in range(_write_edges(shapes[own], room[EDGES + 1, :3], toward, edges)):
            edge = edges[k]
            if edge[6] < _LEAST_SHARE:
                continue
            for end in (0, 3):
                place = to_world(turned, (edge[end], edge[end + 1], edge[end + 2]))
                edge[end], edge[end + 1], edge[end + 2] = plus(centre, to_body(rotation[solid], place))
            along = (edge[3] - edge[0], edge[4] - edge[1], edge[5] - edge[2])
            length = math.sqrt(dot(along, along))
            apart = ball + rounded + outlook.reach
            if _distance(shapes[solid], core, _on_edge(edge, 0.5))[0] - 0.5 * length > apart:
                continue
            nearest, distance = _nearest(shapes[solid], core, edge)
            if distance >= apart:
                continue
            level = distance + max(_LEVEL_M, 0.5 * (ball + rounded - distance))
            for end in range(2 if length > 0.0 else 1):
                at = _on_edge(edge, _last(shapes[solid], core, edge, nearest, float(end), level))
                distance, gradient = _distance(shapes[solid], core, at)
                depth = ball + rounded - distance
                outward = to_world(rotation[solid], gradient)
                # half-way between the two surfaces, from the centres
                place = plus(to_world(rotation[solid], at), times(0.5 * (rounded - ball - distance), outward))
                from_own = minus(place, between)
                muscles = contacts.fingers * contacts.coordinates
                pusher = object_velocity(outlook, muscles + 6 * solid, place)
                pushed = object_velocity(outlook, muscles + 6 * own, from_own)
                if depth <= -outlook.reach or not closes(outlook, depth, outward, pusher, pushed):
                    continue
                n, sign = contacts.count[0], 1.0 if turn == 1 else -1.0
                contacts.count[0] = n + 1
                contacts.depth[n], contacts.share[n], contacts.limit[n] = depth, edge[6], ball + rounded
                contacts.slot[n], contacts.kind[n] = slot + 2 * (EDGES * turn + k) + end, ContactKind.OBJECT_OBJECT
                contacts.one[n], contacts.other[n] = contacts.fingers + one, contacts.fingers + other
                contacts.rise[n] = 0.0
                contacts.normal[n, 0], contacts.normal[n, 1], contacts.normal[n, 2] = times(sign, outward)
                jacobian = contacts.jacobian[n].T
                object_columns(place if turn == 1 else from_own, 0, jacobian)
                object_columns(from_own if turn == 1 else place, 6, jacobian)
                for i in range(6):
                    for j in range(6):
                        jacobian[i, j] = -jacobian[i, j]


def pair_room() -> Array:
    """Return the room for two objects' edges and cores."""
    return np.zeros((EDGES + 2, 7))
