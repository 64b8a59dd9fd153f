import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.mesh import CellGeometry, Resolution
from mbpam_ros.study.fe.muscle_loads import NOTHING, UPRIGHT, MuscleLoads
from mbpam_ros.study.fe.muscle_mesh import EndPieces
from mbpam_ros.study.fe.plate_contact import Plate
from mbpam_ros.study.fe.solve import LoadStepError, StepControl
from mbpam_ros.study.fe.unit_cell import UnitCell
from mbpam_ros.study.fe.whole_muscle import WholeMuscle

SMALL = Resolution(wave=4, wall=1, arm=2, spoke=2, sector=2)
QUADRATIC = Resolution(wave=2, wall=1, arm=2, spoke=2, sector=2, quadratic=True)
BOTH_ELEMENTS = pytest.mark.parametrize("resolution", [SMALL, QUADRATIC], ids=["trilinear", "quadratic"])
BOTH_PATTERNS = pytest.mark.parametrize("pattern", ["pdc", "psc"])
HOLLOW = EndPieces(4.0, 2.0)
PRESSURE_MPA = 0.02
FEW_STEPS = StepControl(residual_n=1e-5, most_iterations=10, first_step=0.5, largest_step=0.5, most_revisions=20)


def geometry(waves):
    return CellGeometry(wave_count=float(waves), active_length_mm=waves * CellGeometry().wave_length_mm)


def muscle(pattern="pdc", resolution=SMALL, waves=1, **more):
    more = {"ends": HOLLOW, "control": FEW_STEPS, **more}
    return WholeMuscle(geometry(waves), pattern, resolution, **more)


def weight_n(model):
    return 9.80665 * model.mass_kg


def inflate(model, pressure_mpa=PRESSURE_MPA, gravity=UPRIGHT):
    """Stand the muscle upright, then inflate it."""
    return model.moved(model.standing(gravity), model.inflated_loads(pressure_mpa, gravity))


def disturbed(model, seed=4):
    """Positions of a muscle that is bent and crumpled at random, its base and symmetry plane included."""
    rng = np.random.default_rng(seed)
    x = model.mesh.points_mm + 0.02 * rng.standard_normal(model.mesh.points_mm.shape)
    x[:, 0] -= 0.002 * x[:, 2] ** 2
    return x, rng.standard_normal(x.shape)


pytestmark = pytest.mark.xdist_group("whole_muscle")  # its muscles are solved once


@pytest.fixture(scope="module")
def heavy():
    return muscle(waves=2, ends=EndPieces(5.0, 5.0, density_factor=4.0))


@pytest.fixture(scope="module")
def inflated(heavy):
    return inflate(heavy)


@pytest.fixture(scope="module")
def blocked_model():
    return muscle(waves=2, plate=Plate(friction=0.6))


@pytest.fixture(scope="module")
def blocked(blocked_model):
    return inflate(blocked_model)


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_the_forces_are_the_slope_of_the_potential(pattern, resolution):
    model = muscle(pattern, resolution)
    x, direction = disturbed(model)
    x[model.mesh.points_mm[:, 1] == 0.0, 1] = direction[model.mesh.points_mm[:, 1] == 0.0, 1] = 0.0
    gravity = (100.0, 0.0, -300.0)  # thirty times its weight, so that it can be seen
    loads = replace(model.inflated_loads(PRESSURE_MPA, gravity), tip_force_n=(0.3, 0.0, 0.2))
    ahead, behind = (model.potential_n_mm(x + sign * 1e-6 * direction, loads) for sign in (1.0, -1.0))
    assert (ahead - behind) / 2e-6 == pytest.approx(float(np.sum(model.forces_n(x, loads) * direction)), rel=1e-6)


@BOTH_ELEMENTS
@BOTH_PATTERNS
def test_the_tangent_is_the_slope_of_the_forces_and_symmetric_to_rounding(pattern, resolution):
    model = muscle(pattern, resolution)
    x, direction = disturbed(model)
    loads = model.inflated_loads(PRESSURE_MPA)
    tangent = model.tangent(x, loads)
    ahead, behind = (model.forces_n(x + sign * 1e-6 * direction, loads).ravel() for sign in (1.0, -1.0))
    slope = (ahead - behind) / 2e-6
    assert np.abs(tangent @ direction.ravel() - slope).max() < 1e-8 * np.abs(slope).max()
    assert abs(tangent - tangent.T).max() < 1e-14 * abs(tangent).max()


