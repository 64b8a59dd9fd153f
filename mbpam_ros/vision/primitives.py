"""The primitives the detector fits, all standing on one horizontal plane.

A ball, a lying cylinder, one that stands upright, a box on any of its faces and a lying capsule. Each is a short
vector of parameters; its height over the support couples to its size, so that what the image shows of it fixes its
size in metres. Its silhouette is the convex hull of its projected vertices.

Parameters [m, rad], all in ``gripper_base``: ball (x, y, radius); rod (x, y, yaw, radius, length); post (x, y, radius,
height); box (x, y, yaw, width, length, height); capsule (x, y, yaw, radius, length with its ends). At yaw = 0 the axis
of rod and capsule and the box's length lie along y.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.vision.solid_fit.compiled import clipped
from mbpam_ros.vision.solid_fit.outline import BOX, CAPSULE, POST, ROD, SPHERE

SHAPE_OF: dict[int, Shape] = {SPHERE: "sphere", ROD: "cylinder", POST: "cylinder", BOX: "box", CAPSULE: "cylinder"}
YAW_INDEX = 2

_HEIGHTS = (0.08, 0.16, 0.26, 0.38, 0.52)
"""Heights that a silhouette is tried for, as shares of the camera's own or of :data:`_TALL_M`."""
_TALL_M = 0.20
_LEAST_EXTENT_M = 0.003


def lies(form: int) -> bool:
    """Whether the form has a yaw."""
    return form in (ROD, BOX, CAPSULE)


def sizes(form: int, parameters: NDArray) -> NDArray[np.float64]:
    """Size (3,) [m] as in ``visualization_msgs/Marker``."""
    p = parameters
    if form == SPHERE:
        return np.full(3, 2.0 * p[2])
    if form == POST:
        return np.array([2.0 * p[2], 2.0 * p[2], p[3]])
    if form == BOX:
        return np.array(p[3:6])
    return np.array([2.0 * p[3], 2.0 * p[3], p[4]])


def height(form: int, parameters: NDArray) -> float:
    """Vertical extent [m]."""
    size = sizes(form, parameters)
    return float(size[2] if form in (BOX, POST) else size[0])


class Placed(NamedTuple):
    """Where a primitive's Marker stands: centre (3,) [m], orientation (4,)."""

    centre: NDArray[np.float64]
    orientation_xyzw: NDArray[np.float64]


def place(form: int, parameters: NDArray, support_depth_m: float) -> Placed:
    """Centre and orientation in the convention of ``visualization_msgs/Marker``: a cylinder's z is its axis."""
    p = parameters
    rotation = Rotation.identity()
    if lies(form):
        rotation = Rotation.from_euler("z", p[YAW_INDEX])
    if form in (ROD, CAPSULE):
        rotation = rotation * Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    centre = np.array([p[0], p[1], support_depth_m - 0.5 * height(form, p)])
    return Placed(centre, rotation.as_quat())


def canonical(form: int, parameters: NDArray) -> NDArray[np.float64]:
    """The same primitive with length >= width and yaw in (-90, 90] deg."""
    p = np.array(parameters, dtype=float)
    if not lies(form):
        return p
    if form == BOX and p[3] > p[4]:
        p[3], p[4] = p[4], p[3]
        p[YAW_INDEX] += 0.5 * math.pi
    p[YAW_INDEX] = 0.5 * math.pi - (0.5 * math.pi - p[YAW_INDEX]) % math.pi
    return p


def at_height(box: NDArray, height_m: float, support_depth_m: float, eye_m: NDArray) -> NDArray[np.float64]:
    """The box of another height whose top looks the same from the eye: it is scaled about the eye's foot."""
    eye_height = support_depth_m - float(eye_m[2])
    scale = (eye_height - height_m) / (eye_height - box[5])
    p = np.array(box, dtype=float)
    p[:2] = eye_m[:2] + scale * (p[:2] - eye_m[:2])
    p[3:5] *= scale
    p[5] = height_m
    return p


def first_guesses(
    rays: NDArray[np.float64], support_depth_m: float, eye_m: NDArray[np.float64]
) -> list[tuple[int, NDArray[np.float64]]]:
    """Forms and parameters to start fits from, given the rays (n, 3) through a silhouette's outline.

    Where the rays meet the support they draw the shape P that the object covers. An upright prism of height h with the
    base B covers B and its top seen against the support, which is B stretched by D / (D - h) about the foot of the
    eye, at a height of D. So the largest base for a height is that part of P which lies in P shrunk by (D - h) / D.
    """
    guesses: list[tuple[int, NDArray[np.float64]]] = []
    ball = _ball_from_cone(rays, support_depth_m, eye_m)
    if ball is not None:
        guesses.append((SPHERE, ball))
    depth = support_depth_m - float(eye_m[2])
    covered = (1e3 * depth * rays[:, :2] / rays[:, 2:]).astype(np.float32)  # OpenCV's tolerances suit millimetres
    outline = cv2.convexHull(covered)[:, 0].astype(float)
    if _area(outline) < 0.0:
        outline = outline[::-1].copy()
    rods: list[tuple[float, NDArray[np.float64]]] = []
    for share in _HEIGHTS:
        tall = share * min(depth, _TALL_M / _HEIGHTS[-1])
        base = clipped(outline, (depth - tall) / depth * outline)
        area = _area(base) if len(base) >= 3 else 0.0
        if area < (1e3 * _LEAST_EXTENT_M) ** 2:
            break
        (x, y), (first, second), degrees = cv2.minAreaRect(base.astype(np.float32))
        x, y, first, second, area = 1e-3 * x, 1e-3 * y, 1e-3 * first, 1e-3 * second, 1e-6 * area
        yaw = math.radians(degrees)  # of the side ``first``
        if first > second:
            first, second, yaw = second, first, yaw + 0.5 * math.pi
        if first < _LEAST_EXTENT_M:
            break
        x, y = x + eye_m[0], y + eye_m[1]
        guesses.append((BOX, np.array([x, y, yaw, first, second, tall])))
        radius = math.sqrt(area / math.pi)
        if second < 1.8 * first:
            guesses.append((POST, np.array([x, y, radius, tall])))
        rods.append((abs(math.log(first / tall)), np.array([x, y, yaw, 0.25 * (first + tall), second])))
    if rods:
        rod = min(rods, key=lambda item: item[0])[1]
        if rod[4] > 2.2 * rod[3]:
            guesses += [(ROD, rod), (CAPSULE, rod.copy())]
    return guesses


def _area(polygon: NDArray[np.float64]) -> float:
    x, y = polygon.T
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def _ball_from_cone(rays: NDArray, support_depth_m: float, eye_m: NDArray) -> NDArray[np.float64] | None:
    """Ball on the plane from its cone of tangents: unit rays q on it satisfy q . axis = cos(half angle)."""
    scaled_axis = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    norm = float(np.linalg.norm(scaled_axis))
    if norm < 1.0:
        return None
    axis, cosine = scaled_axis / norm, 1.0 / norm
    sine = math.sqrt(1.0 - cosine**2)
    if axis[2] + sine < 0.05:
        return None
    distance = (support_depth_m - eye_m[2]) / (axis[2] + sine)
    centre = eye_m + distance * axis
    return np.array([centre[0], centre[1], distance * sine])
