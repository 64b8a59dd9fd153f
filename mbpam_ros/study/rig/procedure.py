"""How a muscle is characterised: mounted, ramped up and down, held until it has settled, and read.

A pattern is measured in two mounts, as in the paper's Fig. 3b: free, in front of the camera, and with its tip against
the plate of a scale. In each the scale is zeroed, and then every pressure is held until, over a window of time, its
reading and what is measured spread by no more than they may; what is read in that window is a set of samples. Whether
that takes a tenth of a second or ten is the muscle's own matter. At the end of each mount the scale must show nothing
again. What is off ends the measurement with one line (:class:`RigError`): nothing that follows could be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, pressurised_chambers
from mbpam_ros.errors import MbpamError

BEND, FORCE = "bend", "force"
QUANTITIES = (BEND, FORCE)
UP, DOWN = "up", "down"

DIRECTIONS = {"pdc": (0.0, 90.0, 180.0, 270.0), "psc": (45.0, 135.0, 225.0, 315.0)}
"""Azimuths [deg] in which each pattern bends; the first stands for the pattern."""


class RigError(MbpamError, RuntimeError):
    """The rig cannot measure, or no longer can; the message says what is off, where, and what to do."""


@dataclass(frozen=True)
class Reading:
    """What the rig shows at one moment.

    Args:
        time_s: of the rig's clock.
        pressure_pa: of the four chambers, gauge.
        bend_rad: of the picture.
        force_n: of the scale, as it shows it.
    """

    time_s: float
    pressure_pa: tuple[float, ...]
    bend_rad: float
    force_n: float


@dataclass(frozen=True)
class Mount:
    """How the muscle is put up.

    Args:
        pattern: ``pdc`` or ``psc``.
        azimuth_deg: of the muscle frame, that points to the right of the picture.
        quantity: :data:`BEND`, the plate away; :data:`FORCE`, the plate at the tip's right.
    """

    pattern: str
    azimuth_deg: float
    quantity: str

    def __str__(self) -> str:
        return f"{self.pattern} toward {self.azimuth_deg:g} deg, {self.quantity}"

    @property
    def chambers(self) -> NDArray[np.bool_]:
        """Which chambers bend it there, shape (4,)."""
        return pressurised_chambers(math.radians(self.azimuth_deg))


class Rig(Protocol):
    """What measures: real or simulated. Each method raises :class:`RigError` for what is off."""

    def mount(self, mount: Mount) -> None:
        """Have the muscle put up so; the chambers are vented."""

    def command(self, pressure_gauge_pa: Sequence[float]) -> None:
        """Ask for pressures in the four chambers."""

    def read(self) -> Reading:
        """Return the next reading, newer than the last one in all it holds."""


@dataclass(frozen=True)
class Plan:
    """What is measured, and when a reading counts.

    Args:
        mounts: in this order.
        pressures_kpa: rising, to ramp over, from 0 or more; down again without the last.
        repeats: ramps of each mount.
        window_s: over which readings must have settled.
        timeout_s: for settling at one pressure.
        pressure_spread_pa, pressure_error_pa: of a window, at most: from its least to its greatest, and of its mean
            from what is asked for.
        bend_spread_rad, force_spread_n: of a window, at most.
        touch_n: a free muscle puts no more than this on the scale.
        zero_shift_n: what the scale shows of nothing may have moved by so much at the end of a mount.

    Raises:
        RigError: it says nothing that could be measured.
    """

    mounts: tuple[Mount, ...]
    pressures_kpa: tuple[float, ...]
    repeats: int = 2
    window_s: float = 1.0
    timeout_s: float = 20.0
    pressure_spread_pa: float = 1500.0
    pressure_error_pa: float = 500.0
    bend_spread_rad: float = math.radians(0.8)
    force_spread_n: float = 0.006
    touch_n: float = 0.015
    zero_shift_n: float = 0.010

    def __post_init__(self) -> None:
        rises = all(low < high for low, high in zip(self.pressures_kpa, self.pressures_kpa[1:], strict=False))
        if len(self.pressures_kpa) < 2 or not rises or self.pressures_kpa[0] < 0.0:
            raise RigError("pressures must be two or more and rise from 0 or more, such as 0:100:10")
        if not self.mounts or self.repeats < 1:
            raise RigError("give a pattern to measure, and one repeat or more")

    @property
    def ramp(self) -> list[tuple[str, float]]:
        """Up and down: branch and pressure [kPa]."""
        up = [(UP, pressure) for pressure in self.pressures_kpa]
        return up + [(DOWN, pressure) for pressure in reversed(self.pressures_kpa[:-1])]


def mounts_of(
    patterns: Sequence[str], all_directions: bool = False, quantities: Sequence[str] = QUANTITIES
) -> tuple[Mount, ...]:
    """Return the mounts of patterns, in one direction each or in all.

    Raises:
        RigError: an unknown pattern or quantity.
    """
    for given, known in ((patterns, DIRECTIONS), (quantities, QUANTITIES)):
        if unknown := [name for name in given if name not in known]:
            raise RigError(f"unknown {', '.join(unknown)}; known: {', '.join(known)}")
    return tuple(
        Mount(pattern, azimuth, quantity)
        for pattern in patterns
        for azimuth in DIRECTIONS[pattern][: None if all_directions else 1]
        for quantity in quantities
    )


@dataclass(frozen=True)
class Sample:
    """One reading that counts.

    Args:
        time_s, mount, repeat, branch, set_kpa: when, how and at what it was taken; repeats from 1.
        pressure_kpa: mean of the chambers under pressure; of all at 0.
        value: bend [deg] or force [N].
    """

    time_s: float
    mount: Mount
    repeat: int
    branch: str
    set_kpa: float
    pressure_kpa: float
    value: float


def characterise(rig: Rig, plan: Plan, tell: Callable[[str], None] = lambda _: None) -> list[Sample]:
    """Return all samples of a plan.

    Args:
        rig: what measures.
        plan: what.
        tell: is told of each pressure that has settled.

    Raises:
        RigError: something is off; there are no samples then.
    """
    return [sample for mount in plan.mounts for sample in _measured(rig, plan, mount, tell)]


def _measured(rig: Rig, plan: Plan, mount: Mount, tell: Callable[[str], None]) -> Iterator[Sample]:
    rig.mount(mount)
    nothing = _settled(rig, plan, mount, 0.0)
    zero_n = float(np.mean([reading.force_n for reading in nothing]))
    for repeat in range(1, plan.repeats + 1):
        for branch, pressure_kpa in plan.ramp:
            window = _settled(rig, plan, mount, pressure_kpa)
            samples = [_sample(reading, mount, repeat, branch, pressure_kpa, zero_n) for reading in window]
            _check(window, plan, mount, pressure_kpa, zero_n)
            mean = float(np.mean([sample.value for sample in samples]))
            unit = "deg" if mount.quantity == BEND else "N"
            tell(f"{mount}, {repeat}, {branch} {pressure_kpa:g} kPa: {mean:.4g} {unit}")
            yield from samples
    after = _settled(rig, plan, mount, 0.0)
    shift_n = float(np.mean([reading.force_n for reading in after])) - zero_n
    if abs(shift_n) > plan.zero_shift_n:
        raise RigError(
            f"{mount}: without pressure the scale shows {1e3 * shift_n:+.0f} mN more at the end than at the start, at "
            f"most {1e3 * plan.zero_shift_n:.0f} are taken; let it warm up, and see that nothing leans on it"
        )


def _settled(rig: Rig, plan: Plan, mount: Mount, pressure_kpa: float) -> list[Reading]:
    """Ask for a pressure, wait until all has settled, and return the window in which it had."""
    pressed = mount.chambers
    rig.command([1e3 * pressure_kpa * on for on in pressed])
    window: list[Reading] = []
    begun_s: float | None = None
    wrong = "no reading"
    while True:
        reading = rig.read()
        begun_s = reading.time_s if begun_s is None else begun_s
        window = [each for each in window if reading.time_s - each.time_s < plan.window_s] + [reading]
        if reading.time_s - begun_s >= plan.window_s:
            found = _unrest(window, plan, mount, pressure_kpa)
            if found is None:
                return window
            wrong = found
        if reading.time_s - begun_s > plan.timeout_s:
            raise RigError(f"{mount}: not settled at {pressure_kpa:g} kPa within {plan.timeout_s:g} s: {wrong}")


def _unrest(window: list[Reading], plan: Plan, mount: Mount, pressure_kpa: float) -> str | None:
    """Return what has not settled in a window; none if all has."""
    pressures = np.array([reading.pressure_pa for reading in window])
    wanted = 1e3 * pressure_kpa * mount.chambers
    spread = np.ptp(pressures, axis=0)
    if spread.max() > plan.pressure_spread_pa:
        chamber = int(spread.argmax())
        return f"the pressure of chamber {chamber + 1} spreads by {1e-3 * spread[chamber]:.2f} kPa"
    error = np.abs(pressures.mean(axis=0) - wanted)
    if not error.max() <= plan.pressure_error_pa:
        chamber = int(error.argmax())
        return f"chamber {chamber + 1} is at {1e-3 * pressures[:, chamber].mean():.2f} kPa"
    bend = float(np.ptp([reading.bend_rad for reading in window]))
    force = float(np.ptp([reading.force_n for reading in window]))
    if mount.quantity == BEND and bend > plan.bend_spread_rad:
        return f"the bend spreads by {math.degrees(bend):.2f} deg"
    if (mount.quantity == FORCE or pressure_kpa == 0.0) and force > plan.force_spread_n:
        return f"the scale spreads by {1e3 * force:.1f} mN"
    return None


def _check(window: list[Reading], plan: Plan, mount: Mount, pressure_kpa: float, zero_n: float) -> None:
    force_n = float(np.mean([reading.force_n for reading in window])) - zero_n
    if mount.quantity == BEND and abs(force_n) > plan.touch_n:
        raise RigError(
            f"{mount}: the scale shows {1e3 * force_n:.0f} mN at {pressure_kpa:g} kPa, but the muscle should be free; "
            "take the plate away"
        )
    if mount.quantity == FORCE and force_n < -plan.touch_n:
        raise RigError(f"{mount}: the scale shows {1e3 * force_n:.0f} mN at {pressure_kpa:g} kPa: is it the wrong way?")


def _sample(reading: Reading, mount: Mount, repeat: int, branch: str, set_kpa: float, zero_n: float) -> Sample:
    pressures = np.array(reading.pressure_pa)
    if pressures.shape != (CHAMBERS_PER_FINGER,):
        raise RigError(f"{mount}: expected the pressures of four chambers, found {pressures.size}")
    pressure_kpa = 1e-3 * float(pressures[mount.chambers].mean())
    value = math.degrees(reading.bend_rad) if mount.quantity == BEND else reading.force_n - zero_n
    return Sample(reading.time_s, mount, repeat, branch, set_kpa, pressure_kpa, value)
