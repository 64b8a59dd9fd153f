"""All of the muscle, without a symmetry plane, under any loads."""

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_loads import MuscleLoadError, MuscleLoads, pattern_pressures_mpa
from mbpam_ros.study.fe.muscle_mesh import EndPieces
from mbpam_ros.study.fe.solve import StepControl, UpdatedMatrix
from mbpam_ros.study.fe.whole_muscle import WholeMuscle

GEOMETRY = CellGeometry(wave_count=1.0, active_length_mm=7.0)
SMALL = Resolution(wave=4, wall=1, arm=1, spoke=2, sector=2)
SMALL_QUADRATIC = Resolution(wave=2, wall=1, arm=1, spoke=2, sector=2, quadratic=True)
ENDS = EndPieces(4.0, 4.0)
FEW_STEPS = StepControl(residual_n=1e-6, first_step=0.5, largest_step=0.5)
PDC = MuscleLoads(pattern_pressures_mpa("pdc", 0.03))
LOADS = MuscleLoads(pattern_pressures_mpa("half", 0.03), (0.5, 0.3, -0.4), 20.0, (3.0, -60.0, 100.0))
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

pytestmark = pytest.mark.xdist_group("whole_muscle_loads")  # its muscles are solved once


def muscle(section="full", resolution=SMALL):
    return WholeMuscle(GEOMETRY, section, resolution, ends=ENDS, control=FEW_STEPS)


def found(model, loads):
    return model.moved(model.rest(), loads)


@pytest.fixture(scope="module")
def model():
    return muscle()


@pytest.fixture(scope="module")
def loaded(model):
    return found(model, LOADS)


def test_the_tangent_is_the_slope_of_the_forces_under_every_load_at_once(model):
    rng = np.random.default_rng(5)
    x = model.mesh.points_mm + 0.02 * rng.standard_normal(model.mesh.points_mm.shape)
    direction = rng.standard_normal(x.shape)
    tangent = model.tangent(x, LOADS)
    ahead, behind = (model.forces_n(x + sign * 1e-6 * direction, LOADS).ravel() for sign in (1.0, -1.0))
    slope = (ahead - behind) / 2e-6
    assert isinstance(tangent, UpdatedMatrix)
    change = tangent.matrix @ direction.ravel() - tangent.left @ (tangent.right.T @ direction.ravel())
    assert np.abs(change - slope).max() < 1e-8 * np.abs(slope).max()
    assert abs(tangent.matrix - tangent.matrix.T).max() < 1e-14 * abs(tangent.matrix).max()


def test_the_tangent_of_the_unknowns_is_that_of_all_nodes_cut_and_its_pattern_stays(model):
    x, patterns = model.mesh.points_mm + 0.02 * np.random.default_rng(6).standard_normal(model.mesh.points_mm.shape), []
    for loads in (LOADS, PDC, MuscleLoads()):
        full, cut = model.tangent(x, loads), model._tangent_of_free(x, loads, None)
        if loads is LOADS:
            assert np.array_equal(full.left[model._free], cut.left) and np.array_equal(
                full.right[model._free], cut.right
            )
            full, cut = full.matrix, cut.matrix
        assert abs(full[model._free][:, model._free] - cut).max() < 1e-15 * abs(full).max()
        patterns.append(cut.indices)
    assert patterns[0] is patterns[1] is patterns[2]


def test_the_clamp_carries_force_and_weight_and_their_moment_and_the_torque(model, loaded):
    weight_n = model.mass_kg * np.array(LOADS.gravity_m_s2)
    assert model.base_reaction_n(loaded) == pytest.approx(-weight_n - LOADS.tip_force_n, abs=1e-4)
    x, base = loaded.positions_mm, model.mesh.points_mm[:, 2] == 0.0
    moment = np.cross(x, model.forces_n(x, LOADS))[base].sum(axis=0)
    weights = np.cross(x, model._masses_kg[:, None] * LOADS.gravity_m_s2).sum(axis=0)
    tip = np.cross(loaded.tip.position_mm, LOADS.tip_force_n) + LOADS.tip_torque_n_mm * loaded.tip.direction
    assert moment == pytest.approx(-weights - tip, abs=1e-3)


def test_mirrored_loads_give_the_mirrored_muscle(model, loaded):
    mirrored = found(model, LOADS.mirrored)
    assert mirrored.tip.position_mm == pytest.approx(loaded.tip.position_mm * (1.0, -1.0, 1.0), abs=1e-6)
    assert mirrored.tip.direction == pytest.approx(loaded.tip.direction * (1.0, -1.0, 1.0), abs=1e-6)
    assert abs(loaded.tip.roll_rad) > math.radians(1.0)
    assert mirrored.tip.roll_rad == pytest.approx(-loaded.tip.roll_rad, abs=1e-6)
    assert mirrored.tip_angle_rad == pytest.approx(loaded.tip_angle_rad, abs=1e-6)


def test_loads_turned_by_a_quarter_give_the_muscle_turned_by_a_quarter(model, loaded):
    first, second, third, fourth = LOADS.pressures_gauge_mpa
    force, gravity = (QUARTER @ vector for vector in (LOADS.tip_force_n, LOADS.gravity_m_s2))
    turned = found(model, MuscleLoads((fourth, first, second, third), tuple(force), 20.0, tuple(gravity)))
    assert turned.tip.position_mm == pytest.approx(QUARTER @ loaded.tip.position_mm, abs=1e-6)
    assert turned.tip.direction == pytest.approx(QUARTER @ loaded.tip.direction, abs=1e-6)
    assert turned.tip.roll_rad == pytest.approx(loaded.tip.roll_rad, abs=1e-6)


