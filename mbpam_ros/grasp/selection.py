"""From a detected object to the grasp mode that suits it, and the wrist pose that lines the two up.

Shape decides first, size second. A sphere, or a cylinder that stands upright, is round seen from the palm: envelope.
A lying cylinder is a round rod: slender_rod from a slenderness (length over diameter) on, short_rod below it. A box
gets mid_rod, whose fingers all close in one plane, flat on two of its faces. Length alone could not tell the paper's
rod modes apart: with the sizes assumed here its banana (mode 1, "relatively shorter length") is 180 mm long and its
carton (mode 3, "mid-length") 120 mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbpam_ros.configuration import require_positive
from mbpam_ros.geometry.rotations import about_z, product, rotation_matrix
from mbpam_ros.geometry.solids import SHAPES, Shape
from mbpam_ros.grasp.grip_pressure import NOTHING_EXPECTED, Expected, GripPlanner
from mbpam_ros.grasp.modes import GraspMode
from mbpam_ros.grasp.reach import Body, Reach
from mbpam_ros.gripper import Gripper

_LIKELY_HIDDEN_M = 0.05
"""By how much a rod is likely to be longer than is seen where there is no bound near by."""


@dataclass(frozen=True)
class SelectionConfig:
    """Thresholds of the selection, all of ``config/grasp.yaml``.

    Args:
        slenderness_min: length over diameter from which a round rod is slender.
        confidence_min: least confidence of a detection that may be grasped, 0..1.
        confidence_tie: of several objects one this much less certain than the surest counts as equally so.
        mirror_above_deg: wrist rotation left from which the mirrored mode is considered.
        offset_max_m: greatest horizontal distance of the object's centre from the palm's axis that an arm takes out.
        friction_coefficient: of fingers on an object whose own is not told.
        table_depth_m: depth of a table under the palm; none: the fingers hang free, beside what the object stands on.
        width_min_m, depth_min_m, depth_max_m: limits of your own to an object's width and its centre's depth below the
            palm; none: what the fingers reach.
    """

    slenderness_min: float
    confidence_min: float
    confidence_tie: float
    offset_max_m: float
    mirror_above_deg: float
    friction_coefficient: float = 0.6
    table_depth_m: float | None = None
    width_min_m: float | None = None
    depth_min_m: float | None = None
    depth_max_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "slenderness_min", "offset_max_m", "friction_coefficient")
        for name in ("table_depth_m", "width_min_m", "depth_min_m", "depth_max_m"):
            if getattr(self, name) is not None:
                require_positive(self, name)
        if not (0.0 <= self.confidence_min <= 1.0 and 0.0 <= self.confidence_tie <= 1.0):
            raise ValueError("confidence_min and confidence_tie must lie in 0..1")
        if self.depth_min_m is not None and self.depth_max_m is not None and self.depth_min_m >= self.depth_max_m:
            raise ValueError(f"depth_min_m = {self.depth_min_m:g} must be less than depth_max_m")
        if self.mirror_above_deg < 0.0:
            raise ValueError(f"mirror_above_deg must not be negative, found {self.mirror_above_deg:g}")


@dataclass(frozen=True)
class DetectedObject:
    """An object the camera sees, in ``gripper_base``, sizes as in visualization_msgs/Marker.

    Args:
        label: the detector's name for it.
        shape: sphere, cylinder or box.
        size_m: sphere: diameters; cylinder (axis along body z): diameter, diameter, length; box: full extents.
        position_m: centre.
        orientation_xyzw: quaternion of the body axes; normalised here.
        confidence: 0..1.
        hidden_m: of a length that is seen in part, how much farther it may reach at the negative and at the positive
            end of its axis; size and centre are those of the part that is seen.

    Raises:
        ValueError: an unknown shape, a size that is not positive, a number that is not finite, a zero quaternion,
            a confidence outside 0..1, a hidden length that is negative.
    """

    label: str
    shape: Shape
    size_m: tuple[float, float, float]
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]
    confidence: float
    hidden_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ValueError(f"{self.label}: shape {self.shape!r} is none of {', '.join(SHAPES)}")
        for name, count in (("size_m", 3), ("position_m", 3), ("orientation_xyzw", 4), ("hidden_m", 2)):
            value = tuple(float(number) for number in getattr(self, name))
            if len(value) != count or not all(math.isfinite(number) for number in value):
                raise ValueError(f"{self.label}: {name} must hold {count} finite numbers, found {value}")
            object.__setattr__(self, name, value)
        if min(self.size_m) <= 0.0:
            raise ValueError(f"{self.label}: size must be positive, found {self.size_m} m")
        if min(self.hidden_m) < 0.0:
            raise ValueError(f"{self.label}: hidden_m must not be negative, found {self.hidden_m}")
        if not 0.0 <= self.confidence <= 1.0:
            raise ValueError(f"{self.label}: confidence must lie in 0..1, found {self.confidence}")
        norm = math.hypot(*self.orientation_xyzw)
        if norm < 1e-6:
            raise ValueError(f"{self.label}: the orientation is a zero quaternion")
        object.__setattr__(self, "orientation_xyzw", tuple(part / norm for part in self.orientation_xyzw))

    @property
    def words(self) -> str:
        """What it is and where, for people."""
        return f"{self.label} at ({1e3 * self.position_m[0]:.0f}, {1e3 * self.position_m[1]:.0f}) mm"

    @property
    def offset_m(self) -> float:
        """Horizontal distance of the centre from the palm's axis [m]."""
        return math.hypot(self.position_m[0], self.position_m[1])


