"""Muscles of the tier ``rod`` that stretch and twist, under gravity from any side, against closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from mbpam_ros.actuator.rod_law import StrainLaw
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.mechanics.lanes import WIDTH
from mbpam_ros.plant.mechanics.rod import build_rod, masses_and_loads, motion_at_rest, move_rods, room_for_loads
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, TierError, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier

GRIPPER = load_gripper()
GEOMETRY = GRIPPER.geometry
LENGTH, END, DENSITY = GEOMETRY.active_length_m, GEOMETRY.end_length_m, GEOMETRY.mass_per_length_kg_m
CONFIG = load_config(PlantConfig, "plant.yaml")
UNDAMPED = dataclasses.replace(CONFIG, retardation_time_s=0.0)
MOMENTS = np.array([[0.04, 0.0], [0.0, -0.02], [0.01, 0.03], [0.0, 0.0]])
BENDING, AXIAL, TORSION = 1.5e-3, 25.0, 0.8e-3  # N m2, N, N m2
DOWN, LEVEL, UP = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)
STRAINS = [(0, 2), (2, 0), (2, 2), (1, 3)]


def law(free=0.0, slope=(0.0, 0.0), axial=AXIAL, torsion=TORSION):
    return StrainLaw(
        np.full(4, free),
        np.broadcast_to(np.asarray(slope, float), (4, 2)).copy(),
        np.full(4, axial),
        np.full(4, torsion),
    )


def actuation(moment=(0.0, 0.0), strain=None, stiffness=BENDING):
    moments = np.broadcast_to(np.asarray(moment, dtype=float), (4, 2)).copy()
    return Actuation(moments, np.full(4, stiffness), law() if strain is None else strain)


def tier(twist, stretch, modes=3, step_s=2e-3, gravity=9.81, direction=DOWN, config=CONFIG, acts=None):
    setup = TierSetup(GEOMETRY, GRIPPER.finger_base_m, gravity, None, np.empty((0, 3)), config, False, direction)
    built = build_tier(setup, Fidelity("rod", modes, step_s, twist_modes=twist, stretch_modes=stretch))
    built.reset(actuation() if acts is None else acts)
    return built


def rested(acts, **how):
    rod = tier(acts=acts, step_s=5e-3, **how)
    rod.step(acts, np.zeros(801), np.zeros(801))
    return rod


def tips(rod):
    return rod.state().centreline_m[:, -1] - GRIPPER.finger_base_m


def test_a_free_muscle_rests_in_the_circle_and_the_stretch_of_the_air():
    free, slope = 0.08, np.array([0.002, -0.001])
    rod = rested(actuation(MOMENTS, law(free, slope)), twist=2, stretch=2, gravity=0.0)
    curvature = MOMENTS / BENDING
    np.testing.assert_allclose(rod.state().bend_rad, LENGTH * curvature, atol=1e-6)
    stretch = 1.0 + free + curvature @ slope
    angle = LENGTH * np.linalg.norm(curvature, axis=1)
    across, down = (
        LENGTH * stretch * (1.0 - np.cos(angle)) / np.where(angle > 0.0, angle, 1.0),
        LENGTH * stretch * np.sinc(angle / np.pi),
    )
    expected = np.stack([across + END * np.sin(angle), END + down + END * np.cos(angle)], axis=1)
    found = tips(rod)
    np.testing.assert_allclose(np.hypot(found[:, 0], found[:, 1]), expected[:, 0], atol=1e-5)
    np.testing.assert_allclose(found[:, 2], expected[:, 1], atol=1e-5)


@pytest.mark.parametrize(("direction", "sign"), [(DOWN, 1.0), (UP, -1.0)])
def test_its_weight_lengthens_a_muscle_that_hangs_and_shortens_one_that_stands(direction, sign):
    # Stiff in bending, so that it does not buckle; N(s) is the weight beyond s.
    rod = rested(actuation(stiffness=1.0), twist=0, stretch=2, direction=direction)
    weight = 9.81 * DENSITY
    longer = weight * (0.5 * LENGTH**2 + END * LENGTH) / AXIAL
    np.testing.assert_allclose(tips(rod)[:, 2], GEOMETRY.length_m + sign * longer, atol=1e-9)


def test_a_stiff_level_muscle_sags_like_a_cantilever():
    stiffness = 1.0
    rod = rested(actuation(stiffness=stiffness), twist=2, stretch=2, modes=4, direction=LEVEL)
    weight = 9.81 * DENSITY
    # The active part under its own weight, and under the force and moment of the rigid end.
    force, moment = weight * END, 0.5 * weight * END**2
    slope = (weight * LENGTH**3 / 6.0 + force * LENGTH**2 / 2.0 + moment * LENGTH) / stiffness
    sag = (weight * LENGTH**4 / 8.0 + force * LENGTH**3 / 3.0 + moment * LENGTH**2 / 2.0) / stiffness + slope * END
    np.testing.assert_allclose(tips(rod)[:, 0], sag, rtol=1e-4)
    np.testing.assert_allclose(tips(rod)[:, 1], 0.0, atol=1e-12)


def test_gravity_from_the_side_twists_a_bent_muscle_and_the_mirrored_one_the_other_way():
    moments, aside = 0.03 * np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]]), (0.0, 1.0, 0.0)
    softer, stiffer = (
        tips(rested(actuation(moments, law(torsion=value)), twist=2, stretch=0, direction=aside))
        for value in (TORSION, 1e6 * TORSION)
    )
    rigid = tips(rested(actuation(moments), twist=0, stretch=0, direction=aside))
    assert (softer[:, 1] > 1.1 * stiffer[:, 1]).all()
    np.testing.assert_allclose(stiffer, rigid, atol=1e-6)
    np.testing.assert_allclose(softer[1], softer[0] * (-1.0, 1.0, 1.0), atol=1e-9)


@pytest.mark.parametrize(("twist", "stretch"), STRAINS)
def test_a_quarter_turn_of_everything_turns_the_answer(twist, stretch):
    def turn(vectors):
        vectors = np.array(vectors, dtype=float)
        vectors[..., 0], vectors[..., 1] = -vectors[..., 1].copy(), vectors[..., 0].copy()
        return vectors

    slope, direction = np.array([0.003, 0.001]), np.array([0.6, 0.0, 0.8])
    one = rested(actuation(MOMENTS, law(0.05, slope)), twist=twist, stretch=stretch, direction=tuple(direction))
    turned = rested(
        actuation(turn(MOMENTS), law(0.05, turn(slope))), twist=twist, stretch=stretch, direction=tuple(turn(direction))
    )
    np.testing.assert_allclose(tips(turned), turn(tips(one)), atol=1e-9)


def frequencies(modes, twist, stretch):
    """Angular frequencies of small motion of the straight muscle in space, rising."""
    rod = build_rod(GEOMETRY, modes, max(4, modes + 2), 2, twist, stretch)
    size = 2 * modes + twist + stretch
    motion, mass, load = motion_at_rest(rod), np.empty((size, size, WIDTH)), np.empty((size, WIDTH))
    move_rods(np.zeros((size, WIDTH)), np.zeros((size, WIDTH)), rod, motion)
    masses_and_loads(rod, motion, (0.0, 0.0, 0.0), room_for_loads(rod), mass, load)
    springs = np.concatenate(
        [BENDING * np.repeat(rod.springs[:modes], 2), TORSION * rod.springs[:twist], AXIAL * rod.stretch_springs]
    )
    return np.sqrt(eigh(np.diag(springs), mass[..., 0], eigvals_only=True))


def bar_frequency(stiffness, inertia_per_length):
    """The lowest of a bar that twists or stretches, clamped, with the rigid end at its tip: cot(b L) = b l."""
    number = brentq(lambda b: math.cos(b * LENGTH) - b * END * math.sin(b * LENGTH), 1e-6, 0.5 * math.pi / LENGTH)
    return number * math.sqrt(stiffness / inertia_per_length)


@pytest.mark.parametrize(("modes", "error"), [(2, 2.4e-3), (3, 2.2e-5)])
def test_the_lowest_frequencies_of_twist_and_stretch_are_those_of_a_bar(modes, error):
    # Ritz: nothing in so many modes is nearer than 0.232 and 0.00214 %.
    spin = 0.5 * DENSITY * GEOMETRY.outer_radius_m**2
    for stiffness, inertia, how in ((TORSION, spin, (modes, 0)), (AXIAL, DENSITY, (0, modes))):
        expected = bar_frequency(stiffness, inertia)
        found = frequencies(1, *how)
        assert np.abs(found / expected - 1.0).min() < error


def energy_j(rod):
    """Kinetic, elastic and gravity's energy of the four muscles of a tier under an actuation that stays."""
    parts = rod._parts
    shape, speed = (part[: rod._coordinates].reshape(4, -1) for part in parts.state[:2])
    system, drive, mechanics = parts.system, parts.drive, parts.system.rod
    motion, size = motion_at_rest(mechanics), shape.shape[1]
    mass, load = np.empty((size, size, WIDTH)), np.empty((size, WIDTH))
    move_rods(np.ascontiguousarray(shape.T), np.ascontiguousarray(speed.T), mechanics, motion)
    masses_and_loads(mechanics, motion, tuple(system.gravity), room_for_loads(mechanics), mass, load)
    total = 0.5 * np.einsum("fi,ijf,fj->", speed, mass, speed)
    total -= np.einsum("k,kif,i->", mechanics.levers, motion.tangent[1:], system.gravity)
    bend, twist, stretch = rod.by_strain(shape)
    modes = bend.shape[1] // 2
    q = bend.reshape(4, modes, 2)
    total += 0.5 * np.einsum("f,i,fij->", drive.stiffnesses[1], mechanics.springs[:modes], q**2)
    total -= np.einsum("fj,fj->", drive.moments[1], q[:, 0])
    total += 0.5 * np.einsum("f,i,fi->", drive.torsions[1], mechanics.springs[: twist.shape[1]], twist**2)
    common = min(modes, stretch.shape[1])
    off = stretch.copy()
    off[:, :1] -= drive.free_stretches[1][:, None]
    off[:, :common] -= np.einsum("fij,fj->fi", q[:, :common], drive.couplings[1]) / LENGTH
    return total + 0.5 * np.einsum("f,i,fi->", drive.axials[1], mechanics.stretch_springs, off**2)


