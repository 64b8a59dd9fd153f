"""The grasp state machine, transition by transition."""

import dataclasses
import math

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.grasp.arbitration import Arbiter, Contact, Phase, Source, load_grasp_config
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject, ModeSelector
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air

CONFIG = load_grasp_config()
TIMES = CONFIG.arbitration
MODES = load_modes()
GRIPPER = load_gripper()
LIMIT_PA, OVER_PA = GRIPPER.pressure_limit_gauge_pa, GRIPPER.over_pressure_gauge_pa
DT_S = 0.01

BULB = DetectedObject("bulb", "sphere", (0.06, 0.06, 0.06), (0.002, 0.0, 0.09), (0.0, 0.0, 0.0, 1.0), 0.9)
BOULDER = dataclasses.replace(BULB, label="boulder", size_m=(0.2, 0.2, 0.2))


class Bench:
    """An arbiter with perfect valves: unless told otherwise, pressures are at once what the arbiter wants."""

    def __init__(self, time_s=100.0):
        self.arbiter = Arbiter(TIMES, MODES, ModeSelector(CONFIG.selection, GRIPPER, MODES), LIMIT_PA, OVER_PA)
        self.time_s = time_s
        self.pressure_pa = np.zeros(16)
        self.run(DT_S)

    def run(self, duration_s, pressure_pa="follow"):
        """Advance in steps of 10 ms; ``None``: no readings come, an array: these readings come."""
        for _ in range(max(1, round(duration_s / DT_S))):
            self.time_s += DT_S
            if pressure_pa is not None:
                follow = isinstance(pressure_pa, str)
                self.pressure_pa = self.decision.setpoint_gauge_pa if follow else pressure_pa
                self.arbiter.observe_pressures(self.time_s, self.pressure_pa)
        return self.decision

    @property
    def decision(self):
        return self.arbiter.tick(self.time_s)

    def see(self, *objects):
        self.arbiter.observe_detections(self.time_s, objects)

    def health(self, source, ok, message=""):
        self.arbiter.observe_health(self.time_s, source, ok, message)

    def ask(self, request, *arguments):
        return getattr(self.arbiter, request)(*arguments, self.time_s)


def closing(source="operator"):
    bench = Bench()
    if source == "operator":
        assert bench.ask("request_mode", "mid_rod").accepted
    else:
        bench.see(BULB)
        assert bench.ask("request_auto").accepted
    return bench


def holding(source="operator"):
    bench = closing(source)
    bench.run(TIMES.settle_dwell_s + 2 * DT_S)
    return bench


def releasing(source="operator"):
    bench = holding(source)
    grip_pa = bench.pressure_pa
    assert bench.ask("release").accepted
    bench.run(DT_S, grip_pa)
    return bench


def kept_by_fault(source="operator"):
    bench = holding(source)
    bench.health("valve_controller", False, "valve 3 does not answer")
    bench.run(DT_S)
    bench.health("valve_controller", True)
    return bench


def stopped(source="operator"):
    bench = holding(source)
    bench.ask("stop")
    return bench


IN_PHASE = {"idle": lambda source: Bench(), "closing": closing, "holding": holding, "releasing": releasing}
IN_PHASE |= {"fault keeping the object": kept_by_fault, "fault": stopped}


def one_channel(value_pa, channel=5, others_pa=0.0):
    pressure_pa = np.full(16, others_pa) if np.isscalar(others_pa) else np.array(others_pa)
    pressure_pa[channel] = value_pa
    return pressure_pa


# Idle


def test_a_new_gripper_is_open_and_idle():
    decision = Bench().decision
    assert (decision.phase, decision.source, decision.air) == (Phase.IDLE, Source.NONE, Air.REGULATE)
    assert not decision.setpoint_gauge_pa.any()
    assert decision.mode == decision.object_label == "" and decision.grasp_pose is None


@pytest.mark.parametrize("name", MODE_NAMES)
def test_a_mode_request_closes_with_the_modes_grip_pressure(name):
    bench = Bench()
    answer = bench.ask("request_mode", name)
    decision = bench.decision
    assert answer.accepted and answer.reason == f"closing in {name}: operator asked for {name}"
    assert (decision.phase, decision.mode, decision.source) == (Phase.CLOSING, name, Source.OPERATOR)
    assert decision.object_label == "unknown"
    grip_pa = getattr(TIMES.grip_pressure_gauge_pa, name)
    np.testing.assert_array_equal(decision.setpoint_gauge_pa, MODES[name].setpoints(grip_pa))