@dataclass(frozen=True)
class WristPose:
    """Pose in ``gripper_base`` (as it is now) to which the wrist should go: position [m], quaternion x, y, z, w."""

    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]


@dataclass(frozen=True)
class GraspChoice:
    """The mode for an object.

    Args:
        target: the object.
        mode: name of the mode.
        quarter_turns: turn of the mode about gripper Z, in 90 deg.
        mirrored: whether the mirrored mode is used (mirrored first, then turned).
        wrist_rotation_rad: rotation about gripper Z left for the wrist, in (-pi/4, pi/4].
        reason: why this mode, for people.
        grip_gauge_pa: pressure to grip with [Pa gauge]; none: that of the mode.
    """

    target: DetectedObject
    mode: str
    quarter_turns: int
    mirrored: bool
    wrist_rotation_rad: float
    reason: str
    grip_gauge_pa: float | None = None

    @property
    def wrist_pose(self) -> WristPose:
        """Pose that puts the palm's axis through the object's centre and the mode's rod axis along the object."""
        x, y, _ = self.target.position_m
        return WristPose((x, y, 0.0), about_z(self.wrist_rotation_rad))


@dataclass(frozen=True)
class Refusal:
    """No grasp, and why."""

    reason: str


@dataclass(frozen=True)
class _Footprint:
    """How an object lies, seen along gripper Z. Round: no axis, length = width.

    Args:
        width_m, length_m: extents; the length that is seen.
        axis_azimuth_rad: of the length.
        hidden_m: how much farther the length may reach against, and along, that azimuth.
    """

    width_m: float
    length_m: float
    axis_azimuth_rad: float | None
    hidden_m: tuple[float, float] = (0.0, 0.0)

    @property
    def longest_m(self) -> float:
        """Length if all that is hidden belongs to it."""
        return self.length_m + sum(self.hidden_m)


