import math
import time

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

felupe = pytest.importorskip("felupe")

from mbpam_ros.study.fe.design_run import FAST_WALL_MM  # noqa: E402
from mbpam_ros.study.fe.law import BendingLaw  # noqa: E402
from mbpam_ros.study.fe.mesh import FAST, CellGeometry, Resolution  # noqa: E402
from mbpam_ros.study.fe.solve import LoadStepError, StepControl, linear_solver  # noqa: E402
from mbpam_ros.study.fe.unequal_pressures import bend_vector_rad  # noqa: E402
from mbpam_ros.study.fe.unit_cell import UnitCell  # noqa: E402

SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
SMALL_QUADRATIC = Resolution(wave=2, wall=1, arm=2, spoke=1, sector=1, quadratic=True)
BOTH_ELEMENTS = pytest.mark.parametrize("resolution", [SMALL, SMALL_QUADRATIC], ids=["trilinear", "quadratic"])
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])
PRESSURE_MPA = 0.02


def disturbed(cell, seed=5):
    """Unknowns of a cell that is bent and crumpled at random."""
    rng = np.random.default_rng(seed)
    unknowns = cell.rest().unknowns + 0.02 * rng.standard_normal(cell.unknown_count)
    unknowns[-2:] = 0.03, 0.1
    return unknowns, rng.standard_normal(cell.unknown_count)


@pytest.fixture(scope="module")
def pdc():
    return UnitCell(CellGeometry(), "pdc", SMALL)


@pytest.fixture(scope="module")
def bent(pdc):
    return pdc.free_bend(PRESSURE_MPA)


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_the_forces_are_the_slope_of_the_potential(pattern, resolution):
    cell = UnitCell(CellGeometry(), pattern, resolution)
    unknowns, direction = disturbed(cell)
    step = 1e-6
    ahead, behind = (cell.potential_n_mm(unknowns + sign * step * direction, PRESSURE_MPA) for sign in (1.0, -1.0))
    assert (ahead - behind) / (2 * step) == pytest.approx(cell.forces(unknowns, PRESSURE_MPA) @ direction, rel=1e-6)


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_the_tangent_is_the_slope_of_the_forces_and_symmetric_to_rounding(pattern, resolution):
    cell = UnitCell(CellGeometry(), pattern, resolution)
    unknowns, direction = disturbed(cell)
    tangent, step = cell.tangent(unknowns, PRESSURE_MPA), 1e-6
    ahead, behind = (cell.forces(unknowns + sign * step * direction, PRESSURE_MPA) for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2 * step)
    assert np.abs(tangent @ direction - slope).max() < 1e-8 * np.abs(slope).max()
    assert abs(tangent - tangent.T).max() < 1e-14 * abs(tangent).max()


@BOTH_ELEMENTS
def test_the_gas_pushes_the_walls_as_felupes_follower_pressure_does(resolution):
    cell = UnitCell(CellGeometry(), "pdc", resolution)
    x = cell.positions_mm(disturbed(cell)[0])
    mesh = cell.mesh
    kind, boundary = (
        ("hexahedron20", felupe.RegionQuadraticHexahedronBoundary)
        if resolution.quadratic
        else ("hexahedron", felupe.RegionHexahedronBoundary)
    )
    on_wall = np.zeros(len(mesh.points_mm), dtype=bool)
    on_wall[mesh.faces[1]] = True
    region = boundary(felupe.Mesh(mesh.points_mm, mesh.cells, kind), only_surface=True, mask=on_wall)
    wall = felupe.FieldContainer([felupe.Field(region, dim=3)])
    wall[0].values[:] = x[:-1] - mesh.points_mm
    item = felupe.SolidBodyPressure(wall, pressure=PRESSURE_MPA)
    theirs = item.assemble.multiplier * item.assemble.vector(wall).toarray().reshape(-1, 3)
    ours = -PRESSURE_MPA * cell._gas[1].gradient(x)[:-1]
    # Ours also holds the thrust on the end plane, at the nodes of the opening's rim.
    inner = np.setdiff1d(np.unique(mesh.faces[1]), np.unique(mesh.rims[1]))
    free = inner[mesh.points_mm[inner, 2] > 0.0]
    assert np.abs(ours[free]).max() > 1e-3
    assert ours[free] == pytest.approx(theirs[free], rel=1e-6, abs=1e-9)


