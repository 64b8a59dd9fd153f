"""Volts to pressures, and every way a channel can fail and come back."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.sensing import ChannelStatus, PressureSensing, SensingInputError, ZeroRefusedError
from mbpam_ros.pneumatics.transducer import Transducer

DEFAULTS = load_pneumatics()
SENSING, SHEET = DEFAULTS.sensing, DEFAULTS.transducer
BAD = 6  # finger_2_chamber_3
OK, OUT_OF_RANGE, STUCK, MISSING = (
    ChannelStatus.OK,
    ChannelStatus.OUT_OF_RANGE,
    ChannelStatus.STUCK,
    ChannelStatus.MISSING,
)


def volts_at(pressure_gauge_pa):
    return SHEET.zero_v + np.broadcast_to(pressure_gauge_pa, 16) / SHEET.gain_pa_v


def noisy(count, pressure=0.0, seed=0):
    transducer = Transducer(SHEET, 16, seed)
    return [transducer.measure(np.full(16, pressure)) for _ in range(count)]


def sensing(**change):
    return PressureSensing(dataclasses.replace(SENSING, **change), SHEET)


def with_fault(volts, value):
    return np.where(np.arange(16) == BAD, value, volts)


def feed(sensor, samples, start=0, period_s=0.01):
    for k, sample in enumerate(samples, start):
        reading = sensor.update(k * period_s, sample)
    return reading


def test_the_first_sample_is_a_reading():
    reading = sensing().update(0.0, volts_at(np.linspace(0, 150e3, 16)))
    np.testing.assert_allclose(reading.pressure_gauge_pa, np.linspace(0, 150e3, 16), atol=1e-6)
    assert reading.status == (OK,) * 16
    assert reading.time_s == 0.0
    converter = (SHEET.resolution_v * SHEET.gain_pa_v) ** 2 / 12
    np.testing.assert_allclose(reading.variance_pa2, (SHEET.noise_v * SHEET.gain_pa_v) ** 2 + converter)


def test_each_channel_has_a_gain_and_an_offset_of_its_own():
    gain, offset = np.linspace(0.9, 1.1, 16), np.linspace(-0.1, 0.1, 16)
    sensor = sensing(channel_gain=tuple(gain), channel_offset_v=tuple(offset))
    pressure = np.linspace(10e3, 90e3, 16)
    volts = SHEET.zero_v + offset + pressure / (gain * SHEET.gain_pa_v)
    np.testing.assert_allclose(sensor.update(0.0, volts).pressure_gauge_pa, pressure, rtol=1e-12)


def test_the_filter_answers_a_jump_as_a_first_order_low_pass_at_irregular_intervals():
    sensor = sensing(stuck_time_s=0.0)
    sensor.update(0.0, volts_at(0.0))
    for time_s in (0.003, 0.004, 0.019, 0.05):
        reading = sensor.update(time_s, volts_at(80e3))
        expected = 80e3 * (1 - math.exp(-2 * math.pi * SENSING.cutoff_hz * time_s))
        np.testing.assert_allclose(reading.pressure_gauge_pa, expected, rtol=1e-12)


def test_the_stated_variance_is_that_of_the_filtered_pressure():
    sensor = sensing()
    readings = [sensor.update(0.01 * k, v) for k, v in enumerate(noisy(6000, 80e3))][200:]
    true = np.array([r.pressure_gauge_pa for r in readings]).var()
    stated = np.mean([r.variance_pa2 for r in readings])
    assert stated == pytest.approx(true, rel=0.05)
    assert math.sqrt(true) < 0.002 * SHEET.gain_pa_v  # the filter does remove noise


def test_the_variance_follows_a_channel_that_becomes_noisier():
    sensor = sensing()
    feed(sensor, noisy(200))
    rough = np.random.default_rng(1).normal(0.0, 0.02, (300, 16))
    reading = feed(sensor, [v + r for v, r in zip(noisy(300), rough, strict=True)], start=200)
    expected = (0.02 * SHEET.gain_pa_v) ** 2 * 0.44  # alpha / (2 - alpha) at 15 Hz and 100 Hz
    assert reading.variance_pa2.mean() == pytest.approx(expected, rel=0.3)


def test_the_variance_never_falls_below_that_of_the_converter():
    reading = feed(sensing(stuck_time_s=0.0), [volts_at(40e3)] * 2000)
    np.testing.assert_allclose(reading.variance_pa2, (SHEET.resolution_v * SHEET.gain_pa_v) ** 2 / 12)


@pytest.mark.parametrize(
    ("volts", "status"),
    [
        (0.0, OUT_OF_RANGE),
        (4.99, OUT_OF_RANGE),
        (math.inf, OUT_OF_RANGE),
        (-math.inf, OUT_OF_RANGE),
        (math.nan, MISSING),
    ],
)
def test_a_bad_sample_makes_that_channel_invalid_at_once_and_no_other(volts, status):
    sensor = sensing()
    feed(sensor, noisy(10, 50e3))
    reading = sensor.update(0.1, with_fault(volts_at(50e3), volts))
    assert reading.status[BAD] is status
    assert math.isnan(reading.pressure_gauge_pa[BAD]) and math.isnan(reading.variance_pa2[BAD])
    others = np.arange(16) != BAD
    assert np.isfinite(reading.pressure_gauge_pa[others]).all()
    assert all(reading.status[i] is OK for i in np.flatnonzero(others))


def test_a_value_that_never_changes_is_stuck_after_the_stuck_time():
    sensor = sensing()
    samples = [with_fault(v, 1.5) for v in noisy(102)]
    assert feed(sensor, samples[:100]).status == (OK,) * 16
    reading = feed(sensor, samples[100:], start=100)
    assert reading.status[BAD] is STUCK and math.isnan(reading.pressure_gauge_pa[BAD])
    assert reading.status.count(OK) == 15


def test_the_stuck_check_can_be_switched_off():
    assert feed(sensing(stuck_time_s=0.0), [volts_at(30e3)] * 1000).status == (OK,) * 16


def test_a_sound_channel_at_rest_is_never_called_stuck():
    # A probability per sample of at most erf(1/2 count / (sqrt(2) sigma)) = 0.24 to repeat makes runs of 100 hopeless;
    # the longest run in a minute of 16 channels stays below ten.
    samples = np.array(noisy(6000, 80e3))
    repeat = math.erf(0.5 * SHEET.resolution_v / (math.sqrt(2) * SHEET.noise_v))
    assert repeat == pytest.approx(0.24, abs=0.005)
    run = longest = np.zeros(16)
    for k in range(1, len(samples)):
        run = np.where(samples[k] == samples[k - 1], run + 1, 0)
        longest = np.maximum(longest, run)
    assert 3 < longest.max() < 12
    assert 16 * 3.15e9 * repeat ** (SENSING.stuck_time_s * 100) < 1e-50  # per year at 100 Hz


def test_a_channel_recovers_after_some_good_samples_in_a_row():
    sensor = sensing()
    samples = noisy(40, 50e3)
    feed(sensor, samples[:10])
    sensor.update(0.10, with_fault(samples[10], math.nan))
    for k in range(11, 11 + SENSING.recovery_samples - 1):
        reading = sensor.update(0.01 * k, samples[k])
        assert reading.status[BAD] is MISSING and math.isnan(reading.pressure_gauge_pa[BAD])
    reading = sensor.update(0.01 * (10 + SENSING.recovery_samples), samples[20])
    assert reading.status[BAD] is OK
    assert reading.pressure_gauge_pa[BAD] == pytest.approx(50e3, abs=600)


def test_a_bad_sample_on_the_way_starts_the_recovery_anew():
    sensor = sensing()
    samples = noisy(40, 50e3)
    feed(sensor, [with_fault(samples[0], 0.0), *samples[1:4], with_fault(samples[4], 5.0), *samples[5:9]])
    assert sensor.check(0.08).status[BAD] is OUT_OF_RANGE
    assert sensor.update(0.09, samples[9]).status[BAD] is OK


def test_a_recovered_channel_starts_from_where_it_is_not_from_where_it_was():
    sensor = sensing()
    feed(sensor, noisy(10, 20e3))
    feed(sensor, [with_fault(v, math.nan) for v in noisy(20, 90e3)], start=10)
    reading = feed(sensor, noisy(SENSING.recovery_samples, 90e3), start=30)
    assert reading.pressure_gauge_pa[BAD] == pytest.approx(90e3, abs=600)


def test_channels_are_missing_before_any_sample_and_when_samples_cease():
    sensor = sensing()
    assert sensor.check(0.0).status == (MISSING,) * 16
    feed(sensor, noisy(10))
    assert sensor.check(0.25).status == (OK,) * 16
    late = sensor.check(0.3)
    assert late.status == (MISSING,) * 16 and np.isnan(late.pressure_gauge_pa).all()
    assert sensor.update(0.31, noisy(1)[0]).status == (MISSING,) * 16  # recovery needs several


def test_zero_takes_the_vented_reading_per_channel():
    offset = np.linspace(-3e3, 3e3, 16)
    sensor = sensing(stuck_time_s=0.0)
    feed(sensor, [volts_at(offset)] * 30)
    np.testing.assert_allclose(sensor.zero(forced=True), offset, atol=1e-6)
    np.testing.assert_allclose(sensor.check(0.3).pressure_gauge_pa, 0.0, atol=1e-9)
    np.testing.assert_allclose(feed(sensor, [volts_at(offset + 80e3)] * 300, start=31).pressure_gauge_pa, 80e3)


def test_zero_is_refused_while_a_channel_is_pressurised():
    sensor = sensing()
    feed(sensor, [with_fault(v, 1.0) for v in noisy(5)])
    with pytest.raises(ZeroRefusedError, match="finger_2_chamber_3 reads 25000 Pa"):
        sensor.zero()
    assert sensor.check(0.05).pressure_gauge_pa[BAD] == pytest.approx(25e3)


def test_zero_is_refused_while_a_channel_is_invalid():
    sensor = sensing()
    feed(sensor, [with_fault(v, math.nan) for v in noisy(5)])
    with pytest.raises(ZeroRefusedError, match="finger_2_chamber_3 has no valid reading: missing"):
        sensor.zero()


def test_repeated_zeros_cannot_creep_past_the_limit():
    sensor = sensing(stuck_time_s=0.0)
    feed(sensor, [volts_at(4e3)] * 30)
    sensor.zero(forced=True)
    feed(sensor, [volts_at(8e3)] * 100, start=30)
    with pytest.raises(ZeroRefusedError, match="8000 Pa before correction"):
        sensor.zero(forced=True)


@pytest.mark.parametrize("trapped_pa", [1.2e3, 4.3e3, -1.2e3])
def test_a_zero_far_from_the_last_one_is_taken_for_trapped_air_unless_forced(trapped_pa):
    sensor = sensing()
    feed(sensor, noisy(100))
    last = sensor.zero()
    feed(sensor, noisy(100, trapped_pa), start=100)
    with pytest.raises(ZeroRefusedError, match="from the last zero; air may be trapped"):
        sensor.zero()
    assert sensor.check(2.0).pressure_gauge_pa == pytest.approx(trapped_pa, abs=350.0)
    assert sensor.zero(forced=True) == pytest.approx(last + trapped_pa, abs=350.0)


@pytest.mark.parametrize("moves", ["noise", "a fall"])
def test_a_zero_of_readings_that_do_not_stand_still_is_refused_unless_forced(moves):
    sensor = sensing()
    samples = noisy(300)
    if moves == "noise":
        rough = np.random.default_rng(1).normal(0.0, 0.01, 300)
        samples = [with_fault(v, v[BAD] + r) for v, r in zip(samples, rough, strict=True)]
    else:  # from 20 kPa with a time constant of 0.25 s, as a chamber that is being vented
        air_v = 20e3 * np.exp(-np.arange(100) / 25.0) / SHEET.gain_pa_v
        samples = [with_fault(v, v[BAD] + a) for v, a in zip(samples, air_v, strict=False)]
    feed(sensor, samples)
    with pytest.raises(ZeroRefusedError, match="finger_2_chamber_3 is not steady"):
        sensor.zero()
    sensor.zero(forced=True)


def test_a_sound_transducer_at_rest_is_always_steady_enough_for_a_zero():
    sensor = sensing()
    for k in range(20):
        feed(sensor, noisy(100, seed=k), start=100 * k)
        assert np.abs(sensor.zero()).max() < 400.0


def test_time_going_back_forgets_the_filter_but_keeps_the_zero():
    sensor = sensing(stuck_time_s=0.0)
    feed(sensor, [volts_at(2e3)] * 100)
    sensor.zero(forced=True)
    reading = sensor.update(0.0, volts_at(62e3))
    np.testing.assert_allclose(reading.pressure_gauge_pa, 60e3, atol=1e-6)
    assert reading.status == (OK,) * 16


def test_a_repeated_time_does_not_move_the_filter():
    sensor = sensing()
    before = sensor.update(1.0, volts_at(10e3))
    again = sensor.update(1.0, volts_at(90e3))
    np.testing.assert_array_equal(again.pressure_gauge_pa, before.pressure_gauge_pa)
    np.testing.assert_array_equal(again.variance_pa2, before.variance_pa2)


@pytest.mark.parametrize(("time_s", "volts"), [(0.0, np.zeros(4)), (math.nan, np.ones(16)), (math.inf, np.ones(16))])
def test_samples_that_cannot_be_read_are_refused(time_s, volts):
    with pytest.raises(SensingInputError):
        sensing().update(time_s, volts)


@pytest.mark.parametrize(
    "change",
    [
        {"channel_gain": (1.0,) * 15},
        {"channel_offset_v": ()},
        {"channel_gain": (0.0,) + (1.0,) * 15},
        {"cutoff_hz": 0.0},
        {"stuck_time_s": -1.0},
        {"valid_low_v": 4.9},
    ],
)
def test_an_impossible_configuration_is_refused(change):
    with pytest.raises(ValueError):
        dataclasses.replace(SENSING, **change)
