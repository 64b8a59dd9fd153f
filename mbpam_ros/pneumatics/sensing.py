"""From transducer volts to chamber pressures: calibration, filter, variance, and which channels can be believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.chambers import CHANNEL_COUNT, CHANNEL_NAMES
from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.pneumatics.transducer import TransducerConfig

Vector = NDArray[np.float64]


STEADY_NOISE_RATIO = 2.0
"""A reading that moves more than this many times its data sheet's noise is none to take for zero. The noise is a mean
square over some fifty samples, so a sound channel's is seen within a factor of 1.5."""


class ChannelStatus(Enum):
    """What is known of a channel."""

    OK = "ok"
    OUT_OF_RANGE = "out of range"
    STUCK = "stuck"
    MISSING = "missing"


class SensingInputError(MbpamError, ValueError):
    """Samples that cannot be read: wrong shape or a time that is not finite. Nothing was changed."""


class ZeroRefusedError(MbpamError, RuntimeError):
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
        zero_step_pa: greatest distance from the last zero that it accepts unforced.
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
    zero_step_pa: float = 1000.0

    def __post_init__(self) -> None:
        require_positive(
            self, "channel_gain", "cutoff_hz", "variance_time_s", "missing_time_s", "recovery_samples", "zero_limit_pa"
        )
        require_positive(self, "zero_step_pa")
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


class _Channel:
    """One transducer: what it said last, and what is believed of it."""

    __slots__ = (
        "_changed_at_s",
        "_config",
        "_expected_noise_pa2",
        "_floor_pa2",
        "_gain_pa_v",
        "_good_samples",
        "_noise_pa2",
        "_raw_v",
        "_sampled_at_s",
        "_zero_v",
        "correction_pa",
        "pressure_pa",
        "status",
        "variance_pa2",
    )

    def __init__(self, config: SensingConfig, transducer: TransducerConfig, index: int) -> None:
        self._config = config
        self._gain_pa_v = transducer.gain_pa_v * config.channel_gain[index]
        self._zero_v = transducer.zero_v + config.channel_offset_v[index]
        self._floor_pa2 = (self._gain_pa_v * transducer.resolution_v) ** 2 / 12.0
        self._expected_noise_pa2 = (self._gain_pa_v * transducer.noise_v) ** 2 + self._floor_pa2
        self.correction_pa = 0.0
        self.forget(0.0)

    def forget(self, time_s: float) -> None:
        """Start anew at ``time_s``, keeping the zero."""
        self.status = ChannelStatus.MISSING
        # No fault to recover from yet: the first good sample counts.
        self._good_samples = self._config.recovery_samples
        self._raw_v = self.pressure_pa = self.variance_pa2 = math.nan
        self._changed_at_s = self._sampled_at_s = time_s
        self._noise_pa2 = self._expected_noise_pa2  # until there is experience

    @property
    def noise_ratio(self) -> float:
        """Noise seen lately over that of the data sheet; a pressure that moves counts as noise."""
        return math.sqrt(self._noise_pa2 / self._expected_noise_pa2)

    def update(self, time_s: float, volts: float, alpha: float, weight: float) -> None:
        """Take a sample, NaN for none; ``alpha`` and ``weight`` are the filter's and the noise estimate's gains."""
        seen = self._classify(time_s, volts)
        if seen is not ChannelStatus.OK:
            self._lose(seen)
            return
        self._good_samples += 1
        if self._good_samples >= self._config.recovery_samples:
            self.status = ChannelStatus.OK
        if self.status is ChannelStatus.OK:
            self._filter((volts - self._zero_v) * self._gain_pa_v - self.correction_pa, alpha, weight)

    def check(self, time_s: float) -> None:
        """Notice that samples stay out."""
        if time_s - self._sampled_at_s > self._config.missing_time_s:
            self._lose(ChannelStatus.MISSING)

    def _lose(self, status: ChannelStatus) -> None:
        self.status, self._good_samples = status, 0
        self.pressure_pa = self.variance_pa2 = math.nan

    def _classify(self, time_s: float, volts: float) -> ChannelStatus:
        config = self._config
        if volts != self._raw_v:
            self._raw_v, self._changed_at_s = volts, time_s
        if math.isnan(volts):
            return ChannelStatus.MISSING
        self._sampled_at_s = time_s
        if not config.valid_low_v <= volts <= config.valid_high_v:
            return ChannelStatus.OUT_OF_RANGE
        if 0.0 < config.stuck_time_s < time_s - self._changed_at_s:
            return ChannelStatus.STUCK
        return ChannelStatus.OK

    def _filter(self, raw_pa: float, alpha: float, weight: float) -> None:
        if math.isnan(self.pressure_pa):
            self.pressure_pa, self.variance_pa2 = raw_pa, self._noise_pa2
        elif alpha > 0.0:
            residual = raw_pa - self.pressure_pa
            self._noise_pa2 += weight * (0.5 * (2.0 - alpha) * residual * residual - self._noise_pa2)
            self.variance_pa2 = max(self._noise_pa2 * alpha / (2.0 - alpha), self._floor_pa2)
            self.pressure_pa += alpha * residual


