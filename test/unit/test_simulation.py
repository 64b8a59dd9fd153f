"""The gripper without ROS, as a program of one's own uses it."""

import dataclasses
import doctest
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mbpam_ros
from mbpam_ros import MbpamError, Phase, Simulation, load_gripper, load_scene
from mbpam_ros.actuator.named_designs import load_design
from mbpam_ros.configuration import ConfigError
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.simulation import TICK_S, BatchError, SimulationTimeError
from mbpam_ros.study.executors import open_executor

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("design", ["initial", "optimised"])
def test_the_loops_close_with_every_named_design_and_the_same_run_gives_the_same_bits(design):
    gripper = dataclasses.replace(load_gripper(), design=load_design(design))

    def run():
        simulation = Simulation(*load_scene("bulb"), gripper)
        simulation.run(0.1)
        assert simulation.grasp().accepted
        simulation.run(1.0)
        assert simulation.decision.phase is Phase.HOLDING
        return simulation.seen.centreline_m

    first = run()
    assert first.tobytes() == run().tobytes()


def test_a_mode_by_name_closes_also_where_there_is_nothing():
    simulation = Simulation("empty")
    simulation.run(0.1)
    assert simulation.grasp().reason == "no object in view"
    assert simulation.grasp("mid_rod").accepted
    simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING, limit_s=3.0)
    assert simulation.release().accepted
    simulation.run_until(lambda: simulation.decision.phase is Phase.IDLE, limit_s=5.0)
    assert (simulation.seen.pressure_gauge_pa < 5e3).all()


def test_a_stop_vents_at_once_and_a_reset_ends_it():
    simulation = Simulation("empty")
    simulation.run(0.1)
    simulation.grasp("envelope")
    simulation.run_until(lambda: simulation.seen.pressure_gauge_pa.max() > 50e3)
    assert simulation.stop().accepted
    assert not simulation.reset().accepted
    stopped_pa = simulation.seen.pressure_gauge_pa
    inflated = stopped_pa > 20e3
    simulation.run(0.1)
    assert (simulation.seen.pressure_gauge_pa[inflated] < 0.8 * stopped_pa[inflated]).all()
    simulation.run_until(lambda: simulation.reset().accepted, limit_s=5.0)
    simulation.run(TICK_S)
    assert simulation.decision.phase is Phase.IDLE
    assert simulation.grasp("envelope").accepted
    simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING, limit_s=3.0)


def test_a_duration_that_is_no_whole_number_of_ticks_is_refused_and_changes_nothing():
    simulation = Simulation("empty")
    for duration_s in (0.015, -0.01, float("nan"), float("inf")):
        with pytest.raises(SimulationTimeError, match="no whole number of ticks of 0.01 s"):
            simulation.run(duration_s)
    assert simulation.seen.time_s == 0.0
    assert simulation.run(0.0).time_s == 0.0
    assert simulation.run(0.03).time_s == pytest.approx(0.03)


def test_what_does_not_come_in_time_says_what_the_gripper_does_instead():
    simulation = Simulation("empty")
    with pytest.raises(SimulationTimeError, match=r"not within 0.05 s of simulated time; the gripper is idle: open"):
        simulation.run_until(lambda: False, limit_s=0.05)
    assert simulation.seen.time_s == pytest.approx(0.05)


FRICTIONS, PRESSURES_PA = (0.3, 0.6, 0.9), (80e3, 90e3, 100e3)


def swept_scenes():
    """A sweep of friction, pressure and pose at once."""
    bulb, _ = load_scene("bulb")
    x, y, z = bulb.object_position_m
    return [
        dataclasses.replace(bulb, friction_coefficient=friction, object_position_m=(x + 0.001 * number, y, z))
        for number, friction in enumerate(FRICTIONS)
    ]


def closed_on(simulation):
    """Close for half a second, and say what was seen."""
    simulation.run(0.1)
    simulation.grasp()
    seen = simulation.run(0.5)
    return seen.centreline_m.tobytes(), seen.object_in_world.position_m.tobytes(), seen.transducer_v.tobytes()


FAST = Fidelity("rod", 2, 0.005, "iso6358")


@pytest.fixture(scope="module")
def closed_one_by_one():
    runs = zip(swept_scenes(), PRESSURES_PA, range(3), strict=True)
    return [closed_on(Simulation(scene, FAST, None, pressure, seed)) for scene, pressure, seed in runs]


def closed_in_a_batch(**how):
    return Simulation.batch(
        swept_scenes(), closed_on, fidelity=FAST, grip_pressure_gauge_pa=PRESSURES_PA, seed=range(3), **how
    )