def test_the_gas_thrust_on_the_end_plane_is_pressure_times_opening(pdc):
    rest = pdc.rest().unknowns
    along = -(pdc.forces(rest, PRESSURE_MPA) - pdc.forces(rest, 0.0))
    opening = _polygon_area(pdc.mesh.points_mm[pdc.mesh.rims[1]])
    wall_push = _wall_push_along_z_on_end_nodes(pdc)
    assert along[-1] == pytest.approx(PRESSURE_MPA * opening + wall_push, rel=1e-9)


def _polygon_area(edges):
    a, b = edges[:, 0], edges[:, 1]
    return 0.5 * float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def _wall_push_along_z_on_end_nodes(cell):
    """Pressure on the wall's bilinear faces, shared out to the nodes of the end plane by Gauss' rule."""
    nodes, weights = leggauss(3)
    total, grid, weights = 0.0, 0.5 * (nodes + 1.0), 0.25 * np.outer(weights, weights)
    s, t = np.meshgrid(grid, grid, indexing="ij")
    for face in cell.mesh.faces[1]:
        p = cell.mesh.points_mm[face]
        on_end = np.isclose(p[:, 2], cell.mesh.length_mm)
        if not on_end.any():
            continue
        shape = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
        along_s = np.einsum("ij,k->ijk", 1 - t, p[1] - p[0]) + np.einsum("ij,k->ijk", t, p[2] - p[3])
        along_t = np.einsum("ij,k->ijk", 1 - s, p[3] - p[0]) + np.einsum("ij,k->ijk", s, p[2] - p[1])
        normal_z = np.cross(along_s, along_t)[..., 2]
        total += PRESSURE_MPA * float(np.sum(weights * shape[on_end].sum(axis=0) * normal_z))
    return total


@BOTH_PATTERNS
def test_without_pressure_nothing_bends(pattern):
    cell = UnitCell(CellGeometry(), pattern, SMALL)
    assert np.abs(cell.forces(cell.rest().unknowns, 0.0)).max() < 1e-12
    state = cell.free_bend(0.0)
    assert state.angle_rad == 0.0
    assert state.axis_stretch == 1.0


def test_pressure_inflates_the_chambers_lengthens_the_muscle_and_bends_it_away(pdc, bent):
    assert bent.gas_volume_mm3 > 1.1 * pdc.rest().gas_volume_mm3
    assert bent.axis_stretch > 1.003
    x = pdc.positions_mm(bent.unknowns)
    on_end = np.isclose(pdc.mesh.points_mm[:, 2], pdc.mesh.length_mm)
    assert bent.angle_rad > 0.0
    assert x[:-1][on_end & (pdc.mesh.points_mm[:, 0] > 5.0), 2].min() > x[-1, 2]


def test_free_bend_leaves_no_moment_no_axial_force_and_no_push_on_the_pinned_axis(pdc, bent):
    assert abs(bent.moment_n_mm) < 1e-6
    assert np.abs(pdc.forces(bent.unknowns, PRESSURE_MPA)).max() < 1e-7
    x = pdc.positions_mm(bent.unknowns)
    push = pdc._nodal_forces(x, PRESSURE_MPA).reshape(-1, 3)
    axis = np.flatnonzero(~pdc.mesh.points_mm.any(axis=1))[0]
    assert abs(push[axis, 0]) < 1e-6


@BOTH_PATTERNS
def test_half_a_wave_bends_as_half_of_a_whole_wave(pattern):
    half, whole = (
        UnitCell(CellGeometry(), pattern, SMALL, half_waves=count).free_bend(PRESSURE_MPA) for count in (1, 2)
    )
    assert whole.angle_rad == pytest.approx(2.0 * half.angle_rad, rel=1e-6)
    assert whole.axis_stretch == pytest.approx(half.axis_stretch, rel=1e-8)
    assert whole.gas_volume_mm3 == pytest.approx(2.0 * half.gas_volume_mm3, rel=1e-8)


