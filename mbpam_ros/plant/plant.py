"""The simulated gripper behind one face: reset, step, observe."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.calibration import calibrated_rod_law
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.actuator.rod_law import RodLaw
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError, load_config
from mbpam_ros.errors import MbpamError
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.clearance import finger_clearance_m
from mbpam_ros.plant.fidelity import Tolerance
from mbpam_ros.plant.lift import HandLift
from mbpam_ros.plant.planner import planned_scene
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.solids import half_height
from mbpam_ros.plant.tiers import (
    Actuation,
    BodyState,
    PlantConfig,
    PlantDivergedError,
    RigidBody,
    Tier,
    TierSetup,
    build_tier,
)
from mbpam_ros.pneumatics.chamber import PneumaticModel
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.pneumatics.registry import build_pneumatics
from mbpam_ros.pneumatics.transducer import Transducer

Array = NDArray[np.float64]

REST_TOLERANCE_M = 0.002
"""How deep in a support anything may start."""


class StepSizeError(MbpamError, ValueError):
    """A step that is not a whole multiple of the plant's sub-step. Nothing was changed."""


@dataclass(frozen=True)
class Observation:
    """What can be known of the plant after a step. World frame: ``gripper_base`` at the start, z down.

    Args:
        time_s: simulated time since reset.
        pressure_gauge_pa: true chamber pressures, shape (16,).
        transducer_v: their transducers' volts, shape (16,), with noise and quantisation.
        bend_rad, bend_rate_rad_s: of the muscles' tips, as in :class:`~mbpam_ros.plant.tiers.TierState`, shape (4, 2).
        centreline_m: points of the fingers' centre lines in ``gripper_base``, clamp to tip, shape (4, n, 3).
        hand_lift_m: rise of the hand.
        object_in_world: pose and velocity of the object, world frame; none without an object.
        object_in_gripper: the same seen from the hand, in ``gripper_base``.
        finger_force_n: force of each finger on the object, world frame, shape (4, 3).
        support_force_n, palm_force_n: force of the support and of the palm on the object, world frame, shape (3,).
    """

    time_s: float
    pressure_gauge_pa: Array
    transducer_v: Array
    bend_rad: Array
    bend_rate_rad_s: Array
    centreline_m: Array
    hand_lift_m: float
    object_in_world: BodyState | None
    object_in_gripper: BodyState | None
    finger_force_n: Array
    support_force_n: Array
    palm_force_n: Array


def build_plant(
    scene: Scene,
    gripper: Gripper,
    pneumatics: PneumaticsConfig | None = None,
    config: PlantConfig | None = None,
    seed: int = 0,
) -> Plant:
    """Return the plant of a scene, reset.

    Args:
        scene: what is there; with the tier ``auto`` it is computed as planned (:mod:`~mbpam_ros.plant.planner`).
        gripper: the muscles and where they stand.
        pneumatics: supply, valves, transducers; by default ``pneumatics.yaml``.
        config: constants of muscles and contacts; by default ``plant.yaml``.
        seed: of the transducers' noise. The same seed and steps give the same bits.

    Raises:
        ConfigError: a file is wrong, the object starts inside its support, the palm or a finger, or no plan fits the
            scene.
        TierError: no such tier, or it cannot compute what the scene holds.
        PneumaticsInputError: no such pneumatic model.
    """
    pneumatics = load_pneumatics() if pneumatics is None else pneumatics
    config = load_config(PlantConfig, "plant.yaml") if config is None else config
    scene = planned_scene(scene, gripper.geometry.length_m)
    setup = _tier_setup(scene, gripper, config)
    return Plant(
        tier=build_tier(scene.config.tier, setup),
        law=calibrated_rod_law(gripper.design, gripper.geometry, gripper.metamodel, gripper.target),
        chambers=build_pneumatics(scene.config.pneumatics or pneumatics.model, pneumatics.chamber),
        pneumatics=pneumatics,
        lift=HandLift(scene.config.lift),
        sub_step_s=scene.config.planned_sub_step_s,
        seed=seed,
    )