class ModeSelector:
    """Picks the grasp mode of an object.

    Args:
        config: thresholds.
        gripper: the muscles and where they stand, which set what can be reached (:mod:`~mbpam_ros.grasp.reach`).
        modes: the grasp modes by name.
        grip: how hard an object of known mass is gripped; none: as its mode always is.

    Raises:
        RodSolutionError: the gripper's design has no rod law.
    """

    def __init__(
        self,
        config: SelectionConfig,
        gripper: Gripper,
        modes: Mapping[str, GraspMode],
        grip: GripPlanner | None = None,
    ) -> None:
        self._config, self._modes, self._grip = config, modes, grip
        self._reach = Reach(gripper, modes, config.friction_coefficient, config.table_depth_m)

    def select(self, target: DetectedObject, expected: Expected = NOTHING_EXPECTED) -> GraspChoice | Refusal:
        """Return mode, turn, wrist pose and pressure for one object, or why it cannot be grasped.

        Of an object seen in part the centre is taken where, of all places it may be in, it is nearest to the palm's
        axis: a rod that is long enough can be taken there, wherever it ends.
        """
        footprint = _footprint(target)
        target = _at_nearest_centre(target, footprint)
        name, why = self._mode_for(target, footprint)
        turns, rotation = _nearest_turn(footprint.axis_azimuth_rad)
        mirrored = self._mirror_helps(self._modes[name], rotation)
        obstacle = self._obstacle(target, footprint) or self._reach.obstacle(
            _lined_up(target, rotation), name, turns, mirrored
        )
        if obstacle is not None:
            return Refusal(f"{target.label}: {obstacle}")
        grip = self._grip_for(name, target, footprint, expected)
        if isinstance(grip, str):
            return Refusal(f"{target.label}: {grip}")
        if grip is not None:
            why = f"{why}; {1e-3 * grip:.0f} kPa hold it"
        return GraspChoice(target, name, turns, mirrored, rotation, f"{target.label}: {why}", grip)

    def choose(self, targets: Sequence[DetectedObject], expected: Expected = NOTHING_EXPECTED) -> GraspChoice | Refusal:
        """Return the grasp of the nearest of several objects that can be grasped, or why none can be.

        Nearest to the palm's axis. One whose confidence is more than ``confidence_tie`` below that of the surest that
        can be grasped is passed over. The reason names the others, and why those that cannot be grasped cannot.
        """
        if not targets:
            return Refusal("no object in view")
        answers = [self.select(target, expected) for target in targets]
        choices = [answer for answer in answers if isinstance(answer, GraspChoice)]
        refused = [answer.reason for answer in answers if isinstance(answer, Refusal)]
        if not choices:
            return Refusal("no object can be grasped: " + "; ".join(refused))
        sure = max(choice.target.confidence for choice in choices) - self._config.confidence_tie
        nearest = min(
            (choice for choice in choices if choice.target.confidence >= sure),
            key=lambda choice: (choice.target.offset_m, -choice.target.confidence),
        )
        if len(targets) == 1:
            return nearest
        others = [choice.target.words for choice in choices if choice is not nearest] + refused
        among = f"{nearest.reason}; nearest of {len(targets)}, {nearest.target.words}; not: {'; '.join(others)}"
        return replace(nearest, reason=among)

    def _grip_for(
        self, mode: str, target: DetectedObject, footprint: _Footprint, expected: Expected
    ) -> float | str | None:
        """Return the grip pressure [Pa gauge], why no pressure holds the object, or None: that of the mode."""
        if self._grip is None:
            return None
        friction = expected.friction_coefficient or self._config.friction_coefficient
        return self._grip.pressure_gauge_pa(mode, footprint.width_m, target.position_m[2], friction, expected)

    def _mode_for(self, target: DetectedObject, footprint: _Footprint) -> tuple[str, str]:
        if footprint.axis_azimuth_rad is None:
            return "envelope", f"{target.shape} is round from above, {1e3 * footprint.width_m:.0f} mm"
        if target.shape == "box":
            return "mid_rod", "box, flat faces want all fingers in one plane"
        least, most = footprint.length_m / footprint.width_m, footprint.longest_m / footprint.width_m
        likely_m = footprint.length_m + min(0.5 * sum(footprint.hidden_m), _LIKELY_HIDDEN_M)
        threshold = self._config.slenderness_min
        if least == most:
            known = f"{least:.1f}"
        else:
            known = f"{least:.1f} to {most:.1f} (seen in part)"
        if likely_m / footprint.width_m >= threshold:
            return "slender_rod", f"round rod of slenderness {known}, at least {threshold:g}"
        return "short_rod", f"round rod of slenderness {known}, less than {threshold:g}"

    def _obstacle(self, target: DetectedObject, footprint: _Footprint) -> str | None:
        """Return which of the configured limits the object breaks, or None."""
        config = self._config
        width_mm, depth_m, offset_mm = 1e3 * footprint.width_m, target.position_m[2], 1e3 * target.offset_m
        if target.confidence < config.confidence_min:
            return f"confidence {target.confidence:.2f} is less than {config.confidence_min:g}"
        if target.offset_m > config.offset_max_m:
            farthest_mm = 1e3 * config.offset_max_m
            beyond_mm = offset_mm - farthest_mm
            return f"too far off the axis by {beyond_mm:.0f} mm: {offset_mm:.0f} mm, at most {farthest_mm:g} mm"
        if config.width_min_m is not None and footprint.width_m < config.width_min_m:
            return f"too small: {width_mm:.1f} mm wide, at least {1e3 * config.width_min_m:g} mm by the configuration"
        low_m, high_m = config.depth_min_m or 0.0, config.depth_max_m or math.inf
        if not low_m <= depth_m <= high_m and depth_m > 0.0:
            return (
                f"centre {1e3 * depth_m:.0f} mm below the palm, must be {1e3 * low_m:g} to {1e3 * high_m:g} mm by the "
                "configuration"
            )
        return None

    def _mirror_helps(self, mode: GraspMode, wrist_rotation_rad: float) -> bool:
        """Whether the mirrored mode, not the plain one, turns a skew object toward the mode's axis.

        It matters only where no arm takes the rotation out; near alignment the paper's plain mode stays.
        """
        skew = abs(wrist_rotation_rad) > math.radians(self._config.mirror_above_deg)
        return skew and mode.yaw_couple * wrist_rotation_rad > 1e-9


