"""Shapes as markers for RViz and Foxglove, and detections as markers between our own nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.geometry.solids import Shape
from mbpam_ros.nodes.messages import MessageError, point, pose

MARKER_TYPES: dict[Shape, int] = {"sphere": Marker.SPHERE, "cylinder": Marker.CYLINDER, "box": Marker.CUBE}
SHAPES = {marker_type: shape for shape, marker_type in MARKER_TYPES.items()}


def colour(rgb: Sequence[float], alpha: float = 1.0) -> ColorRGBA:
    """Return a colour from components in 0..1."""
    red, green, blue = (float(value) for value in rgb)
    return ColorRGBA(r=red, g=green, b=blue, a=float(alpha))


def finger_markers(
    stamp: Time, frame_id: str, centreline_m: NDArray[np.float64], radius_m: float, rgb: Sequence[float]
) -> list[Marker]:
    """Return one line strip as thick as the muscle per finger; a finger with NaN gets a DELETE.

    Args:
        centreline_m: shape (4, n, 3), clamp to tip.
    """
    markers = []
    for i, line in enumerate(centreline_m):
        marker = _marker(stamp, frame_id, "finger", i, Marker.LINE_STRIP)
        if np.isnan(line).any():
            marker.action = Marker.DELETE
        else:
            marker.scale.x = 2.0 * radius_m
            marker.color = colour(rgb)
            marker.points = [point(position) for position in line]
        markers.append(marker)
    return markers


def finger_lines(message: MarkerArray, frame_id: str) -> tuple[Time, NDArray[np.float64] | None]:
    """Return stamp and centre lines, (4, n, 3), of what :func:`finger_markers` made; None if one is not known.

    Raises:
        MessageError: not four line strips of so many points each, in another frame, or a point that is not finite.
    """
    markers = [marker for marker in message.markers if marker.ns == "finger"]
    if sorted(marker.id for marker in markers) != list(range(FINGER_COUNT)):
        raise MessageError(f"it must hold the markers 0 to {FINGER_COUNT - 1} of the namespace 'finger'")
    header = markers[0].header
    if any(marker.header.frame_id != frame_id for marker in markers):
        raise MessageError(f"header.frame_id must be {frame_id!r}, found {header.frame_id!r}")
    if any(marker.action != Marker.ADD for marker in markers):
        return header.stamp, None
    counts = {len(marker.points) for marker in markers}
    lines = np.array([(at.x, at.y, at.z) for marker in markers for at in marker.points])
    if len(counts) != 1 or counts.pop() < 2 or not np.isfinite(lines).all():
        raise MessageError("each finger must have as many points as the others, two or more, all finite")
    return header.stamp, lines.reshape(FINGER_COUNT, -1, 3)


def solid_marker(
    stamp: Time,
    frame_id: str,
    namespace: str,
    index: int,
    shape: Shape,
    size_m: Sequence[float] | NDArray[np.float64],
    position_m: Sequence[float] | NDArray[np.float64],
    orientation_xyzw: Sequence[float] | NDArray[np.float64],
    rgba: ColorRGBA,
) -> Marker:
    """Return a sphere, cylinder or box of true size [m] at its pose."""
    marker = _marker(stamp, frame_id, namespace, index, MARKER_TYPES[shape])
    marker.pose = pose(position_m, orientation_xyzw)
    marker.scale.x, marker.scale.y, marker.scale.z = (float(value) for value in size_m)
    marker.color = rgba
    return marker


def mark_hidden_lengths(marker: Marker, hidden_m: Sequence[float]) -> None:
    """Note in a cylinder's or box's marker how much farther its length may reach at either end.

    As two points of its own frame, the farthest that its ends may be; a marker without points is seen to its ends.
    """
    if any(hidden_m):
        axis, length_m = _length_axis(marker)
        for sign, hidden in zip((-1.0, 1.0), hidden_m, strict=True):
            end = np.zeros(3)
            end[axis] = sign * (0.5 * length_m + hidden)
            marker.points.append(point(end))


def hidden_lengths(marker: Marker) -> tuple[float, float]:
    """Return what :func:`mark_hidden_lengths` noted [m]; what reaches less far than the marker itself hides nothing."""
    if len(marker.points) != 2:
        return 0.0, 0.0
    axis, length_m = _length_axis(marker)
    first, second = ((end.x, end.y, end.z)[axis] for end in marker.points)
    return max(-first - 0.5 * length_m, 0.0), max(second - 0.5 * length_m, 0.0)


def _length_axis(marker: Marker) -> tuple[int, float]:
    """The axis along which a solid's length lies, z of a cylinder and y of a box, and the length [m]."""
    return (2, marker.scale.z) if marker.type == Marker.CYLINDER else (1, marker.scale.y)


def delete_all(stamp: Time, frame_id: str) -> Marker:
    """Return the marker that clears what was drawn before."""
    marker = _marker(stamp, frame_id, "", 0, Marker.SPHERE)
    marker.action = Marker.DELETEALL
    return marker


def _marker(stamp: Time, frame_id: str, namespace: str, index: int, marker_type: int) -> Marker:
    marker = Marker(ns=namespace, id=index, type=marker_type, action=Marker.ADD)
    marker.header.stamp, marker.header.frame_id = stamp, frame_id
    marker.pose.orientation.w = 1.0
    return marker
