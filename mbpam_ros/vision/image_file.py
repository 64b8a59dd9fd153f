"""Images and camera calibrations from files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import ConfigError, load_yaml
from mbpam_ros.vision.camera import CameraError, Intrinsics, distortion_of
from mbpam_ros.vision.depth import depth_in_metres
from mbpam_ros.vision.detector import ImageError


def read_image(path: Path) -> NDArray[np.uint8]:
    """Return an image of any format that OpenCV reads, as bgr8, (H, W, 3).

    Raises:
        ImageError: there is no such file, or it is no image.
    """
    try:
        content = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {error.strerror}") from error
    image = cv2.imdecode(content, cv2.IMREAD_COLOR) if content.size else None
    if image is None:
        raise ImageError(f"{path}: no image that OpenCV can read")
    return image.astype(np.uint8, copy=False)


def read_depth(path: Path) -> NDArray[np.float32]:
    """Return a depth image as metres, (H, W), NaN where there is no answer.

    Files of 16 bits hold millimetres (png, tiff), those of 32 bit floating point metres (tiff, exr), arrays of NumPy
    (.npy) either, by their type.

    Raises:
        ImageError: there is no such file, or it is no depth image.
    """
    try:
        if path.suffix == ".npy":
            values = np.load(path, allow_pickle=False)
        else:
            read = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
            values = np.empty((0, 0)) if read is None else np.asarray(read)
    except (OSError, ValueError, cv2.error) as error:
        raise ImageError(f"{path}: cannot be read as a depth image: {error}") from error
    if values.dtype == np.float64:
        values = values.astype(np.float32)
    encoding = {np.dtype(np.uint16): "16UC1", np.dtype(np.float32): "32FC1"}.get(values.dtype)
    if encoding is None or values.ndim != 2:
        raise ImageError(f"{path}: no depth image: found {values.dtype} {values.shape}, wanted (H, W) of 16 or 32 bit")
    return depth_in_metres(values, encoding)


def write_image(path: Path, image: NDArray[np.uint8]) -> None:
    """Write a bgr8 image, (H, W, 3); the suffix is the format.

    Raises:
        ImageError: the file cannot be written, or there is no such format.
    """
    if not cv2.haveImageWriter(str(path)):
        raise ImageError(f"{path}: cannot be written: no image format has this suffix")
    _, content = cv2.imencode(path.suffix, image)
    try:
        path.write_bytes(content.tobytes())
    except OSError as error:
        raise ImageError(f"{path}: cannot be written: {error.strerror}") from error


def read_camera_info(path: Path) -> tuple[Intrinsics, NDArray[np.float64]]:
    """Return intrinsics and distortion coefficients, shape (n,), of a file as ROS's camera_calibration writes it.

    Raises:
        ConfigError: the file is missing, is not YAML, or lacks a key.
        CameraError: what it holds describes no camera, or a lens that cannot be undone; the message has the file.
    """
    content = load_yaml(path)
    width_px, height_px = (_value(content, path, key) for key in ("image_width", "image_height"))
    k, d = (_value(content, path, key, "data") for key in ("camera_matrix", "distortion_coefficients"))
    try:
        intrinsics = Intrinsics.from_camera_info(width_px, height_px, k)
        return intrinsics, distortion_of(content.get("distortion_model") or "", d)
    except (CameraError, TypeError, ValueError) as error:
        raise CameraError(f"{path}: {error}") from error


def _value(content: dict[str, Any], path: Path, *keys: str) -> Any:
    value: Any = content
    for key in keys:
        if not isinstance(value, dict) or key not in value:
            raise ConfigError(f"{path}: missing key {': '.join(keys)}; ROS's camera_calibration writes such files")
        value = value[key]
    return value
