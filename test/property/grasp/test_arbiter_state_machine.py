"""Whatever comes in whatever order, the arbiter stays safe."""

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from mbpam_ros.grasp.arbitration import Arbiter, Phase, Source, load_grasp_config
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject, ModeSelector
from mbpam_ros.grasp.watch import SILENCE_S, HealthWatch
from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air

CONFIG, MODES, GRIPPER = load_grasp_config(), load_modes(), load_gripper()
LIMIT_PA, OVER_PA = GRIPPER.pressure_limit_gauge_pa, GRIPPER.over_pressure_gauge_pa
HEALTH_SOURCES = ("pressure_sensor", "valve_controller")

any_number = st.floats(allow_nan=True, allow_infinity=True)
in_range = st.floats(-20e3, OVER_PA)
few_seconds = st.sampled_from([0.0, 0.01, 0.1, 0.25, 0.5, 2.0, 6.0])
coordinates = st.floats(-0.1, 0.2)
objects = st.builds(
    DetectedObject,
    label=st.sampled_from(["bulb", "rod"]),
    shape=st.sampled_from(["sphere", "cylinder", "box"]),
    size_m=st.tuples(*[st.floats(0.001, 0.3)] * 3),
    position_m=st.tuples(coordinates, coordinates, coordinates),
    orientation_xyzw=st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-6),
    confidence=st.floats(0.0, 1.0),
)
graspable = DetectedObject("bulb", "sphere", (0.06, 0.06, 0.06), (0.0, 0.0, 0.09), (0.0, 0.0, 0.0, 1.0), 0.9)