def test_an_unknown_mode_is_refused_with_the_modes_there_are():
    answer = Bench().ask("request_mode", "hug")
    assert not answer.accepted
    assert answer.reason == "no mode 'hug'; modes: envelope, short_rod, slender_rod, mid_rod"


def test_a_channel_without_a_valid_reading_refuses_requests_by_name():
    bench = Bench()
    bench.see(BULB)
    bench.run(DT_S, one_channel(math.nan))
    for request in (("request_mode", "envelope"), ("request_auto",)):
        answer = bench.ask(*request)
        assert not answer.accepted
        assert answer.reason == "no valid pressure reading from finger_2_chamber_2"
    assert bench.decision.phase is Phase.IDLE


def test_an_infinite_reading_is_no_reading():
    bench = Bench()
    bench.run(DT_S, one_channel(math.inf))
    assert "finger_2_chamber_2" in bench.ask("request_mode", "envelope").reason
    assert bench.decision.phase is Phase.IDLE


def test_before_any_pressure_reading_requests_are_refused():
    arbiter = Arbiter(TIMES, MODES, ModeSelector(CONFIG.selection, GRIPPER, MODES), LIMIT_PA, OVER_PA)
    answer = arbiter.request_mode("envelope", 0.0)
    assert not answer.accepted and answer.reason == "no valid pressure reading from any of the 16 channels"


def test_stale_pressures_refuse_requests_while_idle_and_latch_nothing():
    bench = Bench()
    bench.run(TIMES.pressure_stale_s + 2 * DT_S, None)
    answer = bench.ask("request_mode", "envelope")
    assert not answer.accepted and "no valid pressure reading for more than 0.3 s" in answer.reason
    bench.run(DT_S)
    assert bench.ask("request_mode", "envelope").accepted


def test_a_reported_fault_refuses_requests_while_idle_and_latches_nothing():
    bench = Bench()
    bench.health("pressure_sensor", False, "finger_1_chamber_1 is stuck")
    answer = bench.ask("request_mode", "envelope")
    assert not answer.accepted and answer.reason == "pressure_sensor: finger_1_chamber_1 is stuck"
    bench.health("pressure_sensor", True)
    assert bench.ask("request_mode", "envelope").accepted


@pytest.mark.parametrize(("request_name", "reason"), [("release", "already open"), ("reset", "no fault latched")])
def test_opening_or_resetting_an_open_gripper_is_accepted_and_changes_nothing(request_name, reason):
    bench = Bench()
    answer = bench.ask(request_name)
    assert answer.accepted and answer.reason == reason
    assert bench.decision.phase is Phase.IDLE


# The camera's choice


def test_auto_closes_in_the_mode_of_the_object_in_view_and_publishes_the_wrist_pose():
    bench = Bench()
    bench.see(BULB)
    answer = bench.ask("request_auto")
    decision = bench.decision
    assert answer.accepted and answer.reason.startswith("closing in envelope: bulb: sphere is round from above")
    assert (decision.phase, decision.mode, decision.source) == (Phase.CLOSING, "envelope", Source.CAMERA)
    assert decision.object_label == "bulb"
    assert decision.grasp_pose.position_m == (0.002, 0.0, 0.0)


def test_auto_turns_the_mode_with_the_object():
    side = math.sqrt(0.5)
    along_x = DetectedObject("carton", "box", (0.035, 0.06, 0.12), (0.0, 0.0, 0.1), (0.0, side, 0.0, side), 0.9)
    bench = Bench()
    bench.see(dataclasses.replace(along_x, size_m=(0.06, 0.035, 0.12)))
    assert bench.ask("request_auto").accepted
    assert (bench.decision.mode, bench.decision.quarter_turns) == ("mid_rod", 1)
    np.testing.assert_array_equal(bench.decision.setpoint_gauge_pa, MODES["mid_rod"].turned(1).setpoints(100e3))


def test_auto_without_any_detection_is_refused():
    assert Bench().ask("request_auto").reason == "no detection yet; is the object detector running?"


def test_auto_with_an_empty_view_is_refused():
    bench = Bench()
    bench.see()
    answer = bench.ask("request_auto")
    assert not answer.accepted and answer.reason == "no object in view"


