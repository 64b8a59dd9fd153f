"""What the closing fingers can reach, from the rod law, where they stand, and the table: computed once, in figures.

A finger's axis at rest is a curve c(p, s) in the plane toward which its mode bends it, p the pressure and s the length
from the clamp: the rod of the law, hanging, nothing touching it (:class:`~mbpam_ros.actuator.elastic_rod.FreeRods`).
With d(x) the distance of a point from the object's surface and R the muscle's radius, its gap is

    g(p) = min over s of d(c(p, s)) - R,

and it touches at the least p with g(p) <= 0, where it pushes the object along n = -grad d. An object can be held if

- no finger stands in it while straight, g(0) > -:data:`SLACK_M` (else it is too wide, or too far off the middle);
- all fingers touch it, from sides that enclose it: no half plane of the palm's plane is free of pushes, but for the
  angle of friction, atan(mu). A finger that comes by without touching misses it by the least of its gaps;
- where they touch it, neighbouring fingers do not stand in each other;
- the pushes do not squeeze it out downward: the mean of n_z (down) is at most mu times the mean of its level part;
- it lies below the palm, and the tips, which come deepest on their way, stay above the table.

What is told in a refusal is how much is lacking: a shift or a size is varied until the object could be held.

This is what geometry forbids. What forces forbid, that fingers which bend on push the object down and out, is in the
table of pressures (:mod:`~mbpam_ros.grasp.grip_pressure`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.actuator.elastic_rod import HANGING, FreeRods
from mbpam_ros.actuator.equilibrium import resting_bend
from mbpam_ros.geometry.rotations import rotation_matrix
from mbpam_ros.geometry.solids import Shape, distance_from_m, half_height
from mbpam_ros.grasp.modes import GraspMode
from mbpam_ros.gripper import Gripper

Array = NDArray[np.float64]

SLACK_M = 0.002
"""How deep an object may seem to lie in a straight finger: what a camera errs by."""

_PRESSURE_STEP_PA = 2.5e3
_SPACING_M = 0.004
_NUDGE_M = 1e-6
_SHIFT_STEP_M, _LARGEST_SHIFT_M = 0.001, 0.1


class Body(NamedTuple):
    """An object where it lies: as in :class:`~mbpam_ros.grasp.selection.DetectedObject`, in ``gripper_base``."""

    shape: Shape
    size_m: tuple[float, float, float]
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]

    def shifted(self, x_m: float, y_m: float, z_m: float) -> Body:
        """Return it moved."""
        x, y, z = self.position_m
        return self._replace(position_m=(x + x_m, y + y_m, z + z_m))

    def distance_m(self, points_m: Array) -> Array:
        """Return how far points (..., 3) are from its surface, shape (...); negative inside."""
        return distance_from_m(*self, points_m)


class Touch(NamedTuple):
    """How the fingers meet an object.

    Args:
        gap_m: the least gap of each finger on its way from straight to the greatest pressure, shape (4,).
        pressure_gauge_pa: at which each first touches, shape (4,); NaN: it does not.
        push: direction in which each then pushes the object, unit vectors in ``gripper_base``, shape (4, 3); NaN.
        axis_m: where its axis is nearest to the object then, shape (4, 3); NaN.
    """

    gap_m: Array
    pressure_gauge_pa: Array
    push: Array
    axis_m: Array

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Which fingers touch, shape (4,)."""
        return np.isfinite(self.pressure_gauge_pa)


