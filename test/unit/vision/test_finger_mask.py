"""The pixels that told fingers may hide, beside those that the renderer draws of them."""

import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.camera import Camera, load_camera_config
from mbpam_ros.vision.detector import open_fingers
from mbpam_ros.vision.finger_mask import FingerMask
from mbpam_ros.vision.render import Renderer, SceneView

STRIDE = 2
RADIUS_M = load_gripper().geometry.outer_radius_m
MARGIN_M = 0.0015
CAMERA = Camera.from_config(load_camera_config())
RENDERER = Renderer(CAMERA)
DARK = SceneView(0.3, support_rgb=(0.0, 0.0, 0.0))
WITHOUT_FINGERS = RENDERER.render(DARK)
OPEN = open_fingers(load_gripper())
INWARD_DEG = (225.0, 315.0, 45.0, 135.0)
ACROSS_DEG = (135.0, 315.0, 315.0, 135.0)


def bent(angle_deg, azimuths_deg=INWARD_DEG, points=14):
    """Arcs from the clamps, (4, points, 3)."""
    length_m = float(OPEN[0, 1, 2] - OPEN[0, 0, 2])
    angle = np.radians(max(angle_deg, 1e-6)) * np.linspace(0.0, 1.0, points)
    aside, down = length_m * (1.0 - np.cos(angle)) / angle[-1], length_m * np.sin(angle) / angle[-1]
    x, y = np.cos(np.radians(azimuths_deg)), np.sin(np.radians(azimuths_deg))
    parts = np.outer(x, aside), np.outer(y, aside), np.tile(down, (4, 1))
    return OPEN[:, :1] + np.stack(parts, axis=-1)


def drawn(fingers_m):
    """Where the renderer shows fingers, of the pixels that the mask has: any of the stride's."""
    view = SceneView(0.3, (), fingers_m, RADIUS_M, support_rgb=DARK.support_rgb)
    fingers = (RENDERER.render(view) != WITHOUT_FINGERS).any(axis=2)
    height, width = (size // STRIDE * STRIDE for size in fingers.shape)
    return fingers[:height, :width].reshape(height // STRIDE, STRIDE, width // STRIDE, STRIDE).any(axis=(1, 3))


def masked(fingers_m, bend_margin=0.0, margin_m=MARGIN_M):
    return FingerMask(CAMERA, STRIDE, RADIUS_M + margin_m, bend_margin).of(fingers_m) != 0


@pytest.mark.parametrize("azimuths_deg", [INWARD_DEG, ACROSS_DEG])
@pytest.mark.parametrize("angle_deg", [0.0, 12.0, 35.0, 98.0, 150.0])
def test_all_pixels_of_the_fingers_are_masked(angle_deg, azimuths_deg):
    fingers = bent(angle_deg, azimuths_deg)
    assert masked(fingers)[drawn(fingers)].all()


def test_of_open_fingers_little_more_is_masked_than_a_tube_thicker_by_the_margin():
    there = drawn(OPEN)
    too_much = masked(OPEN, margin_m=0.0) & ~there
    assert 0.0 < too_much.sum() / there.sum() < 0.06


@pytest.mark.parametrize("angle_deg", [12.0, 35.0, 98.0])
def test_where_fingers_pass_on_their_way_is_masked_and_little_else(angle_deg):
    way = np.zeros_like(drawn(OPEN))
    for share in np.linspace(0.0, 1.0, 15):
        way |= drawn(bent(share * angle_deg))
    mask = masked(bent(angle_deg), margin_m=0.0)
    assert mask[way].mean() >= 0.999
    assert (mask & ~way).sum() / way.sum() < 0.05


def test_a_finger_bent_farther_than_told_by_the_margin_is_still_masked():
    farther = drawn(bent(69.0, ACROSS_DEG))
    told = bent(60.0, ACROSS_DEG)
    assert masked(told, bend_margin=0.15, margin_m=0.0)[farther].mean() >= 0.999
    assert masked(told, margin_m=0.0)[farther].mean() < 0.98


def test_fingers_told_by_few_points_hide_what_they_hide_told_by_many():
    few, many = masked(bent(0.0, points=2)), masked(bent(0.0, points=60))
    assert (few != many).mean() < 0.002


def test_without_fingers_nothing_is_hidden():
    assert not masked(np.empty((0, 2, 3))).any()


def test_for_the_same_fingers_the_mask_is_not_drawn_again():
    mask = FingerMask(CAMERA, STRIDE, RADIUS_M, 0.0)
    assert mask.of(bent(30.0)) is mask.of(bent(30.0))
    assert mask.of(bent(30.0)) is not mask.of(bent(31.0))