def test_auto_with_an_old_detection_is_refused_with_its_age():
    bench = Bench()
    bench.see(BULB)
    bench.run(TIMES.detection_stale_s + 0.5)
    answer = bench.ask("request_auto")
    assert not answer.accepted and answer.reason == "last detection is 1.5 s old, at most 1 s; camera running?"


def test_auto_with_an_object_out_of_reach_is_refused_with_the_selectors_reason():
    bench = Bench()
    bench.see(BOULDER)
    answer = bench.ask("request_auto")
    assert not answer.accepted and "boulder: too wide by 116.0 mm: 200.0 mm" in answer.reason
    assert bench.decision.phase is Phase.IDLE


# Closing


def test_closing_becomes_holding_once_all_pressures_stayed_near_their_setpoints_for_the_dwell():
    bench = closing()
    assert bench.run(TIMES.settle_dwell_s - 2 * DT_S).phase is Phase.CLOSING
    assert bench.run(4 * DT_S).phase is Phase.HOLDING


def test_a_pressure_that_leaves_the_tolerance_starts_the_dwell_anew():
    bench = closing()
    bench.run(TIMES.settle_dwell_s - 3 * DT_S)
    wanted_pa = bench.decision.setpoint_gauge_pa
    bench.run(DT_S, one_channel(wanted_pa[0] - 2 * TIMES.pressure_tolerance_pa, 0, wanted_pa))
    assert bench.run(TIMES.settle_dwell_s - 3 * DT_S).phase is Phase.CLOSING
    assert bench.run(6 * DT_S).phase is Phase.HOLDING


def test_chambers_that_should_be_empty_count_as_well():
    bench = closing()
    wanted_pa = bench.decision.setpoint_gauge_pa
    empty = int(np.flatnonzero(wanted_pa == 0.0)[0])
    assert bench.run(1.0, one_channel(20e3, empty, wanted_pa)).phase is Phase.CLOSING


def test_a_grasp_that_does_not_reach_its_pressure_is_a_fault_that_names_the_channel_and_vents():
    bench = closing()
    slow_pa = one_channel(40e3, 0, bench.decision.setpoint_gauge_pa)
    assert bench.run(TIMES.close_timeout_s - 5 * DT_S, slow_pa).phase is Phase.CLOSING
    decision = bench.run(10 * DT_S, slow_pa)
    assert (decision.phase, decision.air, decision.source) == (Phase.FAULT, Air.VENT, Source.SAFETY)
    assert decision.reason == ("did not reach pressure in 3 s: finger_1_chamber_1 at 40000 Pa (wanted 100000 Pa)")
    assert not decision.setpoint_gauge_pa.any()


def test_a_pressure_that_never_steadies_is_a_fault_as_well():
    bench = closing()
    decision = bench.decision
    for _ in range(round(TIMES.close_timeout_s / DT_S / 10) + 2):
        bench.run(9 * DT_S)
        decision = bench.run(DT_S, np.zeros(16)) if bench.decision.phase is Phase.CLOSING else bench.decision
    assert decision.phase is Phase.FAULT and "did not reach pressure" in decision.reason


def test_stale_pressures_while_closing_are_a_fault_that_vents():
    bench = closing()
    assert bench.run(TIMES.pressure_stale_s - 2 * DT_S, None).phase is Phase.CLOSING
    decision = bench.run(4 * DT_S, None)
    assert (decision.phase, decision.air) == (Phase.FAULT, Air.VENT)
    assert decision.reason == "no valid pressure reading for more than 0.3 s from any of the 16 channels"


def test_readings_that_stay_out_while_the_computer_is_held_up_are_laid_to_the_computer():
    bench = closing()
    bench.run(TIMES.pressure_stale_s - 2 * DT_S, None)
    bench.arbiter.observe_lateness(bench.time_s, 0.26)
    decision = bench.run(4 * DT_S, None)
    assert (decision.phase, decision.air) == (Phase.FAULT, Air.VENT)
    assert decision.reason.startswith("this computer ran 260 ms late: no valid pressure reading for more than 0.3 s")


def test_a_computer_held_up_before_the_readings_stayed_out_is_not_blamed():
    bench = closing()
    bench.arbiter.observe_lateness(bench.time_s, 0.26)
    bench.run(DT_S)
    decision = bench.run(TIMES.pressure_stale_s + 2 * DT_S, None)
    assert decision.reason.startswith("no valid pressure reading")


