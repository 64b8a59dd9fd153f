"""How far an object is from the fingers as they hang before anything moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.geometry.surfaces import SHAPE_CODES, signed_distance
from mbpam_ros.plant.tiers.base import RigidBody

_SPACING_M = 0.001
_distance = getattr(signed_distance, "py_func", signed_distance)
"""Not compiled: that would take longer than these few hundred points."""


def finger_clearance_m(
    body: RigidBody, geometry: MuscleGeometry, finger_base_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the gap [m] between the object at its start and each straight finger, shape (4,); negative inside.

    A finger is its axis swept by a ball of its radius, up to its rounded tip; sought every millimetre along it.
    """
    rotation = Rotation.from_quat(body.orientation_xyzw).as_matrix()
    end_m = geometry.length_m - geometry.outer_radius_m
    along = np.linspace(0.0, end_m, 1 + round(end_m / _SPACING_M))
    half = 0.5 * np.asarray(body.size_m)
    clearance = np.empty(len(finger_base_m))
    for finger, base in enumerate(finger_base_m):
        points = (base + along[:, None] * [0.0, 0.0, 1.0] - body.position_m) @ rotation
        distances = [_distance(SHAPE_CODES[body.shape], half, *point)[0] for point in points.tolist()]
        clearance[finger] = min(distances) - geometry.outer_radius_m
    return clearance
