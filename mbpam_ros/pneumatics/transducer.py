"""The pressure transducer: pressure to volts, with noise, as its converter reads them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.configuration import require_positive


@dataclass(frozen=True)
class TransducerConfig:
    """Data sheet of the transducers and of the converter behind them.

    Args:
        zero_v: volts at 0 Pa gauge.
        full_scale_v: volts at full scale.
        full_scale_gauge_pa: pressure at full scale.
        noise_v: standard deviation of the white noise of one sample.
        adc_bits: resolution of the converter.
        adc_reference_v: the converter reads 0 V to this.
    """

    zero_v: float
    full_scale_v: float
    full_scale_gauge_pa: float
    noise_v: float
    adc_bits: int
    adc_reference_v: float

    def __post_init__(self) -> None:
        require_positive(self, "full_scale_gauge_pa", "adc_bits", "adc_reference_v")
        if self.noise_v < 0.0:
            raise ValueError(f"noise_v must not be negative, found {self.noise_v}")
        if not 0.0 <= self.zero_v < self.full_scale_v <= self.adc_reference_v:
            raise ValueError(
                "volts must rise as 0 <= zero_v < full_scale_v <= adc_reference_v, found "
                f"{self.zero_v}, {self.full_scale_v}, {self.adc_reference_v}"
            )

    @property
    def gain_pa_v(self) -> float:
        """Pressure per volt [Pa/V]."""
        return self.full_scale_gauge_pa / (self.full_scale_v - self.zero_v)

    @property
    def resolution_v(self) -> float:
        """Volts of one count of the converter."""
        resolution_v: float = self.adc_reference_v / 2**self.adc_bits
        return resolution_v


class Transducer:
    """A set of equal transducers with noise of their own. The same seed gives the same bits."""

    def __init__(self, config: TransducerConfig, channels: int, seed: int) -> None:
        self._config = config
        self._channels = channels
        self._random = np.random.default_rng(seed)

    def measure(self, pressure_gauge_pa: ArrayLike) -> NDArray[np.float64]:
        """Return one converted sample of each channel [V] for the pressures, shape (channels,) [Pa gauge].

        Pressures beyond the converter's range saturate.

        Raises:
            ValueError: wrong shape or a pressure that is not finite.
        """
        config = self._config
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        if pressure.shape != (self._channels,):
            raise ValueError(f"pressures must have shape ({self._channels},), found {pressure.shape}")
        if not np.isfinite(pressure).all():
            channel = int(np.argmin(np.isfinite(pressure)))
            raise ValueError(f"pressure of channel index {channel} is {pressure[channel]}, cannot be measured")
        volts = config.zero_v + pressure / config.gain_pa_v
        volts += config.noise_v * self._random.standard_normal(self._channels)
        counts = np.rint(volts / config.resolution_v)
        shown: NDArray[np.float64] = np.minimum(np.maximum(counts, 0.0), 2**config.adc_bits - 1)
        return shown * config.resolution_v
