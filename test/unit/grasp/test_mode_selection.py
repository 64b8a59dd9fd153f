"""Which mode, which turn and which wrist pose an object gets, and which objects are refused."""

import dataclasses
import math
import re

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.selection import DetectedObject, GraspChoice, ModeSelector, Refusal
from mbpam_ros.gripper import load_gripper

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def selector():
    return ModeSelector(load_grasp_config().selection, load_gripper(), load_modes())


def lying(yaw_rad):
    """Quaternion that lays body z down along the horizontal direction at azimuth ``yaw_rad``, body x pointing up."""
    # Rotation about y by 90 deg takes z to x (and x to -z); then yaw about z.
    half, quarter = yaw_rad / 2.0, math.pi / 4.0
    return (
        -math.sin(half) * math.sin(quarter),
        math.cos(half) * math.sin(quarter),
        math.sin(half) * math.cos(quarter),
        math.cos(half) * math.cos(quarter),
    )


def seen(shape="sphere", size_m=(0.06, 0.06, 0.06), yaw_deg=90.0, **others):
    orientation = UPRIGHT if shape == "sphere" else lying(math.radians(yaw_deg))
    values = {"label": shape, "position_m": (0.0, 0.0, 0.09), "orientation_xyzw": orientation, "confidence": 0.9}
    return DetectedObject(**{"shape": shape, "size_m": size_m, **values, **others})


def rod(yaw_deg=90.0, **others):
    return seen("cylinder", (0.035, 0.035, 0.18), yaw_deg, **others)


@pytest.mark.parametrize(
    ("target", "mode"),
    [
        (seen("sphere", (0.07, 0.07, 0.07), label="tomato"), "envelope"),
        (seen("sphere", (0.06, 0.06, 0.06), label="bulb"), "envelope"),
        (seen("cylinder", (0.035, 0.035, 0.180), label="banana"), "short_rod"),
        (seen("cylinder", (0.020, 0.020, 0.250), label="tube"), "slender_rod"),
        (seen("box", (0.060, 0.035, 0.120), label="carton"), "mid_rod"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.label,
)
def test_the_papers_objects_get_the_papers_modes_even_when_measured_5_mm_wrong(selector, target, mode):
    for error_m in (-0.005, 0.0, 0.005):
        measured = dataclasses.replace(target, size_m=tuple(size + error_m for size in target.size_m))
        choice = selector.select(measured)
        assert isinstance(choice, GraspChoice), choice
        assert (choice.mode, choice.quarter_turns, choice.mirrored) == (mode, 0, False)
        assert choice.wrist_rotation_rad == pytest.approx(0.0, abs=1e-12)


def test_a_rod_seen_in_part_is_judged_by_the_length_it_is_likely_to_have(selector):
    part = (0.02, 0.02, 0.13)
    assert selector.select(seen("cylinder", part)).mode == "short_rod"
    assert selector.select(seen("cylinder", part, hidden_m=(0.02, 0.0))).mode == "short_rod"
    choice = selector.select(seen("cylinder", part, hidden_m=(0.1, 0.0)))
    assert choice.mode == "slender_rod" and "6.5 to 11.5 (seen in part)" in choice.reason


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 35.0])
def test_a_rod_seen_in_part_is_taken_where_its_centre_may_be_nearest_to_the_palm(selector, yaw_deg):
    """Its middle lies 50 mm along its axis from the palm's, but the end that is hidden may be as much farther."""
    along = np.array([math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))])
    place = (*(0.05 * along), 0.09)
    size = (0.02, 0.02, 0.18)
    assert isinstance(selector.select(seen("cylinder", size, yaw_deg, position_m=place)), Refusal)
    away = seen("cylinder", size, yaw_deg, position_m=place, hidden_m=(0.0, 0.2))
    assert isinstance(selector.select(away), Refusal)
    toward = seen("cylinder", size, yaw_deg, position_m=place, hidden_m=(0.06, 0.0))
    choice = selector.select(toward)
    assert choice.wrist_pose.position_m[:2] == pytest.approx(tuple(0.02 * along))


def test_a_hidden_length_must_not_be_negative():
    with pytest.raises(ValueError, match="hidden_m"):
        rod(hidden_m=(-0.1, 0.0))


@pytest.mark.parametrize(("length_m", "mode"), [(0.1599, "short_rod"), (0.1601, "slender_rod")])
def test_slenderness_8_divides_short_rods_from_slender_ones(selector, length_m, mode):
    assert selector.select(seen("cylinder", (0.02, 0.02, length_m))).mode == mode


def test_a_cylinder_standing_upright_is_round_from_above(selector):
    choice = selector.select(seen("cylinder", (0.07, 0.07, 0.10), orientation_xyzw=UPRIGHT))
    assert (choice.mode, choice.wrist_rotation_rad) == ("envelope", 0.0)


def test_a_box_standing_on_its_small_face_is_held_along_its_longer_horizontal_side(selector):
    choice = selector.select(seen("box", (0.04, 0.06, 0.12), orientation_xyzw=UPRIGHT))
    assert (choice.mode, choice.quarter_turns) == ("mid_rod", 0)
    turned = selector.select(seen("box", (0.06, 0.04, 0.12), orientation_xyzw=UPRIGHT))
    assert (turned.mode, turned.quarter_turns) == ("mid_rod", 1)


