"""Lanes: compiled they are what they are in Python, to the last bit, and each is what it is alone."""

import numpy as np
import pytest

from mbpam_ros.plant.mechanics.kernel import entry
from mbpam_ros.plant.mechanics.lanes import WIDTH, all_above, any_above, lane, load, splat, store, with_lane


@entry
def compute(values, answers):
    x, y = load(values, (0, 1)), load(values, (1, 0))
    total = splat(0.0)
    for i in range(3):
        total = total + 0.3 * x * y / (y + 1.0) - -x * float(i) + (2.0 - y) - 1.0 / y
    store(answers, (0,), total)
    store(answers, (1,), with_lane(x, 2, lane(y, 3)))


@entry
def compare(values, limit):
    return any_above(load(values, (0,)), limit), all_above(load(values, (0,)), limit)


def test_compiled_and_in_python_lanes_have_the_same_bits_and_do_not_see_each_other():
    values = np.random.default_rng(7).uniform(0.5, 2.0, (2, 2, WIDTH))
    compiled, plain, backward = (np.zeros((2, WIDTH)) for _ in range(3))
    compute(values, compiled)
    compute.py_func(values, plain)
    compute(np.ascontiguousarray(values[..., ::-1]), backward)
    np.testing.assert_array_equal(compiled, plain)
    np.testing.assert_array_equal(backward[0], compiled[0, ::-1])
    np.testing.assert_array_equal(compiled[1], [*values[0, 1, :2], values[1, 0, 3], values[0, 1, 3]])


@pytest.mark.parametrize("run", [compare, compare.py_func])
def test_a_lane_that_is_no_number_is_not_above_anything(run):
    lanes = np.array([[1.0, 2.0, 3.0, 4.0]])
    assert run(lanes, 0.5) == (True, True)
    assert run(lanes, 3.5) == (True, False)
    assert run(lanes, 4.0) == (False, False)
    assert run(np.array([[np.nan, 2.0, 3.0, 4.0]]), 1.0) == (True, False)
