"""What holds for every input of the pneumatics."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import PressureController
from mbpam_ros.pneumatics.registry import build_pneumatics
from mbpam_ros.pneumatics.sensing import ChannelStatus, PressureSensing

CONFIG = load_pneumatics()
SUPPLY = CONFIG.chamber.supply_gauge_pa

exact = st.sampled_from(["ideal", "lag"])
openings = arrays(float, 16, elements=st.floats(-1.0, 1.0))
pressures = arrays(float, 16, elements=st.floats(0.0, SUPPLY))
anything = arrays(float, 16, elements=st.floats(allow_nan=True, allow_infinity=True))
plausible = arrays(float, 16, elements=st.floats(-2e4, 2e5) | st.just(np.nan))
times = st.floats(-1e3, 1e6) | st.floats(0.0, 0.3)


def run(name, start, steps):
    model = build_pneumatics(name, CONFIG.chamber)
    model.reset(start)
    for spool, dt_s in steps:
        yield model.step(spool, dt_s)
        assert (np.abs(model.spool) <= 1.0).all()


@given(exact, pressures, st.lists(st.tuples(openings, st.floats(1e-6, 1e3)), min_size=1, max_size=6))
def test_chamber_pressures_stay_between_ambient_and_supply(name, start, steps):
    for pressure in run(name, start, steps):
        assert ((pressure >= 0.0) & (pressure <= SUPPLY)).all()


@settings(deadline=None)
@given(pressures, st.lists(st.tuples(openings, st.floats(1e-6, 0.5)), min_size=1, max_size=6))
def test_chambers_with_a_volume_leave_that_range_only_as_far_as_their_neighbours_squeeze_them(start, steps):
    # A closed chamber shrinks while its neighbour vents: by the difference of its volumes in PDC and PSC, 10 %.
    for pressure in run("iso6358", start, steps):
        assert ((pressure > -10e3) & (pressure < 1.15 * SUPPLY)).all()


@given(exact, pressures, openings, openings, st.floats(1e-4, 0.5))
def test_halving_the_step_changes_nothing_at_constant_command(name, start, before, command, dt_s):
    whole, halves = build_pneumatics(name, CONFIG.chamber), build_pneumatics(name, CONFIG.chamber)
    for model in (whole, halves):
        model.reset(start)
        model.step(before, 0.01)  # spools stand somewhere, so that the command may reverse them
    halves.step(command, dt_s / 2)
    np.testing.assert_allclose(whole.step(command, dt_s), halves.step(command, dt_s / 2), rtol=0, atol=1e-12 * SUPPLY)


@given(pressures, pressures, openings, st.floats(1e-4, 0.5))
def test_a_fuller_lag_chamber_stays_fuller(first, second, spool, dt_s):
    result = []
    for start in (np.minimum(first, second), np.maximum(first, second)):
        model = build_pneumatics("lag", CONFIG.chamber)
        model.reset(start)
        result.append(model.step(spool, dt_s))
    assert (result[0] <= result[1] + 1e-9 * SUPPLY).all()


@settings(deadline=None)
@given(
    arrays(float, 16, elements=st.floats(0.0, 110e3)),
    st.lists(st.tuples(times, anything | plausible, st.sampled_from("uuuuuucedv")), min_size=1, max_size=30),
)
def test_no_input_ever_yields_a_spool_command_that_is_not_a_number_or_out_of_range(setpoint, events):
    loops = PressureController(CONFIG.controller, 110e3, 120e3)
    loops.request(setpoint)
    loops.enable(True)
    with np.errstate(all="raise", under="ignore"):
        for time_s, pressure, event in events:
            if event == "e":
                loops.enable(True)
            elif event == "d":
                loops.enable(False)
            elif event == "v":
                loops.vent_all()
            spool = loops.check(time_s) if event == "c" else loops.update(time_s, pressure)
            assert (np.abs(spool) <= 1.0).all()  # False for NaN
            assert np.isfinite(loops.reference_gauge_pa).all()


@given(st.lists(plausible, min_size=2, max_size=20), st.floats(120e3, 130e3, exclude_min=True))
def test_an_over_pressure_always_vents_whatever_came_before(history, over):
    loops = PressureController(CONFIG.controller, 110e3, 120e3)
    loops.request(np.full(16, 110e3))
    loops.enable(True)
    for k, pressure in enumerate(history):
        loops.update(0.01 * k, pressure)
    np.testing.assert_array_equal(loops.update(0.01 * len(history), np.full(16, over)), np.full(16, -1.0))


@given(st.lists(st.tuples(times, anything | arrays(float, 16, elements=st.floats(0.0, 5.0))), min_size=1, max_size=20))
def test_a_reading_is_finite_exactly_where_the_channel_is_ok(events):
    sensor = PressureSensing(CONFIG.sensing, CONFIG.transducer)
    for time_s, volts in events:
        reading = sensor.update(time_s, volts)
        ok = np.array([status is ChannelStatus.OK for status in reading.status])
        np.testing.assert_array_equal(np.isfinite(reading.pressure_gauge_pa), ok)
        np.testing.assert_array_equal(np.isfinite(reading.variance_pa2), ok)
        assert (reading.variance_pa2[ok] > 0.0).all()
