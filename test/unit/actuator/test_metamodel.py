import math

import numpy as np
import pytest

from mbpam_ros.actuator.design import DesignDomain, DesignDomainError, MuscleDesign
from mbpam_ros.actuator.metamodel import (
    CORRELATIONS,
    METAMODELS,
    TRAINING_TABLE,
    TRENDS,
    VALIDATION_TABLE,
    GaussianRadialBasis,
    Kriging,
    MetamodelError,
    PolynomialResponseSurface,
    ThinPlateSpline,
    load_metamodel,
    read_samples,
)

# Paper, Table 3: RMSE and largest absolute error over the range of the validation responses.
PUBLISHED = {
    ("prs", "theta"): (0.0184, 0.0340),
    ("rbf", "theta"): (0.0337, 0.0849),
    ("krg", "theta"): (0.0399, 0.0826),
    ("prs", "force"): (0.0511, 0.0982),
    ("rbf", "force"): (0.0678, 0.1333),
    ("krg", "force"): (0.0669, 0.1345),
}
EQ_9 = [-329.2005, 339.6515, 203.7575, -118.5423, -69.3005, -17.2730, 16.9488, 7.4029]
EQ_10 = [-0.6614, 0.8489, 1.2680, -0.3633, -0.5750, -0.0491, 0.0475, 0.0809]


def validation_errors(name, response):
    design, theta, force = read_samples(VALIDATION_TABLE)
    model = load_metamodel(name)
    if response == "theta":
        return (model.theta_max_deg.predict(design) - theta) / np.ptp(theta)
    return (model.f_max_n.predict(design) - force) / np.ptp(force)


@pytest.mark.parametrize(("name", "response"), PUBLISHED)
def test_each_metamodel_is_as_accurate_as_the_published_one(name, response):
    error = validation_errors(name, response)
    rmse, largest = PUBLISHED[name, response]
    assert np.sqrt(np.mean(error**2)) < 1.05 * rmse
    assert np.abs(error).max() < 1.10 * largest


def test_the_response_surface_returns_the_papers_coefficients():
    model = load_metamodel("prs")
    np.testing.assert_allclose(model.theta_max_deg.coefficients, EQ_9, rtol=1e-4)
    np.testing.assert_allclose(model.f_max_n.coefficients, EQ_10, rtol=2e-3)


def test_the_response_surface_returns_the_papers_errors():
    assert np.sqrt(np.mean(validation_errors("prs", "theta") ** 2)) == pytest.approx(0.0184, abs=5e-5)
    assert np.sqrt(np.mean(validation_errors("prs", "force") ** 2)) == pytest.approx(0.0511, abs=1e-4)
    assert np.abs(validation_errors("prs", "theta")).max() == pytest.approx(0.0340, abs=1e-4)


def test_sigma_is_the_validation_error_in_physical_units():
    performance = load_metamodel("prs").predict(MuscleDesign(2.5, 2.0))
    assert math.degrees(performance.theta_max_sigma_rad) == pytest.approx(1.88, abs=0.01)
    assert performance.f_max_sigma_n == pytest.approx(0.0202, abs=1e-4)


@pytest.mark.parametrize("name", METAMODELS)
def test_performance_at_the_initial_design_is_the_finite_element_one_within_two_sigma(name):
    performance = load_metamodel(name).predict(MuscleDesign(2.5, 2.0))
    assert abs(performance.theta_max_rad - math.radians(148.423)) < 2.0 * performance.theta_max_sigma_rad
    assert abs(performance.f_max_n - 0.6036) < 2.0 * performance.f_max_sigma_n


@pytest.mark.parametrize("name", ["rbf", "krg"])
def test_an_interpolating_metamodel_returns_its_samples(name):
    design, theta, force = read_samples(TRAINING_TABLE)
    model = load_metamodel(name)
    np.testing.assert_allclose(model.theta_max_deg.predict(design), theta, rtol=1e-7)
    np.testing.assert_allclose(model.f_max_n.predict(design), force, rtol=1e-7)


