"""The whole gripper without ROS: plant, transducers, sensing, arbitration, air switch and pressure loops, tick by tick.

The same objects that the nodes wrap, in the order in which their messages follow each other. What the camera would see
is taken from the plant.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.answer import Answer
from mbpam_ros.configuration import ConfigError
from mbpam_ros.errors import MbpamError
from mbpam_ros.grasp.arbitration import (
    Arbiter,
    Decision,
    GraspConfig,
    Phase,
    build_arbiter,
    build_holding_watch,
    load_grasp_config,
)
from mbpam_ros.grasp.grip_pressure import NOTHING_EXPECTED, Expected
from mbpam_ros.grasp.holding_watch import HoldingWatch
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.plant.fidelity import Fidelity, FidelityRequest
from mbpam_ros.plant.plant import Observation, build_plant
from mbpam_ros.plant.scene import Scene, load_scene
from mbpam_ros.pneumatics.config import PneumaticsConfig, load_pneumatics
from mbpam_ros.pneumatics.findings import Finding
from mbpam_ros.pneumatics.machine_faults import MachineFault
from mbpam_ros.pneumatics.sensing import ChannelStatus, PressureSensing
from mbpam_ros.pneumatics.valve_guard import GuardedValves

TICK_S = 0.01
"""Period of sensing, arbitration and valves: the nodes' 100 Hz."""

Result = TypeVar("Result")
Value = TypeVar("Value")

_SETTLED_S, _HELD_S = 0.3, 1.0


class BatchError(MbpamError, ValueError):
    """Scenes and what is asked of each that do not fit together. Nothing was run."""


class SimulationTimeError(MbpamError, RuntimeError):
    """A duration that is no whole number of ticks, or something awaited that did not come in time."""


def grasp_and_lift(simulation: Simulation) -> Observation:
    """Rest, close upon the object that is seen, lift if it is held, stay for a second; return what there is then.

    Raises:
        PlantDivergedError: the plant left what can be.
    """
    simulation.run(_SETTLED_S)
    simulation.grasp()
    while simulation.decision.phase is Phase.CLOSING:  # the arbiter's own time limit ends it
        simulation.tick()
    if simulation.decision.phase is Phase.HOLDING:
        simulation.lift()
        simulation.run(math.ceil(round(simulation.scene.lift.duration_s / TICK_S, 6)) * TICK_S)
    return simulation.run(_HELD_S)


