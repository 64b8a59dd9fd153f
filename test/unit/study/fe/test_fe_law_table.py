import json
import math

import pytest

pytest.importorskip("felupe")

from mbpam_ros.configuration import config_path
from mbpam_ros.study.executors import open_executor
from mbpam_ros.study.fe.design_run import MESHES, Run, settings
from mbpam_ros.study.fe.law_table import STIFFNESSES, law_at_pressure, law_table
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.terminal import Progress

STIFF = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc", MESHES["coarse"])


def test_the_law_knows_the_moment_that_holds_the_muscle_straight():
    table = law_at_pressure(STIFF, 20.0, (-20, 0, 20))
    assert table["bend_deg"] == pytest.approx([-20.0, 0.0, 20.0])
    assert table["moment_n_mm"] == sorted(table["moment_n_mm"])
    assert table["straight_moment_n_mm"] == pytest.approx(-table["moment_n_mm"][1])
    secant = (table["moment_n_mm"][2] - table["moment_n_mm"][0]) / math.radians(40.0) * 100.0
    assert table["line_stiffness_n_mm2"] == pytest.approx(secant, rel=1e-9)
    assert table["missing"] == []
    for column in STIFFNESSES:
        assert len(table[column]) == 3 and min(table[column]) > 0.0
    assert min(table["bend_stiffness_n_mm2"]) < secant < max(table["bend_stiffness_n_mm2"])


def test_the_stored_law_is_what_the_default_mesh_gives():
    stored = json.loads(config_path("data/fe_bending_law.json").read_text(encoding="utf-8"))
    tables = {(row["pattern"], row["p_kpa"]): row for row in stored["tables"]}
    assert len(tables) == 26 and not any(row["missing"] for row in tables.values())
    run = Run(CellGeometry(), "psc")
    for key, value in settings(run).items():
        if key != "versions":
            assert stored["settings"][key] == value, key
    wanted = tables["psc", 20.0]
    at_zero = wanted["bend_deg"].index(0.0)
    table = law_at_pressure(run, 20.0, ())
    assert table["moment_n_mm"][0] == pytest.approx(wanted["moment_n_mm"][at_zero], rel=1e-6)
    assert table["gas_volume_mm3"][0] == pytest.approx(wanted["gas_volume_mm3"][at_zero], rel=1e-6)
    for column in STIFFNESSES:
        assert table[column][0] == pytest.approx(wanted[column][at_zero], rel=1e-6)


def test_rows_of_a_file_from_before_the_stiffness_are_made_again(monkeypatch, tmp_path):
    made = []

    def made_up(run, pressure_kpa, bends_deg):
        made.append(pressure_kpa)
        return {"pattern": run.pattern, "p_kpa": pressure_kpa, **dict.fromkeys(STIFFNESSES, [1.0])}

    monkeypatch.setattr("mbpam_ros.study.fe.law_table.law_at_pressure", made_up)
    path = tmp_path / "law.json"
    progress = Progress(silent=True)
    with open_executor(1) as executor:
        first = law_table(STIFF, path, executor, progress)
        assert len(made) == 26
        del first["tables"][3]["axial_stiffness_n"]
        path.write_text(json.dumps(first), encoding="utf-8")
        law_table(STIFF, path, executor, progress)
    assert made[26:] == [30.0]
