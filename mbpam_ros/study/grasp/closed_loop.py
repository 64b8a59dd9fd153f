"""The whole gripper without ROS: plant, transducers, sensing, arbitration and pressure loops, tick after tick.

The same objects that the nodes wrap, in the order in which their messages follow each other. What the camera would see
is taken from the plant.
"""

from __future__ import annotations

import dataclasses

from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.arbitration import Arbiter, Decision, load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.selection import DetectedObject, ModeSelector
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.plant import Observation, build_plant
from mbpam_ros.plant.scene import Scene
from mbpam_ros.pneumatics.air_switch import AirSwitch
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.controller import PressureController
from mbpam_ros.pneumatics.sensing import PressureSensing

TICK_S = 0.01
"""Period of sensing, arbitration and valves: the nodes' 100 Hz."""


class ClosedLoop:
    """A gripper in front of the object of a scene, air on, open.

    Args:
        scene: what is there; with an object.
        gripper: the muscles and where they stand.
        grip_pressure_gauge_pa: of every mode; none for those of ``grasp.yaml``.
        seed: of the transducers' noise. The same seed gives the same bits.

    Raises:
        ConfigError: a file is wrong, the scene has no object, or the grip pressure is above the gripper's limit.
        TierError: no such tier, or it cannot compute what the scene holds.
    """

    def __init__(
        self, scene: Scene, gripper: Gripper, grip_pressure_gauge_pa: float | None = None, seed: int = 0
    ) -> None:
        if scene.object is None:
            raise ConfigError(f"scene {scene.name}: nothing to grasp; name an object in it")
        self._object = scene.object
        pneumatics, grasp, modes = load_pneumatics(), load_grasp_config(), load_modes()
        arbitration = grasp.arbitration
        if grip_pressure_gauge_pa is not None:
            grip = dataclasses.replace(
                arbitration.grip_pressure_gauge_pa, **dict.fromkeys(modes, grip_pressure_gauge_pa)
            )
            arbitration = dataclasses.replace(arbitration, grip_pressure_gauge_pa=grip)
        limits = gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
        try:
            self._arbiter = Arbiter(arbitration, modes, ModeSelector(grasp.selection, gripper, modes), *limits)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        self._plant = build_plant(scene, gripper, pneumatics, seed=seed)
        self._sensing = PressureSensing(pneumatics.sensing, pneumatics.transducer)
        self._controller = PressureController(pneumatics.controller, *limits)
        self._switch = AirSwitch(self._controller, switched_on=True)
        self.seen: Observation = self._plant.observe()
        self.decision: Decision = self._arbiter.tick(self.seen.time_s)

    def tick(self) -> Observation:
        """Advance everything by :data:`TICK_S` and return what there is then; also in ``seen`` and ``decision``.

        Raises:
            PlantDivergedError: the plant left what can be.
        """
        now_s = self.seen.time_s
        pressure_gauge_pa = self._sensing.update(now_s, self.seen.transducer_v).pressure_gauge_pa
        self._arbiter.observe_pressures(now_s, pressure_gauge_pa)
        self.decision = self._arbiter.tick(now_s)
        self._switch.obey(self.decision.air)
        self._switch.request(self.decision.setpoint_gauge_pa)
        self._plant.step(self._controller.update(now_s, pressure_gauge_pa), TICK_S)
        self.seen = self._plant.observe()
        return self.seen

    def grasp(self) -> Answer:
        """Close in the mode that the camera's rules choose for the object where it is now."""
        pose = self.seen.object_in_gripper
        target = DetectedObject(
            label=self._object.label,
            shape=self._object.shape,
            size_m=self._object.size_m,
            position_m=tuple(pose.position_m),
            orientation_xyzw=tuple(pose.orientation_xyzw),
            confidence=1.0,
        )
        self._arbiter.observe_detections(self.seen.time_s, [target])
        answer = self._arbiter.request_auto(self.seen.time_s)
        self.decision = self._arbiter.tick(self.seen.time_s)
        return answer

    def lift(self) -> None:
        """Start raising the hand."""
        self._plant.lift()
