"""The gripper under random use for a long time, without ROS: grasps, faults of the operator's making, ways back.

Each round puts an object and a friction at random into a scene and closes on it; while it closes or holds, with some
probability something is done that ends a grasp: a stop, a release, another mode, a vent at the valves. Then the way
back is gone, release and reset, and the gripper has to be idle and empty. What must hold at every tick is counted where
it does not, never passed over.
"""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field

import numpy as np

from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.simulation import TICK_S, Simulation

SCENES = ("bulb", "tomato", "banana", "carton", "empty")
DISTURBED = 0.5
"""Share of the grasps that something befalls."""

DISTURBANCES = ("stop", "release", "stop twice")
VENTED_PA = 5e3
BACK_WITHIN_S = 8.0
LONGEST_S = 6.0
"""A grasp is disturbed, or released, within this after it was asked for."""

OVER_LIMIT_S = 0.02
"""For so long a pressure may be 2 % above the limit."""


@dataclass
class SoakResult:
    """What came of it.

    Args:
        seed: of everything drawn.
        simulated_s, wall_s: how long it lasted, on both clocks.
        grasps, held, disturbed: how many were asked for, held before they were ended, and befallen by something.
        pressure_max_kpa: highest true pressure.
        wrong: what must not be, in words, with the simulated time and the round.
        memory_mb: resident memory of the process at the end of each tenth of the time.
    """

    seed: int
    simulated_s: float = 0.0
    wall_s: float = 0.0
    grasps: int = 0
    held: int = 0
    disturbed: int = 0
    pressure_max_kpa: float = 0.0
    wrong: list[str] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)

    def row(self) -> dict[str, object]:
        """Return it as JSON takes it."""
        return dataclasses.asdict(self)


def soak(seed: int, wall_s: float, simulated_s: float = float("inf")) -> SoakResult:
    """Use the gripper at random until ``wall_s`` of the wall clock or ``simulated_s`` have passed.

    Raises:
        MbpamError: what the simulation raises; it must not.
    """
    rng, result, began_s = np.random.default_rng(seed), SoakResult(seed), time.monotonic()
    limit_pa = load_gripper().pressure_limit_gauge_pa
    rounds = 0
    while (passed_s := time.monotonic() - began_s) < wall_s and result.simulated_s < simulated_s:
        _Round(rng, result, limit_pa, rounds).run()
        rounds += 1
        done = max(passed_s / wall_s, result.simulated_s / simulated_s)
        if done * 10.0 >= len(result.memory_mb):
            result.memory_mb.append(round(resident_mb(), 2))
    result.wall_s = round(time.monotonic() - began_s, 1)
    return result


def resident_mb() -> float:
    """Return the resident memory of this process [MB], 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", encoding="ascii") as statm:
            return int(statm.read().split()[1]) * 4096 / 1e6
    except OSError:
        return 0.0


class _Round:
    """One scene, a grasp or two in it, and the way back."""

    def __init__(self, rng: np.random.Generator, result: SoakResult, limit_pa: float, number: int) -> None:
        self._rng, self._result, self._limit_pa, self._number = rng, result, limit_pa, number
        scene, request = load_scene(SCENES[rng.integers(len(SCENES))])
        scene = dataclasses.replace(scene, friction_coefficient=float(rng.uniform(0.4, 0.8)))
        self._simulation = Simulation(scene, request.in_tier("arc"), seed=int(rng.integers(2**31)))
        self._over_s = 0.0

    def run(self) -> None:
        self._pass(0.1)
        for _ in range(int(self._rng.integers(1, 4))):
            self._grasp()
            self._go_back()
        self._result.simulated_s += self._simulation.seen.time_s

    def _grasp(self) -> None:
        simulation, rng = self._simulation, self._rng
        answer = simulation.grasp(MODE_NAMES[rng.integers(len(MODE_NAMES))])
        self._result.grasps += 1
        if not answer.accepted:
            self._wrong(f"a grasp refused while idle: {answer.reason}")
            return
        disturbed = rng.random() < DISTURBED
        until_s = simulation.seen.time_s + rng.uniform(0.05, LONGEST_S)
        while simulation.seen.time_s < until_s:
            self._tick()
            if simulation.decision.phase is Phase.FAULT:
                self._wrong(f"a fault of nobody's making: {simulation.decision.reason}")
                return
        self._result.held += simulation.decision.phase is Phase.HOLDING
        if disturbed:
            self._result.disturbed += 1
            what = DISTURBANCES[rng.integers(len(DISTURBANCES))]
            (simulation.release if what == "release" else simulation.stop)()
            if what == "stop twice":
                self._pass(0.05)
                simulation.stop()

    def _go_back(self) -> None:
        """Release, wait until vented, reset: it has to be idle then."""
        simulation = self._simulation
        simulation.release()
        until_s = simulation.seen.time_s + BACK_WITHIN_S
        while simulation.decision.phase is not Phase.IDLE:
            if simulation.seen.time_s > until_s:
                self._wrong(f"not idle {BACK_WITHIN_S:g} s after a release: {simulation.decision.reason}")
                return
            self._tick()
            if simulation.decision.phase is Phase.FAULT and self._vented():
                simulation.reset()
        if not self._vented():
            self._wrong("idle with air in a chamber")

    def _vented(self) -> bool:
        return bool((self._simulation.seen.pressure_gauge_pa < VENTED_PA).all())

    def _pass(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self._tick()

    def _tick(self) -> None:
        highest_pa = float(self._simulation.tick().pressure_gauge_pa.max())
        self._result.pressure_max_kpa = max(self._result.pressure_max_kpa, round(highest_pa / 1e3, 3))
        self._over_s = self._over_s + TICK_S if highest_pa > 1.02 * self._limit_pa else 0.0
        if self._over_s > OVER_LIMIT_S:
            self._wrong(f"{highest_pa / 1e3:.1f} kPa for {self._over_s:.2f} s")

    def _wrong(self, what: str) -> None:
        time_s = self._result.simulated_s + self._simulation.seen.time_s
        self._result.wrong.append(f"{time_s:.2f} s, round {self._number}: {what}")
