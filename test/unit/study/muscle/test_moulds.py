"""Moulds of a drawing: closed, of the muscle's own volume, printable for every design of the domain or refused."""

import dataclasses
import math
import zipfile

import numpy as np
import pytest

from mbpam_ros.actuator.drawing import load_drawing
from mbpam_ros.commands.mbpam import main
from mbpam_ros.gripper import load_gripper

pytest.importorskip("manifold3d")
from mbpam_ros.study.muscle.moulds import THINNEST_PRINT_MM, moulds_of, palm_of
from mbpam_ros.study.muscle.solids import SolidError, is_sound, muscle_solid

PAPER = load_drawing("paper")


def volume_mm3(drawing):
    """Of the finite elements' muscle: the waves' mean section, and ends of solid silicone."""
    ends = 2.0 * drawing.end_length_mm * math.pi * drawing.outer_radius_mm**2
    return drawing.section_mm2 * drawing.active_length_mm + ends


@pytest.fixture(scope="module")
def papers():
    return moulds_of(PAPER)


@pytest.mark.parametrize("corner", [None, (1.5, 1.0), (3.5, 3.0)])
def test_cavities_less_cores_are_the_muscle_and_all_parts_are_closed(corner, papers):
    drawing = PAPER if corner is None else dataclasses.replace(PAPER, a_mm=corner[0], b_mm=corner[1])
    moulds = papers if corner is None else moulds_of(drawing)
    assert all(is_sound(solid) for solid in moulds.parts.values())
    assert all(len(moulds.parts[name].decompose()) == 1 for name in "ABCD")
    assert moulds.cast_mm3 == pytest.approx(volume_mm3(drawing), rel=0.01)
    assert moulds.parts["muscle"].volume() == pytest.approx(volume_mm3(drawing), rel=0.002)
    assert moulds.thinnest_mould_mm >= THINNEST_PRINT_MM
    assert moulds.thinnest_wall_mm == min(drawing.c_mm, drawing.b_mm)
    assert moulds.grams_a == moulds.grams_b > 0.5e-3 * PAPER.density_kg_m3 * 1e-3 * volume_mm3(drawing)


def test_shell_and_cores_go_together_without_cutting_into_each_other(papers):
    overlap = papers.parts["A"] ^ papers.parts["B"]
    assert overlap.volume() < 1e-6 * papers.parts["A"].volume()


def test_a_muscle_of_half_the_size_has_an_eighth_of_the_silicone(papers):
    lengths = ("outer_radius_mm", "active_length_mm", "end_length_mm", "a_mm", "b_mm", "c_mm")
    half = dataclasses.replace(PAPER, **{name: 0.5 * getattr(PAPER, name) for name in lengths})
    assert 8.0 * muscle_solid(half).volume() == pytest.approx(papers.parts["muscle"].volume(), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"active_length_mm": 250.0, "wave_count": 35.0}, "do not fit a bed of 220 mm"),
        ({"c_mm": 5.2, "b_mm": 2.2, "a_mm": 2.5}, "thick in the valleys, a printer makes"),
        ({"b_mm": 0.5}, "liquid silicone fills"),
    ],
)
def test_what_cannot_be_printed_or_cast_is_one_line(change, message):
    with pytest.raises(SolidError, match=message) as error:
        moulds_of(dataclasses.replace(PAPER, **change))
    assert "\n" not in str(error.value)


def test_the_palm_has_four_seats_that_the_muscles_fit(papers):
    gripper = load_gripper()
    palm = palm_of(gripper)
    assert is_sound(palm) and len(palm.decompose()) == 1
    seat = papers.parts["muscle"]
    for place in 1e3 * gripper.finger_base_m[:1]:
        assert (palm ^ seat.translate(tuple(place))).volume() < 1e-6 * seat.volume()
    close = dataclasses.replace(gripper, finger_circle_radius_m=0.0145)
    with pytest.raises(SolidError, match="move the fingers outward"):
        palm_of(close)


def test_the_verbs_write_files_that_others_read(tmp_path, capsys, papers):
    assert main(["muscle", "moulds", "paper", "--out", str(tmp_path), "--3mf"]) == 0
    assert "g of A" in capsys.readouterr().out
    stl = (tmp_path / "B.stl").read_bytes()
    count = int.from_bytes(stl[80:84], "little")
    assert len(stl) == 84 + 50 * count
    corners = np.frombuffer(stl[84:], dtype=[("f", "<f4", (4, 3)), ("a", "<u2")])["f"][:, 1:].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume == pytest.approx(papers.parts["B"].volume(), rel=1e-4)
    assert zipfile.ZipFile(tmp_path / "B.3mf").testzip() is None
    assert "three hours" in (tmp_path / "casting.html").read_text()
    assert main(["palm", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "palm.stl").is_file()
