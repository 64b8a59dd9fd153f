"""The simulated transducer: scale, noise, quantisation, saturation."""

import dataclasses

import numpy as np
import pytest

from mbpam_ros.pneumatics.transducer import Transducer, TransducerConfig

CONFIG = TransducerConfig(
    zero_v=0.5, full_scale_v=4.5, full_scale_gauge_pa=200e3, noise_v=0.002, adc_bits=12, adc_reference_v=5.0
)
COUNT_V = 5.0 / 4096


def test_volts_rise_linearly_from_zero_to_full_scale_within_half_a_count():
    quiet = Transducer(dataclasses.replace(CONFIG, noise_v=0.0), 16, seed=0)
    pressure = np.linspace(0.0, 200e3, 16)
    np.testing.assert_allclose(quiet.measure(pressure), 0.5 + 4.0 * pressure / 200e3, atol=0.5 * COUNT_V)


def test_every_sample_is_a_whole_number_of_counts():
    counts = Transducer(CONFIG, 16, seed=0).measure(np.linspace(0.0, 200e3, 16)) / COUNT_V
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)


def test_the_noise_has_the_stated_deviation_and_no_bias():
    transducer = Transducer(CONFIG, 16, seed=1)
    samples = np.array([transducer.measure(np.full(16, 80e3)) for _ in range(4000)])
    expected = np.hypot(0.002, COUNT_V / np.sqrt(12))
    assert samples.std() == pytest.approx(expected, rel=0.02)
    assert samples.mean() == pytest.approx(0.5 + 4.0 * 80e3 / 200e3, abs=4 * expected / np.sqrt(samples.size))


def test_channels_have_noise_of_their_own():
    transducer = Transducer(CONFIG, 16, seed=1)
    samples = np.array([transducer.measure(np.full(16, 80e3)) for _ in range(2000)])
    correlation = np.corrcoef(samples.T) - np.eye(16)
    assert np.abs(correlation).max() < 0.1


def test_the_converter_saturates_beyond_its_range():
    volts = Transducer(CONFIG, 2, seed=0).measure(np.array([-1e6, 1e6]))
    np.testing.assert_array_equal(volts, [0.0, 4095 * COUNT_V])


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not():
    def record(seed):
        transducer = Transducer(CONFIG, 16, seed)
        return np.array([transducer.measure(np.full(16, 50e3)) for _ in range(10)])

    np.testing.assert_array_equal(record(5), record(5))
    assert (record(5) != record(6)).any()


@pytest.mark.parametrize("pressure", [np.zeros(15), np.full(16, np.nan), np.full(16, np.inf)])
def test_pressures_that_cannot_be_measured_are_refused(pressure):
    with pytest.raises(ValueError):
        Transducer(CONFIG, 16, seed=0).measure(pressure)


@pytest.mark.parametrize(
    "change", [{"noise_v": -0.1}, {"full_scale_v": 0.4}, {"adc_bits": 0}, {"full_scale_v": 5.5}, {"zero_v": -0.1}]
)
def test_an_impossible_data_sheet_is_refused(change):
    with pytest.raises(ValueError):
        dataclasses.replace(CONFIG, **change)
