"""Standard messages to SI arrays and back."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState

from mbpam_ros.nodes.messages import (
    MessageError,
    floats,
    joint_state,
    named_values,
    pose,
    pose_arrays,
    seconds,
    time_stamp,
)

NAMES = ("a", "b", "c", "d", "e")
STAMP = Time(sec=3, nanosec=250_000_000)


@pytest.mark.parametrize(
    "time_s, sec, nanosec", [(0.0, 0, 0), (3.25, 3, 250_000_000), (0.1, 0, 100_000_000), (0.9999999999, 1, 0)]
)
def test_a_time_stamp_is_rounded_to_the_nanosecond(time_s, sec, nanosec):
    assert time_stamp(time_s) == Time(sec=sec, nanosec=nanosec)


@pytest.mark.parametrize("tick", [1, 7, 333, 123456])
def test_a_tick_of_10_ms_survives_the_way_there_and_back(tick):
    stamp = time_stamp(0.01 * tick)
    assert stamp.sec * 100 + stamp.nanosec // 10_000_000 == tick
    assert stamp.nanosec % 10_000_000 == 0
    assert seconds(stamp) == pytest.approx(0.01 * tick, abs=1e-9)


def test_floats_take_any_numbers_in_any_memory_order():
    assert list(floats([1, True, 2.5])) == [1.0, 1.0, 2.5]
    assert list(floats(np.arange(6, dtype=np.float32)[::2])) == [0.0, 2.0, 4.0]
    assert floats([]).typecode == "d"


def test_a_joint_state_keeps_empty_what_is_not_given():
    message = joint_state(STAMP, NAMES, effort=np.arange(5))
    assert message.header.stamp == STAMP
    assert list(message.name) == list(NAMES)
    assert list(message.effort) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert not message.position and not message.velocity


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
def test_values_come_back_in_the_wanted_order_whatever_the_order_they_came_in(field):
    values = np.array([4.0, math.nan, 2.0, math.inf, 0.0])
    straight = joint_state(STAMP, NAMES, **{field: values})
    np.testing.assert_array_equal(named_values(straight, NAMES, field), values)
    backward = joint_state(STAMP, NAMES[::-1], **{field: values[::-1]})
    np.testing.assert_array_equal(named_values(backward, NAMES, field), values)


def test_the_values_are_a_copy():
    message = joint_state(STAMP, NAMES, effort=np.zeros(5))
    named_values(message, NAMES, "effort")[0] = 1.0
    assert message.effort[0] == 0.0


@pytest.mark.parametrize(
    "names, count, complaint",
    [
        ("abcde", 4, "5 names but 4 values in effort"),
        ("abcde", 6, "5 names but 6 values in effort"),
        ("abcde", 0, "5 names but 0 values in effort"),
        ("", 5, "0 names but 5 values in effort"),
        ("", 0, "missing names: a, b, c and 2 more"),
        ("abcdf", 5, "unknown names: f; expected a .. e"),
        ("abcdef", 6, "unknown names: f"),
        ("abcd", 4, "missing names: e"),
        ("abcdd", 5, "missing names: e"),
        ("abcdee", 6, "6 names, some of them twice, for 5 channels"),
        ("vwxyz", 5, "unknown names: v, w, x and 2 more"),
    ],
)
def test_wrong_names_and_lengths_are_refused_with_what_is_wrong(names, count, complaint):
    message = JointState(name=list(names), effort=[0.0] * count)
    with pytest.raises(MessageError, match=complaint):
        named_values(message, NAMES, "effort")


def test_a_pose_survives_the_way_there_and_back_and_its_quaternion_gets_length_one():
    position, orientation = pose_arrays(pose((1, 2.5, -3), (0.0, 0.0, 3.0, 4.0)))
    np.testing.assert_array_equal(position, [1.0, 2.5, -3.0])
    np.testing.assert_allclose(orientation, [0.0, 0.0, 0.6, 0.8])


@pytest.mark.parametrize(
    "message",
    [
        Pose(position=Point(x=math.nan)),
        Pose(position=Point(z=-math.inf)),
        Pose(orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)),
        Pose(orientation=Quaternion(x=math.nan, w=1.0)),
        Pose(orientation=Quaternion(x=math.inf, w=1.0)),
    ],
    ids=["NaN", "infinity", "no length", "NaN in the quaternion", "infinity in the quaternion"],
)
def test_a_pose_that_is_none_is_refused(message):
    with pytest.raises(MessageError, match="pose"):
        pose_arrays(message)
