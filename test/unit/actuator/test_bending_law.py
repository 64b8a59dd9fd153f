import json

import numpy as np
import pytest

from mbpam_ros.actuator.bending_law import CellLaw, stored_cell_laws
from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.configuration import DIRECTORY_VARIABLE, ConfigError, config_path

LAWS = stored_cell_laws()
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])


def changed(law, **fields):
    names = ("pressure_gauge_pa", "curvature_per_m", "moment_n_m", "axis_stretch")
    return CellLaw(**{**{name: getattr(law, name) for name in names}, **fields})


@BOTH_PATTERNS
def test_the_samples_reach_from_0_to_120_kpa_and_from_minus_60_to_180_deg(pattern):
    law = LAWS[pattern]
    np.testing.assert_allclose(law.pressure_gauge_pa, np.arange(0.0, 121e3, 10e3))
    np.testing.assert_allclose(np.degrees(law.curvature_per_m * 0.1), np.arange(-60.0, 181.0, 30.0))


@BOTH_PATTERNS
def test_the_line_has_the_straight_and_the_free_state_of_the_samples(pattern):
    law = LAWS[pattern]
    straight = np.flatnonzero(law.curvature_per_m == 0.0)[0]
    np.testing.assert_allclose(law.line_residual_n_m[1:, straight], 0.0, atol=1e-15)
    for row, curvature in zip(law.moment_n_m[1:], law.free_curvature_per_m[1:], strict=True):
        after = int(np.searchsorted(law.curvature_per_m, curvature))
        assert row[after - 1] < 0.0 <= row[after]
    line_zero = law.straight_moment_n_m[1:] / law.stiffness_n_m2[1:]
    np.testing.assert_allclose(line_zero, law.free_curvature_per_m[1:], rtol=1e-12)


@pytest.mark.parametrize(("pattern", "at_100_kpa", "worst"), [("pdc", 1.5e-3, 2.1e-3), ("psc", 0.95e-3, 1.95e-3)])
def test_the_lines_residual_is_as_stated(pattern, at_100_kpa, worst):
    law = LAWS[pattern]
    rms = np.sqrt(np.mean(law.line_residual_n_m**2, axis=1))
    assert rms[10] == pytest.approx(at_100_kpa, rel=0.05)
    assert rms.max() == pytest.approx(worst, rel=0.05)


def test_the_unpressurised_section_is_isotropic_up_to_the_two_meshes():
    pdc, psc = (LAWS[pattern].stiffness_n_m2[0] for pattern in ("pdc", "psc"))
    assert pdc == pytest.approx(psc, rel=3e-3)
    assert LAWS["pdc"].straight_moment_n_m[0] == LAWS["psc"].straight_moment_n_m[0] == 0.0


@BOTH_PATTERNS
def test_pressure_bends_and_stretches_the_muscle(pattern):
    law = LAWS[pattern]
    for rising in (law.straight_moment_n_m, law.free_curvature_per_m, law.straight_stretch):
        assert (np.diff(rising) > 0.0).all()
    assert law.straight_stretch[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("pressure_gauge_pa", lambda x: x + 1.0, "rise from 0"),
        ("curvature_per_m", lambda x: x + 0.1, "0 must be one"),
        ("moment_n_m", lambda x: -x, "rise with the curvature"),
        ("moment_n_m", lambda x: x - 1.0, "free bend must lie within"),
        ("axis_stretch", lambda x: x[1:], "axis_stretch must have one value"),
    ],
)
def test_samples_that_make_no_law_are_refused(field, change, message):
    law = LAWS["pdc"]
    with pytest.raises(ValueError, match=message):
        changed(law, **{field: change(getattr(law, field))})


def test_axial_and_torsional_stiffness_are_read_from_the_file_and_taken_at_the_free_bend(tmp_path, monkeypatch):
    content = json.loads(config_path(LAW_FILE).read_text(encoding="utf-8"))
    for row in content["tables"]:
        bend = np.array(row["bend_deg"])
        row["axial_stiffness_n"] = (30.0 + 0.01 * bend).tolist()
        row["torsion_stiffness_n_mm2"] = (1000.0 - bend).tolist()
    (tmp_path / "data").mkdir()
    (tmp_path / "gripper.yaml").write_text("")
    (tmp_path / LAW_FILE).write_text(json.dumps(content))
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))
    for pattern, law in stored_cell_laws.__wrapped__().items():
        free_deg = np.degrees(0.1 * LAWS[pattern].free_curvature_per_m)
        np.testing.assert_allclose(law.free_stiffness("axial_stiffness_n"), 30.0 + 0.01 * free_deg)
        np.testing.assert_allclose(law.free_stiffness("torsion_stiffness_n_m2"), 1e-6 * (1000.0 - free_deg))


@pytest.mark.parametrize("name", ["axial_stiffness_n", "torsion_stiffness_n_m2"])
def test_stiffnesses_that_make_no_law_are_refused(name):
    samples = np.ones_like(LAWS["pdc"].moment_n_m)
    for bad in (samples[1:], 0.0 * samples):
        with pytest.raises(ValueError, match=f"{name} must have one positive value"):
            changed(LAWS["pdc"], **{name: bad})
    with pytest.raises(ValueError, match="'shear'"):
        LAWS["pdc"].free_stiffness("shear")


@pytest.mark.parametrize(
    "content", ["{}", "no json", '{"settings": {"geometry": {"active_length_mm": 100}}, "tables": []}']
)
def test_a_file_that_is_no_law_is_a_configuration_error_that_names_it(content, tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "gripper.yaml").write_text("")
    (tmp_path / LAW_FILE).write_text(content)
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(tmp_path))
    with pytest.raises(ConfigError, match="fe_bending_law.json: no bending law of mbpam fe law"):
        stored_cell_laws.__wrapped__()


def test_the_file_says_how_it_was_made():
    settings = json.loads(config_path(LAW_FILE).read_text(encoding="utf-8"))["settings"]
    assert settings["design"] == {"a_mm": 2.5, "b_mm": 2.0}
    assert {"convention", "geometry", "resolution", "silicone", "not_modelled", "versions"} <= settings.keys()
    assert settings["versions"]["felupe"] and settings["not_modelled"]
