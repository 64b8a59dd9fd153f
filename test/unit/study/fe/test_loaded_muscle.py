import json
import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.actuator.elastic_rod import HANGING
from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.executors import ThisProcess
from mbpam_ros.study.fe import state_set
from mbpam_ros.study.fe.loaded_muscle import LoadedMuscle, MuscleModel, loads_of
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.muscle_loads import LEVEL, NOTHING, MuscleLoads
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.fe.state_set import PATHS, LoadPath, TipLoad
from mbpam_ros.study.fe.whole_muscle import WholeMuscle
from mbpam_ros.study.muscle_states import MuscleState, read_states
from mbpam_ros.terminal import Progress

SHORT = MuscleModel(CellGeometry(c_mm=2.3, wave_count=1.0, active_length_mm=7.0), "coarse", end_length_mm=4.0)
FREE = MuscleState("pdc", 60.0, gravity_m_s2=HANGING)
LOADED = replace(FREE, tip_force_n=(0.0, 0.1, 0.05), tip_torque_n_mm=5.0)
TWO_WAYS = {
    "up": LoadPath("pdc", HANGING, {30.0: (), 60.0: (TipLoad(aside_n=0.1), TipLoad(along_n=0.1))}),
    "level": LoadPath("half", LEVEL, {0.0: (TipLoad(torque_n_mm=5.0),)}),
}

pytestmark = pytest.mark.xdist_group("loaded_muscle")  # its muscles are solved once


@pytest.fixture(scope="module")
def rows():
    muscle = LoadedMuscle(SHORT)
    return [muscle.row(state) for state in (replace(FREE, pressure_kpa=30.0), FREE, LOADED)]


def test_a_state_at_the_end_of_a_way_is_the_state_from_rest(rows):
    alone = LoadedMuscle(SHORT).row(LOADED)
    for name in ("tip_position_mm", "tip_direction", "tip_roll_deg", "tip_angle_deg", "gas_volume_mm3"):
        assert alone[name] == pytest.approx(rows[2][name], abs=1e-4)


def test_pressure_bends_toward_minus_x_and_loads_move_the_tip_where_they_point(rows):
    _, free, loaded = rows
    moved = np.subtract(loaded["tip_position_mm"], free["tip_position_mm"])
    assert free["tip_position_mm"][0] < 0.0
    assert free["tip_position_mm"][1] == pytest.approx(0.0, abs=1e-5)
    assert free["tip_angle_deg"] == pytest.approx(math.degrees(math.acos(free["tip_direction"][2])), abs=1e-4)
    assert moved[1] > 0.0 and moved[2] > 0.0
    assert loaded["tip_roll_deg"] > 0.1 > abs(free["tip_roll_deg"])


def test_the_axis_begins_where_the_waves_begin_and_ends_where_they_end(rows):
    axis = rows[1]["axis"]
    assert [point["z_mm"] for point in axis] == pytest.approx([4.0, 11.0])
    assert np.linalg.norm(np.subtract(rows[1]["tip_position_mm"], axis[1]["position_mm"])) == pytest.approx(
        4.0, rel=0.05
    )
    assert axis[0]["direction"][2] == pytest.approx(1.0, abs=0.01)


def test_another_pattern_or_gravity_begins_at_rest_and_a_lower_pressure_at_one_below_it():
    muscle = LoadedMuscle(SHORT)
    for state in (FREE, replace(FREE, pressure_kpa=20.0), replace(FREE, gravity_m_s2=LEVEL)):
        muscle.row(state)
        way = muscle._ways["pdc"]
        assert way[-1].loads == loads_of(state)
        assert [found.loads.gravity_m_s2 for found in way] == [NOTHING] + [state.gravity_m_s2] * (len(way) - 1)


@pytest.mark.parametrize("pattern", ["pdc", "half"])
def test_halves_do_what_all_of_the_muscle_does(pattern, monkeypatch):
    by_half, all_of_it = LoadedMuscle(SHORT), LoadedMuscle(SHORT)
    monkeypatch.setattr(all_of_it, "_half", lambda pattern: None)
    free = replace(FREE, pattern=pattern, pressure_kpa=30.0)
    ahead = TipLoad(ahead_n=0.1, along_n=0.05).on(free, np.array([0.0, 0.0, 1.0]))
    aside = replace(free, tip_torque_n_mm=5.0, tip_force_n=(0.0, 0.1, 0.0), gravity_m_s2=(1.0, 20.0, 3.0))
    for state in (ahead, aside):
        first, second = by_half.row(state), all_of_it.row(state)
        for name in ("tip_position_mm", "tip_direction", "tip_roll_deg", "tip_angle_deg", "gas_volume_mm3"):
            assert first[name] == pytest.approx(second[name], abs=1e-4)
    assert abs(first["tip_roll_deg"]) > 0.1
    assert list(by_half._ways) == ["psc" if pattern == "half" else pattern]


def test_a_half_of_another_mesh_is_not_unfolded():
    whole, half = SHORT.muscle(), MuscleModel(CellGeometry(), "coarse").muscle("pdc")
    with pytest.raises(ValueError, match="different meshes"):
        whole.unfolded(half.rest(), half)


