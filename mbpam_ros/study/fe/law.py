"""The muscle's bending law at one pressure, from unit cells held at curvatures: M(kappa), stretch and gas volume.

The muscle's bend theta = kappa L is that of the cell times the number of cells in the active length L (per unstretched
length, as a rod of constant length needs it). M is the moment to add to the gas thrust to hold it; it rises with the
bend and is zero at the free bend.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.errors import MbpamError
from mbpam_ros.study.fe.section_stiffness import SectionStiffness, section_stiffness
from mbpam_ros.study.fe.solve import StepControl
from mbpam_ros.study.fe.unit_cell import CellState, UnitCell

SHORT_WAY = StepControl(first_step=1.0, largest_step=1.0)
"""From one pressure or bend of a curve to the next one step is enough; one that is not is halved."""


class LawError(MbpamError, ValueError):
    """The moment does not rise with the bend, so no single bend belongs to a moment."""


class BendingLaw:
    """M(theta) of the active length at one pressure, sampled where it is needed.

    Args:
        cell: the unit cell.
        states: equilibria of one pressure at different bends, at least one.

    Raises:
        ValueError: no state, or states of different pressures.
    """

    def __init__(self, cell: UnitCell, states: Sequence[CellState]) -> None:
        if len({state.pressure_gauge_mpa for state in states}) != 1:
            raise ValueError("a bending law needs states of one pressure")
        self._cell = cell
        self._states = sorted(states, key=lambda state: state.angle_rad)

    @property
    def pressure_gauge_mpa(self) -> float:
        """The pressure [MPa]."""
        return self._states[0].pressure_gauge_mpa

    @property
    def bend_rad(self) -> NDArray[np.float64]:
        """Sampled bends of the active length, rising."""
        return np.array([state.angle_rad for state in self._states]) * self._cell.angle_per_muscle

    @property
    def moment_n_mm(self) -> NDArray[np.float64]:
        """Moments at the sampled bends."""
        return np.array([state.moment_n_mm for state in self._states])

    @property
    def axis_stretch(self) -> NDArray[np.float64]:
        """Stretch of the axis at the sampled bends."""
        return np.array([state.axis_stretch for state in self._states])

    @property
    def gas_volume_mm3(self) -> NDArray[np.float64]:
        """Volume of all pressurised chambers over the active length, at the sampled bends."""
        return np.array([state.gas_volume_mm3 for state in self._states]) * self._cell.angle_per_muscle

    def section_stiffness(self) -> list[SectionStiffness]:
        """Return the section's stiffness at the sampled bends."""
        return [section_stiffness(self._cell, state) for state in self._states]

    def add(self, bend_rad: float) -> None:
        """Sample one more bend, starting from the nearest sample.

        Raises:
            LoadStepError: it could not be reached.
        """
        angle = bend_rad / self._cell.angle_per_muscle
        *others, nearest = sorted(self._states, key=lambda state: -abs(state.angle_rad - angle))
        if math.isclose(nearest.angle_rad, angle, abs_tol=1e-12):
            return
        self._states.append(self._cell.held_bend(self.pressure_gauge_mpa, angle, nearest, others, SHORT_WAY))
        self._states.sort(key=lambda state: state.angle_rad)

    def cover(self, lowest_n_mm: float, highest_n_mm: float, step_rad: float) -> None:
        """Sample bends at distances of ``step_rad`` outward until the moments span the given range.

        Raises:
            LoadStepError: a bend could not be reached.
            LawError: the moment stops rising.
        """
        while self.moment_n_mm[-1] < highest_n_mm:
            self.add(self.bend_rad[-1] + step_rad)
            self._check_rising()
        while self.moment_n_mm[0] > lowest_n_mm:
            self.add(self.bend_rad[0] - step_rad)
            self._check_rising()

    def bend_and_stretch_of_moment(self) -> PchipInterpolator:
        """Return the function moment [N mm] -> (bend [rad], stretch), monotone between samples (PCHIP).

        Raises:
            LawError: the moment does not rise with the bend, or there are fewer than two samples.
        """
        self._check_rising()
        if len(self._states) < 2:
            raise LawError("one sample does not make a law; add bends")
        return PchipInterpolator(self.moment_n_mm, np.stack([self.bend_rad, self.axis_stretch], axis=1))

    def unknowns_at(self, bend_rad: float) -> NDArray[np.float64]:
        """Return the cell's unknowns at a bend of the active length.

        Interpolated linearly between samples, no further than the samples go.
        """
        bends = self.bend_rad
        bend = min(max(bend_rad, bends[0]), bends[-1])
        above = min(max(int(np.searchsorted(bends, bend)), 1), bends.size - 1)
        part = (bend - bends[above - 1]) / (bends[above] - bends[above - 1])
        return (1.0 - part) * self._states[above - 1].unknowns + part * self._states[above].unknowns

    def _check_rising(self) -> None:
        falls = np.flatnonzero(np.diff(self.moment_n_mm) <= 0.0)
        if falls.size:
            bend = math.degrees(self.bend_rad[falls[0]])
            raise LawError(
                f"at {1e3 * self.pressure_gauge_mpa:g} kPa the moment falls with the bend beyond {bend:.1f} deg: "
                "the section is bistable there"
            )
