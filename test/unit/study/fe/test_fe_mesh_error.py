import io
import json
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("felupe")

from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.fe import mesh_error
from mbpam_ros.study.fe.design_run import MESHES, Run
from mbpam_ros.study.fe.mesh import CONVERGED, CellGeometry, Resolution
from mbpam_ros.study.fe.mesh_error import FINEST, REFINED, mesh_error_pct, mesh_error_text, mesh_errors
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.terminal import Progress

STIFF = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc")


def errors_of(path, **options):
    with ThreadPoolExecutor(1) as executor:
        return mesh_errors(STIFF, path, executor, Progress(io.StringIO()), **options)


def test_each_mesh_is_set_beside_the_finest_at_each_design(tmp_path, monkeypatch):
    def bend(name, run):
        if name == "coarse" and run.pattern == "psc":
            raise LoadStepError("inside out", 60.0)
        degrees = 100.0 * run.geometry.a_mm * (1.0 if name == FINEST else 0.98 if run.geometry.b_mm == 1.0 else 1.01)
        return {
            "mesh": name,
            "a_mm": run.geometry.a_mm,
            "b_mm": run.geometry.b_mm,
            "pattern": run.pattern,
            "unknowns": 1,
            "free_bend_deg": degrees,
        }

    monkeypatch.setattr(mesh_error, "free_bend_row", bend)
    result = errors_of(tmp_path / "x.json")
    assert set(result["errors"]) == {*MESHES, *REFINED} - {FINEST}
    assert result["errors"]["quadratic"]["by_design_pct"] == pytest.approx(
        {"a 2.5 b 2 pdc": 1.0, "a 2.5 b 2 psc": 1.0, "a 3.5 b 2 pdc": 1.0, "a 2.5 b 1 pdc": -2.0}
    )
    assert result["errors"]["quadratic"]["worst_pct"] == pytest.approx(-2.0)
    assert "a 2.5 b 2 psc" not in result["errors"]["coarse"]["by_design_pct"]
    assert list(result["failures"].values()) == ["inside out"]

    monkeypatch.setattr(mesh_error, "STORED", str(tmp_path / "x.json"))
    assert mesh_error_pct(CONVERGED) == pytest.approx(-2.0)
    assert "-2.0 %" in mesh_error_text(CONVERGED)
    assert mesh_error_pct(Resolution(wave=2)) is None
    assert "not known" in mesh_error_text(Resolution(wave=2))


def test_the_bends_are_those_of_the_unit_cell_on_each_mesh(tmp_path):
    meshes = {"coarse": MESHES["coarse"], FINEST: Resolution(wave=4, wall=1, arm=2, spoke=2, sector=3)}
    result = errors_of(tmp_path / "x.json", meshes=meshes, designs=((1.5, 2.0, "psc"),))
    coarse, finest = (row["free_bend_deg"] for row in result["bends"])
    cell = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "psc", meshes[FINEST]).cell()
    assert finest == pytest.approx(57.29577951 * cell.free_bend(0.1).angle_rad * cell.angle_per_muscle, rel=1e-6)
    assert result["errors"]["coarse"]["worst_pct"] == pytest.approx(100.0 * (coarse / finest - 1.0))
    assert coarse < finest


def test_a_stored_file_of_something_else_is_an_error_and_one_that_is_missing_is_not(tmp_path, monkeypatch):
    path = tmp_path / "x.json"
    path.write_text(json.dumps({"settings": {}}), encoding="utf-8")
    monkeypatch.setattr(mesh_error, "STORED", str(path))
    with pytest.raises(ConfigError, match="no result of mbpam fe mesh"):
        mesh_error_pct(CONVERGED)
    path.unlink()
    assert mesh_error_pct(CONVERGED) is None
