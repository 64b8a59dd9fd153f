"""Kriging and radial basis functions against independent implementations: scikit-learn, and SciPy's splines."""

import math

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from mbpam_ros.actuator.design import PAPER_DOMAIN
from mbpam_ros.actuator.metamodel import (
    CORRELATIONS,
    TRAINING_TABLE,
    TRENDS,
    GaussianRadialBasis,
    Kriging,
    ThinPlateSpline,
    read_samples,
)

pytestmark = pytest.mark.xdist_group("other_libraries")  # they are loaded once
DESIGN, THETA, FORCE = read_samples(TRAINING_TABLE)
SCALED = PAPER_DOMAIN.scale(DESIGN)
QUERY = np.random.default_rng(3).uniform([1.5, 1.0], [3.5, 3.0], size=(40, 2))
SCALED_QUERY = PAPER_DOMAIN.scale(QUERY)
RESPONSES = pytest.mark.parametrize("response", [THETA, FORCE], ids=["theta", "force"])
FLAT_PRIOR = 1e6
"""Variance of the trend's weights over the process's: with an infinite one a Gaussian process is universal kriging."""


@pytest.fixture(scope="module")
def processes():
    """Scikit-learn's Gaussian processes, loaded by the one worker that asks for them."""
    return pytest.importorskip("sklearn.gaussian_process")


def correlation_kernel(kernels, name, lengths):
    """Product over a and b, each factor blind to the other variable."""
    matern = kernels.Matern
    first, second = [lengths[0], 1e9], [1e9, lengths[1]]
    match name:
        case "gaussian":
            return kernels.RBF(lengths)
        case "exponential":
            return matern(first, nu=0.5) * matern(second, nu=0.5)
        case "matern32":
            return matern(first, nu=1.5) * matern(second, nu=1.5)
        case "matern52":
            return matern(first, nu=2.5) * matern(second, nu=2.5)


def trend_kernel(kernels, name):
    if name == "constant":
        return kernels.ConstantKernel(FLAT_PRIOR)
    return FLAT_PRIOR * kernels.DotProduct(sigma_0=1.0) ** {"linear": 1, "quadratic": 2}[name]


@RESPONSES
@pytest.mark.parametrize("trend", TRENDS)
@pytest.mark.parametrize("correlation", CORRELATIONS)
def test_kriging_is_scikit_learns_gaussian_process_with_a_flat_prior_on_its_trend(
    processes, response, trend, correlation
):
    model = Kriging(trend, correlation, nugget=1e-4).fit(DESIGN, response)
    sigma = model._spread * math.sqrt(model._state.variance)
    kernels = processes.kernels
    kernel = correlation_kernel(kernels, correlation, model.length_scales) + trend_kernel(kernels, trend)
    other = processes.GaussianProcessRegressor(kernel, alpha=model.nugget, optimizer=None).fit(SCALED, response / sigma)
    mean, deviation = other.predict(SCALED_QUERY, return_std=True)
    np.testing.assert_allclose(model.predict(QUERY), sigma * mean, rtol=0.0, atol=1e-4 * np.ptp(response))
    expected = sigma**2 * (deviation**2 + model.nugget)
    np.testing.assert_allclose(model.predict_variance(QUERY), expected, rtol=2e-3, atol=1e-6 * sigma**2)


@RESPONSES
def test_the_likelihood_is_scikit_learns(processes, response):
    model = Kriging(nugget=None).fit(DESIGN, response)
    state, count = model._state, len(response)
    kernel = processes.kernels.ConstantKernel(state.variance) * processes.kernels.RBF(model.length_scales)
    other = processes.GaussianProcessRegressor(kernel, alpha=state.variance * model.nugget, optimizer=None)
    other.fit(SCALED, (response - response.mean()) / response.std() - state.trend_weights[0])
    loss, _ = model._likelihood_loss(np.log([*model.length_scales, model.nugget]))
    expected = -other.log_marginal_likelihood_value_ - 0.5 * count * (1.0 + math.log(2.0 * math.pi))
    assert loss == pytest.approx(expected, abs=1e-6)


@RESPONSES
def test_gaussians_are_scikit_learns_kernel_ridge(response):
    ridge = pytest.importorskip("sklearn.kernel_ridge")
    model = GaussianRadialBasis().fit(DESIGN, response)
    other = ridge.KernelRidge(kernel="rbf", gamma=model.epsilon**2, alpha=1e-8).fit(SCALED, response - response.mean())
    expected = response.mean() + other.predict(SCALED_QUERY)
    np.testing.assert_allclose(model.predict(QUERY), expected, rtol=0.0, atol=1e-6 * np.ptp(response))


@RESPONSES
def test_the_thin_plate_spline_is_scipys(response):
    expected = RBFInterpolator(SCALED, response, kernel="thin_plate_spline", degree=1)(SCALED_QUERY)
    np.testing.assert_allclose(ThinPlateSpline().fit(DESIGN, response).predict(QUERY), expected, rtol=1e-9)
