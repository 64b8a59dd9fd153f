import json
import math

import numpy as np
import pytest

from mbpam_ros.actuator.elastic_rod import RodLoads, rod_at_rest, rod_section
from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.actuator.rod_law import RodLaw, StrainLaw
from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import config_path
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.muscle_states import (
    MuscleState,
    MuscleStateError,
    RodModel,
    compared,
    kind_of_load,
    read_states,
    rod_answer,
    summary,
)

GEOMETRY = load_gripper().geometry
KEYS = ["pattern", "pressure_kpa", "tip_force_n", "tip_torque_n_mm", "gravity_m_s2"]
ANSWERS = ["tip_position_mm", "tip_direction", "tip_roll_deg", "tip_angle_deg"]


def law(torsion=1e-3):
    grid = np.array([0.0, 1e5])
    moment, stiffness = np.array([0.0, 0.04]), np.array([1.2e-3, 1.7e-3])
    strains = StrainLaw(np.array([0.0, 0.16]), np.array([0.0, -1e-3]), np.array([30.0, 20.0]), np.full(2, torsion))
    return RodLaw(grid, moment, moment, stiffness, stiffness, strains, strains)


MODEL, STIFF = RodModel(law(), GEOMETRY, STRAINS), RodModel(law(), GEOMETRY, ("bend",))


def test_the_answer_has_the_states_keys_and_the_rods_tip_in_the_files_units():
    state = MuscleState("pdc", 100.0, (0.0, 0.05, 0.0), 2.0, (0.0, 0.0, -9.81))
    answer = rod_answer(state, MODEL)
    assert list(answer) == KEYS + ANSWERS
    assert json.loads(json.dumps(answer)) == answer
    rod = rod_at_rest(
        rod_section(law(), [1e5, 0.0, 0.0, 1e5]), GEOMETRY, RodLoads((0.0, 0.05, 0.0), 2e-3, (0.0, 0.0, -9.81))
    )
    np.testing.assert_allclose(answer["tip_position_mm"], 1e3 * rod.tip_position_m)
    assert answer["tip_roll_deg"] == pytest.approx(math.degrees(rod.tip_roll_rad))
    assert MuscleState.of_row(answer) == state


@pytest.mark.parametrize(("pattern", "azimuth_deg"), [("pdc", 180.0), ("psc", 225.0)])
def test_the_patterns_bend_toward_their_azimuth(pattern, azimuth_deg):
    x, y, _ = rod_answer(MuscleState(pattern, 80.0), STIFF)["tip_position_mm"]
    assert math.degrees(math.atan2(y, x)) % 360.0 == pytest.approx(azimuth_deg, abs=1e-6)


def test_half_is_the_full_pressure_in_chamber_1_and_half_of_it_in_2():
    np.testing.assert_allclose(MuscleState("half", 80.0).pressure_gauge_pa, [8e4, 4e4, 0.0, 0.0])


@pytest.mark.parametrize(
    ("force", "torque", "kind"),
    [
        ((0.0, 0.0, 0.0), 0.0, "free"),
        ((0.0, 0.0, 0.0), -2.0, "torque"),
        ((0.0, 0.05, 0.0), 0.0, "sideways"),
        ((0.05, 0.0, 0.0), 0.0, "in plane"),
        ((-0.03, 0.0, -0.04), 0.0, "axial"),
        ((0.05, 0.05, 0.0), 0.0, "several"),
        ((0.05, 0.0, 0.0), 1.0, "several"),
    ],
)
def test_loads_are_told_apart_by_the_plane_of_the_bend_and_the_tips_direction(force, torque, kind):
    assert kind_of_load(MuscleState("pdc", 100.0, force, torque), law(), [-0.6, 0.0, -0.8]) == kind


def rows_of(states):
    return [rod_answer(state, MODEL) for state in states]


FREE, PUSHED, TURNED = (
    MuscleState("pdc", 100.0),
    MuscleState("pdc", 100.0, (0.0, 0.05, 0.0)),
    MuscleState("pdc", 100.0, (0.0, 0.0, 0.0), 2.0),
)


def test_a_rod_beside_itself_is_off_by_nothing():
    found = compared(rows_of([PUSHED, FREE, TURNED]), MODEL)
    assert [each["kind"] for each in found] == ["sideways", "free", "torque"]
    for each in found:
        assert each["tip_error_mm"] == each["roll_error_deg"] == 0.0
    assert found[0]["displacement_ratio"] == pytest.approx(1.0) and found[0]["displacement_error_pct"] == 0.0
    assert "displacement_mm" not in found[1]


