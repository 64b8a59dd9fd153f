"""A scene's object and supports set among the muscles; what would start inside something else is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.configuration import ConfigError
from mbpam_ros.geometry.rotations import rotation_matrix
from mbpam_ros.geometry.solids import distance_m, half_height
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.tiers.base import PlantConfig, RigidBody, TierSetup

REST_TOLERANCE_M = 0.002
"""How deep in a support anything may start."""

_SPACING_M = 0.001


def placed(scene: Scene, gripper: Gripper, config: PlantConfig, contact: bool) -> TierSetup:
    """Return what there is for a tier to move.

    Args:
        scene: what is there besides the muscles.
        gripper: the muscles and where they stand.
        config: constants of muscles and contacts, but for those that the scene gives.
        contact: whether anything touches; otherwise the object may start inside a finger.

    Raises:
        ConfigError: the object starts inside its support, the palm or a finger, or a muscle inside the table.
    """
    planes = np.empty((0, 3)) if scene.support is None else scene.support.planes_m
    if len(planes) and planes[-1, 0] < gripper.geometry.length_m - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the table is {planes[-1, 0]:g} m under the palm, the hanging muscles reach "
            f"{gripper.geometry.length_m:g} m; use a deeper table, or a slim stand on one (half_size_m, stand_height_m)"
        )
    body = _body(scene)
    if body is not None and contact:
        _refuse_inside_a_finger(scene, body, gripper)
    return TierSetup(
        geometry=gripper.rod_geometry,
        finger_base_m=gripper.finger_base_m,
        gravity_m_s2=scene.gravity_m_s2,
        body=body,
        planes_m=planes,
        config=_with_own_contact(config, scene),
        fingers_touch=scene.fingers_touch,
        gravity_direction=scene.gravity_direction,
    )


def _with_own_contact(config: PlantConfig, scene: Scene) -> PlantConfig:
    kind = config.finger_object
    if scene.friction_coefficient is not None:
        kind = dataclasses.replace(kind, friction_coefficient=scene.friction_coefficient)
    if scene.contact_stiffness_n_m is not None:
        kind = dataclasses.replace(kind, stiffness_n_m=scene.contact_stiffness_n_m)
    return dataclasses.replace(config, finger_object=kind)


def _body(scene: Scene) -> RigidBody | None:
    spec = scene.object
    if spec is None:
        return None
    position, orientation = np.array(scene.object_position_m), scene.object_orientation_xyzw
    reach = half_height(spec.shape, spec.size_m, orientation)
    if position[2] < reach - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the object starts {1e3 * (reach - position[2]):.1f} mm inside the palm; "
            f"set the third of object_position_m to {reach:.4f} or more"
        )
    if scene.support is not None:
        inside = position[2] + reach - scene.support.depth_m
        if inside > REST_TOLERANCE_M:
            raise ConfigError(
                f"scene {scene.name}: the object starts {1e3 * inside:.1f} mm inside its support; "
                f"set support.depth_m to {scene.support.depth_m + inside:.4f}"
            )
    return RigidBody(spec.shape, spec.size_m, spec.mass_kg, position, orientation)


def _refuse_inside_a_finger(scene: Scene, body: RigidBody, gripper: Gripper) -> None:
    clearance = _finger_clearance_m(body, gripper.geometry, gripper.finger_base_m)
    finger = int(np.argmin(clearance))
    if clearance[finger] < -REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the object starts {-1e3 * clearance[finger]:.1f} mm inside finger {finger + 1} as it "
            "hangs; move object_position_m away from it, turn the object (object_yaw_rad), or use a smaller one"
        )


def _finger_clearance_m(
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