@BOTH_PATTERNS
def test_gas_and_silicone_do_no_work_when_the_muscle_is_moved_and_turned_as_a_whole(pattern):
    model = muscle(pattern)
    x = disturbed(model)[0]
    x[model.mesh.points_mm[:, 1] == 0.0, 1] = 0.0  # the half chamber's fourth wall is the symmetry plane
    force = model.forces_n(x, model.inflated_loads(PRESSURE_MPA, NOTHING))
    along_the_plane, size = force[:, [0, 2]].sum(axis=0), np.abs(force).sum()
    turning = np.sum(force[:, 0] * x[:, 2] - force[:, 2] * x[:, 0])
    assert np.abs(along_the_plane).max() < 1e-12 * size
    assert abs(turning) < 1e-11 * size


@BOTH_PATTERNS
def test_without_pressure_the_muscle_is_straight_and_stands_on_its_weight(pattern):
    model = muscle(pattern)
    assert np.abs(model.forces_n(model.mesh.points_mm, MuscleLoads())).max() < 1e-12
    upright = model.standing()
    assert upright.tip_angle_rad == pytest.approx(0.0, abs=1e-6)
    assert upright.positions_mm[:, 2].max() < model.mesh.length_mm
    assert model.base_reaction_n(upright) == pytest.approx([0.0, 0.0, weight_n(model)], abs=1e-4)


def test_the_weight_is_that_of_the_silicone_and_of_the_ends_density(heavy):
    plain = muscle(waves=2, ends=EndPieces(5.0, 5.0))
    ends_n = 1070.0 * 9.80665 * math.pi * 0.01**2 * 0.01
    assert weight_n(heavy) - weight_n(plain) == pytest.approx(3.0 * ends_n, rel=0.03)  # the mesh is a prism


def test_pressure_bends_the_muscle_away_and_the_clamp_still_carries_its_weight(heavy, inflated):
    assert inflated.tip_angle_rad > math.radians(1.0)
    assert inflated.positions_mm[heavy.mesh.tip_skin, 0].mean() < 0.0
    assert inflated.gas_volume_mm3 > inflate(heavy, 0.5 * PRESSURE_MPA).gas_volume_mm3 > 0.0
    assert heavy.base_reaction_n(inflated) == pytest.approx([0.0, 0.0, weight_n(heavy)], abs=1e-3)


def test_weight_first_and_pressure_first_lead_to_the_same_muscle(heavy, inflated):
    weightless = heavy.moved(heavy.rest(), heavy.inflated_loads(PRESSURE_MPA, NOTHING))
    assert weightless.tip_angle_rad != pytest.approx(inflated.tip_angle_rad, rel=1e-3)
    other = heavy.moved(weightless, inflated.loads)
    assert other.tip_angle_rad == pytest.approx(inflated.tip_angle_rad, rel=1e-5)


@BOTH_PATTERNS
def test_every_further_wave_bends_as_two_unit_cells_do(pattern):
    """The ends' effect is the same for muscles of two and of three waves, and cancels."""
    bends = [inflate(muscle(pattern, waves=waves), gravity=NOTHING).tip_angle_rad for waves in (2, 3)]
    cell = UnitCell(geometry(2), pattern, SMALL).free_bend(PRESSURE_MPA)
    assert bends[1] - bends[0] == pytest.approx(2.0 * cell.angle_rad, rel=5e-3)


def test_plate_clamp_and_weight_balance(blocked_model, blocked):
    assert -blocked.plate_force_n[0] > 0.01
    base = blocked_model.base_reaction_n(blocked)
    assert base - blocked.plate_force_n == pytest.approx([0.0, 0.0, weight_n(blocked_model)], abs=1e-3)


def test_the_tip_stays_outside_the_plate_and_drags_no_more_than_friction_allows(blocked_model, blocked):
    skin = blocked.positions_mm[blocked_model.mesh.tip_skin]
    assert skin[:, 0].min() > -10.0 - 0.02
    normal, drag = -blocked.plate_force_n[0], abs(blocked.plate_force_n[2])
    assert 0.0 < drag <= 0.6 * normal * (1.0 + 1e-3)


def test_the_plate_holds_the_bend_back(blocked_model, blocked):
    free = inflate(muscle(waves=2))
    assert 0.0 < blocked.tip_angle_rad < 0.7 * free.tip_angle_rad


def test_a_stiffer_plate_changes_nothing(blocked):
    stiffer = inflate(muscle(waves=2, plate=Plate(friction=0.6, stiffness_n_mm=500.0, slip_stiffness_n_mm=20.0)))
    assert stiffer.plate_force_n[0] == pytest.approx(blocked.plate_force_n[0], rel=0.01)


def test_a_pressure_out_of_reach_is_an_error_that_says_how_far_it_went():
    model = muscle(control=StepControl(smallest_step=0.05, most_iterations=2))
    with pytest.raises(LoadStepError, match=r"the muscle stopped at \(.*\) kPa, .* gravity \(0, 0, -9.81\) m/s2"):
        inflate(model, 1.0)
