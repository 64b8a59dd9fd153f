"""Grasps drawn at random: objects of every mode's kind, their size, mass, friction and place.

Kinds are drawn evenly, mass evenly by its logarithm, everything else evenly from the ranges below. An object that would
start inside something is drawn again. The same seed and number give the same grasp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbpam_ros.configuration import ConfigError, load_config
from mbpam_ros.grasp.grip_pressure import Expected, GripConfig
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.placement import placed
from mbpam_ros.plant.scene import ObjectSpec, Scene
from mbpam_ros.plant.tiers.base import PlantConfig
from mbpam_ros.study.grasp.grip_table import DEPTHS_M, FRICTIONS, WIDTHS_M, object_for, scene_for

MASS_KG = (0.02, 0.2)
FRICTION = (0.4, 0.9)
OFFSET_M, YAW_RAD = 0.005, 0.1
"""Largest, either way."""

_DRAWS = 1000


@dataclass(frozen=True)
class DrawnGrasp:
    """An object to grasp.

    Args:
        mode: that suits it.
        scene: with it.
        expected: what an operator would tell of it: between which masses its class lies, and the friction of the class
            below.
    """

    mode: str
    scene: Scene
    expected: Expected


def drawn_grasp(seed: int, number: int, gripper: Gripper, config: GripConfig) -> DrawnGrasp:
    """Return a grasp by its seed and number.

    Raises:
        ConfigError: a file is wrong, or no object fits the gripper.
    """
    rng = np.random.default_rng([seed, number])
    plant = load_config(PlantConfig, "plant.yaml")
    for _ in range(_DRAWS):
        mode = str(rng.choice(MODE_NAMES))
        width_m = float(rng.uniform(WIDTHS_M[mode][0], WIDTHS_M[mode][-1]))
        depth_m = float(rng.uniform(DEPTHS_M[mode][0], DEPTHS_M[mode][-1]))
        mass_kg = float(np.exp(rng.uniform(*np.log(MASS_KG))))
        friction = float(rng.uniform(*FRICTION))
        x_m, y_m = (float(value) for value in rng.uniform(-OFFSET_M, OFFSET_M, 2))
        yaw_rad = float(rng.uniform(-YAW_RAD, YAW_RAD))
        scene = scene_for(mode, object_for(mode, width_m, mass_kg), (x_m, y_m, depth_m), yaw_rad, friction)
        try:
            placed(scene, gripper, plant, contact=True)
        except ConfigError:
            continue
        return DrawnGrasp(mode, scene, expected_of(scene.object, friction, config))
    raise ConfigError(f"no object of {_DRAWS} drawn ones fits between the fingers of this gripper")


def expected_of(spec: ObjectSpec | None, friction_coefficient: float, config: GripConfig) -> Expected:
    """Return what the names of an object's classes tell of it."""
    if spec is None:
        return Expected()
    least = max((each for each in FRICTIONS if each <= friction_coefficient), default=friction_coefficient)
    names = ("light", "medium", "heavy")
    classes = (config.mass_classes_kg.named(name) for name in names)
    lightest, heaviest = next((each for each in classes if spec.mass_kg <= each[1]), (spec.mass_kg, spec.mass_kg))
    return Expected(heaviest, least, lightest)
