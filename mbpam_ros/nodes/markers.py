"""Shapes as markers for RViz and Foxglove, and detections as markers between our own nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.nodes.messages import point, pose

BASE_FRAME = "gripper_base"
"""Origin in the palm's centre, z out of the palm along the hanging fingers."""

WORLD_FRAME = "world"
"""``gripper_base`` as it stood at the start; it stays when the hand is lifted (along -z)."""

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
