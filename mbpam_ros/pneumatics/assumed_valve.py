r"""The valve, chamber and supply that loops' observers compare with: how fast a pressure moves at full opening.

As the pneumatic model that ``pneumatics.yaml`` names says of a machine. With ``lag`` (and ``ideal``, whose rates lie
within the bounds around it) the assumed first-order valve of the loops,

    fill (p_s - p) / tau,    vent p / tau.

With ``iso6358`` the orifice and the elastic chamber of :mod:`~mbpam_ros.pneumatics.iso6358`, absolute pressures with a
bar, from n = p V(p, bend) at a bend that stays:

    fill p0 C ps' psi(p' / ps') / c(p),    vent p0 C p' psi(p_a / p') / c(p),    c = V + p' dV/dp,

so that the rate vanishes as p comes to p_s, and falls where the wall gives way. The bend is not known here: V is the
mean of a straight muscle's and of one bent by :data:`GREATEST_BEND_RAD`, half-way between one chamber alone and two
neighbours. What the bend itself can move the pressure by, the air staying in, is p' (V_bent - V_straight) / c. The tank
is taken for settled with the openings of the moment as if all valves were choked, the lowest that it can be:

    C_r p_r' psi(ps' / p_r') = S C ps',    S the sum of what is open to the supply.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.pneumatics.chamber import AMBIENT_PA, REFERENCE_PA, ChamberConfig, OrificeConfig
from mbpam_ros.pneumatics.controller import ControllerConfig

Vector = NDArray[np.float64]

GREATEST_BEND_RAD = math.radians(120.0)
"""Of a finger in use."""


class AssumedValve(ABC):
    """How fast one chamber fills and vents at full opening.

    Args:
        supply_gauge_pa: p_s.
        least_drop_pa: the fastest rates are bounded with at least this pressure difference.
        refill_time_s: in which a supply that was drawn down comes up again.

    Attributes:
        lasting: whether its rates are right at any pressure but for a factor, so that what was learnt of a valve while
            it filled holds for the rest of the grasp.
    """

    lasting = False

    def __init__(self, supply_gauge_pa: float, least_drop_pa: float, refill_time_s: float) -> None:
        self.supply_gauge_pa, self.least_drop_pa, self.refill_time_s = supply_gauge_pa, least_drop_pa, refill_time_s

    @abstractmethod
    def fill_pa_s(self, pressure_gauge_pa: Vector, supply_gauge_pa: float) -> Vector:
        """Return dp/dt of a valve fully open to a supply of this pressure, shape as the pressures, never negative."""

    @abstractmethod
    def vent_pa_s(self, pressure_gauge_pa: Vector) -> Vector:
        """Return -dp/dt of a valve fully open to ambient, shape as the pressures, never negative."""

    @abstractmethod
    def drawn_supply_gauge_pa(self, opening: float) -> float:
        """Return the lowest that the supply can be while valves are open to it that make ``opening`` together [1]."""

    @abstractmethod
    def bend_pa(self, pressure_gauge_pa: Vector) -> Vector:
        """Return by how much the bend of a muscle alone can move the pressure, the air in it staying [Pa]."""


class FirstOrderValve(AssumedValve):
    """The valve of the loops' feed-forward, and a supply that nothing draws down.

    Args:
        supply_gauge_pa, least_drop_pa: as for every valve.
        time_constant_s: tau.
    """

    def __init__(self, supply_gauge_pa: float, least_drop_pa: float, time_constant_s: float) -> None:
        super().__init__(supply_gauge_pa, least_drop_pa, 1.0)
        self._time_constant_s = time_constant_s

    def fill_pa_s(self, pressure_gauge_pa: Vector, supply_gauge_pa: float) -> Vector:
        """Return (p_s - p) / tau."""
        rate: Vector = np.maximum(supply_gauge_pa - pressure_gauge_pa, 0.0) / self._time_constant_s
        return rate

    def vent_pa_s(self, pressure_gauge_pa: Vector) -> Vector:
        """Return p / tau."""
        rate: Vector = np.maximum(pressure_gauge_pa, 0.0) / self._time_constant_s
        return rate

    def drawn_supply_gauge_pa(self, opening: float) -> float:
        """Return the supply: the manifold is kept full."""
        return self.supply_gauge_pa

    def bend_pa(self, pressure_gauge_pa: Vector) -> Vector:
        """Return zeros: such a chamber has no volume."""
        return np.zeros_like(pressure_gauge_pa)


class OrificeValve(AssumedValve):
    """An orifice of ISO 6358 on a chamber with elastic walls, fed from a tank through a regulator.

    Args:
        supply_gauge_pa, least_drop_pa: as for every valve.
        orifice: conductances and volumes.
        gas_law: file of the chambers' volumes; None for the paper's muscle.

    Raises:
        ConfigError: there is no bending law with gas volumes.
    """

    lasting = True

    def __init__(
        self, supply_gauge_pa: float, least_drop_pa: float, orifice: OrificeConfig, gas_law: Path | None = None
    ) -> None:
        regulator_m3_s = REFERENCE_PA * max(orifice.regulator_conductance_m3_s_pa, 1e-15)
        super().__init__(supply_gauge_pa, least_drop_pa, orifice.supply_volume_m3 / regulator_m3_s)
        self._orifice = orifice
        self._grid_gauge_pa, bent_m3 = _volumes(orifice.line_volume_m3, gas_law)
        half_m3 = bent_m3.mean(axis=1)
        slope = np.gradient(half_m3, self._grid_gauge_pa)
        self._capacity_m3 = half_m3 + (self._grid_gauge_pa + AMBIENT_PA) * slope
        self._bend_pa = (self._grid_gauge_pa + AMBIENT_PA) * np.ptp(bent_m3, axis=1) / self._capacity_m3

    def fill_pa_s(self, pressure_gauge_pa: Vector, supply_gauge_pa: float) -> Vector:
        """Return p0 C ps' psi(p' / ps') / c(p)."""
        supply_pa = supply_gauge_pa + AMBIENT_PA
        share = flow_share((pressure_gauge_pa + AMBIENT_PA) / supply_pa, self._orifice.critical_ratio)
        return self._rate(supply_pa * share, pressure_gauge_pa)

    def vent_pa_s(self, pressure_gauge_pa: Vector) -> Vector:
        """Return p0 C p' psi(p_a / p') / c(p)."""
        absolute_pa = np.maximum(pressure_gauge_pa, 0.0) + AMBIENT_PA
        share = flow_share(AMBIENT_PA / absolute_pa, self._orifice.critical_ratio)
        return self._rate(absolute_pa * share, pressure_gauge_pa)

    def drawn_supply_gauge_pa(self, opening: float) -> float:
        """Return ps of a tank that has settled with as much open to it, all choked: the root of an ellipse's law."""
        orifice, regulated_pa = self._orifice, self.supply_gauge_pa + AMBIENT_PA
        drawn, fed = opening * orifice.sonic_conductance_m3_s_pa, orifice.regulator_conductance_m3_s_pa
        b = orifice.critical_ratio
        if drawn <= 0.0:
            return self.supply_gauge_pa
        if fed <= b * drawn:  # the regulator itself is choked
            return regulated_pa * fed / drawn - AMBIENT_PA
        span2, k2 = (1.0 - b) ** 2, (drawn / fed) ** 2
        a = 1.0 + span2 * k2
        return regulated_pa * (b + math.sqrt(b * b - a * (b * b - span2))) / a - AMBIENT_PA

    def bend_pa(self, pressure_gauge_pa: Vector) -> Vector:
        """Return p' (V(p, bent) - V(p, straight)) / c(p)."""
        bend_pa: Vector = np.interp(pressure_gauge_pa, self._grid_gauge_pa, self._bend_pa)
        return bend_pa

    def _rate(self, flow_pa: Vector, pressure_gauge_pa: Vector) -> Vector:
        capacity_m3 = np.interp(pressure_gauge_pa, self._grid_gauge_pa, self._capacity_m3)
        rate: Vector = REFERENCE_PA * self._orifice.sonic_conductance_m3_s_pa * flow_pa / capacity_m3
        return rate


