import numpy as np
import pytest

from mbpam_ros.study.design.latin_hypercube import (
    RANGES,
    SamplingError,
    from_unit,
    optimal_latin_hypercube,
    space_filling,
    to_unit,
)
from mbpam_ros.study.design.samples import Samples

PLANE = ("a_mm", "b_mm")


@pytest.fixture(scope="module")
def optimal():
    return optimal_latin_hypercube(21, 2, seed=0, restarts=1)


def paper():
    return to_unit(Samples.of_the_paper("doe_training.csv").design_mm, PLANE)


def test_every_level_of_every_variable_is_taken_once_its_ends_included(optimal):
    four_variables = optimal_latin_hypercube(12, 4, seed=0, restarts=1)
    for column in (*optimal.T, *four_variables.T):
        np.testing.assert_allclose(np.sort(column), np.linspace(0.0, 1.0, len(column)))


def test_the_papers_points_are_such_a_hypercube():
    for column in paper().T:
        np.testing.assert_allclose(np.sort(column), np.linspace(0.0, 1.0, 21))


def test_the_same_seed_gives_the_same_bits_and_another_seed_other_points(optimal):
    assert optimal_latin_hypercube(21, 2, seed=0, restarts=1).tobytes() == optimal.tobytes()
    assert not np.array_equal(optimal_latin_hypercube(21, 2, seed=1, restarts=1), optimal)


def test_an_optimal_design_is_evener_than_the_papers_and_than_chance(optimal):
    discrepancy = space_filling(optimal).discrepancy
    assert discrepancy < space_filling(paper()).discrepancy
    rng = np.random.default_rng(0)
    shuffled = [np.column_stack([rng.permutation(21), rng.permutation(21)]) / 20.0 for _ in range(50)]
    assert discrepancy < min(space_filling(points).discrepancy for points in shuffled)


def test_more_restarts_do_not_bring_points_closer_together(optimal):
    more = space_filling(optimal_latin_hypercube(21, 2, seed=0, restarts=2))
    assert more.smallest_distance >= space_filling(optimal).smallest_distance


def test_figures_of_a_known_design():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    filling = space_filling(corners)
    assert filling.smallest_distance == 1.0
    # Hickernell's centred L2 discrepancy by hand: |x - 1/2| = 1/2 at all corners.
    one = 1.0 + 0.25 - 0.125
    same, opposite = 1.0 + 0.5, 1.0
    pairs = (4 * same**2 + 8 * same * opposite + 4 * opposite**2) / 16.0
    assert filling.discrepancy == pytest.approx((13.0 / 12.0) ** 2 - 2.0 * one**2 + pairs)


def test_scaling_goes_there_and_back_and_waves_are_whole():
    names = tuple(RANGES)
    unit = np.array([[0.0, 0.5, 1.0, 0.3], [1.0, 0.25, 0.0, 0.8]])
    points = from_unit(unit, names)
    np.testing.assert_allclose(points, [[1.5, 2.0, 3.0, 8.0], [3.5, 1.5, 1.0, 12.0]])
    np.testing.assert_allclose(to_unit(points, names)[:, :3], unit[:, :3])


@pytest.mark.parametrize(("count", "variables", "restarts"), [(1, 2, 1), (5, 1, 1), (5, 2, 0)])
def test_no_design_of_too_little(count, variables, restarts):
    with pytest.raises(SamplingError, match="at least 2 points, 2 variables and 1 restart"):
        optimal_latin_hypercube(count, variables, 0, restarts)


def test_points_that_cannot_be_judged_are_refused():
    with pytest.raises(SamplingError, match="two points"):
        space_filling(np.zeros((1, 2)))
    with pytest.raises(SamplingError, match="outside"):
        space_filling(np.array([[0.0, 0.0], [1.1, 0.0]]))