def test_lateness_alone_is_no_fault():
    bench = closing()
    bench.arbiter.observe_lateness(bench.time_s, 5.0)
    assert bench.run(DT_S).phase is Phase.CLOSING


def test_a_reported_fault_while_closing_vents():
    bench = closing()
    bench.health("valve_controller", False, "valve 3 does not answer")
    decision = bench.decision
    assert (decision.phase, decision.air) == (Phase.FAULT, Air.VENT)
    assert decision.reason == "valve_controller: valve 3 does not answer"
    assert not decision.setpoint_gauge_pa.any()


def test_release_while_closing_opens():
    bench = closing()
    bench.run(DT_S, bench.decision.setpoint_gauge_pa / 2.0)
    assert bench.ask("release").accepted
    assert bench.decision.phase is Phase.RELEASING


# Holding


def test_holding_keeps_mode_object_pose_and_setpoints():
    decision = holding("camera").decision
    assert (decision.phase, decision.mode, decision.source) == (Phase.HOLDING, "envelope", Source.CAMERA)
    assert decision.object_label == "bulb" and decision.grasp_pose is not None
    np.testing.assert_array_equal(decision.setpoint_gauge_pa, MODES["envelope"].setpoints(100e3))


def test_whether_an_object_is_touched_is_said_to_be_not_observable():
    assert holding().decision.contact is Contact.NOT_OBSERVABLE
    assert holding().decision.key_values()["contact"] == "not observable"


@pytest.mark.parametrize(("touching", "contact"), [(True, Contact.TOUCHING), (False, Contact.NOT_TOUCHING)])
def test_a_measured_contact_is_reported_until_it_is_old(touching, contact):
    bench = holding()
    bench.arbiter.observe_contact(bench.time_s, touching)
    assert bench.decision.contact is contact
    assert bench.run(TIMES.contact_stale_s + 2 * DT_S).contact is Contact.NOT_OBSERVABLE


@pytest.mark.parametrize(
    "trouble",
    [
        lambda bench: bench.run(TIMES.pressure_stale_s + 2 * DT_S, None),
        lambda bench: bench.run(TIMES.pressure_stale_s + 2 * DT_S, one_channel(math.nan, 5, bench.pressure_pa)),
        lambda bench: bench.health("pressure_sensor", False, "transducer 7 out of range"),
        lambda bench: bench.run(TIMES.pressure_lost_s + 3 * DT_S, one_channel(30e3, 0, bench.pressure_pa)),
    ],
    ids=["stale pressures", "one channel NaN", "sensor fault", "pressure lost"],
)
def test_a_fault_while_holding_keeps_the_object_with_valves_closed(trouble):
    bench = holding()
    before_pa = bench.decision.setpoint_gauge_pa
    trouble(bench)
    decision = bench.decision
    assert (decision.phase, decision.air, decision.source) == (Phase.FAULT, Air.HOLD, Source.SAFETY)
    assert decision.mode == "mid_rod"
    np.testing.assert_array_equal(decision.setpoint_gauge_pa, before_pa)


def test_a_missing_reading_shorter_than_the_stale_limit_is_no_fault():
    bench = holding()
    bench.run(TIMES.pressure_stale_s - 3 * DT_S, one_channel(math.nan, 5, bench.pressure_pa))
    assert bench.run(0.1).phase is Phase.HOLDING


def test_a_pressure_out_of_tolerance_for_a_moment_is_no_fault():
    bench = holding()
    bench.run(TIMES.pressure_lost_s - 3 * DT_S, one_channel(30e3, 0, bench.pressure_pa))
    assert bench.run(0.1).phase is Phase.HOLDING


def test_lost_pressure_names_the_channel():
    bench = holding()
    decision = bench.run(TIMES.pressure_lost_s + 3 * DT_S, one_channel(30e3, 0, bench.pressure_pa))
    assert decision.reason == "pressure lost: finger_1_chamber_1 at 30000 Pa (wanted 100000 Pa)"


def test_release_while_holding_opens():
    bench = holding("camera")
    answer = bench.ask("release")
    decision = bench.decision
    assert answer.accepted and answer.reason == "releasing"
    assert (decision.phase, decision.air, decision.grasp_pose) == (Phase.RELEASING, Air.REGULATE, None)
    assert not decision.setpoint_gauge_pa.any()