class Reach:
    """What the fingers of a gripper can reach up to its pressure limit.

    Args:
        gripper: the muscles and where they stand.
        modes: the grasp modes by name.
        friction_coefficient: of fingers on objects.
        table_depth_m: of a table under the palm; none: the fingers hang free, beside what the object stands on.

    Raises:
        RodSolutionError: the design has no rod law.
    """

    def __init__(
        self,
        gripper: Gripper,
        modes: Mapping[str, GraspMode],
        friction_coefficient: float,
        table_depth_m: float | None = None,
    ) -> None:
        self._modes, self._gripper = modes, gripper
        self._friction_rad, self._table_m = math.atan(friction_coefficient), table_depth_m
        self._radius_m = gripper.geometry.outer_radius_m
        steps = 1 + math.ceil(gripper.pressure_limit_gauge_pa / _PRESSURE_STEP_PA)
        self._pressure_pa = np.linspace(0.0, gripper.pressure_limit_gauge_pa, steps)
        self._paths = {chambers: _path(gripper, chambers, self._pressure_pa) for chambers in (1, 2)}

    def obstacle(self, body: Body, mode: str, quarter_turns: int = 0, mirrored: bool = False) -> str | None:
        """Return why a mode so posed cannot hold an object where it lies, in figures, or None."""
        lines = self._finger_lines(mode, quarter_turns, mirrored)
        in_the_way = self._too_wide(body, lines) or self._palm_or_table(body, lines)
        if in_the_way is not None:
            return in_the_way
        found = self._touch(body, lines)
        return self._too_deep(body, lines, found) or self._missed(found) or self._too_thin(body, found)

    def touch(self, body: Body, mode: str, quarter_turns: int = 0, mirrored: bool = False) -> Touch:
        """Return how the fingers of a mode so posed meet an object that stays where it is."""
        return self._touch(body, self._finger_lines(mode, quarter_turns, mirrored))

    def depth_m(self, mode: str) -> float:
        """Return how deep the fingers of a mode come under the palm on their way [m], their thickness included."""
        return self._deepest_m(self._finger_lines(mode, 0, False))

    def _finger_lines(self, mode: str, quarter_turns: int, mirrored: bool) -> Array:
        """Axes of the posed fingers in ``gripper_base``, shape (pressures, 4, points, 3)."""
        posed = self._modes[mode]
        posed = (posed.mirrored() if mirrored else posed).turned(quarter_turns)
        lines = []
        for azimuth_deg, base in zip(posed.bend_azimuth_deg, self._gripper.finger_base_m, strict=True):
            azimuth = math.radians(azimuth_deg)
            across, along = self._paths[int(pressurised_chambers(azimuth).sum())]
            flat = np.stack([across * math.cos(azimuth), across * math.sin(azimuth), along], axis=-1)
            lines.append(flat + base)
        return np.stack(lines, axis=1)

    def _touch(self, body: Body, lines: Array) -> Touch:
        distance = body.distance_m(lines)
        nearest = distance.argmin(axis=2)
        gap = distance.min(axis=2) - self._radius_m
        count = gap.shape[1]
        pressure, push, axis = np.full(count, np.nan), np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        for finger in range(count):
            inside = np.flatnonzero(gap[:, finger] <= 0.0)
            if not inside.size:
                continue
            k = int(inside[0])
            share = 1.0
            if k > 0:
                before, after = gap[k - 1, finger], gap[k, finger]
                share = before / (before - after)
            low = max(k - 1, 0)
            pressure[finger] = self._pressure_pa[low] + share * (self._pressure_pa[k] - self._pressure_pa[low])
            place = int(nearest[k, finger])
            point = (1.0 - share) * lines[low, finger, place] + share * lines[k, finger, place]
            push[finger], axis[finger] = -_outward(body, point), point
        return Touch(gap.min(axis=0), pressure, push, axis)

    # What keeps an object from being held, by how much

    def _palm_or_table(self, body: Body, lines: Array) -> str | None:
        half = half_height(body.shape, body.size_m, body.orientation_xyzw)
        inside_mm = 1e3 * (half - body.position_m[2])
        if inside_mm > 1e3 * SLACK_M:
            return f"too near: its top is {inside_mm:.0f} mm inside the palm"
        if self._table_m is None:
            return None
        low_mm = 1e3 * (self._deepest_m(lines) - self._table_m)
        if low_mm > 0.0:
            return (
                f"the table is in the way: the fingers come {1e3 * self._table_m + low_mm:.0f} mm below the palm, the "
                f"table stands at {1e3 * self._table_m:.0f} mm; raise the hand by {low_mm:.0f} mm"
            )
        return None

    def _deepest_m(self, lines: Array) -> float:
        """The tips' end faces are discs across the axis: their rims come deepest."""
        tip, before = lines[:, :, -1], lines[:, :, -2]
        axis = (tip - before) / np.linalg.norm(tip - before, axis=-1, keepdims=True)
        return float((tip[..., 2] + self._radius_m * np.hypot(axis[..., 0], axis[..., 1])).max())

    def _too_wide(self, body: Body, lines: Array) -> str | None:
        straight = lines[:1]

        def inside_m(where: Body) -> float:
            return float(self._radius_m - where.distance_m(straight).min())

        deep_m = inside_m(body)
        if deep_m <= SLACK_M:
            return None
        centred = body._replace(position_m=(0.0, 0.0, body.position_m[2]))
        if inside_m(centred) <= SLACK_M:
            x, y, _ = body.position_m
            allowed_m = _largest_share(lambda share: inside_m(centred.shifted(share * x, share * y, 0.0)) <= SLACK_M)
            off_mm = 1e3 * math.hypot(x, y)
            return (
                f"too far off the axis by {off_mm * (1.0 - allowed_m):.0f} mm: {off_mm:.0f} mm, with "
                f"{off_mm * allowed_m:.0f} mm it would lie between the straight fingers"
            )
        width_mm = 1e3 * _level_width_m(body)
        thinner = _largest_share(lambda share: inside_m(_scaled(centred, share)) <= SLACK_M)
        return (
            f"too wide by {width_mm * (1.0 - thinner):.1f} mm: {width_mm:.1f} mm, {width_mm * thinner:.1f} mm fit "
            "between the straight fingers"
        )

    def _too_deep(self, body: Body, lines: Array, found: Touch) -> str | None:
        if self._lifts(found):
            return None
        shift_m = _least_shift(lambda up_m: self._holds(self._touch(body.shifted(0.0, 0.0, -up_m), lines)))
        if shift_m is None:
            return None  # no height helps: what else is wrong with it is told
        depth_mm = 1e3 * body.position_m[2]
        return f"too deep by {1e3 * shift_m:.0f} mm: at {depth_mm:.0f} mm the fingers push it down or pass over it"

    def _missed(self, found: Touch) -> str | None:
        if self._encloses(found):
            return None
        missing = ~found.touching
        if missing.any():
            names = ", ".join(f"finger {i + 1} by {1e3 * found.gap_m[i]:.1f} mm" for i in np.flatnonzero(missing))
            return f"missed by the closing fingers: {names} at {1e-3 * self._pressure_pa[-1]:.0f} kPa"
        free_deg = math.degrees(_widest_gap_rad(found.push))
        return (
            f"not enclosed: from {free_deg:.0f} deg around it no finger pushes, with this friction "
            f"{math.degrees(math.pi + self._friction_rad):.0f} deg may be open"
        )

    def _too_thin(self, body: Body, found: Touch) -> str | None:
        between_m = np.linalg.norm(found.axis_m - np.roll(found.axis_m, 1, axis=0), axis=1)
        lacking_m = 2.0 * self._radius_m - float(between_m.min())
        if lacking_m <= 0.0:
            return None
        width_mm, inside_mm = 1e3 * _level_width_m(body), 1e3 * lacking_m
        return f"too thin: {width_mm:.1f} mm, fingers that touch it would stand {inside_mm:.1f} mm in each other"

    def _holds(self, found: Touch) -> bool:
        return self._encloses(found) and self._lifts(found)

    def _encloses(self, found: Touch) -> bool:
        return bool(found.touching.all()) and _widest_gap_rad(found.push) <= math.pi + self._friction_rad

    def _lifts(self, found: Touch) -> bool:
        push = found.push[found.touching]
        if not len(push):
            return False
        level = np.hypot(push[:, 0], push[:, 1])
        return bool(push[:, 2].mean() <= math.tan(self._friction_rad) * level.mean())


