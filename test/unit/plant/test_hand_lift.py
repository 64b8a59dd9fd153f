"""The hand's way up and down."""

import numpy as np
import pytest

from mbpam_ros.plant.lift import HandLift, LiftConfig

CONFIG = LiftConfig(height_m=0.1, duration_s=1.0)


def test_the_hand_goes_from_rest_to_rest_over_its_height():
    hand = HandLift(CONFIG)
    assert hand.raise_hand(2.0).accepted
    height, velocity = hand.motion([0.0, 2.0, 2.5, 3.0, 9.0])
    np.testing.assert_allclose(height, [0.0, 0.0, 0.05, 0.1, 0.1], atol=1e-15)
    np.testing.assert_allclose(velocity, [0.0, 0.0, 1.875 * 0.1, 0.0, 0.0], atol=1e-15)


def test_velocity_is_the_derivative_of_height():
    hand = HandLift(CONFIG)
    hand.raise_hand(0.0)
    times = np.linspace(0.05, 0.95, 19)
    slope = (hand.motion(times + 1e-6)[0] - hand.motion(times - 1e-6)[0]) / 2e-6
    np.testing.assert_allclose(hand.motion(times)[1], slope, rtol=1e-6)


def test_a_moving_hand_refuses_both_ways_and_says_for_how_long():
    hand = HandLift(CONFIG)
    hand.raise_hand(0.0)
    for answer in (hand.raise_hand(0.25), hand.lower_hand(0.25)):
        assert not answer.accepted
        assert "0.75 s" in answer.reason


def test_a_hand_that_is_there_refuses():
    hand = HandLift(CONFIG)
    assert "already down" in hand.lower_hand(0.0).reason
    hand.raise_hand(0.0)
    assert "already up" in hand.raise_hand(1.0).reason


def test_the_hand_comes_down_again():
    hand = HandLift(CONFIG)
    hand.raise_hand(0.0)
    assert hand.lower_hand(1.0).accepted
    assert hand.motion(1.5)[0] == pytest.approx(0.05)
    assert hand.motion(2.0)[0] == 0.0


@pytest.mark.parametrize("values", [(0.0, 1.0), (0.1, -1.0)])
def test_height_and_duration_must_be_positive(values):
    with pytest.raises(ValueError, match="greater than 0"):
        LiftConfig(*values)