def test_gaussians_return_their_samples_up_to_the_ridge():
    design, theta, force = read_samples(TRAINING_TABLE)
    model = load_metamodel("rbf_gaussian")
    np.testing.assert_allclose(model.theta_max_deg.predict(design), theta, rtol=4e-3)
    np.testing.assert_allclose(model.f_max_n.predict(design), force, rtol=1e-6)


def test_a_thin_plate_spline_returns_any_plane_and_has_weights_orthogonal_to_planes():
    design, theta, _ = read_samples(TRAINING_TABLE)
    a, b = design.T
    plane = ThinPlateSpline().fit(design, 1.0 - 2.0 * a + 3.0 * b)
    assert plane.predict([[1.6, 2.9]])[0] == pytest.approx(1.0 - 3.2 + 8.7)
    weights = ThinPlateSpline().fit(design, theta)._weights
    np.testing.assert_allclose([weights.sum(), weights @ a, weights @ b], 0.0, atol=1e-8 * np.abs(weights).sum())


def test_kriging_returns_its_samples_up_to_the_nugget():
    design, theta, force = read_samples(TRAINING_TABLE)
    for response in (theta, force):
        model = Kriging(nugget=None).fit(design, response)
        residual = model.predict(design) - response
        # The most the nugget can leave of a residual, from K w = deviation and residual = -nugget w.
        left = -model.nugget * model._spread * model._state.weights
        np.testing.assert_allclose(residual, left, atol=1e-9 * np.ptp(response))
        assert np.sqrt(np.mean(residual**2)) < model._spread * np.sqrt(model.nugget * model._state.variance)


def test_the_response_surface_returns_any_polynomial_of_its_basis():
    design, _, _ = read_samples(TRAINING_TABLE)
    a, b = design.T
    model = PolynomialResponseSurface().fit(design, 1.0 - 2.0 * a * b + 0.5 * b**3)
    assert model.predict([[2.0, 3.0]])[0] == pytest.approx(1.0 - 12.0 + 13.5)


@pytest.mark.parametrize("name", METAMODELS)
def test_fitting_twice_gives_the_same_bits(name):
    design, theta, _ = read_samples(TRAINING_TABLE)
    query = [[1.7, 2.9], [3.1, 1.2]]
    first, second = (METAMODELS[name]().fit(design, theta).predict(query) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_the_shape_parameter_has_the_smallest_leave_one_out_error():
    design, _, force = read_samples(TRAINING_TABLE)
    model = GaussianRadialBasis().fit(design, force)
    best = model._leave_one_out_rms(model.epsilon)
    assert all(best <= model._leave_one_out_rms(epsilon) for epsilon in np.geomspace(0.1, 3.0, 40))


@pytest.mark.parametrize("response", [1, 2])
def test_kriging_parameters_are_the_most_likely(response):
    samples = read_samples(TRAINING_TABLE)
    model = Kriging(nugget=None).fit(samples[0], samples[response])
    log_parameters = np.log([*model.length_scales, model.nugget])
    best, _ = model._likelihood_loss(log_parameters)
    for step in 0.1 * np.vstack([np.eye(3), -np.eye(3)]):
        assert model._likelihood_loss(log_parameters + step)[0] > best


@pytest.mark.parametrize("correlation", CORRELATIONS)
@pytest.mark.parametrize("nugget", [None, 1e-6])
def test_the_gradient_of_the_likelihood_is_that_of_differences(correlation, nugget):
    design, theta, _ = read_samples(TRAINING_TABLE)
    model = Kriging("linear", correlation, nugget).fit(design, theta)
    point = np.log([0.7, 1.3, 1e-3][: 3 if nugget is None else 2])
    _, gradient = model._likelihood_loss(point)
    for step, slope in zip(1e-5 * np.eye(len(point)), gradient, strict=True):
        difference = model._likelihood_loss(point + step)[0] - model._likelihood_loss(point - step)[0]
        assert slope == pytest.approx(difference / 2e-5, rel=1e-5)


def test_kriging_is_less_certain_outside_its_samples():
    design, theta, _ = read_samples(TRAINING_TABLE)
    model = Kriging(nugget=None).fit(design, theta)
    assert model.predict_variance([[1.5, 3.0]])[0] > 1.3 * model.predict_variance(design).mean()


def test_kriging_far_from_its_samples_knows_only_its_uncertain_mean():
    design, theta, _ = read_samples(TRAINING_TABLE)
    wide = DesignDomain((-1000.0, 1000.0), (-1000.0, 1000.0))
    model = Kriging(nugget=1e-3, domain=wide).fit(design, theta)
    model.length_scales = np.array([0.001, 0.001])  # one millimetre
    model._state = model._concentrate(model.length_scales, model.nugget)
    distance2 = ((design[:, None] - design) ** 2).sum(axis=-1)
    precision = np.linalg.inv(np.exp(-0.5 * distance2) + 1e-3 * np.eye(len(design)))
    ones = np.ones(len(design))
    mean = (ones @ precision @ theta) / (ones @ precision @ ones)
    variance = (theta - mean) @ precision @ (theta - mean) / len(theta)
    assert model.predict([[99.0, 99.0]])[0] == pytest.approx(mean)
    expected = variance * (1.0 + model.nugget + 1.0 / (ones @ precision @ ones))
    assert model.predict_variance([[99.0, 99.0]])[0] == pytest.approx(expected)


def test_kriging_errors_are_within_three_of_their_own_standard_deviations():
    design, theta, force = read_samples(TRAINING_TABLE)
    checked, checked_theta, checked_force = read_samples(VALIDATION_TABLE)
    for response, expected in ((theta, checked_theta), (force, checked_force)):
        model = Kriging(nugget=None).fit(design, response)
        score = (model.predict(checked) - expected) / np.sqrt(model.predict_variance(checked))
        assert 0.3 < np.sqrt(np.mean(score**2)) and np.abs(score).max() < 3.0


def test_an_unknown_metamodel_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="'svm'.*prs, rbf, krg"):
        load_metamodel("svm")