def test_all_of_the_muscle_does_what_its_half_does_under_symmetric_loads(model):
    loads = replace(PDC, tip_force_n=(0.3, 0.0, -0.2), gravity_m_s2=(50.0, 0.0, -80.0))
    whole, half = found(model, loads), found(muscle("pdc"), loads)
    assert whole.tip.position_mm == pytest.approx(half.tip.position_mm, abs=1e-6)
    assert whole.tip.rotation == pytest.approx(half.tip.rotation, abs=1e-7)
    assert whole.gas_volume_mm3 == pytest.approx(half.gas_volume_mm3, rel=1e-8)
    assert muscle("pdc").base_reaction_n(half) == pytest.approx(model.base_reaction_n(whole), abs=1e-4)


def test_one_chamber_bends_away_from_its_azimuth_as_the_turned_half_does():
    even = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
    psc = MuscleLoads(pattern_pressures_mpa("psc", 0.03))
    whole, half = found(muscle("full", even), psc), found(muscle("psc", even), psc)
    x, _, z = half.tip.position_mm
    assert x < 0.0
    assert whole.tip.position_mm == pytest.approx([math.sqrt(0.5) * x, math.sqrt(0.5) * x, z], abs=1e-6)
    assert whole.tip.roll_rad == pytest.approx(0.0, abs=1e-7)


def test_the_load_does_the_work_that_the_potential_gains(model):
    """Small steps of the tip's force and of the torque; the trapezoidal rule is good to their square."""
    begin, work = found(model, PDC), 0.0
    state, force = begin, np.array([0.0, 0.4, 0.2])
    for part in (0.25, 0.5, 0.75, 1.0):
        after = model.moved(state, replace(PDC, tip_force_n=tuple(part * force), tip_torque_n_mm=part * 10.0))
        turn = after.tip.rotation @ state.tip.rotation.T
        spin = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        about = 0.5 * (state.tip.direction * state.loads.tip_torque_n_mm + after.tip.direction * part * 10.0)
        mean_n = 0.5 * (np.array(state.loads.tip_force_n) + after.loads.tip_force_n)
        work += float(mean_n @ (after.tip.position_mm - state.tip.position_mm) + about @ spin)
        state = after
    gained = model.potential_n_mm(state.positions_mm, PDC) - model.potential_n_mm(begin.positions_mm, PDC)
    assert gained == pytest.approx(work, rel=1e-3)


def test_the_way_to_a_load_does_not_matter_without_a_moment(model):
    loads = replace(LOADS, tip_torque_n_mm=0.0)
    straight = found(model, loads)
    around = model.moved(found(model, PDC), loads)
    assert around.positions_mm == pytest.approx(straight.positions_mm, abs=1e-5)


def test_half_a_muscle_refuses_loads_that_are_not_symmetric():
    half = muscle("pdc")
    for loads in (LOADS, replace(PDC, tip_torque_n_mm=1.0), MuscleLoads(pattern_pressures_mpa("psc", 0.03))):
        with pytest.raises(MuscleLoadError, match="symmetric in y = 0 only"):
            half.moved(half.rest(), loads)


@pytest.mark.parametrize(
    "wrong", [{"tip_force_n": (0.0, math.nan, 0.0)}, {"gravity_m_s2": (1.0, 2.0)}, {"pressures_gauge_mpa": (1.0,)}]
)
def test_loads_that_are_incomplete_or_not_finite_are_refused(wrong):
    with pytest.raises(MuscleLoadError, match="all finite"):
        MuscleLoads(**wrong)


def test_a_solid_cylinder_bends_stretches_and_twists_as_beams_do():
    """Between two sections far from the clamp: Euler and Bernoulli, Hooke, Saint-Venant."""
    # solid but for four thin channels, 0.4 % of the section
    geometry = CellGeometry(a_mm=0.0, b_mm=0.5, c_mm=9.3, wave_count=8.0, active_length_mm=80.0)
    coarse = Resolution(wave=2, wall=1, arm=1, spoke=2, sector=2, quadratic=True)
    model = WholeMuscle(geometry, "full", coarse, ends=EndPieces(10.0, 10.0), control=FEW_STEPS)
    force_n, torque_n_mm, length = np.array([0.6e-3, 0.8e-3, 1e-3]), 0.1, 100.0
    x = found(model, MuscleLoads(tip_force_n=tuple(force_n), tip_torque_n_mm=torque_n_mm)).positions_mm

    near, far = (int(np.abs(model.frames.z_mm - z).argmin()) for z in (40.0, 70.0))
    rotations, centres = model.frames.rotations(x), model.frames.centres_mm(x)
    turn = rotations[near].T @ rotations[far]
    shear, area = 2.0 * Silicone().c10_mpa, math.pi * 100.0
    young, second_moment = 3.0 * shear, area * 100.0 / 4.0
    lever = 30.0 * length - 0.5 * (70.0**2 - 40.0**2)
    assert turn[:2, 2] == pytest.approx(force_n[:2] * lever / (young * second_moment), rel=0.01)
    assert turn[1, 0] == pytest.approx(torque_n_mm * 30.0 / (2.0 * shear * second_moment), rel=0.01)
    stretch = np.linalg.norm(centres[far] - centres[near]) / 30.0 - 1.0
    assert stretch == pytest.approx(force_n[2] / (young * area), rel=0.01)
