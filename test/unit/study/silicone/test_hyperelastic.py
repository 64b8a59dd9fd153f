"""Models of silicone against their energies, each other, and limits in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbpam_ros.study.silicone.hyperelastic import DEFORMATIONS, MooneyRivlin, NeoHooke, Ogden, Yeoh

PAPER = Yeoh(0.1154, -0.0091, 0.0055)
MODELS = (PAPER, NeoHooke(0.1), MooneyRivlin(0.08, -0.02), Ogden(0.05, 2.7, -0.01, -3.0))
STRETCH = np.linspace(0.6, 3.0, 25)


def energy_mpa(model, first, second):
    """W by its definition, written anew."""
    stretch = np.array([first, second, 1.0 / (first * second)])
    one, two = (stretch**2).sum(axis=0) - 3.0, (stretch**-2.0).sum(axis=0) - 3.0
    if isinstance(model, NeoHooke):
        return model.c10_mpa * one
    if isinstance(model, MooneyRivlin):
        return model.c10_mpa * one + model.c01_mpa * two
    if isinstance(model, Yeoh):
        return model.c10_mpa * one + model.c20_mpa * one**2 + model.c30_mpa * one**3
    terms = ((model.mu1_mpa, model.alpha1), (model.mu2_mpa, model.alpha2))
    return sum(mu / alpha * ((stretch**alpha).sum(axis=0) - 3.0) for mu, alpha in terms)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_the_stress_of_a_pull_is_the_slope_of_the_energy(model):
    step = 1e-6
    up, down = (energy_mpa(model, STRETCH + d, (STRETCH + d) ** -0.5) for d in (step, -step))
    np.testing.assert_allclose(model.stress_mpa(STRETCH), (up - down) / (2.0 * step), atol=1e-8)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_small_strains_meet_the_shear_modulus(model):
    assert model.stress_mpa(np.array(1.0)) == pytest.approx(0.0, abs=1e-15)
    slope = model.stress_mpa(np.array(1.0 + 1e-6)) / 1e-6
    assert slope == pytest.approx(3.0 * model.shear_modulus_mpa(), rel=1e-4)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_the_curvature_is_that_of_the_energy(model):
    first, second, step = 1.4, 0.8, 1e-4

    def energy(a, b):
        return energy_mpa(model, first * np.exp(a * step), second * np.exp(b * step))

    expected = (
        (energy(1, 0) - 2.0 * energy(0, 0) + energy(-1, 0)) / step**2,
        (energy(1, 1) - energy(1, -1) - energy(-1, 1) + energy(-1, -1)) / (4.0 * step**2),
        (energy(0, 1) - 2.0 * energy(0, 0) + energy(0, -1)) / step**2,
    )
    found = model.curvature_mpa(np.array(first), np.array(second))
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)


def test_ogdens_model_holds_the_simpler_ones():
    np.testing.assert_allclose(Ogden(0.2, 2.0, 0.0, 4.0).stress_mpa(STRETCH), NeoHooke(0.1).stress_mpa(STRETCH))
    mooney = MooneyRivlin(0.08, 0.03)
    np.testing.assert_allclose(Ogden(0.16, 2.0, -0.06, -2.0).stress_mpa(STRETCH), mooney.stress_mpa(STRETCH))


@given(st.floats(0.001, 1.0), st.floats(0.5, 8.0))
def test_ogdens_terms_with_mu_and_alpha_of_one_sign_are_stable_at_every_stretch(mu, alpha):
    for model in (Ogden(mu, alpha, 0.0, 2.0), Ogden(-mu, -alpha, 0.0, 2.0)):
        assert all(model.stable_stretches(name) == pytest.approx((0.2, 8.0)) for name in DEFORMATIONS)


def test_a_model_whose_stress_falls_is_stable_only_before():
    model = Yeoh(0.1, 0.0, -0.001)
    stretch = np.linspace(1.0, 6.0, 5001)
    true_stress = stretch * model.stress_mpa(stretch)
    falls_from = stretch[np.argmax(true_stress)]
    assert model.stable_stretches("uniaxial")[1] == pytest.approx(falls_from, rel=0.005)


def test_a_negative_modulus_is_stable_nowhere():
    assert NeoHooke(-0.1).stable_stretches("planar") == (1.0, 1.0)
