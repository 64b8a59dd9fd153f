"""A scene measured by itself."""

import dataclasses

import pytest

from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest, FidelityTable, Tolerance
from mbpam_ros.plant.planner import plan
from mbpam_ros.plant.scene import SupportConfig, load_scene
from mbpam_ros.study.fidelity import own_measurement
from mbpam_ros.study.fidelity.own_measurement import measured_table, own_case

GRIPPER = load_gripper()
EMPTY, BULB = (load_scene(name)[0] for name in ("empty", "bulb"))
NOTHING = FidelityTable((), {}, {}, {})


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    monkeypatch.setattr(own_measurement, "_NEAR", Fidelity("rod", 3, 0.001, "iso6358"))
    monkeypatch.setattr(own_measurement, "_CALLS_PER_TICK", 2)


def test_what_is_run_is_the_scenes_own_grasp_at_the_pressure():
    case = own_case(BULB, 70e3)
    assert case.scene is BULB and case.lift_s is not None
    assert case.wanted_gauge_pa(1.0).max() == pytest.approx(70e3)
    assert own_case(EMPTY, 70e3).lift_s is None


def test_a_plan_from_a_measurement_is_of_what_was_run(monkeypatch):
    few = (Fidelity("rod", 2, 0.005, "iso6358"), Fidelity("rod", 2, 0.01, "lag"))
    monkeypatch.setattr(own_measurement, "fidelities", lambda pneumatics: few)
    found = measured_table(EMPTY, False, NOTHING, 60e3, [("bend",)], GRIPPER)
    assert {row.fidelity for row in found.promises} == set(few)
    made = plan(EMPTY, GRIPPER.geometry.length_m, found, FidelityRequest(tolerance=Tolerance(1.0, 1.0, 1.0)))
    assert made.within_tolerance
    assert (made.fidelity.sub_step_s, made.fidelity.pneumatics) == (few[0].sub_step_s, few[0].pneumatics)


def test_no_more_is_run_than_there_is_time_for(monkeypatch):
    monkeypatch.setattr(own_measurement, "BUDGET_S", 0.0)
    assert measured_table(EMPTY, False, NOTHING, 60e3, [("bend",)], GRIPPER).promises == ()


def test_a_scene_without_a_grasp_of_its_own_is_refused():
    table = dataclasses.replace(EMPTY, support=SupportConfig(0.14))
    with pytest.raises(ConfigError, match="there is no case to measure"):
        measured_table(table, True, NOTHING, 60e3, [("bend",)], GRIPPER)
