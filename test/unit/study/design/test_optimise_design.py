import json

import numpy as np
import pytest

from mbpam_ros import terminal
from mbpam_ros.actuator.metamodel import METAMODELS
from mbpam_ros.actuator.named_designs import load_kept_designs
from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.design import optimise_design
from mbpam_ros.study.design.improvement import gains, reference_design
from mbpam_ros.study.design.optimise_design import Run, check_table_5
from mbpam_ros.study.design.pareto import Front, grid_front
from mbpam_ros.study.design.responses import fitted_responses, published_responses
from mbpam_ros.study.design.samples import Samples

NO_GAINS = {"gain_force_at_equal_angle_pct": None, "gain_angle_at_equal_force_pct": None}

pytestmark = pytest.mark.xdist_group("optimise_design")  # what its command writes is computed once


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    pytest.importorskip("pymoo")
    path = tmp_path_factory.mktemp("optimisation") / "front.json"
    assert main(["optimise", "--json", str(path), "--seeds", "1"]) == 0
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_papers_improvements_come_back(written):
    assert written["initial"] == {"a_mm": 2.5, "b_mm": 2.0, "theta_deg": 148.423, "f_n": 0.6036, "source": "samples"}
    for run in (written, *written["runs"]):
        assert run["gain_force_at_equal_angle_pct"] == pytest.approx(7.8, abs=0.1)
        assert run["gain_angle_at_equal_force_pct"] == pytest.approx(8.6, abs=0.1)


def test_both_algorithms_cover_the_grids_front(written):
    assert [run["algorithm"] for run in written["runs"]] == ["mopso", "nsga2"]
    assert min(run["hypervolume_ratio"] for run in written["runs"]) >= 0.995
    assert written["hypervolume_ratio"] == written["runs"][0]["hypervolume_ratio"]


def test_the_front_is_what_the_metamodel_says_of_its_designs(written):
    rows = np.array(written["pareto"])
    np.testing.assert_allclose(published_responses().objectives(rows[:, :2]), rows[:, 2:])
    assert np.all(np.diff(rows[:, 2]) > 0.0) and np.all(np.diff(rows[:, 3]) < 0.0)


def test_the_chosen_design_is_on_the_front_and_has_a_deviation(written):
    chosen = written["chosen"]
    row = [chosen[key] for key in ("a_mm", "b_mm", "theta_deg", "f_n")]
    assert row in written["pareto"] and chosen["rule"] == "knee"
    assert 1.0 < chosen["theta_sigma_deg"] < 8.0 and 0.005 < chosen["f_sigma_n"] < 0.03


def test_the_design_kept_as_optimised_is_the_one_that_is_chosen(written):
    kept = load_kept_designs()["optimised"]
    for key, value in (("a_mm", kept.a_mm), ("b_mm", kept.b_mm), ("theta_deg", kept.theta_max_deg)):
        assert value == pytest.approx(written["chosen"][key], rel=1e-3)
    run = written["runs"][0]
    expected = {"metamodel": written["metamodel"], "algorithm": run["algorithm"], "seed": str(run["seed"])}
    assert expected.items() <= kept.provenance.items() and kept.provenance["rule"] == written["chosen"]["rule"]


@pytest.mark.parametrize("refitted", [False, True])
def test_table_5_comes_back(refitted):
    responses = fitted_responses("prs", Samples.of_the_paper("doe_training.csv")) if refitted else published_responses()
    rows = check_table_5(responses)
    assert len(rows) == 3
    front = grid_front(responses.objectives, responses.domain)
    for row in rows:
        assert row["theta_deg"] == pytest.approx(row["theta_prs_deg"], abs=0.5)
        assert row["f_n"] == pytest.approx(row["f_prs_n"], abs=0.002)
        assert front.second_at_first(row["theta_deg"]) == pytest.approx(row["f_n"], abs=0.002)


