"""Tests as machines write them, and files that are none."""

import numpy as np
import pytest

from mbpam_ros.study.silicone.hyperelastic import Yeoh
from mbpam_ros.study.silicone.machine_table import TensileTestError
from mbpam_ros.study.silicone.reading import Specimen, read_tensile_test
from mbpam_ros.study.silicone.tensile_test import youngs_modulus_mpa

MODEL = Yeoh(0.1154, -0.0091, 0.0055)
STRAIN = np.linspace(0.02, 1.2, 60)
STRESS_MPA = MODEL.stress_mpa(1.0 + STRAIN)


def written(tmp_path, head, *columns, separator=",", comma=False, foot=""):
    rows = [separator.join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True)]
    body = "\n".join(rows)
    path = tmp_path / "test.csv"
    path.write_text(head + (body.replace(".", ",") if comma else body) + "\n" + foot, encoding="utf-8")
    return path


def holds_the_pull(test):
    np.testing.assert_allclose(test.strain, STRAIN, rtol=1e-6)
    np.testing.assert_allclose(test.stress_mpa, STRESS_MPA, rtol=1e-6)


@pytest.mark.parametrize(
    ("head", "columns", "dialect"),
    [
        ("strain,stress (MPa)\n", (STRAIN, STRESS_MPA), {}),
        ("Strain [%];Stress [kPa]\n", (100 * STRAIN, 1e3 * STRESS_MPA), {"separator": ";", "comma": True}),
        ("Strain\tStress\n%\tpsi\n", (100 * STRAIN, STRESS_MPA / 6.894757e-3), {"separator": "\t"}),
        ("strain   stress_mpa\n", (STRAIN, STRESS_MPA), {"separator": "   "}),
        ('"Time","Strain","Stress"\n"s","mm/mm","N/mm²"\n', (STRAIN, STRAIN, STRESS_MPA), {}),
        ("True strain (-),Cauchy stress (Pa)\n", (np.log1p(STRAIN), 1e6 * STRESS_MPA * (1 + STRAIN)), {}),
        ("stretch;stress (MPa)\n", (1 + STRAIN, STRESS_MPA), {"separator": ";"}),
        (
            "Specimen width (mm);6\nThickness (mm);3\nGauge length (cm);3.3\nTime (s);Load (N);Extension (mm)\n",
            (STRAIN, 18.0 * STRESS_MPA, 33.0 * STRAIN),
            {"separator": ";"},
        ),
        (
            "Lab;Somewhere, far away\nMachine;5569;;\n\nTrue Strain;True Stress (MPa);Engineering Strain;Engineering "
            "Stress (MPa)\n",
            (np.log1p(STRAIN), STRESS_MPA * (1 + STRAIN), STRAIN, STRESS_MPA),
            {"separator": ";", "foot": "remark;broke at the grip\n"},
        ),
    ],
)
def test_dialects_of_machines_are_read(tmp_path, head, columns, dialect):
    holds_the_pull(read_tensile_test(written(tmp_path, head, *columns, **dialect)))


def test_columns_without_names_are_named_by_hand(tmp_path):
    path = written(tmp_path, "", STRAIN, 100 * STRAIN, 1e3 * STRESS_MPA)
    with pytest.raises(TensileTestError, match="no names over the columns; give them"):
        read_tensile_test(path)
    holds_the_pull(read_tensile_test(path, columns="-,strain (%),stress (kPa)"))


def test_sizes_given_go_before_those_in_the_file(tmp_path):
    path = written(tmp_path, "Width (mm),60\nforce (N),extension (mm)\n", 18.0 * STRESS_MPA, 33.0 * STRAIN)
    holds_the_pull(read_tensile_test(path, Specimen(width_mm=6.0, thickness_mm=3.0, length_mm=33.0)))
    with pytest.raises(TensileTestError, match="needs the gauge length; give --length-mm"):
        read_tensile_test(path, Specimen(width_mm=6.0, thickness_mm=3.0))


