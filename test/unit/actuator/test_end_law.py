import math

import numpy as np
import pytest

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.elastic_rod import EndJoint, RodLoads, RodSection, rod_at_rest
from mbpam_ros.actuator.end_law import EndLaw, PatternEnds, finite_element_end_law
from mbpam_ros.configuration import ConfigError

GEOMETRY = MuscleGeometry(outer_radius_m=0.01, end_length_m=0.015, active_length_m=0.1, mass_per_length_kg_m=0.162)
WEIGHTLESS = (0.0, 0.0, 0.0)
BENT = RodSection(-0.03, 0.0, 1.5e-3, 0.1, 1e-3)
JOINT = EndJoint(-0.02, 0.0, 3e-4, -1e-3, 0.0)
GRID, SHEAR = np.array([0.0, 1e5]), np.array([0.06, 0.04])
LAW = EndLaw(
    GRID,
    psc=PatternEnds(np.array([0.0, 0.01]), np.array([0.0, 1e-4]), np.array([0.0, 4e-4]), np.array([-0.4, 0.2]), SHEAR),
    pdc=PatternEnds(np.array([0.0, 0.02]), np.array([0.0, 3e-4]), np.array([0.0, 7e-4]), np.array([-0.4, 0.5]), SHEAR),
)


def turned(vector):
    return [-vector[1], vector[0]]


def test_without_loads_the_joints_add_their_turn_length_and_shift_in_the_order_told():
    """End, length, turn, shift, arc, and the mirror image; in the plane x z, toward -x."""
    rod = rod_at_rest(BENT, GEOMETRY, RodLoads(gravity_m_s2=WEIGHTLESS), steps=96, joint=JOINT)
    bend = 0.03 / 1.5e-3 * 0.1
    arc = (1.1 - 1e-3 * 0.03 / 1.5e-3) * 0.1

    def along(angle):
        return np.array([-math.sin(angle), 0.0, math.cos(angle)])

    def inward(angle):
        return np.array([-math.cos(angle), 0.0, -math.sin(angle)])

    first, last = 0.02, 0.02 + bend
    chord = arc * math.sin(0.5 * bend) / (0.5 * bend) * along(0.5 * (first + last))
    ends = 0.0153 * (along(0.0) + along(last + 0.02))
    np.testing.assert_allclose(rod.tip_position_m, ends + 1e-3 * (inward(first) - inward(last)) + chord, atol=1e-9)
    assert rod.tip_angle_rad == pytest.approx(bend + 0.04, abs=1e-9)


def test_a_rod_with_joints_is_held_by_its_loads_without_work_on_a_closed_way():
    """Maxwell's theorem: what one force does along another is what the other does along it, at the loaded state."""
    start, small = np.array([0.01, 0.02, 0.03]), 1e-4
    rows = []
    for axis in np.eye(3):
        after, before = (
            rod_at_rest(
                BENT._replace(
                    axial_compliance_per_n=1.0 / 50.0,
                    torsion_compliance_per_n_m2=1.0 / 1.5e-3,
                    shear_compliance_per_n=0.05,
                ),
                GEOMETRY,
                RodLoads(tuple((start + sign * small * axis).tolist())),
                joint=JOINT._replace(turn_y_rad=0.03, shift_y_m=-5e-4, compliance_per_n_m=3.0),
            ).tip_position_m
            for sign in (1.0, -1.0)
        )
        rows.append((after - before) / (2.0 * small))
    np.testing.assert_allclose(rows, np.transpose(rows), rtol=1e-4, atol=1e-6)


def test_a_joint_yields_as_a_hinge_of_its_compliance():
    """On the straight muscle: the hinges turn by C times the moment at each, that of a small force at the tip."""
    straight, small = RodSection(0.0, 0.0, 1.2e-3), 1e-5
    loads = RodLoads((0.6 * small, 0.8 * small, 0.0), gravity_m_s2=WEIGHTLESS)
    plain, hinged = (
        rod_at_rest(straight, GEOMETRY, loads, joint=EndJoint(compliance_per_n_m=c)).tip_position_m for c in (0.0, 3.0)
    )
    far, near = GEOMETRY.active_length_m + GEOMETRY.end_length_m, GEOMETRY.end_length_m
    expected = 3.0 * small * (far**2 + near**2)
    np.testing.assert_allclose(hinged - plain, expected * np.array([0.6, 0.8, 0.0]), rtol=1e-4, atol=1e-10)