def _lined_up(target: DetectedObject, wrist_rotation_rad: float) -> Body:
    """The object as it lies once the wrist is at the wrist pose."""
    depth_m = target.position_m[2]
    turned = product(about_z(-wrist_rotation_rad), target.orientation_xyzw)
    return Body(target.shape, target.size_m, (0.0, 0.0, depth_m), turned)


def _footprint(target: DetectedObject) -> _Footprint:
    if target.shape == "sphere":
        return _Footprint(max(target.size_m), max(target.size_m), None)
    axes = rotation_matrix(target.orientation_xyzw)
    upright = int(np.argmax(np.abs(axes[2])))
    if target.shape == "cylinder":
        diameter, length = max(target.size_m[:2]), target.size_m[2]
        # A cylinder is round about z: it stands only if its axis is nearer to the vertical than 45 deg.
        if abs(axes[2, 2]) > math.sqrt(0.5):
            return _Footprint(diameter, diameter, None)
        return _Footprint(diameter, length, math.atan2(axes[1, 2], axes[0, 2]), target.hidden_m)
    long, short = sorted((axis for axis in range(3) if axis != upright), key=lambda axis: -target.size_m[axis])
    azimuth = math.atan2(axes[1, long], axes[0, long])
    return _Footprint(target.size_m[short], target.size_m[long], azimuth, target.hidden_m)


def _at_nearest_centre(target: DetectedObject, footprint: _Footprint) -> DetectedObject:
    """The object with that of its possible centres which is nearest to the palm's axis."""
    if footprint.axis_azimuth_rad is None or not any(footprint.hidden_m):
        return target
    x, y, z = target.position_m
    along = math.cos(footprint.axis_azimuth_rad), math.sin(footprint.axis_azimuth_rad)
    back, forth = footprint.hidden_m
    shift = min(max(-(x * along[0] + y * along[1]), -0.5 * back), 0.5 * forth)
    return replace(target, position_m=(x + shift * along[0], y + shift * along[1], z))


def _nearest_turn(axis_azimuth_rad: float | None) -> tuple[int, float]:
    """Return the quarter turns (0 or 1) that bring gripper Y nearest to the axis, and the rotation then left [rad].

    An axis has no sense, and every mode comes back after half a turn about gripper Z or holds the same axis.
    """
    if axis_azimuth_rad is None:
        return 0, 0.0
    quarters = axis_azimuth_rad / (math.pi / 2.0) - 1.0
    nearest = math.ceil(quarters - 0.5)
    return nearest % 2, (quarters - nearest) * (math.pi / 2.0)
