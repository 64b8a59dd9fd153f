"""The judge of the detector: the same scenes for the same seed, and figures that say what they say."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.selection import ModeSelector
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.judge.own import photograph_own, random_own_scene
from mbpam_ros.study.judge.scenes import KINDS, TABLES, random_scene
from mbpam_ros.study.judge.score import calibration_error, is_right, reliability, score_image, summary
from mbpam_ros.study.judge.tables import texture
from mbpam_ros.study.judge.tuning import fit_weights
from mbpam_ros.vision.confidence import probabilities
from mbpam_ros.vision.detector import Detection
from mbpam_ros.vision.region_fit import Hypothesis
from mbpam_ros.vision.solid_fit.outline import ROD

SELECTOR = ModeSelector(load_grasp_config().selection, load_gripper(), load_modes())


def rod_scene():
    """An own scene with a rod near the axis."""
    scenes = (random_own_scene(seed, "tune") for seed in range(100))
    return next(s for s in scenes if s.things[0].kind == "rod" and np.abs(s.things[0].position_m[:2]).max() < 0.015)


def seen(thing, confidence=0.9, **changes):
    truth = Detection(
        thing.shape,
        thing.size_m.copy(),
        thing.position_m.copy(),
        thing.rotation.as_quat(),
        confidence,
        "rod",
        np.zeros((3, 2)),
    )
    return replace(truth, **changes)


def test_the_two_sets_share_no_table_and_no_mesh():
    assert not set(TABLES["tune"]) & set(TABLES["report"])
    assert set(KINDS["tune"]) & set(KINDS["report"]) == {"ball", "rod", "post", "capsule", "box"}


def test_the_same_seed_gives_the_same_scene_and_the_same_image():
    first, again, other = random_scene(3, "tune"), random_scene(3, "tune"), random_scene(4, "tune")
    assert first.table == again.table and np.array_equal(first.things[0].size_m, again.things[0].size_m)
    assert not np.array_equal(first.things[0].position_m, other.things[0].position_m)
    images = [photograph_own(random_own_scene(1, "report")) for _ in range(2)]
    assert np.array_equal(images[0].image, images[1].image)
    assert np.array_equal(images[0].depth_m, images[1].depth_m, equal_nan=True)


@pytest.mark.parametrize("kind", sorted(TABLES["tune"]) + sorted(TABLES["report"]))
def test_every_table_has_a_texture(kind):
    tables = TABLES["tune"] if kind in TABLES["tune"] else TABLES["report"]
    image = texture(tables, kind, np.random.default_rng(0))
    assert image.dtype == np.uint8 and image.shape == (1024, 1024, 3) and 5 < image.mean() < 250


def test_the_truth_is_right_and_found():
    thing = rod_scene().things[0]
    score = score_image([thing], [seen(thing)], SELECTOR, 0.5)
    (item,) = score.objects
    assert item.found and item.right and item.mode_right and not item.wrong_mode and score.false_alarms == 0
    assert item.width_error_m == 0.0 and item.yaw_error_rad == pytest.approx(0.0, abs=1e-9)


def test_a_wrong_size_a_wrong_shape_and_nothing_are_told_apart():
    thing = rod_scene().things[0]
    thick = seen(thing, size_m=thing.size_m + (0.012, 0.012, 0.0))
    (item,) = score_image([thing], [thick], SELECTOR, 0.5).objects
    assert item.found and item.shape_right and not item.right and item.width_error_m == pytest.approx(0.012)
    (item,) = score_image([thing], [seen(thing, shape="box")], SELECTOR, 0.5).objects
    assert item.found and not item.shape_right
    (item,) = score_image([thing], [], SELECTOR, 0.5).objects
    assert not item.found and math.isnan(item.width_error_m) and not item.mode_right


def test_a_detection_of_nothing_is_a_false_alarm_if_it_is_sure():
    thing = rod_scene().things[0]
    elsewhere = thing.position_m + (0.3, 0.3, 0.0)
    assert score_image([thing], [seen(thing, position_m=elsewhere)], SELECTOR, 0.5).false_alarms == 1
    unsure = seen(thing, confidence=0.4, position_m=elsewhere)
    assert score_image([thing], [unsure], SELECTOR, 0.5).false_alarms == 0


def test_a_bound_is_right_if_the_truth_lies_within_it():
    thing = rod_scene().things[0]
    shorter, longer = thing.size_m - (0.0, 0.0, 0.05), thing.size_m + (0.0, 0.0, 0.05)

    def bounded(size_m, longer_by_m):
        return seen(thing, size_m=size_m, size_range_m=np.stack([size_m, size_m + (0.0, 0.0, longer_by_m)]))

    assert not is_right(thing, seen(thing, size_m=shorter))
    assert is_right(thing, bounded(shorter, 0.06))
    assert not is_right(thing, bounded(shorter, 0.03))
    assert not is_right(thing, bounded(longer, 0.2))


def test_the_summary_counts_and_calibration_compares():
    thing = rod_scene().things[0]
    scores = [score_image([thing], found, SELECTOR, 0.5) for found in ([seen(thing)], [])]
    assert summary(scores)["recall"] == 0.5 and summary(scores)["objects"] == 2
    bins = reliability([score_image([thing], [seen(thing, confidence=0.75)], SELECTOR, 0.5)])
    assert bins[0]["right"] == 1.0 and calibration_error(bins) == pytest.approx(0.25)


def hypothesis(misfit_px2):
    figures = dict.fromkeys(
        ("contour_px", "gap_sigmas", "visible", "coverage", "crease_coverage", "crease_misfit_px2", "overlap", "beyond")
        + (
            "shading",
            "size_sigma_m",
            "width_sigma_m",
            "height_m",
            "slim",
            "shadowy",
            "contour_px_lead",
            "misfit_px2_lead",
        )
        + ("shading_lead", "gap_sigmas_lead"),
        0.0,
    )
    return Hypothesis(ROD, np.zeros(5), np.zeros(5), np.zeros((3, 2)), {**figures, "misfit_px2": misfit_px2})


def test_fitted_weights_give_the_share_that_is_right():
    """Of small misfits four in five are right, of large ones one in five."""
    small, large = hypothesis(0.5), hypothesis(8.0)
    right = [i % 5 != 0 for i in range(100)] + [i % 5 == 0 for i in range(100)]
    weights = fit_weights([[small]] * 100 + [[large]] * 100, [[each] for each in right])
    assert probabilities([small], weights) == pytest.approx([0.8], abs=0.02)
    assert probabilities([large], weights) == pytest.approx([0.2], abs=0.02)
    both = probabilities([small, large], weights)
    assert sum(both) < 1.0 and both[0] < 0.8 and both[0] / both[1] == pytest.approx(16.0, rel=0.15)
