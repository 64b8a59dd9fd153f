"""The pressure loops by themselves: set-points, limits, faults, enabling."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import ControllerInputError, PressureController, SetpointError, ValveFault

CONFIG = load_pneumatics().controller
LIMIT, TRIP = 110e3, 120e3
BAD = 6  # finger_2_chamber_3
OTHERS = np.arange(16) != BAD
NONE, NO_PRESSURE, OVER_PRESSURE = ValveFault.NONE, ValveFault.NO_PRESSURE, ValveFault.OVER_PRESSURE


def controller(setpoint_pa=80e3, enabled=True, **change):
    loops = PressureController(dataclasses.replace(CONFIG, **change), LIMIT, TRIP)
    loops.request(np.full(16, setpoint_pa))
    loops.enable(enabled)
    return loops


def but(value, pressure):
    return np.where(OTHERS, pressure, value)


def hold(loops, pressure, start=0, count=20):
    """Feed one pressure at 100 Hz and return the openings, (count, 16)."""
    return np.array([loops.update(0.01 * k, np.broadcast_to(pressure, 16)) for k in range(start, start + count)])


class TestSetpoints:
    @pytest.mark.parametrize(
        ("value", "message"),
        [(math.nan, "nan"), (math.inf, "inf"), (-1.0, "-1 Pa"), (110001.0, "110001 Pa")],
    )
    def test_a_bad_one_is_refused_by_name_and_none_is_applied(self, value, message):
        loops = controller(50e3)
        with pytest.raises(SetpointError, match=f"finger_2_chamber_3 is {message}"):
            loops.request(but(value, 60e3))
        np.testing.assert_array_equal(loops.setpoint, np.full(16, 50e3))

    @pytest.mark.parametrize("shape", [(15,), (16, 1), ()])
    def test_a_wrong_number_of_them_is_refused(self, shape):
        with pytest.raises(SetpointError, match="shape"):
            controller().request(np.zeros(shape))

    def test_the_limit_itself_and_zero_are_accepted(self):
        loops = controller(minimum_setpoint_gauge_pa=5e3)
        loops.request(but(0.0, LIMIT))
        np.testing.assert_array_equal(loops.setpoint, but(0.0, LIMIT))
        with pytest.raises(SetpointError, match="0 or 5000 to 110000 Pa"):
            loops.request(but(4e3, LIMIT))

    def test_the_caller_s_array_is_not_kept(self):
        loops, wanted = controller(), np.full(16, 40e3)
        loops.request(wanted)
        wanted[:] = 1e9
        np.testing.assert_array_equal(loops.setpoint, np.full(16, 40e3))

    def test_the_reference_moves_at_the_rate_limit_and_arrives_from_one_side(self):
        loops = controller(100e3)
        reference = []
        for k in range(100):
            loops.update(0.01 * k, np.zeros(16))
            reference.append(loops.reference_gauge_pa[0])
        rate = np.diff(reference) / 0.01
        assert rate.max() == pytest.approx(CONFIG.rate_limit_pa_s)
        assert (rate >= 0.0).all() and reference[-1] == 100e3

    def test_the_reference_is_the_same_whatever_the_interval(self):
        def reference_after(count, period_s):
            loops = controller(100e3)
            for k in range(count + 1):
                loops.update(period_s * k, np.zeros(16))
            return loops.reference_gauge_pa

        np.testing.assert_allclose(reference_after(12, 0.02), reference_after(240, 0.001), rtol=1e-12)

    @pytest.mark.parametrize("limit", [0.0, -1.0, 200001.0, math.nan])
    def test_a_limit_that_cannot_be_is_refused(self, limit):
        with pytest.raises(ValueError, match="pressure limit"):
            PressureController(CONFIG, limit, 1e9)

    @pytest.mark.parametrize("over_pressure", [LIMIT, 0.0, math.nan])
    def test_an_over_pressure_that_is_not_above_the_limit_is_refused(self, over_pressure):
        with pytest.raises(ValueError, match="over-pressure"):
            PressureController(CONFIG, LIMIT, over_pressure)


class TestEnabling:
    def test_it_starts_disabled_with_every_valve_closed(self):
        loops = PressureController(CONFIG, LIMIT, TRIP)
        assert not loops.enabled
        loops.request(np.full(16, 80e3))
        np.testing.assert_array_equal(hold(loops, 0.0), np.zeros((20, 16)))

    def test_disabling_closes_the_valves_at_once(self):
        loops = controller()
        assert (hold(loops, 0.0)[-1] > 0.1).all()
        loops.enable(False)
        np.testing.assert_array_equal(loops.check(0.195), np.zeros(16))
        np.testing.assert_array_equal(hold(loops, 0.0, start=20), np.zeros((20, 16)))

    def test_enabling_starts_from_the_measured_pressures_without_a_jump(self):
        loops = controller(80e3, enabled=False)
        hold(loops, 78e3)
        loops.enable(True)
        first = loops.update(0.2, np.full(16, 78e3))
        np.testing.assert_array_equal(first, np.zeros(16))
        np.testing.assert_allclose(loops.reference_gauge_pa, 78e3, atol=1.0)
        assert (np.abs(loops.update(0.21, np.full(16, 78e3))) < 0.2).all()

    def test_disabling_forgets_what_the_integral_learned(self):
        loops = controller(80e3)
        hold(loops, 75e3, count=200)
        loops.enable(False)
        loops.enable(True)
        np.testing.assert_array_equal(loops.update(2.0, np.full(16, 75e3)), np.zeros(16))
        expected = CONFIG.rate_limit_pa_s * CONFIG.fill_time_constant_s / (200e3 - 75e3)
        assert (loops.update(2.01, np.full(16, 75e3)) < expected).all()

    def test_enabling_again_while_enabled_disturbs_nothing(self):
        loops, same = controller(), controller()
        hold(loops, 10e3), hold(same, 10e3)
        loops.enable(True)
        np.testing.assert_array_equal(hold(loops, 12e3, start=20), hold(same, 12e3, start=20))


class TestStop:
    def test_vent_all_opens_every_valve_to_ambient_even_without_readings(self):
        loops = controller()
        hold(loops, 80e3)
        loops.vent_all()
        np.testing.assert_array_equal(loops.check(5.0), np.full(16, -1.0))
        np.testing.assert_array_equal(loops.update(5.1, np.full(16, np.nan)), np.full(16, -1.0))
        np.testing.assert_array_equal(loops.setpoint, np.zeros(16))

    def test_only_enabling_ends_it(self):
        loops = controller()
        loops.vent_all()
        with pytest.raises(SetpointError, match="vented"):
            loops.request(np.full(16, 50e3))
        loops.request(np.zeros(16))
        loops.enable(False)
        assert loops.vented
        np.testing.assert_array_equal(loops.update(0.0, np.full(16, 50e3)), np.full(16, -1.0))
        loops.enable(True)
        loops.request(np.full(16, 50e3))
        assert not loops.vented
        np.testing.assert_array_equal(loops.check(0.005), np.zeros(16))
        np.testing.assert_array_equal(loops.update(0.01, np.full(16, 50e3)), np.zeros(16))


class TestAtRest:
    def test_a_settled_valve_closes_and_stays_closed_within_the_open_band(self):
        loops = controller(80e3)
        hold(loops, 80e3)
        for k, error in enumerate((100.0, -300.0, 600.0, -700.0)):
            np.testing.assert_array_equal(loops.update(0.2 + 0.01 * k, np.full(16, 80e3 + error)), np.zeros(16))

    def test_it_opens_again_before_two_percent_are_lost(self):
        for setpoint in (20e3, 80e3, 110e3):
            loops = controller(setpoint)
            hold(loops, setpoint)
            assert (loops.update(0.2, np.full(16, 0.982 * setpoint)) > 0.0).all()
            assert (loops.update(0.21, np.full(16, 1.018 * setpoint)) < 0.0).all()

    def test_set_point_zero_vents_until_empty_then_closes(self):
        loops = controller(0.0)
        np.testing.assert_array_equal(hold(loops, 3e3, count=40)[-1], np.full(16, -1.0))
        np.testing.assert_array_equal(hold(loops, 200.0, start=40, count=1)[0], np.full(16, -1.0))
        np.testing.assert_array_equal(hold(loops, 100.0, start=41, count=1)[0], np.zeros(16))
        np.testing.assert_array_equal(hold(loops, 900.0, start=42, count=1)[0], np.zeros(16))
        np.testing.assert_array_equal(hold(loops, 1100.0, start=43, count=1)[0], np.full(16, -1.0))


class TestAntiWindup:
    def test_the_integral_adds_no_more_than_its_limit(self):
        loops = controller(80e3)
        openings = hold(loops, 70e3, count=3000)[:, 0]
        rate = CONFIG.proportional_gain_1_s * 10e3 + CONFIG.integral_limit_pa_s
        assert openings[-1] == pytest.approx(rate * CONFIG.fill_time_constant_s / 130e3)

    def test_a_saturated_valve_feeds_no_integral(self):
        loops = controller(80e3)
        # 48 kPa short at Kp = 15 1/s asks for more than the valve gives, as long as it lasts.
        assert CONFIG.proportional_gain_1_s * 48e3 * CONFIG.fill_time_constant_s / (200e3 - 32e3) > 1.0
        np.testing.assert_array_equal(hold(loops, 32e3, count=2000)[-1], np.ones(16))
        proportional_alone = CONFIG.proportional_gain_1_s * 2e3 * CONFIG.fill_time_constant_s / (200e3 - 78e3)
        np.testing.assert_allclose(hold(loops, 78e3, start=2000, count=1), proportional_alone, rtol=1e-6)

    def test_the_integral_learns_a_steady_need(self):
        openings = hold(controller(80e3), 79e3, count=150)[:, 0]
        learning = openings[50:100]  # the reference stands still by then, the limit is not reached yet
        slope = CONFIG.integral_gain_1_s2 * 1e3 * CONFIG.fill_time_constant_s / 121e3 * 0.01
        np.testing.assert_allclose(np.diff(learning), slope, rtol=0.02)


class TestWatchdog:
    @pytest.mark.parametrize("reading", [math.nan, math.inf, -math.inf, -2e5])
    def test_a_channel_without_a_valid_pressure_closes_and_is_reported_after_the_watchdog_time(self, reading):
        loops = controller()
        hold(loops, 20e3)  # last valid at 0.19 s
        for k in range(20, 40):
            spool = loops.update(0.01 * k, but(reading, 20e3))
            age_s = 0.01 * k - 0.19
            assert (spool[OTHERS] > 0.0).all()
            assert (spool[BAD] > 0.0) == (age_s <= CONFIG.hold_time_s + 1e-9), age_s
            if abs(age_s - CONFIG.watchdog_s) > 1e-9:
                assert (loops.faults[BAD] is NO_PRESSURE) == (age_s > CONFIG.watchdog_s), age_s
        assert [f for i, f in enumerate(loops.faults) if i != BAD] == [NONE] * 15

    def test_a_single_reading_that_is_missing_does_not_bring_a_venting_valve_to_rest(self):
        loops = controller(20e3)
        hold(loops, 20e3, count=100)
        loops.request(np.zeros(16))
        hold(loops, 500.0, start=100, count=100)  # still above where it closes, below where a closed one would open
        assert loops.update(2.0, but(math.nan, 500.0))[BAD] == -1.0
        assert loops.update(2.01, np.full(16, 500.0))[BAD] == -1.0

    def test_the_timer_closes_all_valves_when_no_pressures_arrive(self):
        loops = controller()
        hold(loops, 20e3)
        assert (loops.check(0.2) > 0.0).all()
        np.testing.assert_array_equal(loops.check(0.25), np.zeros(16))
        assert loops.faults == (NONE,) * 16
        np.testing.assert_array_equal(loops.check(0.4), np.zeros(16))
        assert loops.faults == (NO_PRESSURE,) * 16

    def test_a_controller_that_never_got_a_pressure_reports_it(self):
        loops = controller()
        np.testing.assert_array_equal(loops.check(100.0), np.zeros(16))
        assert loops.faults == (NONE,) * 16
        loops.check(100.21)
        assert loops.faults == (NO_PRESSURE,) * 16

    def test_the_channel_resumes_from_its_pressure_without_a_jump(self):
        loops = controller()
        hold(loops, 20e3)
        hold(loops, but(math.nan, 20e3), start=20, count=40)
        spool = loops.update(0.6, but(55e3, 20e3))
        assert loops.faults == (NONE,) * 16
        assert spool[BAD] == 0.0
        assert loops.reference_gauge_pa[BAD] == pytest.approx(55e3)

    def test_after_a_gap_the_reference_moves_on_by_no_more_than_the_hold_time(self):
        loops = controller()
        hold(loops, 10e3)
        before = loops.reference_gauge_pa
        loops.update(0.19 + 0.15, np.full(16, 10e3))
        moved = loops.reference_gauge_pa - before
        assert (moved > 0.0).all() and (moved <= CONFIG.rate_limit_pa_s * CONFIG.hold_time_s + 1e-6).all()

    def test_time_going_back_restarts_the_loops_and_the_watchdog(self):
        loops = controller()
        hold(loops, 20e3, start=1000)
        np.testing.assert_array_equal(loops.update(0.0, np.full(16, 30e3)), np.zeros(16))
        np.testing.assert_allclose(loops.reference_gauge_pa, 30e3)
        assert (loops.update(0.01, np.full(16, 30e3)) > 0.0).all()
        loops.check(0.22)
        assert loops.faults == (NO_PRESSURE,) * 16

    def test_a_repeated_time_keeps_the_openings(self):
        loops = controller()
        last = hold(loops, 20e3)[-1]
        np.testing.assert_array_equal(loops.update(0.19, np.full(16, 25e3)), last)


class TestOverPressure:
    @pytest.mark.parametrize("enabled", [True, False])
    def test_it_vents_that_chamber_at_once_with_hysteresis_enabled_or_not(self, enabled):
        loops = controller(100e3, enabled=enabled)
        hold(loops, 100e3)
        release = TRIP - CONFIG.over_pressure_release_pa
        for k, (pressure, vents) in enumerate(
            [(TRIP - 1, False), (TRIP + 1, True), (TRIP - 1, True), (release + 1, True), (release - 1, False)]
        ):
            spool = loops.update(0.2 + 0.01 * k, but(pressure, 100e3))
            np.testing.assert_array_equal(spool[OTHERS], 0.0)
            assert (loops.faults[BAD] is OVER_PRESSURE) == vents
            assert (spool[BAD] == -1.0) == vents
        assert spool[BAD] == 0.0  # from here on it goes on without a jump
        assert loops.reference_gauge_pa[BAD] == pytest.approx(release - 1 if enabled else 0.0)
        assert loops.faults == (NONE,) * 16

    def test_it_keeps_venting_when_the_reading_is_lost(self):
        loops = controller(100e3)
        hold(loops, but(150e3, 100e3))
        spool = hold(loops, but(math.nan, 100e3), start=20, count=100)[-1]
        assert spool[BAD] == -1.0 and loops.faults[BAD] is OVER_PRESSURE


class TestInput:
    @pytest.mark.parametrize(
        ("time_s", "pressure"), [(math.nan, np.zeros(16)), (math.inf, np.zeros(16)), (0.0, np.zeros(4))]
    )
    def test_what_cannot_be_used_is_refused(self, time_s, pressure):
        with pytest.raises(ControllerInputError):
            controller().update(time_s, pressure)

    def test_the_pressures_given_are_not_changed(self):
        pressure = but(math.nan, 20e3)
        loops = controller()
        loops.update(0.0, pressure)
        loops.update(0.01, pressure)
        np.testing.assert_array_equal(pressure, but(math.nan, 20e3))

    def test_channels_do_not_influence_one_another(self):
        together = controller(80e3)
        pressure = np.linspace(0.0, 100e3, 16)
        spool = hold(together, pressure, count=30)
        for channel in (0, 7, 15):
            np.testing.assert_array_equal(hold(controller(80e3), pressure[channel], count=30)[:, 0], spool[:, channel])
