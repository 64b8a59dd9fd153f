"""Whatever is asked in whatever order, no valve opens that must not."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from mbpam_ros.gripper import load_gripper
from mbpam_ros.pneumatics.air_switch import Air, AirSwitch
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import PressureController, SetpointError

GRIPPER, CONFIG = load_gripper(), load_pneumatics().controller
LIMIT_PA, OVER_PA = GRIPPER.pressure_limit_gauge_pa, GRIPPER.over_pressure_gauge_pa


class AirMachine(RuleBasedStateMachine):
    @initialize(switched_on=st.booleans())
    def start(self, switched_on):
        self.controller = PressureController(CONFIG, LIMIT_PA, OVER_PA)
        self.switch = AirSwitch(self.controller, switched_on)
        self.may_fill = switched_on
        self.told, self.has_setpoints, self.time_s = Air.REGULATE, False, 0.0
        self.latched = self.contested = self.lost = self.closing = self.barred = False
        self.pressure_pa = np.zeros(16)

    @rule(pressure_pa=st.lists(st.floats(-1e4, 1.5 * OVER_PA) | st.just(float("nan")), min_size=16, max_size=16))
    def read(self, pressure_pa):
        self.pressure_pa = np.array(pressure_pa)

    @rule(setpoint_pa=st.lists(st.sampled_from([0.0, 50e3, LIMIT_PA]) | st.floats(-1e4, 2e5), min_size=16, max_size=16))
    def request(self, setpoint_pa):
        before_pa = self.controller.setpoint
        try:
            self.switch.request(setpoint_pa)
        except SetpointError:
            np.testing.assert_array_equal(self.controller.setpoint, before_pa)
            return
        assert not (self.lost or self.contested)
        self.has_setpoints = True

    @rule(air=st.sampled_from(Air), closing=st.booleans())
    def obey(self, air, closing):
        self.switch.obey(air, closing)
        self.latched |= air is Air.VENT and self.told is not Air.VENT
        self.told, self.closing = air, closing

    @rule()
    def vent(self):
        assert self.switch.vent("asked for").accepted
        self.latched, self.closing = True, False

    @rule()
    def clear(self):
        assert self.switch.clear().accepted
        self.latched = False

    @rule(lost=st.booleans())
    def hear_of_the_arbiter(self, lost):
        self.lost = lost
        self.switch.lose_arbiter() if lost else self.switch.find_arbiter()
        if lost and self.closing:
            self.latched, self.closing = True, False

    @rule(contested=st.booleans())
    def hear_of_two(self, contested):
        self.contested = contested
        self.switch.contest("arbiters", "two" if contested else None)
        if contested and self.closing:
            self.latched, self.closing = True, False

    @rule(barred=st.booleans())
    def bar(self, barred):
        self.switch.bar("inactive") if barred else self.switch.unbar()
        self.barred, self.may_fill = barred, self.may_fill and not barred

    @rule(on=st.booleans())
    def turn(self, on):
        accepted = self.switch.switch(on).accepted
        assert accepted or on
        assert not (on and accepted and (self.lost or self.contested or self.latched or self.barred))
        if accepted:
            self.may_fill = on

    @invariant()
    def the_openings_are_safe(self):
        if not hasattr(self, "controller"):
            return
        for _ in range(2):
            self.time_s += 0.01
            openings = self.controller.update(self.time_s, self.pressure_pa)
        assert openings.shape == (16,) and (np.abs(openings) <= 1.0).all()
        assert (openings[self.pressure_pa > OVER_PA] == -1.0).all()
        vented = self.latched or self.told is Air.VENT
        assert bool(self.switch.vent_reason) == self.latched
        if vented:
            assert (openings == -1.0).all()
            assert not self.controller.setpoint.any()
        follows = self.told is Air.REGULATE and self.may_fill and self.has_setpoints and not self.contested
        if vented or not follows:
            assert (openings <= 0.0).all()
        calm = self.pressure_pa <= OVER_PA - CONFIG.over_pressure_release_pa
        if not vented and not follows:
            assert not openings[calm].any()


TestAirSwitch = AirMachine.TestCase
TestAirSwitch.settings = settings(max_examples=100, stateful_step_count=30, deadline=None, derandomize=True)
