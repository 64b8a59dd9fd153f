"""The run from a drawing to a muscle that grasps: what goes on, what is left out, what is refused."""

import dataclasses
import json
import shutil
from functools import partial

import numpy as np
import pytest
import yaml

pytest.importorskip("felupe")
from mbpam_ros.actuator.drawing import load_drawing
from mbpam_ros.actuator.end_law import finite_element_end_law
from mbpam_ros.actuator.gas_volume import gas_volume_tables
from mbpam_ros.actuator.metamodel import METAMODELS
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import ConfigError, config_directory, load_yaml
from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.registry import build_pneumatics
from mbpam_ros.simulation import Simulation, grasp_and_lift
from mbpam_ros.study.design import compare_metamodels, optimise_design
from mbpam_ros.study.design.latin_hypercube import optimal_latin_hypercube
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.muscle import build, samples
from mbpam_ros.study.muscle.findings import Findings
from mbpam_ros.study.muscle.samples import ranges_of
from mbpam_ros.study.silicone.known import largest_stretch_of

PAPER = load_drawing("paper")
CHAMBER = load_pneumatics().chamber
RAN: list[str] = []


def similar_row(name, run, _):
    """What a design does by the paper's first table in spirit: wider with a, narrower with b; force the other way."""
    RAN.append(name)
    geometry = run.geometry
    a, b = (10.0 / geometry.outer_radius_mm * each for each in (geometry.a_mm, geometry.b_mm))
    if b > 2.9 and a > 3.0:
        raise LoadStepError("stopped at 80 kPa", 80.0)
    row = {"name": name, "pattern": run.pattern, "a_mm": geometry.a_mm, "b_mm": geometry.b_mm, "c_mm": geometry.c_mm}
    bend, force = 60.0 * a - 25.0 * b + 50.0, 1.0 - 0.15 * a - 0.08 * (b - 1.5) ** 2
    wall = {"stretch_max": 1.5 + 0.2 * a, "stretch_99": 1.4 + 0.2 * a, "stress_max_mpa": 1.0, "stress_99_mpa": 0.8}
    return {**row, "n": geometry.wave_count, "theta_max_deg": bend, "f_max_n": force, **wall}


@pytest.fixture
def half(tmp_path, monkeypatch):
    """A configuration with a muscle of half the size, whose finite elements are a formula and whose law is similar."""
    own = tmp_path / "config"
    shutil.copytree(config_directory(), own, ignore=shutil.ignore_patterns("data"))
    (own / "data").symlink_to(config_directory() / "data")
    text = (own / "muscles" / "paper.yaml").read_text()
    for name in ("outer_radius_mm", "active_length_mm", "end_length_mm", "a_mm", "b_mm", "c_mm"):
        value = getattr(PAPER, name)
        text = text.replace(f"{name}: {value}", f"{name}: {0.5 * value}")
    (own / "muscles" / "half.yaml").write_text(text)
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(own))
    monkeypatch.setattr(samples, "sample_row", similar_row)
    monkeypatch.setattr(build, "law_table", similar_law)
    monkeypatch.setattr(build, "end_effect_table", ends_that_turn_twice_as_far)
    for module in (compare_metamodels, optimise_design):  # one is enough to go through
        monkeypatch.setattr(module, "METAMODELS", {"prs": METAMODELS["prs"]})
    monkeypatch.setattr(optimise_design, "GRID", 61)
    monkeypatch.setattr(build, "optimal_latin_hypercube", partial(optimal_latin_hypercube, restarts=1))
    RAN.clear()
    return own


def similar_law(run, path, executor, progress, pressures_kpa, bends_deg):
    """The paper's law at the size of ``run``: moments with its third power, stiffnesses with the second and fourth."""
    size = run.geometry.outer_radius_mm / 10.0
    law = json.loads((config_directory() / "data" / "fe_bending_law.json").read_text())
    law["settings"]["geometry"]["active_length_mm"] *= size
    powers = {"moment_n_mm": 3, "gas_volume_mm3": 3, "axial_stiffness_n": 2}
    powers |= dict.fromkeys(("torsion_stiffness_n_mm2", "bend_stiffness_n_mm2", "side_bend_stiffness_n_mm2"), 4)
    for row in law["tables"]:
        for name, power in powers.items():
            row[name] = [value * size**power for value in row[name]]
        row["missing"] = []
    path.write_text(json.dumps(law))
    return {**law, "failures": {}}


