"""A scene's objects and supports set among the muscles; what would start inside something else is refused."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.configuration import ConfigError
from mbpam_ros.geometry.rotations import rotation_matrix
from mbpam_ros.geometry.solids import distance_from_m, half_height, surface_points_m
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.scene import PlacedObject, Scene
from mbpam_ros.plant.tiers.base import PlantConfig, RigidBody, TierSetup

MOST_OBJECTS = 32
"""Each pair has room of its own in the table of contacts."""

REST_TOLERANCE_M = 0.002
"""How deep in a support anything may start."""

_SPACING_M = 0.001


def placed(scene: Scene, gripper: Gripper, config: PlantConfig, contact: bool) -> TierSetup:
    """Return what there is for a tier to move.

    Args:
        scene: what is there besides the muscles.
        gripper: the muscles and where they stand.
        config: constants of muscles and contacts, but for those that the scene gives.
        contact: whether anything touches; otherwise objects may start inside a finger and each other.

    Raises:
        ConfigError: an object starts inside a support, the palm, a finger or another object, or a muscle inside the
            table; or there are more than :data:`MOST_OBJECTS`.
    """
    planes = np.empty((0, 3)) if scene.support is None else scene.support.planes_m
    if len(planes) and planes[-1, 0] < gripper.geometry.length_m - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the table is {planes[-1, 0]:g} m under the palm, the hanging muscles reach "
            f"{gripper.geometry.length_m:g} m; use a deeper table, or a slim stand on one (half_size_m, stand_height_m)"
        )
    if len(scene.placed) > MOST_OBJECTS:
        raise ConfigError(f"scene {scene.name}: {len(scene.placed)} objects; at most {MOST_OBJECTS} are computed")
    bodies = [_body(scene, each) for each in scene.placed]
    if contact:
        for each, body in zip(scene.placed, bodies, strict=True):
            _refuse_inside_a_finger(scene, each, body, gripper)
        _refuse_inside_each_other(scene, bodies)
    return TierSetup(
        geometry=gripper.rod_geometry,
        finger_base_m=gripper.finger_base_m,
        gravity_m_s2=scene.gravity_m_s2,
        body=bodies[0] if bodies else None,
        planes_m=planes,
        config=_with_own_contact(config, scene),
        fingers_touch=scene.fingers_touch,
        gravity_direction=scene.gravity_direction,
        others=tuple(bodies[1:]),
    )


def _with_own_contact(config: PlantConfig, scene: Scene) -> PlantConfig:
    kind = config.finger_object
    if scene.friction_coefficient is not None:
        kind = dataclasses.replace(kind, friction_coefficient=scene.friction_coefficient)
    if scene.contact_stiffness_n_m is not None:
        kind = dataclasses.replace(kind, stiffness_n_m=scene.contact_stiffness_n_m)
    return dataclasses.replace(config, finger_object=kind)


def _body(scene: Scene, placed: PlacedObject) -> RigidBody:
    spec, name = placed.object, _called(scene, placed)
    position, orientation = np.array(placed.object_position_m), placed.orientation_xyzw
    reach = half_height(spec.shape, spec.size_m, orientation)
    if position[2] < reach - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: {name} starts {1e3 * (reach - position[2]):.1f} mm inside the palm; "
            f"set the third of object_position_m to {reach:.4f} or more"
        )
    body = RigidBody(spec.shape, spec.size_m, spec.mass_kg, position, orientation)
    for depth_m, half_x_m, half_y_m in () if scene.support is None else scene.support.planes_m:
        inside = position[2] + reach - depth_m
        if inside <= REST_TOLERANCE_M or (scene.others and _beside(body, half_x_m, half_y_m)):
            continue
        if scene.others:
            raise ConfigError(
                f"scene {scene.name}: {name} starts {1e3 * inside:.1f} mm inside its support; set the third of its "
                f"object_position_m to {depth_m - reach:.4f} or less"
            )
        raise ConfigError(
            f"scene {scene.name}: {name} starts {1e3 * inside:.1f} mm inside its support; "
            f"set support.depth_m to {depth_m + inside:.4f}"
        )
    return body


def _called(scene: Scene, placed: PlacedObject) -> str:
    return placed.object.name if scene.others else "the object"


def _beside(body: RigidBody, half_x_m: float, half_y_m: float) -> bool:
    """Whether no point of an object is over a footprint."""
    points = _surface_m(body)
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(low[0] > half_x_m or high[0] < -half_x_m or low[1] > half_y_m or high[1] < -half_y_m)


def _refuse_inside_a_finger(scene: Scene, placed: PlacedObject, body: RigidBody, gripper: Gripper) -> None:
    clearance = _finger_clearance_m(body, gripper.geometry, gripper.finger_base_m)
    finger = int(np.argmin(clearance))
    if clearance[finger] < -REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: {_called(scene, placed)} starts {-1e3 * clearance[finger]:.1f} mm inside finger "
            f"{finger + 1} as it hangs; move object_position_m away from it, turn the object (object_yaw_rad), or use "
            "a smaller one"
        )


def _refuse_inside_each_other(scene: Scene, bodies: Sequence[RigidBody]) -> None:
    for (one, first), (other, second) in itertools.combinations(zip(scene.placed, bodies, strict=True), 2):
        inside = -min(_lowest_distance_m(first, second), _lowest_distance_m(second, first))
        if inside > REST_TOLERANCE_M:
            raise ConfigError(
                f"scene {scene.name}: {one.object.name} and {other.object.name} start {1e3 * inside:.1f} mm inside "
                "each other; move one of them (object_position_m)"
            )


def _lowest_distance_m(solid: RigidBody, other: RigidBody) -> float:
    """Return the smallest distance of the other's surface from a solid, sought point by point; negative inside."""
    return float(_distance_m(solid, _surface_m(other)).min())


def _distance_m(body: RigidBody, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return distance_from_m(body.shape, body.size_m, body.position_m, body.orientation_xyzw, points_m)


def _surface_m(body: RigidBody) -> NDArray[np.float64]:
    return surface_points_m(body.shape, body.size_m) @ rotation_matrix(body.orientation_xyzw).T + body.position_m


def _finger_clearance_m(
    body: RigidBody, geometry: MuscleGeometry, finger_base_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the gap [m] between the object at its start and each straight finger, shape (4,); negative inside.

    A finger is its axis swept by a ball of its radius, up to its rounded tip; sought every millimetre along it.
    """
    end_m = geometry.length_m - geometry.outer_radius_m
    along = np.linspace(0.0, end_m, 1 + round(end_m / _SPACING_M))
    clearance = np.empty(len(finger_base_m))
    for finger, base in enumerate(finger_base_m):
        points = base + along[:, None] * [0.0, 0.0, 1.0]
        clearance[finger] = _distance_m(body, points).min() - geometry.outer_radius_m
    return clearance
