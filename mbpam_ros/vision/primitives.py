"""The primitives the detector fits: a sphere, a lying cylinder and a box, all standing on one horizontal plane.

Each is a short vector of parameters; its height over the support couples to its size, so that what the image shows
of it fixes its size in metres. A primitive's silhouette is the convex hull of its projected vertices.

Parameters [m, rad], all in ``gripper_base``: sphere (x, y, radius); cylinder (x, y, yaw, radius, length); box (x, y,
yaw, width, length, height). At yaw = 0 the cylinder's axis and the box's length lie along y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.geometry.solids import BOX_CORNERS, Shape
from mbpam_ros.vision.raycast import Body

SPHERE_VERTICES = 48
CAP_VERTICES = 32

_PARAMETERS: dict[str, tuple[str, ...]] = {
    "sphere": ("x", "y", "radius"),
    "cylinder": ("x", "y", "yaw", "radius", "length"),
    "box": ("x", "y", "yaw", "width", "length", "height"),
}
YAW_INDEX = 2
FIRST_SIZE = {"sphere": 2, "cylinder": 3, "box": 3}

_BOX_FACES = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], dtype=float)
_BOX_EDGES = np.array([(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit])


def parameter_count(shape: Shape) -> int:
    """Number of parameters of ``shape``."""
    return len(_PARAMETERS[shape])


def vertices(shape: Shape, parameters: NDArray, support_depth_m: float, eye_m: NDArray) -> NDArray[np.float64]:
    """Points whose convex hull has the silhouette of the primitive, seen from ``eye_m``, shape (3,).

    Args:
        parameters: (k, parameter_count), k variants at once.

    Returns:
        (k, m, 3) points in ``gripper_base``; m and the points' order depend on the shape alone.
    """
    p = np.atleast_2d(parameters)
    if shape == "sphere":
        return _sphere_outline(p, support_depth_m, eye_m)
    yaw = p[:, YAW_INDEX]
    zero = np.zeros_like(yaw)
    across = np.stack([np.cos(yaw), np.sin(yaw), zero], axis=-1)[:, None, :]
    along = np.stack([-np.sin(yaw), np.cos(yaw), zero], axis=-1)[:, None, :]
    if shape == "cylinder":
        radius, half_length = p[:, 3, None, None], 0.5 * p[:, 4, None, None]
        angle = 2.0 * math.pi * np.arange(CAP_VERTICES) / CAP_VERTICES
        down = np.array([0.0, 0.0, 1.0])
        ring = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * down)
        ring += np.stack([p[:, 0], p[:, 1], support_depth_m - p[:, 3]], axis=-1)[:, None, :]
        return np.concatenate([ring - half_length * along, ring + half_length * along], axis=1)
    half = 0.5 * p[:, 3:6]
    centre = np.stack([p[:, 0], p[:, 1], support_depth_m - half[:, 2]], axis=-1)[:, None, :]
    corner = BOX_CORNERS[None] * half[:, None, :]
    return centre + corner[..., :1] * across + corner[..., 1:2] * along + corner[..., 2:] * np.array([0.0, 0.0, 1.0])


def _sphere_outline(p: NDArray, support_depth_m: float, eye_m: NDArray) -> NDArray[np.float64]:
    """The circle in which the cone of tangents from the eye touches the sphere."""
    radius = p[:, 2, None]
    view = np.column_stack([p[:, :2], support_depth_m - p[:, 2]]) - eye_m
    distance = np.linalg.norm(view, axis=1, keepdims=True)
    view = view / distance
    first = np.cross(view, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(view, first)
    sine = radius / distance
    centre = eye_m + view * (distance - radius * sine)
    ring = radius * np.sqrt(np.maximum(1.0 - sine**2, 1e-9))
    angle = 2.0 * math.pi * np.arange(SPHERE_VERTICES) / SPHERE_VERTICES
    circle = np.cos(angle)[:, None] * first[:, None, :] + np.sin(angle)[:, None] * second[:, None, :]
    return centre[:, None, :] + ring[:, None, :] * circle


def box_creases(parameters: NDArray, support_depth_m: float, eye_m: NDArray) -> NDArray[np.intp]:
    """Vertex pairs, shape (c, 2), of a box's edges between two faces that the eye sees."""
    body = to_body("box", parameters, support_depth_m)
    eye = (eye_m - body.centre) @ body.rotation
    seen = _BOX_FACES @ eye > np.abs(_BOX_FACES) @ body.half_size
    on_face = (BOX_CORNERS @ _BOX_FACES.T) > 0.5  # (8, 6)
    faces_of_edge = on_face[_BOX_EDGES[:, 0]] & on_face[_BOX_EDGES[:, 1]]
    return _BOX_EDGES[(faces_of_edge & seen).sum(axis=1) == 2]