# Priorities


@pytest.mark.parametrize("phase", ["closing", "holding"])
def test_the_operator_preempts_the_cameras_grasp(phase):
    bench = IN_PHASE[phase]("camera")
    answer = bench.ask("request_mode", "short_rod")
    decision = bench.decision
    assert answer.accepted and f"preempts the camera's envelope grasp ({phase})" in answer.reason
    assert (decision.phase, decision.mode, decision.source) == (Phase.CLOSING, "short_rod", Source.OPERATOR)
    assert decision.object_label == "unknown" and decision.grasp_pose is None
    np.testing.assert_array_equal(decision.setpoint_gauge_pa, MODES["short_rod"].setpoints(100e3))
    assert bench.run(TIMES.settle_dwell_s + 2 * DT_S).phase is Phase.HOLDING


def test_a_preempting_grasp_of_the_same_mode_dwells_anew():
    bench = holding("camera")
    assert bench.ask("request_mode", "envelope").accepted
    assert bench.run(TIMES.settle_dwell_s - 2 * DT_S).phase is Phase.CLOSING
    assert bench.run(4 * DT_S).phase is Phase.HOLDING


def test_a_preempting_grasp_gets_the_full_time_to_close():
    bench = closing("camera")
    bench.run(TIMES.close_timeout_s - 0.1, np.zeros(16))
    assert bench.ask("request_mode", "mid_rod").accepted
    assert bench.run(TIMES.close_timeout_s - 0.1, np.zeros(16)).phase is Phase.CLOSING


@pytest.mark.parametrize("phase", ["closing", "holding"])
@pytest.mark.parametrize(
    ("running", "request_name", "refusal"),
    [
        ("operator", ("request_mode", "envelope"), "operator's mid_rod grasp ({}) is not preempted by the operator"),
        ("operator", ("request_auto",), "operator's mid_rod grasp ({}) is not preempted by the camera"),
        ("camera", ("request_auto",), "camera's envelope grasp ({}) is not preempted by the camera"),
    ],
)
def test_an_equal_or_lower_source_is_refused_while_a_grasp_runs(phase, running, request_name, refusal):
    bench = IN_PHASE[phase](running)
    bench.see(BULB)
    before = bench.decision
    answer = bench.ask(*request_name)
    assert not answer.accepted
    assert answer.reason == refusal.format(phase) + "; call grasp/release first"
    assert not bench.decision.changed and bench.decision.mode == before.mode


# Releasing


def test_releasing_becomes_idle_once_all_pressures_are_down():
    bench = releasing()
    assert bench.run(0.5, one_channel(TIMES.open_below_gauge_pa + 100.0)).phase is Phase.RELEASING
    decision = bench.run(DT_S, np.full(16, TIMES.open_below_gauge_pa - 100.0))
    assert (decision.phase, decision.source, decision.reason) == (Phase.IDLE, Source.NONE, "released")
    assert decision.mode == decision.object_label == ""


def test_a_second_release_is_accepted_and_changes_nothing():
    bench = releasing()
    assert bench.decision.phase is Phase.RELEASING
    assert bench.ask("release").reason == "already releasing"
    assert not bench.decision.changed


@pytest.mark.parametrize("request_name", [("request_mode", "envelope"), ("request_auto",)])
def test_requests_while_releasing_are_refused_with_what_to_do(request_name):
    bench = releasing()
    bench.see(BULB)
    answer = bench.ask(*request_name)
    assert not answer.accepted and answer.reason == "releasing; ask again once idle"


def test_a_chamber_that_does_not_vent_is_a_fault_that_names_it():
    decision = releasing().run(TIMES.release_timeout_s + 2 * DT_S, one_channel(50e3))
    assert (decision.phase, decision.air) == (Phase.FAULT, Air.VENT)
    assert decision.reason == "did not vent in 5 s: finger_2_chamber_2 at 50000 Pa (wanted 0 Pa)"


def test_stale_pressures_never_count_as_vented():
    bench = releasing()
    bench.run(DT_S, np.full(16, 9e3))
    assert bench.run(TIMES.release_timeout_s - 0.1, None).phase is Phase.RELEASING
    decision = bench.run(0.2, None)
    assert decision.phase is Phase.FAULT and "did not vent in 5 s: no valid pressure reading" in decision.reason


# Safety


