import json
import shutil

import pytest

from mbpam_ros.actuator.design import DesignDomainError
from mbpam_ros.actuator.named_designs import load_design, load_kept_designs
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import DIRECTORY_VARIABLE, ConfigError, config_directory
from mbpam_ros.study.design.design_file import keep_design


@pytest.fixture
def own_configuration(tmp_path, monkeypatch):
    folder = shutil.copytree(config_directory(), tmp_path / "config")
    monkeypatch.setenv(DIRECTORY_VARIABLE, str(folder))
    return folder


def result(a_mm=3.0, b_mm=1.4):
    chosen = {"a_mm": a_mm, "b_mm": b_mm, "theta_deg": 180.0, "f_n": 0.56, "rule": "knee"}
    return {"chosen": chosen, "metamodel": "krg", "runs": [{"algorithm": "nsga2", "seed": 7}]}


def test_a_kept_design_can_be_named_and_leaves_the_others(own_configuration):
    before = load_kept_designs()
    keep_design("strong", result(), "own.csv")
    after = load_kept_designs()
    assert after.pop("strong").provenance["seed"] == "7" and after == before
    assert (load_design("strong").a_mm, load_design("strong").b_mm) == (3.0, 1.4)


def test_a_name_that_exists_is_replaced(own_configuration):
    keep_design("strong", result(), "own.csv")
    keep_design("strong", result(a_mm=2.0), "own.csv")
    assert load_design("strong").a_mm == 2.0


@pytest.mark.parametrize("name", ["initial", "", "a b", "../x", "2nd", "no: yaml"])
def test_a_name_that_cannot_be_is_refused(own_configuration, name):
    before = load_kept_designs()
    with pytest.raises(ConfigError, match="letters, digits"):
        keep_design(name, result(), "own.csv")
    assert load_kept_designs() == before


def test_a_design_that_no_gripper_can_run_with_is_refused(own_configuration):
    with pytest.raises(DesignDomainError, match="nearest design inside"):
        keep_design("wild", result(a_mm=30.0), "own.csv")
    assert "wild" not in load_kept_designs()


def test_the_command_writes_what_the_gripper_reads(own_configuration, tmp_path):
    path = tmp_path / "front.json"
    arguments = ["--algorithms", "mopso", "--seeds", "1", "--required-force", "0.6", "--json", str(path)]
    assert main(["optimise", *arguments, "--save-as", "wide"]) == 0
    chosen, kept = json.loads(path.read_text(encoding="utf-8"))["chosen"], load_kept_designs()["wide"]
    assert (kept.a_mm, kept.b_mm, kept.f_max_n) == (chosen["a_mm"], chosen["b_mm"], chosen["f_n"])
    assert kept.provenance["rule"] == "required force 0.6 N"
