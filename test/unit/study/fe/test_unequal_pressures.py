import json
import math

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.configuration import config_path
from mbpam_ros.study.fe import unequal_pressures
from mbpam_ros.study.fe.design_run import Run, settings
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.unequal_pressures import PRESSURES_KPA, SHARES, section_for, unequal_rows

DEFAULT = Run(CellGeometry(), "psc")
SMALL = Run(CellGeometry(), "psc", Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2))
STORED = json.loads(config_path("data/fe_unequal_pressures.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("shares", "pattern"),
    [
        ((1.0, 0.0, 0.0, 1.0), "pdc"),
        ((1.0, 0.5, 0.5, 1.0), "pdc"),
        ((1.0, 0.0, 0.5, 0.0), "psc"),
        ((1.0, 1.0, 0.0, 1.0), "psc"),
        ((1.0, 0.5, 0.0, 0.0), "full"),
    ],
)
def test_a_mirror_plane_of_the_pressures_halves_the_model(shares, pattern):
    assert section_for(shares).pattern == pattern


def test_the_same_pressures_bend_the_whole_and_the_half_section_alike(monkeypatch):
    """(p, 0, p/2, 0) has a mirror plane, so both models can take it; the directions are those of the muscle frame."""
    monkeypatch.setattr(unequal_pressures, "PRESSURES_KPA", (20.0,))
    shares = (1.0, 0.0, 0.5, 0.0)
    half = unequal_rows(SMALL, shares)[0]
    whole_section = unequal_pressures.Section("full", (1, 2, 3, 4), 0.0)
    monkeypatch.setattr(unequal_pressures, "section_for", lambda shares: whole_section)
    whole = unequal_rows(SMALL, shares)[0]
    for name in ("straight_moment_n_mm", "free_bend_deg"):
        assert whole[name] == pytest.approx(half[name], rel=0.02)  # one section, two meshes
        assert math.atan2(*half[name][::-1]) == pytest.approx(math.radians(-135.0), abs=1e-6)


def test_the_stored_sets_are_all_there_and_from_the_default_mesh():
    wanted = [(list(shares), pressure) for shares in SHARES for pressure in PRESSURES_KPA]
    assert [(row["shares"], row["p_kpa"]) for row in STORED["rows"]] == wanted
    for key, value in settings(DEFAULT).items():
        if key != "versions":
            assert STORED["settings"][key] == value, key


def test_the_stored_set_of_two_opposite_chambers_is_what_the_default_mesh_gives(monkeypatch):
    monkeypatch.setattr(unequal_pressures, "PRESSURES_KPA", PRESSURES_KPA[:1])
    row = unequal_rows(DEFAULT, (1.0, 0.0, 0.5, 0.0))[0]
    stored = next(row for row in STORED["rows"] if row["shares"] == [1.0, 0.0, 0.5, 0.0])
    for name in ("straight_moment_n_mm", "free_bend_deg"):
        np.testing.assert_allclose(row[name], stored[name], rtol=1e-5)
