"""Where rays meet primitives, in closed form.

A ray is origin + t * direction with a unit direction. Origin and direction are triples of components; a component is
a number or an array, and all broadcast against each other, so the same functions serve rays from one eye and rays
toward one distant light. Every function returns t of the first hit in front of the origin, +inf where there is none.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry.solids import Shape

Components = tuple[Any, Any, Any]

_NO_HIT = np.float32(np.inf)
_TINY = np.float32(1e-12)


class Body(NamedTuple):
    """A primitive at its place: shape name, half of its Marker size (3,), centre (3,), rotation (3, 3) from body."""

    shape: Shape
    half_size: NDArray[Any]
    centre: NDArray[Any]
    rotation: NDArray[Any]

    def single_precision(self) -> Body:
        """The same body in float32, so that float32 rays stay float32."""
        return Body(self.shape, *(np.asarray(part, dtype=np.float32) for part in self[1:]))


def _dot(a: Components, b: Components) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _smaller_root(half_b: Any, c: Any, a: Any = 1.0) -> Any:
    """Smaller root of a t^2 + 2 half_b t + c = 0, +inf where it is complex."""
    discriminant = half_b * half_b - a * c
    root = (-half_b - np.sqrt(np.maximum(discriminant, 0.0))) / a
    return np.where(discriminant >= 0.0, root, _NO_HIT)


def _in_front(t: Any) -> Any:
    return np.where(t > 0.0, t, _NO_HIT)


def _to_body(vector: Components, rotation: NDArray[Any]) -> Components:
    """Components of ``vector`` in the body frame whose axes are the columns of ``rotation``, shape (3, 3)."""
    x, y, z = vector
    r = rotation
    return (
        r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
        r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
        r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
    )


def hit_sphere(origin: Components, direction: Components, radius: float) -> Any:
    """First hit of a sphere about the frame's origin."""
    return _in_front(_smaller_root(_dot(origin, direction), _dot(origin, origin) - radius * radius))


def hit_cylinder(origin: Components, direction: Components, radius: float, half_length: float) -> Any:
    """First hit of a capped cylinder along the frame's z axis, centred."""
    (ox, oy, oz), (dx, dy, dz) = origin, direction
    a = np.maximum(dx * dx + dy * dy, _TINY)
    side = _smaller_root(ox * dx + oy * dy, ox * ox + oy * oy - radius * radius, a)
    with np.errstate(invalid="ignore"):
        side = np.where(np.abs(oz + side * dz) <= half_length, side, _NO_HIT)
    safe_dz = np.where(np.abs(dz) < _TINY, _TINY, dz)
    cap = (-np.sign(safe_dz) * half_length - oz) / safe_dz
    x, y = ox + cap * dx, oy + cap * dy
    cap = np.where(x * x + y * y <= radius * radius, cap, _NO_HIT)
    return np.minimum(_in_front(side), _in_front(cap))


def hit_box(origin: Components, direction: Components, half_size: NDArray[Any]) -> Any:
    """First hit of a box along the frame's axes, centred (slab method)."""
    enter: Any = -_NO_HIT
    leave: Any = _NO_HIT
    for o, d, half in zip(origin, direction, half_size, strict=True):
        inverse = 1.0 / np.where(np.abs(d) < _TINY, _TINY, d)
        middle, reach = -o * inverse, half * np.abs(inverse)
        enter, leave = np.maximum(enter, middle - reach), np.minimum(leave, middle + reach)
    return np.where((enter <= leave) & (enter > 0.0), enter, _NO_HIT)


def hit_capsule(origin: Components, direction: Components, axis: NDArray[Any], radius: float) -> Any:
    """First hit of a capsule from the frame's origin to ``axis``, shape (3,) [m]: a cylinder with round ends.

    Rays that start inside miss.
    """
    length_sq = float(axis @ axis)
    along_d, along_o = _dot(tuple(axis), direction), _dot(tuple(axis), origin)
    half_b, c = _dot(origin, direction), _dot(origin, origin) - radius * radius
    a = np.maximum(length_sq - along_d * along_d, _TINY)
    side = _smaller_root(length_sq * half_b - along_o * along_d, length_sq * c - along_o * along_o, a)
    with np.errstate(invalid="ignore"):
        station = along_o + side * along_d
    near = _smaller_root(half_b, c)
    tip = tuple(o - w for o, w in zip(origin, axis, strict=True))
    far = _smaller_root(_dot(tip, direction), _dot(tip, tip) - radius * radius)
    side = np.where((station >= 0.0) & (station <= length_sq), side, _NO_HIT)
    return _in_front(np.minimum(side, np.minimum(near, far)))


def hit_body(body: Body, origin: Components, direction: Components) -> Any:
    """First hit of a sphere, cylinder or box at its place. Computed in single precision."""
    _, half, centre, rotation = body.single_precision()
    relative = _to_body((origin[0] - centre[0], origin[1] - centre[1], origin[2] - centre[2]), rotation)
    turned = _to_body(direction, rotation)
    if body.shape == "sphere":
        return hit_sphere(relative, turned, half[0])
    if body.shape == "cylinder":
        return hit_cylinder(relative, turned, half[0], half[2])
    return hit_box(relative, turned, half)


def surface_normals(body: Body, points: Components) -> Components:
    """Outward unit normals at points of the surface of ``body``."""
    _, half, centre, rotation = body.single_precision()
    inside = _to_body((points[0] - centre[0], points[1] - centre[1], points[2] - centre[2]), rotation)
    x, y, z = (part / extent for part, extent in zip(inside, half, strict=True))
    if body.shape == "cylinder":
        on_cap = np.abs(z) > np.hypot(x, y)
        x, y, z = np.where(on_cap, 0.0, x), np.where(on_cap, 0.0, y), np.where(on_cap, np.sign(z), 0.0)
    elif body.shape == "box":
        # The face is the axis along which the point is relatively farthest out.
        face = np.abs(np.stack([x, y, z])).argmax(axis=0)
        x, y, z = (np.where(face == i, np.sign(part), 0.0) for i, part in enumerate((x, y, z)))
    return _to_body((x, y, z), rotation.T)


def chords(line: NDArray[np.float64], sag_m: float) -> NDArray[np.float64]:
    """The fewest points of a centreline, (n, 3), whose chords stay within ``sag_m`` of it (Douglas and Peucker)."""
    if len(line) == 2:
        return line
    chord = line[-1] - line[0]
    offset = line - line[0]
    length_sq = float(chord @ chord)
    if length_sq > 0.0:
        offset = offset - np.outer(offset @ chord / length_sq, chord)
    sag = np.linalg.norm(offset, axis=1)
    split = int(sag[1:-1].argmax()) + 1
    if sag[split] < sag_m:
        return line[[0, -1]]
    return np.concatenate([chords(line[: split + 1], sag_m)[:-1], chords(line[split:], sag_m)])
