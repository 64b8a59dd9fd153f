import numpy as np
import pytest

from mbpam_ros.actuator.metamodel import PolynomialResponseSurface
from mbpam_ros.study.design.accuracy import Accuracy, JudgingError, leave_one_out
from mbpam_ros.study.design.samples import Samples


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


def test_leaving_out_is_the_known_formula_of_least_squares():
    samples = Samples.of_the_paper("doe_training.csv")
    theta = samples.responses["theta_max"]
    basis = PolynomialResponseSurface._basis(samples.design_mm)
    hat = basis @ np.linalg.pinv(basis)
    expected = theta - (theta - hat @ theta) / (1.0 - np.diag(hat))
    np.testing.assert_allclose(leave_one_out(PolynomialResponseSurface, samples.design_mm, theta), expected, rtol=1e-6)