def test_the_muscles_angle_is_proportional_to_the_number_of_equal_waves(pdc, bent):
    longer = UnitCell(CellGeometry(wave_count=21.0, active_length_mm=150.0), "pdc", SMALL)
    angle = longer.free_bend(PRESSURE_MPA).angle_rad * longer.angle_per_muscle
    assert angle == pytest.approx(1.5 * bent.angle_rad * pdc.angle_per_muscle, rel=1e-8)


def test_the_way_to_a_pressure_does_not_matter(pdc, bent):
    small_steps = UnitCell(CellGeometry(), "pdc", SMALL, control=StepControl(first_step=0.07, largest_step=0.07))
    by_steps = small_steps.free_bend(PRESSURE_MPA)
    from_above = pdc.free_bend(PRESSURE_MPA, pdc.free_bend(1.5 * PRESSURE_MPA))
    for other in (by_steps, from_above):
        assert other.angle_rad == pytest.approx(bent.angle_rad, rel=1e-7)


def test_states_on_the_way_make_a_better_guess_and_change_nothing():
    solves, solve = [], linear_solver()

    def counted(matrix, right):
        solves.append(matrix.shape)
        return solve(matrix, right)

    one_step = StepControl(first_step=1.0, largest_step=1.0)
    cell, found, counts = UnitCell(CellGeometry(), "pdc", SMALL, control=one_step, solve=counted), [], []
    for known in (False, True):
        states = [cell.rest()]
        for pressure in (0.005, 0.010, 0.015, PRESSURE_MPA):
            states.append(cell.free_bend(pressure, states[-1], states[:-1] if known else ()))
        for angle in (0.02, 0.03, 0.04):
            held = [state for state in states if state.pressure_gauge_mpa == PRESSURE_MPA]
            states.append(cell.held_bend(PRESSURE_MPA, angle, held[-1], held[:-1] if known else ()))
        found.append([(state.angle_rad, state.moment_n_mm) for state in states])
        counts.append(len(solves))
    assert np.array(found[1]) == pytest.approx(np.array(found[0]), rel=1e-6, abs=1e-6)
    assert counts[1] - counts[0] < 0.85 * counts[0]


def test_the_muscle_bent_by_hand_is_equally_stiff_in_both_patterns_and_both_ways():
    moments = [
        UnitCell(CellGeometry(), pattern, SMALL).held_bend(0.0, angle).moment_n_mm
        for pattern in ("pdc", "psc")
        for angle in (0.01, -0.01)
    ]
    assert moments[0] > 0.0
    assert moments[0] == pytest.approx(-moments[1], rel=1e-6)
    assert moments[0] == pytest.approx(moments[2], rel=0.02)  # one section of fourfold symmetry, two meshes
    assert moments[2] == pytest.approx(-moments[3], rel=1e-6)


def test_holding_the_free_bend_takes_no_moment_and_holding_it_straight_takes_one_against_the_gas(pdc, bent):
    assert pdc.held_bend(PRESSURE_MPA, bent.angle_rad).moment_n_mm == pytest.approx(0.0, abs=1e-5)
    assert pdc.held_bend(PRESSURE_MPA, 0.0).moment_n_mm < -0.1


def test_the_moment_is_what_the_work_of_bending_says(pdc, bent):
    """dPi*/dphi = M along held bends, Pi* being least over all else; the model is half the section."""
    angles = bent.angle_rad + np.array([-0.002, 0.0, 0.002])
    states = [pdc.held_bend(PRESSURE_MPA, angle, bent) for angle in angles]
    energy = [2.0 * pdc.potential_n_mm(state.unknowns, PRESSURE_MPA) for state in states]
    work = (energy[2] - energy[0]) / (angles[2] - angles[0])
    assert states[1].moment_n_mm == pytest.approx(work, abs=2e-3 * abs(states[0].moment_n_mm))


def test_the_gas_does_the_work_that_its_volume_says(pdc, bent):
    """d Pi*/dp = -V: with the law M(p, kappa) comes the chambers' volume V(p, kappa)."""
    pressures = PRESSURE_MPA + np.array([-1e-4, 0.0, 1e-4])
    states = [pdc.free_bend(pressure, bent) for pressure in pressures]
    energy = [2.0 * pdc.potential_n_mm(state.unknowns, state.pressure_gauge_mpa) for state in states]
    slope = (energy[2] - energy[0]) / (pressures[2] - pressures[0])
    assert -slope == pytest.approx(states[1].gas_volume_mm3, rel=1e-5)


