"""``mbpam silicone``: from a file to constants, and one line for what cannot be."""

import json

import numpy as np
import pytest

from mbpam_ros.commands.mbpam import main
from mbpam_ros.study.silicone.hyperelastic import Yeoh
from mbpam_ros.study.silicone.known import load_silicones, yeoh_constants_of

STRAIN = np.linspace(0.0, 1.2, 50)
PAPER = {"c10_mpa": 0.1154, "c20_mpa": -0.0091, "c30_mpa": 0.0055}


def pull(path, constants=(), factor=1.0):
    stress_mpa = factor * Yeoh(*(constants or PAPER.values())).stress_mpa(1.0 + STRAIN)
    rows = [f"{strain:.6f},{stress:.8f}" for strain, stress in zip(STRAIN, stress_mpa, strict=True)]
    path.write_text("strain,stress (MPa)\n" + "\n".join(rows), encoding="utf-8")
    return str(path)


def test_the_papers_constants_come_back_and_are_kept_for_the_finite_elements(tmp_path, capsys):
    kept = tmp_path / "kept.json"
    assert main(["silicone", pull(tmp_path / "a.csv"), "--json", str(kept)]) == 0
    found = json.loads(kept.read_text())
    assert found["constants"] == pytest.approx(PAPER, rel=1e-3)
    assert found["r2"] > 0.99999 and found["best"] == "yeoh"
    assert yeoh_constants_of(str(kept)).constants() == pytest.approx(PAPER, rel=1e-3)
    assert "mooney-rivlin" in capsys.readouterr().out


@pytest.mark.slow
def test_a_picture_shows_repeats_and_models(tmp_path):
    pytest.importorskip("matplotlib")
    tests = [pull(tmp_path / f"{factor}.csv", factor=factor) for factor in (0.95, 1.05)]
    picture = tmp_path / "fit.png"
    assert main(["silicone", *tests, "--picture", str(picture)]) == 0
    assert picture.stat().st_size > 10_000


def test_a_model_too_simple_for_the_test_is_told_with_those_that_follow_it(tmp_path, capsys):
    stiffening = pull(tmp_path / "a.csv", (0.05, 0.02, 0.01))
    assert main(["silicone", stiffening, "--model", "neo-hooke"]) == 1
    assert "neo-hooke has R2" in (said := capsys.readouterr().err)
    assert "take yeoh" in said


def test_silicones_known_by_name_are_printed_and_are_stable_when_pulled(capsys):
    assert main(["silicone", "--known"]) == 0
    shown = capsys.readouterr().out
    for name, known in load_silicones().items():
        assert name in shown
        yeoh = Yeoh(known.c10_mpa, known.c20_mpa, known.c30_mpa)
        low, high = yeoh.stable_stretches("uniaxial")
        assert low < 0.6 and high > 2.0
    assert yeoh_constants_of("e625").constants() == PAPER


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a test, or --known"),
        (["no.csv"], "no.csv: cannot be read: No such file"),
        (["TEST", "--strain", "1:0.5"], "expected LOW below HIGH"),
        (["TEST", "--strain", "a:b"], "expected LOW:HIGH"),
        (["TEST", "--strain", "3:4"], "points lie between strains 3 and 4"),
        (["TEST", "--width-mm", "-1"], "width_mm of the specimen must be 0.01 to 1000"),
        (["TEST", "--columns", "a,b,c"], "3 columns are named, the table has 2"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, capsys, arguments, message):
    given = [pull(tmp_path / "a.csv") if each == "TEST" else each for each in arguments]
    try:
        status = main(["silicone", *given])
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr().err
    assert status in (1, 2) and message in said and said.count("\n") == 1
