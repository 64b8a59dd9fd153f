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
from mbpam_ros.errors import MbpamError

Vector = NDArray[np.float64]

VACUUM_GAUGE_PA = -101325.0
"""No gauge pressure lies below; a reading that does is no reading."""


class ValveFault(Enum):
    """Why a channel does not follow its set-point."""

    NONE = "none"
    NO_PRESSURE = "no fresh valid pressure"
    OVER_PRESSURE = "over-pressure"


class SetpointError(MbpamError, ValueError):
    """Set-points that were refused, all sixteen of them; the message names the channel and the value."""


class ControllerInputError(MbpamError, ValueError):
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


class _PressureLoop:
    """One channel: chamber, valve and what stands between its set-point and the opening."""

    __slots__ = (
        "_close_pa",
        "_config",
        "_delayed_pa",
        "_integral_pa_s",
        "_over",
        "_reopen_pa",
        "_trip_pa",
        "_valid_at_s",
        "fault",
        "leak_1_s",
        "reference_pa",
        "restart",
        "resting",
        "spool",
        "target_pa",
    )

    def __init__(self, config: ControllerConfig, over_pressure_gauge_pa: float) -> None:
        self._config, self._trip_pa = config, over_pressure_gauge_pa
        self.spool = self.reference_pa = self._delayed_pa = self._integral_pa_s = self.leak_1_s = 0.0
        self.resting = self._over = False
        self.fault = ValveFault.NONE
        self.begin_anew(0.0)
        self.aim(0.0)

    def aim(self, target_pa: float) -> None:
        """Take a set-point, and with it the errors within which the valve closes and, closed, stays so."""
        config = self._config
        self.target_pa = target_pa
        if target_pa == 0.0:
            self._close_pa, self._reopen_pa = config.vent_close_gauge_pa, config.vent_open_gauge_pa
        else:
            self._close_pa = max(config.close_band_pa, config.close_band_ratio * target_pa)
            self._reopen_pa = max(config.open_band_pa, config.open_band_ratio * target_pa)

    def begin_anew(self, time_s: float) -> None:
        """Go on from the next valid pressure as if the last one had come now."""
        self._valid_at_s, self.restart = time_s, True

    def update(self, time_s: float, pressure_pa: float, enabled: bool) -> None:
        """Take a reading, valid or not, and move the opening if the loop is enabled."""
        valid = VACUUM_GAUGE_PA <= pressure_pa < math.inf
        age_s = time_s - self._valid_at_s
        if valid:
            release_pa = self._trip_pa - self._config.over_pressure_release_pa
            self._over = pressure_pa > (release_pa if self._over else self._trip_pa)
        self.watch(time_s, valid)
        if not (enabled and valid) or self._over:
            return
        if self.restart:
            self.reference_pa = self._delayed_pa = pressure_pa
            self._integral_pa_s, self.resting, self.restart = 0.0, False, False
            self.spool = self._control(pressure_pa, 0.0)
        elif age_s > 0.0:
            self.spool = self._control(pressure_pa, min(age_s, self._config.hold_time_s))

    def watch(self, time_s: float, valid: bool) -> None:
        """Find the fault; after one the loop starts anew."""
        too_old = time_s - self._valid_at_s > self._config.watchdog_s
        if too_old or self._over:
            self.restart = True
        if valid:
            self._valid_at_s = time_s
        if self._over:
            self.fault = ValveFault.OVER_PRESSURE
        else:
            self.fault = ValveFault.NO_PRESSURE if too_old and not valid else ValveFault.NONE

    def guard(self, time_s: float, enabled: bool, vented: bool) -> float:
        """Return, and remember, what the fault and the switches leave of the opening."""
        if self._over or vented:
            self.spool = -1.0
        elif not enabled or self.restart or time_s - self._valid_at_s > self._config.hold_time_s:
            self.spool = 0.0
        return self.spool

    def _control(self, pressure_pa: float, dt_s: float) -> float:
        config = self._config
        feed_forward = self._move_reference(dt_s)
        lag = -math.expm1(-dt_s / config.loop_delay_s)
        self._delayed_pa += lag * (self.reference_pa - self._delayed_pa)

        error = self._delayed_pa - pressure_pa
        wanted_rate = feed_forward + config.proportional_gain_1_s * error + self._integral_pa_s
        if self.leak_1_s > 0.0:
            wanted_rate += self.leak_1_s * max(pressure_pa, 0.0)
        drop = config.supply_gauge_pa - pressure_pa if wanted_rate > 0.0 else pressure_pa
        opening = wanted_rate * config.fill_time_constant_s / max(drop, config.least_drop_pa)

        arrived = abs(self.target_pa - self.reference_pa) < config.close_band_pa
        self.resting = arrived and self._is_near(pressure_pa)
        if self.resting:
            return 0.0
        if arrived and (abs(opening) < 1.0 or error * opening < 0.0):
            learnt, limit = self._integral_pa_s + config.integral_gain_1_s2 * dt_s * error, config.integral_limit_pa_s
            self._integral_pa_s = min(max(learnt, -limit), limit)
        if arrived and self.target_pa == 0.0:
            return -1.0
        return min(max(opening, -1.0), 1.0)

    def _move_reference(self, dt_s: float) -> float:
        """Move the reference for ``dt_s`` and return its mean rate [Pa/s]: at the limit, then exponential."""
        gap = self.target_pa - self.reference_pa
        if gap == 0.0:
            return 0.0
        config = self._config
        distance = abs(gap)
        at_limit_s = distance / config.rate_limit_pa_s - config.approach_time_s
        at_limit_s = min(max(at_limit_s, 0.0), dt_s)
        left = (distance - config.rate_limit_pa_s * at_limit_s) * math.exp((at_limit_s - dt_s) / config.approach_time_s)
        if left < 0.1 * config.close_band_pa:
            left = 0.0
        self.reference_pa = self.target_pa - math.copysign(left, gap)
        return math.copysign(distance - left, gap) / max(dt_s, 1e-6)

    def _is_near(self, pressure_pa: float) -> bool:
        """Whether the valve may close, or stay closed."""
        error = pressure_pa if self.target_pa == 0.0 else abs(self.target_pa - pressure_pa)
        return error < (self._reopen_pa if self.resting else self._close_pa)


