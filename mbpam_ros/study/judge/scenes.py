"""Random scenes: what lies on the table, the lamps, and where the camera is. In ``gripper_base``, whose z is down."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.study.judge.tables import REPORT, TUNING
from mbpam_ros.vision.camera import CameraPose, Intrinsics, camera_intrinsics, camera_pose, load_camera_config

Split = Literal["tune", "report"]
TABLES = {"tune": TUNING, "report": REPORT}

KINDS: dict[Split, tuple[str, ...]] = {
    "tune": ("ball", "rod", "post", "capsule", "box", "bottle", "pear"),
    "report": ("ball", "rod", "post", "capsule", "box", "egg", "banana", "can"),
}
"""Objects of the two sets; what is not a primitive is in one of them alone."""


@dataclass(frozen=True, eq=False)
class Part:
    """One convex part of an object.

    Args:
        kind: sphere, capsule, ellipsoid, cylinder or box, with sizes as MuJoCo has them (half lengths) [m].
        size_m: (3,), half sizes.
        position_m: (3,), in the object's frame.
        rotation: from the part to the object.
    """

    kind: str
    size_m: tuple[float, ...]
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: Rotation = field(default_factory=Rotation.identity)


@dataclass(frozen=True, eq=False)
class Thing:
    """An object on the table, and the primitive that it is for a gripper.

    Args:
        kind: a name of :data:`KINDS`.
        shape, size_m: the primitive, sizes as in ``visualization_msgs/Marker``.
        position_m, rotation: of the primitive's frame in ``gripper_base``.
        parts: what is drawn, in that frame.
        rgb: colour, 0 to 1.
        label: whether a printed pattern covers it.
        shininess: specular share, 0 to 1.
    """

    kind: str
    shape: Shape
    size_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    rotation: Rotation
    parts: tuple[Part, ...]
    rgb: NDArray[np.float64]
    label: bool
    shininess: float


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp: where, toward what, how bright (0 to 1)."""

    position_m: NDArray[np.float64]
    toward_m: NDArray[np.float64]
    brightness: float


@dataclass(frozen=True, eq=False)
class JudgedScene:
    """All that an image is made from.

    Args:
        seed: of this scene.
        camera: palm or stand.
        intrinsics: of the camera.
        pose: where the camera is.
        assumed_pose: where the detector is told that it is.
        support_depth_m: z of the table.
        table: a name of :mod:`~mbpam_ros.study.judge.tables`.
        things: what stands on the table; the first is what shall be grasped.
        lamps: one to three.
        ambient: brightness without lamps.
        fingers: whether the open fingers hang in view.
        papers: flat sheets on the table: x, y, yaw, half width, half length.
        noise_levels: of the sensor.
    """

    seed: int
    camera: Literal["palm", "stand"]
    intrinsics: Intrinsics
    pose: CameraPose
    assumed_pose: CameraPose
    support_depth_m: float
    table: str
    things: tuple[Thing, ...]
    lamps: tuple[Lamp, ...]
    ambient: float
    fingers: bool
    papers: tuple[tuple[float, float, float, float, float], ...]
    noise_levels: float


@dataclass(frozen=True, eq=False)
class Photographs:
    """What the detector gets of a scene.

    Args:
        image: (H, W, 3) rgb8.
        backgrounds: frames, (n, H, W, 3) rgb8, of the table without the objects, at another exposure and shifted.
        depth_m: (H, W) float32, along the optical axis; NaN where the sensor has no answer.
    """

    image: NDArray[np.uint8]
    backgrounds: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


