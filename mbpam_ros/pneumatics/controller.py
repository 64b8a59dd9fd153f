"""Sixteen independent pressure loops, from set-points and measured pressures to spool openings.

Per channel: the set-point becomes a reference that moves at no more than ``rate_limit_pa_s`` and slows down
exponentially over ``approach_time_s`` before it arrives. The wanted pressure rate is

    v = dr/dt + Kp (m - p) + I,      dI/dt = Ki (m - p),

with r the reference and m = r seen through the loop's own delay (first order, ``loop_delay_s``), so that feed-forward
and feedback do not push twice. The opening is v over the rate the valve would give at full opening there: by the
first-order model, (supply - p) / tau to fill, p / tau to vent. The integral learns leaks: it is fed only once the
reference has arrived and the opening is not saturated (conditional integration), and it is bounded.

The reference and m are integrated exactly, so the interval between updates matters only as delay. A chamber integrates
its opening; with a delay T in the loop it is stable while Kp times the ratio of true to assumed valve rate stays below
pi / (2 T), and overshoots little below 1 / T (T = 0.035 s: 28 1/s, so a valve may be almost twice as fast as assumed).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.configuration import require_positive

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

VACUUM_GAUGE_PA = -101325.0
"""No gauge pressure lies below; a reading that does is no reading."""


class ValveFault(Enum):
    """Why a channel does not follow its set-point."""

    NONE = "none"
    NO_PRESSURE = "no fresh valid pressure"
    OVER_PRESSURE = "over-pressure"


class SetpointError(ValueError):
    """Set-points that were refused, all sixteen of them; the message names the channel and the value."""


class ControllerInputError(ValueError):
    """Pressures of the wrong shape or a time that is not finite. Nothing was changed."""


@dataclass(frozen=True)
class ControllerConfig:
    """Gains, limits and watchdog of the pressure loops.

    Args:
        supply_gauge_pa: supply pressure the feed-forward assumes.
        fill_time_constant_s: time constant of a fully open valve on its chamber the feed-forward assumes.
        least_drop_pa: least pressure difference over the valve the feed-forward divides by; bounds the loop gain.
        proportional_gain_1_s: Kp, wanted pressure rate per pressure error.
        integral_gain_1_s2: Ki.
        integral_limit_pa_s: greatest |I|: the greatest leak it may learn.
        rate_limit_pa_s: greatest rate of the reference.
        approach_time_s: time constant with which the reference arrives.
        loop_delay_s: delay of valve, sampling and filter together.
        minimum_setpoint_gauge_pa: least set-point accepted.
        close_band_pa: error within which a settled valve closes ...
        close_band_ratio: ... or this part of the set-point, whichever is wider.
        open_band_pa: error beyond which a closed valve opens again ...
        open_band_ratio: ... or this part of the set-point.
        vent_close_gauge_pa: at set-point 0 the valve vents down to this.
        vent_open_gauge_pa: at set-point 0 a closed valve vents again above this.
        hold_time_s: a valve keeps its opening at most this long without a fresh valid pressure, then closes.
        watchdog_s: after this long without one the channel is at fault.
        over_pressure_release_pa: a chamber in over-pressure vents until this far below where it tripped.
    """

    supply_gauge_pa: float
    fill_time_constant_s: float
    least_drop_pa: float
    proportional_gain_1_s: float
    integral_gain_1_s2: float
    integral_limit_pa_s: float
    rate_limit_pa_s: float
    approach_time_s: float
    loop_delay_s: float
    minimum_setpoint_gauge_pa: float
    close_band_pa: float
    close_band_ratio: float
    open_band_pa: float
    open_band_ratio: float
    vent_close_gauge_pa: float
    vent_open_gauge_pa: float
    hold_time_s: float
    watchdog_s: float
    over_pressure_release_pa: float

    def __post_init__(self) -> None:
        require_positive(
            self,
            "supply_gauge_pa",
            "fill_time_constant_s",
            "least_drop_pa",
            "proportional_gain_1_s",
            "rate_limit_pa_s",
            "approach_time_s",
            "loop_delay_s",
            "close_band_pa",
            "vent_close_gauge_pa",
            "hold_time_s",
            "over_pressure_release_pa",
        )
        for name in ("integral_gain_1_s2", "integral_limit_pa_s", "minimum_setpoint_gauge_pa", "close_band_ratio"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} must not be negative, found {getattr(self, name)}")
        for lower, upper in (
            ("close_band_pa", "open_band_pa"),
            ("close_band_ratio", "open_band_ratio"),
            ("vent_close_gauge_pa", "vent_open_gauge_pa"),
            ("hold_time_s", "watchdog_s"),
        ):
            if getattr(self, lower) > getattr(self, upper):
                raise ValueError(f"{lower} must not exceed {upper}")


class PressureController:
    """Follows set-points with sixteen valves; starts disabled, all set-points at ambient.

    Disabled, every valve is closed: what is in the chambers stays there. Whatever the state, over-pressure vents its
    chamber, and :meth:`vent_all` vents every chamber until :meth:`enable` is called with True.
    """

    def __init__(self, config: ControllerConfig, pressure_limit_gauge_pa: float, over_pressure_gauge_pa: float) -> None:
        """
        Args:
            config: gains, limits and watchdog.
            pressure_limit_gauge_pa: greatest set-point accepted.
            over_pressure_gauge_pa: a chamber above this vents at once.

        Raises:
            ValueError: the limit is not between the least set-point and the supply pressure, or over-pressure is not
                above it.
        """
        if not config.minimum_setpoint_gauge_pa < pressure_limit_gauge_pa <= config.supply_gauge_pa:
            raise ValueError(
                f"pressure limit {pressure_limit_gauge_pa:g} Pa must lie above the least set-point "
                f"{config.minimum_setpoint_gauge_pa:g} Pa and not above the supply {config.supply_gauge_pa:g} Pa"
            )
        self._config = config
        if not over_pressure_gauge_pa > pressure_limit_gauge_pa:
            raise ValueError(
                f"over-pressure {over_pressure_gauge_pa:g} Pa must lie above the pressure limit "
                f"{pressure_limit_gauge_pa:g} Pa"
            )
        self._limit, self._trip = float(pressure_limit_gauge_pa), float(over_pressure_gauge_pa)
        self._enabled = False
        self._vented = False
        self._target = np.zeros(CHANNEL_COUNT)
        self._time = -math.inf
        self._spool = np.zeros(CHANNEL_COUNT)
        self._reference = np.zeros(CHANNEL_COUNT)
        self._delayed_reference = np.zeros(CHANNEL_COUNT)
        self._integral = np.zeros(CHANNEL_COUNT)
        self._resting = np.zeros(CHANNEL_COUNT, dtype=bool)
        self._restart = np.ones(CHANNEL_COUNT, dtype=bool)
        self._over = np.zeros(CHANNEL_COUNT, dtype=bool)
        self._stale = np.zeros(CHANNEL_COUNT, dtype=bool)
        self._valid_at = np.zeros(CHANNEL_COUNT)

    @property
    def enabled(self) -> bool:
        """Whether the loops follow their set-points."""
        return self._enabled

    @property
    def vented(self) -> bool:
        """Whether :meth:`vent_all` holds every valve open to ambient."""
        return self._vented

    @property
    def setpoint(self) -> Vector:
        """Set-points last accepted, shape (16,) [Pa gauge]."""
        return self._target.copy()

    @property
    def reference_gauge_pa(self) -> Vector:
        """Where the rate-limited references stand, shape (16,) [Pa gauge]."""
        return self._reference.copy()

    @property
    def faults(self) -> tuple[ValveFault, ...]:
        """Fault of every channel."""
        return tuple(
            ValveFault.OVER_PRESSURE if over else ValveFault.NO_PRESSURE if stale else ValveFault.NONE
            for over, stale in zip(self._over.tolist(), self._stale.tolist(), strict=True)
        )

    def request(self, setpoint_gauge_pa: ArrayLike) -> None:
        """Take new set-points, shape (16,) [Pa gauge]. Disabled, they wait until enabled.

        Raises:
            SetpointError: wrong shape, or one of them not finite, below the least, above the limit, or above zero
                while everything is vented. None is applied then.
        """
        setpoint = np.array(setpoint_gauge_pa, dtype=float)
        if setpoint.shape != (CHANNEL_COUNT,):
            raise SetpointError(f"set-points must have shape ({CHANNEL_COUNT},), found {setpoint.shape}")
        low, high = self._config.minimum_setpoint_gauge_pa, self._limit
        accepted = (setpoint == 0.0) | ((setpoint >= low) & (setpoint <= high))  # False for NaN
        for channel in np.flatnonzero(~accepted):
            raise SetpointError(
                f"set-point of {CHANNEL_NAMES[channel]} is {setpoint[channel]:g} Pa gauge; "
                f"accepted: 0 or {low:g} to {high:g} Pa"
            )
        if self._vented and setpoint.any():
            channel = int(np.argmax(setpoint))
            raise SetpointError(
                f"set-point of {CHANNEL_NAMES[channel]} is {setpoint[channel]:g} Pa gauge while all chambers are "
                "vented by a stop; enable first"
            )
        self._target = setpoint

    def enable(self, on: bool) -> None:
        """Follow the set-points from the pressures as they are (no jump), or close all valves.

        ``enable(True)`` also ends :meth:`vent_all`; ``enable(False)`` does not.
        """
        if on:
            self._vented = False
        self._restart |= on != self._enabled
        self._enabled = on

    def vent_all(self) -> None:
        """Stop: set-points to 0 and every valve open to ambient, measured pressures or not, until enabled."""
        self._vented = True
        self._enabled = False
        self._target = np.zeros(CHANNEL_COUNT)

    def update(self, time_s: float, pressure_gauge_pa: ArrayLike) -> Vector:
        """Return the spool openings, shape (16,) in [-1, 1], for the measured pressures, shape (16,) [Pa gauge].

        NaN, infinity or less than a vacuum is no valid reading. A time before the last one (a simulation started
        anew) restarts the loops from the measured pressures.

        Raises:
            ControllerInputError: wrong shape or a time that is not finite.
        """
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        if pressure.shape != (CHANNEL_COUNT,):
            raise ControllerInputError(f"pressures must have shape ({CHANNEL_COUNT},), found {pressure.shape}")
        self._advance(time_s)
        valid = np.isfinite(pressure) & (pressure >= VACUUM_GAUGE_PA)
        age_s = self._time - self._valid_at
        self._watch(valid, pressure)
        if self._enabled:
            begins = valid & ~self._over & self._restart
            fresh = begins | (valid & ~self._over & (age_s > 0.0))
            self._begin_where(begins, pressure)
            # A channel without a new sample moves nothing: no time passes for it and it has no error.
            dt_s = np.where(fresh & ~begins, np.minimum(age_s, self._config.hold_time_s), 0.0)
            pressure = np.where(fresh, pressure, self._delayed_reference)
            self._spool = np.where(fresh, self._control(pressure, dt_s), self._spool)
        return self._guarded()

    def check(self, time_s: float) -> Vector:
        """Return the spool openings, shape (16,), when no pressures came: what a timer calls.

        Raises:
            ControllerInputError: a time that is not finite.
        """
        self._advance(time_s)
        self._watch(np.zeros(CHANNEL_COUNT, dtype=bool), self._reference)
        return self._guarded()

    def _advance(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise ControllerInputError(f"time must be finite, found {time_s}")
        if time_s < self._time or self._time == -math.inf:
            self._valid_at[:] = time_s
            self._restart[:] = True
        self._time = time_s

    def _watch(self, valid: Mask, pressure: Vector) -> None:
        """Update the faults; a channel that has one starts anew when it ends."""
        release = self._trip - self._config.over_pressure_release_pa
        self._over = np.where(valid, (pressure > self._trip) | (self._over & (pressure > release)), self._over)
        too_old = self._time - self._valid_at > self._config.watchdog_s
        self._stale = too_old & ~valid
        self._restart |= self._over | too_old
        self._valid_at = np.where(valid, self._time, self._valid_at)

    def _begin_where(self, chosen: Mask, pressure: Vector) -> None:
        if not chosen.any():
            return
        self._reference = np.where(chosen, pressure, self._reference)
        self._delayed_reference = np.where(chosen, pressure, self._delayed_reference)
        self._integral = np.where(chosen, 0.0, self._integral)
        self._resting &= ~chosen
        self._restart &= ~chosen

    def _control(self, pressure: Vector, dt_s: Vector) -> Vector:
        config = self._config
        feed_forward = self._move_reference(dt_s)
        lag = -np.expm1(-dt_s / config.loop_delay_s)
        self._delayed_reference = self._delayed_reference + lag * (self._reference - self._delayed_reference)

        error = self._delayed_reference - pressure
        wanted_rate = feed_forward + config.proportional_gain_1_s * error + self._integral
        drop = np.where(wanted_rate > 0.0, config.supply_gauge_pa - pressure, pressure)
        opening = wanted_rate * config.fill_time_constant_s / np.maximum(drop, config.least_drop_pa)

        arrived = np.abs(self._target - self._reference) < config.close_band_pa
        resting = self._rest(pressure, arrived)
        free = arrived & ~resting & ((np.abs(opening) < 1.0) | (error * opening < 0.0))
        integral = self._integral + np.where(free, config.integral_gain_1_s2 * dt_s * error, 0.0)
        self._integral = np.minimum(np.maximum(integral, -config.integral_limit_pa_s), config.integral_limit_pa_s)
        opening = np.minimum(np.maximum(opening, -1.0), 1.0)
        return np.where(resting, 0.0, np.where(arrived & (self._target == 0.0), -1.0, opening))

    def _move_reference(self, dt_s: Vector) -> Vector:
        """Move the reference for ``dt_s`` and return its mean rate [Pa/s]: at the limit, then exponential."""
        config = self._config
        gap = self._target - self._reference
        distance = np.abs(gap)
        at_limit_s = distance / config.rate_limit_pa_s - config.approach_time_s
        at_limit_s = np.minimum(np.maximum(at_limit_s, 0.0), dt_s)
        left = (distance - config.rate_limit_pa_s * at_limit_s) * np.exp((at_limit_s - dt_s) / config.approach_time_s)
        left = np.where(left < 0.1 * config.close_band_pa, 0.0, left)
        self._reference = self._target - np.copysign(left, gap)
        return np.copysign(distance - left, gap) / np.maximum(dt_s, 1e-6)

    def _rest(self, pressure: Vector, arrived: Mask) -> Mask:
        """Return which valves may stay closed, now that the reference has arrived and the pressure is near."""
        config = self._config
        empty = self._target == 0.0
        error = np.where(empty, pressure, np.abs(self._target - pressure))
        close = np.maximum(config.close_band_pa, config.close_band_ratio * self._target)
        reopen = np.maximum(config.open_band_pa, config.open_band_ratio * self._target)
        close = np.where(empty, config.vent_close_gauge_pa, close)
        reopen = np.where(empty, config.vent_open_gauge_pa, reopen)
        self._resting = arrived & (error < np.where(self._resting, reopen, close))
        return self._resting

    def _guarded(self) -> Vector:
        """Return what the faults and the switches leave of the openings, and remember it."""
        held = self._time - self._valid_at <= self._config.hold_time_s
        self._spool = np.where(held & ~self._restart, self._spool, 0.0)
        if not self._enabled:
            self._spool = np.zeros(CHANNEL_COUNT)
        if self._vented:
            self._spool = np.full(CHANNEL_COUNT, -1.0)
        self._spool = np.where(self._over, -1.0, self._spool)
        return self._spool.copy()