def sizes(shape: Shape, parameters: NDArray) -> NDArray[np.float64]:
    """Size (3,) [m] as in ``visualization_msgs/Marker``."""
    p = parameters
    if shape == "sphere":
        return np.full(3, 2.0 * p[2])
    if shape == "cylinder":
        return np.array([2.0 * p[3], 2.0 * p[3], p[4]])
    return np.array(p[3:6])


def to_body(shape: Shape, parameters: NDArray, support_depth_m: float) -> Body:
    """The primitive as a body for ray casting. A cylinder's body z is its axis."""
    p, size = parameters, sizes(shape, parameters)
    height = size[2] if shape == "box" else size[0]
    rotation = np.eye(3)
    if shape != "sphere":
        c, s = math.cos(p[YAW_INDEX]), math.sin(p[YAW_INDEX])
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    if shape == "cylinder":
        rotation = rotation @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return Body(shape, 0.5 * size, np.array([p[0], p[1], support_depth_m - 0.5 * height]), rotation)


def canonical(shape: Shape, parameters: NDArray) -> NDArray[np.float64]:
    """The same primitive with length >= width and yaw in (-90, 90] deg."""
    p = np.array(parameters, dtype=float)
    if shape == "sphere":
        return p
    if shape == "box" and p[3] > p[4]:
        p[3], p[4] = p[4], p[3]
        p[YAW_INDEX] += 0.5 * math.pi
    p[YAW_INDEX] = 0.5 * math.pi - (0.5 * math.pi - p[YAW_INDEX]) % math.pi
    return p


@dataclass(frozen=True)
class Footprint:
    """A rectangle on the support plane: what a silhouette would be if it were flat. Lengths [m], yaw as above."""

    x: float
    y: float
    yaw: float
    width: float
    length: float


def first_guesses(
    shape: Shape, footprint: Footprint, rays: NDArray, support_depth_m: float, eye_m: NDArray
) -> list[NDArray[np.float64]]:
    """Parameters to start a fit from, given the silhouette's footprint and the rays (n, 3) through its contour."""
    if shape == "sphere":
        return [_sphere_from_cone(rays, support_depth_m, eye_m)]
    depth = support_depth_m - eye_m[2]
    flat = np.array([footprint.x, footprint.y])

    def raised(height: float) -> tuple[NDArray, float]:
        # What lies ``height`` above the plane is nearer to the eye by this factor than its footprint says.
        scale = (depth - height) / depth
        return eye_m[:2] + (flat - eye_m[:2]) * scale, scale

    if shape == "cylinder":
        radius = 0.5 * footprint.width / (1.0 + 0.5 * footprint.width / depth)
        centre, _ = raised(radius)
        length = footprint.length * raised(2.0 * radius)[1]
        return [np.array([*centre, footprint.yaw, radius, length])]
    guesses = []
    for fraction in (0.15, 0.4, 0.6):
        centre, scale = raised(fraction * depth)
        extents = (footprint.width * scale, footprint.length * scale)
        guesses.append(np.array([*centre, footprint.yaw, *extents, fraction * depth]))
    return guesses


def _sphere_from_cone(rays: NDArray, support_depth_m: float, eye_m: NDArray) -> NDArray[np.float64]:
    """Sphere on the plane from its cone of tangents: unit rays q on it satisfy q . axis = cos(half angle)."""
    scaled_axis = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    norm = float(np.linalg.norm(scaled_axis))
    axis, cosine = scaled_axis / norm, min(1.0 / norm, 1.0)
    sine = math.sqrt(1.0 - cosine**2)
    distance = (support_depth_m - eye_m[2]) / (axis[2] + sine)
    centre = eye_m + distance * axis
    return np.array([centre[0], centre[1], distance * sine])


def orientation_xyzw(body: Body) -> NDArray[np.float64]:
    """Quaternion (4,) of the body's rotation."""
    return Rotation.from_matrix(body.rotation).as_quat()