def flow_share(ratio: Vector, critical_ratio: float) -> Vector:
    """Return psi of a ratio of absolute pressures behind and before an orifice (ISO 6358-1), 0 above 1."""
    x = (np.minimum(np.maximum(ratio, critical_ratio), 1.0) - critical_ratio) / (1.0 - critical_ratio)
    share: Vector = np.sqrt(1.0 - x * x)
    return share


def _volumes(line_volume_m3: float, gas_law: Path | None) -> tuple[Vector, Vector]:
    """Return V [m3] of a chamber and its line on a grid of pressures [Pa gauge], straight and bent: (n,), (n, 2)."""
    from mbpam_ros.actuator.gas_volume import gas_volume_tables  # loads scipy, which other valves do without

    tables = gas_volume_tables(gas_law)
    grid_pa = tables.pressure_start_pa + tables.pressure_step_pa * np.arange(tables.psc.shape[0], dtype=np.float64)
    bends_rad = tables.bend_start_rad + tables.bend_step_rad * np.arange(tables.psc.shape[1])
    alone, paired = (
        np.array([np.interp(share * np.array([0.0, GREATEST_BEND_RAD]), bends_rad, row) for row in table])
        for table, share in ((tables.psc, 1.0), (tables.pdc, math.sqrt(2.0)))
    )
    volume_m3: Vector = line_volume_m3 + 0.5 * (alone + paired)
    return grid_pa, volume_m3


def assumed_valve(
    model: str, chamber: ChamberConfig, loops: ControllerConfig, gas_law: Path | None = None
) -> AssumedValve:
    """Return the valve that a machine like the pneumatic ``model`` has.

    Args:
        model: ``ideal``, ``lag`` or ``iso6358``.
        chamber: valves and volumes, of which ``iso6358`` knows.
        loops: what they assume of supply and valve.
        gas_law: file of the chambers' volumes, for ``iso6358``; None for the paper's muscle.

    Raises:
        ConfigError: the model needs gas volumes, and there are none.
    """
    if model == "iso6358":
        return OrificeValve(loops.supply_gauge_pa, loops.least_drop_pa, chamber.iso6358, gas_law)
    return FirstOrderValve(loops.supply_gauge_pa, loops.least_drop_pa, loops.fill_time_constant_s)
