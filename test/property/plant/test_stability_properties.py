"""At the extremes of step, mass, stiffness, damping, pressure and design, a plant ends finite or in a typed error."""

import dataclasses

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.design import MuscleDesign
from mbpam_ros.configuration import ConfigError, load_config, load_yaml
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, PlantConfig, PlantDivergedError, RigidBody, TierSetup
from mbpam_ros.plant.tiers.registry import build_tier
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.pneumatics.registry import build_pneumatics

GRIPPER = load_gripper()
CONFIG = load_config(PlantConfig, "plant.yaml")
PNEUMATICS = load_pneumatics()
STAND = np.array([[0.130, 0.01, 0.01], [0.315, np.inf, np.inf]])
SIZES = {"sphere": (0.06,) * 3, "cylinder": (0.02, 0.02, 0.25), "box": (0.035, 0.12, 0.06)}


def over_decades(low, high):
    """Numbers from 10^low to 10^high, each decade as likely."""
    return st.floats(low, high).map(lambda power: 10.0**power)


stiffnesses = over_decades(1.0, 8.0)
steps = over_decades(-5.0, 0.0)
corners = st.sampled_from([(1.5, 1.0), (3.5, 1.0), (1.5, 3.0), (3.5, 3.0), (2.5, 2.0)])
chambers = arrays(float, (4, 4), elements=st.floats(-80e3, 220e3)) | st.just(np.zeros((4, 4)))
bodies = st.builds(
    lambda shape, mass_kg, aside, spin: RigidBody(
        shape,
        SIZES[shape],
        mass_kg,
        np.array([*aside, 0.085]),
        np.array([0.0, 0.0, 0.0, 1.0]),
        angular_velocity_rad_s=spin,
    ),
    st.sampled_from(sorted(SIZES)),
    over_decades(-3.0, 1.0),
    st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
    st.tuples(*(st.floats(-10.0, 10.0) for _ in range(3))),
)


directions = st.sampled_from([(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)])


@st.composite
def setups(draw):
    """Name of a tier and its setup, the object in place or none."""
    name = draw(st.sampled_from(["static", "arc", "rod"]))
    finger_object, finger_finger, object_support = (
        dataclasses.replace(kind, stiffness_n_m=draw(stiffnesses))
        for kind in (CONFIG.finger_object, CONFIG.finger_finger, CONFIG.object_support)
    )
    config = dataclasses.replace(
        CONFIG,
        retardation_time_s=draw(st.sampled_from([0.0, 1e-4, 0.02])),
        finger_object=finger_object,
        finger_finger=finger_finger,
        object_support=object_support,
    )
    mass = draw(st.sampled_from([0.01, 1.0])) * GRIPPER.geometry.mass_per_length_kg_m
    body = None if name == "static" else draw(st.none() | bodies)
    setup = TierSetup(
        geometry=dataclasses.replace(GRIPPER.geometry, mass_per_length_kg_m=mass),
        finger_base_m=GRIPPER.finger_base_m,
        gravity_m_s2=9.81,
        body=body,
        planes_m=np.empty((0, 3)) if body is None else STAND,
        config=config,
        fingers_touch=True,
        gravity_direction=(0.0, 0.0, 1.0) if name == "static" else draw(directions),
    )
    if name != "rod":
        return setup, Fidelity(name, 1, draw(steps))
    modes, twist, stretch = draw(st.integers(1, 6)), draw(st.integers(0, 4)), draw(st.integers(0, 4))
    return setup, Fidelity(name, modes, draw(steps), twist_modes=twist, stretch_modes=stretch)


def assert_finite(value):
    if dataclasses.is_dataclass(value):
        for part in vars(value).values():
            assert_finite(part)
    elif isinstance(value, tuple):
        for part in value:
            assert_finite(part)
    else:
        assert value is None or np.isfinite(value).all()


