"""The simulated gripper behind one face: reset, step, observe."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.calibration import Calibration
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.actuator.hysteresis import felt_pressure
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import load_config
from mbpam_ros.errors import MbpamError
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest
from mbpam_ros.plant.lift import HandLift
from mbpam_ros.plant.placement import placed
from mbpam_ros.plant.planner import choose_fidelity
from mbpam_ros.plant.scene import Scene
from mbpam_ros.plant.tiers.base import (
    Actuation,
    BodyForces,
    BodyState,
    PlantConfig,
    PlantDivergedError,
    Tier,
)
from mbpam_ros.plant.tiers.registry import build_tier
from mbpam_ros.pneumatics.chamber import PneumaticModel
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.pneumatics.machine_faults import MachineFault, MachineFaults
from mbpam_ros.pneumatics.registry import build_pneumatics
from mbpam_ros.pneumatics.transducer import Transducer

Array = NDArray[np.float64]


class GravityError(MbpamError, ValueError):
    """No vector of gravity. Nothing was changed."""


class StepSizeError(MbpamError, ValueError):
    """A step that is not a whole multiple of the plant's sub-step. Nothing was changed."""


@dataclass(frozen=True)
class SeenObject:
    """One of the objects of a scene.

    Args:
        name: its own in the scene.
        in_world: pose and velocity, world frame.
        in_gripper: the same seen from the hand, in ``gripper_base``.
        forces: of fingers, supports, palm and other objects on it.
    """

    name: str
    in_world: BodyState
    in_gripper: BodyState
    forces: BodyForces


