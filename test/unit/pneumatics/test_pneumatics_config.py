"""The shipped pneumatics file, and what a wrong one gets."""

import copy

import pytest

from mbpam_ros.configuration import ConfigError, load_yaml, parse_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.pneumatics.controller import PressureController
from mbpam_ros.pneumatics.registry import build_pneumatics, pneumatic_model_names


def changed(section, key, value):
    mapping = copy.deepcopy(load_yaml("pneumatics.yaml"))
    mapping[section][key] = value
    return mapping


def test_the_shipped_file_builds_every_part():
    config = load_pneumatics()
    assert config.model in pneumatic_model_names()
    build_pneumatics(config.model, config.chamber)
    gripper = load_gripper()
    PressureController(config.controller, gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa)


def test_the_feed_forward_assumes_the_simulated_plant():
    config = load_pneumatics()
    assert config.controller.supply_gauge_pa == config.chamber.supply_gauge_pa
    assert config.controller.fill_time_constant_s == config.chamber.lag_time_constant_s


def test_over_pressure_is_within_what_the_transducers_can_tell():
    config = load_pneumatics()
    trip = load_gripper().over_pressure_gauge_pa
    highest = (config.sensing.valid_high_v - config.transducer.zero_v) * config.transducer.gain_pa_v
    assert trip < config.chamber.supply_gauge_pa < highest


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("chamber", "supply_kpa", 200.0),
        ("chamber", "supply_gauge_pa", -1.0),
        ("chamber", "lag_time_constant_s", float("nan")),
        ("transducer", "adc_bits", 12.5),
        ("sensing", "channel_gain", [1.0, 1.0]),
        ("sensing", "recovery_samples", 0),
        ("controller", "hold_time_s", 0.3),
        ("controller", "open_band_pa", 10.0),
        ("controller", "integral_gain_1_s2", -1.0),
        ("controller", "over_pressure_release_pa", 0.0),
    ],
)
def test_a_wrong_value_is_refused_by_name(section, key, value):
    with pytest.raises(ConfigError, match=key):
        parse_config(PneumaticsConfig, changed(section, key, value), "test")


def test_an_unknown_model_is_refused():
    with pytest.raises(ConfigError, match="steam"):
        parse_config(PneumaticsConfig, {**load_yaml("pneumatics.yaml"), "model": "steam"}, "test")


def test_a_stuck_check_on_noiseless_transducers_is_refused():
    with pytest.raises(ConfigError, match="stuck_time_s"):
        parse_config(PneumaticsConfig, changed("transducer", "noise_v", 0.0), "test")