def test_both_sparse_solvers_find_the_same_bend(bent):
    pytest.importorskip("pypardiso")
    for name in ("superlu", "pardiso"):
        cell = UnitCell(CellGeometry(), "pdc", SMALL, solve=linear_solver(name))
        assert cell.free_bend(PRESSURE_MPA).angle_rad == pytest.approx(bent.angle_rad, rel=1e-9)


def test_a_pressure_out_of_reach_is_an_error_that_says_how_far_it_went():
    cell = UnitCell(CellGeometry(), "pdc", SMALL, control=StepControl(smallest_step=0.05))
    with pytest.raises(LoadStepError, match="stopped at .* kPa") as caught:
        cell.free_bend(0.4)
    assert 1e3 * PRESSURE_MPA < caught.value.reached < 400.0


def test_the_law_is_zero_at_the_free_bend_and_reaches_the_moments_asked_for(pdc, bent):
    law = BendingLaw(pdc, [bent])
    law.cover(-2.0, 2.0, math.radians(15.0))
    assert law.moment_n_mm[0] <= -2.0 and law.moment_n_mm[-1] >= 2.0
    bend, stretch = law.bend_and_stretch_of_moment()(0.0)
    assert bend == pytest.approx(bent.angle_rad * pdc.angle_per_muscle, rel=1e-6)
    assert stretch == pytest.approx(bent.axis_stretch, rel=1e-6)


def test_a_law_is_of_one_pressure(pdc, bent):
    with pytest.raises(ValueError, match="one pressure"):
        BendingLaw(pdc, [bent, pdc.rest()])


def test_a_curve_to_100_kpa_on_the_fast_mesh_is_quick_and_is_that_of_another_program():
    """Free bends of an earlier rebuild in the same reading, with a mesh that is not on record."""
    began_s = time.process_time()
    other_deg = {20.0: 9.05, 40.0: 23.08, 60.0: 46.26, 80.0: 92.88, 90.0: 121.75, 100.0: 143.67}
    cell = UnitCell(CellGeometry(c_mm=FAST_WALL_MM), "pdc", FAST)
    state, bend_deg = cell.rest(), []
    for pressure_kpa in other_deg:
        state = cell.free_bend(1e-3 * pressure_kpa, state)
        bend_deg.append(math.degrees(state.angle_rad) * cell.angle_per_muscle)
    assert bend_deg == pytest.approx(list(other_deg.values()), rel=0.015)
    assert time.process_time() - began_s < 30.0


def full_section(shares):
    quick = StepControl(first_step=0.5, largest_step=0.5)
    return UnitCell(CellGeometry(), "full", SMALL, control=quick, shares=shares)


@pytest.fixture(scope="module")
def lopsided():
    return full_section({1: 1.0, 2: 0.5, 4: 0.2})