def test_what_is_assumed_and_left_out_is_noted(tmp_path):
    strain = np.append(STRAIN, [1.21, 1.22])
    stress = np.append(STRESS_MPA, [0.2, 0.01])
    stress[0] = 0.5 * STRESS_MPA.max()
    test = read_tensile_test(written(tmp_path, "strain,stress\n", 100 * strain, stress))
    assert test.notes == (
        "engineering strain and engineering stress, 62 points",
        "no unit of the engineering strain: taken as %, since it goes to 122",
        "no unit of the engineering stress: taken as MPa",
        "2 points after the largest stress left out",
        "1 point far off the neighbours left out, at strain 0.02",
    )
    np.testing.assert_allclose(test.strain, STRAIN[1:], rtol=1e-6)


def test_youngs_modulus_is_that_of_small_strains(tmp_path):
    test = read_tensile_test(written(tmp_path, "strain,stress (MPa)\n", STRAIN, STRESS_MPA))
    assert youngs_modulus_mpa(test) == pytest.approx(6.0 * 0.1154, rel=0.02)


@pytest.mark.parametrize(
    ("head", "columns", "message"),
    [
        ("strain,stress (MPa)\n", (STRAIN, 1e3 * STRESS_MPA), r"a unit is wrong, perhaps by .*1000 \(kPa and MPa\)"),
        ("strain,stress (MPa)\n", (STRAIN, 145.0 * STRESS_MPA), r"perhaps by .*145 \(psi and MPa\)"),
        ("strain,stress (kPa)\n", (STRAIN, STRESS_MPA), r"perhaps by .*1000 \(kPa and MPa\)"),
        ("strain (-),stress (MPa)\n", (100 * STRAIN, STRESS_MPA), "a unit is wrong"),
        ("strain,stress (MPa)\n", (-STRAIN, -STRESS_MPA), "compressive: .* turn the signs"),
        ("strain,stress (MPa)\n", (STRAIN[:2], STRESS_MPA[:2]), "too short: 2 rows have both"),
        (
            "strain,stress (MPa)\n",
            (np.r_[STRAIN, STRAIN[::-1], STRAIN], np.r_[STRESS_MPA, 0.9 * STRESS_MPA[::-1], 1.01 * STRESS_MPA]),
            "not one pull: strain goes back",
        ),
        (
            "strain,stress (MPa)\n",
            (STRAIN, STRESS_MPA + 0.4 * np.random.default_rng(2).standard_normal(60)),
            "noise of .* % of the largest stress|not one pull|Young's modulus",
        ),
        ("time (s),temperature (C)\n", (STRAIN, STRESS_MPA), "no columns that tell a tensile test among: time"),
        ("strain,strain,stress (MPa)\n", (STRAIN, STRAIN, STRESS_MPA), "columns 1 and 2 both look like engineering"),
        (
            "true stress (MPa),strain,stress (MPa)\n",
            (10.0 * STRESS_MPA * (1 + STRAIN), STRAIN, STRESS_MPA),
            "its true stress is 10 times what",
        ),
        (
            "Section (cm2),1.8,0\nWidth (mm),6,0\nThickness (mm),3,0\nstrain,stress (MPa)\n",
            (STRAIN, STRESS_MPA),
            "its section of 180 mm2 is not width x thickness, 18 mm2",
        ),
    ],
)
def test_what_silicone_cannot_be_is_refused_with_what_looks_wrong(tmp_path, head, columns, message):
    with pytest.raises(TensileTestError, match=message):
        read_tensile_test(written(tmp_path, head, *columns))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"\n \n", "empty"),
        (b"nothing but\nwords here\n", "no table"),
        (b"strain,stress\n0.1,0.2\n0.2,0.3\n0.3,0.4\nn.a.,0.5\n0.5,0.6\n0.6,0.7\n0.7,0.8\n", "two tables, at lines"),
        (b"strain,stress\n0.1,nan\n0.2,inf\n", "no table"),
        (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x01", "no table"),
    ],
)
def test_files_that_are_no_test_are_refused(tmp_path, content, message):
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    with pytest.raises(TensileTestError, match=message):
        read_tensile_test(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(TensileTestError, match="none.csv: cannot be read: No such file"):
        read_tensile_test(tmp_path / "none.csv")