def test_a_refit_of_table_1_is_the_printed_equations_to_their_rounding():
    design = Samples.of_the_paper("doe_validation.csv").design_mm
    refit, printed = fitted_responses("prs", Samples.of_the_paper("doe_training.csv")), published_responses()
    difference = np.abs(refit.objectives(design) - printed.objectives(design))
    assert difference[:, 0].max() < 0.01 and difference[:, 1].max() < 0.001


def test_gains_are_against_the_reference_and_unknown_beyond_the_front():
    front = Front(np.zeros((2, 2)), np.array([[100.0, 0.8], [200.0, 0.4]]))
    responses = published_responses()
    samples = Samples(np.array([[2.5, 2.0], [3.0, 2.0]]), {"theta_max": [150.0, 250.0], "f_max": [0.5, 0.3]})
    inside = gains(front, reference_design(2.5, 2.0, [samples], responses))
    assert inside.gain_force_at_equal_angle_pct == pytest.approx(20.0)
    assert inside.gain_angle_at_equal_force_pct == pytest.approx(100.0 * (175.0 / 150.0 - 1.0))
    beyond = gains(front, reference_design(3.0, 2.0, [samples], responses))
    assert beyond.gain_force_at_equal_angle_pct is None and beyond.gain_angle_at_equal_force_pct is None


def test_a_reference_without_a_sample_has_the_metamodels_values():
    reference = reference_design(2.0, 2.0, [Samples.of_the_paper("doe_training.csv")], published_responses())
    assert reference.source == "metamodel"
    assert reference.theta_deg == pytest.approx(published_responses().objectives(np.array([[2.0, 2.0]]))[0, 0])


@pytest.fixture
def quickly(monkeypatch):
    """Optimisations that are not looked at take no time: each finds the grid's front."""
    seeds = []

    def found(responses, truth, algorithm, seed):
        seeds.append((algorithm, seed))
        return Run(algorithm, seed, 3 + seed, truth, 0.999)

    monkeypatch.setattr(optimise_design, "optimise", found)
    monkeypatch.setattr(optimise_design, "metamodel_gains", lambda *_: NO_GAINS)
    monkeypatch.setattr(
        optimise_design, "sigma_values", lambda *_: {"theta_sigma_deg": 2.0, "f_sigma_n": 0.01, "sigma_verdict": {}}
    )
    return seeds


def own_samples(path, row_count=21):
    table = Samples.of_the_paper("doe_training.csv")
    columns = np.column_stack([10.0 * table.design_mm, *table.responses.values()])[:row_count]
    np.savetxt(path, columns, delimiter=",", header="a_mm,b_mm,theta_max_deg,f_max_n", comments="")
    return str(path)


def test_samples_of_ones_own_are_optimised_in_their_own_domain(tmp_path, capsys):
    path = tmp_path / "own.json"
    arguments = ["--training", own_samples(tmp_path / "own.csv"), "--algorithms", "mopso", "--seeds", "1"]
    assert main(["optimise", *arguments, "--initial", "22,18", "--required-force", "0.6", "--json", str(path)]) == 0
    result = json.loads(path.read_text())
    assert result["metamodel"] == "prs" and result["initial"]["source"] == "samples"
    chosen = result["chosen"]
    assert 15.0 <= chosen["a_mm"] <= 35.0 and 10.0 <= chosen["b_mm"] <= 30.0
    assert 0.6 <= chosen["f_n"] < 0.601 and chosen["theta_deg"] > 160.0
    assert "table_5" not in result and "Table 5" not in capsys.readouterr().out


