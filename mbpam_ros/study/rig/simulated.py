"""The rig without ROS: a hidden muscle whose pressures, pictures and scale err as real ones do, in simulated time.

The chambers follow what is asked for with a lag of first order, and transducers have their noise. Pictures are not
drawn, which would take a hundred times as long; a bend errs as one from a picture does
(:mod:`~mbpam_ros.vision.side_view`): by a gain of a tilted camera, the same for a mount, and by noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.actuator.planar_rod import RodSolutionError
from mbpam_ros.plant.rig import MuscleRig
from mbpam_ros.study.rig.procedure import BEND, FORCE, Mount, Reading, RigError

_PERIOD_S = 0.2
_LAG_S = 0.15
_PRESSURE_NOISE_PA = 100.0
_CAMERA_GAIN, _CAMERA_NOISE_RAD = 0.003, math.radians(0.15)
_SCALE_GAIN = 0.003
_REMOUNTED = 0.004
"""Standard deviation by which one and the same muscle bends and pushes differently when it is mounted again."""


class SimulatedRig:
    """A :class:`~mbpam_ros.study.rig.procedure.Rig` around a hidden muscle.

    Args:
        rig: the muscle in its clamp.
        seed: of all noise.
    """

    def __init__(self, rig: MuscleRig, seed: int) -> None:
        self._rig, self._random = rig, np.random.default_rng((seed, 0x77))
        self._scale_gain = 1.0 + self._random.normal(0.0, _SCALE_GAIN)
        self._time_s = 0.0
        self._wanted = self._pressure = np.zeros(CHAMBERS_PER_FINGER)
        self._gain = 1.0

    def mount(self, mount: Mount) -> None:
        """Put the muscle up so."""
        self._rig.mount(math.radians(mount.azimuth_deg), with_plate=mount.quantity == FORCE)
        self._wanted = self._pressure = np.zeros(CHAMBERS_PER_FINGER)
        again = self._random.normal(0.0, _REMOUNTED)
        self._gain = math.exp(again + self._random.normal(0.0, _CAMERA_GAIN if mount.quantity == BEND else 0.0))

    def command(self, pressure_gauge_pa: Sequence[float]) -> None:
        """Ask for pressures."""
        self._wanted = np.array(pressure_gauge_pa, dtype=float)

    def read(self) -> Reading:
        """Return what is read a fifth of a second later.

        Raises:
            RigError: the muscle stands in no equilibrium.
        """
        self._time_s += _PERIOD_S
        gain = -math.expm1(-_PERIOD_S / _LAG_S)
        self._pressure = self._pressure + gain * (self._wanted - self._pressure)
        self._rig.step(self._pressure, _PERIOD_S)
        try:
            bend, scale = self._rig.tip_angle_rad, self._rig.scale_n()
            push = self._rig.push_n
        except RodSolutionError as error:
            raise RigError(f"the simulated muscle falls over: {error}") from error
        noisy = self._pressure + self._random.normal(0.0, _PRESSURE_NOISE_PA, CHAMBERS_PER_FINGER)
        return Reading(
            self._time_s,
            tuple(noisy.tolist()),
            self._gain * bend + self._random.normal(0.0, _CAMERA_NOISE_RAD),
            scale + push * (self._gain * self._scale_gain - 1.0),
        )
