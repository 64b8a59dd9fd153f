"""From transducer volts to chamber pressures: calibration, filter, variance, and which channels can be believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.configuration import require_positive
from mbpam_ros.pneumatics.transducer import TransducerConfig

Vector = NDArray[np.float64]


class ChannelStatus(Enum):
    """What is known of a channel."""

    OK = "ok"
    OUT_OF_RANGE = "out of range"
    STUCK = "stuck"
    MISSING = "missing"


class SensingInputError(ValueError):
    """Samples that cannot be read: wrong shape or a time that is not finite. Nothing was changed."""


class ZeroRefusedError(RuntimeError):
    """The present reading may not become the zero; the message names the channel and the reason."""


@dataclass(frozen=True)
class SensingConfig:
    """How volts are read.

    Args:
        channel_gain: per channel, true over nominal pressure per volt.
        channel_offset_v: per channel, volts at 0 Pa gauge minus the data sheet's.
        cutoff_hz: cut-off frequency of the first-order low-pass.
        variance_time_s: memory of the noise estimate.
        valid_low_v: below this a channel is out of range (broken wire, short).
        valid_high_v: above this a channel is out of range.
        stuck_time_s: one raw value for longer than this is a stuck channel; 0 switches the check off.
        missing_time_s: no sample for longer than this is a missing channel.
        recovery_samples: good samples in a row that end a fault.
        zero_limit_pa: greatest distance from the data sheet's zero that :meth:`PressureSensing.zero` accepts.
    """

    channel_gain: tuple[float, ...]
    channel_offset_v: tuple[float, ...]
    cutoff_hz: float
    variance_time_s: float
    valid_low_v: float
    valid_high_v: float
    stuck_time_s: float
    missing_time_s: float
    recovery_samples: int
    zero_limit_pa: float

    def __post_init__(self) -> None:
        require_positive(
            self, "channel_gain", "cutoff_hz", "variance_time_s", "missing_time_s", "recovery_samples", "zero_limit_pa"
        )
        for name in ("channel_gain", "channel_offset_v"):
            if len(getattr(self, name)) != CHANNEL_COUNT:
                raise ValueError(f"{name} needs {CHANNEL_COUNT} values, found {len(getattr(self, name))}")
        if self.stuck_time_s < 0.0:
            raise ValueError(f"stuck_time_s must not be negative, found {self.stuck_time_s}")
        if self.valid_low_v >= self.valid_high_v:
            raise ValueError(f"valid_low_v = {self.valid_low_v} is not below valid_high_v = {self.valid_high_v}")


@dataclass(frozen=True)
class PressureReading:
    """Sixteen channels at one time.

    Args:
        time_s: time of the reading.
        pressure_gauge_pa: filtered pressure, shape (16,) [Pa gauge]; NaN = no valid reading.
        variance_pa2: variance of the filtered pressure, shape (16,) [Pa^2]; NaN where the pressure is.
        status: of each channel.
    """

    time_s: float
    pressure_gauge_pa: Vector
    variance_pa2: Vector
    status: tuple[ChannelStatus, ...]


_STATUS = tuple(ChannelStatus)
_OK, _OUT_OF_RANGE, _STUCK, _MISSING = range(4)


class PressureSensing:
    """Reads sixteen transducers.

    Filter: y += (1 - exp(-2 pi f dt)) (x - y), the exact answer of the first-order low-pass to samples held over their
    intervals, hence stable for any interval. Noise: exponentially weighted mean square of x - y_previous, which for
    white noise of variance s2 is s2 * 2 / (2 - alpha); the filtered pressure then has s2 * alpha / (2 - alpha), never
    less than the converter's step^2 / 12. While the pressure moves, the filter's lag counts as noise, on purpose.
    """

    def __init__(self, config: SensingConfig, transducer: TransducerConfig) -> None:
        self._config = config
        gain = transducer.gain_pa_v * np.array(config.channel_gain)
        self._gain_pa_v = gain
        self._zero_v = transducer.zero_v + np.array(config.channel_offset_v)
        self._variance_floor = (gain * transducer.resolution_v) ** 2 / 12.0
        self._expected_noise = (gain * transducer.noise_v) ** 2 + self._variance_floor  # until there is experience
        self._zero_correction = np.zeros(CHANNEL_COUNT)
        self._forget(0.0)

    def update(self, time_s: float, volts: ArrayLike) -> PressureReading:
        """Take one sample of every channel, shape (16,) [V], NaN where a channel gave none.

        A time before the last one (a simulation started anew) forgets the filter, keeping the zero. A repeated time
        is not a new sample for the filter.

        Raises:
            SensingInputError: wrong shape or a time that is not finite.
        """
        sample = np.array(volts, dtype=float)
        if sample.shape != (CHANNEL_COUNT,):
            raise SensingInputError(f"volts must have shape ({CHANNEL_COUNT},), found {sample.shape}")
        self._advance(time_s)
        now = self._classify(sample)
        good = now == _OK
        self._good_samples = np.where(good, self._good_samples + 1, 0)
        recovered = good & (self._good_samples >= self._config.recovery_samples)
        self._status = np.where(good, np.where(recovered, _OK, self._status), now)
        valid = self._status == _OK
        believed_v = np.where(valid, sample, self._zero_v)
        self._filter((believed_v - self._zero_v) * self._gain_pa_v - self._zero_correction, valid)
        return self._reading()

    def check(self, time_s: float) -> PressureReading:
        """Return the reading at ``time_s`` without a new sample: channels too old become ``MISSING``.

        Raises:
            SensingInputError: a time that is not finite.
        """
        self._advance(time_s)
        self._mark_missing(self._time - self._sampled_at > self._config.missing_time_s)
        return self._reading()

    def zero(self) -> Vector:
        """Make the present readings the zero and return the whole correction, shape (16,) [Pa].

        Raises:
            ZeroRefusedError: a channel has no valid reading, or is further than ``zero_limit_pa`` from the data sheet's
                zero, zeroing done before included. Nothing is changed then.
        """
        for channel in np.flatnonzero(self._status != _OK):
            raise ZeroRefusedError(
                f"{CHANNEL_NAMES[channel]} has no valid reading: {_STATUS[self._status[channel]].value}"
            )
        correction = self._zero_correction + self._pressure
        for channel in np.flatnonzero(np.abs(correction) > self._config.zero_limit_pa):
            raise ZeroRefusedError(
                f"{CHANNEL_NAMES[channel]} reads {correction[channel]:.0f} Pa before correction, more than "
                f"{self._config.zero_limit_pa:.0f} Pa from zero; vent it first"
            )
        self._zero_correction = correction
        self._pressure = np.zeros(CHANNEL_COUNT)
        return correction.copy()

    def _advance(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise SensingInputError(f"time must be finite, found {time_s}")
        if time_s < self._time:
            self._forget(time_s)
        self._time = time_s

    def _forget(self, time_s: float) -> None:
        self._time = time_s
        self._status = np.full(CHANNEL_COUNT, _MISSING)
        # No fault to recover from yet: the first good sample counts.
        self._good_samples = np.full(CHANNEL_COUNT, self._config.recovery_samples)
        self._raw_v = np.full(CHANNEL_COUNT, np.nan)
        self._changed_at = np.full(CHANNEL_COUNT, time_s)
        self._sampled_at = np.full(CHANNEL_COUNT, time_s)
        self._filtered_at = np.full(CHANNEL_COUNT, time_s)
        self._pressure = np.full(CHANNEL_COUNT, np.nan)
        self._noise = self._expected_noise.copy()
        self._variance = self._expected_noise.copy()

    def _classify(self, sample_v: Vector) -> NDArray[np.intp]:
        config = self._config
        missing = np.isnan(sample_v)
        self._sampled_at = np.where(missing, self._sampled_at, self._time)
        self._changed_at = np.where(sample_v != self._raw_v, self._time, self._changed_at)
        self._raw_v = sample_v
        status = np.zeros(CHANNEL_COUNT, dtype=np.intp)
        if config.stuck_time_s > 0.0:
            status[self._time - self._changed_at > config.stuck_time_s] = _STUCK
        status[(sample_v < config.valid_low_v) | (sample_v > config.valid_high_v)] = _OUT_OF_RANGE
        status[missing] = _MISSING
        return status

    def _filter(self, raw_pa: Vector, valid: NDArray[np.bool_]) -> None:
        config = self._config
        fresh = valid & np.isnan(self._pressure)
        interval = self._time - self._filtered_at
        alpha = -np.expm1(-2.0 * math.pi * config.cutoff_hz * interval)
        residual = np.where(valid & ~fresh, raw_pa - self._pressure, 0.0)
        weight = -np.expm1(-interval / config.variance_time_s)
        noise = self._noise + weight * (0.5 * (2.0 - alpha) * residual**2 - self._noise)
        variance = np.maximum(noise * alpha / (2.0 - alpha), self._variance_floor)

        moved = valid & ~fresh & (interval > 0.0)
        self._variance = np.where(moved, variance, np.where(fresh, self._noise, self._variance))
        self._noise = np.where(moved, noise, self._noise)
        self._pressure = np.where(valid, np.where(fresh, raw_pa, self._pressure + alpha * residual), np.nan)
        self._filtered_at = np.full(CHANNEL_COUNT, self._time)

    def _mark_missing(self, missing: NDArray[np.bool_]) -> None:
        self._status = np.where(missing, _MISSING, self._status)
        self._good_samples = np.where(missing, 0, self._good_samples)
        self._pressure = np.where(missing, np.nan, self._pressure)

    def _reading(self) -> PressureReading:
        variance = np.where(np.isnan(self._pressure), np.nan, self._variance)
        status = tuple(_STATUS[code] for code in self._status.tolist())
        return PressureReading(self._time, self._pressure.copy(), variance, status)
