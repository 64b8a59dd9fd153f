"""The pinhole camera: its pose in the palm, its intrinsics, and the way from points to pixels and back.

Optical frame (REP 103): x to the right of the image, y down, z forward. Pixel centres have whole-number coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.configuration import load_config, require_positive
from mbpam_ros.errors import MbpamError

LENS_MODELS = ("", "plumb_bob", "rational_polynomial")
"""Distortion models of ``sensor_msgs/CameraInfo`` that can be undone; no name is that of an ideal pinhole."""

_NARROWEST = (0.1, 30.0)
"""Focal lengths in widths of the image: angles of view from 157 down to 2 deg."""


LARGEST_SIDE_PX = 16384
FARTHEST_M = 10.0
"""Of a camera that sees what the gripper does."""


class CameraError(MbpamError, ValueError):
    """A camera's description or a use of it makes no sense: no focal length, a point behind the camera."""


@dataclass(frozen=True)
class Intrinsics:
    """Intrinsics of an ideal pinhole.

    Args:
        width_px, height_px: image size.
        fx, fy: focal lengths [px].
        cx, cy: principal point [px].

    Raises:
        CameraError: a size or focal length is not positive, or a value is not finite.
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width_px <= 0 or self.height_px <= 0:
            raise CameraError(f"image size must be positive, found {self.width_px} x {self.height_px} px")
        if not all(map(math.isfinite, (self.fx, self.fy, self.cx, self.cy))) or min(self.fx, self.fy) <= 0.0:
            raise CameraError(
                f"K has no positive focal lengths or is not finite: fx = {self.fx:g}, fy = {self.fy:g}, "
                f"cx = {self.cx:g}, cy = {self.cy:g}; calibrate the camera or fill its CameraInfo"
            )

    @classmethod
    def from_camera_info(cls, width_px: int, height_px: int, k: ArrayLike) -> Intrinsics:
        """Read the row-major matrix K, shape (9,), of a ``sensor_msgs/CameraInfo``.

        Raises:
            CameraError: K has not nine values, is the matrix of no camera with square pixels and a centre in or near
                its image, or see the class.
        """
        values = np.asarray(k, dtype=float).ravel()
        if values.size != 9:
            raise CameraError(f"K must have 9 values, found {values.size}")
        intrinsics = cls(int(width_px), int(height_px), *(float(values[i]) for i in (0, 4, 2, 5)))
        _refuse_impossible(intrinsics, values)
        return intrinsics

    @property
    def matrix(self) -> NDArray[np.float64]:
        """K, shape (3, 3) [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


def _refuse_impossible(k: Intrinsics, values: NDArray[np.float64]) -> None:
    """Raise CameraError, by name of the entry, for a K that no camera has: mixed up, or of another image size."""
    if values[8] != 1.0:
        raise CameraError(f"K[8] must be 1, found {values[8]:g}; K is row-major: fx 0 cx 0 fy cy 0 0 1")
    if abs(values[1]) > 1e-3 * k.fx:
        raise CameraError(f"K[1], the skew, must be 0, found {values[1]:g}; no rectangular pixels have one")
    if max(abs(values[i]) for i in (3, 6, 7)) > 1e-9:
        raise CameraError(f"K[3], K[6] and K[7] must be 0, found {values[3]:g}, {values[6]:g}, {values[7]:g}")
    if not 0.5 < k.fx / k.fy < 2.0:
        raise CameraError(f"focal lengths fx = {k.fx:g} and fy = {k.fy:g} px are out of all proportion")
    if not _NARROWEST[0] < k.fx / k.width_px < _NARROWEST[1]:
        raise CameraError(
            f"focal length fx = {k.fx:g} px does not fit a width of {k.width_px} px; was it calibrated at another size?"
        )
    for name, centre, extent in (("cx", k.cx, k.width_px), ("cy", k.cy, k.height_px)):
        if not -0.5 * extent < centre < 1.5 * extent:
            raise CameraError(
                f"centre {name} = {centre:g} px lies far outside an image of {extent} px; was it calibrated at "
                "another size?"
            )


@dataclass(frozen=True, eq=False)
class CameraData:
    """The fields of a ``sensor_msgs/CameraInfo``, as it defines them.

    Args:
        width_px, height_px: of the full image, that K and P are for.
        model, d: lens.
        k: (9,).
        p: (12,), of the rectified image.
        binning: of the pixels along x and y; 0 is 1.
        roi: x, y, width, height of the part that is sent, in the full image; width or height 0 is all of it.
    """

    width_px: int
    height_px: int
    model: str
    d: ArrayLike
    k: ArrayLike
    p: ArrayLike = ()
    binning: tuple[int, int] = (1, 1)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)

    def pinhole(self, rectified: bool) -> tuple[Intrinsics, NDArray[np.float64]]:
        """Return intrinsics of the image as it is sent, and what distorts it, shape (n,).

        Binning and region are applied as image_geometry does: the region's corner is taken off the centre, then all
        is divided by the binning.

        Args:
            rectified: whether the image is rectified: P is used, and D is not.

        Raises:
            CameraError: what is told describes no camera.
        """
        if rectified:
            p = np.asarray(self.p, dtype=float).ravel()
            if p.size != 12 or not p.any():
                raise CameraError("P must have 12 values for a rectified image; or set rectified to false")
            matrix, d = p.reshape(3, 4)[:, :3].ravel(), np.zeros(0)
        else:
            matrix, d = np.asarray(self.k, dtype=float).ravel(), distortion_of(self.model, self.d)
        full = Intrinsics.from_camera_info(self.width_px, self.height_px, matrix)
        x, y, width, height = self.roi
        if width == 0 or height == 0:
            x, y, width, height = 0, 0, full.width_px, full.height_px
        if x + width > full.width_px or y + height > full.height_px:
            raise CameraError(
                f"roi of {width} x {height} px at ({x}, {y}) leaves the image of {full.width_px} x {full.height_px} px"
            )
        across, down = (max(int(number), 1) for number in self.binning)
        return (
            Intrinsics(
                width // across,
                height // down,
                full.fx / across,
                full.fy / down,
                (full.cx - x) / across,
                (full.cy - y) / down,
            ),
            d,
        )