@pytest.mark.slow
@pytest.mark.parametrize(("twist", "stretch"), STRAINS)
def test_undamped_muscles_keep_their_energy_with_the_fourth_power_of_the_step(twist, stretch):
    acts = actuation(MOMENTS, law(0.1, (0.004, 0.002)))
    swings = []
    for h in (5e-4, 2.5e-4):
        rod = tier(twist, stretch, 2, h, direction=(0.6, 0.0, 0.8), config=UNDAMPED, acts=acts)
        energies = []
        for _ in range(20):
            rod.step(acts, np.zeros(round(0.01 / h) + 1), np.zeros(round(0.01 / h) + 1))
            energies.append(energy_j(rod))
        swings.append(np.ptp(energies))
    moving = 0.02  # J, what the jump of the moments sets free
    assert swings[1] < 1e-4 * moving
    assert swings[0] / swings[1] > 8.0 or swings[0] < 1e-9


@pytest.mark.parametrize(("twist", "stretch"), STRAINS)
@pytest.mark.parametrize("step_s", [1e-3, 5e-3, 1e-2])
def test_damped_muscles_come_to_the_same_rest_at_any_step(twist, stretch, step_s):
    acts = actuation(MOMENTS, law(0.1, (0.004, 0.002)))
    steps = round(4.0 / step_s)
    rod = tier(twist, stretch, step_s=step_s, direction=(0.6, 0.0, 0.8), acts=acts)
    rod.step(acts, np.zeros(steps + 1), np.zeros(steps + 1))
    finer = rested(acts, twist=twist, stretch=stretch, direction=(0.6, 0.0, 0.8))
    np.testing.assert_allclose(tips(rod), tips(finer), atol=1e-6)


