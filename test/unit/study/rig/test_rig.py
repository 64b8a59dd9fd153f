"""The rig: from a hidden muscle over its curves to factors that bring the estimator to it; and what it refuses."""

import dataclasses
import json
import math

import numpy as np
import pytest

from mbpam_ros.actuator.drawing import load_drawing
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.rig import MuscleRig, hidden_muscle
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.study.rig.curves import COLUMNS, as_json, averaged, csv_text, read_curves
from mbpam_ros.study.rig.fit import CalibrationError, fit_muscle, predicted
from mbpam_ros.study.rig.judge import is_good, judged_row, verdict
from mbpam_ros.study.rig.procedure import BEND, FORCE, Plan, RigError, characterise, mounts_of
from mbpam_ros.study.rig.simulated import SimulatedRig

GRIPPER = load_gripper()
CONFIG = load_scene("rig")[0].rig
LAW, GEOMETRY = GRIPPER.rod_law(), GRIPPER.rod_geometry
PLAN = Plan(mounts_of(["pdc", "psc"]), tuple(np.arange(0.0, 101.0, 20.0).tolist()), repeats=1)


def rig(seed=1, **changes):
    config = dataclasses.replace(CONFIG, muscle_seed=seed, **changes)
    return SimulatedRig(MuscleRig(hidden_muscle(LAW, config), GEOMETRY, config, seed), seed)


@pytest.fixture(scope="module")
def samples():
    return characterise(rig(), PLAN)


@pytest.fixture(scope="module")
def points(samples):
    return averaged(samples)


def test_calibration_brings_hidden_muscles_within_2_percent_and_2_degrees():
    rows = [judged_row(GRIPPER, dataclasses.replace(CONFIG, muscle_seed=seed), 1, 20.0) for seed in (1,)]
    found = verdict(rows)
    assert is_good(found), found
    assert found["bend_before_rms_deg"] > 2.0 * found["bend_rms_deg"]


def test_the_curves_have_the_lag_of_their_hysteresis_and_come_back_from_their_file(points, samples, tmp_path):
    def curve(quantity, branch):
        return np.array([p.mean for p in points if (p.pattern, p.quantity, p.branch) == ("pdc", quantity, branch)])

    for quantity in (BEND, FORCE):
        up, down = curve(quantity, "up"), curve(quantity, "down")
        assert (np.diff(up) > 0.0).all()
        if quantity == BEND:  # a force has its plate's friction besides
            assert (down[1:] > up[1:-1]).all()
    file = tmp_path / "curves.json"
    file.write_text(json.dumps(as_json(points, {})))
    assert read_curves(file) == points
    lines = csv_text(samples).splitlines()
    assert lines[0] == ",".join(COLUMNS) and len(lines) == 1 + len(samples)
    assert sum(p.samples for p in points) == len(samples)


def test_without_forces_only_the_weight_tells_moment_from_stiffness_and_what_is_not_told_is_said(points):
    true = hidden_muscle(LAW, dataclasses.replace(CONFIG, muscle_seed=1)).pdc
    bends = [point for point in points if point.quantity == BEND and point.pattern == "pdc"]
    fitted, whole = fit_muscle(LAW, GEOMETRY, bends), fit_muscle(LAW, GEOMETRY, points)
    assert fitted.pdc.moment / fitted.pdc.stiffness == pytest.approx(true.moment / true.stiffness, rel=0.01)
    assert fitted.sigma["pdc_moment"] > 2.0 * whole.sigma["pdc_moment"]
    assert any("psc: not measured" in text for text in fitted.undetermined)
    assert any("stretch: not determined" in text for text in fitted.undetermined)
    assert fitted.psc == fitted.pdc


def test_a_muscle_that_is_its_drawing_has_factors_of_one(points):
    points = [point for point in points if point.pattern == "pdc"]
    exact = predicted(LAW, GEOMETRY, points, 0.0)
    drawn = [dataclasses.replace(p, mean=float(value), spread=0.0) for p, value in zip(points, exact, strict=True)]
    fitted = fit_muscle(LAW, GEOMETRY, drawn)
    assert [fitted.pdc.moment, fitted.pdc.stiffness, fitted.stretch] == pytest.approx([1.0] * 3, abs=2e-3)
    assert fitted.hysteresis_pa < 50.0


class Spoiled:
    """A rig of which something is wrong from a moment on."""

    def __init__(self, spoil, after=60):
        self._rig, self._spoil, self._left = rig(), spoil, after
        self.mount, self.command = self._rig.mount, self._rig.command

    def read(self):
        self._left -= 1
        reading = self._rig.read()
        return self._spoil(reading) if self._left < 0 else reading


def _lost(_):
    raise RigError("no picture for 1 s on camera/image_raw")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_lost, "no picture"),
        (lambda r: dataclasses.replace(r, force_n=r.force_n + 0.5), "should be free; take the plate away"),
        (lambda r: dataclasses.replace(r, pressure_pa=(2e4,) * 4), "not settled at .*chamber"),
        (lambda r: dataclasses.replace(r, bend_rad=r.bend_rad + 0.1 * math.sin(9.0 * r.time_s)), "the bend spreads by"),
        (lambda r: dataclasses.replace(r, pressure_pa=(math.nan,) * 4), "not settled at"),
    ],
)
def test_what_is_off_ends_the_measurement_with_one_line(spoil, message):
    with pytest.raises(RigError, match=message) as error:
        characterise(Spoiled(spoil), dataclasses.replace(PLAN, timeout_s=3.0))
    assert "\n" not in str(error.value)


