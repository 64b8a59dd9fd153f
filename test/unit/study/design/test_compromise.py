import numpy as np
import pytest

from mbpam_ros.study.design.compromise import CompromiseError, knee, required_force, weighted
from mbpam_ros.study.design.pareto import Front

VALUES = np.array([[100.0, 0.70], [120.0, 0.69], [140.0, 0.66], [160.0, 0.60], [170.0, 0.50]])
FRONT = Front(np.zeros_like(VALUES), VALUES)


def test_the_knee_is_furthest_from_the_chord():
    low, spread = VALUES.min(axis=0), np.ptp(VALUES, axis=0)
    x, y = ((VALUES - low) / spread).T
    assert knee(FRONT) == np.argmax(np.abs(x + y - 1.0) / np.sqrt(2.0)) == 2


def test_weights_move_the_choice_from_force_to_angle():
    choices = [weighted(share, 1.0 - share)(FRONT) for share in (0.0, 0.2, 0.5, 0.8, 1.0)]
    assert choices == sorted(choices)
    assert choices[0] == 0 and choices[-1] == 4


def test_weights_reach_a_design_in_a_hollow():
    hollow = Front(np.zeros((3, 2)), np.array([[0.0, 1.0], [0.4, 0.4], [1.0, 0.0]]))
    assert weighted(1.0, 1.0)(hollow) == 1


@pytest.mark.parametrize("weights", [(0.0, 0.0), (-1.0, 2.0), (np.nan, 1.0)])
def test_weights_that_weigh_nothing_are_refused(weights):
    with pytest.raises(CompromiseError, match="weights"):
        weighted(*weights)


def test_a_required_force_takes_the_largest_angle_that_has_it():
    assert required_force(0.6)(FRONT) == 3
    assert required_force(0.0)(FRONT) == 4
    with pytest.raises(CompromiseError, match="largest force possible is 0.7000 N"):
        required_force(0.71)(FRONT)


@pytest.mark.parametrize("force", [float("nan"), float("inf"), -0.1])
def test_a_required_force_that_is_none_is_refused(force):
    with pytest.raises(CompromiseError, match="a number that is not negative"):
        required_force(force)