class Simulation:
    """A gripper in a scene, air on, open.

    Args:
        scene: what is there, or the name of a scene or scene file.
        fidelity: how it is computed; none for what the scene file says, and for a scene without one for what the
            planner chooses.
        gripper: the muscles and where they stand; by default those of ``gripper.yaml``.
        grip_pressure_gauge_pa: of every mode; none for those of ``grasp.yaml``.
        seed: of the transducers' noise. The same seed and calls give the same bits.
        expected: what is known of the object besides what is seen; with its mass the grip is as hard as that asks for.
        real_pneumatics: of the plant, where it is not what loops and judgement take it for; none for the same.
        grasp: how grasps are chosen and judged; by default ``grasp.yaml``.

    Attributes:
        seen: what there is after the last tick.
        pressure_gauge_pa: last measured, shape (16,); NaN before the first tick.
        decision: what the arbiter has decided last.
        scene: what is there.
        channel_status: what the sensing has said last of each channel; empty before the first tick.

    Raises:
        ConfigError: a file is wrong, no plan fits, or the grip pressure is above the gripper's limit.
        TierError: no such tier, or it cannot compute what the scene holds.
    """

    def __init__(
        self,
        scene: Scene | str,
        fidelity: Fidelity | FidelityRequest | None = None,
        gripper: Gripper | None = None,
        grip_pressure_gauge_pa: float | None = None,
        seed: int = 0,
        expected: Expected = NOTHING_EXPECTED,
        real_pneumatics: PneumaticsConfig | None = None,
        grasp: GraspConfig | None = None,
    ) -> None:
        scene, request = load_scene(scene) if isinstance(scene, str) else (scene, FidelityRequest())
        gripper = load_gripper() if gripper is None else gripper
        self.scene = scene
        pneumatics = load_pneumatics()
        limits = gripper.pressure_limit_gauge_pa, gripper.over_pressure_gauge_pa
        grasp = load_grasp_config() if grasp is None else grasp
        model = (fidelity or request).pneumatics or pneumatics.model
        holding = build_holding_watch(grasp, gripper, pneumatics, model)
        self._arbiter = _arbiter(gripper, grasp, grip_pressure_gauge_pa, holding)
        self._arbiter.expect(expected)
        self._plant = build_plant(scene, fidelity or request, gripper, real_pneumatics or pneumatics, seed=seed)
        self._sensing = PressureSensing(pneumatics.sensing, pneumatics.transducer)
        self._valves = GuardedValves(pneumatics, *limits, switched_on=True, model=model, gas_law=gripper.gas_law)
        self.channel_status: tuple[ChannelStatus, ...] = ()
        self.seen: Observation = self._plant.observe()
        self.pressure_gauge_pa = np.full(CHANNEL_COUNT, np.nan)
        self.decision: Decision = self._arbiter.tick(self.seen.time_s)

    def tick(self) -> Observation:
        """Advance everything by :data:`TICK_S` and return what there is then.

        Raises:
            PlantDivergedError: the plant left what can be.
        """
        now_s = self.seen.time_s
        reading = self._sensing.update(now_s, self.seen.transducer_v)
        self.channel_status, self.pressure_gauge_pa = reading.status, reading.pressure_gauge_pa
        self._arbiter.observe_findings(now_s, self._valves.findings)
        self._arbiter.observe_pressures(now_s, reading.pressure_gauge_pa)
        self.decision = self._arbiter.tick(now_s)
        self._valves.switch.obey(self.decision.air, self.decision.phase is Phase.CLOSING)
        self._valves.switch.request(self.decision.setpoint_gauge_pa)
        command = self._valves.update(now_s, reading.pressure_gauge_pa)
        self._arbiter.observe_valves(now_s, command.spool)
        self._plant.step(self._moved(command.spool), TICK_S, command.supply_open)
        self.seen = self._plant.observe()
        return self.seen

    def run(self, duration_s: float) -> Observation:
        """Advance by ``duration_s``, a whole number of ticks, and return what there is then.

        Raises:
            SimulationTimeError: no whole number of ticks, or negative. Nothing was changed.
            PlantDivergedError: the plant left what can be.
        """
        ticks = round(duration_s / TICK_S) if math.isfinite(duration_s) else -1
        if ticks < 0 or abs(ticks * TICK_S - duration_s) > 1e-9 + 1e-9 * duration_s:
            raise SimulationTimeError(f"duration {duration_s:g} s is no whole number of ticks of {TICK_S:g} s")
        for _ in range(ticks):
            self.tick()
        return self.seen

    def run_until(self, predicate: Callable[[], bool], limit_s: float = 10.0) -> Observation:
        """Advance until ``predicate`` holds, at most ``limit_s``, and return what there is then.

        Raises:
            SimulationTimeError: it did not hold in time.
            PlantDivergedError: the plant left what can be.
        """
        end_s = self.seen.time_s + limit_s
        while not predicate():
            if self.seen.time_s >= end_s:
                phase, reason = self.decision.phase.value, self.decision.reason
                raise SimulationTimeError(
                    f"not within {limit_s:g} s of simulated time; the gripper is {phase}: {reason}"
                )
            self.tick()
        return self.seen

    @classmethod
    def batch(
        cls,
        scenes: Iterable[Scene | str],
        program: Callable[[Simulation], Result] = grasp_and_lift,  # type: ignore[assignment]
        *,
        fidelity: Fidelity | FidelityRequest | None = None,
        gripper: Gripper | None = None,
        grip_pressure_gauge_pa: float | Sequence[float | None] | None = None,
        seed: int | Sequence[int] = 0,
        workers: int | None = None,
        executor: Executor | None = None,
    ) -> list[Result]:
        """Run a program in each of many scenes side by side, and return what it returns, in their order.

        Each runs in a simulation of its own and gives the same bits as alone.

        Args:
            scenes: what is there, or names, as for one simulation: sweeps of friction, mass, pose.
            program: is given each simulation, reset. For processes and Dask a function
                of a module, and what it returns must be plain enough to be sent back.
            fidelity, gripper: as for one simulation.
            grip_pressure_gauge_pa, seed: likewise, for all scenes or one for each.
            workers: threads; none for one a core. The compiled steps run side by side, the Python around them does not:
                processes or a cluster gain more where steps are few and cheap.
            executor: runs the scenes instead of threads: a ``ProcessPoolExecutor``, a Dask client's ``get_executor()``,
                or what :func:`mbpam_ros.study.executors.open_executor` gives.

        Raises:
            BatchError: no worker, or not as many pressures or seeds as scenes.
            MbpamError: the first in the order of the scenes of what a simulation or the program raised; scenes that had
                not begun are not run.
        """
        there = list(scenes)
        pressures = _one_each("grip_pressure_gauge_pa", grip_pressure_gauge_pa, len(there))
        seeds = _one_each("seed", seed, len(there))
        with _threads(workers) if executor is None else nullcontext(executor) as runs:
            futures = [
                runs.submit(_run_program, program, cls, scene, fidelity, gripper, pressure, each)
                for scene, pressure, each in zip(there, pressures, seeds, strict=True)
            ]
            try:
                return [future.result() for future in futures]
            finally:
                for future in futures:
                    future.cancel()

    # What an operator asks for; what comes of it is in ``decision``.

    def grasp(self, mode: str | None = None) -> Answer:
        """Close in a mode by name, or in the one that the camera's rules choose for the object where it is now."""
        if mode is not None:
            return self._asked(lambda time_s: self._arbiter.request_mode(mode, time_s))
        self._arbiter.observe_detections(self.seen.time_s, self._in_view())
        return self._asked(self._arbiter.request_auto)

    def release(self) -> Answer:
        """Open."""
        return self._asked(self._arbiter.release)

    def stop(self) -> Answer:
        """Vent everything at once and latch a fault."""
        return self._asked(self._arbiter.stop)

    def reset(self) -> Answer:
        """Clear a latched fault."""
        answer = self._asked(self._arbiter.reset)
        if answer.accepted:
            self._valves.switch.clear()
        return answer

    def check(self, seen: Sequence[DetectedObject] | None = None) -> Answer:
        """Ask whether the raised hand holds something.

        Args:
            seen: what the camera shows; none for what is there.
        """
        self._arbiter.observe_detections(self.seen.time_s, self._in_view() if seen is None else seen)
        return self._asked(self._arbiter.check)

    def lift(self) -> Answer:
        """Start raising the hand."""
        return self._plant.lift()

    def lower(self) -> Answer:
        """Start lowering the hand."""
        return self._plant.lower()

    # The machine

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the valves' observers have found wrong, and has not gone."""
        return self._valves.findings

    def inject(self, fault: MachineFault) -> None:
        """Let a fault befall the machine."""
        self._plant.inject(fault)

    def repair(self) -> None:
        """Mend all that was injected."""
        self._plant.repair()

    def _moved(self, spool: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the valves do, shape (16,), of what they are commanded; a study may have them err."""
        return spool

    def _asked(self, request: Callable[[float], Answer]) -> Answer:
        answer = request(self.seen.time_s)
        self.decision = self._arbiter.tick(self.seen.time_s)
        return answer

    def _in_view(self) -> list[DetectedObject]:
        return [
            DetectedObject(
                label=placed.object.label,
                shape=placed.object.shape,
                size_m=placed.object.size_m,
                position_m=tuple(there.in_gripper.position_m),
                orientation_xyzw=tuple(there.in_gripper.orientation_xyzw),
                confidence=1.0,
            )
            for placed, there in zip(self.scene.placed, self.seen.objects, strict=True)
        ]


def _run_program(
    program: Callable[[Simulation], Result],
    kind: type[Simulation],
    scene: Scene | str,
    fidelity: Fidelity | FidelityRequest | None,
    gripper: Gripper | None,
    grip_pressure_gauge_pa: float | None,
    seed: int,
) -> Result:
    return program(kind(scene, fidelity, gripper, grip_pressure_gauge_pa, seed))


def _threads(workers: int | None) -> ThreadPoolExecutor:
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    if count < 1:
        raise BatchError(f"there must be at least 1 worker, found {count}")
    return ThreadPoolExecutor(count)


def _one_each(name: str, given: Value | Sequence[Value], count: int) -> list[Value]:
    """Return a value for each scene."""
    if not isinstance(given, Sequence):
        return [given] * count
    if len(given) != count:
        raise BatchError(f"{name}: one for all scenes, or one for each of the {count}, found {len(given)}")
    return list(given)


def _arbiter(
    gripper: Gripper, grasp: GraspConfig, grip_pressure_gauge_pa: float | None, holding: HoldingWatch
) -> Arbiter:
    if grip_pressure_gauge_pa is not None:  # of every mode, and of every object
        pressures = dataclasses.replace(
            grasp.arbitration.grip_pressure_gauge_pa, **dict.fromkeys(MODE_NAMES, grip_pressure_gauge_pa)
        )
        grasp = dataclasses.replace(
            grasp,
            arbitration=dataclasses.replace(grasp.arbitration, grip_pressure_gauge_pa=pressures),
            grip=dataclasses.replace(grasp.grip, table=None),
        )
    try:
        return build_arbiter(grasp, gripper, load_modes(), holding)
    except ValueError as error:
        raise ConfigError(str(error)) from error
