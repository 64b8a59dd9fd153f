import dataclasses
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mbpam_ros.actuator.elastic_rod import RodLoads, RodSection, rod_at_rest
from mbpam_ros.gripper import load_gripper

GEOMETRY = load_gripper().geometry
MOMENT, SLOPE = st.floats(-0.045, 0.045), st.floats(-2e-3, 2e-3)
FORCE, GRAVITY = st.floats(-0.1, 0.1), st.floats(-10.0, 10.0)


@st.composite
def sections(draw):
    return RodSection(
        draw(MOMENT),
        draw(MOMENT),
        draw(st.floats(1.2e-3, 2.5e-3)),
        draw(st.floats(0.0, 0.25)),
        draw(SLOPE),
        draw(SLOPE),
        1.0 / draw(st.floats(10.0, 40.0)),
        1.0 / draw(st.floats(5e-4, 3e-3)),
    )


LOADS = st.builds(
    RodLoads, st.tuples(FORCE, FORCE, FORCE), st.floats(-5e-3, 5e-3), st.tuples(GRAVITY, GRAVITY, GRAVITY)
)


def turned(section, loads):
    """By a quarter turn about z."""
    return (
        section._replace(
            moment_x_n_m=-section.moment_y_n_m,
            moment_y_n_m=section.moment_x_n_m,
            slope_x_m=-section.slope_y_m,
            slope_y_m=section.slope_x_m,
        ),
        dataclasses.replace(loads, **{name: quarter(getattr(loads, name)) for name in ("tip_force_n", "gravity_m_s2")}),
    )


def mirrored(section, loads):
    """In the plane of x and z: y changes its sign, and so does a torque about an axis in that plane."""
    vectors = {
        name: (getattr(loads, name)[0], -getattr(loads, name)[1], getattr(loads, name)[2])
        for name in ("tip_force_n", "gravity_m_s2")
    }
    return (
        section._replace(moment_y_n_m=-section.moment_y_n_m, slope_y_m=-section.slope_y_m),
        dataclasses.replace(loads, tip_torque_n_m=-loads.tip_torque_n_m, **vectors),
    )


def quarter(vector):
    return (-vector[1], vector[0], *vector[2:])


def same_angle(first, second):
    return abs(math.remainder(first - second, 2.0 * math.pi)) < 1e-6


@settings(max_examples=40, deadline=None)
@given(sections(), LOADS)
def test_the_rod_turns_with_its_section_and_loads(section, loads):
    at, after = rod_at_rest(section, GEOMETRY, loads), rod_at_rest(*_of(turned, section, loads))
    np.testing.assert_allclose(after.tip_position_m, quarter(at.tip_position_m), atol=1e-9)
    np.testing.assert_allclose(after.tip_direction, quarter(at.tip_direction), atol=1e-8)
    np.testing.assert_allclose(after.bend_rad, quarter(at.bend_rad), atol=1e-8)
    if at.tip_direction[2] > -0.99:  # where it looks back at the clamp the shortest turn has no axis
        assert same_angle(after.tip_roll_rad, at.tip_roll_rad)


@settings(max_examples=40, deadline=None)
@given(sections(), LOADS)
def test_the_rod_is_mirrored_with_its_section_and_loads(section, loads):
    at, after = rod_at_rest(section, GEOMETRY, loads), rod_at_rest(*_of(mirrored, section, loads))
    np.testing.assert_allclose(after.tip_position_m, at.tip_position_m * [1.0, -1.0, 1.0], atol=1e-9)
    if at.tip_direction[2] > -0.99:
        assert same_angle(after.tip_roll_rad, -at.tip_roll_rad)


@settings(max_examples=40, deadline=None)
@given(sections(), LOADS)
def test_halving_the_steps_moves_the_tip_by_less_than_a_hundred_thousandth_of_the_length(section, loads):
    usual, fine = (rod_at_rest(section, GEOMETRY, loads, steps).tip_position_m for steps in (24, 48))
    assert np.linalg.norm(usual - fine) < 1e-5 * GEOMETRY.active_length_m


def _of(change, section, loads):
    section, loads = change(section, loads)
    return section, GEOMETRY, loads
