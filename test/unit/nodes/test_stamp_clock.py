"""One time line from stamps and the node's clock."""

import math

import pytest

from mbpam_ros.nodes.messages import MessageError
from mbpam_ros.nodes.stamps import StampClock, StampError, stamp_age


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


def compared():
    return StampClock(oldest_s=0.2, tolerance_s=0.1)


def test_age_is_by_the_stamp_within_the_clocks_tolerance():
    assert stamp_age(100.0, 100.05, 0.2, 0.1) == pytest.approx(0.05)
    assert stamp_age(100.0, 99.95, 0.2, 0.1) == 0.0
    assert stamp_age(100.0, 100.29, 0.2, 0.1) == pytest.approx(0.29)
    assert stamp_age(100.0, 1e9, 0.2, tolerance_s=0.0) == 0.0
    assert stamp_age(100.0, 0.0, 0.2, 0.1) == 0.0  # simulated time has not begun


@pytest.mark.parametrize(
    ("stamp_s", "said"),
    [
        (1e9 - 0.5, "stamped 0.50 s ago .* clock is behind; synchronise"),
        (1e9 - 3600.0, "stamped 1.00 h ago"),
        (1e9 + 3600.0, "stamped 1.00 h in the future: its sender's clock is ahead; synchronise"),
        (0.0, "no stamp .1970."),
    ],
)
def test_a_sample_too_old_or_of_another_clock_is_refused_in_one_line(stamp_s, said):
    clock = compared()
    with pytest.raises(StampError, match=said) as refusal:
        clock.sample(stamp_s, now_s=5.0, clock_s=1e9)
    assert "\n" not in str(refusal.value)
    assert clock.age(5.0) == math.inf


def test_a_sample_overtaken_by_a_later_one_is_refused_and_changes_nothing():
    clock = compared()
    clock.sample(100.00, now_s=5.00, clock_s=100.00)
    clock.sample(100.02, now_s=5.02, clock_s=100.02)
    with pytest.raises(MessageError, match="10 ms behind a later one: overtaken"):
        clock.sample(100.01, now_s=5.03, clock_s=100.03)
    assert clock.sample(100.03, now_s=5.04, clock_s=100.04) == 100.03


def test_with_its_clock_set_back_a_source_is_followed_at_once():
    clock = compared()
    clock.sample(100.0, now_s=5.0, clock_s=100.0)
    assert clock.sample(0.01, now_s=5.01, clock_s=0.01) == 0.01


def test_of_set_points_the_order_alone_counts():
    clock = compared()
    clock.order(50.0, clock_s=100.0)
    clock.order(50.0, clock_s=100.0)
    with pytest.raises(MessageError, match="overtaken"):
        clock.order(49.0, clock_s=100.0)
    clock.order(3.0, clock_s=2.0)  # the clock was set back