def ends_that_turn_twice_as_far(model, path, executor, progress, pressures_kpa):
    """The paper's ends at the size of ``model``, but for their turn."""
    size = model.geometry.outer_radius_mm / 10.0
    ends = json.loads((config_directory() / "data" / "fe_ends.json").read_text())
    factors = {"turn_deg": 2.0, "length_mm": size, "shift_mm": size, "shear_per_n": size**-2}
    factors["compliance_rad_per_n_mm"] = size**-3
    for row in ends["ends"]:
        row |= {name: [factor * value for value in row[name]] for name, factor in factors.items()}
    path.write_text(json.dumps(ends))
    return {**ends, "failures": {}}


def lifts_a_ball_of_30_mm(config, gripper):
    """Whether a gripper of half the size grasps, holds and lifts it, with chambers of volumes of their own."""
    ball = {"shape": "sphere", "size_m": [0.03, 0.03, 0.03], "mass_kg": 0.008, "colour_rgb": [1.0, 0.0, 0.0]}
    objects = load_yaml("objects.yaml")
    objects["objects"]["ball"] = objects["objects"]["bulb"] | ball
    (config / "objects.yaml").write_text(yaml.safe_dump(objects))
    scene = load_yaml("scenes/bulb.yaml") | {"object": "ball", "object_position_m": [0.0, 0.0, 0.0425]}
    scene["support"] = {"depth_m": 0.0575, "half_size_m": [0.005, 0.005], "stand_height_m": 0.1}
    (config / "scenes" / "ball.yaml").write_text(yaml.safe_dump(scene))
    request = FidelityRequest(tier="arc", pneumatics="iso6358", sub_step_s=0.002)
    simulation = Simulation("ball", request, gripper)
    seen = grasp_and_lift(simulation)
    lifted_m = 0.0425 - float(seen.objects[0].in_world.position_m[2])
    return simulation.decision.phase is Phase.HOLDING and lifted_m > 0.09


def test_the_run_goes_on_where_it_was_and_ends_in_a_gripper_of_that_muscle(half, capsys):
    command = ["muscle", "build", "half", "--samples", "14", "--checks", "4", "--patterns", "pdc", "--workers", "1"]
    assert main([*command, "--keep-as", "half_chosen", "--ends", "coarse"]) == 0
    said = capsys.readouterr().out
    assert "muscle: half, target: fe" in said and "at what stretch it tears is not known" in said
    folder = half / "muscles" / "half"
    front = json.loads((folder / "front.json").read_text())
    offered, checked = (of["gain_force_at_equal_angle_pct"] for of in (front, front["finite_elements"]))
    assert checked == pytest.approx(offered, abs=3.0) and len(front["finite_elements"]["designs"]) == 5
    assert set(front["judged"]) <= {"left out", "checks"} and len(front["pareto"]) > 10
    assert "<h2>Drawing</h2>" in (folder / "report.html").read_text()
    ran = len(RAN)
    assert main(command) == 0 and len(RAN) <= ran + 1  # what failed is tried again, nothing else
    rows = json.loads((folder / "samples.json").read_text())["samples"]
    assert main(["muscle", "build", "half", "--samples", "0", "--patterns", "pdc", "--workers", "1"]) == 0
    assert json.loads((folder / "samples.json").read_text())["samples"] == rows  # a smaller run loses none
    chosen = load_drawing("half_chosen")
    assert (chosen.a_mm, chosen.b_mm) == pytest.approx((front["chosen"]["a_mm"], front["chosen"]["b_mm"]), abs=1e-3)
    (half / "gripper.yaml").write_text(
        "muscle: half\ntarget: fe\nfinger_circle_radius_m: 0.025\npressure_limit_gauge_pa: 110000.0\n"
        "over_pressure_gauge_pa: 120000.0\n"
    )
    small = load_gripper()
    assert small.geometry.length_m == pytest.approx(0.065)
    eighth = gas_volume_tables().pdc / 8.0
    assert np.allclose(gas_volume_tables(small.gas_law).pdc, eighth, rtol=1e-9, atol=0.0)
    air = [build_pneumatics("iso6358", CHAMBER, law).amount_j for law in (small.gas_law, None)]
    assert (air[0] - air[1]).max() < 0.0  # what the plant lets in
    assert lifts_a_ball_of_30_mm(half, small)
    moment, stiffness = small.rod_law().at_nominal_pressure("pdc")
    (folder / "ends.json").unlink()  # then similar to the paper's, whose turn is half as far
    similar, _ = small.rod_law().at_nominal_pressure("pdc")
    turn_rad = finite_element_end_law().of_pattern("pdc", 100e3).turn_rad
    assert moment - similar == pytest.approx(2.0 * stiffness * turn_rad / small.rod_geometry.active_length_m, rel=1e-3)
    assert small.muscle == "half" and 0.0 < moment < 0.01 and 0.0 < stiffness < 3e-4
    with pytest.raises(ConfigError, match="target test is the paper's muscle"):
        (half / "gripper.yaml").write_text((half / "gripper.yaml").read_text().replace("target: fe", "target: test"))
        load_gripper()


