import dataclasses
import json
import math

import pytest

pytest.importorskip("felupe")

from mbpam_ros.actuator.end_law import finite_element_end_law
from mbpam_ros.study.executors import ThisProcess
from mbpam_ros.study.fe import end_effect
from mbpam_ros.study.fe.end_effect import ShortMuscle, end_effect_table
from mbpam_ros.study.fe.loaded_muscle import MuscleModel
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.terminal import Progress

COARSE = MuscleModel(CellGeometry(c_mm=2.1), "coarse", end_length_mm=4.0)


def test_what_an_end_does_is_the_same_for_any_number_of_waves():
    """Turn, length and shift follow from the middle, where all is the unit cell's."""
    few, more = (ShortMuscle(COARSE, "pdc", waves).effect(0.06) for waves in (4, 6))
    assert math.degrees(few.turn_rad) == pytest.approx(math.degrees(more.turn_rad), abs=0.02)
    assert few.length_mm == pytest.approx(more.length_mm, abs=0.01)
    assert few.shift_mm == pytest.approx(more.shift_mm, abs=0.01)
    assert more.shift_mm > 0.1
    # the end as a beam yields by 4 mm / (5.4e3 N mm2)
    assert few.compliance_rad_per_n_mm == pytest.approx(more.compliance_rad_per_n_mm, abs=2e-5)
    assert abs(more.compliance_rad_per_n_mm) < 7e-4


def test_without_pressure_an_end_does_nothing():
    effect = ShortMuscle(COARSE, "pdc", 2).effect(0.0)
    assert (effect.turn_rad, effect.length_mm, effect.shift_mm) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert effect.compliance_rad_per_n_mm < 0.0  # its waves cannot warp


def test_the_waves_are_sheared_about_as_a_rod_of_their_material():
    """GA next to 5/6 EA / 3 with the unit cell's EA, 67 N for the finer wall."""
    effect = ShortMuscle(COARSE, "pdc", 4).effect(0.0)
    assert 1.0 / effect.shear_per_n == pytest.approx(67.0 / 3.0 * 5.0 / 6.0, rel=0.35)


@pytest.mark.slow
def test_a_smaller_muscle_of_a_softer_silicone_has_similar_ends():
    """Half the size, a third of the modulus: at a third of the pressure the same turn, and yield of the same law."""
    paper, soft = ShortMuscle(COARSE, "pdc", 2).effect(0.04), Silicone()
    constants = {name: value / 3.0 for name, value in dataclasses.asdict(soft).items()}
    size = CellGeometry(a_mm=1.25, b_mm=1.0, c_mm=1.05, outer_radius_mm=5.0, active_length_mm=50.0)
    small = ShortMuscle(MuscleModel(size, "coarse", 2.0, silicone=Silicone(**constants)), "pdc", 2).effect(0.04 / 3.0)
    assert small.turn_rad == pytest.approx(paper.turn_rad, rel=1e-4)
    assert (2.0 * small.length_mm, 2.0 * small.shift_mm) == pytest.approx((paper.length_mm, paper.shift_mm), rel=1e-3)
    assert small.compliance_rad_per_n_mm == pytest.approx(24.0 * paper.compliance_rad_per_n_mm, rel=1e-2)
    assert small.shear_per_n == pytest.approx(12.0 * paper.shear_per_n, rel=1e-3)


def test_an_odd_number_of_waves_is_refused():
    with pytest.raises(ValueError, match="even number of waves"):
        ShortMuscle(COARSE, "pdc", 3)


def test_the_table_is_kept_and_is_what_the_rod_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(end_effect, "WAVES", 2)
    monkeypatch.setattr(end_effect, "PRESSURES_KPA", (0.0, 60.0))
    path = tmp_path / "ends.json"
    table = end_effect_table(COARSE, path, ThisProcess(), Progress())
    assert [row["pattern"] for row in table["ends"]] == ["pdc", "psc"] and not table["failures"]
    monkeypatch.setattr(end_effect, "end_rows", None)  # nothing is run again
    again = end_effect_table(COARSE, path, ThisProcess(), Progress())
    assert again["ends"] == table["ends"] == json.loads(path.read_text())["ends"]
    joint = finite_element_end_law(path).joint([6e4, 0.0, 0.0, 6e4])
    assert 1e3 * joint.shift_x_m == pytest.approx(-table["ends"][0]["shift_mm"][1], abs=1e-9)