def test_a_run_that_covers_too_little_fails_the_command(monkeypatch, capsys, tmp_path):
    def lame(responses, truth, algorithm, seed):
        return Run(algorithm, seed, 3, truth, 0.9)

    monkeypatch.setattr(optimise_design, "optimise", lame)
    monkeypatch.setattr(optimise_design, "metamodel_gains", lambda *_: NO_GAINS)
    path = tmp_path / "lame.json"
    assert main(["optimise", "--algorithms", "mopso", "--json", str(path)]) == 1
    assert "mopso with seed 0 covers 0.9000" in capsys.readouterr().err
    assert path.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--training", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--training", "{own}", "--metamodel", "published"], "choose another --metamodel"),
        (["--training", "{few}"], "at least 8 designs"),
        (["--initial", "4,2"], "nearest design inside is a = 3.5, b = 2 mm"),
        (["--weights", "0,0"], "weights must not be negative nor all zero"),
        (["--required-force", "2"], "no design of the front has 2 N"),
    ],
)
def test_what_cannot_be_optimised_is_said_in_one_line(arguments, message, tmp_path, capsys):
    files = {"own": own_samples(tmp_path / "own.csv"), "few": own_samples(tmp_path / "few.csv", 5)}
    quick = ["--algorithms", "mopso", "--seeds", "1"]
    assert main(["optimise", *quick, *(argument.format(**files) for argument in arguments)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mbpam optimise: ") and message in said and said.count("\n") == 1


def test_an_optimisation_goes_on_from_what_its_file_holds(quickly, tmp_path):
    path = tmp_path / "front.json"
    command = ["optimise", "--algorithms", "mopso", "--seeds", "2", "--json", str(path)]
    assert main(command) == 0
    whole, kept = path.read_text(), json.loads((tmp_path / "front_runs.json").read_text())
    path.unlink()
    kept["runs"] = [row for row in kept["runs"] if row["job"] != "mopso, seed 1"]
    (tmp_path / "front_runs.json").write_text(json.dumps(kept))
    quickly.clear()
    assert main(command) == 0
    assert quickly == [("mopso", 1)] and path.read_text() == whole


@pytest.mark.parametrize(
    "arguments", [["--algorithms", "ga"], ["--initial", "2.5"], ["--seeds", "0"], ["--seed", "-1"]]
)
def test_options_that_mean_nothing_are_refused(arguments):
    with pytest.raises(SystemExit, match="2"):
        main(["optimise", *arguments])


def test_a_force_that_no_design_has_is_refused_before_anything_is_optimised(monkeypatch, capsys):
    monkeypatch.setattr(optimise_design, "optimise", lambda *_: pytest.fail("optimised"))
    assert main(["optimise", "--required-force", "0.75", "--algorithms", "mopso", "--seeds", "1"]) == 1
    truth = grid_front(published_responses().objectives, published_responses().domain)
    assert f"the largest force possible is {truth.values[:, 1].max():.4f} N" in capsys.readouterr().err


@pytest.mark.parametrize("metamodel", METAMODELS)
def test_samples_on_a_line_have_no_optimum(metamodel, tmp_path, capsys):
    a = np.linspace(10.0, 20.0, 15)
    rows = np.column_stack([a, 30.0 - a, 100.0 + a**1.5, 1.0 / a])
    path = tmp_path / "line.csv"
    np.savetxt(path, rows, delimiter=",", header="a_mm,b_mm,theta_max_deg,f_max_n", comments="")
    assert (
        main(["optimise", "--training", str(path), "--metamodel", metamodel, "--algorithms", "mopso", "--seeds", "1"])
        == 1
    )
    assert "nothing is known in direction (0.707, 0.707)" in capsys.readouterr().err


def test_beside_a_deviation_stands_whether_it_covers(written):
    coverage = written["chosen"]["sigma_coverage"]
    assert not coverage["theta_max"]["covers"] and coverage["theta_max"]["rms_score"] > 1.5
    assert coverage["theta_max"]["within_two"] < 19 and coverage["theta_max"]["count"] == 21
    assert f"count on {coverage['theta_max']['rms_score']:.1f} times" in written["chosen"]["sigma_verdict"]["theta_max"]


@pytest.mark.usefixtures("quickly")
def test_a_long_command_says_so_before_and_counts_its_jobs(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "PATIENCE_S", 0.01)
    assert main(["optimise", "--algorithms", "mopso", "--seeds", "2"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("2 optimisations, 21 samples: takes about ")
    assert said[1:4] == ["front of the grid", "[1/7] mopso, seed 0", "[2/7] mopso, seed 1"]
    assert said[4:] == [*(f"[{n}/7] gains by {name}" for n, name in enumerate(METAMODELS, 3)), "deviation by kriging"]
