"""The gripper as a URDF: fingers as chains of short links that ``joint_states`` moves.

A muscle of constant curvature, as long as its rod (:mod:`~mbpam_ros.actuator.kinematics`), is cut into as many equal
pieces as it has waves, N = 14; in the middle of each, a valley, sits a joint that turns about y by bend_x / N and about
x by -bend_y / N. Joints of one axis mimic the joint that ``joint_states`` names (``finger_1_bend_x``), which itself
moves a link without a body. The two turns come in the opposite order at every other joint, so that the twist of one
undoes that of the next. The chain's tip lies off the arc's by the length times (bend / N)^2 / 8 at most, 0.5 mm at 150
deg. It neither sags nor stretches; the tips in TF, estimated by the whole rod, do.

Links between joints are drawn as waves, from valley to valley, the two ends as far as the next joint: the muscle of the
drawing in pieces (:mod:`~mbpam_ros.description.wave_mesh`), along the axis as long as the rod's. A rod that bends on
into its ends has longer waves and shorter ends than the drawing. It is a description of shape alone: no masses, and of
stiffness and force nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import FINGER_NAMES
from mbpam_ros.description.frames import Frames
from mbpam_ros.description.wave_mesh import Wave, end_triangles, wave_count, wave_triangles
from mbpam_ros.gripper import Gripper

LARGEST_BEND_RAD = math.pi
"""Limit of the bends; the measured muscle reaches 151 deg."""

LARGEST_RATE_RAD_S = 30.0

PALM_THICKNESS_M = 0.010

WAVE_FILE, END_FILE = "wave.stl", "end.stl"
"""Names of the meshes of a muscle's pieces."""

_EFFORT_N_M = 1.0  # URDF wants a limit; nobody pushes these joints
_SILICONE_RGBA = (0.80, 0.82, 0.84, 1.0)
_PALM_RGBA = (0.30, 0.30, 0.30, 1.0)
_AT_ORIGIN = _STRAIGHT = (0.0, 0.0, 0.0)
_UPSIDE_DOWN = (math.pi, 0.0, 0.0)
_TURNS = (("x", (0.0, 1.0, 0.0), 1.0), ("y", (1.0, 0.0, 0.0), -1.0))
"""Of a bend's two components: its name, the axis it turns about, and in which sense."""


def gripper_urdf(
    gripper: Gripper,
    camera_rotation: ArrayLike,
    camera_position_m: ArrayLike,
    frames: Frames | None = None,
    meshes: str | None = None,
) -> str:
    """Return the URDF of a gripper. Its root is ``gripper_base``; links carry the prefix of the frames, joints do not.

    Args:
        gripper: muscles and where they stand.
        camera_rotation: (3, 3), takes vectors of the optical frame to ``gripper_base``.
        camera_position_m: (3,) in ``gripper_base``.
        frames: their names; without a prefix by default.
        meshes: address of a folder with the files of :func:`muscle_meshes`; without one pieces are drawn as cylinders.

    Raises:
        WaveError: the muscles' lengths leave no chambers.
    """
    frames = frames or Frames()
    muscle = _Drawn(_wave_of(gripper), gripper.rod_geometry.end_length_m, meshes)
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
        muscle.draw_end(mount, tip=False)
        _add_finger(robot, frames.prefix, finger, muscle, joint_count(gripper))
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def muscle_meshes(gripper: Gripper) -> dict[str, NDArray[np.float64]]:
    """Return the pieces that a muscle is drawn of as triangles, shape (n, 3, 3) [m], by the names of their files.

    Raises:
        WaveError: the muscles' lengths leave no chambers.
    """
    wave = _wave_of(gripper)
    return {WAVE_FILE: wave_triangles(wave), END_FILE: end_triangles(wave, gripper.rod_geometry.end_length_m)}


def joint_count(gripper: Gripper) -> int:
    """Return the joints of a finger in each plane: one in the middle of every wave of its rod."""
    return wave_count(gripper)


def _wave_of(gripper: Gripper) -> Wave:
    return Wave.of_gripper(gripper, gripper.rod_geometry.active_length_m / joint_count(gripper))


@dataclass(frozen=True)
class _Drawn:
    """How the pieces of a muscle are drawn.

    Args:
        wave: one wave.
        solid_m: length of an end without waves [m].
        meshes: address of their folder; None: cylinders.
    """

    wave: Wave
    solid_m: float
    meshes: str | None

    @property
    def end_m(self) -> float:
        """From the face of an end to the first joint [m]."""
        return self.solid_m + 0.5 * self.wave.length_m

    def draw_end(self, link: Element, tip: bool) -> None:
        """Draw an end onto a link; that of the tip lies upside down."""
        crest_m = self.solid_m + 0.25 * self.wave.length_m
        if self.meshes is not None:
            place, turn = ((0.0, 0.0, self.end_m), _UPSIDE_DOWN) if tip else (_AT_ORIGIN, _STRAIGHT)
            self._mesh(link, END_FILE, place, turn)
        else:
            _cylinder(link, "visual", self.wave.valley_radius_m, self.end_m, 0.5 * self.end_m)
            _cylinder(
                link, "visual", self.wave.crest_radius_m, crest_m, self.end_m - 0.5 * crest_m if tip else 0.5 * crest_m
            )
        _cylinder(link, "collision", self.wave.crest_radius_m, self.end_m, 0.5 * self.end_m)

    def draw_wave(self, link: Element) -> None:
        """Draw a wave onto a link."""
        length_m, middle_m = self.wave.length_m, 0.5 * self.wave.length_m
        if self.meshes is not None:
            self._mesh(link, WAVE_FILE, (0.0, 0.0, middle_m), _STRAIGHT)
        else:
            _cylinder(link, "visual", self.wave.valley_radius_m, length_m, middle_m)
            _cylinder(link, "visual", self.wave.crest_radius_m, 0.5 * length_m, middle_m)
        _cylinder(link, "collision", self.wave.crest_radius_m, length_m, middle_m)

    def _mesh(self, link: Element, file: str, place_m: Sequence[float], turn_rad: Sequence[float]) -> None:
        geometry = _geometry(link, "visual", "silicone", place_m, turn_rad)
        SubElement(geometry, "mesh", filename=f"{self.meshes}/{file}")


def _add_finger(robot: Element, prefix: str, finger: str, muscle: _Drawn, joints: int) -> None:
    mount = f"{prefix}{finger}_mount"
    for component, axis, _ in _TURNS:
        name = f"{finger}_bend_{component}"
        _link(robot, f"{prefix}{name}")
        _turning(robot, name, mount, f"{prefix}{name}", axis, 0.0)
    parent, height_m = mount, muscle.end_m
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
            muscle.draw_end(body, tip=True)
        else:
            muscle.draw_wave(body)
        height_m = muscle.wave.length_m


def _cylinder(link: Element, part: str, radius_m: float, length_m: float, middle_m: float) -> None:
    geometry = _geometry(link, part, "silicone", (0.0, 0.0, middle_m))
    SubElement(geometry, "cylinder", radius=f"{radius_m:.9g}", length=f"{length_m:.9g}")


def _geometry(
    link: Element, part: str, material: str, position_m: Sequence[float], rpy: Sequence[float] = _STRAIGHT
) -> Element:
    seen = SubElement(link, part)
    SubElement(seen, "origin", xyz=_numbers(position_m), rpy=_numbers(rpy))
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
