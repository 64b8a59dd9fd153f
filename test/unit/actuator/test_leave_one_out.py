"""Leaving samples out by closed form, against refits of weights and trend in plain linear algebra."""

import numpy as np
import pytest

from mbpam_ros.actuator import metamodel
from mbpam_ros.actuator.design import DesignDomain
from mbpam_ros.actuator.metamodel import (
    CORRELATIONS,
    METAMODELS,
    TRAINING_TABLE,
    TRENDS,
    GaussianRadialBasis,
    Kriging,
    MetamodelError,
    PolynomialResponseSurface,
    ThinPlateSpline,
    read_samples,
)

pytestmark = pytest.mark.slow

DESIGN, THETA, FORCE = read_samples(TRAINING_TABLE)
RESPONSES = pytest.mark.parametrize("response", [THETA, FORCE], ids=["theta", "force"])
EVERYONE = np.arange(len(DESIGN))


@pytest.fixture
def closed_form(monkeypatch):
    """As with many samples, where refits would cost too much."""
    monkeypatch.setattr(metamodel, "REFITTED_SAMPLES", 0)


def without_each():
    return [EVERYONE != row for row in EVERYONE]


@RESPONSES
@pytest.mark.parametrize("maker", [PolynomialResponseSurface, ThinPlateSpline])
def test_cubic_and_spline_without_a_sample_are_those_fitted_to_the_others(maker, response):
    left_out = maker().fit(DESIGN, response).leave_one_out()
    expected = [
        maker().fit(DESIGN[kept], response[kept]).predict(DESIGN[[row]])[0] for row, kept in enumerate(without_each())
    ]
    np.testing.assert_allclose(left_out.predicted, expected, rtol=1e-9)
    assert left_out.sigma is None and left_out.how == "closed form, as refits give"


@RESPONSES
def test_gaussians_without_a_sample_are_those_of_its_width_and_mean_through_the_others(response, closed_form):
    model = GaussianRadialBasis().fit(DESIGN, response)
    matrix, deviation = model._matrix(model.epsilon), response - response.mean()
    expected = [
        response.mean() + matrix[row, kept] @ np.linalg.solve(matrix[np.ix_(kept, kept)], deviation[kept])
        for row, kept in enumerate(without_each())
    ]
    left_out = model.leave_one_out()
    np.testing.assert_allclose(left_out.predicted, expected, rtol=0.0, atol=1e-7 * np.ptp(response))
    assert left_out.sigma is None and "width and mean of all samples" in left_out.how


@RESPONSES
@pytest.mark.parametrize("trend", TRENDS)
@pytest.mark.parametrize("correlation", CORRELATIONS)
def test_kriging_without_a_sample_is_kriging_of_the_others_with_its_length_scales(
    trend, correlation, response, closed_form
):
    model = Kriging(trend, correlation, nugget=1e-3).fit(DESIGN, response)
    matrix, basis = model._matrix(model.length_scales, model.nugget), model._basis(model._points)
    variance = model._state.variance * np.var(response)
    predicted, sigma = [], []
    for row, kept in enumerate(without_each()):
        inverse, cross = np.linalg.inv(matrix[np.ix_(kept, kept)]), matrix[row, kept]
        normal = np.linalg.inv(basis[kept].T @ inverse @ basis[kept])
        weights = normal @ basis[kept].T @ inverse @ response[kept]
        missed = basis[row] - cross @ inverse @ basis[kept]
        predicted.append(basis[row] @ weights + cross @ inverse @ (response[kept] - basis[kept] @ weights))
        sigma.append(np.sqrt(variance * (matrix[row, row] - cross @ inverse @ cross + missed @ normal @ missed)))
    left_out = model.leave_one_out()
    np.testing.assert_allclose(left_out.predicted, predicted, rtol=0.0, atol=1e-8 * np.ptp(response))
    np.testing.assert_allclose(left_out.sigma, sigma, rtol=1e-7)
    assert "length scales, nugget and variance of all samples" in left_out.how


@pytest.mark.parametrize("name", ["krg", "krg_nugget", "rbf_gaussian"])
def test_few_samples_are_left_out_by_fitting_anew(name):
    left_out = METAMODELS[name]().fit(DESIGN, FORCE).leave_one_out()
    assert left_out.how == "refits"
    for row in (0, 13):
        other = METAMODELS[name]().fit(DESIGN[EVERYONE != row], FORCE[EVERYONE != row])
        assert left_out.predicted[row] == pytest.approx(other.predict(DESIGN[[row]])[0], rel=1e-9)
        if left_out.sigma is not None:
            assert left_out.sigma[row] == pytest.approx(other.deviation(DESIGN[[row]])[0], rel=1e-9)


@pytest.mark.parametrize("name", METAMODELS)
def test_many_samples_are_left_out_without_a_refit(name, monkeypatch):
    design = np.random.default_rng(3).uniform(size=(metamodel.REFITTED_SAMPLES + 1, 2))
    maker = METAMODELS[name]
    model = maker(domain=DesignDomain((0.0, 1.0), (0.0, 1.0))).fit(design, np.sin(3.0 * design[:, 0]) + design[:, 1])
    fits = []
    monkeypatch.setattr(type(model), "_fit", lambda self: fits.append(self))
    left_out = model.leave_one_out()
    assert not fits and np.isfinite(left_out.predicted).all()


def test_with_many_samples_the_starts_of_kriging_run_on_some_of_them(monkeypatch):
    design = np.random.default_rng(3).uniform(size=(400, 2))
    sizes = []
    whole = Kriging._likelihood_loss

    def counted(self, log_parameters):
        sizes.append(len(self._values))
        return whole(self, log_parameters)

    monkeypatch.setattr(Kriging, "_likelihood_loss", counted)
    domain = DesignDomain((0.0, 1.0), (0.0, 1.0))
    model = Kriging(nugget=None, domain=domain).fit(design, np.sin(9.0 * design[:, 0]) * design[:, 1])
    assert set(sizes) == {Kriging._MOST_FOR_STARTS, 400}
    # and yet the parameters are the most likely for all of them
    log_parameters = np.log([*model.length_scales, model.nugget])
    best = whole(model, log_parameters)[0]
    for step in 0.1 * np.vstack([np.eye(3), -np.eye(3)])[:5]:
        inside = np.clip(log_parameters + step, None, np.log([20.0, 20.0, 0.1]))
        assert whole(model, inside)[0] >= best


def test_a_sample_that_the_others_cannot_do_without_is_named():
    design = read_samples("doe_validation.csv")[0]  # eight, as many as the cubic has coefficients
    model = PolynomialResponseSurface().fit(design, np.arange(8.0))
    with pytest.raises(MetamodelError, match=r"the sample a = .* mm cannot be left out"):
        model.leave_one_out()
    six = Kriging().fit(DESIGN[:6], THETA[:6])
    with pytest.raises(MetamodelError, match="cannot be left out: of the others, expected at least 6 designs"):
        six.leave_one_out()
