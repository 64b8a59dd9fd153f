"""The four grasp modes: which chambers they fill, and how they turn and mirror."""

import math
import re

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHAMBER_AZIMUTH_RAD
from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.grasp.modes import MODE_NAMES, GraspMode, load_modes
from mbpam_ros.gripper import load_gripper


@pytest.fixture(scope="module")
def modes():
    return load_modes()


def bend_directions(mode):
    azimuth = np.radians(mode.bend_azimuth_deg)
    return np.column_stack([np.cos(azimuth), np.sin(azimuth)])


@pytest.mark.parametrize(
    ("name", "azimuths", "chambers"),
    [
        ("envelope", (225, 315, 45, 135), [{1}, {2}, {3}, {4}]),
        ("short_rod", (180, 315, 0, 135), [{1, 4}, {2}, {2, 3}, {4}]),
        ("slender_rod", (135, 315, 315, 135), [{4}, {2}, {2}, {4}]),
        ("mid_rod", (180, 0, 0, 180), [{1, 4}, {2, 3}, {2, 3}, {1, 4}]),
    ],
)
def test_each_mode_fills_the_chambers_of_the_mode_table(modes, name, azimuths, chambers):
    setpoint_pa = modes[name].setpoints(100e3).reshape(4, 4)
    filled = [{int(chamber) + 1 for chamber in np.flatnonzero(finger)} for finger in setpoint_pa]
    assert modes[name].bend_azimuth_deg == azimuths
    assert filled == chambers
    assert set(np.unique(setpoint_pa)) == {0.0, 100e3}


def test_the_file_holds_the_four_modes_in_the_order_of_their_services(modes):
    assert tuple(modes) == MODE_NAMES == ("envelope", "short_rod", "slender_rod", "mid_rod")


@pytest.mark.parametrize("name", MODE_NAMES)
def test_filled_chambers_push_each_finger_exactly_toward_its_bend_azimuth(modes, name):
    filled = modes[name].setpoints(1.0).reshape(4, 4)
    push = -filled @ np.column_stack([np.cos(CHAMBER_AZIMUTH_RAD), np.sin(CHAMBER_AZIMUTH_RAD)])
    push /= np.linalg.norm(push, axis=1, keepdims=True)
    np.testing.assert_allclose(push, bend_directions(modes[name]), atol=1e-12)


def test_all_envelope_fingers_bend_to_the_palms_axis(modes):
    base = load_gripper().finger_base_m[:, :2]
    np.testing.assert_allclose(bend_directions(modes["envelope"]), -base / 0.05, atol=1e-12)


def test_paper_mode_1_bends_two_fingers_in_xz_and_two_at_minus_45_deg(modes):
    planes = sorted(azimuth % 180 for azimuth in modes["short_rod"].bend_azimuth_deg)
    assert planes == [0, 0, 135, 135]


def test_paper_mode_2_bends_all_fingers_at_minus_45_deg_and_neighbours_across_the_rod_oppose(modes):
    azimuth = modes["slender_rod"].bend_azimuth_deg
    assert {value % 180 for value in azimuth} == {135}
    assert (azimuth[0] - azimuth[1]) % 360 == (azimuth[2] - azimuth[3]) % 360 == 180