@pytest.mark.parametrize("name", METAMODELS)
def test_samples_that_do_not_match_are_refused(name):
    model = METAMODELS[name]()
    with pytest.raises(MetamodelError, match="one response for each"):
        model.fit(np.ones((9, 2)), np.ones(8))
    with pytest.raises(MetamodelError, match="at least"):
        model.fit([[1.5, 1.0], [2.0, 2.0]], np.ones(2))
    with pytest.raises(MetamodelError, match="finite"):
        model.fit(np.full((9, 2), 2.0), np.full(9, np.nan))
    with pytest.raises(MetamodelError, match=r"rows \(a, b\)"):
        model.predict([2.5, 2.0])


@pytest.mark.parametrize("name", METAMODELS)
def test_outside_its_domain_a_metamodel_refuses_and_names_the_nearest_design(name):
    with pytest.raises(DesignDomainError, match="nearest design inside is a = 3.5, b = 2 mm"):
        load_metamodel(name).theta_max_deg.predict([[2.5, 2.0], [3.6, 2.0]])
    with pytest.raises(DesignDomainError, match="outside"):
        load_metamodel(name).theta_max_deg.predict([[np.nan, 2.0]])


@pytest.mark.parametrize("trend", TRENDS)
def test_kriging_returns_the_polynomial_of_its_trend(trend):
    design, _, _ = read_samples(TRAINING_TABLE)
    rng = np.random.default_rng(1)
    weights = np.zeros(6)
    weights[: TRENDS[trend]] = rng.normal(size=TRENDS[trend])

    def polynomial(rows):
        x, y = (rows - [2.5, 2.0]).T
        return np.column_stack([np.ones_like(x), x, y, x**2, y**2, x * y]) @ weights

    noise = 1e-6 * rng.normal(size=len(design))  # the likelihood of an exact fit has no maximum
    model = Kriging(trend, nugget=1e-3).fit(design, polynomial(design) + noise)
    query = np.array([[1.7, 2.9], [3.4, 1.1]])
    np.testing.assert_allclose(model.predict(query), polynomial(query), atol=1e-5)


def test_responses_without_a_remainder_have_no_kriging():
    design, _, _ = read_samples(TRAINING_TABLE)
    for trend, response in (("constant", np.full(21, 3.0)), ("linear", 1.0 + design @ [2.0, 3.0])):
        with pytest.raises(MetamodelError, match=f"{trend} trend alone"):
            Kriging(trend).fit(design, response)