def test_a_scale_whose_zero_has_moved_is_refused():
    def warm(reading):
        return dataclasses.replace(reading, force_n=reading.force_n + 2e-4 * reading.time_s)

    plan = dataclasses.replace(PLAN, mounts=mounts_of(["pdc"], quantities=[FORCE]), pressures_kpa=(0.0, 20.0, 40.0))
    with pytest.raises(RigError, match="without pressure the scale shows .* more at the end"):
        characterise(Spoiled(warm, after=0), dataclasses.replace(plan, repeats=5, zero_shift_n=0.003))


def test_the_verb_keeps_what_it_found_and_plant_and_estimator_use_it(points, tmp_path, monkeypatch, capsys):
    import shutil

    from mbpam_ros.configuration import config_directory

    own = tmp_path / "config"
    shutil.copytree(config_directory(), own, ignore=shutil.ignore_patterns("data", "muscles", "measured.json"))
    (own / "data").symlink_to(config_directory() / "data")
    (own / "muscles").mkdir()
    shutil.copy(config_directory() / "muscles" / "paper.yaml", own / "muscles")
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(own))
    drawing = load_drawing("paper")
    measured = dataclasses.replace(GRIPPER, target="measured", design=drawing.design, geometry=drawing.geometry)
    with pytest.raises(ConfigError, match="'paper' was not measured"):
        measured.calibration()
    file = tmp_path / "curves.json"
    file.write_text(json.dumps(as_json(points, {})))
    assert main(["muscle", "calibrate", "paper", "--from", str(file)]) == 0
    assert "scatter between muscles: one was measured" in capsys.readouterr().out
    calibration = measured.calibration()
    true = hidden_muscle(LAW, dataclasses.replace(CONFIG, muscle_seed=1))
    assert calibration.law.at_nominal_pressure("pdc") == pytest.approx(true.law.at_nominal_pressure("pdc"), rel=0.02)
    assert calibration.hysteresis_pa == pytest.approx(true.hysteresis_pa, rel=0.4)
    unnamed = (own / "gripper.yaml").read_text().replace("target: test", "target: measured")
    (own / "unnamed.yaml").write_text(unnamed)
    with pytest.raises(ConfigError, match="say which muscle was measured"):
        load_gripper("unnamed.yaml")
    (own / "gripper.yaml").write_text(
        "muscle: paper\ntarget: measured\nfinger_circle_radius_m: 0.05\npressure_limit_gauge_pa: 110000.0\n"
        "over_pressure_gauge_pa: 120000.0\n"
    )
    found = load_gripper().rod_law().at_nominal_pressure("psc")
    assert found == calibration.law.at_nominal_pressure("psc")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: dataclasses.replace(p, mean=-p.mean), "no .* is above 0"),
        (lambda p: dataclasses.replace(p, mean=9.0 * p.mean), "drawn muscle .*to these curves"),
        (lambda p: dataclasses.replace(p, pressure_kpa=0.01 * p.pressure_kpa), "at least 4 are needed"),
    ],
)
def test_curves_of_no_such_muscle_are_one_line(points, change, message):
    with pytest.raises(CalibrationError, match=message):
        fit_muscle(LAW, GEOMETRY, [change(point) for point in points])


@pytest.mark.parametrize("content", ["", "[]", '{"curves": []}', '{"curves": [{"pattern": "pdc"}]}', '{"curves": [1]}'])
def test_a_file_that_is_none_of_the_rigs_is_one_line(content, tmp_path):
    file = tmp_path / "curves.json"
    file.write_text(content)
    with pytest.raises(ConfigError, match=r"curves\.json: (no file of mbpam characterise|its curves are empty)"):
        read_curves(file)


def test_the_verb_writes_samples_curves_and_what_was_measured_or_nothing(tmp_path, capsys):
    file = tmp_path / "curves.json"
    ramp = ["characterise", "--patterns", "pdc", "--pressures", "0:60:30", "--repeats", "1", "--json", str(file)]
    assert main([*ramp, "--simulated", "3", "--settle-s", "25"]) == 1
    assert "less than --timeout-s" in capsys.readouterr().err
    assert not file.exists()
    assert main([*ramp, "--simulated", "3"]) == 0
    assert json.loads(file.read_text())["measured"]["muscle"] == "paper"
    assert file.with_suffix(".csv").read_text().startswith("time_s,pattern")
    assert {point.quantity for point in read_curves(file)} == {BEND, FORCE}


@pytest.mark.parametrize("pressures", ["0:100", "0:100000:10000", "100:0:10", "0:100:0", "a:b:c"])
def test_pressures_that_cannot_be_are_one_line(pressures, capsys):
    with pytest.raises(SystemExit):
        main(["characterise", "--pressures", pressures, "--json", "x.json"])
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "--pressures" in said
