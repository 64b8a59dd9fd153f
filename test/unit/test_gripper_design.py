"""The design that the gripper file names is the one that plant, estimator and arbiter run with."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from mbpam_ros.actuator.calibration import calibration_targets
from mbpam_ros.actuator.named_designs import load_design
from mbpam_ros.configuration import ConfigError, load_config, load_yaml
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene

PRESSURE_PA = 8e4 * np.tile([1.0, 1.0, 0.0, 0.0], 4)


@pytest.fixture
def gripper_with(tmp_path):
    """Reads the gripper file with this design in it."""

    def load(design):
        path = tmp_path / "own_gripper.yaml"
        path.write_text(yaml.safe_dump({**load_yaml("gripper.yaml"), "design": design}), encoding="utf-8")
        return load_gripper(path)

    return load


def plants_bend(gripper):
    scene, request = load_scene("empty")
    plant = build_plant(scene, replace(request, tier="static"), gripper)
    for _ in range(200):
        plant.step(np.clip((PRESSURE_PA - plant.observe().pressure_gauge_pa) / 2e4, -1.0, 1.0), 0.01)
    np.testing.assert_allclose(plant.observe().pressure_gauge_pa, PRESSURE_PA, atol=10.0)
    return plant.observe().bend_rad


def estimators_bend(gripper):
    estimator = BendEstimator.for_gripper(gripper, load_config(EstimatorConfig, "estimator.yaml"))
    return estimator.update(0.0, PRESSURE_PA).bend_rad


@pytest.mark.parametrize("design", ["initial", "optimised", {"a_mm": 3.0, "b_mm": 1.5}])
def test_plant_and_estimator_bend_alike(gripper_with, design):
    gripper = gripper_with(design)
    np.testing.assert_allclose(estimators_bend(gripper), plants_bend(gripper), atol=2e-3)


def test_another_design_bends_otherwise(gripper_with):
    initial, optimised = (estimators_bend(gripper_with(design)) for design in ("initial", "optimised"))
    ratio = np.hypot(*optimised.T) / np.hypot(*initial.T)
    angles = [
        calibration_targets(load_design(name), "prs", "test")["pdc"].theta_max_rad for name in ("initial", "optimised")
    ]
    assert (np.sign(ratio - 1.0) == np.sign(angles[1] - angles[0])).all()
    assert (np.abs(ratio - 1.0) > 0.03).all()


def test_a_name_and_its_numbers_are_the_same_gripper(gripper_with):
    assert gripper_with("initial") == gripper_with({"a_mm": 2.5, "b_mm": 2.0}) == load_gripper()


def test_a_name_that_no_design_has_is_refused_with_those_that_there_are(gripper_with):
    with pytest.raises(ConfigError, match=r"own_gripper\.yaml: design: no design 'best'; known: initial, optimised"):
        gripper_with("best")


def test_numbers_outside_the_domain_are_refused(gripper_with):
    with pytest.raises(ConfigError, match="nearest design inside is a = 3.5, b = 2 mm"):
        gripper_with({"a_mm": 3.6, "b_mm": 2.0})


@pytest.mark.parametrize("design", [None, 2.5, ["initial"], {"a_mm": 2.5}])
def test_what_is_neither_a_name_nor_a_design_is_refused(gripper_with, design):
    with pytest.raises(ConfigError, match=r"own_gripper\.yaml: design: "):
        gripper_with(design)