@pytest.mark.parametrize("name", METAMODELS)
def test_many_designs_are_predicted_as_one_by_one(name):
    model = load_metamodel(name).f_max_n
    design = np.random.default_rng(5).uniform([1.5, 1.0], [3.5, 3.0], size=(2500, 2))
    together = model.predict(design)
    assert together.shape == (2500,) and model.predict(np.empty((0, 2))).shape == (0,)
    picked = [0, 1023, 1024, 2499]
    np.testing.assert_allclose(together[picked], [model.predict(design[[i]])[0] for i in picked], rtol=1e-7)


@pytest.mark.parametrize("correlation", CORRELATIONS)
def test_a_correlation_is_one_at_zero_and_falls(correlation):
    distance = np.linspace(0.0, 5.0, 50)
    values = CORRELATIONS[correlation].value(distance)
    assert values[0] == 1.0 and np.all(np.diff(values) < 0.0) and values[-1] > 0.0


def test_kriging_reports_the_jitter_and_the_condition_number_it_solved_with():
    design, theta, _ = read_samples(TRAINING_TABLE)
    model = Kriging(nugget=1e-6).fit(design, theta)
    report = model.fitted_parameters()
    assert report["nugget"] == 1e-6
    distance2 = ((design[:, None] - design) ** 2 / model.length_scales**2).sum(axis=-1)
    eigenvalues = np.linalg.eigvalsh(np.exp(-0.5 * distance2) + 1e-6 * np.eye(len(design)))
    assert report["condition_number"] == pytest.approx(eigenvalues[-1] / eigenvalues[0], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trend": "cubic"}, "'cubic'.*constant, linear, quadratic"),
        ({"correlation": "sinc"}, "'sinc'.*gaussian, exponential"),
        ({"nugget": 0.0}, "at least 1e-12"),
    ],
)
def test_an_unknown_kriging_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        Kriging(**options)


def test_a_domain_is_the_box_of_its_samples():
    domain = DesignDomain.around([[1.0, 5.0], [3.0, 4.0], [2.0, 7.0]])
    assert domain == DesignDomain((1.0, 3.0), (4.0, 7.0))
    np.testing.assert_allclose(domain.scale(np.array([[1.0, 7.0], [2.0, 5.5]])), [[-1.0, 1.0], [0.0, 0.0]])
    with pytest.raises(DesignDomainError, match="b must span a range"):
        DesignDomain.around([[1.0, 5.0], [3.0, 5.0]])


@pytest.mark.parametrize("factor", [1e9, 1.0, 1e-6])
def test_the_coefficients_of_the_response_surface_are_those_of_its_own_units(factor):
    design, theta, _ = read_samples(TRAINING_TABLE)
    domain = DesignDomain((1.5 * factor, 3.5 * factor), (1.0, 3.0))
    model = PolynomialResponseSurface(domain).fit(design * [factor, 1.0], theta)
    powers_of_a = np.array([0, 1, 0, 2, 0, 1, 3, 0])
    np.testing.assert_allclose(model.coefficients * factor**powers_of_a, EQ_9, rtol=1e-4)
    assert list(model.fitted_parameters()) == ["coefficients"]


def test_coefficients_that_cancel_to_nothing_are_not_given_but_the_scaled_ones():
    design, theta, _ = read_samples(TRAINING_TABLE)
    far = design * [1e-6, 1.0] + [1000.0, 0.0]
    model = PolynomialResponseSurface(DesignDomain.around(far)).fit(far, theta)
    parameters = model.fitted_parameters()
    assert "coefficients" not in parameters and "cancellation" in parameters["scaled"]
    x, y = DesignDomain.around(far).scale(far).T
    terms = np.column_stack([np.ones_like(x), x, y, x**2, y**2, x * y, x**3, y**3])
    np.testing.assert_allclose(terms @ parameters["coefficients_scaled"], model.predict(far), rtol=1e-12)
    near = PolynomialResponseSurface().fit(design, theta)
    np.testing.assert_allclose(model.predict(far), near.predict(design), rtol=1e-4)