@dataclass(frozen=True)
class Observation:
    """What can be known of the plant after a step. World frame: ``gripper_base`` at the start, z down.

    Args:
        time_s: simulated time since reset.
        pressure_gauge_pa: true chamber pressures, shape (16,).
        transducer_v: their transducers' volts, shape (16,), with noise and quantisation.
        bend_rad, bend_rate_rad_s: of the muscles' tips, as in :class:`~mbpam_ros.plant.tiers.base.TierState`,
            shape (4, 2).
        centreline_m: points of the fingers' centre lines in ``gripper_base``, clamp to tip, shape (4, n, 3).
        hand_lift_m: rise of the hand.
        object_in_world: pose and velocity of the first object, world frame; none without an object.
        object_in_gripper: the same seen from the hand, in ``gripper_base``.
        finger_force_n: force of each finger on the first object, world frame, shape (4, 3).
        support_force_n, palm_force_n: force of the support and of the palm on it, world frame, shape (3,).
        objects: all of them, the first too.
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
    objects: tuple[SeenObject, ...] = ()


def build_plant(
    scene: Scene,
    fidelity: Fidelity | FidelityRequest,
    gripper: Gripper,
    pneumatics: PneumaticsConfig | None = None,
    config: PlantConfig | None = None,
    seed: int = 0,
) -> Plant:
    """Return the plant of a scene, reset.

    Args:
        scene: what is there.
        fidelity: how it is computed; what is asked for is first made one (:mod:`~mbpam_ros.plant.planner`).
        gripper: the muscles and where they stand.
        pneumatics: supply, valves, transducers; by default ``pneumatics.yaml``.
        config: constants of muscles and contacts; by default ``plant.yaml``.
        seed: of the transducers' noise. The same seed and steps give the same bits.

    Raises:
        ConfigError: a file is wrong, an object starts inside a support, the palm, a finger or another object, or no
            plan fits the scene.
        TierError: no such tier, or it cannot compute what the scene holds.
        PneumaticsInputError: no such pneumatic model.
    """
    pneumatics = load_pneumatics() if pneumatics is None else pneumatics
    config = load_config(PlantConfig, "plant.yaml") if config is None else config
    if isinstance(fidelity, FidelityRequest):
        fidelity = choose_fidelity(scene, fidelity, gripper.geometry.length_m)
    return Plant(
        tier=build_tier(placed(scene, gripper, config, fidelity.contact), fidelity),
        calibration=gripper.calibration(),
        chambers=build_pneumatics(fidelity.pneumatics or pneumatics.model, pneumatics.chamber, gripper.gas_law),
        pneumatics=pneumatics,
        lift=HandLift(scene.lift),
        sub_step_s=fidelity.sub_step_s,
        seed=seed,
        object_names=tuple(placed.object.name for placed in scene.placed),
    )


class Plant:
    """Valves, chambers, muscles, objects and arm of one scene. Build it with :func:`build_plant`."""

    def __init__(
        self,
        tier: Tier,
        calibration: Calibration,
        chambers: PneumaticModel,
        pneumatics: PneumaticsConfig,
        lift: HandLift,
        sub_step_s: float,
        seed: int,
        object_names: tuple[str, ...] = (),
    ) -> None:
        self._object_names = object_names
        self._tier, self._law, self._chambers, self._lift = tier, calibration.law, chambers, lift
        self._hysteresis_pa = calibration.hysteresis_pa
        self._pneumatics, self._seed = pneumatics, seed
        self.sub_step_s = sub_step_s
        self.reset()

    def reset(self) -> None:
        """Put everything back to the start: vented, at rest, hand down, objects in place, noise from its seed."""
        self._sub_steps = 0
        self._failure: str | None = None
        self._lift.reset()
        self._chambers.reset()
        self._pressure = self._chambers.pressure_gauge_pa
        self._felt_pa = np.full((FINGER_COUNT, CHAMBERS_PER_FINGER), np.nan)
        self._tier.reset(self._actuation(self._pressure))
        self._transducer = Transducer(self._pneumatics.transducer, CHANNEL_COUNT, self._seed)
        supply_pa = self._pneumatics.chamber.supply_gauge_pa
        self._faults = MachineFaults(self._pneumatics.transducer, supply_pa, self._seed)
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
    def pressure_gauge_pa(self) -> Array:
        """True chamber pressures after the last step, shape (16,), without the cost of :meth:`observe`."""
        return self._pressure.copy()

    @property
    def hand_lift_m(self) -> float:
        """Rise of the hand [m]."""
        return float(self._lift.motion(self.time_s)[0])

    def step(self, spool: ArrayLike, dt_s: float, supply_open: bool = True) -> None:
        """Hold the spool commands, shape (16,) in [-1, 1], for ``dt_s``, and the supply's valve open or shut.

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
        pressure = self._move_air(spool, dt_s, supply_open, bend)
        ends_s = (self._sub_steps + np.arange(count + 1)) * self.sub_step_s
        try:
            self._tier.step(self._actuation(pressure), *self._lift.motion(ends_s))
        except PlantDivergedError as error:
            self._failure = f"diverged at {self.time_s:.3f} s: {error}"
            raise PlantDivergedError(self._failure) from error
        self._sub_steps += count
        self._pressure = pressure
        if self._faults:
            self._volts = self._faults.measure(self._transducer, pressure, dt_s)
        else:
            self._volts = self._transducer.measure(pressure)

    def _move_air(self, spool: ArrayLike, dt_s: float, supply_open: bool, bend: dict[str, Array]) -> Array:
        """Move the air, through what faults the machine has; return the pressures."""
        if not self._faults:
            self._chambers.feed(supply_open)
            return self._chambers.step(spool, dt_s, **bend)
        self._faults.feed(self._chambers, supply_open)
        self._chambers.step(self._faults.command(np.asarray(spool, dtype=float), dt_s), dt_s, **bend)
        self._faults.seep(self._chambers, dt_s)
        return self._chambers.pressure_gauge_pa

    @property
    def supply_gauge_pa(self) -> float:
        """Pressure before the valves [Pa gauge]."""
        return self._chambers.supply_gauge_pa

    def inject(self, fault: MachineFault) -> None:
        """Let a fault befall the machine as it is now; it stays until :meth:`repair`."""
        self._faults.inject(fault, self._chambers.spool, self._pressure, self._volts)

    def repair(self) -> None:
        """Mend all faults that were injected."""
        self._faults.repair()

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
        objects = tuple(
            SeenObject(name, body, _from_hand(body, height, velocity), forces)
            for name, body, forces in zip(self._object_names, state.bodies, state.body_forces, strict=True)
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
            object_in_gripper=objects[0].in_gripper if objects else None,
            finger_force_n=state.finger_force_n,
            support_force_n=state.support_force_n,
            palm_force_n=state.palm_force_n,
            objects=objects,
        )

    def _count_sub_steps(self, dt_s: float) -> int:
        count = round(dt_s / self.sub_step_s) if math.isfinite(dt_s) else 0
        if count < 1 or abs(count * self.sub_step_s - dt_s) > 1e-6 * self.sub_step_s:
            raise StepSizeError(
                f"dt_s = {dt_s:g} s is not a whole multiple of the plant's sub-step of {self.sub_step_s:g} s"
            )
        return count

    def set_gravity(self, gravity_m_s2: ArrayLike) -> None:
        """Let gravity act as this vector from now on, also after a reset: a hand that an arm tilts.

        Args:
            gravity_m_s2: in ``gripper_base``, shape (3,), finite.

        Raises:
            GravityError: another shape, or a value that is not finite; nothing was changed.
            TierError: the tier keeps the gravity it was built with.
        """
        vector = np.array(gravity_m_s2, dtype=float)
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise GravityError(f"gravity must be three finite numbers in m/s2, found {gravity_m_s2!r}")
        self._tier.set_gravity(vector)

    def _actuation(self, pressure_gauge_pa: Array) -> Actuation:
        pressure = pressure_gauge_pa.reshape(FINGER_COUNT, CHAMBERS_PER_FINGER)
        pressure = self._felt_pa = felt_pressure(self._felt_pa, pressure, self._hysteresis_pa)
        strain = self._law.strain_law(pressure) if self._tier.has_strain else None
        return Actuation(*self._law.moment_and_stiffness(pressure), strain)


def _from_hand(body: BodyState, height_m: float, velocity_m_s: float) -> BodyState:
    """Return what is seen from the hand: ``gripper_base`` keeps its axes and moves along -z."""
    return dataclasses.replace(
        body,
        position_m=body.position_m + (0.0, 0.0, height_m),
        velocity_m_s=body.velocity_m_s + (0.0, 0.0, velocity_m_s),
    )
