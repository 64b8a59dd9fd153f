import dataclasses
import json
import shutil

import pytest

from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.actuator.named_designs import load_design, load_kept_designs
from mbpam_ros.configuration import DIRECTORY_VARIABLE, ConfigError, config_directory


@pytest.fixture
def own_configuration(tmp_path, monkeypatch):
    folder = shutil.copytree(config_directory(), tmp_path / "config")
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(folder))
    return folder


def keep(folder, **designs):
    (folder / "data" / "designs.json").write_text(json.dumps({"designs": designs}), encoding="utf-8")


def entry(a_mm, b_mm):
    return {"a_mm": a_mm, "b_mm": b_mm, "theta_max_deg": 150.0, "f_max_n": 0.6, "provenance": {"rule": "a coin"}}


def test_initial_is_the_papers_design():
    assert load_design("initial") == MuscleDesign(a_mm=2.5, b_mm=2.0)


def test_every_kept_design_has_its_name_and_says_where_it_comes_from():
    kept = load_kept_designs()
    assert "optimised" in kept
    for name, found in kept.items():
        assert load_design(name) == found.design
        assert {"samples", "metamodel", "algorithm", "seed", "rule"} <= found.provenance.keys()


def test_a_design_of_ones_own_has_a_name(own_configuration):
    keep(own_configuration, mine=entry(3.0, 1.5))
    assert load_design("mine") == MuscleDesign(a_mm=3.0, b_mm=1.5)


def test_an_unknown_name_is_refused_with_those_that_there_are(own_configuration):
    keep(own_configuration, mine=entry(3.0, 1.5), other=entry(2.0, 1.5))
    with pytest.raises(ConfigError, match="no design 'optimized'; known: initial, mine, other"):
        load_design("optimized")


def test_without_kept_designs_there_is_the_initial_one(own_configuration):
    (own_configuration / "data" / "designs.json").unlink()
    assert load_design("initial") == MuscleDesign(2.5, 2.0)
    with pytest.raises(ConfigError, match="known: initial;"):
        load_design("optimised")


def test_a_kept_design_outside_the_domain_is_refused_with_its_place(own_configuration):
    keep(own_configuration, wild=entry(4.0, 2.0))
    with pytest.raises(ConfigError, match=r"designs\.json: designs: wild: .*nearest design inside is a = 3.5, b = 2"):
        load_design("wild")


def test_what_is_no_file_of_designs_is_refused(own_configuration):
    (own_configuration / "data" / "designs.json").write_text('{"front": []}', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"designs\.json: unknown key front"):
        load_design("initial")


def test_a_kept_design_does_not_change():
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_kept_designs()["optimised"].a_mm = 2.0
