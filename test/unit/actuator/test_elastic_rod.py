import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.elastic_rod import (
    HANGING,
    RodLoads,
    RodSection,
    rod_at_rest,
    rod_section,
    solid_end,
)
from mbpam_ros.actuator.planar_rod import AxisStretch, RodSolutionError, rod_tip_angle
from mbpam_ros.actuator.rod_law import RodLaw, StrainLaw, StrainLawError, finite_element_rod_law
from mbpam_ros.actuator.strains import STRAINS

GEOMETRY = MuscleGeometry(outer_radius_m=0.01, end_length_m=0.015, active_length_m=0.1, mass_per_length_kg_m=0.162)
ACTIVE, END = GEOMETRY.active_length_m, GEOMETRY.end_length_m
BENT = RodSection(-0.035, 0.02, 1.7e-3, 0.16, 1.5e-3, -0.8e-3, 1.0 / 20.0, 1.0 / 1.0e-3)
CURVED = BENT._replace(stiffening_n_m3=1e-5, side_n_m2=-1.5e-4)
STRAIGHT = RodSection(0.0, 0.0, 1.2e-3, 0.0, 0.0, 0.0, 1.0 / 30.0, 1.0 / 0.9e-3)
EVERYTHING = RodLoads((0.02, 0.05, -0.03), 2e-3, (3.0, 4.0, -8.0))
WEIGHTLESS = (0.0, 0.0, 0.0)


def tip(section, loads, **options):
    return rod_at_rest(section, GEOMETRY, loads, **options).tip_position_m


@pytest.mark.slow
def test_the_error_of_the_tip_falls_with_the_fourth_power_of_the_step_and_is_small_with_the_usual_one():
    exact = tip(BENT, EVERYTHING, steps=384)
    errors = [np.linalg.norm(tip(BENT, EVERYTHING, steps=steps) - exact) / ACTIVE for steps in (12, 24, 48)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.3)
    assert errors[1] < 1e-6


def bend_of(load, section):
    """Curvature at which the energy B k^2 / 2 + Q (k^3 / 3 - k_free k^2 / 2) + S k_s^2 / 2 has the slope ``load``."""
    intrinsic = np.array([section.moment_x_n_m, section.moment_y_n_m])
    toward = intrinsic / np.linalg.norm(intrinsic)
    side = np.array([-toward[1], toward[0]])
    free = np.linalg.norm(intrinsic) / section.stiffness_n_m2

    def left(k):
        return section.stiffness_n_m2 * k + section.stiffening_n_m3 * k * (k - free) - load @ toward

    return brentq(left, -40.0, 120.0) * toward + load @ side / (section.stiffness_n_m2 + section.side_n_m2) * side


