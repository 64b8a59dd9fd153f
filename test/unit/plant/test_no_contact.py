"""Scenes whose contact is left out: the fingers do as in the empty scene, and the object is only there to be seen."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene

GRIPPER = load_gripper()
INWARD = 0.8 * np.eye(4).ravel()
"""Chamber i of finger i bends it to the middle, where the bulb is."""


def closed(name, **changes):
    scene, request = load_scene(name)
    there = {key: changes.pop(key) for key in tuple(changes) if hasattr(scene, key)}
    plant = build_plant(dataclasses.replace(scene, **there), dataclasses.replace(request, **changes), GRIPPER)
    for _ in range(30):
        plant.step(INWARD, 0.01)
    return plant.observe()


@pytest.mark.parametrize("tier", ["static", "arc", "rod"])
def test_fingers_pass_through_an_object_that_stays_where_it_is(tier):
    seen, alone = closed("bulb", tier=tier, contact=False), closed("empty", tier=tier, fingers_touch=False)
    np.testing.assert_allclose(seen.centreline_m, alone.centreline_m, atol=1e-12)
    np.testing.assert_array_equal(seen.object_in_world.position_m, load_scene("bulb")[0].object_position_m)
    assert not seen.finger_force_n.any() and not seen.support_force_n.any()


def test_the_same_fingers_meet_the_object_with_contact():
    assert closed("bulb", tier="arc").finger_force_n.any()


def test_an_object_inside_a_finger_is_no_error_where_nothing_touches():
    inside_m = tuple(GRIPPER.finger_base_m[0] + (0.0, 0.0, 0.08))
    assert closed("bulb", object_position_m=inside_m, contact=False).object_in_world is not None


def test_modes_of_the_air_are_enough_where_nothing_touches():
    fewer, plain = closed("bulb", tier="rod", modes=4, air_modes=2, contact=False), closed("bulb", tier="rod", modes=2)
    reached = closed("bulb", tier="rod", modes=2, contact=False)
    np.testing.assert_array_equal(fewer.centreline_m, reached.centreline_m)
    assert np.abs(reached.centreline_m - plain.centreline_m).max() > 1e-3