class ArbiterMachine(RuleBasedStateMachine):
    @initialize(time_s=st.floats(-10.0, 1e6))
    def start(self, time_s):
        self.arbiter = Arbiter(
            CONFIG.arbitration, MODES, ModeSelector(CONFIG.selection, GRIPPER, MODES), LIMIT_PA, OVER_PA
        )
        self.watch = HealthWatch(self.arbiter, dict.fromkeys(HEALTH_SOURCES, "not heard of yet"), time_s)
        self.unheard_s = dict.fromkeys(HEALTH_SOURCES, math.inf)
        self.time_s = time_s
        self.latched = False
        self.must_vent = False
        self.wrong = set()
        self.decision = self.arbiter.tick(time_s)

    @rule(seconds=few_seconds)
    def wait(self, seconds):
        self.pass_time(seconds)

    def pass_time(self, seconds):
        self.time_s += seconds
        for source in self.unheard_s:
            self.unheard_s[source] += seconds

    @rule(time_s=st.floats(-10.0, 1e6))
    def jump(self, time_s):
        self.time_s = time_s
        # How long ago a report was is known again with the next one.
        self.unheard_s = {source: since_s if since_s == math.inf else 0.0 for source, since_s in self.unheard_s.items()}

    @rule(pressure_pa=st.one_of(*[st.lists(number, min_size=16, max_size=16) for number in (any_number, in_range)]))
    def read_anything(self, pressure_pa):
        self.read(np.array(pressure_pa))

    @rule(
        channel=st.integers(0, 15),
        value_pa=st.sampled_from([float("nan"), 0.0, 50e3, OVER_PA, float("inf")]),
    )
    def read_one_channel_off(self, channel, value_pa):
        pressure_pa = self.decision.setpoint_gauge_pa.copy()
        pressure_pa[channel] = value_pa
        self.read(pressure_pa)

    @rule(steps=st.sampled_from([1, 2, 5]))
    def follow_the_setpoints(self, steps):
        for _ in range(steps):
            self.pass_time(0.1)
            self.read(self.arbiter.tick(self.time_s).setpoint_gauge_pa)

    @rule(channel=st.integers(0, 15))
    def read_too_much(self, channel):
        pressure_pa = np.zeros(16)
        pressure_pa[channel] = OVER_PA + 1.0
        self.read(pressure_pa)

    @rule(name=st.sampled_from(["auto", *MODE_NAMES]))
    def grasp(self, name):
        """A grasp as it should go: whole parts, vented chambers, an object in view, valves that follow."""
        self.make_idle()
        for _ in range(2):  # what was somewhere else a moment ago is not closed upon
            self.pass_time(0.1)
            self.read(np.zeros(16))
            self.arbiter.observe_detections(self.time_s, [graspable])
        if name == "auto":
            self.request_auto()
        else:
            self.request_mode(name)
        for _ in range(5):
            self.follow_the_setpoints(1)
        assert self.arbiter.tick(self.time_s).phase is Phase.HOLDING

    def read(self, pressure_pa):
        if np.any(np.isfinite(pressure_pa) & (pressure_pa > OVER_PA)):
            self.latched = self.must_vent = True
        self.arbiter.observe_pressures(self.time_s, pressure_pa)

    @rule(seen=st.one_of(st.just([graspable]), st.lists(objects, max_size=3)))
    def see(self, seen):
        self.arbiter.observe_detections(self.time_s, seen)

    @rule(source=st.sampled_from(HEALTH_SOURCES), well=st.booleans(), air_on=st.booleans())
    def report_health(self, source, well, air_on):
        self.watch.report(self.time_s, source, well, "broken", air_on)
        self.unheard_s[source] = 0.0

    @rule(source=st.sampled_from(HEALTH_SOURCES), right=st.booleans())
    def hear_signs_of_life(self, source, right):
        if right:
            self.watch.find_right(source)
            self.wrong.discard(source)
        else:
            self.watch.find_wrong(self.time_s, source, "no sign of life")
            self.wrong.add(source)

    @rule()
    def vent_at_the_valves(self):
        self.arbiter.observe_vent(self.time_s, "asked for")
        self.latched = self.must_vent = True

    @rule(touching=st.booleans())
    def report_contact(self, touching):
        self.arbiter.observe_contact(self.time_s, touching)

    @rule(name=st.sampled_from([*MODE_NAMES, "hug"]), asked_pa=st.none() | st.floats(1e3, 2e5))
    def request_mode(self, name, asked_pa=None):
        pressure_of = None if asked_pa is None else lambda mode, own_pa: asked_pa
        self.check_request(self.arbiter.request_mode(name, self.time_s, pressure_of), Source.OPERATOR)

    @rule()
    def request_auto(self):
        self.check_request(self.arbiter.request_auto(self.time_s), Source.CAMERA)

    def check_request(self, answer, source):
        before, after = self.decision, self.arbiter.tick(self.time_s)
        assert answer.reason
        if answer.accepted:
            assert (after.phase, after.source) == (Phase.CLOSING, source)
            assert not self.latched
            # Transitions of the time passed may have come first, but never from holding straight to idle.
            if before.phase in (Phase.CLOSING, Phase.HOLDING):
                assert before.source < source

    @rule()
    def release(self):
        assert self.arbiter.release(self.time_s).accepted
        decision = self.arbiter.tick(self.time_s)
        assert not decision.setpoint_gauge_pa.any()
        assert decision.phase in (Phase.IDLE, Phase.RELEASING, Phase.FAULT)

    @rule()
    def stop(self):
        assert self.arbiter.stop(self.time_s).accepted
        self.latched = self.must_vent = True

    @rule()
    def reset(self):
        self.arbiter.tick(self.time_s)
        objection = self.arbiter.objection_to_reset(self.time_s)
        answer = self.arbiter.reset(self.time_s)
        assert answer.accepted == (objection is None) and objection in (None, answer.reason)
        if answer.accepted:
            assert self.arbiter.tick(self.time_s).phase is Phase.IDLE
            self.latched = self.must_vent = False

    @precondition(lambda self: self.decision.phase is not Phase.IDLE)
    @rule()
    def stop_then_vent_then_reset_always_ends_idle(self):
        self.make_idle()

    def make_idle(self):
        self.stop()
        for source in HEALTH_SOURCES:
            self.hear_signs_of_life(source, right=True)
            self.report_health(source, well=True, air_on=False)  # the air may come on after the reset only
        self.pass_time(0.01)
        self.read(np.zeros(16))
        answer = self.arbiter.reset(self.time_s)
        assert answer.accepted, answer.reason
        for source in HEALTH_SOURCES:
            self.report_health(source, well=True, air_on=True)
        self.latched = self.must_vent = False
        self.decision = self.arbiter.tick(self.time_s)
        assert self.decision.phase is Phase.IDLE

    @invariant()
    def the_decision_is_safe(self):
        if not hasattr(self, "arbiter"):
            return
        self.watch.look(self.time_s)
        self.decision = decision = self.arbiter.tick(self.time_s)
        if max(self.unheard_s.values()) > SILENCE_S or self.wrong:
            assert decision.phase not in (Phase.CLOSING, Phase.HOLDING)
        setpoint_pa = decision.setpoint_gauge_pa
        assert setpoint_pa.shape == (16,)
        assert np.all(np.isfinite(setpoint_pa)) and np.all((setpoint_pa >= 0.0) & (setpoint_pa <= LIMIT_PA))
        if self.latched:
            assert decision.phase is Phase.FAULT
        if self.must_vent:
            assert decision.air is Air.VENT
        self.latched |= decision.phase is Phase.FAULT
        if decision.air is Air.VENT or decision.phase in (Phase.IDLE, Phase.RELEASING):
            assert not setpoint_pa.any()
        else:
            assert setpoint_pa.any()
        assert (decision.phase is Phase.FAULT) == (decision.source is Source.SAFETY)
        assert (decision.air is Air.REGULATE) == (decision.phase is not Phase.FAULT)
        assert decision.reason and all(isinstance(value, str) for value in decision.key_values().values())
        assert not self.arbiter.tick(self.time_s).changed


TestArbiter = ArbiterMachine.TestCase
TestArbiter.settings = settings(max_examples=150, stateful_step_count=40, deadline=None, derandomize=True)