@functools.lru_cache(maxsize=8)
def _hanging(gripper: Gripper, chambers: int, pressures: tuple[float, ...]) -> tuple[Array, Array]:
    """Lateral place and depth of a hanging finger's axis, each (pressures, points)."""
    law = gripper.rod_law()
    azimuth = math.pi / 4.0 if chambers == 1 else 0.0
    pressure = np.outer(pressures, pressurised_chambers(azimuth))
    moment, stiffness = law.moment_and_stiffness(pressure)
    bend = resting_bend(moment, stiffness, gripper.rod_geometry, np.array(HANGING))
    rods = FreeRods(law, gripper.rod_geometry, ("bend",)).at_rest(moment, pressure, HANGING, bend)
    length = gripper.geometry.length_m
    along = np.linspace(0.0, length, 1 + round(length / _SPACING_M))
    line = np.stack(
        [[np.interp(along, rods.arc_length_m, rod[:, axis]) for axis in range(3)] for rod in rods.centreline_m]
    )
    across = line[:, 0] * math.cos(azimuth) + line[:, 1] * math.sin(azimuth)
    return across, line[:, 2]


def _path(gripper: Gripper, chambers: int, pressure_pa: Array) -> tuple[Array, Array]:
    return _hanging(gripper, chambers, tuple(pressure_pa.tolist()))


def _outward(body: Body, point_m: Array) -> Array:
    nudges = _NUDGE_M * np.vstack([np.eye(3), -np.eye(3)])
    distance = body.distance_m(point_m + nudges)
    slope = distance[:3] - distance[3:]
    return np.asarray(slope / max(float(np.linalg.norm(slope)), 1e-300))


def _widest_gap_rad(push: Array) -> float:
    """The largest angle about z in which none of the pushes points that point at all sideways."""
    level = push[np.hypot(push[:, 0], push[:, 1]) > 1e-6]  # drops NaN
    if not len(level):
        return 2.0 * math.pi
    azimuth = np.sort(np.arctan2(level[:, 1], level[:, 0]))
    return float(np.diff(azimuth, append=azimuth[0] + 2.0 * math.pi).max())


def _level_width_m(body: Body) -> float:
    """The object's least level extent between two upright planes that are parallel to one of its axes."""
    if body.shape == "sphere":
        return max(body.size_m)
    if body.shape == "cylinder":
        return max(body.size_m[:2])
    axes = rotation_matrix(body.orientation_xyzw)
    upright = int(np.argmax(np.abs(axes[2])))
    return min(size for axis, size in enumerate(body.size_m) if axis != upright)


def _scaled(body: Body, share: float) -> Body:
    x, y, z = body.size_m
    return body._replace(size_m=(share * x, share * y, share * z))


def _largest_share(fits: Callable[[float], bool]) -> float:
    """Bisect for the largest share of 1 that fits; 0 if none does."""
    low, high = 0.0, 1.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _least_shift(holds: Callable[[float], bool]) -> float | None:
    for count in range(1, 1 + round(_LARGEST_SHIFT_M / _SHIFT_STEP_M)):
        if holds(count * _SHIFT_STEP_M):
            return count * _SHIFT_STEP_M
    return None
