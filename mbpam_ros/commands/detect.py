"""The objects in an image file: shape, size and place in the gripper's frame.

    mbpam detect --image photo.png --camera-info camera.yaml --json found.json --overlay found.png

--camera-info is the file that ROS's camera_calibration writes. Where the camera is comes from camera.yaml, of the
configuration or by --camera, or from --camera-pose. What objects stand on is a plane that is told, its depth below the
palm, or that is found in a depth image (--depth: 16 bit [mm] or 32 bit floating point [m], png, tiff or npy, of the
same camera or with --depth-camera-info). Images of the empty table (--background, one or more) help where there is no
depth. Angles are in radians, lengths in metres.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import table
from mbpam_ros.vision.camera import CameraPose, camera_pose, load_camera_config
from mbpam_ros.vision.depth import DepthImage
from mbpam_ros.vision.detector import Detection, ObjectDetector, Sighting, load_detector_config
from mbpam_ros.vision.image_file import read_camera_info, read_depth, read_image, write_image
from mbpam_ros.vision.overlay import describe_size, draw_overlay

_SUPPORT_DEPTH_M = 0.115
"""That of the node object_detector."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--image", type=Path, metavar="FILE", required=True, help="image in colour: png, jpg, ...")
    parser.add_argument("--camera-info", type=Path, metavar="YAML", required=True, help="calibration of the camera")
    parser.add_argument("--depth", type=Path, metavar="FILE", help="depth image of the same moment")
    parser.add_argument("--depth-camera-info", type=Path, metavar="YAML", help="its calibration (default: the image's)")
    parser.add_argument("--background", type=Path, nargs="+", metavar="FILE", help="images of the empty table")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the detections go")
    parser.add_argument(
        "--overlay", type=result_file, metavar="FILE", help="where the image with the detections drawn goes"
    )
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
    if options.background:
        detector.learn_background([read_image(path) for path in options.background], "bgr8", intrinsics, distortion)
    depth = None
    if options.depth is not None:
        of_depth = None if options.depth_camera_info is None else read_camera_info(options.depth_camera_info)[0]
        depth = DepthImage(read_depth(options.depth), of_depth)
    view = image, "bgr8", intrinsics, distortion, options.support_depth
    seen = detector.look(*view, depth=depth, patience=math.inf)  # a file waits for it
    found = seen.detections
    print(_text(found))
    for line in _remarks(seen):
        print(line)
    if options.json is not None:
        write_json(options.json, _content(seen))
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


def _remarks(seen: Sighting) -> list[str]:
    lines = [f"{each.label}: {each.bound}" for each in seen.detections if each.bound]
    if seen.tilt_deg is not None:
        lines.append(
            f"table {1e3 * seen.support_depth_m:.0f} mm below the palm; the camera is tilted {seen.tilt_deg:.1f} deg "
            "against its pose, corrected for"
        )
    return [*lines, seen.remark] if seen.remark else lines


def _content(seen: Sighting) -> dict[str, object]:
    return {
        "frame": "gripper_base",
        "source": seen.source,
        "support_depth_m": seen.support_depth_m,
        "camera_tilt_deg": seen.tilt_deg,
        "cpu_s": seen.cpu_s,
        "remark": seen.remark,
        "detections": [_values(each) for each in seen.detections],
    }


def _values(found: Detection) -> dict[str, object]:
    return {
        "shape": found.shape,
        "label": found.label,
        "size_m": found.size_m.tolist(),
        "position_m": found.position_m.tolist(),
        "orientation_xyzw": found.orientation_xyzw.tolist(),
        "yaw_rad": found.yaw_rad,
        "confidence": float(found.confidence),
        "source": found.source,
        "bound": found.bound,
        "hidden_m": list(found.hidden_m),
        "size_range_m": None if found.size_range_m is None else found.size_range_m.tolist(),
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
