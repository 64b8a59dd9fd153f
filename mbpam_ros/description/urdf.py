"""The gripper as a URDF: fingers as chains of short links that ``joint_states`` moves.

A muscle of constant curvature, as long as its rod (:mod:`~mbpam_ros.actuator.kinematics`), is cut into N = 15 equal
pieces, one more than it has waves; in the middle of each sits a joint that turns about y by bend_x / N and about x by
-bend_y / N. Joints of one axis mimic the joint that ``joint_states`` names (``finger_1_bend_x``), which itself moves a
link without a body. The two turns come in the opposite order at every other joint, so that the twist of one undoes that
of the next. The chain's tip lies off the arc's by the length times (bend / N)^2 / 8 at most, 0.4 mm at 150 deg. It
neither sags nor stretches; the tips in TF, estimated by the whole rod, do.

Links between joints are drawn as waves, from valley to valley; the two ends as far as the next joint, which is 14 of
their 15 mm. It is a description of shape alone: no masses, and of stiffness and force nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import FINGER_NAMES
from mbpam_ros.description.frames import Frames
from mbpam_ros.description.wave_mesh import Wave, wave_count
from mbpam_ros.gripper import Gripper

LARGEST_BEND_RAD = math.pi
"""Limit of the bends; the measured muscle reaches 151 deg."""

LARGEST_RATE_RAD_S = 30.0

PALM_THICKNESS_M = 0.010

_EFFORT_N_M = 1.0  # URDF wants a limit; nobody pushes these joints
_SILICONE_RGBA = (0.80, 0.82, 0.84, 1.0)
_PALM_RGBA = (0.30, 0.30, 0.30, 1.0)
_STRAIGHT = (0.0, 0.0, 0.0)
_TURNS = (("x", (0.0, 1.0, 0.0), 1.0), ("y", (1.0, 0.0, 0.0), -1.0))
"""Of a bend's two components: its name, the axis it turns about, and in which sense."""


def gripper_urdf(
    gripper: Gripper,
    camera_rotation: ArrayLike,
    camera_position_m: ArrayLike,
    frames: Frames | None = None,
    wave_mesh: str | None = None,
) -> str:
    """Return the URDF of a gripper. Its root is ``gripper_base``; links carry the prefix of the frames, joints do not.

    Args:
        gripper: muscles and where they stand.
        camera_rotation: (3, 3), takes vectors of the optical frame to ``gripper_base``.
        camera_position_m: (3,) in ``gripper_base``.
        frames: their names; without a prefix by default.
        wave_mesh: address of a file of :mod:`~mbpam_ros.description.wave_mesh`, as long as :func:`wave_length_m` says;
            without one a wave is drawn as two cylinders.

    Raises:
        WaveError: the muscles' lengths leave no chambers.
    """
    frames = frames or Frames()
    wave = Wave.of_gripper(gripper, wave_length_m(gripper))
    robot = Element("robot", name="mbpam_gripper")
    for name, rgba in (("silicone", _SILICONE_RGBA), ("palm", _PALM_RGBA)):
        SubElement(SubElement(robot, "material", name=name), "color", rgba=_numbers(rgba))
    width_m = 2.0 * (np.abs(gripper.finger_base_m[:, :2]).max() + gripper.geometry.outer_radius_m)
    palm = _link(robot, frames.base)
    for part in ("visual", "collision"):
        SubElement(
            _geometry(palm, part, "palm", (0.0, 0.0, -0.5 * PALM_THICKNESS_M)),
            "box",
            size=_numbers((width_m, width_m, PALM_THICKNESS_M)),
        )
    camera = np.asarray(camera_rotation, dtype=float)
    _fixed(robot, "camera", frames.base, frames.camera_optical, camera_position_m, _roll_pitch_yaw(camera))
    for i, finger in enumerate(FINGER_NAMES):
        mount = _fixed(robot, f"{finger}_mount", frames.base, frames.mounts[i], gripper.finger_base_m[i])
        _draw_end(mount, wave.crest_radius_m, gripper.rod_geometry.end_length_m + 0.5 * wave.length_m)
        _add_finger(robot, frames.prefix, finger, gripper, wave, wave_mesh)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def wave_length_m(gripper: Gripper) -> float:
    """Return the distance of two joints of a chain, and length of the wave drawn between them [m]."""
    return gripper.rod_geometry.active_length_m / joint_count(gripper)


