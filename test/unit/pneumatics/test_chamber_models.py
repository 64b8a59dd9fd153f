"""Valve and chamber models against closed forms and against an independent integrator."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbpam_ros.pneumatics.chamber import ChamberConfig, OrificeConfig, PneumaticsInputError
from mbpam_ros.pneumatics.registry import build_pneumatics, pneumatic_model_names

ORIFICES = OrificeConfig(
    sonic_conductance_m3_s_pa=2.5e-10,
    critical_ratio=0.3,
    leak_conductance_m3_s_pa=0.0,
    line_volume_m3=2e-6,
    supply_volume_m3=1e-4,
    regulator_conductance_m3_s_pa=5e-9,
    sub_step_s=2.5e-3,
)
CONFIG = ChamberConfig(
    supply_gauge_pa=200e3,
    spool_time_constant_s=0.005,
    ideal_rate_pa_s=400e3,
    lag_time_constant_s=0.25,
    iso6358=ORIFICES,
)
MODELS = ("ideal", "lag")


@pytest.fixture(params=pneumatic_model_names())
def model(request):
    return build_pneumatics(request.param, CONFIG)


def right_hand_side(name, command):
    def rate(_, state):
        spool, pressure = state
        if name == "ideal":
            flow = CONFIG.ideal_rate_pa_s * spool
        else:
            end = CONFIG.supply_gauge_pa if spool > 0 else 0.0
            flow = abs(spool) * (end - pressure) / CONFIG.lag_time_constant_s
        return [(command - spool) / CONFIG.spool_time_constant_s, flow]

    return rate


@pytest.mark.parametrize("name", MODELS)
def test_a_step_through_a_reversal_agrees_with_a_fine_numerical_integration(name):
    model = build_pneumatics(name, CONFIG)
    model.reset(90e3)
    forth = np.linspace(-1.0, 1.0, 16)
    model.step(forth, 0.03)
    back = model.step(-0.7 * forth, 0.02)
    for channel in range(16):
        state = [0.0, 90e3]
        for command, duration in ((forth[channel], 0.03), (-0.7 * forth[channel], 0.02)):
            solution = solve_ivp(
                right_hand_side(name, command), (0, duration), state, rtol=1e-10, atol=1e-6, max_step=1e-3
            )
            state = solution.y[:, -1]
        assert back[channel] == pytest.approx(state[1], abs=0.05)
        assert model.spool[channel] == pytest.approx(state[0], abs=1e-6)


def test_lag_at_full_opening_fills_with_its_time_constant_after_the_spool_has_moved():
    model = build_pneumatics("lag", CONFIG)
    pressure = model.step(np.ones(16), 0.25)
    # The opening's time integral is dt - tau_spool (1 - exp(-dt / tau_spool)).
    exponent = (0.25 - 0.005 * (1 - math.exp(-50.0))) / 0.25
    np.testing.assert_allclose(pressure, 200e3 * (1 - math.exp(-exponent)), rtol=1e-13)


def test_ideal_rate_is_proportional_to_the_opening():
    model = build_pneumatics("ideal", CONFIG)
    opening = np.linspace(0.1, 1.0, 16)
    model.step(opening, 0.2)  # spool settled
    before = model.pressure_gauge_pa
    np.testing.assert_allclose(model.step(opening, 0.05) - before, 400e3 * opening * 0.05, rtol=1e-9)


def test_a_closed_valve_keeps_the_pressure(model):
    model.reset(np.linspace(0.0, 200e3, 16))
    np.testing.assert_allclose(model.step(np.zeros(16), 10.0), np.linspace(0.0, 200e3, 16), rtol=1e-9, atol=1e-3)


def test_filling_ends_at_the_supply_and_venting_at_ambient(model):
    np.testing.assert_allclose(model.step(np.ones(16), 30.0), 200e3, rtol=1e-9)
    np.testing.assert_allclose(model.step(-np.ones(16), 30.0), 0.0, atol=1e-3)


@pytest.mark.parametrize("name", MODELS)
def test_filling_and_venting_are_mirror_images_about_half_the_supply(name):
    model = build_pneumatics(name, CONFIG)
    opening = np.linspace(0.0, 0.9, 16)
    model.reset(60e3)
    filled = model.step(opening, 0.07)
    model.reset(140e3)
    np.testing.assert_allclose(200e3 - model.step(-opening, 0.07), filled, rtol=1e-12)


def test_reset_closes_the_valves(model):
    model.step(np.ones(16), 0.1)
    model.reset(50e3)
    np.testing.assert_array_equal(model.spool, np.zeros(16))
    np.testing.assert_allclose(model.step(np.zeros(16), 0.1), 50e3, rtol=1e-9)


def test_what_is_returned_is_a_copy(model):
    model.step(np.ones(16), 0.01)[:] = -1.0
    model.pressure_gauge_pa[:] = -1.0
    assert (model.pressure_gauge_pa > 0.0).all()


@pytest.mark.parametrize(
    ("spool", "dt_s", "message"),
    [
        (np.zeros(15), 0.01, "shape"),
        (np.zeros((16, 1)), 0.01, "shape"),
        (np.where(np.arange(16) == 6, np.nan, 0.0), 0.01, "finger_2_chamber_3"),
        (np.full(16, np.inf), 0.01, "finger_1_chamber_1"),
        (np.full(16, 1.01), 0.01, r"\[-1, 1\]"),
        (np.zeros(16), 0.0, "dt_s"),
        (np.zeros(16), math.nan, "dt_s"),
    ],
)
def test_a_bad_step_is_refused_and_changes_nothing(model, spool, dt_s, message):
    model.reset(70e3)
    with pytest.raises(PneumaticsInputError, match=message):
        model.step(spool, dt_s)
    np.testing.assert_array_equal(model.pressure_gauge_pa, np.full(16, 70e3))


@pytest.mark.parametrize("pressure", [-1.0, 200e3 + 1.0, math.nan, np.zeros(4)])
def test_a_reset_to_an_impossible_pressure_is_refused(model, pressure):
    with pytest.raises(PneumaticsInputError):
        model.reset(pressure)


def test_an_unknown_model_is_refused_with_the_known_names():
    with pytest.raises(PneumaticsInputError, match="ideal, lag, iso6358"):
        build_pneumatics("steam", CONFIG)


@pytest.mark.parametrize("bend_rad", [np.zeros((4, 3)), np.full((4, 2), np.nan)])
def test_a_bend_that_cannot_be_is_refused(model, bend_rad):
    with pytest.raises(PneumaticsInputError, match="bend_rad"):
        model.step(np.zeros(16), 0.01, bend_rad)


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(ChamberConfig) if field.type == "float"])
def test_a_configuration_without_a_positive_value_is_refused(name):
    with pytest.raises(ValueError, match=name):
        dataclasses.replace(CONFIG, **{name: 0.0})