@pytest.mark.slow
@pytest.mark.parametrize("of", [CURVED], ids=["curve"])
def test_bend_stretch_and_twist_under_all_loads_are_those_of_a_collocation_solver(of):
    """SciPy's solve_bvp on forces, moments and energy written with matrices: it shares neither march nor Newton."""
    weight = GEOMETRY.mass_per_length_kg_m * np.array(EVERYTHING.gravity_m_s2)
    force, slope = np.array(EVERYTHING.tip_force_n), np.array([BENT.slope_x_m, BENT.slope_y_m])
    intrinsic = np.array([BENT.moment_x_n_m, BENT.moment_y_n_m])
    beyond = ACTIVE + END

    def derivative(s, y, share):
        rows = []
        for length, (rotation, moment) in zip(s, zip(y[:4].T, y[4:7].T, strict=True), strict=True):
            body = Rotation.from_quat(rotation)
            n = share * (force + weight * (beyond - length))
            local_n, local_m = body.inv().apply(n), body.inv().apply(moment)
            bend = bend_of(intrinsic + local_n[2] * slope + [local_m[1], -local_m[0]], of)
            twist = local_m[2] * BENT.torsion_compliance_per_n_m2
            stretch = 1.0 + BENT.free_stretch + slope @ bend + local_n[2] * BENT.axial_compliance_per_n
            forward = stretch * body.apply([0.0, 0.0, 1.0])
            u0, u1, u2 = -bend[1], bend[0], twist
            x, y_, z, w = rotation
            turning = 0.5 * np.array(
                [
                    w * u0 + y_ * u2 - z * u1,
                    w * u1 + z * u0 - x * u2,
                    w * u2 + x * u1 - y_ * u0,
                    -(x * u0 + y_ * u1 + z * u2),
                ]
            )
            rows.append(np.concatenate([turning, -np.cross(forward, n), forward]))
        return np.array(rows).T

    def ends(clamp, far, share):
        axis = Rotation.from_quat(far[:4]).apply([0.0, 0.0, 1.0])
        at_tip = np.cross(END * axis, share * (force + 0.5 * END * weight)) + share * EVERYTHING.tip_torque_n_m * axis
        return np.concatenate([clamp[:4] - [0, 0, 0, 1], far[4:7] - at_tip, clamp[7:] - [0, 0, END]])

    s = np.linspace(0.0, ACTIVE, 31)
    turns = np.outer(s, [-intrinsic[1], intrinsic[0], 0.0]) / BENT.stiffness_n_m2
    guess = np.zeros((10, s.size))
    guess[:4] = Rotation.from_rotvec(turns).as_quat().T
    for share in (0.25, 0.5, 0.75, 1.0):
        found = solve_bvp(
            lambda s, y, share=share: derivative(s, y, share),
            lambda a, b, share=share: ends(a, b, share),
            s,
            guess,
            tol=1e-6,
            max_nodes=3000,
        )
        assert found.success
        s, guess = found.x, found.y
    ours = rod_at_rest(of, GEOMETRY, EVERYTHING)
    axis = Rotation.from_quat(found.y[:4, -1]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(ours.tip_position_m, found.y[7:, -1] + END * axis, atol=1e-5 * ACTIVE)
    np.testing.assert_allclose(ours.tip_direction, axis, atol=1e-5)
    assert (
        Rotation.from_quat(ours.tip_orientation_xyzw) * Rotation.from_quat(found.y[:4, -1]).inv()
    ).magnitude() < 2e-5


def test_small_loads_on_the_straight_muscle_are_those_of_beam_theory():
    small, far = 1e-5, ACTIVE + END
    sideways = tip(STRAIGHT, RodLoads((0.0, small, 0.0), 0.0, WEIGHTLESS))
    expected = small * (far**3 - END**3) / (3.0 * STRAIGHT.stiffness_n_m2)
    assert sideways == pytest.approx([0.0, expected, GEOMETRY.length_m], rel=1e-6)
    pulled = tip(STRAIGHT, RodLoads((0.0, 0.0, small), 0.0, WEIGHTLESS))
    assert pulled[2] - GEOMETRY.length_m == pytest.approx(small * ACTIVE / 30.0, rel=1e-6)
    twisted = rod_at_rest(STRAIGHT, GEOMETRY, RodLoads((0.0, 0.0, 0.0), small, WEIGHTLESS))
    assert twisted.tip_roll_rad == pytest.approx(small * ACTIVE / 0.9e-3, rel=1e-9)
    level = tip(STRAIGHT, RodLoads(gravity_m_s2=(1e-3, 0.0, 0.0)))
    weight = 1e-3 * GEOMETRY.mass_per_length_kg_m
    assert level[0] == pytest.approx(weight * (far**4 - END**4) / (8.0 * STRAIGHT.stiffness_n_m2), rel=1e-6)


def test_small_loads_on_a_muscle_with_elastic_ends_are_those_of_beam_theory():
    """The whole a solid cylinder, and ends softer than the active part."""
    small, length = 1e-5, GEOMETRY.length_m
    solid = solid_end(0.23e6, GEOMETRY)
    assert solid.stiffness_n_m2 == pytest.approx(5.42e-3, rel=1e-3)  # 3 G pi R^4 / 4
    found = rod_at_rest(solid, GEOMETRY, RodLoads((0.0, small, small), small, WEIGHTLESS), ends=solid)
    assert found.tip_position_m[1] == pytest.approx(small * length**3 / (3.0 * solid.stiffness_n_m2), rel=1e-4)
    assert found.tip_position_m[2] - length == pytest.approx(small * length * solid.axial_compliance_per_n, rel=2e-2)
    assert found.tip_roll_rad == pytest.approx(small * length * solid.torsion_compliance_per_n_m2, rel=1e-6)
    far = ACTIVE + END
    soft = rod_at_rest(STRAIGHT, GEOMETRY, RodLoads((small, 0.0, 0.0), 0.0, WEIGHTLESS), ends=solid)
    active = (far**3 - END**3) / (3.0 * STRAIGHT.stiffness_n_m2)
    ends = (length**3 - far**3 + END**3) / (3.0 * solid.stiffness_n_m2)
    assert soft.tip_position_m[0] == pytest.approx(small * (active + ends), rel=1e-6)


def test_its_own_weight_stretches_the_hanging_muscle():
    weight, far = GEOMETRY.mass_per_length_kg_m * HANGING[2], ACTIVE + END
    longer = tip(STRAIGHT, RodLoads())[2] - GEOMETRY.length_m
    assert longer == pytest.approx(weight * (far**2 - END**2) / 2.0 / 30.0, rel=1e-9)


@pytest.mark.parametrize(
    ("load", "angle_rad", "shortening", "deflection"),
    [(1.0, 0.46135, 0.05643, 0.30172), (10.0, 1.43029, 0.55500, 0.81061)],
)
def test_a_cantilever_under_a_large_end_load_is_the_elastica(load, angle_rad, shortening, deflection):
    """K. Mattiasson, Int. J. Numer. Meth. Eng. 17 (1981): elliptic integrals, P L^2 / B = 1 and 10."""
    geometry = dataclasses.replace(GEOMETRY, end_length_m=1e-9)
    force = load * STRAIGHT.stiffness_n_m2 / ACTIVE**2
    beam = RodSection(0.0, 0.0, STRAIGHT.stiffness_n_m2)
    found = rod_at_rest(beam, geometry, RodLoads((force, 0.0, 0.0), 0.0, WEIGHTLESS))
    assert found.tip_angle_rad == pytest.approx(angle_rad, abs=1e-5)
    assert found.tip_position_m / ACTIVE == pytest.approx([deflection, 0.0, 1.0 - shortening], abs=1e-5)


def test_the_upright_rod_that_only_bends_is_the_planar_rod():
    section = RodSection(0.04, 0.0, 1.7e-3)
    found = rod_at_rest(section, GEOMETRY, RodLoads(gravity_m_s2=(0.0, 0.0, -9.81)))
    assert found.tip_angle_rad == pytest.approx(rod_tip_angle(0.04, 1.7e-3, GEOMETRY), abs=1e-4)
    assert found.tip_roll_rad == pytest.approx(0.0, abs=1e-12)


def test_the_upright_rod_that_stretches_is_the_planar_rod_that_calibrations_are_made_with():
    stretch = AxisStretch(1.16, -1.5e-3, 1.0 / 20.0)
    section = RodSection(0.04, 0.0, 1.7e-3, 0.16, -1.5e-3, 0.0, 1.0 / 20.0)
    found = rod_at_rest(section, GEOMETRY, RodLoads(gravity_m_s2=(0.0, 0.0, -9.81)))
    assert found.tip_angle_rad == pytest.approx(rod_tip_angle(0.04, 1.7e-3, GEOMETRY, stretch=stretch), abs=1e-5)


def test_without_loads_the_axis_is_an_arc_of_the_free_stretch():
    free = dataclasses.replace(EVERYTHING, tip_force_n=WEIGHTLESS, tip_torque_n_m=0.0, gravity_m_s2=WEIGHTLESS)
    curvature = math.hypot(BENT.moment_x_n_m, BENT.moment_y_n_m) / BENT.stiffness_n_m2
    away = np.array([BENT.moment_x_n_m, BENT.moment_y_n_m]) / math.hypot(BENT.moment_x_n_m, BENT.moment_y_n_m)
    stretch = 1.0 + BENT.free_stretch + curvature * (away @ [BENT.slope_x_m, BENT.slope_y_m])
    angle = curvature * ACTIVE
    across = stretch * (1.0 - math.cos(angle)) / curvature + END * math.sin(angle)
    along = stretch * math.sin(angle) / curvature + END * (1.0 + math.cos(angle))
    for of in (BENT, CURVED):
        np.testing.assert_allclose(tip(of, free), [*(across * away), along], atol=1e-7)


@pytest.mark.parametrize("of", [BENT, CURVED], ids=["line", "curve"])
def test_the_tip_yields_to_forces_as_one_energy_asks(of):
    """The compliance d tip / d force of a loaded, bent, stretched and twisted rod is symmetric: the loads are dead."""
    loads, nudge = dataclasses.replace(EVERYTHING, tip_torque_n_m=0.0), 1e-4
    compliance = np.empty((3, 3))
    for axis in range(3):
        moved = [np.array(loads.tip_force_n) + sign * nudge * np.eye(3)[axis] for sign in (1.0, -1.0)]
        tips = [tip(of, dataclasses.replace(loads, tip_force_n=tuple(force))) for force in moved]
        compliance[:, axis] = (tips[0] - tips[1]) / (2.0 * nudge)
    np.testing.assert_allclose(compliance, compliance.T, atol=1e-5 * np.abs(compliance).max())
    assert (np.linalg.eigvalsh(0.5 * (compliance + compliance.T)) > 0.0).all()


def test_the_tip_angle_counts_on_beyond_a_half_turn_and_the_roll_of_a_planar_bend_is_none():
    for degrees in (30.0, 150.0, 200.0, 350.0, 400.0):
        curvature = math.radians(degrees) / ACTIVE
        found = rod_at_rest(RodSection(-curvature * 1.7e-3, 0.0, 1.7e-3), GEOMETRY, RodLoads(gravity_m_s2=WEIGHTLESS))
        assert math.degrees(found.tip_angle_rad) == pytest.approx(degrees, abs=1e-4)
        assert found.tip_roll_rad == pytest.approx(0.0, abs=1e-9)


def test_a_torque_turns_the_tip_about_its_own_axis():
    """Bent by half a turn, the tip looks at the clamp: a right-handed torque about it is left-handed about z."""
    section = RodSection(math.pi / ACTIVE * 1.7e-3, 0.0, 1.7e-3, torsion_compliance_per_n_m2=1e3)
    torque = RodLoads(WEIGHTLESS, 1e-5, WEIGHTLESS)
    moved = tip(section, torque) - tip(section, RodLoads(gravity_m_s2=WEIGHTLESS))
    quarter = RodSection(0.5 * math.pi / ACTIVE * 1.7e-3, 0.0, 1.7e-3, torsion_compliance_per_n_m2=1e3)
    assert rod_at_rest(quarter, GEOMETRY, torque).tip_roll_rad > 0.0
    assert rod_at_rest(STRAIGHT, GEOMETRY, torque).tip_roll_rad > 0.0
    assert abs(moved[1]) > 100.0 * np.abs(moved[[0, 2]]).max()


def synthetic_law():
    grid = np.array([0.0, 1e5])
    moment, stiffness = np.array([0.0, 0.04]), np.array([1.2e-3, 1.7e-3])
    strains = StrainLaw(np.array([0.0, 0.16]), np.array([0.0, -1e-3]), np.array([30.0, 20.0]), np.array([9e-4, 1e-3]))
    return RodLaw(grid, moment, moment, stiffness, stiffness, strains, strains)


def test_strains_that_are_left_out_are_none_and_unknown_ones_are_refused():
    law, pressure = synthetic_law(), [1e5, 0.0, 0.0, 1e5]
    full, stiff = rod_section(law, pressure, STRAINS), rod_section(law, pressure, ("bend",))
    assert stiff[3:] == (0.0,) * 8
    assert full[:3] == stiff[:3]
    assert rod_section(law, pressure, ("bend", "twist")) == full._replace(
        free_stretch=0.0, slope_x_m=0.0, slope_y_m=0.0, axial_compliance_per_n=0.0
    )
    assert rod_section(law, pressure, ("stretch", "bend")) == full._replace(torsion_compliance_per_n_m2=0.0)
    assert full.axial_compliance_per_n == pytest.approx(1.0 / 20.0)
    assert full.slope_x_m > 0.0  # pdc bends toward -x, where more bend shortens the axis
    for strains in (("stretch",), ("bend", "shear"), ("bend", "bend"), ()):
        with pytest.raises(ValueError, match="strains must be some of bend, stretch, twist"):
            rod_section(law, pressure, strains)
    bare = RodLaw(*(getattr(law, field.name) for field in dataclasses.fields(law)[:5]))
    assert rod_section(bare, pressure, ("bend",)) == stiff
    with pytest.raises(StrainLawError):
        rod_section(bare, pressure, STRAINS)


def test_the_curve_of_the_law_is_its_departure_from_the_line_along_and_across_the_moment():
    law, pressure = finite_element_rod_law(), [1e5, 5e4, 0.0, 0.0]
    line, curve = (rod_section(law, pressure, STRAINS, bending) for bending in ("line", "curve"))
    assert curve[:8] == line[:8] and line[8:] == (0.0, 0.0, 0.0)
    of, (moment, _) = law.bend_curve(pressure), law.moment_and_stiffness(pressure)
    assert curve.stiffening_n_m3 == pytest.approx(of.stiffening_n_m3 @ moment / np.hypot(*moment))
    assert curve.side_n_m2 == of.side_n_m2
    balanced = rod_section(law, [1e5, 0.0, 1e5, 0.0], STRAINS, "curve")
    assert balanced[8:] == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="'arc'; known: line, curve"):
        rod_section(law, pressure, STRAINS, "arc")
    with pytest.raises(StrainLawError, match="side_bend_stiffness_n_mm2"):
        rod_section(synthetic_law(), pressure, STRAINS, "curve")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tip_force_n": (0.0, 1.0)}, "tip_force_n must be three"),
        ({"gravity_m_s2": (0.0, math.nan, 0.0)}, "gravity_m_s2 must be three finite"),
        ({"tip_torque_n_m": math.inf}, "tip_torque_n_m must be finite"),
    ],
)
def test_loads_that_cannot_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        RodLoads(**change)


def test_loads_that_no_equilibrium_is_found_for_are_said():
    with pytest.raises(RodSolutionError, match="beyond .*% of the loads on its tip"):
        rod_at_rest(BENT, GEOMETRY, RodLoads((1e6, 0.0, 0.0)))
