import numpy as np
import pytest

from mbpam_ros.study.design.accuracy import Accuracy, Coverage, JudgingError


def test_the_figures_of_a_case_by_hand():
    accuracy = Accuracy.of(np.array([1.0, 4.0, 3.0, 6.0]), np.array([2.0, 4.0, 4.0, 6.0]))
    assert accuracy.r2 == pytest.approx(1.0 - 2.0 / 8.0)
    assert accuracy.rmse == pytest.approx(np.sqrt(0.5))
    assert accuracy.rmse_normalised == pytest.approx(np.sqrt(0.5) / 4.0)
    assert (accuracy.mre, accuracy.mre_normalised, accuracy.mre_relative) == (1.0, 0.25, 0.5)


def test_an_error_relative_to_nothing_is_not_a_number_but_none():
    assert Accuracy.of(np.array([1.0, 1.0]), np.array([0.0, 2.0])).mre_relative is None


@pytest.mark.parametrize("expected", [[], [3.0, 3.0]])
def test_responses_that_do_not_vary_judge_nothing(expected):
    with pytest.raises(JudgingError, match="do not vary"):
        Accuracy.of(np.ones(len(expected)), np.array(expected))


def test_an_honest_deviation_covers_and_one_too_small_does_not():
    error = np.random.default_rng(2).normal(size=200)
    honest, narrow = (Coverage.of(error, np.full(200, sigma), "left out") for sigma in (1.0, 1.0 / 3.0))
    assert honest.covers and 0.9 < honest.rms_score < 1.1 and honest.text().endswith("it covers")
    assert not narrow.covers and narrow.rms_score == pytest.approx(3.0 * honest.rms_score)
    assert f"count on {narrow.rms_score:.1f} times as much" in narrow.text()


def test_what_is_within_two_deviations_is_counted():
    coverage = Coverage.of(np.array([0.1, -1.9, 2.1, 4.0]), np.array([1.0, 1.0, 1.0, 2.0]), "left out")
    assert (coverage.within_two, coverage.count) == (3, 4)


def test_few_errors_may_be_a_little_larger_than_their_deviation_and_many_may_not():
    few, many = (Coverage.of(np.full(count, 1.2), np.ones(count), "left out") for count in (10, 1000))
    assert few.covers and not many.covers