class Plant:
    """Valves, chambers, muscles, object and arm of one scene. Build it with :func:`build_plant`."""

    def __init__(
        self,
        tier: Tier,
        law: RodLaw,
        chambers: PneumaticModel,
        pneumatics: PneumaticsConfig,
        lift: HandLift,
        sub_step_s: float,
        seed: int,
    ) -> None:
        self._tier, self._law, self._chambers, self._lift = tier, law, chambers, lift
        self._pneumatics, self._seed = pneumatics, seed
        self.sub_step_s = sub_step_s
        self.reset()

    def reset(self) -> None:
        """Put everything back to the start: vented, at rest, hand down, object in place, noise from its seed."""
        self._sub_steps = 0
        self._failure: str | None = None
        self._lift.reset()
        self._tier.reset()
        self._chambers.reset()
        self._pressure = self._chambers.pressure_gauge_pa
        self._actuation = self._actuate(self._pressure)
        self._transducer = Transducer(self._pneumatics.transducer, CHANNEL_COUNT, self._seed)
        self._volts = self._transducer.measure(self._pressure)

    @property
    def time_s(self) -> float:
        """Simulated time since reset [s]."""
        return self._sub_steps * self.sub_step_s

    @property
    def transducer_v(self) -> Array:
        """The transducers' volts after the last step, shape (16,), without the cost of :meth:`observe`."""
        return self._volts.copy()

    @property
    def hand_lift_m(self) -> float:
        """Rise of the hand [m]."""
        return float(self._lift.motion(self.time_s)[0])

    def step(self, spool: ArrayLike, dt_s: float) -> None:
        """Hold the spool commands, shape (16,) in [-1, 1], for ``dt_s``.

        Pressures act on the muscles as a straight line between the ends of the step.

        Raises:
            StepSizeError: ``dt_s`` is not a whole multiple of the sub-step.
            PneumaticsInputError: spool commands that cannot be; nothing was changed.
            PlantDivergedError: the state left what can be. The last good state stays to be observed, and every
                further step raises again until :meth:`reset`.
        """
        if self._failure is not None:
            raise PlantDivergedError(f"{self._failure} Reset the plant.")
        count = self._count_sub_steps(dt_s)
        bend = {"bend_rad": self._tier.state().bend_rad} if self._chambers.has_volume else {}
        pressure = self._chambers.step(spool, dt_s, **bend)
        actuation = self._actuate(pressure)
        ends_s = (self._sub_steps + np.arange(count + 1)) * self.sub_step_s
        try:
            self._tier.step(self._actuation, actuation, *self._lift.motion(ends_s))
        except PlantDivergedError as error:
            self._failure = f"diverged at {self.time_s:.3f} s: {error}"
            raise PlantDivergedError(self._failure) from error
        self._sub_steps += count
        self._pressure, self._actuation = pressure, actuation
        self._volts = self._transducer.measure(pressure)

    def lift(self) -> Answer:
        """Start raising the hand; refused while it moves or when it is up."""
        return self._lift.raise_hand(self.time_s)

    def lower(self) -> Answer:
        """Start lowering the hand; refused while it moves or when it is down."""
        return self._lift.lower_hand(self.time_s)

    def observe(self) -> Observation:
        """Return the present state; asking twice gives the same."""
        state = self._tier.state()
        height, velocity = (float(value) for value in self._lift.motion(self.time_s))
        seen = None
        if state.body is not None:
            # gripper_base keeps its axes and moves along -z.
            seen = dataclasses.replace(
                state.body,
                position_m=state.body.position_m + (0.0, 0.0, height),
                velocity_m_s=state.body.velocity_m_s + (0.0, 0.0, velocity),
            )
        return Observation(
            time_s=self.time_s,
            pressure_gauge_pa=self._pressure.copy(),
            transducer_v=self._volts.copy(),
            bend_rad=state.bend_rad,
            bend_rate_rad_s=state.bend_rate_rad_s,
            centreline_m=state.centreline_m,
            hand_lift_m=height,
            object_in_world=state.body,
            object_in_gripper=seen,
            finger_force_n=state.finger_force_n,
            support_force_n=state.support_force_n,
            palm_force_n=state.palm_force_n,
        )

    def _count_sub_steps(self, dt_s: float) -> int:
        count = round(dt_s / self.sub_step_s) if math.isfinite(dt_s) else 0
        if count < 1 or abs(count * self.sub_step_s - dt_s) > 1e-6 * self.sub_step_s:
            raise StepSizeError(
                f"dt_s = {dt_s:g} s is not a whole multiple of the plant's sub-step of {self.sub_step_s:g} s"
            )
        return count

    def _actuate(self, pressure_gauge_pa: Array) -> Actuation:
        return Actuation(*self._law.moment_and_stiffness(pressure_gauge_pa.reshape(FINGER_COUNT, CHAMBERS_PER_FINGER)))