@pytest.mark.parametrize("source", ["operator", "camera"])
@pytest.mark.parametrize("phase", IN_PHASE)
def test_stop_vents_at_once_from_everywhere_and_latches(phase, source):
    bench = IN_PHASE[phase](source)
    answer = bench.ask("stop")
    decision = bench.decision
    assert answer.accepted
    assert (decision.phase, decision.air, decision.source) == (Phase.FAULT, Air.VENT, Source.SAFETY)
    assert decision.reason.startswith("stop requested") and not decision.setpoint_gauge_pa.any()
    assert bench.run(3.0).phase is Phase.FAULT


@pytest.mark.parametrize("source", ["operator", "camera"])
@pytest.mark.parametrize("phase", IN_PHASE)
def test_an_over_pressure_vents_at_once_from_everywhere(phase, source):
    bench = IN_PHASE[phase](source)
    decision = bench.run(DT_S, one_channel(OVER_PA + 1.0, 5, bench.pressure_pa))
    assert (decision.phase, decision.air, decision.source) == (Phase.FAULT, Air.VENT, Source.SAFETY)
    assert not decision.setpoint_gauge_pa.any()


def test_an_excess_between_two_ticks_is_not_missed():
    bench = holding()
    bench.arbiter.observe_pressures(bench.time_s, one_channel(OVER_PA + 1.0, 5, bench.pressure_pa))
    bench.arbiter.observe_pressures(bench.time_s, bench.pressure_pa)
    assert bench.decision.air is Air.VENT
    assert "over-pressure, above 120000 Pa: finger_2_chamber_2 at 120001 Pa" in bench.decision.reason


def test_a_fault_that_keeps_the_object_vents_when_over_pressure_follows():
    bench = kept_by_fault()
    assert bench.decision.air is Air.HOLD
    decision = bench.run(DT_S, one_channel(OVER_PA + 1.0, 5, bench.pressure_pa))
    assert decision.air is Air.VENT
    assert "before: valve_controller: valve 3 does not answer" in decision.reason


def test_every_request_during_a_fault_is_refused_with_its_cause_and_what_to_do():
    bench = stopped()
    bench.see(BULB)
    for request in (("request_mode", "envelope"), ("request_auto",)):
        answer = bench.ask(*request)
        assert not answer.accepted and answer.reason == "fault latched (stop requested); call grasp/reset"
    kept = kept_by_fault().ask("request_mode", "envelope")
    assert kept.reason == (
        "fault latched (valve_controller: valve 3 does not answer); call grasp/release, then grasp/reset"
    )


def test_repeated_stops_do_not_lengthen_the_reason():
    bench = stopped()
    before = bench.decision.reason
    for _ in range(3):
        bench.ask("stop")
    assert bench.decision.reason == before and not bench.decision.changed


def test_release_lets_go_of_what_a_fault_has_kept_and_the_fault_stays():
    bench = kept_by_fault()
    answer = bench.ask("release")
    decision = bench.decision
    assert answer.accepted and answer.reason == "venting; the fault stays until grasp/reset"
    assert (decision.phase, decision.air) == (Phase.FAULT, Air.VENT)
    assert not decision.setpoint_gauge_pa.any()
    bench.run(0.1)
    assert bench.ask("reset").accepted and bench.decision.phase is Phase.IDLE


def test_release_during_a_venting_fault_changes_nothing():
    bench = stopped()
    assert bench.decision.phase is Phase.FAULT
    assert bench.ask("release").accepted
    assert not bench.decision.changed


# Reset


def test_reset_after_a_stop_makes_the_gripper_idle_and_usable():
    bench = stopped()
    bench.run(0.1)
    answer = bench.ask("reset")
    assert answer.accepted and answer.reason == "fault cleared"
    assert (bench.decision.phase, bench.decision.source) == (Phase.IDLE, Source.NONE)
    assert bench.ask("request_mode", "envelope").accepted


def test_reset_is_refused_while_pressure_is_up():
    bench = stopped()
    bench.run(DT_S, one_channel(60e3))
    answer = bench.ask("reset")
    assert not answer.accepted
    assert answer.reason == ("pressure is still up: finger_2_chamber_2 at 60000 Pa (wanted 0 Pa); wait until vented")


