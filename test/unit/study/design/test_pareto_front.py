import numpy as np
import pytest

from mbpam_ros.actuator.design import DesignDomain
from mbpam_ros.study.design.pareto import Front, FrontError, grid_front, hypervolume_ratio, non_dominated

UNIT = DesignDomain((0.0, 1.0), (0.0, 1.0))


def front_of(*values):
    rows = np.array(values, dtype=float)
    return Front.of(np.zeros_like(rows), rows)


def test_the_front_is_what_nothing_else_beats():
    rng = np.random.default_rng(0)
    values = rng.integers(0, 12, size=(200, 2)).astype(float)
    kept = set(map(tuple, values[non_dominated(values)]))
    beaten = {tuple(row) for row in values if any(np.all(other >= row) and np.any(other > row) for other in values)}
    assert kept == set(map(tuple, values)) - beaten
    assert len(non_dominated(values)) == len(kept)


def test_rows_that_are_not_finite_are_on_no_front():
    values = np.array([[np.nan, 9.0], [-np.inf, -np.inf], [1.0, 1.0], [np.inf, 2.0]])
    assert non_dominated(values).tolist() == [2]
    assert non_dominated(values[:2]).size == 0


def test_the_front_goes_from_strong_to_far():
    front = front_of([1.0, 5.0], [3.0, 1.0], [2.0, 4.0], [2.0, 2.0])
    assert front.values.tolist() == [[1.0, 5.0], [2.0, 4.0], [3.0, 1.0]]


def test_hypervolume_is_the_union_of_the_rectangles():
    front = front_of([1.0, 5.0], [2.0, 4.0], [3.0, 1.0])
    assert front.hypervolume(np.zeros(2)) == 1.0 * 5.0 + 1.0 * 4.0 + 1.0 * 1.0
    assert front.hypervolume(np.array([1.0, 1.0])) == 1.0 * 3.0
    assert front.hypervolume(np.array([9.0, 9.0])) == 0.0


def test_hypervolume_meets_random_darts():
    rng = np.random.default_rng(1)
    front = front_of(*rng.uniform(size=(30, 2)))
    darts = rng.uniform(size=(20_000, 2))
    hit = np.any(np.all(darts[:, None] <= front.values, axis=2), axis=1)
    assert front.hypervolume(np.zeros(2)) == pytest.approx(hit.mean(), abs=4.0 * np.sqrt(0.25 / len(darts)))


def test_values_between_designs_are_linear_and_off_the_ends_unknown():
    front = front_of([1.0, 5.0], [2.0, 4.0], [4.0, 1.0])
    assert front.second_at_first(3.0) == pytest.approx(2.5)
    assert front.first_at_second(2.5) == pytest.approx(3.0)
    assert front.second_at_first(0.9) is None and front.second_at_first(4.1) is None
    assert front.first_at_second(0.9) is None and front.first_at_second(5.1) is None


def test_a_grids_front_is_the_known_one():
    # x + y at fixed sum: f1 = a, f2 = 1 - a - b has its front at b = 0.
    front = grid_front(lambda design: np.column_stack([design[:, 0], 1.0 - design.sum(axis=1)]), UNIT, 11)
    np.testing.assert_allclose(front.design_mm, np.column_stack([np.linspace(0.0, 1.0, 11), np.zeros(11)]))


def test_half_the_front_covers_less():
    whole = front_of(*[[x, 1.0 - x**2] for x in np.linspace(0.0, 1.0, 50)])
    half = Front(whole.design_mm[:25], whole.values[:25])
    assert hypervolume_ratio(whole, whole) == 1.0
    assert hypervolume_ratio(half, whole) < 0.8


def test_one_best_design_leaves_no_trade_off_to_judge():
    with pytest.raises(FrontError, match="no trade-off"):
        hypervolume_ratio(front_of([1.0, 1.0]), front_of([2.0, 2.0]))
