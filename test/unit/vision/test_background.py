"""The empty table: learnt, compared at another exposure and a little shifted."""

import cv2
import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.background import Background, BackgroundError
from mbpam_ros.vision.camera import Camera, camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.detector import ObjectDetector, load_detector_config, open_fingers
from mbpam_ros.vision.finger_mask import FingerMask
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView

CONFIG = load_camera_config()
RENDERER = Renderer.from_config(CONFIG)
NOTHING_HIDDEN = np.zeros((240, 320), np.uint8)


def table(seed=0):
    """A mottled table, (240, 320, 3)."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.standard_normal((240, 320, 3)), (0, 0), 4.0)
    return 120.0 + 25.0 * noise / noise.std()


def frames(count=4, noise=2.0):
    rng = np.random.default_rng(1)
    return [
        np.clip(table() + noise * rng.standard_normal((240, 320, 3)), 0, 255).astype(np.uint8) for _ in range(count)
    ]


def with_object(image, colour=(40, 60, 150)):
    changed = image.astype(float)
    cv2.circle(changed, (160, 120), 30, colour, -1)
    return changed


def seen(image):
    background = Background.learn(frames(), [NOTHING_HIDDEN] * 4)
    noisy = image + 2.0 * np.random.default_rng(2).standard_normal(image.shape)
    return background.differences(np.clip(noisy, 0, 255).astype(np.uint8), NOTHING_HIDDEN == 0)


def disc():
    return cv2.circle(np.zeros((240, 320), np.uint8), (160, 120), 30, 1, -1).astype(bool)


@pytest.mark.parametrize("gain", [0.85, 1.0, 1.1])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.4, -1.3)])
def test_an_object_is_all_that_differs_whatever_the_exposure_and_a_small_shift(gain, shift):
    move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    moved = cv2.warpAffine(table(), move, (320, 240), borderMode=cv2.BORDER_REFLECT)
    mask = seen(gain * with_object(moved)).with_shadow
    inside = disc()
    assert mask[inside].mean() > 0.95
    assert mask[~cv2.dilate(inside.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)].mean() < 0.005


def test_a_shadow_is_not_sure_to_be_an_object():
    shadow = np.ones((240, 320), np.float32)
    shadow[60:120, 40:120] = 0.6
    shadow = cv2.GaussianBlur(shadow, (0, 0), 3.0)[..., None]
    masks = seen(table() * shadow)
    assert masks.sure.mean() < 0.01
    assert masks.with_shadow[70:110, 50:110].mean() > 0.9


def test_an_object_as_dark_as_a_shadow_shows_by_the_texture_it_covers():
    grey = with_object(table(), (75, 75, 75))
    assert seen(grey).sure[disc()].mean() > 0.5


def test_frames_of_different_sizes_and_images_of_another_size_are_refused():
    with pytest.raises(BackgroundError):
        Background.learn([], [])
    with pytest.raises(BackgroundError):
        Background.learn([frames()[0], frames()[0][:100]], [NOTHING_HIDDEN] * 2)
    with pytest.raises(BackgroundError, match="learnt with"):
        Background.learn(frames(), [NOTHING_HIDDEN] * 4).differences(
            np.zeros((100, 100, 3), np.uint8), np.ones((100, 100), bool)
        )


def test_where_fingers_hid_the_table_in_every_frame_nothing_is_said():
    hidden = NOTHING_HIDDEN.copy()
    hidden[:, :100] = 1
    background = Background.learn(frames(), [hidden] * 4)
    image = np.zeros((240, 320, 3), np.uint8)
    assert not background.differences(image, NOTHING_HIDDEN == 0).with_shadow[:, :100].any()


def test_the_detector_tells_from_the_empty_table_and_says_so():
    ball = ColouredSolid("sphere", (0.05,) * 3, (0.0, 0.0, 0.105), (0.0, 0.0, 0.0, 1.0), (0.1, 0.3, 0.7))
    detector = ObjectDetector(load_detector_config(), camera_pose(CONFIG))
    intrinsics = camera_intrinsics(CONFIG)
    rng = np.random.default_rng(0)
    empty = [RENDERER.render(SceneView(0.13), rng) for _ in range(3)]
    detector.learn_background(empty, "rgb8", intrinsics, None)
    seen = detector.look(RENDERER.render(SceneView(0.13, (ball,)), rng), "rgb8", intrinsics, None, 0.13)
    assert seen.source == "background"
    (found,) = seen.detections
    assert found.shape == "sphere" and found.size_m == pytest.approx(ball.size_m, abs=0.003)
    assert detector.look(empty[0], "rgb8", intrinsics, None, 0.13).detections == []


LENGTH_M = load_gripper().geometry.length_m
OPEN = open_fingers(load_gripper())


def closing(angle_deg):
    """Fingers bent inward in arcs, (4, 14, 3)."""
    angle = np.radians(max(angle_deg, 1e-6)) * np.linspace(0.0, 1.0, 14)[:, None]
    inward = -OPEN[:, :1] / np.linalg.norm(OPEN[:, :1], axis=2, keepdims=True)
    return OPEN[:, :1] + LENGTH_M / angle[-1] * ((1.0 - np.cos(angle)) * inward + np.sin(angle) * [0.0, 0.0, 1.0])


def learnt(*angles_deg, told=True):
    """A detector that has learnt the empty table while fingers moved, and how far it is from the table itself."""
    rng = np.random.default_rng(0)
    fingers = [closing(angle) for angle in angles_deg]
    frames = [RENDERER.render(SceneView(0.13, (), lines), rng) for lines in fingers]
    detector = ObjectDetector(load_detector_config(), camera_pose(CONFIG), load_gripper())
    background = detector.learn_background(frames, "rgb8", camera_intrinsics(CONFIG), None, fingers if told else None)
    table = RENDERER.render(SceneView(0.13))[::2, ::2].astype(float)
    free = hidden_when_open() == 0
    return detector, np.abs(background.mean - table).max(axis=2)[free & background.known], background.known[free]


def hidden_when_open():
    camera = Camera.from_config(CONFIG)
    gripper, config = load_gripper(), load_detector_config()
    return FingerMask(camera, 2, gripper.geometry.outer_radius_m + config.finger_margin_m, 0.0).of(OPEN)


def test_while_fingers_move_the_table_is_learnt_where_they_are_not():
    _, error, known = learnt(0.0, 15.0, 40.0, 80.0, 30.0)
    assert known.mean() > 0.995
    assert np.quantile(error, 0.999) < 8.0
    _, error, _ = learnt(0.0, 15.0, 40.0, 80.0, 30.0, told=False)
    assert np.quantile(error, 0.95) > 20.0


def test_over_a_table_learnt_under_moving_fingers_nothing_but_the_object_is_seen():
    detector, _, _ = learnt(0.0, 15.0, 40.0, 80.0, 30.0)
    ball = ColouredSolid("sphere", (0.05,) * 3, (0.0, 0.0, 0.105), (0.0, 0.0, 0.0, 1.0), (0.1, 0.3, 0.7))
    view = SceneView(0.13, (ball,), closing(0.0))
    intrinsics = camera_intrinsics(CONFIG)
    (found,) = detector.detect(RENDERER.render(view, np.random.default_rng(1)), "rgb8", intrinsics, None, 0.13)
    assert found.source == "background" and found.size_m == pytest.approx(ball.size_m, abs=0.003)


def test_a_table_that_fingers_hid_in_all_images_is_refused_with_its_share_and_the_one_before_stands():
    detector, _, _ = learnt(0.0)
    before = detector.background
    fingers = [closing(80.0), closing(82.0)]
    frames = [RENDERER.render(SceneView(0.13, (), lines)) for lines in fingers]
    with pytest.raises(BackgroundError, match=r"fingers hid \d+\.\d% of .* in all of 2 images; .*let them move"):
        detector.learn_background(frames, "rgb8", camera_intrinsics(CONFIG), None, fingers)
    assert detector.background is before
