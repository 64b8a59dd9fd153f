"""A muscle in pieces as closed surfaces: a wave, and an end with half a wave beside it, with the walls of the chambers.

Outside and inside are those of the drawing, its moulds and its finite elements (:mod:`~mbpam_ros.actuator.section`). A
muscle of n waves, which begin and end at a crest, is an end, n - 1 waves from valley to valley, and an end turned over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.section import outer_radius
from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.gripper import Gripper

ARC_POINTS = 12
"""Of a quarter of the circle, both ends included: chords leave it by at most 0.3 % of the radius."""

SLICES = 13
"""Sections of a wave, both ends included."""


class WaveError(MbpamError, ValueError):
    """These lengths leave no chamber in the valleys."""


@dataclass(frozen=True)
class Wave:
    """The lengths of one wave [m].

    Args:
        crest_radius_m: outer radius at the crest.
        amplitude_m: a, from peak to valley.
        cross_m: b, thickness of the arms of the cross.
        wall_m: c, thickness of the wall.
        length_m: p, from valley to valley.

    Raises:
        WaveError: no chamber is left in the valleys.
        ValueError: a length is not positive and finite.
    """

    crest_radius_m: float
    amplitude_m: float
    cross_m: float
    wall_m: float
    length_m: float

    def __post_init__(self) -> None:
        require_positive(self, "crest_radius_m", "amplitude_m", "cross_m", "wall_m", "length_m")
        if not self.valley_radius_m - self.wall_m > 0.5 * math.sqrt(2.0) * self.cross_m:
            raise WaveError(
                f"no chamber is left in the valleys, of outer radius {self.valley_radius_m:g} m, beside a wall of "
                f"{self.wall_m:g} m and a cross of {self.cross_m:g} m; make one of the three smaller"
            )

    @classmethod
    def of_gripper(cls, gripper: Gripper, length_m: float) -> Wave:
        """Return a wave of a gripper's muscles, drawn as long as ``length_m``."""
        design, crest_m = gripper.design, gripper.geometry.outer_radius_m
        return cls(crest_m, 1e-3 * design.a_mm, 1e-3 * design.b_mm, gripper.wall_m, length_m)

    @property
    def valley_radius_m(self) -> float:
        """Outer radius in a valley [m]."""
        return self.crest_radius_m - self.amplitude_m


def wave_count(gripper: Gripper) -> int:
    """Return how many waves of a muscle are drawn: whole ones, where a drawing has a part of one."""
    return max(1, round(gripper.wave_count))


def wave_triangles(wave: Wave, arc_points: int = ARC_POINTS, slices: int = SLICES) -> NDArray[np.float64]:
    """Return the closed surface of a wave from valley to valley, its crest at z = 0: triangles, shape (n, 3, 3) [m].

    Seen from outside the material the corners run anticlockwise; every edge belongs to two triangles.

    Args:
        wave: its lengths.
        arc_points: of a quarter of the circle, both ends included; at least 2.
        slices: sections of the wave, both ends included; at least 2.
    """
    z = np.linspace(-0.5, 0.5, slices) * wave.length_m
    circle, chamber = _outlines(wave, z, z, arc_points)
    sides = [_between(circle[:-1], circle[1:]), _between(chamber[1:], chamber[:-1], closed=True)]
    return _four([*sides, _section(circle[-1], chamber[-1]), _section(circle[0], chamber[0])[:, ::-1]])


