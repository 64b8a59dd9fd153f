import numpy as np
import pytest

from mbpam_ros.actuator.design import DesignDomainError
from mbpam_ros.actuator.metamodel import Kriging
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.design.uncertainty import kriging_sigma, uncertain_kriging, uncertainty_map

SAMPLES = Samples.of_the_paper("doe_training.csv")
VALIDATION = Samples.of_the_paper("doe_validation.csv")


@pytest.fixture(scope="module")
def sparse():
    """Ten samples: few are quick to leave out."""
    return Samples(SAMPLES.design_mm[:10], {key: values[:10] for key, values in SAMPLES.responses.items()})


def test_the_map_is_krigings_deviation_and_the_errors_of_fits_without_each_sample(sparse):
    kriging = uncertain_kriging(sparse)
    found = uncertainty_map(sparse, kriging, points=5)
    corner = [[found.a_mm[-1], found.b_mm[0]]]
    assert found.sigma["f_max"][0, -1] == pytest.approx(kriging_sigma(kriging, corner)["f_max"][0])
    without = Kriging(nugget=None, domain=sparse.domain()).fit(sparse.design_mm[1:], sparse.responses["f_max"][1:])
    expected = without.predict(sparse.design_mm[:1])[0] - sparse.responses["f_max"][0]
    assert found.left_out_error["f_max"][0] == pytest.approx(expected)
    scores = found.coverage["f_max"]
    assert scores.count == 10 and scores.held_back == "left out in turn, refits"


def test_the_deviation_grows_toward_the_corners():
    sigma = kriging_sigma(uncertain_kriging(SAMPLES), [[2.5, 2.0], [1.5, 1.0], [3.5, 3.0]])
    for values in sigma.values():
        assert values[1:].min() > 1.3 * values[0]


def test_validation_errors_are_a_few_deviations_and_those_of_an_interpolating_model_are_not():
    domain = SAMPLES.domain()
    for key, estimated in uncertain_kriging(SAMPLES).items():
        interpolating = Kriging(domain=domain).fit(SAMPLES.design_mm, SAMPLES.responses[key])
        scores = [
            np.abs(model.predict(VALIDATION.design_mm) - VALIDATION.responses[key])
            / model.deviation(VALIDATION.design_mm)
            for model in (estimated, interpolating)
        ]
        assert scores[0].max() < 3.0 < scores[1].max()


def test_outside_the_domain_there_is_no_deviation_but_the_nearest_design():
    with pytest.raises(DesignDomainError, match="nearest design inside is a = 1.5, b = 3 mm"):
        kriging_sigma(uncertain_kriging(SAMPLES), [[1.4, 3.2]])
