"""What is in a scene: the objects, what they rest on, gravity, the lift. Scene files also say how to compute it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import (
    ConfigError,
    config_directory,
    load_yaml,
    parse_config,
    parse_together,
    require_positive,
)
from mbpam_ros.geometry.rotations import about_z, product
from mbpam_ros.geometry.solids import Shape
from mbpam_ros.plant.fidelity import AUTO, FidelityRequest
from mbpam_ros.plant.lift import LiftConfig
from mbpam_ros.plant.rig import RigConfig

PAPER_SCENES = ("tomato", "bulb", "banana", "tube", "carton")
"""Scenes of the paper's figure 10, in its order."""

_Z_LAID_ALONG_Y = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Quarter turn about -x."""


@dataclass(frozen=True)
class ObjectSpec:
    """A kind of object.

    Args:
        name: in ``objects.yaml``.
        shape: sphere, cylinder (axis along body z) or box.
        size_m: diameters; diameter, diameter, length; or full extents.
        mass_kg: of the homogeneous solid.
        colour_rgb: to render it in, 0 to 1.
        label: what a person calls it.
        expected_mode: the grasp mode the paper used, for reports only.
    """

    name: str
    shape: Shape
    size_m: tuple[float, float, float]
    mass_kg: float
    colour_rgb: tuple[float, float, float]
    label: str
    expected_mode: str

    def __post_init__(self) -> None:
        require_positive(self, "size_m", "mass_kg")
        x, y, z = self.size_m
        if (self.shape != "box" and x != y) or (self.shape == "sphere" and x != z):
            raise ValueError(f"size_m = {self.size_m} is not round as a {self.shape} must be")
        if not all(0.0 <= value <= 1.0 for value in self.colour_rgb):
            raise ValueError(f"colour_rgb must lie in 0 to 1, found {self.colour_rgb}")


@dataclass(frozen=True)
class SupportConfig:
    """What the object rests on: a table, or a slim stand on a table.

    Args:
        depth_m: depth of the top under the palm before the hand is raised.
        half_size_m: half extents of a stand's top along x and y, centred under the palm; none for a table. Fingers
            pass by a stand without touching it.
        stand_height_m: height of the stand's top over the table it stands on; given with ``half_size_m``.
    """

    depth_m: float
    half_size_m: tuple[float, float] | None = None
    stand_height_m: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "depth_m")
        if (self.half_size_m is None) != (self.stand_height_m is None):
            raise ValueError("half_size_m and stand_height_m describe a stand: give both, or none for a table")
        if self.half_size_m is not None:
            require_positive(self, "half_size_m", "stand_height_m")

    @property
    def planes_m(self) -> NDArray[np.float64]:
        """Rows (depth, half size x, half size y) of the level planes, uppermost first, the table (endless) last."""
        if self.half_size_m is None or self.stand_height_m is None:
            return np.array([[self.depth_m, np.inf, np.inf]])
        return np.array([[self.depth_m, *self.half_size_m], [self.depth_m + self.stand_height_m, np.inf, np.inf]])


@dataclass(frozen=True)
class PlacedObject:
    """An object and where it starts.

    Args:
        object: what it is; a file names one of ``objects.yaml``.
        object_position_m: its centre, world frame.
        object_yaw_rad: turn about z; 0 lays a rod along y.
    """

    object: ObjectSpec
    object_position_m: tuple[float, float, float]
    object_yaw_rad: float = 0.0

    @property
    def orientation_xyzw(self) -> NDArray[np.float64]:
        """Orientation at the start, (4,): a cylinder lies along y turned by the yaw."""
        yaw = about_z(self.object_yaw_rad)
        return np.array(yaw if self.object.shape != "cylinder" else product(yaw, _Z_LAID_ALONG_Y))


@dataclass(frozen=True)
class Scene:
    """What is there. World frame: ``gripper_base`` at the start, z down.

    Args:
        name: of the scene, for messages and reports.
        object: what is there to grasp; none for an empty scene. A file names one of ``objects.yaml``.
        object_position_m: centre of the object at the start; given with ``object``.
        object_yaw_rad: turn about z; 0 lays a rod along y.
        gravity_m_s2: acceleration of gravity.
        support: what the object rests on.
        lift: travel of the hand.
        friction_coefficient: of fingers on the object; none for that of ``plant.yaml``.
        contact_stiffness_n_m: of fingers on the object; none for that of ``plant.yaml``.
        fingers_touch: whether fingers touch each other (tiers arc and rod); otherwise they pass through each other.
        gravity_direction: along which gravity acts, of any length but zero; made one of length 1. +z: the hand hangs;
            -z: it stands; supports stay level in ``gripper_base``. The tier static knows +z only.
        others: further objects, each with a name of its own; given with ``object``. A file lists them all, the one to
            grasp first, under ``objects`` instead of ``object`` and what belongs to it.
        rig: the measuring rig that the muscle of finger 1 is mounted in; none: it is a finger.
    """

    name: str
    object: ObjectSpec | None
    object_position_m: tuple[float, float, float] | None
    object_yaw_rad: float
    gravity_m_s2: float
    support: SupportConfig | None
    lift: LiftConfig
    friction_coefficient: float | None = None
    contact_stiffness_n_m: float | None = None
    fingers_touch: bool = True
    gravity_direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    others: tuple[PlacedObject, ...] = ()
    rig: RigConfig | None = None

    def __post_init__(self) -> None:
        length = math.hypot(*self.gravity_direction)
        if not 0.0 < length < math.inf:
            raise ValueError(f"gravity_direction must point somewhere, found {list(self.gravity_direction)}")
        object.__setattr__(self, "gravity_direction", tuple(part / length for part in self.gravity_direction))
        if (self.object is None) != (self.object_position_m is None):
            raise ValueError("object and object_position_m must both be given or both be null")
        if self.others and self.object is None:
            raise ValueError("others are further objects: give object and object_position_m, or list all under objects")
        names = [placed.object.name for placed in self.placed]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"two objects are named {twice}; give each a name of its own (key name under objects)")
        if self.friction_coefficient is not None and self.friction_coefficient < 0.0:
            raise ValueError(f"friction_coefficient must not be negative, found {self.friction_coefficient}")
        if self.contact_stiffness_n_m is not None:
            require_positive(self, "contact_stiffness_n_m")

    @property
    def placed(self) -> tuple[PlacedObject, ...]:
        """All objects, the one to grasp first."""
        if self.object is None or self.object_position_m is None:
            return ()
        return (PlacedObject(self.object, self.object_position_m, self.object_yaw_rad), *self.others)

    @property
    def object_orientation_xyzw(self) -> NDArray[np.float64]:
        """Orientation of the object at the start, (4,): a cylinder lies along y turned by the yaw."""
        return self.placed[0].orientation_xyzw if self.placed else np.array(about_z(self.object_yaw_rad))


def scene_names() -> tuple[str, ...]:
    """Return the names of the scenes of the configuration directory, sorted."""
    return tuple(sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml")))


def load_objects(name: str | Path = "objects.yaml") -> dict[str, ObjectSpec]:
    """Read the catalogue of objects.

    Raises:
        ConfigError: wrong keys or values.
    """
    content = load_yaml(name)
    objects = content.get("objects")
    if list(content) != ["objects"] or not isinstance(objects, dict):
        raise ConfigError(f"{name}: expected one key, objects, with a mapping; found {', '.join(map(str, content))}")
    return {
        str(key): parse_config(ObjectSpec, value, f"{name}: objects: {key}", name=str(key))
        for key, value in objects.items()
    }


def load_scene(name: str | Path) -> tuple[Scene, FidelityRequest]:
    """Read a scene, by name (``bulb``) or from a file: what is there, and how it shall be computed.

    Raises:
        ConfigError: no such scene, wrong keys or values, or an object that ``objects.yaml`` does not have.
    """
    file, stem = Path(name), Path(name).stem
    if file.suffix != ".yaml":
        if str(name) not in scene_names():
            raise ConfigError(f"no scene {str(name)!r}; known: {', '.join(scene_names())}; or give a .yaml file")
        file = Path("scenes") / f"{name}.yaml"
    content = load_yaml(file)
    if "objects" in content:
        content |= _first_and_others(content.pop("objects"), content, str(file), stem)
    elif content.get("object") is not None:
        content["object"] = _object(str(content["object"]), stem)
    scene, request = parse_together((Scene, FidelityRequest), content, str(file), name=stem)
    if request.tier != AUTO and request.sub_step_s is None:
        raise ConfigError(f"{file}: sub_step_s must be given with tier {request.tier}; only tier auto chooses one")
    return scene, request


_OF_ONE_OBJECT = ("object", "object_position_m", "object_yaw_rad")


def _first_and_others(listed: object, content: dict[str, Any], file: str, scene_name: str) -> dict[str, Any]:
    """Return what a file's ``objects`` say, under the keys of :class:`Scene`."""
    both = [key for key in (*_OF_ONE_OBJECT, "others") if content.get(key) is not None]
    if both:
        raise ConfigError(f"{file}: {', '.join(both)} and objects: give one object, or a list of all under objects")
    if not isinstance(listed, list) or not listed:
        raise ConfigError(f"{file}: objects: expected a list with an entry for each object, found {listed!r}")
    placed = [_placed(entry, f"{file}: objects[{place}]", scene_name) for place, entry in enumerate(listed)]
    first = placed[0]
    return {
        "object": first.object,
        "object_position_m": list(first.object_position_m),
        "object_yaw_rad": first.object_yaw_rad,
        "others": placed[1:],
    }


def _placed(entry: object, where: str, scene_name: str) -> PlacedObject:
    if not isinstance(entry, dict) or entry.get("object") is None:
        raise ConfigError(f"{where}: expected keys {', '.join(_OF_ONE_OBJECT)} and maybe name, found {entry!r}")
    spec, keys = _object(str(entry["object"]), scene_name), {key: entry[key] for key in entry if key != "name"}
    if entry.get("name") is not None:
        spec = dataclasses.replace(spec, name=str(entry["name"]))
    return parse_config(PlacedObject, {**keys, "object": spec}, where)


def _object(name: str, scene_name: str) -> ObjectSpec:
    objects = load_objects()
    if name not in objects:
        raise ConfigError(f"scene {scene_name}: no object {name!r}; known: {', '.join(sorted(objects))}")
    return objects[name]