def end_triangles(
    wave: Wave, solid_m: float, arc_points: int = ARC_POINTS, slices: int = SLICES
) -> NDArray[np.float64]:
    """Return the closed surface of an end: solid from z = 0 to ``solid_m``, then a wave's half, from crest to valley.

    Args:
        wave: its lengths.
        solid_m: length of the piece without chambers [m].
        arc_points: as for :func:`wave_triangles`.
        slices: sections of a whole wave.

    Returns:
        Triangles as those of :func:`wave_triangles`.
    """
    from_crest_m = np.linspace(0.0, 0.5, slices // 2 + 1) * wave.length_m
    circle, chamber = _outlines(wave, from_crest_m, solid_m + from_crest_m, arc_points)
    foot = circle[0] * [1.0, 1.0, 0.0]
    outside = np.concatenate([foot[None], circle])
    sides = [_between(outside[:-1], outside[1:]), _between(chamber[1:], chamber[:-1], closed=True)]
    disc, floor = _fan(np.zeros(3), foot)[:, ::-1], _fan(chamber[0, -1], chamber[0, :-1])
    return _four([*sides, _section(circle[-1], chamber[-1]), disc, floor])


def _outlines(
    wave: Wave, from_crest_m: NDArray[np.float64], z_m: NDArray[np.float64], points: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Quarter circles and chambers, shapes (slices, points, 3) and (slices, points + 1, 3), at each height."""
    outer = outer_radius(from_crest_m, wave.crest_radius_m, wave.amplitude_m, wave.length_m)
    return _quarter_circle(outer, z_m, points), _chamber(outer - wave.wall_m, wave.cross_m, z_m, points)


def _quarter_circle(radius_m: NDArray[np.float64], z_m: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """Points of the quarter circles from x to y at each height, shape (slices, points, 3)."""
    angle = np.linspace(0.0, 0.5 * np.pi, points)
    return _arc(radius_m, np.broadcast_to(angle, (len(z_m), points)), z_m)


def _chamber(
    radius_m: NDArray[np.float64], cross_m: float, z_m: NDArray[np.float64], points: int
) -> NDArray[np.float64]:
    """Outline of the chamber in the first quadrant at each height: its arc, then its corner at the cross."""
    first = np.arcsin(0.5 * cross_m / radius_m)
    angle = np.linspace(first, 0.5 * np.pi - first, points, axis=1)
    corner = np.column_stack([np.full((len(z_m), 2), 0.5 * cross_m), z_m])
    return np.concatenate([_arc(radius_m, angle, z_m), corner[:, None, :]], axis=1)


def _arc(
    radius_m: NDArray[np.float64], angle_rad: NDArray[np.float64], z_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    across = radius_m[:, None] * np.stack([np.cos(angle_rad), np.sin(angle_rad)])
    return np.stack([across[0], across[1], np.broadcast_to(z_m[:, None], angle_rad.shape)], axis=-1)


def _between(low: NDArray[np.float64], high: NDArray[np.float64], closed: bool = False) -> NDArray[np.float64]:
    """Triangles of the strips between lines of points, each shape (strips, points, 3), outside to the right."""
    if closed:
        low, high = (np.concatenate([line, line[:, :1]], axis=1) for line in (low, high))
    a, b, c, d = low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2).reshape(-1, 3, 3)


def _fan(middle: NDArray[np.float64], line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangles between a point and a line of points, facing up."""
    return np.stack([np.broadcast_to(middle, line[1:].shape), line[:-1], line[1:]], axis=1)


def _section(circle: NDArray[np.float64], chamber: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangles of a quarter's section, facing up: the wall, and the two half arms of the cross up to the middle."""
    arc, corner = chamber[:-1], chamber[-1]
    middle = np.array([0.0, 0.0, corner[2]])
    wall = _between(arc[None], circle[None])[:, ::-1]
    arms = [(middle, circle[0], corner), (circle[0], arc[0], corner)]
    arms += [(middle, corner, circle[-1]), (corner, arc[-1], circle[-1])]
    return np.concatenate([wall, np.array(arms)])


def _four(quarter: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """A surface of four quarters, of the triangles of the first."""
    triangles = np.concatenate(quarter)
    return np.concatenate([_turned(triangles, quarters) for quarters in range(4)])


def _turned(triangles: NDArray[np.float64], quarters: int) -> NDArray[np.float64]:
    """Turned about z by quarters, to the bit, so that edges of neighbours are the same."""
    x, y, z = np.moveaxis(triangles, -1, 0)
    for _ in range(quarters):
        x, y = -y, x
    return np.stack([x, y, z], axis=-1)
