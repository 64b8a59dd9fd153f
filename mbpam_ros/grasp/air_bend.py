"""How far fingers are bent, from the air that was let into their chambers: what pressure alone cannot tell.

A chamber's volume grows with its pressure and with the bend away from it (:mod:`~mbpam_ros.actuator.gas_volume`). The
valves' openings and the pressures give the amount of gas n that has come in since the chambers were empty (the model
:mod:`~mbpam_ros.pneumatics.iso6358`, run beside the real chambers), and

    n = p V(p, theta)

the bend theta at the measured pressure p. Fingers that an object keeps from bending hold less air at the same
pressure: at 100 kPa by 0.13 % a degree (one chamber), so an error of the valves' conductance of 1 % counts as 8 deg.

Not counted: that air warms as it is let in and cools within a second, and leaks. What valves err by adds up with all
that they move, their test pulses included, so the account ends :data:`LONGEST_ACCOUNT_S` after it began.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, FINGER_COUNT
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2, resting_bend
from mbpam_ros.gripper import Gripper
from mbpam_ros.pneumatics.chamber import AMBIENT_PA, ChamberConfig
from mbpam_ros.pneumatics.iso6358 import IsoChambers, volume_rows

Array = NDArray[np.float64]

LONGEST_GAP_S = 0.1
"""Openings that are not known for longer leave the amount unknown."""

LONGEST_ACCOUNT_S = 60.0

_BENDS_RAD = np.radians(np.arange(-30.0, 211.0, 15.0))
_HANGING = np.array([0.0, 0.0, GRAVITY_M_S2])


class AirBend:
    """Keeps account of the air in the chambers.

    Args:
        gripper: whose law says how far free fingers bend, for the flow while they move, and their volumes.
        chamber: valves, lines and supply, as they are assumed to be.

    Raises:
        ConfigError: the table of volumes cannot be read.
        RodSolutionError: the gripper's design has no rod law.
    """

    def __init__(self, gripper: Gripper, chamber: ChamberConfig) -> None:
        self._twin, self._chamber = IsoChambers(chamber, gripper.gas_law), chamber
        self._law = gripper.rod_law()
        self._geometry = gripper.rod_geometry
        self._time_s = self._begun_s = math.nan
        self._spool = np.zeros(CHANNEL_COUNT)

    @property
    def known(self) -> bool:
        """Whether the amount of air is known."""
        return math.isfinite(self._time_s)

    def begin(self, time_s: float, pressure_gauge_pa: Array) -> None:
        """Begin with fingers that hang straight under pressures (16,) near 0 [Pa gauge]."""
        self._twin.reset(np.clip(np.nan_to_num(pressure_gauge_pa), 0.0, self._chamber.supply_gauge_pa))
        self._time_s = self._begun_s = time_s
        self._spool = np.zeros(CHANNEL_COUNT)

    def forget(self) -> None:
        """Know nothing until the next beginning."""
        self._time_s = math.nan

    def update(self, time_s: float, spool: Array) -> None:
        """Take the openings (16,) that the valves are commanded from now on; those before held until now."""
        if not self.known:
            return
        gap_s = time_s - self._time_s
        old = time_s - self._begun_s > LONGEST_ACCOUNT_S
        if old or not 0.0 <= gap_s <= LONGEST_GAP_S or not np.isfinite(spool).all():
            self.forget()
            return
        if gap_s > 0.0:
            pressure = np.maximum(self._twin.pressure_gauge_pa, 0.0).reshape(FINGER_COUNT, CHAMBERS_PER_FINGER)
            free = resting_bend(*self._law.moment_and_stiffness(pressure), self._geometry, _HANGING)
            self._twin.step(self._spool, gap_s, free)
        self._time_s, self._spool = time_s, np.clip(spool, -1.0, 1.0)

    def bend_rad(self, pressure_gauge_pa: Array, under_pressure: NDArray[np.bool_]) -> Array:
        """Return the bend of each finger away from its chambers under pressure, shape (4,) [rad].

        Mean of what the chambers say, in the direction in which their pattern bends it. NaN where none is under
        pressure, or the amount of air is not known.

        Args:
            pressure_gauge_pa: measured now, shape (16,).
            under_pressure: which chambers to ask, shape (16,).
        """
        if not self.known:
            return np.full(FINGER_COUNT, np.nan)
        absolute = pressure_gauge_pa + AMBIENT_PA
        line = self._chamber.iso6358.line_volume_m3
        tables = self._twin.tables
        grid = tables.pressure_start_pa + tables.pressure_step_pa * np.arange(tables.psc.shape[0])
        amounts = np.empty((_BENDS_RAD.size, CHANNEL_COUNT))
        for row, bend in zip(amounts, _BENDS_RAD, strict=True):
            volumes = volume_rows(tables, absolute, np.full(CHANNEL_COUNT, bend), line)
            row[:] = [p * np.interp(p - AMBIENT_PA, grid, each) for p, each in zip(absolute, volumes, strict=True)]
        found = np.array([np.interp(n, amounts[:, i], _BENDS_RAD) for i, n in enumerate(self._twin.amount_j)]).reshape(
            FINGER_COUNT, CHAMBERS_PER_FINGER
        )
        asked = under_pressure.reshape(FINGER_COUNT, CHAMBERS_PER_FINGER)
        count = asked.sum(axis=1)
        # Two neighbours are each bent away from by 45 deg: they see the bend by cos 45 deg.
        share = np.where(count == 2, math.sqrt(0.5), 1.0)
        mean: Array = np.full(FINGER_COUNT, np.nan)
        np.divide(np.where(asked, found, 0.0).sum(axis=1), count * share, out=mean, where=count > 0)
        return mean
