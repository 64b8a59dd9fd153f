"""How far an object is from the fingers as they hang before anything moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.geometry.rotations import rotation_matrix
from mbpam_ros.geometry.solids import distance_m
from mbpam_ros.plant.tiers.base import RigidBody

_SPACING_M = 0.001


def finger_clearance_m(
    body: RigidBody, geometry: MuscleGeometry, finger_base_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the gap [m] between the object at its start and each straight finger, shape (4,); negative inside.

    A finger is its axis swept by a ball of its radius, up to its rounded tip; sought every millimetre along it.
    """
    rotation = rotation_matrix(body.orientation_xyzw)
    end_m = geometry.length_m - geometry.outer_radius_m
    along = np.linspace(0.0, end_m, 1 + round(end_m / _SPACING_M))
    clearance = np.empty(len(finger_base_m))
    for finger, base in enumerate(finger_base_m):
        points = (base + along[:, None] * [0.0, 0.0, 1.0] - body.position_m) @ rotation
        clearance[finger] = distance_m(body.shape, body.size_m, points).min() - geometry.outer_radius_m
    return clearance