@pytest.mark.parametrize(
    ("yaw_deg", "turns", "left_deg"),
    [
        (90.0, 0, 0.0),
        (120.0, 0, 30.0),
        (60.0, 0, -30.0),
        (0.0, 1, 0.0),
        (20.0, 1, 20.0),
        (-20.0, 1, -20.0),
        (160.0, 1, -20.0),
        (270.0, 0, 0.0),
        (225.5, 0, -44.5),
        (134.5, 0, 44.5),
        (135.5, 1, -44.5),
    ],
)
def test_the_turn_nearest_to_the_rod_is_taken_and_the_rest_is_left_to_the_wrist(selector, yaw_deg, turns, left_deg):
    choice = selector.select(rod(yaw_deg))
    assert choice.quarter_turns == turns
    assert math.degrees(choice.wrist_rotation_rad) == pytest.approx(left_deg, abs=1e-9)


@pytest.mark.parametrize("yaw_deg", range(-180, 181, 7))
def test_the_wrist_pose_lines_the_modes_rod_axis_up_with_the_object(selector, yaw_deg):
    target = rod(float(yaw_deg), position_m=(0.012, -0.007, 0.1))
    choice = selector.select(target)
    pose = choice.wrist_pose
    turned = 2.0 * math.atan2(pose.orientation_xyzw[2], pose.orientation_xyzw[3])
    axis_azimuth = math.radians(90.0 + 90.0 * choice.quarter_turns) + turned
    assert math.sin(axis_azimuth - math.radians(yaw_deg)) == pytest.approx(0.0, abs=1e-9)
    assert -math.pi / 4 - 1e-9 < choice.wrist_rotation_rad <= math.pi / 4 + 1e-9
    assert pose.position_m == (0.012, -0.007, 0.0)
    assert pose.orientation_xyzw[:2] == (0.0, 0.0)
    assert np.linalg.norm(pose.orientation_xyzw) == pytest.approx(1.0)


@pytest.mark.parametrize("yaw_deg", [90.0, 94.0, 86.0])
def test_near_alignment_the_plain_mode_stays(selector, yaw_deg):
    assert not selector.select(rod(yaw_deg)).mirrored


@pytest.mark.parametrize("shape", ["cylinder", "box"])
@pytest.mark.parametrize("left_deg", [-30.0, 30.0])
@pytest.mark.parametrize("axis_deg", [0.0, 90.0])
def test_a_skew_rod_gets_the_mirror_whose_fingers_turn_it_toward_the_axis(selector, shape, left_deg, axis_deg):
    size_m = (0.035, 0.035, 0.18)
    choice = selector.select(seen(shape, size_m, axis_deg + left_deg))
    mode = load_modes()[choice.mode]
    couple = (mode.mirrored() if choice.mirrored else mode).yaw_couple
    assert couple * left_deg <= 1e-9
    assert choice.mirrored == (shape == "cylinder" and left_deg > 0.0)


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (seen(size_m=(0.085,) * 3), "sphere: too wide by 1.0 mm: 85.0 mm, 84.0 mm fit between the straight fingers"),
        (seen("box", (0.035, 0.06, 0.12)), "box: too wide by 5.3 mm: 60.0 mm, 54.7 mm fit"),
        (seen("cylinder", (0.055, 0.055, 0.2)), "cylinder: too wide by 0.3 mm"),
        (seen("cylinder", (0.03, 0.03, 0.04)), "missed by the closing fingers: finger 1 by 5.4 mm, finger 3 by 5.4 mm"),
        (seen(size_m=(0.01,) * 3), "too thin: 10.0 mm, fingers that touch it would stand"),
        (seen(position_m=(0.03, 0.03, 0.09)), "too far off the axis by 12 mm: 42 mm, at most 30 mm"),
        (seen(confidence=0.3), "confidence 0.30 is less than 0.5"),
        (seen(size_m=(0.05,) * 3, position_m=(0.0, 0.0, 0.15)), "too deep by 5 mm: at 150 mm"),
        (seen(position_m=(0.0, 0.0, 0.3)), "missed by the closing fingers: finger 1 by 134.8 mm"),
        (seen(position_m=(0.0, 0.0, -0.09)), "too near: its top is 120 mm inside the palm"),
    ],
)
def test_objects_out_of_reach_are_refused_with_the_figure_that_decided(selector, target, reason):
    answer = selector.select(target)
    assert isinstance(answer, Refusal)
    assert reason in answer.reason


def test_nothing_in_view_is_refused(selector):
    assert selector.choose([]) == Refusal("no object in view")


def test_an_object_much_less_certain_than_another_is_passed_over(selector):
    near = seen(label="near", confidence=0.7)
    sure = seen(label="sure", confidence=0.95, position_m=(0.02, 0.0, 0.09))
    assert selector.choose([near, sure]).target is sure