def test_a_torque_on_a_straight_muscle_is_compared_by_its_roll_only():
    straight, turned = MuscleState("pdc", 0.0), MuscleState("pdc", 0.0, (0.0, 0.0, 0.0), 2.0)
    found = compared(rows_of([straight, turned]), RodModel(law(torsion=2e-3), GEOMETRY, STRAINS))[1]
    assert "displacement_ratio" not in found and found["tip_error_mm"] == pytest.approx(0.0, abs=1e-9)
    assert found["roll_error_deg"] == pytest.approx(-math.degrees(2.0 * 0.1 / 2.0), rel=1e-6)


def test_a_rod_that_cannot_twist_is_off_as_its_displacements_say():
    reference = rows_of([FREE, PUSHED])
    free, pushed = compared(reference, RodModel(law(), GEOMETRY, ("bend", "stretch")))
    assert free["tip_error_mm"] == pytest.approx(0.0, abs=1e-9)
    moved = np.subtract(pushed["tip_position_mm"], free["tip_position_mm"])
    expected = np.subtract(reference[1]["tip_position_mm"], reference[0]["tip_position_mm"])
    np.testing.assert_allclose(pushed["displacement_mm"], moved)
    np.testing.assert_allclose(pushed["reference_displacement_mm"], expected)
    off = np.linalg.norm(moved - expected)
    assert pushed["displacement_error_pct"] == pytest.approx(100.0 * off / np.linalg.norm(expected))
    assert pushed["tip_error_pct"] == pytest.approx(pushed["tip_error_mm"]) == pytest.approx(off)
    assert 0.1 < pushed["displacement_ratio"] < 0.7
    assert abs(pushed["roll_error_deg"]) > 1.0
    kinds = summary([free, pushed])
    assert [row["kind"] for row in kinds] == ["free", "sideways"]
    assert kinds[1]["displacement_error_pct_worst"] == pytest.approx(pushed["displacement_error_pct"])
    assert "displacement_error_pct_rms" not in kinds[0]


def test_a_file_of_states_is_read_and_one_that_is_none_is_refused_with_its_place(tmp_path):
    path = tmp_path / "states.json"
    rows = rows_of([FREE, PUSHED])
    path.write_text(json.dumps({"states": rows, "settings": {"mass_per_length_kg_m": {"waves": 0.17, "ends": 0.1}}}))
    assert read_states(path) == (rows, 0.17)
    path.write_text(json.dumps({"states": rows, "mesh": "fine"}))
    assert read_states(path) == (rows, None)
    del rows[1]["tip_direction"]
    for content, message in (("{}", "no file of muscle states"), (json.dumps({"states": rows}), "state 2: 'tip_dir")):
        path.write_text(content)
        with pytest.raises(MuscleStateError, match=message):
            read_states(path)
    with pytest.raises(MuscleStateError, match="absent.json"):
        read_states(tmp_path / "absent.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pattern": "tsc"}, "'tsc'; known: pdc, psc, half"),
        ({"pressure_kpa": -1.0}, "0 or more"),
        ({"pressure_kpa": math.nan}, "0 or more"),
        ({"tip_force_n": (0.0, 0.0, math.inf)}, "tip_force_n"),
        ({"gravity_m_s2": (0.0, 0.0)}, "gravity_m_s2"),
    ],
)
def test_what_describes_no_state_is_refused(change, message):
    with pytest.raises(MuscleStateError, match=message):
        MuscleState(**{"pattern": "pdc", "pressure_kpa": 50.0, **change})


