"""One time line from stamps and the node's clock."""

import math

import pytest

from mbpam_ros.nodes.messages import MessageError
from mbpam_ros.nodes.stamps import StampClock


def test_before_the_first_sample_time_is_the_node_s_clock_and_the_sample_infinitely_old():
    clock = StampClock()
    assert clock.time(7.0) == 7.0
    assert clock.age(7.0) == math.inf


def test_samples_count_by_their_stamps_whenever_they_arrive():
    clock = StampClock()
    assert clock.sample(10.00, now_s=500.0) == 10.00
    assert clock.sample(10.01, now_s=500.9) == 10.01


def test_between_samples_time_goes_on_with_the_node_s_clock():
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    assert clock.age(500.3) == pytest.approx(0.3)
    assert clock.time(500.3) == pytest.approx(10.3)


def test_a_stamp_a_little_before_a_moment_already_reported_counts_as_that_moment():
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    reported = clock.time(500.3)
    assert clock.sample(10.25, now_s=500.31) == reported
    assert clock.sample(10.35, now_s=500.41) == 10.35


@pytest.mark.parametrize("jump_s", [0.25, 1.0, 60.0])
def test_a_node_s_clock_that_jumps_ahead_does_not_make_time_stand_still(jump_s):
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    assert clock.time(500.0 + jump_s) == pytest.approx(10.0 + jump_s)
    times = [clock.sample(10.0 + 0.01 * k, now_s=500.0 + jump_s + 0.01 * k) for k in range(1, 20)]
    assert times == [10.0 + 0.01 * k for k in range(1, 20)]


def test_silence_counts_from_the_moment_a_simulation_starts_anew():
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    assert clock.age(0.5) == 0.0
    assert clock.age(1.0) == 0.5


def test_time_does_not_go_back_between_samples():
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    assert clock.time(500.2) == pytest.approx(10.2)
    assert clock.time(500.1) == pytest.approx(10.2)
    assert clock.age(499.0) == 0.0


@pytest.mark.parametrize("back_to_s", [0.01, 99.0, 99.99])
def test_a_stamp_before_the_last_one_is_a_clock_set_back(back_to_s):
    clock = StampClock()
    clock.sample(100.0, now_s=500.0)
    assert clock.sample(back_to_s, now_s=500.1) == back_to_s
    assert clock.time(500.2) == pytest.approx(back_to_s + 0.1)


def test_the_same_stamp_again_is_no_sample_and_does_not_make_the_last_one_younger():
    clock = StampClock()
    clock.sample(10.0, now_s=500.0)
    with pytest.raises(MessageError, match="header.stamp stands still at 10.000 s"):
        clock.sample(10.0, now_s=500.1)
    assert clock.age(500.3) == pytest.approx(0.3)
