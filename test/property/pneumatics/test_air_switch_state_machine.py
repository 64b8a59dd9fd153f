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
        self.pressure_pa = np.zeros(16)

    @rule(pressure_pa=st.lists(st.floats(-1e4, 1.5 * OVER_PA) | st.just(float("nan")), min_size=16, max_size=16))
    def read(self, pressure_pa):
        self.pressure_pa = np.array(pressure_pa)

    @rule(setpoint_pa=st.lists(st.sampled_from([0.0, 50e3, LIMIT_PA]) | st.floats(-1e4, 2e5), min_size=16, max_size=16))
    def request(self, setpoint_pa):
        try:
            self.switch.request(setpoint_pa)
        except SetpointError:
            return
        self.has_setpoints = True

    @rule(air=st.sampled_from(Air))
    def obey(self, air):
        self.switch.obey(air)
        if (self.told, air) != (Air.VENT, Air.HOLD):
            self.told = air

    @rule(on=st.booleans())
    def turn(self, on):
        accepted = self.switch.switch(on).accepted
        assert accepted or on
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
        if self.told is Air.VENT:
            assert (openings == -1.0).all()
        if self.told is not Air.REGULATE or not self.may_fill or not self.has_setpoints:
            assert (openings <= 0.0).all()
        calm = self.pressure_pa <= OVER_PA - CONFIG.over_pressure_release_pa
        if self.told is Air.HOLD or (self.told is Air.REGULATE and not (self.may_fill and self.has_setpoints)):
            assert not openings[calm].any()


TestAirSwitch = AirMachine.TestCase
TestAirSwitch.settings = settings(max_examples=100, stateful_step_count=30, deadline=None, derandomize=True)
