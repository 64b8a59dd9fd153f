"""Valve and chamber: from spool commands to chamber pressures, several models behind one face.

Every channel is a 3/3-way proportional valve (+1 fill, 0 closed, -1 vent) on one chamber. The spool follows its command
with a first-order lag, integrated exactly; the chamber follows the opening by the law of the model: exactly for
``ideal`` and ``lag``, where cutting a step into pieces changes nothing but rounding, implicitly for ``iso6358``
(:mod:`~mbpam_ros.pneumatics.iso6358`). None has a stability limit. What a sampled caller loses is that its command is
held for the length of the step.

Before the valves stands the supply: a manifold at the regulated pressure, or, with its own valve shut, dumped to
ambient. ``ideal`` and ``lag`` let it follow with one time constant, which valves see as its mean over a step; what a
chamber has above it flows back through a valve that is open. ``iso6358`` dumps its tank with the same time constant.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES, FINGER_COUNT
from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError

Vector = NDArray[np.float64]

AMBIENT_PA = 101325.0
"""Absolute."""

REFERENCE_PA = 100e3
"""Absolute, of ISO 8778 (ANR), in whose volume conductances count."""

_STRAIGHT = np.zeros((FINGER_COUNT, 2))


class PneumaticsInputError(MbpamError, ValueError):
    """A spool command, a pressure or a step that no model can use. Nothing was changed."""


@dataclass(frozen=True)
class OrificeConfig:
    """Valves, lines and supply of the model ``iso6358``. Conductances are sonic, C of ISO 6358 [m3/(s Pa), ANR].

    Args:
        sonic_conductance_m3_s_pa: of a fully open valve, either way.
        critical_ratio: b, of all orifices.
        leak_conductance_m3_s_pa: of each chamber to ambient, always open; 0 for a tight one.
        line_volume_m3: between a valve and its chamber, the muscle's ends included.
        supply_volume_m3: of the tank that all valves are fed from.
        regulator_conductance_m3_s_pa: from the regulated pressure into the tank; 0 for a tank that is not refilled.
        sub_step_s: greatest implicit step.
    """

    sonic_conductance_m3_s_pa: float
    critical_ratio: float
    leak_conductance_m3_s_pa: float
    line_volume_m3: float
    supply_volume_m3: float
    regulator_conductance_m3_s_pa: float
    sub_step_s: float

    def __post_init__(self) -> None:
        require_positive(self, "sonic_conductance_m3_s_pa", "supply_volume_m3", "sub_step_s")
        for name in ("leak_conductance_m3_s_pa", "line_volume_m3", "regulator_conductance_m3_s_pa"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ValueError(f"{name} must be finite and not negative, found {getattr(self, name)}")
        if not 0.0 <= self.critical_ratio <= 0.95:
            raise ValueError(f"critical_ratio must lie in [0, 0.95], found {self.critical_ratio}")


@dataclass(frozen=True)
class ChamberConfig:
    """Supply, valve and chamber. Pressures gauge, ambient = 0.

    Args:
        supply_gauge_pa: pressure before the valves.
        spool_time_constant_s: first-order response of the spool to its command.
        ideal_rate_pa_s: pressure rate of the model ``ideal`` at full opening.
        lag_time_constant_s: time constant of the model ``lag`` at full opening.
        iso6358: orifices and volumes of the model ``iso6358``.
        supply_time_constant_s: with which the manifold follows the regulator, or is dumped.
    """

    supply_gauge_pa: float
    spool_time_constant_s: float
    ideal_rate_pa_s: float
    lag_time_constant_s: float
    iso6358: OrificeConfig
    supply_time_constant_s: float = 0.02

    def __post_init__(self) -> None:
        require_positive(self, "supply_gauge_pa", "spool_time_constant_s", "ideal_rate_pa_s", "lag_time_constant_s")
        require_positive(self, "supply_time_constant_s")


class PneumaticModel(ABC):
    """Sixteen valves and chambers: reset, step, read. A model adds the law of one chamber, :meth:`_flow`.

    Args:
        config: supply, valve and chamber.
        gas_law: file of the chambers' volumes, for models that know them; None for the paper's muscle.
    """

    has_volume = False
    """Whether the bend of the muscles matters to it."""

    def __init__(self, config: ChamberConfig, gas_law: Path | None = None) -> None:
        self._config = config
        self._pressure: Vector
        self._spool: Vector
        self._supply_pa: float
        self._fed_pa: float
        self.reset()

    @property
    def pressure_gauge_pa(self) -> Vector:
        """Chamber pressures, shape (16,) [Pa gauge]."""
        return self._pressure.copy()

    @property
    def spool(self) -> Vector:
        """Openings the spools stand at, shape (16,), -1 (vent) .. +1 (fill)."""
        return self._spool.copy()

    @property
    def supply_gauge_pa(self) -> float:
        """Pressure before the valves [Pa gauge]."""
        return self._supply_pa

    def feed(self, supply_open: bool, regulated_gauge_pa: float | None = None) -> None:
        """Open the supply's own valve, or shut it and dump what is before the valves.

        Args:
            regulated_gauge_pa: what the regulator gives from now on; none for what the configuration says.
        """
        regulated_pa = self._config.supply_gauge_pa if regulated_gauge_pa is None else regulated_gauge_pa
        self._fed_pa = regulated_pa if supply_open else 0.0

    def seep(self, out_1_s: Vector, in_1_s: Vector, dt_s: float) -> Vector:
        """Let chambers leak to ambient and from the supply for ``dt_s`` and return the pressures, (16,) [Pa gauge].

        dp/dt = -p out + (p_supply - p) in, integrated exactly beside the valves (first order in the step).

        Args:
            out_1_s, in_1_s: one over the leaks' time constants, shape (16,).
        """
        rate = out_1_s + in_1_s
        end_pa = np.divide(in_1_s * self._supply_pa, rate, out=np.zeros(CHANNEL_COUNT), where=rate > 0.0)
        self._pressure = end_pa + (self._pressure - end_pa) * np.exp(-rate * dt_s)
        return self._pressure.copy()

    def reset(self, pressure_gauge_pa: ArrayLike = 0.0) -> None:
        """Close all valves at the given pressures, a number or shape (16,) [Pa gauge]; the supply is there.

        Raises:
            PneumaticsInputError: wrong shape, not finite, or outside [0, supply].
        """
        try:
            pressure = np.array(np.broadcast_to(np.asarray(pressure_gauge_pa, dtype=float), (CHANNEL_COUNT,)))
        except ValueError:
            shape = np.shape(pressure_gauge_pa)
            raise PneumaticsInputError(
                f"pressures must be a number or {CHANNEL_COUNT} numbers, found {shape}"
            ) from None
        _require_within(pressure, 0.0, self._config.supply_gauge_pa, "pressure_gauge_pa")
        self._pressure = pressure
        self._spool = np.zeros(CHANNEL_COUNT)
        self._supply_pa = self._fed_pa = self._config.supply_gauge_pa

    def step(self, spool: ArrayLike, dt_s: float, bend_rad: ArrayLike = _STRAIGHT) -> Vector:
        """Hold the spool commands, shape (16,) in [-1, 1], for ``dt_s`` and return the pressures, (16,) [Pa gauge].

        Args:
            bend_rad: of the four muscles, shape (4, 2): it changes the chambers' volume, where the model has one.

        Raises:
            PneumaticsInputError: wrong shape, a command not finite or outside [-1, 1], a step that is not positive.
        """
        command = np.asarray(spool, dtype=float)
        if command.shape != (CHANNEL_COUNT,):
            raise PneumaticsInputError(f"spool commands must have shape ({CHANNEL_COUNT},), found {command.shape}")
        _require_within(command, -1.0, 1.0, "spool command")
        if not (math.isfinite(dt_s) and dt_s > 0.0):
            raise PneumaticsInputError(f"dt_s must be a positive number of seconds, found {dt_s}")
        bend = np.asarray(bend_rad, dtype=float)
        if bend.shape != (FINGER_COUNT, 2) or not np.isfinite(bend).all():
            raise PneumaticsInputError(f"bend_rad must be finite, of shape ({FINGER_COUNT}, 2), found {bend}")
        for opening_time, duration in self._move_spools(command, dt_s):
            self._pressure = self._flow(opening_time, duration, bend)
        return self._pressure.copy()

    def _move_spools(self, command: Vector, dt_s: float) -> list[tuple[Vector, float]]:
        """Move the spools; return the time integrals of the opening [s] before and after its change of sign.

        With each comes the time the part takes [s], which counts for what flows whatever the opening (supply, leaks).
        s(t) = u + (s0 - u) exp(-t / tau) is monotone, so it crosses zero at most once, at t0 = tau ln(1 - s0 / u).
        Within each part the flow has one direction, which is what lets a law be integrated in closed form.
        """
        tau, start = self._config.spool_time_constant_s, self._spool

        def opening_time(until_s: float) -> Vector:
            return command * until_s - (start - command) * tau * math.expm1(-until_s / tau)

        self._spool = command + (start - command) * math.exp(-dt_s / tau)
        whole = opening_time(dt_s)
        crosses = start * self._spool < -1e-200  # a smaller opening moves nothing and would overflow the ratio
        if not crosses.any():
            return [(whole, dt_s)]
        ratio = np.divide(start, command, out=np.zeros(CHANNEL_COUNT), where=crosses)
        crossed_s = tau * np.log1p(-ratio)
        first_s = float(crossed_s[crosses].mean())
        before = np.where(crosses, command * crossed_s + start * tau, opening_time(first_s))
        return [(before, first_s), (whole - before, dt_s - first_s)]

    def _move_supply(self, duration_s: float) -> float:
        """Let the manifold follow what it is fed; return its mean over the time [Pa gauge]."""
        if self._supply_pa == self._fed_pa:
            return self._supply_pa
        tau = self._config.supply_time_constant_s
        above_pa, decay = self._supply_pa - self._fed_pa, -math.expm1(-duration_s / tau)
        self._supply_pa = self._fed_pa + above_pa * (1.0 - decay)
        if abs(self._supply_pa - self._fed_pa) < 1.0:
            self._supply_pa = self._fed_pa
        return self._fed_pa + above_pa * decay * tau / max(duration_s, 1e-12)

    @abstractmethod
    def _flow(self, opening_time_s: Vector, duration_s: float, bend_rad: Vector) -> Vector:
        """Return the pressures after an opening of one sign whose time integral is ``opening_time_s``, (16,) [s]."""


class IdealChambers(PneumaticModel):
    """Pressure rate proportional to the opening, whatever the pressure, between ambient and supply."""

    def _flow(self, opening_time_s: Vector, duration_s: float, bend_rad: Vector) -> Vector:
        supply_pa = self._move_supply(duration_s)
        fill = self._config.ideal_rate_pa_s * opening_time_s
        back = (self._pressure > supply_pa) & (fill > 0.0)
        if not back.any():
            return np.minimum(np.maximum(self._pressure + fill, 0.0), np.maximum(self._pressure, supply_pa))
        moved = np.where(back, np.maximum(self._pressure - fill, supply_pa), self._pressure + fill)
        return np.maximum(moved, 0.0)


class LagChambers(PneumaticModel):
    """dp/dt = |s| (p_end - p) / tau, with p_end the supply for s > 0 and ambient for s < 0."""

    def _flow(self, opening_time_s: Vector, duration_s: float, bend_rad: Vector) -> Vector:
        end = np.where(opening_time_s > 0.0, self._move_supply(duration_s), 0.0)
        decay = np.exp(-np.abs(opening_time_s) / self._config.lag_time_constant_s)
        moved = end + (self._pressure - end) * decay
        within: Vector = np.minimum(np.maximum(moved, 0.0), self._config.supply_gauge_pa)
        return within


def _require_within(values: Vector, low: float, high: float, what: str) -> None:
    inside = (values >= low) & (values <= high)  # False for NaN
    if not inside.all():
        channel = int(np.argmin(inside))
        raise PneumaticsInputError(
            f"{what} of {CHANNEL_NAMES[channel]} must lie in [{low:g}, {high:g}], found {values[channel]:g}"
        )
