import json
from pathlib import Path

import numpy as np
import pytest

from mbpam_ros import terminal
from mbpam_ros.actuator.metamodel import GaussianRadialBasis, Kriging, PolynomialResponseSurface
from mbpam_ros.commands.mbpam import main
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.design import compare_metamodels
from mbpam_ros.study.design.accuracy import Accuracy
from mbpam_ros.study.design.compare_metamodels import published_errors
from mbpam_ros.study.design.comparison import judge
from mbpam_ros.study.design.samples import RESPONSES, Samples

TRAINING, VALIDATION = Samples.of_the_paper("doe_training.csv"), Samples.of_the_paper("doe_validation.csv")
EQUATIONS = {
    "theta_max": [-329.2005, 339.6515, 203.7575, -118.5423, -69.3005, -17.2730, 16.9488, 7.4029],
    "f_max": [-0.6614, 0.8489, 1.2680, -0.3633, -0.5750, -0.0491, 0.0475, 0.0809],
}

pytestmark = pytest.mark.xdist_group("compare_metamodels")  # what its command writes is computed once


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("comparison") / "table.json"
    assert main(["metamodels", "--json", str(path)]) == 0
    return json.loads(path.read_text(encoding="utf-8"))


def from_published(figures, metamodel, response):
    paper = published_errors()[metamodel, response]
    return {
        "r2": figures["r2"] - paper["r2"],
        "rmse": figures["rmse_normalised"] - paper["rmse"],
        "mre": figures["mre_normalised"] - paper["mre"],
    }


@pytest.mark.parametrize("response", RESPONSES)
def test_the_rows_of_table_3_come_back(written, response):
    surface = from_published(written["PRS"][response], "PRS", response)
    spline = from_published(written["RBF"][response], "RBF", response)
    kriging = from_published(written["KRG"][response], "KRG", response)
    assert max(map(abs, surface.values())) < 0.0003
    assert max(map(abs, spline.values())) < 0.0002
    assert abs(kriging["r2"]) < 0.01


@pytest.mark.parametrize("response", RESPONSES)
def test_equations_9_and_10_come_back(written, response):
    tolerance = {"theta_max": 1e-4, "f_max": 2e-3}[response]
    found = written["PRS"][response]["parameters"]["coefficients"]
    np.testing.assert_allclose(found, EQUATIONS[response], rtol=tolerance)


@pytest.mark.parametrize("response", RESPONSES)
def test_gaussians_of_no_width_have_the_papers_row(response):
    paper = np.array(list(published_errors()["RBF", response].values()))
    model = GaussianRadialBasis()
    model.fit(TRAINING.design_mm, TRAINING.responses[response])
    deviation = (TRAINING.responses[response] - TRAINING.responses[response].mean()) / TRAINING.responses[
        response
    ].std()
    nearest = np.inf
    for epsilon in np.geomspace(0.05, 10.0, 400):
        model.epsilon, model._weights = epsilon, np.linalg.solve(model._matrix(epsilon), deviation)
        found = Accuracy.of(model.predict(VALIDATION.design_mm), VALIDATION.responses[response])
        row = np.array([found.r2, found.rmse_normalised, found.mre_normalised])
        nearest = min(nearest, np.abs(row - paper).max())
    assert nearest > 0.0005


def test_physical_figures_are_the_normalised_ones_times_the_range(written):
    assert written["PRS"]["theta_max"]["rmse"] == pytest.approx(1.88, abs=0.01)
    assert written["PRS"]["f_max"]["rmse"] == pytest.approx(0.0202, abs=1e-4)
    for rows in written.values():
        for key, figures in rows.items():
            spread = np.ptp(VALIDATION.responses[key])
            assert figures["rmse"] == pytest.approx(spread * figures["rmse_normalised"])
            assert figures["mre"] == pytest.approx(spread * figures["mre_normalised"])