def test_of_several_objects_the_nearest_that_can_be_grasped_is_taken_and_the_reason_names_the_others(selector):
    far = seen(label="far", confidence=0.95, position_m=(0.02, 0.0, 0.09))
    near = seen(label="near", confidence=0.9, position_m=(0.004, 0.0, 0.09))
    nearest = seen(label="wide", size_m=(0.2, 0.2, 0.2))
    choice = selector.choose([far, nearest, near])
    assert choice.target is near
    assert "nearest of 3, near at (4, 0) mm; not: far at (20, 0) mm; wide: too wide by 116.0 mm" in choice.reason


def test_an_object_that_cannot_be_grasped_does_not_keep_another_from_being_grasped(selector):
    wide = seen(label="wide", size_m=(0.2, 0.2, 0.2), confidence=1.0)
    assert selector.choose([wide, seen(label="bulb", confidence=0.6)]).target.label == "bulb"


def test_when_no_object_can_be_grasped_every_reason_is_told(selector):
    answer = selector.choose([seen(label="wide", size_m=(0.2, 0.2, 0.2)), seen(label="faint", confidence=0.1)])
    assert "wide: too wide" in answer.reason and "faint: confidence 0.10" in answer.reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": "cone"}, "shape 'cone' is none of sphere, cylinder, box"),
        ({"size_m": (0.06, -0.06, 0.06)}, "size must be positive"),
        ({"size_m": (0.06, 0.06)}, "size_m must hold 3 finite numbers"),
        ({"position_m": (0.0, math.nan, 0.1)}, "position_m must hold 3 finite numbers"),
        ({"orientation_xyzw": (0.0, 0.0, 0.0, 0.0)}, "zero quaternion"),
        ({"orientation_xyzw": (0.0, 0.0, math.inf, 0.0)}, "orientation_xyzw must hold 4 finite numbers"),
        ({"confidence": 1.2}, "confidence must lie in 0..1"),
        ({"confidence": math.nan}, "confidence must lie in 0..1"),
    ],
)
def test_a_malformed_detection_is_refused(change, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        dataclasses.replace(seen(), **change)


def test_a_quaternion_is_normalised():
    assert seen(orientation_xyzw=(0.0, 0.0, 0.0, 2.0)).orientation_xyzw == UPRIGHT


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"slenderness_min: \S+", "slenderness_min: -8.0", "slenderness_min must be greater than 0"),
        (r"confidence_min: \S+", "confidence_min: 1.5", "confidence_min and confidence_tie must lie in 0..1"),
        (
            r"table_depth_m: \S+",
            "depth_min_m: 0.2\n  depth_max_m: 0.1",
            "depth_min_m = 0.2 must be less than depth_max_m",
        ),
        (r"table_depth_m: \S+", "table_depth_m: -0.2", "table_depth_m must be greater than 0"),
        (r"mirror_above_deg: \S+", "mirror_above_deg: -1.0", "mirror_above_deg must not be negative"),
        (r"  offset_max_m: .*\n", "", "missing key offset_max_m"),
        (r"settle_dwell_s: \S+", "settle_dwell_s: 9.0", "settle_dwell_s must be less than close_timeout_s"),
        (r"pressure_stale_s: \S+", "pressure_stale_s: 0.0", "pressure_stale_s must be greater than 0"),
        (r"    envelope: \S+", "    envelope: -1.0", "envelope must be greater than 0"),
        (r"    envelope: \S+", "    hug: 1.0", "unknown key hug"),
    ],
)
def test_a_wrong_grasp_file_is_refused(tmp_path, pattern, replacement, message):
    text = config_path("grasp.yaml").read_text(encoding="utf-8")
    assert re.search(pattern, text)
    wrong = tmp_path / "grasp.yaml"
    wrong.write_text(re.sub(pattern, replacement, text, count=1), encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_grasp_config(wrong)


def test_limits_of_your_own_narrow_what_can_be_reached():
    config = dataclasses.replace(load_grasp_config().selection, width_min_m=0.05, depth_min_m=0.07, depth_max_m=0.1)
    selector = ModeSelector(config, load_gripper(), load_modes())
    assert isinstance(selector.select(seen()), GraspChoice)
    for target, reason in (
        (seen(size_m=(0.04,) * 3), "too small: 40.0 mm wide, at least 50 mm by the configuration"),
        (seen(position_m=(0.0, 0.0, 0.11)), "centre 110 mm below the palm, must be 70 to 100 mm by the configuration"),
    ):
        assert reason in selector.select(target).reason


def test_a_table_that_the_closing_fingers_would_hit_is_told_with_the_height_that_is_lacking():
    config = dataclasses.replace(load_grasp_config().selection, table_depth_m=0.125)
    answer = ModeSelector(config, load_gripper(), load_modes()).select(seen())
    assert re.search(r"the table is in the way: .* the table stands at 125 mm; raise the hand by \d mm", answer.reason)


def test_an_object_off_the_axis_is_judged_as_it_lies_once_the_wrist_is_lined_up(selector):
    off = rod(110.0, position_m=(0.02, -0.02, 0.07))
    assert isinstance(selector.select(off), GraspChoice)
