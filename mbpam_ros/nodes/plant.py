"""Node ``plant``: the simulated gripper in place of valves, transducers and camera."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from mbpam_ros.nodes.runtime import LATCHED, NEWEST, STREAM, GripperNode, Health, NodeOptions, run  # isort: skip
import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.clock import Clock as RosClock
from rclpy.clock import ClockType
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.actuator.planar_rod import RodSolutionError
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.description.frames import HANGING_XYZW, WORLD, Frames, turned_up, up
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.log_forwarding import forward_logs
from mbpam_ros.nodes.markers import colour, finger_markers, solid_marker
from mbpam_ros.nodes.messages import JointStateForm, MessageError, direction, named_values, time_stamp
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.nodes.plant_camera import PlantCamera
from mbpam_ros.nodes.plant_rig import PlantRig, RigCamera
from mbpam_ros.nodes.transforms import FRAME_PREFIX, Placed, TransformBroadcaster
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.planner import choose_fidelity
from mbpam_ros.plant.plant import Observation, Plant, build_plant
from mbpam_ros.plant.scene import Scene, load_scene
from mbpam_ros.plant.tiers.base import PlantDivergedError, TierError
from mbpam_ros.pneumatics.chamber import PneumaticsInputError
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.findings import SUPPLY

if TYPE_CHECKING:
    from typing_extensions import Unpack

PARAMETERS = (
    Parameter("gripper", "gripper.yaml", "gripper file: muscles and layout"),
    Parameter("pneumatics", "pneumatics.yaml", "pneumatics file: supply, valves, chambers, transducers"),
    Parameter("camera", "camera.yaml", "camera file: resolution, lens and pose"),
    Parameter("scene", "bulb", "scene: a name of config/scenes or a file"),
    Parameter("tier", "", "static, arc, rod or auto (planned); empty: as the scene says"),
    Parameter("seed", 0, "seed of all noise", 0, 2**31 - 1),
    Parameter("rate_hz", 100.0, "rate of transducers and of the plant's ticks [Hz]", 10.0, 1000.0),
    Parameter("depth_camera", False, "publish camera/depth/image_raw too, with a consumer sensor's noise and holes"),
    Parameter("camera_rate_hz", 5.0, "rate of camera images [Hz]; 0: no camera", 0.0, 60.0),
    Parameter("marker_rate_hz", 10.0, "rate of the true shapes [Hz]", 0.1, 100.0),
    Parameter("command_timeout_s", 0.03, "valves close when no command came for this long [s]", 0.02, 60.0),
    Parameter("publish_clock", False, "publish simulated time on /clock"),
    Parameter("lock_step", False, "with publish_clock: tick as soon as the valves have answered the last tick"),
    Parameter("lock_step_timeout_s", 0.5, "lock step: tick after this long if no valves answer [wall s]", 0.01, 60.0),
    FRAME_PREFIX,
)

LOCK_STEP_PATIENCE_S = 10.0
"""In lock step, valves that have answered before are waited for at most this long by the wall clock: on a slow computer
they still answer, but a sample may be lost between processes."""

CATCH_UP_TICKS = 5
"""Ticks that a busy computer held up are made up for, so many at once. What a model costs in steps that take more than
half of their time is not: then time goes slower, tick by tick."""

SUPPLY_TIMEOUT_S = 0.2
"""Without a command for so long the supply's valve shuts by itself, as the valves do sooner."""

SCALE_EVERY = 10
"""The scale of a rig shows something new every so many ticks."""

SLOW_FACTOR = 0.95
"""Below this part of real time the health report warns."""

PLANT_LOGGER = "mbpam_ros.plant"
"""Says how a scene was planned, and when the plant steps between tiers."""

FINGER_RGB = (0.80, 0.82, 0.84)
PALM_SIZE_M = (0.12, 0.12, 0.01)