def test_kriging_says_what_it_solved_with_and_every_row_what_it_costs(written):
    parameters = written["KRG"]["f_max"]["parameters"]
    assert parameters["nugget"] == 1e-10 and 1.0 < parameters["condition_number"] < 1e12
    for rows in written.values():
        for figures in rows.values():
            assert 0.0 < figures["one_evaluation_s"] < figures["ten_thousand_evaluations_s"]
            assert figures["fit_s"] > 0.0


def write_csv(path, samples, rows=slice(None)):
    columns = np.column_stack([samples.design_mm, *samples.responses.values()])[rows]
    np.savetxt(path, columns, delimiter=",", header="a_mm,b_mm,theta_max_deg,f_max_n", comments="")
    return str(path)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(compare_metamodels, "METAMODELS", {"prs": PolynomialResponseSurface})


def test_samples_of_ones_own_have_a_domain_of_their_own(tmp_path, quick, capsys):
    scaled = [Samples(3.0 + 2.0 * table.design_mm, table.responses) for table in (TRAINING, VALIDATION)]
    training, validation = (write_csv(tmp_path / f"{i}.csv", table) for i, table in enumerate(scaled))
    path = tmp_path / "own.json"
    assert main(["metamodels", "--training", training, "--validation", validation, "--json", str(path)]) == 0
    # A cubic of scaled variables is a cubic: the errors are those of the paper's tables.
    assert json.loads(path.read_text())["PRS"]["theta_max"]["r2"] == pytest.approx(0.9964, abs=1e-4)
    assert "paper" not in capsys.readouterr().out


def test_samples_come_from_a_spreadsheet_that_writes_decimals_with_a_comma(tmp_path, quick, capsys):
    plain = Path(write_csv(tmp_path / "plain.csv", TRAINING))
    table, result = tmp_path / "spreadsheet.csv", tmp_path / "result.json"
    text = plain.read_text(encoding="utf-8").replace(",", ";").replace(".", ",").replace("\n", "\r\n")
    table.write_bytes(b"\xef\xbb\xbf" + text.encode() + b";;;\r\n")
    found = []
    for training in (plain, table):
        assert main(["metamodels", "--training", str(training), "--json", str(result)]) == 0
        found.append(json.loads(result.read_text(encoding="utf-8"))["PRS"]["f_max"]["parameters"])
    assert found[0] == found[1]


def test_a_bad_sample_is_named_with_its_line_and_column(tmp_path, quick, capsys):
    table = tmp_path / "own.csv"
    table.write_text("a_mm,b_mm,theta_max_deg,f_max_n\n1.5,2,100,n.a.\n", encoding="utf-8")
    assert main(["metamodels", "--training", str(table)]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"mbpam metamodels: {table}: line 2, column f_max_n: 'n.a.' is not a plain number")
    assert said.count("\n") == 1


def test_the_papers_errors_are_read_as_strictly_as_samples(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "gripper.yaml").touch()
    (tmp_path / "data" / "metamodel_errors.csv").write_text("metamodel,response,r2,rmse,mre\nPRS,f_max,1,nan,0\n")
    monkeypatch.setenv("MBPAM_CONFIG_DIR", str(tmp_path))
    with pytest.raises(ConfigError, match="line 2, column rmse: 'nan' is not a plain number"):
        published_errors()