def test_paper_mode_3_bends_all_fingers_in_xz_toward_the_rod(modes):
    base_x = load_gripper().finger_base_m[:, 0]
    direction = bend_directions(modes["mid_rod"])
    np.testing.assert_allclose(direction[:, 0], -np.sign(base_x), atol=1e-12)
    np.testing.assert_allclose(direction[:, 1], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", MODE_NAMES)
@pytest.mark.parametrize("turns", [0, 1, 2, 3, -1, 7])
def test_a_turned_mode_is_the_mode_seen_from_a_turned_palm(modes, name, turns):
    """Rotate bases and directions as vectors: the finger that arrives at a base brings its direction along."""
    angle = turns * math.pi / 2.0
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    assert_moved_by(modes[name], modes[name].turned(turns), rotation)


@pytest.mark.parametrize("name", MODE_NAMES)
def test_a_mirrored_mode_is_the_mode_seen_in_the_xz_plane(modes, name):
    assert_moved_by(modes[name], modes[name].mirrored(), np.diag([1.0, -1.0]))


def assert_moved_by(mode, moved, transform):
    base = load_gripper().finger_base_m[:, :2]
    moved_base, moved_direction = base @ transform.T, bend_directions(mode) @ transform.T
    for finger in range(4):
        arrived_at = int(np.argmin(np.linalg.norm(base - moved_base[finger], axis=1)))
        np.testing.assert_allclose(bend_directions(moved)[arrived_at], moved_direction[finger], atol=1e-12)


@pytest.mark.parametrize("name", MODE_NAMES)
def test_four_quarter_turns_are_exactly_nothing(modes, name):
    turned = modes[name]
    for _ in range(4):
        turned = turned.turned(1)
    assert turned == modes[name] == modes[name].turned(4) == modes[name].turned(0)


@pytest.mark.parametrize("name", MODE_NAMES)
def test_two_mirrors_are_exactly_nothing(modes, name):
    assert modes[name].mirrored().mirrored() == modes[name]


@pytest.mark.parametrize("name", MODE_NAMES)
def test_mirror_after_a_turn_is_the_opposite_turn_after_the_mirror(modes, name):
    assert modes[name].turned(1).mirrored() == modes[name].mirrored().turned(-1)


@pytest.mark.parametrize("name", MODE_NAMES)
def test_half_a_turn_brings_every_mode_back_because_a_rod_has_no_sense(modes, name):
    assert modes[name].turned(2) == modes[name]


def test_rod_modes_differ_after_a_quarter_turn_and_the_envelope_does_not(modes):
    unchanged = {name for name in MODE_NAMES if modes[name].turned(1) == modes[name]}
    assert unchanged == {"envelope"}


def test_setpoints_of_a_posed_mode_are_those_of_the_mirrored_then_turned_mode(modes):
    mode = modes["short_rod"]
    np.testing.assert_array_equal(
        mode.setpoints(5e4, quarter_turns=1, mirrored=True), mode.mirrored().turned(1).setpoints(5e4)
    )
    assert not np.array_equal(mode.setpoints(5e4, quarter_turns=1), mode.setpoints(5e4))


def test_only_the_skew_modes_turn_the_object_and_their_mirror_turns_it_back(modes):
    couple = {name: modes[name].yaw_couple for name in MODE_NAMES}
    assert couple["envelope"] == pytest.approx(0.0, abs=1e-12)
    assert couple["mid_rod"] == pytest.approx(0.0, abs=1e-12)
    assert couple["slender_rod"] == pytest.approx(2.0)
    assert couple["short_rod"] == pytest.approx(math.sqrt(2.0))
    for name in MODE_NAMES:
        assert modes[name].mirrored().yaw_couple == pytest.approx(-couple[name], abs=1e-12)
        assert modes[name].turned(1).yaw_couple == pytest.approx(couple[name], abs=1e-12)


@pytest.mark.parametrize("pressure_pa", [-1.0, math.nan, math.inf])
def test_a_grip_pressure_that_is_no_pressure_is_refused(modes, pressure_pa):
    with pytest.raises(ValueError, match="grip pressure"):
        modes["envelope"].setpoints(pressure_pa)


def test_an_azimuth_beside_the_eight_directions_is_refused_with_its_finger():
    with pytest.raises(ValueError, match="finger 3: azimuth 30 deg"):
        GraspMode("own", (0.0, 45.0, 30.0, 90.0))


def test_azimuths_are_kept_within_one_turn():
    assert GraspMode("own", (-45.0, 360.0, 450.0, 0.0)).bend_azimuth_deg == (315.0, 0.0, 90.0, 0.0)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"  mid_rod: .*\n", "", "missing key mid_rod"),
        (r"  mid_rod:", "  long_rod:", "unknown key long_rod"),
        (
            r"\[225, 315, 45, 135\]",
            "[225, 315, 45, 130]",
            "envelope: finger 4: azimuth 130 deg is not a multiple of 45",
        ),
        (r"\[225, 315, 45, 135\]", "[225, 315, 45]", "expected 4 values, found 3"),
        (r"\[225, 315, 45, 135\]", "[225, 315, 45, .nan]", "finite"),
        (r"\Z", "speed: 1\n", "unknown key speed"),
    ],
)
def test_a_wrong_mode_file_is_refused_with_the_place(tmp_path, pattern, replacement, message):
    text = config_path("modes.yaml").read_text(encoding="utf-8")
    wrong = tmp_path / "modes.yaml"
    wrong.write_text(re.sub(pattern, replacement, text, count=1), encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_modes(wrong)