class PlantNode(GripperNode):
    """Adapter around the plant's one face: step, observe, reset, lift, lower."""

    def __init__(self, **node_options: Unpack[NodeOptions]) -> None:
        super().__init__("plant", PARAMETERS, **node_options)
        self._gripper = load_gripper(self.text("gripper"))
        forward_logs(PLANT_LOGGER, self.get_logger())
        self._scene, self._fidelity = self._load_scene()
        self._plant = self._build_plant()
        self._dt_s = 1.0 / self.number("rate_hz")
        self._command_timeout_s = self.number("command_timeout_s")
        self._spool = np.zeros(CHANNEL_COUNT)
        self._supply_open = False
        self._commanded_at_s = -np.inf
        self._before_reset_s = 0.0
        self._ticks = 0
        self._stamp = self.now_stamp()
        self._rate_since = (time.monotonic(), 0.0)
        self._real_time_factor = 1.0
        self._tick_cost_s = 0.0

        self._frames = Frames(self.text("frame_prefix"))
        self._transforms = TransformBroadcaster(self)
        self._rig, self._camera = self._build_eyes()
        self._camera_every = max(1, round(self.number("rate_hz") / max(self.number("camera_rate_hz"), 1e-3)))
        self._markers_every = max(1, round(self.number("rate_hz") / self.number("marker_rate_hz")))
        self._transducers = self.create_publisher(JointState, "transducers", STREAM)
        self._volts = JointStateForm(CHANNEL_NAMES)
        self._markers = self.create_publisher(MarkerArray, "plant/finger_markers", STREAM)
        self._clock_topic = self.create_publisher(Clock, "/clock", STREAM) if self.value("publish_clock") else None
        self.create_subscription(JointState, "valve_commands", self._on_valve_commands, NEWEST)
        self.create_subscription(Vector3Stamped, "gravity", self._on_gravity, NEWEST)
        self.serve(Trigger, "plant/reset", self._on_reset)
        self.serve(Trigger, "plant/lift", lambda _: self._plant.lift())
        self.serve(Trigger, "plant/lower", lambda _: self._plant.lower())
        self._lock_step = bool(self.value("lock_step"))
        self._ticks_at_timer = -1
        self._ticked_at_s = self._began_at_s = time.monotonic()
        self._answering: tuple[int, int] | None = None
        period_s = self.number("lock_step_timeout_s") if self._lock_step else self._dt_s
        self.create_timer(period_s, self._on_timer, clock=RosClock(clock_type=ClockType.STEADY_TIME))

    def health(self) -> Health:
        """WARN while slower than real time."""
        now_s = time.monotonic()
        since_s, from_s = self._rate_since
        if now_s - since_s > 0.5:
            self._real_time_factor = (self._time_s() - from_s) / (now_s - since_s)
            self._rate_since = (now_s, self._time_s())
        values = {
            "scene": self._scene.name,
            "tier": self._fidelity.tier,
            "time_s": f"{self._time_s():.3f}",
            "hand_lift_m": f"{self._plant.hand_lift_m:.4f}",
            "real_time_factor": f"{self._real_time_factor:.2f}",
        }
        if self._real_time_factor < SLOW_FACTOR:
            message = f"slower than real time: factor {self._real_time_factor:.2f}"
            return Health(DiagnosticStatus.WARN, message, values)
        return Health(message="running", values=values)

    def _load_scene(self) -> tuple[Scene, Fidelity]:
        scene, request = load_scene(self.text("scene"))
        if self.text("tier"):
            request = request.in_tier(self.text("tier"))
        tick_s = 1.0 / self.number("rate_hz")
        fidelity = choose_fidelity(scene, request, self._gripper.geometry.length_m, tick_s)
        ratio = tick_s / fidelity.sub_step_s
        if abs(ratio - round(ratio)) > 1e-6 or ratio < 1.0:
            raise ConfigError(
                f"plant: rate_hz = {self.value('rate_hz'):g} gives ticks that are not a whole multiple of the scene's "
                f"sub-step of {fidelity.sub_step_s:g} s"
            )
        if self.value("lock_step") and not self.value("publish_clock"):
            raise ConfigError("plant: lock_step needs publish_clock")
        return scene, fidelity

    def _build_plant(self) -> Plant:
        pneumatics = load_pneumatics(self.text("pneumatics"))
        try:
            return build_plant(self._scene, self._fidelity, self._gripper, pneumatics, seed=self.whole("seed"))
        except ConfigError:
            raise
        except (TierError, PneumaticsInputError) as error:
            raise ConfigError(f"scene {self._scene.name}: {error}") from error
        except (ValueError, RodSolutionError) as error:
            raise ConfigError(f"{self.value('gripper')}: no rod law for this muscle: {error}") from error

    def _build_eyes(self) -> tuple[PlantRig | None, PlantCamera | None]:
        """Return the measuring rig, if the scene has one, and the camera, if there is to be one."""
        config, with_camera = self._scene.rig, self.number("camera_rate_hz") > 0.0
        optical = self._frames.camera_optical
        scale = self.create_publisher(WrenchStamped, "scale/wrench", STREAM)
        self.create_subscription(JointState, "rig/mount", self._on_mount, LATCHED)
        if config is None:
            return None, PlantCamera(self, self._gripper, self._scene, optical) if with_camera else None
        rig = PlantRig(self, self._gripper, config, scale)
        if not with_camera:
            return rig, None
        camera = RigCamera(self, self._gripper, self._scene, optical, config.camera)
        camera.marker_rgb = config.marker_rgb
        return rig, camera

    # Ticks

    def _on_timer(self) -> None:
        """Tick; in lock step only if nothing has ticked since the last time-out and nobody is going to answer."""
        if not self._lock_step:
            due = self._ticks_due()
            if due > 0:
                self._tick(due)
        elif self._ticks == self._ticks_at_timer and not self._answer_comes():
            self._tick()
        self._ticks_at_timer = self._ticks

    def _ticks_due(self) -> int:
        """Return by how many ticks the plant is behind real time, as far as they are made up for."""
        behind = round((time.monotonic() - self._began_at_s - self._time_s()) / self._dt_s)
        most = CATCH_UP_TICKS if self._tick_cost_s < 0.5 * self._dt_s else 1
        self._began_at_s += max(behind - most, 0) * self._dt_s
        return min(behind, most)

    def _answer_comes(self) -> bool:
        """Return whether those who answered before still will: a slow computer must not change what comes out."""
        if self._answering != self._ends_of_the_loop():
            return False
        waited_s = time.monotonic() - self._ticked_at_s
        if waited_s <= LOCK_STEP_PATIENCE_S:
            return True
        self.get_logger().warning(
            f"lock step: no valve command for {waited_s:.0f} s; the plant ticks on, and this run will not repeat"
        )
        return False

    def _ends_of_the_loop(self) -> tuple[int, int]:
        """Return how many listen to the transducers, and how many command the valves."""
        return self._transducers.get_subscription_count(), self.count_publishers("valve_commands")

    def _on_valve_commands(self, message: JointState) -> None:
        try:
            openings = named_values(message, CHANNEL_NAMES, "position", optional=SUPPLY)
            if not (np.abs(openings) <= 1.0).all():
                raise MessageError("an opening that is not within -1 .. 1")
        except MessageError as error:
            self.refuse("valve_commands", error)
            return
        self._spool, self._commanded_at_s = openings[:CHANNEL_COUNT], self._time_s()
        # Who knows of no supply valve leaves its name out.
        self._supply_open = bool(openings[CHANNEL_COUNT:].min(initial=1.0) > 0.5)
        if self._lock_step and message.header.stamp == self._stamp:
            self._answering = self._ends_of_the_loop()
            self._tick()

    def _on_gravity(self, message: Vector3Stamped) -> None:
        try:
            self._plant.set_gravity(self._scene.gravity_m_s2 * direction(message, self._frames.base))
        except (MessageError, TierError) as error:
            self.refuse("gravity", error)

    def _on_mount(self, message: JointState) -> None:
        try:
            if self._rig is None:
                raise MessageError(f"scene {self._scene.name} has no rig; start the plant with scene:=rig")
            self._rig.mount(message)
        except MessageError as error:
            self.refuse("rig/mount", error)

    def _tick(self, count: int = 1) -> None:
        """Let so many ticks pass, and publish the last."""
        if self.failure is not None:
            return
        silence_s = self._time_s() - self._commanded_at_s
        if silence_s > self._command_timeout_s:
            self._spool = np.zeros(CHANNEL_COUNT)
        if silence_s > max(SUPPLY_TIMEOUT_S, self._command_timeout_s):
            self._supply_open = False
        began_s = time.thread_time()  # what the model costs, not what other processes took in between
        try:
            for _ in range(count):
                self._plant.step(self._spool, self._dt_s, self._supply_open)
        except PlantDivergedError as error:
            self.fail(error)
            return
        self._ticks, self._ticked_at_s = self._ticks + 1, time.monotonic()
        self._tick_cost_s = (time.thread_time() - began_s) / count
        try:
            self._publish_tick(count * self._dt_s)
        except RodSolutionError as error:
            self.fail(f"the muscle in the rig has no equilibrium: {error}")

    def _publish_tick(self, dt_s: float) -> None:
        if self._clock_topic is None:
            self._stamp = self.now_stamp()
        else:
            self._stamp = time_stamp(self._time_s())
            self._clock_topic.publish(Clock(clock=self._stamp))
        if self._rig is not None:
            self._rig.step(self._plant.pressure_gauge_pa[:CHAMBERS_PER_FINGER], dt_s)
            if self._ticks % SCALE_EVERY == 0:
                self._rig.weigh(self._stamp)
        if self._camera is not None:
            if self._ticks % self._camera_every == 0:
                observation = self._plant.observe()
                self._camera.expose(observation if self._rig is None else self._rig.seen(observation), self._stamp)
            self._camera.publish_finished(wait=self._lock_step)
        if self._ticks % self._markers_every == 0 and self._markers.get_subscription_count() > 0:
            self._publish_markers(self._plant.observe())
        self._transducers.publish(self._volts.filled(self._stamp, effort=self._plant.transducer_v))
        if self._transforms.active:
            palm_m = np.array([0.0, 0.0, self._plant.hand_lift_m])
            self._transforms.send(self._stamp, [Placed(WORLD, self._frames.base, palm_m, HANGING_XYZW)])

    def _time_s(self) -> float:
        """Simulated time [s]; a reset of the scene does not set it back."""
        return self._before_reset_s + self._plant.time_s

    # Truth

    def _publish_markers(self, observation: Observation) -> None:
        rise = np.array([0.0, 0.0, -observation.hand_lift_m])
        radius_m = self._gripper.geometry.outer_radius_m
        markers = finger_markers(self._stamp, WORLD, up(observation.centreline_m + rise), radius_m, FINGER_RGB)
        upright = (0.0, 0.0, 0.0, 1.0)
        palm = up(rise - (0.0, 0.0, PALM_SIZE_M[2] / 2.0))
        grey = colour((0.3, 0.3, 0.3))
        markers.append(solid_marker(self._stamp, WORLD, "palm", 0, "box", PALM_SIZE_M, palm, upright, grey))
        for k, (placed, there) in enumerate(zip(self._scene.placed, observation.objects, strict=True)):
            spec, namespace = placed.object, "object" if k == 0 else "other_object"
            pose, rgba = (
                (up(there.in_world.position_m), turned_up(there.in_world.orientation_xyzw)),
                colour(spec.colour_rgb),
            )
            markers.append(solid_marker(self._stamp, WORLD, namespace, k, spec.shape, spec.size_m, *pose, rgba))
        self._markers.publish(MarkerArray(markers=markers))

    # Services

    def _on_reset(self, _: Trigger.Request) -> Answer:
        if self.failure is not None:
            return Answer(False, f"{self.failure}; start the node anew")
        self._before_reset_s += self._plant.time_s
        self._plant.reset()
        self._spool = np.zeros(CHANNEL_COUNT)
        return Answer(True, f"scene {self._scene.name} is back at its start; set-points stand until grasp/release")


def main() -> int:
    """Run the node until a signal."""
    return run(PlantNode)


if __name__ == "__main__":
    sys.exit(main())