def test_without_samples_to_judge_on_each_is_left_out_in_turn():
    judged = judge(PolynomialResponseSurface, TRAINING, None)
    assert judged["theta_max"].predicted.shape == (21,)
    assert (
        judged["theta_max"].accuracy.rmse
        > judge(PolynomialResponseSurface, TRAINING, VALIDATION)["theta_max"].accuracy.rmse
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--training", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--validation", "doe_validation.csv"], "needs --training"),
        (["--training", "{few}"], "at least 8 designs"),
        (["--training", "{half}", "--validation", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--training", "{half}", "--validation", "{all}"], "nearest design inside"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(arguments, message, tmp_path, quick, capsys, monkeypatch):
    files = {
        "few": write_csv(tmp_path / "few.csv", TRAINING, slice(0, 5)),
        "half": write_csv(tmp_path / "half.csv", TRAINING, np.flatnonzero(TRAINING.design_mm[:, 0] < 3.0)),
        "all": write_csv(tmp_path / "all.csv", VALIDATION),
    }
    assert main(["metamodels", *(argument.format(**files) for argument in arguments)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("mbpam metamodels: ") and message in said and said.count("\n") == 1


def test_it_is_said_how_samples_were_held_back_and_whether_deviations_cover(capsys):
    assert main(["metamodels", "--leave-one-out"]) == 0
    said = capsys.readouterr()
    assert "held back: closed form, as refits give (PRS, RBF)" in said.out
    assert "held back: refits (KRG, RBF_GAUSSIAN, KRG_NUGGET)" in said.out
    verdicts = [line for line in said.out.splitlines() if "times sigma" in line]
    assert len(verdicts) == 4 and verdicts[0].startswith("  KRG ") and "do not trust it" in verdicts[0]
    assert said.err == ""


def test_many_samples_are_announced_and_judged_without_refits(tmp_path, monkeypatch, capsys):
    design = np.random.default_rng(6).uniform([1.5, 1.0], [3.5, 3.0], size=(60, 2))
    a, b = design.T
    samples = Samples(design, {"theta_max": 100.0 * np.sin(a) + 10.0 * b**2, "f_max": np.exp(0.3 * b) / a})
    fits, fit = [], Kriging._fit
    monkeypatch.setattr(Kriging, "_fit", lambda self: (fits.append(self), fit(self)))
    monkeypatch.setattr(terminal, "PATIENCE_S", 1.0)
    assert main(["metamodels", "--training", write_csv(tmp_path / "many.csv", samples)]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("5 metamodels of 60 samples, judged by leaving each out: takes about ")
    assert "[5/5] KRG_NUGGET fitted and judged" in said.err
    assert "closed form, with length scales, nugget and variance of all samples (KRG, KRG_NUGGET)" in said.out
    assert len(fits) <= 2 * 2 * (1 + 3)  # once, and three times more to be timed where a fit is quick


def test_the_same_design_twice_is_refused_in_one_line(tmp_path, capsys):
    rows = np.r_[np.arange(21), 5]
    design = TRAINING.design_mm[rows] + np.where(np.arange(22) == 21, 1e-8, 0.0)[:, None]
    twice = Samples(design, {key: values[rows] + (np.arange(22) == 21) for key, values in TRAINING.responses.items()})
    assert main(["metamodels", "--training", write_csv(tmp_path / "twice.csv", twice)]) == 1
    said = capsys.readouterr().err
    assert "samples 6 and 22 have the same design" in said and said.count("\n") == 1


def test_a_comparison_goes_on_from_what_its_file_holds(tmp_path, monkeypatch, capsys):
    path, kept_in = tmp_path / "table.json", tmp_path / "table_runs.json"
    command = ["metamodels", "--json", str(path), "--picture", str(tmp_path / "table.png")]
    pytest.importorskip("matplotlib")
    assert main(command) == 0
    whole, said, kept = path.read_text(), capsys.readouterr().out, json.loads(kept_in.read_text())
    kept["metamodels"] = [row for row in kept["metamodels"] if row["metamodel"] != "PRS"]
    kept_in.write_text(json.dumps(kept))
    judge_metamodel, judged_anew = compare_metamodels.judge_metamodel, []
    monkeypatch.setattr(
        compare_metamodels, "judge_metamodel", lambda *job: judged_anew.append(job[0]) or judge_metamodel(*job)
    )
    assert main(command) == 0
    assert judged_anew == ["prs"]
    before, after = json.loads(whole), json.loads(path.read_text())
    assert before.pop("PRS")["f_max"]["rmse"] == after.pop("PRS")["f_max"]["rmse"]  # its times are others
    assert after == before
    assert len(capsys.readouterr().out.splitlines()) == len(said.splitlines())