def random_scene(seed: int, split: Split, tilt_deg: float = 1.0) -> JudgedScene:
    """Return scene ``seed`` of a set.

    Args:
        seed: same seed, same scene.
        split: the set, of its own tables and objects.
        tilt_deg: standard deviation of the stand camera's pose from what is told; the palm's has a third of it.
    """
    rng = np.random.default_rng((seed, {"tune": 1, "report": 2}[split]))
    palm = bool(rng.random() < 0.5)
    depth_m = float(rng.uniform(0.110, 0.140))
    tables = sorted(TABLES[split])
    table = tables[int(rng.integers(len(tables)))]
    target = _thing(rng, split, depth_m, rng.uniform(-0.03, 0.03, 2))
    things = [target]
    for _ in range(int(rng.integers(0, 3))):
        away, azimuth = rng.uniform(0.11, 0.17), rng.uniform(0.0, 2.0 * math.pi)
        other = _thing(rng, split, depth_m, away * np.array([math.cos(azimuth), math.sin(azimuth)]))
        if all(_apart(other, thing) for thing in things):
            things.append(other)
    pose, intrinsics = _palm(rng) if palm else _stand(rng, depth_m)
    error = Rotation.from_rotvec(rng.normal(0.0, math.radians(tilt_deg) * (0.3 if palm else 1.0), 3))
    assumed = CameraPose(pose.rotation @ error.as_matrix(), pose.position_m)
    lamps = tuple(_lamp(rng, depth_m) for _ in range(int(rng.integers(1, 4))))
    ambient = float(rng.uniform(0.15, 0.45))
    # A camera exposes so that a light table is hardly clipped.
    exposure = rng.uniform(0.6, 1.05) / (ambient + sum(lamp.brightness for lamp in lamps))
    lamps = tuple(replace(lamp, brightness=exposure * lamp.brightness) for lamp in lamps)
    papers = tuple(
        (*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.0, 3.0), *rng.uniform(0.008, 0.05, 2))
        for _ in range(int(rng.integers(0, 2)) * int(rng.integers(0, 3)))
    )
    return JudgedScene(
        seed,
        "palm" if palm else "stand",
        intrinsics,
        pose,
        assumed,
        depth_m,
        table,
        tuple(things),
        lamps,
        exposure * ambient,
        palm,
        papers,
        float(rng.uniform(1.0, 4.0)),
    )


def _apart(first: Thing, second: Thing) -> bool:
    reach = 0.5 * (np.linalg.norm(first.size_m) + np.linalg.norm(second.size_m))
    return bool(np.linalg.norm((first.position_m - second.position_m)[:2]) > 0.75 * reach + 0.01)


def _palm(rng: np.random.Generator) -> tuple[CameraPose, Intrinsics]:
    config = load_camera_config()
    return camera_pose(config), camera_intrinsics(config)


def _stand(rng: np.random.Generator, depth_m: float) -> tuple[CameraPose, Intrinsics]:
    """A camera above or beside, looking about at what lies under the palm."""
    distance, azimuth = rng.uniform(0.30, 0.55), rng.uniform(0.0, 2.0 * math.pi)
    elevation = math.radians(rng.uniform(40.0, 85.0))
    middle = np.array([*rng.uniform(-0.02, 0.02, 2), depth_m - 0.02])
    outward = np.array([math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), 0.0])
    position = middle + distance * (outward + (0.0, 0.0, -math.sin(elevation)))
    forward = (middle - position) / distance
    down = np.array([0.0, 0.0, 1.0]) - forward[2] * forward
    down /= np.linalg.norm(down)
    rotation = np.column_stack([np.cross(down, forward), down, forward])
    width, height = 640, 480
    focal = 0.5 * width / math.tan(0.5 * math.radians(rng.uniform(55.0, 70.0)))
    intrinsics = Intrinsics(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))
    return CameraPose(rotation, position), intrinsics


def _lamp(rng: np.random.Generator, depth_m: float) -> Lamp:
    azimuth, elevation = rng.uniform(0.0, 2.0 * math.pi), math.radians(rng.uniform(35.0, 85.0))
    outward = np.array(
        [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), -math.sin(elevation)]
    )
    toward = np.array([*rng.uniform(-0.05, 0.05, 2), depth_m])
    return Lamp(toward + rng.uniform(0.8, 1.6) * outward, toward, float(rng.uniform(0.25, 0.7)))