@settings(max_examples=100)
@given(setups(), corners, chambers, chambers, st.lists(st.integers(1, 12), min_size=1, max_size=3), st.booleans())
def test_any_step_ends_finite_or_in_an_error_that_says_what_to_change(setup, design, start, end, counts, raised):
    """Pressures from one set to another within the first step, at times a hand that is raised by 0.1 m meanwhile."""
    setup, fidelity = setup
    law = calibrated_rod_law(MuscleDesign(*design), GRIPPER.geometry)
    before, after = (Actuation(*law.moment_and_stiffness(each), law.strain_law(each)) for each in (start, end))
    tier = build_tier(setup, fidelity)
    tier.reset(before)
    try:
        for count in counts:
            heights = np.linspace(0.0, 0.1 * raised, count + 1)
            rates = np.full(count + 1, 0.1 * raised / (count * fidelity.sub_step_s))
            last = tier.state()
            tier.step(after, heights, rates)
    except PlantDivergedError as error:
        assert "use a smaller sub_step_s" in str(error).lower()
        np.testing.assert_array_equal(tier.state().centreline_m, last.centreline_m)  # as before the step
    assert_finite(tier.state())


@settings(max_examples=20)
@given(st.sampled_from(["arc", "rod"]), over_decades(-3.0, -2.0), stiffnesses, over_decades(-3.0, 1.0))
def test_a_body_of_any_mass_rests_on_anything_with_its_weight(name, step_s, stiffness_n_m, mass_kg):
    """Where the support gives way by less than the plate is thick."""
    support = dataclasses.replace(CONFIG.object_support, stiffness_n_m=max(stiffness_n_m, 2e3 * mass_kg))
    body = RigidBody("sphere", SIZES["sphere"], mass_kg, np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 0.0, 1.0]))
    config = dataclasses.replace(CONFIG, object_support=support)
    setup = TierSetup(GRIPPER.geometry, GRIPPER.finger_base_m, 9.81, body, STAND, config)
    tier = build_tier(setup, Fidelity(name, 3 if name == "rod" else 1, step_s))
    still = np.zeros(round(1.0 / step_s) + 1)
    air = Actuation(np.zeros((4, 2)), np.full(4, 1.5e-3))
    tier.reset(air)
    tier.step(air, still, still)
    lasting = np.mean([push_after(tier, air, 1) for _ in range(round(0.2 / step_s))])
    assert lasting == pytest.approx(mass_kg * 9.81, rel=0.02)


def push_after(tier, air, count):
    tier.step(air, np.zeros(count + 1), np.zeros(count + 1))
    return -tier.state().support_force_n[2]


def test_pressures_that_wind_a_muscle_up_are_named_as_what_to_lower():
    setup = TierSetup(GRIPPER.geometry, GRIPPER.finger_base_m, 9.81, None, np.empty((0, 3)), CONFIG)
    air = Actuation(np.full((4, 2), 0.2), np.full(4, 1.5e-3))
    tier = build_tier(setup, Fidelity("rod", 2, 1e-3))
    tier.reset(air)
    with pytest.raises(
        PlantDivergedError, match="beyond 458 deg. The air alone bends one by 1080 deg: lower its pressure"
    ):
        tier.step(air, np.zeros(1001), np.zeros(1001))


@settings(max_examples=60)
@given(
    over_decades(-8.0, -3.0),
    st.sampled_from([0.0, 1e-10, 5e-9]),
    arrays(float, 16, elements=st.floats(0.0, 200e3)),
    st.lists(st.tuples(arrays(float, 16, elements=st.floats(-1.0, 1.0)), steps), min_size=1, max_size=5),
)
def test_a_tank_that_runs_empty_or_is_filled_from_the_chambers_stays_a_pressure(tank_m3, regulator, start, course):
    """Tanks from 10 mm3 to a litre, not refilled or slowly: fuller chambers flow back into them."""
    orifices = dataclasses.replace(
        PNEUMATICS.chamber.iso6358, supply_volume_m3=tank_m3, regulator_conductance_m3_s_pa=regulator
    )
    model = build_pneumatics("iso6358", dataclasses.replace(PNEUMATICS.chamber, iso6358=orifices))
    model.reset(start)
    for spool, dt_s in course:
        pressure = model.step(spool, dt_s)
        assert np.isfinite(pressure).all() and (pressure > -101325.0).all()
        assert np.isfinite(model.supply_gauge_pa) and model.supply_gauge_pa > -101325.0


@pytest.mark.parametrize("supply_gauge_pa", [0.0, -50e3, float("nan"), float("inf")])
def test_a_supply_that_is_empty_or_sucks_is_refused_by_name(supply_gauge_pa, tmp_path):
    content = load_yaml("pneumatics.yaml")
    content["chamber"]["supply_gauge_pa"] = supply_gauge_pa
    file = tmp_path / "pneumatics.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match="supply_gauge_pa"):
        load_config(PneumaticsConfig, file)