def joint_count(gripper: Gripper) -> int:
    """Return the joints of a finger in each plane: one more than it has waves."""
    return wave_count(gripper) + 1


def _add_finger(robot: Element, prefix: str, finger: str, gripper: Gripper, wave: Wave, wave_mesh: str | None) -> None:
    mount = f"{prefix}{finger}_mount"
    for component, axis, _ in _TURNS:
        name = f"{finger}_bend_{component}"
        _link(robot, f"{prefix}{name}")
        _turning(robot, name, mount, f"{prefix}{name}", axis, 0.0)
    end_m, joints = gripper.rod_geometry.end_length_m + 0.5 * wave.length_m, joint_count(gripper)
    parent, height_m = mount, end_m
    for number in range(1, joints + 1):
        link = f"{prefix}{finger}_" + ("end" if number == joints else f"link_{number}")
        turns = _TURNS if number % 2 else _TURNS[::-1]
        for (component, axis, sense), child in zip(turns, (f"{prefix}{finger}_half_{number}", link), strict=True):
            body = _link(robot, child)
            joint = _turning(robot, f"{finger}_joint_{number}_{component}", parent, child, axis, height_m)
            share = f"{sense / joints:.9g}"
            SubElement(joint, "mimic", joint=f"{finger}_bend_{component}", multiplier=share, offset="0")
            parent, height_m = child, 0.0
        if number == joints:
            _draw_end(body, wave.crest_radius_m, end_m)
        else:
            _draw_wave(body, wave, wave_mesh)
        height_m = wave.length_m


def _draw_end(link: Element, radius_m: float, length_m: float) -> None:
    for part in ("visual", "collision"):
        _cylinder(link, part, radius_m, length_m, length_m)


def _draw_wave(link: Element, wave: Wave, mesh: str | None) -> None:
    if mesh is not None:
        SubElement(_geometry(link, "visual", "silicone", (0.0, 0.0, 0.5 * wave.length_m)), "mesh", filename=mesh)
    else:
        _cylinder(link, "visual", wave.valley_radius_m, wave.length_m, wave.length_m)
        _cylinder(link, "visual", wave.crest_radius_m, 0.5 * wave.length_m, wave.length_m)
    _cylinder(link, "collision", wave.crest_radius_m, wave.length_m, wave.length_m)


def _cylinder(link: Element, part: str, radius_m: float, length_m: float, link_length_m: float) -> None:
    geometry = _geometry(link, part, "silicone", (0.0, 0.0, 0.5 * link_length_m))
    SubElement(geometry, "cylinder", radius=f"{radius_m:.9g}", length=f"{length_m:.9g}")


def _geometry(link: Element, part: str, material: str, position_m: Sequence[float]) -> Element:
    seen = SubElement(link, part)
    SubElement(seen, "origin", xyz=_numbers(position_m), rpy=_numbers(_STRAIGHT))
    geometry = SubElement(seen, "geometry")
    if part == "visual":
        SubElement(seen, "material", name=material)
    return geometry


def _link(robot: Element, name: str) -> Element:
    return SubElement(robot, "link", name=name)


def _turning(robot: Element, name: str, parent: str, child: str, axis: Sequence[float], height_m: float) -> Element:
    joint = _joint(robot, name, "revolute", parent, child, (0.0, 0.0, height_m), _STRAIGHT)
    SubElement(joint, "axis", xyz=_numbers(axis))
    SubElement(
        joint,
        "limit",
        lower=f"{-LARGEST_BEND_RAD:.9g}",
        upper=f"{LARGEST_BEND_RAD:.9g}",
        velocity=f"{LARGEST_RATE_RAD_S:g}",
        effort=f"{_EFFORT_N_M:g}",
    )
    return joint


def _fixed(
    robot: Element, name: str, parent: str, child: str, position_m: ArrayLike, rpy: Sequence[float] = _STRAIGHT
) -> Element:
    link = _link(robot, child)
    _joint(robot, name, "fixed", parent, child, np.asarray(position_m), rpy)
    return link


def _joint(
    robot: Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    position_m: Sequence[float] | NDArray[np.float64],
    rpy: Sequence[float],
) -> Element:
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=_numbers(position_m), rpy=_numbers(rpy))
    return joint


def _roll_pitch_yaw(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the angles of URDF of a rotation (3, 3): about fixed x, then y, then z."""
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    if math.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # x points up or down: roll and yaw turn about one axis
        return math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        pitch,
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )


def _numbers(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)