@pytest.mark.parametrize("workers", [1, 3])
def test_a_batch_on_threads_gives_the_bits_of_single_runs(workers, closed_one_by_one):
    assert len(set(closed_one_by_one)) == 3
    assert closed_in_a_batch(workers=workers) == closed_one_by_one


@pytest.mark.slow
def test_a_batch_on_a_dask_cluster_gives_the_bits_of_one_on_threads():
    pytest.importorskip("distributed")
    with open_executor(1, "local") as executor:
        found = [Simulation.batch(swept_scenes()[:2], fidelity=FAST, executor=each) for each in (executor, None)]
    for there, here in zip(*found, strict=True):
        assert there.object_in_world.position_m.tobytes() == here.object_in_world.position_m.tobytes()
        assert there.centreline_m.tobytes() == here.centreline_m.tobytes()


def test_a_batch_says_which_numbers_do_not_fit_its_scenes():
    with pytest.raises(
        BatchError, match="grip_pressure_gauge_pa: one for all scenes, or one for each of the 3, found 2"
    ):
        Simulation.batch(swept_scenes(), closed_on, grip_pressure_gauge_pa=(80e3, 90e3))
    with pytest.raises(BatchError, match="at least 1 worker, found 0"):
        Simulation.batch(swept_scenes(), closed_on, workers=0)


def test_what_a_scene_of_a_batch_raises_comes_out_of_it():
    with pytest.raises(ConfigError, match="no scene 'piano'"):
        Simulation.batch(["bulb", "piano"], lambda simulation: None)


def test_a_batch_grasps_and_lifts_unless_told_otherwise():
    (held, empty) = Simulation.batch([load_scene("bulb")[0], "empty"], fidelity=FAST)
    rise_m = 0.115 - 0.030 - held.object_in_world.position_m[2]
    assert rise_m > 0.09 and held.hand_lift_m == pytest.approx(0.1)
    assert empty.hand_lift_m == 0.0 and empty.time_s == pytest.approx(1.3)


def test_the_public_names_are_there_and_no_other():
    for name in mbpam_ros.__all__:
        assert getattr(mbpam_ros, name).__doc__
    assert dir(mbpam_ros) == mbpam_ros.__all__
    with pytest.raises(AttributeError, match="no attribute 'Grippr'; it has Answer, .*, Gripper"):
        mbpam_ros.Grippr  # noqa: B018
    assert issubclass(SimulationTimeError, MbpamError)


def test_the_package_alone_loads_neither_arrays_nor_the_compiler():
    code = "import sys, mbpam_ros; print(sorted({'numpy', 'numba', 'rclpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_example_in_the_package_s_docstring_is_true():
    result = doctest.testmod(mbpam_ros)
    assert result.attempted > 3 and result.failed == 0


@pytest.mark.slow
def test_the_example_runs():
    command = [sys.executable, EXAMPLES / "grasp_without_ros.py"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert ended.returncode == 0 and not ended.stderr
    assert "hand up by 100 mm, object by 100 mm" in ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("installed", [True, False])
def test_the_sweep_gives_the_same_map_on_a_cluster_and_without_dask(installed):
    if installed:
        pytest.importorskip("distributed")
    hidden = "" if installed else "import sys; sys.modules['distributed'] = None; "
    program = f"{hidden}import runpy; runpy.run_path({str(EXAMPLES / 'sweep_on_dask.py')!r}, run_name='__main__')"
    command = [sys.executable, EXAMPLES / "sweep_on_dask.py"] if installed else [sys.executable, "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=200)
    assert ended.returncode == 0, ended.stderr
    assert [line.split(":")[0] for line in ended.stdout.splitlines()] == [
        "friction 0.05,  60 kPa",
        "friction 0.05, 100 kPa",
        "friction 0.60,  60 kPa",
        "friction 0.60, 100 kPa",
    ]
    outcomes = [line.split(": ")[1].split(",")[0] for line in ended.stdout.splitlines()]
    assert outcomes[3] == "held"


def test_the_bulb_of_the_example_is_held_and_rises_with_the_hand():
    simulation = Simulation("bulb")
    rest_m = simulation.run(0.3).object_in_world.position_m
    assert simulation.grasp().accepted
    simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING)
    assert simulation.lift().accepted
    held = simulation.run(2.0)
    assert held.hand_lift_m == pytest.approx(0.1)
    assert 0.09 < rest_m[2] - held.object_in_world.position_m[2] < 0.13
    assert simulation.lower().accepted
    lowered = simulation.run(2.0)
    assert lowered.hand_lift_m == pytest.approx(0.0) and np.isfinite(lowered.finger_force_n).all()
