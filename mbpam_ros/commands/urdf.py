"""The gripper as a URDF, for RViz, MoveIt and whatever else reads one.

    mbpam urdf --out gripper.urdf                   muscles drawn as cylinders, so one file is all
    mbpam urdf --out gripper.urdf --meshes meshes   as the drawing's solid in pieces: meshes/wave.stl, meshes/end.stl
    mbpam urdf --prefix right/                      links of a second gripper, to standard output

Fingers are chains of short links; what moves them are the joints that joint_states names. The node state_estimator
publishes the same, without meshes, on robot_description.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file, result_folder
from mbpam_ros.description.frames import Frames
from mbpam_ros.description.urdf import gripper_urdf, muscle_meshes
from mbpam_ros.geometry.stl import binary_stl
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.study.result_file import write_bytes, write_text
from mbpam_ros.vision.camera import camera_pose, load_camera_config


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--out", type=result_file, metavar="FILE", help="where the URDF goes (default: printed)")
    parser.add_argument("--meshes", type=result_folder, metavar="DIR", help="draw muscles as meshes, kept there")
    parser.add_argument("--prefix", default="", help="before every link, as the parameter frame_prefix (default: none)")
    parser.add_argument("--gripper", default="gripper.yaml", metavar="YAML", help="default: gripper.yaml")
    parser.add_argument("--camera", default="camera.yaml", metavar="YAML", help="default: camera.yaml")


def run(options: argparse.Namespace) -> int:
    """Write the URDF, and the meshes if asked for."""
    gripper, camera = load_gripper(options.gripper), camera_pose(load_camera_config(options.camera))
    meshes = None if options.meshes is None else _write_meshes(options.meshes, gripper).absolute().as_uri()
    text = gripper_urdf(gripper, camera.rotation, camera.position_m, Frames(options.prefix), meshes)
    if options.out is None:
        print(text, end="")
    else:
        write_text(options.out, text)
    return 0


def _write_meshes(folder: Path, gripper: Gripper) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, triangles in muscle_meshes(gripper).items():
        write_bytes(folder / name, binary_stl(triangles))
    return folder