class TestFullSection:
    """The section without a mirror plane: two angles, four chambers of any pressures."""

    @staticmethod
    def bend(cell):
        """Free bend [rad] in the section's own axes."""
        free = cell.free_bend(PRESSURE_MPA)
        return turned(bend_vector_rad(free), -cell.section_turn_rad(free.unknowns))

    def test_forces_and_tangent_are_slopes_of_the_potential(self, lopsided):
        unknowns, direction = disturbed(lopsided)
        unknowns[-3:] = 0.03, -0.02, 0.1
        step = 1e-6
        ahead, behind = (unknowns + sign * step * direction for sign in (1.0, -1.0))
        slope = (lopsided.potential_n_mm(ahead, PRESSURE_MPA) - lopsided.potential_n_mm(behind, PRESSURE_MPA)) / (
            2 * step
        )
        assert slope == pytest.approx(lopsided.forces(unknowns, PRESSURE_MPA) @ direction, rel=1e-6)
        slope = (lopsided.forces(ahead, PRESSURE_MPA) - lopsided.forces(behind, PRESSURE_MPA)) / (2 * step)
        tangent = lopsided.tangent(unknowns, PRESSURE_MPA)
        assert np.abs(tangent @ direction - slope).max() < 1e-8 * np.abs(slope).max()
        assert abs(tangent - tangent.T).max() < 1e-14 * abs(tangent).max()

    def test_with_a_patterns_pressures_it_is_the_half_section(self, pdc, bent):
        whole = full_section({1: 1.0, 2: 1.0})  # bends toward -y
        assert self.bend(whole) == pytest.approx([0.0, -bent.angle_rad], rel=1e-6, abs=1e-9)
        straight = whole.held_bend(PRESSURE_MPA, 0.0)
        moment = turned([straight.moment_n_mm, straight.side_moment_n_mm], -whole.section_turn_rad(straight.unknowns))
        assert moment == pytest.approx([0.0, pdc.held_bend(PRESSURE_MPA, 0.0).moment_n_mm], rel=1e-6, abs=1e-6)

    def test_a_quarter_turn_of_the_pressures_turns_the_bend(self, lopsided):
        other = full_section({2: 1.0, 3: 0.5, 1: 0.2})
        assert self.bend(other) == pytest.approx(turned(self.bend(lopsided), 0.5 * math.pi), rel=1e-5, abs=1e-9)

    def test_equal_pressures_in_all_chambers_lengthen_and_do_not_bend(self):
        state = full_section(dict.fromkeys((1, 2, 3, 4), 1.0)).free_bend(PRESSURE_MPA)
        assert (state.angle_rad, state.side_angle_rad) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert state.axis_stretch > 1.01


def turned(vector, angle_rad):
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine], [sine, cosine]]) @ vector


def test_the_opposite_chamber_of_a_half_section_takes_bend_away(bent):
    one, both = (
        UnitCell(CellGeometry(), "psc", SMALL, shares=shares).free_bend(PRESSURE_MPA).angle_rad
        for shares in ({1: 1.0}, {1: 1.0, 3: 0.5})
    )
    balanced = UnitCell(CellGeometry(), "psc", SMALL, shares={1: 1.0, 3: 1.0}).free_bend(PRESSURE_MPA).angle_rad
    assert 0.3 * one < both < 0.9 * one
    assert balanced == pytest.approx(0.0, abs=1e-9)


def test_a_pressure_for_a_chamber_that_is_not_meshed_is_refused():
    with pytest.raises(ValueError, match=r"'pdc' holds chambers \[1, 2\], not \[4\]"):
        UnitCell(CellGeometry(), "pdc", SMALL, shares={1: 1.0, 4: 1.0})


def test_with_contact_thin_arms_rest_on_the_wall_they_pass_through_without():
    geometry, mesh = CellGeometry(a_mm=1.8, b_mm=1.0), Resolution(wave=2, wall=1, arm=2, spoke=3, sector=3)
    free, kept = (UnitCell(geometry, "pdc", mesh, self_contact=contact) for contact in (False, True))
    through, resting = free.free_bend(0.08), kept.free_bend(0.08)
    assert free.clearance(through).arm_gap_mm < -0.2
    assert -0.03 < kept.clearance(resting).arm_gap_mm < 0.01
    assert kept.clearance(resting).fold_opening > 0.5
    assert np.abs(kept.forces(resting.unknowns, 0.08)).max() < 1e-7
    early = free.free_bend(0.03)  # before the touch contact changes nothing
    assert kept.free_bend(0.03).angle_rad == pytest.approx(early.angle_rad, rel=1e-9)


def test_the_tangent_with_contact_is_the_slope_of_the_forces():
    geometry, mesh = CellGeometry(a_mm=1.8, b_mm=1.0), Resolution(wave=2, wall=1, arm=2, spoke=3, sector=3)
    cell = UnitCell(geometry, "pdc", mesh, self_contact=True)
    unknowns = UnitCell(geometry, "pdc", mesh).free_bend(0.07).unknowns  # some nodes a little behind the wall
    direction, step = np.random.default_rng(8).standard_normal(cell.unknown_count), 1e-7
    ahead, behind = (cell.forces(unknowns + sign * step * direction, 0.07) for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2 * step)
    assert abs(cell.tangent(unknowns, 0.07) @ direction - slope).max() < 1e-6 * np.abs(slope).max()
    assert np.abs(slope - UnitCell(geometry, "pdc", mesh).tangent(unknowns, 0.07) @ direction).max() > 0.1