def test_the_verb_prints_the_tip_and_writes_state_answer_and_model(tmp_path, capsys):
    path = tmp_path / "rod.json"
    arguments = ["rod", "--pattern", "psc", "--pressure-kpa", "80", "--tip-force", "-0.02,0,0", "--tip-torque", "-1"]
    assert main([*arguments, "--gravity", "9.81,0,0", "--strains", "bend", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    assert [result[key] for key in KEYS] == ["psc", 80.0, [-0.02, 0.0, 0.0], -1.0, [9.81, 0.0, 0.0]]
    assert set(ANSWERS) < result.keys() and (result["strains"], result["ends"]) == (["bend"], "silicone")
    assert f"{result['tip_angle_deg']:.2f} deg" in capsys.readouterr().out


def test_the_verb_compares_with_a_file_of_states(tmp_path, capsys):
    states, path = tmp_path / "states.json", tmp_path / "rod.json"
    settings = {"mass_per_length_kg_m": {"waves": 0.17}}
    states.write_text(json.dumps({"states": rows_of([FREE, PUSHED]), "settings": settings}))
    assert main(["rod", "--states", str(states), "--strains", "bend", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    assert [row["kind"] for row in result["summary"]] == ["free", "sideways"]
    assert len(result["states"]) == 2 and result["reference"] == "states.json"
    assert result["mass_per_length_kg_m"] == 0.17
    assert "sideways" in capsys.readouterr().out


def test_the_verb_refuses_strains_that_it_does_not_know(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["rod", "--strains", "bend,shear"])
    assert ended.value.code == 2
    assert "some of bend, stretch, twist" in capsys.readouterr().err


def test_ends_of_silicone_yield_under_a_force_on_the_tip_and_hardly_without(tmp_path):
    tips = []
    for ends in ("rigid", "silicone"):
        path = tmp_path / f"{ends}.json"
        force = ["--tip-force", "0.05,0,0", "--gravity", "0,0,0", "--pressure-kpa", "0"]
        assert main(["rod", *force, "--strains", "bend", "--ends", ends, "--json", str(path)]) == 0
        result = json.loads(path.read_text())
        assert result["ends"] == ends
        tips.append(result["tip_position_mm"][0])
    assert 1.08 < tips[1] / tips[0] < 1.15


def test_the_law_may_come_from_another_file(tmp_path, capsys):
    stiffer = json.loads(config_path(LAW_FILE).read_text())
    for row in stiffer["tables"]:
        row["moment_n_mm"] = [2.0 * moment for moment in row["moment_n_mm"]]
    path = tmp_path / "law.json"
    path.write_text(json.dumps(stiffer))
    angles = []
    for law_name in ("config", str(path)):
        out = tmp_path / "out.json"
        arguments = ["rod", "--law", law_name, "--gravity", "0,0,0", "--strains", "bend", "--bending", "line"]
        assert main([*arguments, "--tip-force", "0,0.02,0", "--json", str(out)]) == 0
        angles.append(json.loads(out.read_text())["tip_position_mm"][1])
    assert angles[1] < 0.7 * angles[0]
    assert main(["rod", "--law", str(tmp_path / "absent.json"), "--strains", "bend"]) == 1
    assert "absent.json: no such file" in capsys.readouterr().err


def test_the_uniform_rod_answers_as_ends_of_silicone_do_without_weight(tmp_path):
    tips = []
    for ends in ("silicone", "uniform"):
        path = tmp_path / f"{ends}.json"
        state = ["--pattern", "psc", "--pressure-kpa", "100", "--gravity", "0,0,0", "--ends", ends]
        assert main(["rod", *state, "--json", str(path)]) == 0
        tips.append(json.loads(path.read_text())["tip_position_mm"])
    np.testing.assert_allclose(*tips, atol=5e-3)


def test_the_calibrated_law_is_that_of_the_uniform_rod_and_of_no_other(tmp_path, capsys):
    path = tmp_path / "rod.json"
    assert main(["rod", "--law", "calibrated", "--json", str(path)]) == 0
    assert json.loads(path.read_text())["ends"] == "uniform"
    assert main(["rod", "--law", "calibrated", "--ends", "silicone"]) == 1
    assert "--law calibrated and --ends silicone exclude each other" in capsys.readouterr().err


def test_on_a_law_of_the_states_own_elements_two_chambers_are_right_in_the_plane_of_the_bend(tmp_path):
    """What the rod is off by on its own law there is what the meshes differ by."""
    states, path = config_path("data/fe_muscle_states.json"), tmp_path / "rod.json"
    law = config_path("data/fe_bending_law_states.json")
    assert main(["rod", "--states", str(states), "--law", str(law), "--json", str(path)]) == 0
    found = [each for each in json.loads(path.read_text())["states"] if each["pattern"] == "pdc"]
    free = [each["tip_error_pct"] for each in found if each["kind"] == "free" and each["gravity_m_s2"][1] == 0.0]
    moved = [each["displacement_error_pct"] for each in found if each["kind"] == "in plane"]
    assert len(free) >= 10 and max(free) < 0.6
    assert len(moved) == 7 and max(moved) < 7.0
