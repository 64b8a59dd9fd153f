"""The objects in an image file: shape, size and place in the gripper's frame.

    mbpam detect --image photo.png --camera-info camera.yaml --json found.json --overlay found.png

--camera-info is the file that ROS's camera_calibration writes. Where the camera is comes from camera.yaml, of the
configuration or by --camera, or from --camera-pose. What objects stand on is a plane that is told: its depth below the
palm. Angles are in radians, lengths in metres.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import table
from mbpam_ros.vision.camera import CameraPose, camera_pose, load_camera_config
from mbpam_ros.vision.detector import Detection, ObjectDetector, load_detector_config
from mbpam_ros.vision.image_file import read_camera_info, read_image, write_image
from mbpam_ros.vision.overlay import describe_size, draw_overlay

_SUPPORT_DEPTH_M = 0.115
"""That of the node object_detector."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--image", type=Path, metavar="FILE", required=True, help="image in colour: png, jpg, ...")
    parser.add_argument("--camera-info", type=Path, metavar="YAML", required=True, help="calibration of the camera")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the detections go")
    parser.add_argument("--overlay", type=Path, metavar="FILE", help="where the image with the detections drawn goes")
    parser.add_argument(
        "--support-depth",
        type=float,
        default=_SUPPORT_DEPTH_M,
        metavar="M",
        help=f"of the plane the objects stand on, below the palm (default: {_SUPPORT_DEPTH_M:g})",
    )
    pose = parser.add_mutually_exclusive_group()
    pose.add_argument("--camera", default="camera.yaml", metavar="YAML", help="its pose (default: camera.yaml)")
    pose.add_argument(
        "--camera-pose",
        type=_pose,
        metavar="X,Y,Z,QX,QY,QZ,QW",
        help="of the optical frame in gripper_base: place and quaternion; write --camera-pose=-0.1,...",
    )
    parser.add_argument("--gripper", default="gripper.yaml", metavar="YAML", help="whose open fingers hide parts")
    parser.add_argument("--no-fingers", action="store_true", help="no finger is in view")
    parser.add_argument("--detector", default="detector.yaml", metavar="YAML", help="thresholds")


def run(options: argparse.Namespace) -> int:
    """Print what is found, and write it."""
    intrinsics, distortion = read_camera_info(options.camera_info)
    image = read_image(options.image)
    detector = ObjectDetector(
        load_detector_config(options.detector),
        options.camera_pose or camera_pose(load_camera_config(options.camera)),
        None if options.no_fingers else load_gripper(options.gripper),
    )
    found = detector.detect(image, "bgr8", intrinsics, distortion, options.support_depth)
    print(_text(found))
    if options.json is not None:
        write_json(options.json, {"frame": "gripper_base", "detections": [_values(each) for each in found]})
    if options.overlay is not None:
        write_image(options.overlay, draw_overlay(image, "bgr8", found))
    return 0


def _text(found: Sequence[Detection]) -> str:
    if not found:
        return "nothing found"
    rows = [
        (
            each.label,
            describe_size(each),
            " ".join(f"{1e3 * value:.0f}" for value in each.position_m),
            f"{np.degrees(each.yaw_rad):.0f}",
            f"{each.confidence:.0%}",
        )
        for each in found
    ]
    return table(("object", "size", "centre [mm]", "yaw [deg]", "confidence"), rows)


def _values(found: Detection) -> dict[str, object]:
    return {
        "shape": found.shape,
        "label": found.label,
        "size_m": found.size_m.tolist(),
        "position_m": found.position_m.tolist(),
        "orientation_xyzw": found.orientation_xyzw.tolist(),
        "yaw_rad": found.yaw_rad,
        "confidence": float(found.confidence),
        "contour_px": found.contour_px.tolist(),
    }


def _pose(text: str) -> CameraPose:
    try:
        numbers = [float(part) for part in text.split(",")]
        if len(numbers) != 7:
            raise ValueError(f"found {len(numbers)} numbers")
        return CameraPose(Rotation.from_quat(numbers[3:]).as_matrix(), np.array(numbers[:3]))
    except ValueError as error:  # also a CameraError, and SciPy's for a quaternion of length 0
        raise argparse.ArgumentTypeError(f"wants X,Y,Z,QX,QY,QZ,QW, found {text!r}: {error}") from error