def _thing(rng: np.random.Generator, split: Split, depth_m: float, place: NDArray) -> Thing:
    kinds = KINDS[split]
    kind = kinds[int(rng.integers(len(kinds)))]
    shape: Shape
    lying = Rotation.from_euler("x", 90.0, degrees=True)  # body z along gripper y
    yaw = Rotation.from_euler("z", rng.uniform(-180.0, 180.0), degrees=True)
    rotation = yaw * lying
    if kind in ("ball", "egg", "pear"):
        radius = rng.uniform(0.018, 0.037)
        shape, size = "sphere", np.full(3, 2.0 * radius)
        parts: tuple[Part, ...] = (Part("sphere", (radius,) * 3),)
        rotation, height = yaw, radius
        if kind == "egg":
            parts = (Part("ellipsoid", (radius, 1.18 * radius, radius)),)
            size = np.array([2.0, 2.12, 2.0]) * radius
        elif kind == "pear":
            parts = (*parts, Part("sphere", (0.6 * radius,) * 3, (0.0, 0.75 * radius, -0.05 * radius)))
    elif kind == "box":
        half = np.sort(rng.uniform((0.009, 0.014, 0.03), (0.025, 0.035, 0.075)))
        if rng.random() < 0.5:
            half[:2] = half[1], half[0]
        shape, size, height, rotation = "box", 2.0 * half[[0, 2, 1]], half[1], yaw
        parts = (Part("box", tuple(0.5 * size)),)
    elif kind in ("post", "can"):
        radius, half_height = rng.uniform(0.015, 0.036), rng.uniform(0.02, 0.045)
        shape, size, height, rotation = "cylinder", np.array([2, 2, 0]) * radius, half_height, yaw
        size[2] = 2.0 * half_height
        parts = (Part("cylinder", (radius, half_height, 0.0)),)
        if kind == "can":
            rim = 0.93 * radius
            parts = (
                Part("cylinder", (radius, half_height - 0.004, 0.0)),
                Part("cylinder", (rim, half_height, 0.0)),
            )
    else:
        slender = rng.random() < 0.4
        radius = rng.uniform(0.009, 0.014) if slender else rng.uniform(0.012, 0.024)
        half_length = rng.uniform(9.0, 12.0) * radius if slender else rng.uniform(2.6, 6.5) * radius
        half_length = max(half_length, 0.032)
        shape, size, height = "cylinder", np.array([2.0 * radius, 2.0 * radius, 2.0 * half_length]), radius
        if kind == "rod":
            parts = (Part("cylinder", (radius, half_length, 0.0)),)
        elif kind == "capsule":
            parts = (Part("capsule", (radius, half_length - radius, 0.0)),)
        elif kind == "bottle":
            body = 0.68 * half_length
            parts = (
                Part("cylinder", (radius, body, 0.0), (0.0, 0.0, body - half_length)),
                Part("ellipsoid", (radius, radius, radius), (0.0, 0.0, 2.0 * body - half_length)),
                Part("cylinder", (0.45 * radius, half_length - body, 0.0), (0.0, 0.0, body)),
            )
        else:
            parts = _banana(radius, half_length)
    position = np.array([*place, depth_m - height])
    return Thing(
        kind,
        shape,
        np.asarray(size, dtype=float),
        position,
        rotation,
        parts,
        np.clip(rng.uniform(0.05, 0.95) + rng.uniform(-0.35, 0.35, 3), 0.02, 0.98),
        bool(rng.random() < 0.35),
        float(rng.uniform(0.0, 0.5)),
    )


def _banana(radius: float, half_length: float) -> tuple[Part, ...]:
    """Capsules along an arc that rises by a quarter of its length, in the table's plane (body x)."""
    stations = np.linspace(-1.0, 1.0, 8)
    along = (half_length - radius) * stations
    bend = 0.25 * half_length * (stations**2 - 0.5)
    points = np.column_stack([bend, np.zeros(8), along])
    parts = []
    for a, b, station in zip(points[:-1], points[1:], stations, strict=False):
        axis = b - a
        turn = Rotation.align_vectors(axis[None], [[0.0, 0.0, 1.0]])[0]
        thick = radius * (1.0 - 0.25 * abs(station + 0.14) ** 3)
        parts.append(Part("capsule", (thick, 0.5 * float(np.linalg.norm(axis)), 0.0), tuple(0.5 * (a + b)), turn))
    return tuple(parts)