def _tier_setup(scene: Scene, gripper: Gripper, config: PlantConfig) -> TierSetup:
    overrides = {
        name: value
        for name, value in (
            ("friction_coefficient", scene.config.friction_coefficient),
            ("stiffness_n_m", scene.config.contact_stiffness_n_m),
        )
        if value is not None
    }
    config = dataclasses.replace(config, finger_object=dataclasses.replace(config.finger_object, **overrides))
    support = scene.config.support
    planes = np.empty((0, 3)) if support is None else support.planes_m
    if len(planes) and planes[-1, 0] < gripper.geometry.length_m - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the table is {planes[-1, 0]:g} m under the palm, the hanging muscles reach "
            f"{gripper.geometry.length_m:g} m; use a deeper table, or a slim stand on one (half_size_m, stand_height_m)"
        )
    body = _body(scene)
    if body is not None and scene.config.contact:
        _refuse_inside_a_finger(scene, body, gripper)
    tolerance = scene.config.tolerance or Tolerance()
    return TierSetup(
        geometry=gripper.geometry,
        finger_base_m=gripper.finger_base_m,
        gravity_m_s2=scene.config.gravity_m_s2,
        sub_step_s=scene.config.planned_sub_step_s,
        body=body,
        planes_m=planes,
        config=config,
        modes=scene.config.modes,
        fingers_touch=scene.config.fingers_touch,
        air_modes=scene.config.air_modes,
        moving_fingers=scene.config.moving_fingers,
        contact=scene.config.contact,
        largest_jump_m=1e-2 * tolerance.static_pct * gripper.geometry.active_length_m,
    )


def _body(scene: Scene) -> RigidBody | None:
    spec, support = scene.object, scene.config.support
    if spec is None:
        return None
    position, orientation = np.array(scene.config.object_position_m), scene.object_orientation_xyzw
    reach = half_height(spec.shape, spec.size_m, orientation)
    if position[2] < reach - REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the object starts {1e3 * (reach - position[2]):.1f} mm inside the palm; "
            f"set the third of object_position_m to {reach:.4f} or more"
        )
    if support is not None:
        inside = position[2] + reach - support.depth_m
        if inside > REST_TOLERANCE_M:
            raise ConfigError(
                f"scene {scene.name}: the object starts {1e3 * inside:.1f} mm inside its support; "
                f"set support.depth_m to {support.depth_m + inside:.4f}"
            )
    return RigidBody(spec.shape, spec.size_m, spec.mass_kg, position, orientation)


def _refuse_inside_a_finger(scene: Scene, body: RigidBody, gripper: Gripper) -> None:
    clearance = finger_clearance_m(body, gripper.geometry, gripper.finger_base_m)
    finger = int(np.argmin(clearance))
    if clearance[finger] < -REST_TOLERANCE_M:
        raise ConfigError(
            f"scene {scene.name}: the object starts {-1e3 * clearance[finger]:.1f} mm inside finger {finger + 1} as it "
            "hangs; move object_position_m away from it, turn the object (object_yaw_rad), or use a smaller one"
        )