def test_a_sample_without_equilibrium_is_named_and_left_out_and_too_many_are_refused(half, capsys, monkeypatch):
    monkeypatch.setattr(build, "front_of", lambda *_: None)
    command = ["muscle", "build", "half", "--checks", "0", "--patterns", "pdc", "--workers", "1", "--samples", "14"]
    assert main([*command, "--seed", "3"]) == 0
    kept = json.loads((half / "muscles" / "half" / "samples.json").read_text())
    said = capsys.readouterr().out
    for name in kept["failures"]:
        assert f"warning: {name} is left out" in said

    def failing(name, run, wall):
        if name.startswith("sample"):
            raise LoadStepError("stopped at 20 kPa", 20.0)
        return similar_row(name, run, wall)

    monkeypatch.setattr(samples, "sample_row", failing)
    assert main([*command, "--seed", "5"]) == 1
    assert "of 15 samples have no equilibrium, more than 30 %" in capsys.readouterr().err


def test_the_ranges_of_a_similar_muscle_are_similar_and_the_papers_are_the_papers():
    assert ranges_of(PAPER)["a_mm"] == (1.5, 3.5) and ranges_of(PAPER)["n"] == (6.0, 14.0)
    lengths = ("outer_radius_mm", "active_length_mm", "end_length_mm", "a_mm", "b_mm", "c_mm")
    half = dataclasses.replace(PAPER, **{name: 0.5 * getattr(PAPER, name) for name in lengths})
    assert ranges_of(half)["b_mm"] == (0.5, 1.5) and ranges_of(half)["n"] == (6.0, 14.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"c_mm": 6.5}, "no chamber is left in the valleys"),
        ({"wave_count": 60.0}, "fills the folds"),
        ({"a_mm": -1.0}, "a_mm must be greater than 0"),
        ({"density_kg_m3": 1.07}, "is no silicone's"),
    ],
)
def test_a_drawing_that_is_no_muscle_is_one_line(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(PAPER, **change)


def test_what_a_silicone_bears_is_of_its_data_or_of_its_test(tmp_path):
    assert largest_stretch_of("rtv615") == pytest.approx(2.932) and largest_stretch_of("e625") is None
    tested = {"models": {"yeoh": {"constants": {"c10_mpa": 0.1, "c20_mpa": 0.0, "c30_mpa": 0.0}}}}
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({**tested, "tests": [{"strain": [0.0, 3.1]}, {"strain": [0.0, 2.6]}]}))
    assert largest_stretch_of(str(path)) == pytest.approx(3.6)
    path.write_text(json.dumps(tested))
    with pytest.raises(ConfigError, match="does not say how far was pulled"):
        largest_stretch_of(str(path))
    wall = {"stretch_max": 2.4, "stretch_99": 2.0, "stress_99_mpa": 1.0}
    told = [Findings([{"name": "drawing pdc", **wall}], {}, None, {}, None, limit).wall_text for limit in (2.3, 2.9)]
    assert "it may BURST, specimens of it bore 2.30" in told[0] and told[1].endswith("specimens of it bore 2.90")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "no muscle 'nobody'; known:"),
        (["paper", "--law-to", "90"], "--law-to must be 100 to 200 kPa"),
        (["paper", "--patterns", "psc"], "--patterns psc: pdc, or pdc,psc"),
        (["paper", "--keep-as", "paper"], "no drawing that there is already"),
        (["../paper"], "a muscle is named by letters, digits, _ and -, without path or suffix, found '../paper'"),
        (["paper", "--largest-stretch", "0"], "--largest-stretch must be above 1"),
    ],
)
def test_what_cannot_be_built_is_one_line(arguments, message, capsys):
    assert main(["muscle", "build", *arguments]) == 1
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_the_section_is_that_of_the_finite_elements():
    from mbpam_ros.study.fe.mesh import CellGeometry
    from mbpam_ros.study.fe.posture import weight_n_mm

    weight = weight_n_mm(CellGeometry())
    assert 9.81 * PAPER.geometry.mass_per_length_kg_m * 1e-3 == pytest.approx(weight, rel=1e-3)
    assert np.isclose(PAPER.geometry.mass_per_length_kg_m, load_gripper().geometry.mass_per_length_kg_m, rtol=2e-3)