def distortion_of(model: str, coefficients: ArrayLike) -> NDArray[np.float64]:
    """Return the coefficients D of a ``sensor_msgs/CameraInfo``, shape (n,), whose lens the detector can undo.

    Raises:
        CameraError: ``model`` is none of :data:`LENS_MODELS`.
    """
    if model not in LENS_MODELS:
        raise CameraError(
            f"distortion_model {model!r} is none of {', '.join(LENS_MODELS[1:])}; "
            "publish rectified images with their CameraInfo"
        )
    return np.array(coefficients, dtype=float).ravel()


@dataclass(frozen=True)
class CameraConfig:
    """What ``config/camera.yaml`` says of the palm camera. Vectors are in ``gripper_base``.

    Args:
        width_px, height_px: image size.
        horizontal_fov_rad: full angle of view along the image's x axis.
        position_m: centre of projection.
        look_at_m: point in the middle of the image.
        image_x_axis: direction that the image's x axis follows (made perpendicular to the view).
        noise_levels: standard deviation of the sensor noise [8 bit levels].
        blur_sigma_px: standard deviation of the lens' point spread.
    """

    width_px: int
    height_px: int
    horizontal_fov_rad: float
    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    image_x_axis: tuple[float, float, float]
    noise_levels: float
    blur_sigma_px: float

    def __post_init__(self) -> None:
        require_positive(self, "width_px", "height_px", "horizontal_fov_rad")
        if self.horizontal_fov_rad >= math.pi:
            raise ValueError(f"horizontal_fov_rad must be less than pi, found {self.horizontal_fov_rad:g}")
        if max(self.width_px, self.height_px) > LARGEST_SIDE_PX:
            raise ValueError(f"width_px and height_px must be at most {LARGEST_SIDE_PX} pixels")
        if self.noise_levels < 0.0 or self.blur_sigma_px < 0.0:
            raise ValueError("noise_levels and blur_sigma_px must not be negative")
        if np.abs((self.position_m, self.look_at_m)).max() > FARTHEST_M:
            raise ValueError(f"position_m and look_at_m must lie within {FARTHEST_M:g} m of the gripper")
        view = np.subtract(self.look_at_m, self.position_m)
        if np.linalg.norm(np.cross(view, self.image_x_axis)) < 1e-6:
            raise ValueError("image_x_axis must not be parallel to the view from position_m to look_at_m")


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Pose of the optical frame in ``gripper_base``.

    Args:
        rotation: (3, 3), takes vectors of the optical frame to ``gripper_base``.
        position_m: (3,), centre of projection.

    Raises:
        CameraError: ``rotation`` is not a rotation.
    """

    rotation: NDArray[np.float64]
    position_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        rotation, position = np.array(self.rotation, dtype=float), np.array(self.position_m, dtype=float)
        if rotation.shape != (3, 3) or position.shape != (3,):
            raise CameraError(f"expected rotation (3, 3), position (3,); found {rotation.shape}, {position.shape}")
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0.0:
            raise CameraError("rotation is not a rotation matrix")
        if not np.isfinite(position).all():
            raise CameraError(f"position_m must be finite, found {position}")
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position_m", position)


def camera_pose(config: CameraConfig) -> CameraPose:
    """Pose of the camera that ``config`` describes."""
    forward = np.subtract(config.look_at_m, config.position_m)
    forward /= np.linalg.norm(forward)
    right = np.array(config.image_x_axis) - np.dot(config.image_x_axis, forward) * forward
    right /= np.linalg.norm(right)
    return CameraPose(np.column_stack([right, np.cross(forward, right), forward]), np.array(config.position_m))


def camera_intrinsics(config: CameraConfig) -> Intrinsics:
    """Intrinsics of the camera that ``config`` describes: square pixels, principal point in the middle."""
    focal = 0.5 * config.width_px / math.tan(0.5 * config.horizontal_fov_rad)
    centre = (0.5 * (config.width_px - 1), 0.5 * (config.height_px - 1))
    return Intrinsics(config.width_px, config.height_px, focal, focal, *centre)


def load_camera_config(name: str | Path = "camera.yaml") -> CameraConfig:
    """Read the camera file ``name``.

    Raises:
        ConfigError: wrong keys or values.
    """
    return load_config(CameraConfig, name)


class Camera:
    """An ideal pinhole at a pose in ``gripper_base``.

    Args:
        intrinsics: image size and projection.
        pose: pose of the optical frame in ``gripper_base``.
    """

    def __init__(self, intrinsics: Intrinsics, pose: CameraPose) -> None:
        self.intrinsics = intrinsics
        self.rotation = pose.rotation
        self.position_m = pose.position_m

    @classmethod
    def from_config(cls, config: CameraConfig) -> Camera:
        """The camera that ``config`` describes."""
        return cls(camera_intrinsics(config), camera_pose(config))

    def project(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Pixels (u, v), shape (..., 2), of points of ``gripper_base``, shape (..., 3).

        Raises:
            CameraError: a point is not in front of the camera.
        """
        optical = (np.asarray(points_m, dtype=float) - self.position_m) @ self.rotation
        depth = optical[..., 2:]
        if not (depth > 0.0).all():
            raise CameraError("cannot project a point that is not in front of the camera")
        k = self.intrinsics
        return optical[..., :2] / depth * (k.fx, k.fy) + (k.cx, k.cy)

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Unit directions in ``gripper_base``, shape (..., 3), of pixels (u, v), shape (..., 2)."""
        k = self.intrinsics
        image = (np.asarray(pixels, dtype=float) - (k.cx, k.cy)) / (k.fx, k.fy)
        direction = np.concatenate([image, np.ones_like(image[..., :1])], axis=-1) @ self.rotation.T
        return direction / np.linalg.norm(direction, axis=-1, keepdims=True)
