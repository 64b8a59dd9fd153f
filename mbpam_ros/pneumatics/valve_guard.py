"""All that stands between set-points and valves: switch, loops, observers, test pulses and the supply's valve.

What is found acts here at once, in the same tick and whatever the phase of the grasp; what the grasp then does is in
the table of :mod:`~mbpam_ros.grasp.responses`:

================================================== ==================================================
found                                              at once
================================================== ==================================================
rises without its valve                            supply shut and dumped, that valve is closed
supply low                                         no valve fills
does not follow, does not vent, reading jumped,    that valve is closed
swapped, drifts, slow valve
over-pressure                                      that valve vents; supply shut if that does not help
no valid reading                                   that valve is closed
leaks, leak or drift, noisy                        the loop goes on
================================================== ==================================================
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.pneumatics.air_switch import AirSwitch
from mbpam_ros.pneumatics.assumed_valve import assumed_valve
from mbpam_ros.pneumatics.config import PneumaticsConfig
from mbpam_ros.pneumatics.controller import PressureController, ValveFault
from mbpam_ros.pneumatics.findings import Fault, Finding
from mbpam_ros.pneumatics.observer import Observer, ReadingNoise
from mbpam_ros.pneumatics.probing import Prober
from mbpam_ros.pneumatics.supply_valve import SupplyValve

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLOSED_BY = (
    Fault.RISES, Fault.NOT_FOLLOWING, Fault.NOT_VENTING, Fault.JUMPED, Fault.SWAPPED, Fault.DRIFT, Fault.SLOW_VALVE,
)  # fmt: skip
"""Faults whose channel is closed at once."""

_NONE = np.zeros(CHANNEL_COUNT, dtype=bool)
_NONE.flags.writeable = False
_GREATEST_CORRECTION = 2.5
"""A valve that fills slower against what its loop assumes does not make up for a leak."""

_OF_LOOPS = {
    ValveFault.NO_PRESSURE: (Fault.NO_READING, "no fresh valid pressure"),
    ValveFault.OVER_PRESSURE: (Fault.OVER_PRESSURE, "more than a chamber may have"),
}


class ValveCommand(NamedTuple):
    """What valves are told.

    Args:
        spool: openings, shape (16,), -1 (vent) .. 0 (closed) .. +1 (fill).
        supply_open: whether the supply's own valve is open; shut, what stands before the valves is dumped.
    """

    spool: Vector
    supply_open: bool


class GuardedValves:
    """Sixteen pressure loops that see what is wrong with the machine.

    Args:
        config: loops, observers and pulses.
        pressure_limit_gauge_pa: greatest set-point accepted.
        over_pressure_gauge_pa: a chamber above this vents at once.
        switched_on: whether the operator has the air on from the start.
        model: the pneumatic model that the machine is like; by default that of the configuration.
        gas_law: file of the chambers' volumes, for a model that knows them; None for the paper's muscle.

    Attributes:
        controller: the loops.
        switch: who may let them open a valve.

    Raises:
        ValueError: as :class:`~mbpam_ros.pneumatics.controller.PressureController`.
        ConfigError: ``gas_law`` is no law with gas volumes.
    """

    def __init__(
        self,
        config: PneumaticsConfig,
        pressure_limit_gauge_pa: float,
        over_pressure_gauge_pa: float,
        switched_on: bool = False,
        model: str | None = None,
        gas_law: Path | None = None,
    ) -> None:
        loops = config.controller
        valve = assumed_valve(model or config.model, config.chamber, loops, gas_law)
        self.controller = PressureController(loops, pressure_limit_gauge_pa, over_pressure_gauge_pa)
        self.switch = AirSwitch(self.controller, switched_on)
        self._observer = Observer(config.observer, valve, ReadingNoise.of(config.transducer, config.sensing))
        self._prober = Prober(config.probing, valve, self._observer)
        self._supply = SupplyValve()
        self._supply.open = switched_on
        self._watchdog_s, self._read_at_s = loops.watchdog_s, -math.inf
        self._supply_gauge_pa, self._least_drop_pa = loops.supply_gauge_pa, loops.least_drop_pa
        self._time_constant_s = loops.fill_time_constant_s
        self._findings: tuple[Finding, ...] = ()
        self._compensates = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with channels and supply at present."""
        return self._findings

    @property
    def parting(self) -> ValveCommand:
        """What to leave the valves with when nobody will move them afterwards."""
        return ValveCommand(np.full(CHANNEL_COUNT, self.switch.parting_opening), False)

    def update(self, time_s: float, pressure_gauge_pa: ArrayLike, late_s: float = 0.0) -> ValveCommand:
        """Return what valves are told for the measured pressures, shape (16,) [Pa gauge], NaN for no reading.

        Args:
            time_s: when they were measured.
            late_s: for how long they have waited to be taken, beyond what they always do.

        Raises:
            ControllerInputError: wrong shape or a time that is not finite.
        """
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        spool = self.controller.update(time_s, pressure)
        if np.isfinite(pressure).any():
            self._read_at_s = time_s
        self._observer.update(time_s, pressure, self._supply.open, self.controller.vented, late_s)
        target = self.controller.setpoint
        self._observer.aim(target, time_s)
        if self._observer.findings or self._compensates:
            self._compensate(pressure)
        spool = self._restrained(time_s, pressure, spool, target)
        self._observer.commanded(spool)
        return self._command(time_s, spool)

    def check(self, time_s: float) -> ValveCommand:
        """Return what valves are told when no pressures came: what a timer calls.

        Raises:
            ControllerInputError: a time that is not finite.
        """
        spool = self.controller.check(time_s)
        self._prober.abort()
        return self._command(time_s, spool)

    def _compensate(self, pressure: Vector) -> None:
        """Let loops add what leaks lose, in their own terms: by the opening that lets as much through."""
        leak_1_s = self._observer.leak_1_s
        self._compensates = bool(leak_1_s.any())
        if self._compensates:
            assumed_pa_s = np.maximum(self._supply_gauge_pa - pressure, self._least_drop_pa) / self._time_constant_s
            fills_pa_s = np.maximum(self._observer.fill_pa_s, assumed_pa_s / _GREATEST_CORRECTION)
            leak_1_s = np.where(leak_1_s > 0.0, leak_1_s * np.maximum(assumed_pa_s / fills_pa_s, 1.0), 0.0)
        self.controller.compensate(np.nan_to_num(leak_1_s))

    def _restrained(self, time_s: float, pressure: Vector, spool: Vector, target: Vector) -> Vector:
        """Return what findings and test pulses leave of the loops' openings."""
        observer = self._observer
        if self.controller.vented:
            self._prober.abort()
            return spool
        closed = _NONE
        if not observer.calm:
            closed = observer.channels(*CLOSED_BY) | observer.looked_at | observer.rising
            if closed.any():
                closed &= ~self.controller.in_over_pressure
                self.controller.restart(closed)
                spool = np.where(closed, 0.0, spool)
            if observer.supply_low:
                spool = np.minimum(spool, 0.0)
        self._probe(time_s, target, closed)
        tested = self._prober.tested
        if not np.count_nonzero(tested):
            return spool
        return np.where(tested, self._prober.openings(time_s, pressure), spool)

    def _probe(self, time_s: float, target: Vector, closed: Mask) -> None:
        """Let test pulses begin or go on where a held channel rests."""
        observer, tested = self._observer, self._prober.tested
        held = (target > 0.0) & ~closed
        if (
            observer.held_up
            or observer.supply_low
            or not (self._supply.open and self.controller.enabled and np.count_nonzero(held))
        ):
            self._prober.abort()
            return
        if not (np.count_nonzero(tested) or np.count_nonzero(self._prober.due(time_s, held, observer.in_doubt))):
            return
        read = observer.read
        at_rest = observer.at_rest & read
        ready = held & ((at_rest & self.controller.resting) | (tested & read)) & ~self.controller.in_over_pressure
        self._prober.update(time_s, ready, at_rest | tested, observer.in_doubt)

    def _command(self, time_s: float, spool: Vector) -> ValveCommand:
        faults = self.controller.faults
        supply_open = self._supply.update(
            time_s,
            switched_on=self.switch.switched_on,
            vented=self.controller.vented,
            over=ValveFault.OVER_PRESSURE in faults,
            rising=not self._observer.calm
            and bool((self._observer.rising | self._observer.channels(Fault.RISES)).any()),
            blind=time_s - self._read_at_s > self._watchdog_s,
        )
        if faults.count(ValveFault.NONE) == len(faults):
            self._findings = self._observer.findings
            return ValveCommand(spool, supply_open)
        of_loops = tuple(
            Finding(_OF_LOOPS[fault][0], (name,), _OF_LOOPS[fault][1], 1.0)
            for name, fault in zip(CHANNEL_NAMES, faults, strict=True)
            if fault in _OF_LOOPS
        )
        self._findings = (*of_loops, *self._observer.findings)
        return ValveCommand(spool, supply_open)
