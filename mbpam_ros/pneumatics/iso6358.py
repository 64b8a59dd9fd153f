r"""Model ``iso6358``: orifice flow between supply, chambers and ambient, isothermal, implicit in time.

The flow through an orifice of sonic conductance C and critical ratio b from p1 to p2 < p1 (absolute), in the volume it
would have at the reference pressure p0 = 100 kPa (ANR) and the gas's own temperature (ISO 6358-1, section 5):

    Q = C p1 psi(p2 / p1),   psi(r) = 1 for r <= b,   sqrt(1 - ((r - b) / (1 - b))^2) above,

and proportional to 1 - r for r > 0.995, where the flow is laminar and the square root would be infinitely steep. With
the amount of gas n = p V (isothermal), a chamber of volume V(p, bend) and the supply tank V_s obey

    dn/dt = p0 (|s| Q_fill(p_s -> p) or - |s| Q_vent(p -> p_a), - Q_leak(p -> p_a)),
    V_s dp_s/dt = p0 (Q_regulator(p_r -> p_s) - sum |s| Q_fill).

Scheme: backward Euler of at most ``sub_step_s``, the spool's motion entering by its exact time integral; first order,
L-stable, and free of overshoot at any step, since each equation is a monotone function of its own unknown: p V - n
rises and the flow in falls with p. A flow stops where the pressures meet. The 17 equations form an arrow: for a given
p_s each chamber is one scalar equation, which leaves one for p_s; all by Newton's method on a bracket.

Not modelled: heat (a filling chamber warms), inertia and friction of the air in the lines, the muscle's volume between
the ends of a step (the bend is that of its start, n is kept when it changes).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT
from mbpam_ros.actuator.gas_volume import GasVolumeTables, chamber_bend_rad, gas_volume_tables
from mbpam_ros.pneumatics.chamber import AMBIENT_PA, REFERENCE_PA, ChamberConfig, PneumaticModel, Vector

LAMINAR_RATIO = 0.995
_TOLERANCE_PA = 1e-6
_LEAST_PA = 1.0
_MOST_ITERATIONS = 80
_MOST_STEPS = 400
"""In one call, 1 s by default; in a longer one the steps grow, and little but its end state can be asked of it."""


class Orifices(NamedTuple):
    """C [m3/(s Pa)] of a valve, a leak and the regulator, b of all, volumes [m3], regulated pressure [Pa absolute]."""

    valve: float
    leak: float
    regulator: float
    critical_ratio: float
    line_volume: float
    supply_volume: float
    regulated: float


@njit(cache=True, nogil=True)
def orifice_flow(critical_ratio: float, from_pa: float, to_pa: float) -> tuple[float, float, float]:
    """Return p0 Q / C [Pa2] between two absolute pressures and its slopes with ``from_pa`` and ``to_pa`` [Pa].

    Negative where it flows back.
    """
    high, low = max(from_pa, to_pa), min(from_pa, to_pa)
    ratio, span = low / high, 1.0 - critical_ratio
    psi, slope = 1.0, 0.0
    if ratio > critical_ratio:
        x = (min(ratio, LAMINAR_RATIO) - critical_ratio) / span
        psi = math.sqrt(1.0 - x * x)
        slope = -x / (span * psi)
        if ratio > LAMINAR_RATIO:
            slope = -psi / (1.0 - LAMINAR_RATIO)
            psi *= (1.0 - ratio) / (1.0 - LAMINAR_RATIO)
    flow, with_high, with_low = REFERENCE_PA * high * psi, REFERENCE_PA * (psi - ratio * slope), REFERENCE_PA * slope
    if from_pa >= to_pa:
        return flow, with_high, with_low
    return -flow, -with_low, -with_high


@njit(cache=True, nogil=True)
def volume_rows(tables: GasVolumeTables, pressure: Vector, bend_rad: Vector, line_volume: float) -> Vector:
    """Return the volumes [m3] of all chambers with their lines on the tables' pressures, shape (16, pressures).

    Args:
        pressure: absolute, shape (16,): how much a neighbour's pressure shares in the volume.
        bend_rad: the bend away from each chamber, shape (16,).
    """
    rows = np.full((pressure.shape[0], tables.psc.shape[0]), line_volume)
    for c in range(rows.shape[0]):
        first, own = c - c % CHAMBERS_PER_FINGER, max(pressure[c] - AMBIENT_PA, 1.0)
        before, after = first + (c + 3) % CHAMBERS_PER_FINGER, first + (c + 1) % CHAMBERS_PER_FINGER
        neighbour = min(max(pressure[before] - AMBIENT_PA, pressure[after] - AMBIENT_PA, 0.0) / own, 1.0)
        for paired in range(2):
            table = tables.pdc if paired else tables.psc
            weight = neighbour if paired else 1.0 - neighbour
            bend = bend_rad[c] * math.sqrt(2.0) if paired else bend_rad[c]
            place = (bend - tables.bend_start_rad) / tables.bend_step_rad
            j = int(min(max(place, 0.0), table.shape[1] - 2.0))
            t = min(max(place - j, 0.0), 1.0)
            for i in range(rows.shape[1]):
                rows[c, i] += weight * ((1.0 - t) * table[i, j] + t * table[i, j + 1])
    return rows


@njit(cache=True, nogil=True)
def gas_amount(tables: GasVolumeTables, row: Vector, pressure_pa: float) -> tuple[float, float]:
    """Return n = p V [J] of a chamber at an absolute pressure, and dn/dp; V is constant beyond its tables."""
    place = (pressure_pa - AMBIENT_PA - tables.pressure_start_pa) / tables.pressure_step_pa
    i = int(min(max(place, 0.0), row.shape[0] - 2.0))
    t = place - i
    rise = (row[i + 1] - row[i]) / tables.pressure_step_pa if 0.0 <= t <= 1.0 else 0.0
    volume = row[i] + min(max(t, 0.0), 1.0) * (row[i + 1] - row[i])
    return pressure_pa * volume, volume + pressure_pa * rise


@njit(cache=True, nogil=True)
def _within(low: float, high: float, here: float, guess: float, before_pa: float) -> float:
    """Return Newton's guess, or the middle of the bracket (its end doubled while it is open).

    The middle is taken where the guess is outside, or no nearer than half of the step before the last, ``before_pa``:
    between the kinks of the flow and of the volume Newton's method would go to and fro.
    """
    if low < guess < high and abs(guess - here) <= 0.5 * before_pa:
        return guess
    return 0.5 * (low + high) if high < np.inf else 2.0 * low + _LEAST_PA


@njit(cache=True, nogil=True)
def _chamber_pressure(
    start_pa: float, amount: float, fill: float, loss: float, supply_pa: float, critical_ratio: float,
    tables: GasVolumeTables, row: Vector,
) -> tuple[float, float, float]:  # fmt: skip
    """Solve one chamber's implicit step.

    Args:
        start_pa: where to begin looking, absolute.
        amount: n before the step [J].
        fill, loss: time integrals of conductance to the supply and to ambient [m3/Pa].

    Returns:
        The absolute pressure after the step, the gas that came from the supply [J] and its slope with ``supply_pa``.
    """
    low, high, pressure = _LEAST_PA, np.inf, start_pa
    last_pa = before_pa = np.inf
    for _ in range(_MOST_ITERATIONS):
        now, rise = gas_amount(tables, row, pressure)
        filled, with_supply, with_pressure = orifice_flow(critical_ratio, supply_pa, pressure)
        lost, loss_rise, _ = orifice_flow(critical_ratio, pressure, AMBIENT_PA)
        left = now - amount - fill * filled + loss * lost
        slope = rise - fill * with_pressure + loss * loss_rise
        if abs(left) < _TOLERANCE_PA * slope:
            break
        if left > 0.0:
            high = pressure
        else:
            low = pressure
        here, pressure = pressure, _within(low, high, pressure, pressure - left / slope, before_pa)
        before_pa, last_pa = last_pa, abs(pressure - here)
    return pressure, fill * filled, fill * with_supply * (1.0 + fill * with_pressure / slope)


@njit(cache=True, nogil=True)
def advance(
    pressure: Vector, supply_pa: float, opening_s: Vector, duration_s: float, bend_rad: Vector, amount: Vector,
    steps: int, orifices: Orifices, tables: GasVolumeTables,
) -> float:  # fmt: skip
    """Advance the chambers' pressures (16,) [Pa abs] in place; return the supply's.

    Args:
        opening_s: time integrals of the openings, fill positive, shape (16,).
        bend_rad: away from each chamber, shape (16,).
        amount: n of the chambers [J], shape (16,), kept when the volume changes with the bend.
    """
    size, b = pressure.shape[0], orifices.critical_ratio
    h, after = duration_s / steps, np.empty(size)
    for _ in range(steps):
        rows = volume_rows(tables, pressure, bend_rad, orifices.line_volume)
        begun_pa = supply_pa
        low, high = _LEAST_PA, np.inf
        last_pa = before_pa = np.inf
        for _ in range(_MOST_ITERATIONS):
            left, slope = orifices.supply_volume * (supply_pa - begun_pa), orifices.supply_volume
            if orifices.regulated > supply_pa:  # a regulator does not relieve
                fed, _, with_supply = orifice_flow(b, orifices.regulated, supply_pa)
                left -= h * orifices.regulator * fed
                slope -= h * orifices.regulator * with_supply
            for i in range(size):
                share = opening_s[i] / steps
                fill, vent = orifices.valve * max(share, 0.0), orifices.valve * max(-share, 0.0)
                after[i], taken, with_supply = _chamber_pressure(
                    pressure[i], amount[i], fill, vent + h * orifices.leak, supply_pa, b, tables, rows[i]
                )
                left += taken
                slope += with_supply
            if abs(left) < _TOLERANCE_PA * slope:
                break
            if left > 0.0:
                high = supply_pa
            else:
                low = supply_pa
            here, supply_pa = supply_pa, _within(low, high, supply_pa, supply_pa - left / slope, before_pa)
            before_pa, last_pa = last_pa, abs(supply_pa - here)
        for i in range(size):
            pressure[i] = after[i]
            amount[i] = gas_amount(tables, rows[i], pressure[i])[0]
    return supply_pa


class IsoChambers(PneumaticModel):
    """Sixteen chambers with a volume of their own, fed through orifices from one tank."""

    has_volume = True

    def __init__(self, config: ChamberConfig, gas_law: Path | None = None) -> None:
        orifice = config.iso6358
        self._tables = gas_volume_tables(gas_law)
        self._orifices = Orifices(
            valve=orifice.sonic_conductance_m3_s_pa,
            leak=orifice.leak_conductance_m3_s_pa,
            regulator=orifice.regulator_conductance_m3_s_pa,
            critical_ratio=orifice.critical_ratio,
            line_volume=orifice.line_volume_m3,
            supply_volume=orifice.supply_volume_m3,
            regulated=config.supply_gauge_pa + AMBIENT_PA,
        )
        super().__init__(config, gas_law)

    @property
    def tables(self) -> GasVolumeTables:
        """The chambers' volumes."""
        return self._tables

    @property
    def amount_j(self) -> Vector:
        """Gas in each chamber and its line, n = p V [J], shape (16,)."""
        return self._amount.copy()

    def reset(self, pressure_gauge_pa: ArrayLike = 0.0) -> None:
        """Close all valves at the given pressures, muscles straight, the tank at the regulated pressure."""
        super().reset(pressure_gauge_pa)
        absolute = self._pressure + AMBIENT_PA
        self._bend_rad = np.zeros(CHANNEL_COUNT)
        rows = volume_rows(self._tables, absolute, self._bend_rad, self._orifices.line_volume)
        self._amount = np.array([gas_amount(self._tables, row, p)[0] for row, p in zip(rows, absolute, strict=True)])

    def seep(self, out_1_s: Vector, in_1_s: Vector, dt_s: float) -> Vector:
        """As for every model; as much gas goes as the pressure asks for, at the bend there is."""
        before_pa = self._pressure + AMBIENT_PA
        pressure = super().seep(out_1_s, in_1_s, dt_s)
        rows = volume_rows(self._tables, before_pa, self._bend_rad, self._orifices.line_volume)
        for channel in np.flatnonzero(out_1_s + in_1_s > 0.0):
            after, _ = gas_amount(self._tables, rows[channel], pressure[channel] + AMBIENT_PA)
            self._amount[channel] += after - gas_amount(self._tables, rows[channel], before_pa[channel])[0]
        return pressure

    def _flow(self, opening_time_s: Vector, duration_s: float, bend_rad: Vector) -> Vector:
        absolute = self._pressure + AMBIENT_PA
        self._bend_rad = chamber_bend_rad(bend_rad).ravel()
        if self._fed_pa < self._supply_pa and self._fed_pa == 0.0:
            self._supply_pa *= math.exp(-duration_s / self._config.supply_time_constant_s)
        supply = advance(
            absolute,
            self._supply_pa + AMBIENT_PA,
            opening_time_s,
            duration_s,
            self._bend_rad,
            self._amount,
            min(math.ceil(duration_s / self._config.iso6358.sub_step_s), _MOST_STEPS),
            self._orifices._replace(regulated=self._fed_pa + AMBIENT_PA),
            self._tables,
        )
        self._supply_pa = supply - AMBIENT_PA
        return absolute - AMBIENT_PA
