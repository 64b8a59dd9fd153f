"""A still scene is not a camera that has stopped."""

import array

import numpy as np
import pytest

from mbpam_ros.vision.stillness import FrozenCamera, FrozenCameraError, is_same_scene


def noise(seed):
    return np.random.default_rng(seed).normal(0.0, 3.0, (120, 160, 3))


def picture(seed, shift=0):
    scene = np.full((120, 160, 3), 90.0)
    scene[40:60, 50 + shift : 70 + shift] = 180.0
    return np.clip(scene + noise(seed), 0, 255).astype(np.uint8)


def test_noise_is_no_change_and_an_object_that_moves_by_three_pixels_is_one():
    assert is_same_scene(picture(1), picture(2))
    assert not is_same_scene(picture(1, shift=3), picture(2))


def test_the_same_picture_to_the_bit_is_frozen_after_the_patience_and_one_bit_frees_it():
    camera, data = FrozenCamera(1.0), array.array("B", picture(1).tobytes())
    for k in range(11):
        camera.check(10.0 + 0.1 * k, array.array("B", data))
    with pytest.raises(FrozenCameraError, match="not a bit of the images has changed for 1.1 s"):
        camera.check(11.1, array.array("B", data))
    data[7] ^= 1
    camera.check(11.2, data)


def test_a_stamp_that_stands_is_frozen_at_once_whatever_the_picture():
    camera = FrozenCamera(1.0)
    camera.check(10.0, picture(1).tobytes())
    with pytest.raises(FrozenCameraError, match="stands still at 10.000 s"):
        camera.check(10.0, picture(2).tobytes())


def test_pictures_without_noise_are_not_judged_where_that_is_switched_off():
    camera, data = FrozenCamera(0.0), picture(1).tobytes()
    for stamp_s in (1.0, 5.0, 100.0, 0.5):
        camera.check(stamp_s, data)