def test_reset_is_refused_while_the_cause_persists():
    bench = holding()
    bench.health("pressure_sensor", False, "transducer 7 out of range")
    bench.ask("stop")
    bench.run(0.1)
    answer = bench.ask("reset")
    assert not answer.accepted and answer.reason == "the cause persists: pressure_sensor: transducer 7 out of range"
    bench.health("pressure_sensor", True)
    assert bench.ask("reset").accepted


@pytest.mark.parametrize("readings", [None, one_channel(math.nan)], ids=["stale", "NaN"])
def test_reset_is_refused_while_pressures_are_unknown(readings):
    bench = stopped()
    bench.run(0.1)
    bench.run(TIMES.pressure_stale_s + 2 * DT_S, readings)
    answer = bench.ask("reset")
    assert not answer.accepted and "the cause persists: no valid pressure reading" in answer.reason


def test_reset_is_refused_while_a_fault_keeps_the_object():
    answer = kept_by_fault().ask("reset")
    assert not answer.accepted and "call grasp/release first" in answer.reason


@pytest.mark.parametrize("phase", ["closing", "holding", "releasing"])
def test_reset_without_a_fault_is_refused_with_what_opens(phase):
    answer = IN_PHASE[phase]("operator").ask("reset")
    assert not answer.accepted
    assert answer.reason == f"no fault latched, the gripper is {phase}; grasp/release opens it"


# Time and input


@pytest.mark.parametrize("phase", IN_PHASE)
def test_a_clock_that_starts_anew_keeps_the_phase(phase):
    bench = IN_PHASE[phase]("camera")
    before = bench.decision
    bench.time_s = 0.0
    after = bench.decision
    assert not after.changed and after.phase is before.phase
    bench.run(0.1, bench.pressure_pa)
    assert bench.decision.phase is before.phase


def test_time_outs_go_on_after_the_clock_started_anew():
    bench = closing()
    bench.run(TIMES.close_timeout_s - 0.5, np.zeros(16))
    bench.time_s = 0.0
    assert bench.run(0.4, np.zeros(16)).phase is Phase.CLOSING
    assert bench.run(0.2, np.zeros(16)).phase is Phase.FAULT


def test_stale_data_is_still_noticed_after_the_clock_started_anew():
    bench = holding()
    bench.time_s = 0.0
    assert bench.decision.phase is Phase.HOLDING
    assert bench.run(TIMES.pressure_stale_s + 2 * DT_S, None).phase is Phase.FAULT


def test_pressures_of_a_wrong_length_are_refused_and_nothing_is_applied():
    bench = holding()
    with pytest.raises(ValueError, match=r"expected 16 pressures, found an array of shape \(15,\)"):
        bench.arbiter.observe_pressures(bench.time_s, np.zeros(15))
    assert bench.run(0.1).phase is Phase.HOLDING


def test_a_time_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="time must be finite"):
        Bench().arbiter.tick(math.nan)


def test_a_grip_pressure_above_the_grippers_limit_is_refused():
    with pytest.raises(
        ValueError, match="grip_pressure_gauge_pa of envelope is 100000 Pa, above the limit of 90000 Pa"
    ):
        Arbiter(TIMES, MODES, ModeSelector(CONFIG.selection, GRIPPER, MODES), 90e3, 120e3)


# What is published


def test_a_decision_is_marked_changed_once():
    bench = closing()
    assert bench.decision.changed
    assert not bench.decision.changed
    assert [bench.run(DT_S).changed for _ in range(5)] == [False] * 5


def test_setpoints_cannot_be_changed_by_the_reader():
    with pytest.raises(ValueError, match="read-only"):
        closing().decision.setpoint_gauge_pa[0] = 1.0


def test_key_values_are_texts_that_tell_phase_mode_source_object_and_reason():
    values = holding("camera").decision.key_values()
    assert all(isinstance(value, str) for value in values.values())
    assert values["reason"].startswith("bulb: sphere is round from above")
    assert {key: values[key] for key in ("phase", "mode", "source", "object", "air", "mirrored", "quarter_turns")} == {
        "phase": "holding",
        "mode": "envelope",
        "source": "camera",
        "object": "bulb",
        "air": "regulate",
        "mirrored": "false",
        "quarter_turns": "0",
    }


def test_channels_in_reasons_are_the_packages_channel_names():
    bench = Bench()
    for channel, name in enumerate(CHANNEL_NAMES):
        bench.run(DT_S, one_channel(math.nan, channel))
        assert bench.ask("request_mode", "envelope").reason.endswith(name)