class PressureController:
    """Follows set-points with sixteen valves; starts disabled, all set-points at ambient.

    Disabled, every valve is closed: what is in the chambers stays there. Whatever the state, over-pressure vents its
    chamber, and :meth:`vent_all` vents every chamber until :meth:`enable` is called with True.
    """

    def __init__(self, config: ControllerConfig, pressure_limit_gauge_pa: float, over_pressure_gauge_pa: float) -> None:
        """Build the loops, disabled.

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
        if not over_pressure_gauge_pa > pressure_limit_gauge_pa:
            raise ValueError(
                f"over-pressure {over_pressure_gauge_pa:g} Pa must lie above the pressure limit "
                f"{pressure_limit_gauge_pa:g} Pa"
            )
        self._config, self._limit = config, float(pressure_limit_gauge_pa)
        self._loops = [_PressureLoop(config, float(over_pressure_gauge_pa)) for _ in range(CHANNEL_COUNT)]
        self._enabled = False
        self._vented = False
        self._time = -math.inf

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
        return np.array([loop.target_pa for loop in self._loops])

    @property
    def reference_gauge_pa(self) -> Vector:
        """Where the rate-limited references stand, shape (16,) [Pa gauge]."""
        return np.array([loop.reference_pa for loop in self._loops])

    @property
    def faults(self) -> tuple[ValveFault, ...]:
        """Fault of every channel."""
        return tuple([loop.fault for loop in self._loops])

    @property
    def in_over_pressure(self) -> NDArray[np.bool_]:
        """Channels that vent because of over-pressure, shape (16,)."""
        return np.array([loop.fault is ValveFault.OVER_PRESSURE for loop in self._loops])

    @property
    def resting(self) -> NDArray[np.bool_]:
        """Channels that have arrived and keep their valve closed, shape (16,)."""
        return np.array([loop.resting for loop in self._loops])

    def restart(self, channels: NDArray[np.bool_]) -> None:
        """Let loops, shape (16,), go on from the pressure that comes next, as if just enabled."""
        for channel in np.flatnonzero(channels):
            self._loops[channel].restart = True

    def compensate(self, leak_1_s: Vector) -> None:
        """Let loops add what leaks lose, p times these, shape (16,) [1/s], beyond what their integral may learn."""
        for loop, each in zip(self._loops, leak_1_s.tolist(), strict=True):
            loop.leak_1_s = each

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
        for refused in np.flatnonzero(~accepted):
            raise SetpointError(
                f"set-point of {CHANNEL_NAMES[refused]} is {setpoint[refused]:g} Pa gauge; "
                f"accepted: 0 or {low:g} to {high:g} Pa"
            )
        if self._vented and setpoint.any():
            channel = int(np.argmax(setpoint))
            raise SetpointError(
                f"set-point of {CHANNEL_NAMES[channel]} is {setpoint[channel]:g} Pa gauge while all chambers are "
                "vented by a stop; enable first"
            )
        for loop, target_pa in zip(self._loops, setpoint.tolist(), strict=True):
            loop.aim(target_pa)

    def enable(self, on: bool) -> None:
        """Follow the set-points from the pressures as they are (no jump), or close all valves.

        ``enable(True)`` also ends :meth:`vent_all`; ``enable(False)`` does not.
        """
        if on:
            self._vented = False
        if on != self._enabled:
            self._enabled = on
            for loop in self._loops:
                loop.restart = True

    def vent_all(self) -> None:
        """Stop: set-points to 0 and every valve open to ambient, measured pressures or not, until enabled."""
        self._vented = True
        self._enabled = False
        for loop in self._loops:
            loop.aim(0.0)

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
        for loop, pressure_pa in zip(self._loops, pressure.tolist(), strict=True):
            loop.update(time_s, pressure_pa, self._enabled)
        return self._guarded()

    def check(self, time_s: float) -> Vector:
        """Return the spool openings, shape (16,), when no pressures came: what a timer calls.

        Raises:
            ControllerInputError: a time that is not finite.
        """
        self._advance(time_s)
        for loop in self._loops:
            loop.watch(time_s, valid=False)
        return self._guarded()

    def _advance(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise ControllerInputError(f"time must be finite, found {time_s}")
        if time_s < self._time or self._time == -math.inf:
            for loop in self._loops:
                loop.begin_anew(time_s)
        self._time = time_s

    def _guarded(self) -> Vector:
        return np.array([loop.guard(self._time, self._enabled, self._vented) for loop in self._loops])
