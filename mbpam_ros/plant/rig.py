"""The paper's measuring rig (its Fig. 3), simulated: one muscle that nobody knows, clamped at its base, tip up.

A hidden muscle is one of a batch, and each of a batch is a sample of its own: what the drawing says of M0, B and the
free stretch is multiplied by what is drawn for batch and sample, and its silicone has hysteresis
(:mod:`~mbpam_ros.actuator.hysteresis`) and creeps. At each moment it stands as the planar rod of the pressure it feels
(:mod:`~mbpam_ros.actuator.planar_rod`), freely, or with its tip against a plate that stands on a scale
(:mod:`~mbpam_ros.actuator.blocked_rod`). In the clamp it is turned so that it bends in the picture of a camera at its
side, to the right.

The frame of the rig: origin at the clamp, z up along the straight muscle, x to where it bends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbpam_ros.actuator.blocked_rod import BlockedTip, PlateContact, RodLoad
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.hysteresis import felt_pressure
from mbpam_ros.actuator.planar_rod import AxisStretch, rod_tip_angle, upright_axis_m
from mbpam_ros.actuator.rod_law import PatternFactors, RodLaw
from mbpam_ros.configuration import require_positive

Array = NDArray[np.float64]

_BATCH_MOMENT, _BATCH_STIFFNESS, _PATTERN, _STRETCH = 0.08, 0.10, 0.03, 0.10
"""Standard deviations of the logarithms that are drawn: of a batch's M0 and B, of a pattern's, of the stretch."""
_HYSTERESIS_PA = (300.0, 1200.0)
_SMALLEST_CHANGE_PA = 5.0
_SMALLEST_MOMENT_N_M = 2e-4
"""Below it the tip does no more than touch its plate: 4 mN."""


@dataclass(frozen=True)
class RigConfig:
    """What a scene with a rig says of it.

    Args:
        camera: file of the camera at its side, in the rig's frame.
        muscle_seed: which hidden muscle of the batch of that seed.
        sample: which of the batch's samples is mounted, from 0.
        sample_scatter: standard deviation of M0 and B between samples of a batch, over their mean.
        creep_share, creep_time_s: part of the pressure's effect that comes late, and how late.
        scale_noise_n, scale_step_n: standard deviation of a reading, and its last digit.
        scale_offset_n: what the scale shows of nothing, at most.
        marker_rgb: colour, 0 to 1, of two strips at the muscle's ends; None: there are none.

    Raises:
        ValueError: a value out of its range.
    """

    camera: str
    muscle_seed: int
    sample: int
    sample_scatter: float
    creep_share: float
    creep_time_s: float
    scale_noise_n: float
    scale_step_n: float
    scale_offset_n: float
    marker_rgb: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        require_positive(self, "creep_time_s", "scale_step_n")
        for name in ("muscle_seed", "sample", "sample_scatter", "creep_share", "scale_noise_n", "scale_offset_n"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, found {getattr(self, name)}")
        if max(self.sample_scatter, self.creep_share) > 0.5:
            raise ValueError("sample_scatter and creep_share must be at most 0.5")
        if self.marker_rgb is not None and not all(0.0 <= value <= 1.0 for value in self.marker_rgb):
            raise ValueError(f"marker_rgb must be three numbers from 0 to 1, found {self.marker_rgb}")


@dataclass(frozen=True, eq=False)
class HiddenMuscle:
    """A muscle, and what it has over its drawing.

    Args:
        law: its own.
        psc, pdc: factors of its law over the drawing's.
        stretch_factor: of its free stretch.
        hysteresis_pa: half width of its play.
    """

    law: RodLaw
    psc: PatternFactors
    pdc: PatternFactors
    stretch_factor: float
    hysteresis_pa: float


def hidden_muscle(drawn: RodLaw, config: RigConfig) -> HiddenMuscle:
    """Return the sample of a batch that ``config`` names; equal seeds and samples give equal bits.

    Args:
        drawn: law of the drawing, of the uniform rod.
        config: of the rig.
    """
    batch = np.random.default_rng((config.muscle_seed, 0x5A))
    moment, stiffness = batch.normal(0.0, (_BATCH_MOMENT, _BATCH_STIFFNESS))
    of_pattern = batch.normal(0.0, _PATTERN, (2, 2))
    stretch = math.exp(batch.normal(0.0, _STRETCH))
    hysteresis_pa = float(batch.uniform(*_HYSTERESIS_PA))
    own = np.random.default_rng((config.muscle_seed, config.sample, 0xA5)).normal(0.0, config.sample_scatter, 2)
    moments = np.exp(moment + of_pattern[:, 0] + own[0])
    stiffnesses = np.exp(stiffness + of_pattern[:, 1] + own[1])
    psc, pdc = (PatternFactors(float(m), float(b)) for m, b in zip(moments, stiffnesses, strict=True))
    return HiddenMuscle(drawn.scaled(psc, pdc).stretched(stretch), psc, pdc, stretch, hysteresis_pa)


class MuscleRig:
    """One muscle in its clamp, with or without the plate on the scale.

    Args:
        muscle: who is mounted.
        geometry: of the uniform rod that stands for it.
        config: of the rig.
        seed: of the scale's readings.
    """

    def __init__(self, muscle: HiddenMuscle, geometry: MuscleGeometry, config: RigConfig, seed: int = 0) -> None:
        self._muscle, self._geometry, self._config = muscle, geometry, config
        self._random = np.random.default_rng((seed, 0x3C))
        self._offset_n = float(self._random.uniform(-1.0, 1.0)) * config.scale_offset_n
        self.mount(0.0, with_plate=False)

    def mount(self, azimuth_rad: float, with_plate: bool) -> None:
        """Turn the muscle in its clamp so that its azimuth points to the right; put the plate there, or away.

        The muscle forgets its past: it is taken out of its clamp.
        """
        self._toward = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad)])
        self._with_plate = with_plate
        self._felt = self._late = np.zeros(CHAMBERS_PER_FINGER)
        self._tip = BlockedTip(self._geometry)
        self._solved: tuple[Array, RodLoad, PlateContact] | None = None

    def step(self, pressure_gauge_pa: ArrayLike, dt_s: float) -> None:
        """Let pressures, shape (4,), act for ``dt_s``."""
        pressure = np.array(pressure_gauge_pa, dtype=float)
        self._felt = felt_pressure(self._felt, pressure, self._muscle.hysteresis_pa)
        gain = -math.expm1(-dt_s / self._config.creep_time_s)
        self._late = self._late + gain * (self._felt - self._late)

    @property
    def tip_angle_rad(self) -> float:
        """Turn of the tip over the clamp [rad], positive to the right.

        Raises:
            RodSolutionError: the muscle has no equilibrium.
        """
        return self._rest()[1].tip_angle_rad

    @property
    def push_n(self) -> float:
        """Force of the tip on the plate [N]; 0 without one.

        Raises:
            RodSolutionError: as :attr:`tip_angle_rad`.
        """
        return self._rest()[1].push_n

    def scale_n(self) -> float:
        """Return the next reading of the scale [N].

        Raises:
            RodSolutionError: as :attr:`tip_angle_rad`.
        """
        reading = self.push_n + self._offset_n + self._random.normal(0.0, self._config.scale_noise_n)
        return round(reading / self._config.scale_step_n) * self._config.scale_step_n

    def axis_m(self) -> Array:
        """Return the axis from clamp to tip, in the rig's frame, shape (n, 3) [m].

        Raises:
            RodSolutionError: as :attr:`tip_angle_rad`.
        """
        load, rest = self._rest()
        side = -1.0 if rest.tip_angle_rad < 0.0 else 1.0
        axis = upright_axis_m(
            abs(rest.tip_angle_rad) if rest.push_n == 0.0 else rest.tip_angle_rad,
            load.moment_n_m,
            load.stiffness_n_m2,
            self._geometry,
            load.stretch,
            rest.push_n,
            rest.friction_n,
        )
        if rest.push_n > 0.0:
            side = 1.0
        return np.column_stack([side * axis[:, 0], np.zeros(len(axis)), axis[:, 1]])

    def _rest(self) -> tuple[RodLoad, PlateContact]:
        """The load, and how the muscle is at rest under it; anew only when the pressures it feels have changed."""
        felt = self._felt - self._config.creep_share * (self._felt - self._late)
        if self._solved is None or np.abs(felt - self._solved[0]).max() > _SMALLEST_CHANGE_PA:
            load, side = self._load(felt)
            self._solved = felt, load, self._at_rest(load, side)
        return self._solved[1], self._solved[2]

    def _load(self, felt_pa: Array) -> tuple[RodLoad, float]:
        """The planar rod that the pressures make, its moment positive, and to which side it bends."""
        law = self._muscle.law
        moment, stiffness = law.moment_and_stiffness(felt_pa)
        along = float(moment @ self._toward)
        side = -1.0 if along < 0.0 else 1.0
        strains = law.strain_law(felt_pa)
        # With next to no moment the weight would bend the rod through this coupling alone, to either side.
        slope = side * float(strains.stretch_per_curvature_m @ self._toward) * (abs(along) > _SMALLEST_MOMENT_N_M)
        stretch = AxisStretch(1.0 + float(strains.free_stretch), slope, 1.0 / float(strains.axial_stiffness_n))
        return RodLoad(abs(along), float(stiffness), stretch), side

    def _at_rest(self, load: RodLoad, side: float) -> PlateContact:
        if self._with_plate and side > 0.0:
            if load.moment_n_m > _SMALLEST_MOMENT_N_M:
                return self._tip.follow(load)
            self._tip = BlockedTip(self._geometry)
        angle = rod_tip_angle(load.moment_n_m, load.stiffness_n_m2, self._geometry, stretch=load.stretch)
        return PlateContact(0.0, 0.0, side * angle, 0.0)