@pytest.mark.parametrize(
    ("chambers", "expected"),
    [
        ([1, 0, 0, 1], EndJoint(-0.02, 0.0, 3e-4, -7e-4, 0.0, 0.5)),
        ([1, 0, 0, 0], EndJoint(*[-0.01 * math.sqrt(0.5)] * 2, 1e-4, *[-4e-4 * math.sqrt(0.5)] * 2, 0.2)),
        ([0, 0, 0, 0], EndJoint(compliance_per_n_m=-0.4)),
        ([1, 0, 1, 0], EndJoint(length_m=2e-4, compliance_per_n_m=0.8)),
    ],
    ids=["pdc", "psc", "none", "opposite"],
)
def test_the_patterns_come_back_away_from_their_chambers(chambers, expected):
    np.testing.assert_allclose(LAW.joint(1e5 * np.array(chambers)), expected, atol=1e-15)


def test_waves_are_sheared_as_without_pressure_and_as_their_chambers_say():
    assert LAW.shear_compliance_per_n(np.zeros(4)) == pytest.approx(0.06)
    for chambers in ([1, 0, 0, 0], [1, 1, 0, 0]):
        assert LAW.shear_compliance_per_n(1e5 * np.array(chambers)) == pytest.approx(0.04)


def test_a_sheared_rod_moves_by_the_force_over_ga():
    sheared = RodSection(0.0, 0.0, 1.2e-3, shear_compliance_per_n=1.0 / 20.0)
    plain, small = sheared._replace(shear_compliance_per_n=0.0), 1e-5
    loads = RodLoads((0.6 * small, 0.8 * small, 0.0), gravity_m_s2=WEIGHTLESS)
    moved = np.subtract(*(rod_at_rest(of, GEOMETRY, loads).tip_position_m for of in (sheared, plain)))
    expected = small * GEOMETRY.active_length_m / 20.0
    np.testing.assert_allclose(moved, expected * np.array([0.6, 0.8, 0.0]), rtol=1e-4, atol=1e-11)


def test_the_joint_turns_with_the_pressures():
    pressure = np.array([9e4, 5e4, 0.0, 2e4])
    joint, after = LAW.joint(pressure), LAW.joint(np.roll(pressure, 1))
    np.testing.assert_allclose(after, [*turned(joint[:2]), joint[2], *turned(joint[3:5]), joint[5]], atol=1e-15)


def test_the_stored_ends_are_nothing_without_pressure_stay_above_120_kpa_and_shift_toward_the_bend():
    law = finite_element_end_law()
    np.testing.assert_array_equal(law.joint(np.zeros(4))[:5], 0.0)
    assert law.joint([1.5e5, 0.0, 0.0, 1.5e5]) == law.joint([1.2e5, 0.0, 0.0, 1.2e5])
    for pressure in (5e4, 1e5):
        assert law.joint([pressure, 0.0, 0.0, pressure]).shift_x_m < 0.0
    assert all(math.isnan(value) for value in law.joint([math.nan, 0.0, 0.0, 0.0]))


def test_what_is_no_law_of_ends_is_refused(tmp_path):
    with pytest.raises(ValueError, match="equal steps"):
        EndLaw(np.array([0.0, 1.0, 3.0]), LAW.psc, LAW.pdc)
    with pytest.raises(ValueError, match="0 without pressure"):
        EndLaw(GRID, LAW.psc._replace(length_m=np.array([1e-4, 1e-4])), LAW.pdc)
    with pytest.raises(ValueError, match="four chambers"):
        LAW.joint([1e5, 0.0, 0.0])
    file = tmp_path / "ends.json"
    file.write_text('{"ends": [{"pattern": "pdc"}]}')
    with pytest.raises(ConfigError, match=r"ends\.json: no ends of mbpam fe ends"):
        finite_element_end_law(str(file))
