"""Scenes as the simulated palm camera shows them: the same kinds of objects, any yaw, fingers in view."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.judge.scenes import JudgedScene, Photographs, Split, Thing
from mbpam_ros.vision.camera import camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

_KINDS = ("ball", "rod", "tube", "box")
_REACH_M = 0.03


@lru_cache(maxsize=1)
def _renderer() -> Renderer:
    return Renderer.from_config(load_camera_config())


def random_own_scene(seed: int, split: Split) -> JudgedScene:
    """Return scene ``seed`` of a set: one object up to 30 mm off the palm's axis."""
    rng = np.random.default_rng((seed, {"tune": 11, "report": 12}[split]))
    depth_m = float(rng.uniform(0.110, 0.140))
    kind = _KINDS[int(rng.integers(len(_KINDS)))]
    yaw = Rotation.from_euler("z", rng.uniform(-180.0, 180.0), degrees=True)
    place = rng.uniform(-_REACH_M, _REACH_M, 2)
    shape: Shape
    if kind == "ball":
        shape, size, height, rotation = "sphere", np.full(3, rng.uniform(0.05, 0.075)), 0.0, yaw
        height = 0.5 * size[0]
    elif kind == "box":
        shape, size, rotation = "box", rng.uniform((0.03, 0.08, 0.03), (0.045, 0.13, 0.065)), yaw
        height = 0.5 * size[2]
    else:
        diameter = rng.uniform(0.016, 0.024) if kind == "tube" else rng.uniform(0.028, 0.042)
        length = rng.uniform(0.2, 0.26) if kind == "tube" else rng.uniform(0.1, 0.2)
        shape, size, height = "cylinder", np.array([diameter, diameter, length]), 0.5 * diameter
        rotation = yaw * Rotation.from_euler("x", 90.0, degrees=True)
    thing = Thing(
        kind,
        shape,
        size,
        np.array([*place, depth_m - height]),
        rotation,
        (),
        np.clip(rng.uniform(0.3, 0.9) + rng.uniform(-0.3, 0.3, 3), 0.1, 0.95),
        False,
        0.0,
    )
    config = load_camera_config()
    pose = camera_pose(config)
    table = "light" if rng.random() < 0.3 else "dark"
    return JudgedScene(
        seed, "palm", camera_intrinsics(config), pose, pose, depth_m, table, (thing,), (), 0.0, True, (), 1.5
    )


def photograph_own(scene: JudgedScene) -> Photographs:
    """Draw the scene as the plant's camera does."""
    rng = np.random.default_rng((scene.seed, 78))
    gripper = load_gripper()
    base = gripper.finger_base_m
    fingers = np.stack([base, base + (0.0, 0.0, gripper.geometry.length_m)], axis=1)
    solids = tuple(
        ColouredSolid(thing.shape, thing.size_m, thing.position_m, thing.rotation.as_quat(), tuple(thing.rgb))
        for thing in scene.things
    )
    rgb = {"dark": (0.115, 0.135, 0.165), "light": (0.62, 0.60, 0.56)}[scene.table]
    view = SceneView(scene.support_depth_m, solids, fingers, support_rgb=rgb)
    empty = SceneView(scene.support_depth_m, (), fingers, support_rgb=rgb)
    renderer = _renderer()
    backgrounds = np.stack([renderer.render(empty, rng) for _ in range(3)])
    return Photographs(renderer.render(view, rng), backgrounds, renderer.render_depth(view, rng))
