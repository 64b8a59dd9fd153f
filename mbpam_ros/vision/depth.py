"""What a depth image shows: the table's plane, how the camera is tilted, and what stands above the plane.

The plane is found by random samples (RANSAC: Fischler and Bolles, Comm. ACM 24, 1981) with a fixed seed, among those
that face the palm, and refined by least squares over its inliers. NumPy and OpenCV do all of it in milliseconds; a
library of point clouds (Open3D, 400 MB with what it needs) would add only what is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.errors import MbpamError
from mbpam_ros.vision.camera import Camera, CameraPose, Intrinsics

_SAMPLES = 1500
_TRIALS = 120
_INLIER_M = 0.006
_STEEPEST_DEG = 25.0
_LEAST_SHARE = 0.15
_FLOOR_M = 0.05
_PALM_M = 0.02
"""No table is nearer below the palm."""


class DepthError(MbpamError, ValueError):
    """A depth image that cannot be used: its type, its size, or no plane in it."""


@dataclass(frozen=True, eq=False)
class DepthImage:
    """An image of distances along the optical axis.

    Args:
        metres: (H, W) float32; NaN, 0 or negative where the sensor has no answer.
        intrinsics: of its camera; None for those of the colour image, with which it is then aligned.
        pose: of its camera in ``gripper_base``; None for that of the colour camera.
    """

    metres: NDArray[np.float32]
    intrinsics: Intrinsics | None = None
    pose: CameraPose | None = None


def depth_in_metres(values: NDArray, encoding: str) -> NDArray[np.float32]:
    """Return a 32FC1 [m] or 16UC1 [mm] image as metres, (H, W), NaN where there is no answer.

    Raises:
        DepthError: another encoding, or pixels that are not of it.
    """
    kinds = {"32FC1": np.float32, "16UC1": np.uint16}
    if encoding not in kinds:
        raise DepthError(f"depth encoding {encoding!r} is none of {', '.join(kinds)}")
    if values.ndim != 2 or values.dtype != kinds[encoding]:
        raise DepthError(f"a depth image of {encoding} must be (H, W) {kinds[encoding].__name__}, found {values.dtype}")
    metres = values.astype(np.float32) * np.float32(1.0 if encoding == "32FC1" else 1e-3)
    with np.errstate(invalid="ignore"):
        metres[~((metres > 0.0) & np.isfinite(metres))] = np.nan
    return metres


def aligned(depth: DepthImage, camera: Camera) -> NDArray[np.float32]:
    """Return the depth image as the colour camera would have it, (H, W) of that camera; NaN where nothing is known.

    Raises:
        DepthError: its size does not fit its intrinsics.
    """
    k, colour = depth.intrinsics or camera.intrinsics, camera.intrinsics
    if depth.metres.shape != (k.height_px, k.width_px):
        raise DepthError(f"depth image of shape {depth.metres.shape} does not fit {k.width_px} x {k.height_px} px")
    pose = depth.pose
    same_place = pose is None or (
        np.allclose(pose.rotation, camera.rotation, atol=1e-6)
        and np.allclose(pose.position_m, camera.position_m, atol=1e-6)
    )
    if k == colour and same_place:
        return depth.metres
    rotation, position = (camera.rotation, camera.position_m) if pose is None else (pose.rotation, pose.position_m)
    points = _points(depth.metres, k).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])]
    optical = (points @ rotation.T + (position - camera.position_m)) @ camera.rotation
    optical = optical[optical[:, 2] > 1e-3]
    u = np.round(optical[:, 0] / optical[:, 2] * colour.fx + colour.cx).astype(int)
    v = np.round(optical[:, 1] / optical[:, 2] * colour.fy + colour.cy).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < colour.width_px) & (v < colour.height_px)
    u, v, z = u[inside], v[inside], optical[inside, 2].astype(np.float32)
    order = np.argsort(-z, kind="stable")  # the nearest is written last
    result = np.full((colour.height_px, colour.width_px), np.inf, np.float32)
    result[v[order], u[order]] = z[order]
    # Between the splats of a coarser image: the nearest neighbour's value.
    spread = max(int(math.ceil(colour.fx / k.fx)), 1)
    if spread > 1 or not same_place:
        size = 2 * (spread // 2) + 3
        filled = cv2.erode(result, np.ones((size, size), np.uint8))
        result = np.where(np.isfinite(result), result, filled).astype(np.float32)
    result[~np.isfinite(result)] = np.nan
    return result


def _points(metres: NDArray[np.float32], k: Intrinsics) -> NDArray[np.float32]:
    """Points (H, W, 3) of the optical frame."""
    u = ((np.arange(k.width_px) - k.cx) / k.fx).astype(np.float32)
    v = ((np.arange(k.height_px) - k.cy) / k.fy).astype(np.float32)
    return np.stack([metres * u, metres * v[:, None], metres], axis=-1)


@dataclass(frozen=True, eq=False)
class Table:
    """The plane that objects stand on, as the depth image has it.

    Args:
        camera: the colour camera, turned so that the plane is horizontal.
        support_depth_m: z of the plane below the palm.
        tilt_deg: by how much the camera is tilted against what its pose says.
        noise_m: standard deviation of the plane's inliers.
        height_m: (h, w), of what is seen above the plane, at every ``stride`` th pixel; NaN where nothing is known.
        points_m: (h, w, 3) in ``gripper_base``.
    """

    camera: Camera
    support_depth_m: float
    tilt_deg: float
    noise_m: float
    height_m: NDArray[np.float32]
    points_m: NDArray[np.float32]


def find_table(
    metres: NDArray[np.float32], camera: Camera, stride: int, hidden: NDArray[np.uint8], told_depth_m: float
) -> Table:
    """Find the support in an aligned depth image.

    Args:
        metres: (H, W).
        camera: with the pose that it is said to have.
        stride: of the pixels that are looked at.
        hidden: (h, w), not 0 where fingers may be.
        told_depth_m: where the support is said to be. If the plane that is found lies much deeper, it is the floor
            under a stand: the tilt is taken from it, and the support is where it is said to be.

    Raises:
        DepthError: too few pixels with an answer, or no plane below the palm.
    """
    k = camera.intrinsics
    sampled = metres[::stride, ::stride]
    with np.errstate(invalid="ignore"):
        valid = (sampled > 0.0) & np.isfinite(sampled)
    u = ((stride * np.arange(sampled.shape[1]) - k.cx) / k.fx).astype(np.float32)
    v = ((stride * np.arange(sampled.shape[0]) - k.cy) / k.fy).astype(np.float32)
    optical = np.stack([sampled * u, sampled * v[:, None], sampled], axis=-1)
    usable = np.flatnonzero(valid & (hidden == 0))
    if len(usable) < 200:
        raise DepthError(f"the depth image has an answer in {len(usable)} of {sampled.size} places only")
    rng = np.random.default_rng(0)
    picked = usable[rng.integers(0, len(usable), min(_SAMPLES, len(usable)))]
    cloud = optical.reshape(-1, 3)[picked].astype(float)
    cloud = cloud @ camera.rotation.T + camera.position_m  # in gripper_base
    normal, offset = _ransac(cloud, rng)
    residual = cloud @ normal - offset
    inliers = np.abs(residual) < _INLIER_M
    for _ in range(3):  # least squares, then again without what stands on the plane
        centre = cloud[inliers].mean(axis=0)
        _, _, axes = np.linalg.svd(cloud[inliers] - centre, full_matrices=False)
        normal = axes[2] * np.sign(axes[2][2])
        offset = float(normal @ centre)
        residual = cloud @ normal - offset
        spread = 1.4826 * float(np.median(np.abs(residual[inliers])))
        inliers = np.abs(residual) < max(2.5 * spread, 0.002)
    noise = max(1.4826 * float(np.median(np.abs(residual[inliers]))), 2e-4)
    turn = _shortest_turn(normal)
    turned = Camera(k, CameraPose(turn @ camera.rotation, camera.position_m))
    # The camera stays where it is; below it the plane is as far as was measured.
    support = float(camera.position_m[2] + offset - normal @ camera.position_m)
    if support > told_depth_m + _FLOOR_M:
        support = told_depth_m
    points = (optical @ turned.rotation.T.astype(np.float32) + turned.position_m.astype(np.float32)).astype(np.float32)
    heights = np.float32(support) - points[..., 2]
    heights[~valid] = np.nan
    tilt = math.degrees(math.acos(min(abs(float(normal[2])), 1.0)))
    return Table(turned, support, tilt, noise, heights, points)


def _ransac(cloud: NDArray[np.float64], rng: np.random.Generator) -> tuple[NDArray[np.float64], float]:
    """The plane normal . x = offset with most inliers, its normal down, among those that a table may be."""
    corners = cloud[rng.integers(0, len(cloud), (_TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    corners = corners[lengths > 1e-9]
    normals *= np.sign(normals[:, 2:] + 1e-12)
    offsets = np.einsum("ij,ij->i", normals, corners[:, 0])
    flat = (normals[:, 2] > math.cos(math.radians(_STEEPEST_DEG))) & (offsets > _PALM_M)
    if not flat.any():
        raise DepthError(f"no plane within {_STEEPEST_DEG:g} deg of the palm's in the depth image")
    normals, offsets = normals[flat], offsets[flat]
    counts = (np.abs(cloud @ normals.T - offsets) < _INLIER_M).sum(axis=0)
    best = int(counts.argmax())
    if counts[best] < _LEAST_SHARE * len(cloud):
        raise DepthError(f"no plane in the depth image: the best has {counts[best]} of {len(cloud)} points")
    return normals[best], float(offsets[best])


def _shortest_turn(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smallest rotation, (3, 3), that takes a unit vector to z."""
    x, y, z = normal
    axis = np.array([y, -x, 0.0])
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn: NDArray[np.float64] = np.eye(3) + skew + skew @ skew / (1.0 + z)
    return turn