def test_motion_with_all_strains_converges_with_the_square_of_the_step():
    acts = actuation(MOMENTS, law(0.1, (0.004, 0.002)))
    ends = {}
    for h in (1.25e-4, 1e-3, 2e-3):
        rod = tier(2, 2, step_s=h, acts=actuation())
        rod.step(acts, np.zeros(round(0.1 / h) + 1), np.zeros(round(0.1 / h) + 1))
        ends[h] = tips(rod)
    fine, coarse = (np.abs(ends[h] - ends[1.25e-4]).max() for h in (1e-3, 2e-3))
    assert 3.2 < coarse / fine < 5.0
    assert fine < 1e-3 * LENGTH


def test_a_tilt_on_the_way_leads_to_the_rest_of_a_muscle_that_was_always_tilted():
    acts, tilted = actuation(MOMENTS, law(0.05)), (0.8, 0.0, 0.6)
    rod = tier(2, 2, acts=acts)
    rod.step(acts, np.zeros(11), np.zeros(11))
    rod.set_gravity(9.81 * np.array(tilted))
    rod.step(acts, np.zeros(2001), np.zeros(2001))
    np.testing.assert_allclose(tips(rod), tips(rested(acts, twist=2, stretch=2, direction=tilted)), atol=1e-6)


def test_more_stretch_than_the_model_covers_is_refused_and_the_state_kept():
    rod = tier(0, 2, acts=actuation())
    with pytest.raises(PlantDivergedError, match="longer or shorter by more than 80%"):
        rod.step(actuation(strain=law(free=2.0)), np.zeros(1001), np.zeros(1001))
    np.testing.assert_allclose(tips(rod)[:, 2], GEOMETRY.length_m, atol=1e-12)


def test_muscles_that_stretch_ask_for_a_strain_law():
    with pytest.raises(TierError, match="strain law"):
        tier(0, 1, acts=Actuation(np.zeros((4, 2)), np.ones(4)))


@pytest.mark.parametrize("name", ["static", "arc"])
def test_only_the_rod_stretches_and_twists(name):
    setup = TierSetup(GEOMETRY, GRIPPER.finger_base_m, 9.81, None, np.empty((0, 3)), CONFIG)
    with pytest.raises(TierError, match="neither twists nor stretches"):
        build_tier(setup, Fidelity(name, 1, 2e-3, stretch_modes=1))


def test_static_muscles_hang():
    setup = TierSetup(GEOMETRY, GRIPPER.finger_base_m, 9.81, None, np.empty((0, 3)), CONFIG, False, LEVEL)
    with pytest.raises(TierError, match="hanging"):
        build_tier(setup, Fidelity("static", 1, 2e-3))
