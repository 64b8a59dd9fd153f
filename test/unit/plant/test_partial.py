"""Scenes in which some fingers are left out: the others do as they would, and who is left out must not be filled."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import PlantDivergedError

GRIPPER = load_gripper()
ONE_AND_THREE = np.repeat([1.0, 0.0, 1.0, 0.0], 4) * np.tile([1.0, 0.2, 0.0, 0.0], 4)


def plant_of(name, fingers, **changes):
    scene, request = load_scene(name)
    return build_plant(scene, dataclasses.replace(request, moving_fingers=fingers, **changes), GRIPPER)


@pytest.mark.parametrize("tier", ["static", "arc", "rod"])
def test_the_moving_fingers_do_as_among_four_and_the_others_hang_straight(tier):
    some, all_four = (plant_of("empty", fingers, tier=tier) for fingers in ((3, 1), None))
    for plant in (some, all_four):
        for _ in range(20):
            plant.step(ONE_AND_THREE, 0.01)
    found, expected = some.observe(), all_four.observe()
    for name in ("bend_rad", "bend_rate_rad_s", "centreline_m"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-12)
    assert np.linalg.norm(found.bend_rad, axis=1)[[0, 2]].min() > 0.1
    assert not found.bend_rad[[1, 3]].any()


def test_two_fingers_touch_an_object_and_the_others_do_not():
    plant = plant_of("bulb", (1, 3), tier="rod")
    inward = np.repeat([1.0, 0.0, 1.0, 0.0], 4) * np.eye(4).ravel()  # chamber i of finger i bends it to the middle
    for _ in range(33):
        plant.step(0.6 * inward, 0.01)
    force = plant.observe().finger_force_n
    assert np.linalg.norm(force[[0, 2]], axis=1).min() > 0.01
    assert not force[[1, 3]].any()


def test_a_finger_that_is_left_out_must_not_be_filled():
    plant = plant_of("empty", (1, 2))
    with pytest.raises(PlantDivergedError, match="finger 3 are filled.*moving_fingers = 1, 2: add it"):
        for _ in range(5):
            plant.step(ONE_AND_THREE, 0.01)


@pytest.mark.parametrize("fingers", [(), (0, 1), (5,), (1, 1)])
def test_fingers_that_there_are_not_are_refused(fingers):
    with pytest.raises(ValueError, match=r"moving_fingers must be some of \(1, 2, 3, 4\)"):
        plant_of("empty", fingers)