class PressureSensing:
    """Reads sixteen transducers.

    Filter: y += (1 - exp(-2 pi f dt)) (x - y), the exact answer of the first-order low-pass to samples held over their
    intervals, hence stable for any interval. Noise: exponentially weighted mean square of x - y_previous, which for
    white noise of variance s2 is s2 * 2 / (2 - alpha); the filtered pressure then has s2 * alpha / (2 - alpha), never
    less than the converter's step^2 / 12. While the pressure moves, the filter's lag counts as noise, on purpose.
    """

    def __init__(self, config: SensingConfig, transducer: TransducerConfig) -> None:
        self._config = config
        self._channels = [_Channel(config, transducer, index) for index in range(CHANNEL_COUNT)]
        self._time_s = self._filtered_at_s = 0.0

    def update(self, time_s: float, volts: ArrayLike) -> PressureReading:
        """Take one sample of every channel, shape (16,) [V], NaN where a channel gave none.

        A time before the last one (a simulation started anew) forgets the filter, keeping the zero. A repeated time
        is not a new sample for the filter.

        Raises:
            SensingInputError: wrong shape or a time that is not finite.
        """
        sample = np.asarray(volts, dtype=float)
        if sample.shape != (CHANNEL_COUNT,):
            raise SensingInputError(f"volts must have shape ({CHANNEL_COUNT},), found {sample.shape}")
        self._advance(time_s)
        interval_s, self._filtered_at_s = time_s - self._filtered_at_s, time_s
        alpha = -math.expm1(-2.0 * math.pi * self._config.cutoff_hz * interval_s)
        weight = -math.expm1(-interval_s / self._config.variance_time_s)
        for channel, value in zip(self._channels, sample.tolist(), strict=True):
            channel.update(time_s, value, alpha, weight)
        return self._reading()

    def check(self, time_s: float) -> PressureReading:
        """Return the reading at ``time_s`` without a new sample: channels too old become ``MISSING``.

        Raises:
            SensingInputError: a time that is not finite.
        """
        self._advance(time_s)
        for channel in self._channels:
            channel.check(time_s)
        return self._reading()

    def zero(self, forced: bool = False) -> Vector:
        """Make the present readings the zero and return the whole correction, shape (16,) [Pa].

        A chamber with some air in it reads like a transducer whose zero is off. What tells them apart is that a zero
        hardly moves, and stands still: what does neither is taken only if ``forced``.

        Raises:
            ZeroRefusedError: a channel has no valid reading; is further than ``zero_limit_pa`` from the data sheet's
                zero, zeroing done before included; or, unforced, further than ``zero_step_pa`` from the last zero, or
                unsteady. Nothing is changed then.
        """
        for name, channel in zip(CHANNEL_NAMES, self._channels, strict=True):
            if channel.status is not ChannelStatus.OK:
                raise ZeroRefusedError(f"{name} has no valid reading: {channel.status.value}")
        correction_pa = [channel.correction_pa + channel.pressure_pa for channel in self._channels]
        limit_pa = self._config.zero_limit_pa
        for name, value in zip(CHANNEL_NAMES, correction_pa, strict=True):
            if abs(value) > limit_pa:
                raise ZeroRefusedError(
                    f"{name} reads {value:.0f} Pa before correction, more than {limit_pa:.0f} Pa from zero; "
                    "vent it first"
                )
        if not forced:
            self._refuse_doubtful_zero()
        for channel, value in zip(self._channels, correction_pa, strict=True):
            channel.correction_pa, channel.pressure_pa = value, 0.0
        return np.array(correction_pa)

    def _refuse_doubtful_zero(self) -> None:
        step_pa = self._config.zero_step_pa
        for name, channel in zip(CHANNEL_NAMES, self._channels, strict=True):
            if abs(channel.pressure_pa) > step_pa:
                raise ZeroRefusedError(
                    f"{name} reads {channel.pressure_pa:.0f} Pa, more than {step_pa:.0f} Pa from the last zero; air "
                    "may be trapped: vent it, or force the zero"
                )
            if channel.noise_ratio > STEADY_NOISE_RATIO:
                raise ZeroRefusedError(
                    f"{name} is not steady: it moves {channel.noise_ratio:.1f} times as much as its data sheet's "
                    "noise; wait, or force the zero"
                )

    def _advance(self, time_s: float) -> None:
        if not math.isfinite(time_s):
            raise SensingInputError(f"time must be finite, found {time_s}")
        if time_s < self._time_s:
            self._filtered_at_s = time_s
            for channel in self._channels:
                channel.forget(time_s)
        self._time_s = time_s

    def _reading(self) -> PressureReading:
        pressure_pa = np.array([channel.pressure_pa for channel in self._channels])
        variance_pa2 = np.array([channel.variance_pa2 for channel in self._channels])
        status = tuple([channel.status for channel in self._channels])
        return PressureReading(self._time_s, pressure_pa, variance_pa2, status)
