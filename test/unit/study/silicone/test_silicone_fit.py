"""Constants from tests whose truth is known."""

import numpy as np
import pytest

from mbpam_ros.study.silicone.fit import FitError, fit_all
from mbpam_ros.study.silicone.hyperelastic import MooneyRivlin, NeoHooke, Ogden, Yeoh
from mbpam_ros.study.silicone.tensile_test import TensileTest, mean_of

STRAIN = np.linspace(0.0, 1.5, 90)
PAPER = Yeoh(0.1154, -0.0091, 0.0055)


def pull(model, noise_mpa=0.0, strain=STRAIN, seed=1):
    noise = noise_mpa * np.random.default_rng(seed).standard_normal(strain.size)
    return TensileTest("pull", strain, model.stress_mpa(1.0 + strain) + noise)


@pytest.mark.parametrize(
    "model",
    [PAPER, MooneyRivlin(0.08, 0.03), NeoHooke(0.05), Ogden(0.06, 1.6, 0.002, 5.2)],
    ids=lambda model: model.name,
)
def test_constants_come_back_from_the_models_own_curve(model):
    fit = fit_all(pull(model), (0.0, 1.5))[model.name]
    assert fit.model.constants() == pytest.approx(model.constants(), rel=1e-3)
    assert fit.r2 == pytest.approx(1.0, abs=1e-9)


def test_the_model_that_made_the_curve_comes_first():
    for model in (PAPER, NeoHooke(0.05), MooneyRivlin(0.08, 0.03)):
        assert next(iter(fit_all(pull(model, noise_mpa=2e-4), (0.0, 1.5)))) == model.name


def test_noise_moves_constants_as_little_as_least_squares_say():
    sure = [fit_all(pull(PAPER, 1e-3, seed=seed), (0.0, 1.5))["yeoh"].model.c10_mpa for seed in range(12)]
    assert np.mean(sure) == pytest.approx(PAPER.c10_mpa, rel=6e-3)
    assert fit_all(pull(PAPER, 1e-3), (0.0, 1.5))["yeoh"].rmse_mpa == pytest.approx(1e-3, rel=0.3)


def test_repeats_are_averaged_with_their_spread_over_the_strains_they_share():
    short, long = (pull(PAPER, strain=np.linspace(low, high, 70)) for low, high in ((0.1, 1.1), (0.0, 1.5)))
    stiffer = TensileTest("stiffer", long.strain, 1.1 * long.stress_mpa)
    mean = mean_of([short, stiffer])
    assert (mean.strain[0], mean.strain[-1]) == (0.1, 1.1)
    assert mean.stress_mpa == pytest.approx(1.05 * PAPER.stress_mpa(1.0 + mean.strain), rel=1e-3)
    assert mean.spread_mpa == pytest.approx(0.1 * PAPER.stress_mpa(1.0 + mean.strain) / np.sqrt(2.0), rel=2e-2)


def test_instability_within_what_will_be_seen_is_told_by_deformation():
    fit = fit_all(pull(Yeoh(0.09, 0.014, -0.0015)), (0.0, 1.0))["yeoh"]
    assert set(fit.unstable(0.6, 2.0)) == {"equibiaxial"}
    assert fit.unstable(0.8, 1.5) == {}


@pytest.mark.parametrize(
    ("strain", "message"),
    [
        (np.linspace(0.0, 0.5, 8), "8 points lie between strains 0 and 1, at least 10"),
        (np.linspace(2.0, 3.0, 80), "the test goes from 2 to 3"),
    ],
)
def test_too_little_within_the_range_is_refused(strain, message):
    with pytest.raises(FitError, match=message):
        fit_all(pull(PAPER, strain=strain), (0.0, 1.0))