def test_the_ends_have_the_weight_per_length_of_the_waves():
    heavy = MuscleModel(replace(SHORT.geometry, a_mm=0.0), "coarse", end_length_mm=4.0)
    per_length = heavy.settings()["mass_per_length_kg_m"]
    assert per_length["ends"] == per_length["waves"]
    assert LoadedMuscle(heavy).mass_kg == pytest.approx(1e-3 * 15.0 * per_length["waves"], rel=0.03)  # a mesh of chords
    assert LoadedMuscle(replace(heavy, end_weight_factor=0.0)).mass_kg == pytest.approx(
        1e-3 * 7.0 * per_length["waves"], rel=0.03
    )


def test_a_mesh_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="unknown mesh 'none'; known: converged"):
        MuscleModel(mesh="none")


def test_loads_are_given_in_the_frame_of_the_bend():
    free = MuscleState("psc", 50.0)
    half = math.sqrt(0.5)
    direction = np.array([0.0, 0.6, 0.8])
    assert TipLoad(ahead_n=1.0).on(free, direction).tip_force_n == pytest.approx((-half, -half, 0.0), abs=1e-5)
    assert TipLoad(aside_n=1.0).on(free, direction).tip_force_n == pytest.approx((half, -half, 0.0), abs=1e-5)
    assert TipLoad(along_n=0.5).on(free, direction).tip_force_n == pytest.approx((0.0, 0.3, 0.4), abs=1e-5)
    assert TipLoad(torque_n_mm=2.0).on(free, direction) == replace(free, tip_torque_n_mm=2.0)


def test_the_set_has_what_it_should():
    stations = [(path, pressure, loads) for path in PATHS.values() for pressure, loads in path.stations.items()]
    assert sum(1 + len(loads) for _, _, loads in stations) >= 40
    assert {path.pattern for path in PATHS.values()} == {"pdc", "psc", "half"}
    assert {pressure for _, pressure, _ in stations} == {0.0, 50.0, 80.0, 100.0}
    assert {path.gravity_m_s2 for path in PATHS.values()} >= {HANGING, LEVEL, NOTHING}
    assert all(list(path.stations) == sorted(path.stations) for path in PATHS.values())


def test_the_set_is_kept_resumed_and_read_by_the_rod(tmp_path, capsys):
    path = tmp_path / "states.json"
    result = state_set.state_set(SHORT, path, ThisProcess(), Progress(), {"up": TWO_WAYS["up"]})
    assert [row["pressure_kpa"] for row in result["states"]] == [30.0, 60.0, 60.0, 60.0]
    again = state_set.state_set(SHORT, path, ThisProcess(), Progress(), TWO_WAYS)
    assert again["states"][:4] == result["states"]
    assert again["failures"] == {}
    assert len(read_states(path).rows) == 6
    assert json.loads(path.read_text(encoding="utf-8"))["settings"] == SHORT.settings()
    assert "1 job" in capsys.readouterr().out


def test_a_state_that_is_not_reached_is_told_and_the_others_are_kept(tmp_path, monkeypatch):
    moved = WholeMuscle.moved

    def stubborn(self, start, loads, *more, **options):
        if any(loads.tip_force_n):
            raise LoadStepError("no equilibrium", 0.0)
        return moved(self, start, loads, *more, **options)

    monkeypatch.setattr(WholeMuscle, "moved", stubborn)
    result = state_set.state_set(SHORT, tmp_path / "states.json", ThisProcess(), Progress(), {"up": TWO_WAYS["up"]})
    assert len(result["states"]) == 2
    assert len(result["failures"]) == 2
    assert all("aside_n=0.1" in name or "along_n=0.1" in name for name in result["failures"])


def test_the_verb_writes_the_state_with_its_model(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("mbpam_ros.commands.fe.muscle.LoadedMuscle", lambda model: LoadedMuscle(SHORT))
    path = tmp_path / "state.json"
    arguments = ["--pattern", "psc", "--pressure-kpa", "30", "--tip-force", "-0.05,0,0", "--gravity", "0,0,-9.81"]
    assert main(["fe", "muscle", *arguments, "--tip-torque", "-2", "--mesh", "coarse", "--json", str(path)]) == 0
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["tip_force_n"] == [-0.05, 0.0, 0.0]
    assert found["tip_torque_n_mm"] == -2.0
    assert found["model"]["mesh"]["name"] == "coarse"
    assert found["model"]["geometry"]["c_mm"] == 2.3
    assert {"tip_position_mm", "tip_direction", "tip_roll_deg", "tip_angle_deg"} <= set(found)
    assert "unknowns" in capsys.readouterr().out


def test_the_verb_of_the_set_writes_its_states_and_says_what_it_did(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("mbpam_ros.commands.fe.states.PATHS", TWO_WAYS)
    monkeypatch.setattr("mbpam_ros.commands.fe.states.muscle_model", lambda options: SHORT)
    path = tmp_path / "states.json"
    command = ["fe", "states", "--workers", "1", "--json", str(path), "--path"]
    assert main([*command, "level"]) == 0
    assert [row["tip_torque_n_mm"] for row in read_states(path).rows] == [0.0, 5.0]
    monkeypatch.setitem(TWO_WAYS, "up", LoadPath("pdc", HANGING, {30.0: ()}))
    assert main([*command, "up"]) == 0
    assert sorted(row["path"] for row in read_states(path).rows) == ["level", "level", "up"]
    assert "[1/1] level: 2 states" in capsys.readouterr().out


def test_loads_of_a_state_are_in_the_finite_elements_units():
    assert loads_of(replace(LOADED, pattern="half")) == MuscleLoads(
        (0.06, 0.03, 0.0, 0.0), (0.0, 0.1, 0.05), 5.0, HANGING
    )
