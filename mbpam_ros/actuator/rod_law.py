"""The muscle's rod law M(p, kappa) = B(p) kappa - M0(p): what four chamber pressures do to a bending rod.

One chamber under pressure (PSC) and two adjacent ones (PDC) have laws of their own, each an intrinsic moment M0 and a
bending stiffness B over pressure, from the finite element unit cell. Any other four pressures are blended.

Let u = p1 - p3 and v = p2 - p4 be the pressure differences along the two diagonals and q = min(|u|, |v|). With
subscripts S for PSC and D for PDC

    M_u = -sgn(u) (M0_S(|u|) + M0_D(q) / sqrt(2) - M0_S(q))     along the azimuth of chamber 1, M_v likewise (chamber 2)
    B   = B_S(max(|u|, |v|)) + B_D(q) - B_S(q)

PSC (q = 0) and PDC (|u| = |v|) come back exactly, a quarter turn or a mirror of the pressures turns or mirrors the
moment, opposite chambers at equal pressure cancel, and all is continuous. B_S(0) = B_D(0) = B0, because an
unpressurised cross-section of fourfold symmetry is isotropic; with it the stiffness is also
B0 + d_S(|u|) + d_S(|v|) + d_D(q) - 2 d_S(q), where d = B - B0.

B stays positive: both stiffnesses rise with pressure in every calibrated design of the sampled domain, so B >= B0.
Laws for which a blend of PSC and PDC would not be positive are refused.

That equal pressure in opposite chambers changes neither M0 nor B is an assumption (no data).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.actuator.tables import read_table

NOMINAL_PRESSURE_GAUGE_PA = 100e3
"""The pressure at which the paper states its bends and forces."""

LARGEST_PRESSURE_GAUGE_PA = 200e3
"""End of the tables. Above 100 kPa the laws are straight lines (no data); above this, constant."""

# B at 100 kPa of the line M = B kappa - M0 at a = 2.5, b = 2.0 mm [N m2]; config/data/README.md.
_PDC_STIFFNESS_N_M2 = 1919e-6
_PSC_STIFFNESS_N_M2 = 1495e-6

_GRID_STEP_PA = 100.0
_FE_ACTIVE_LENGTH_M = 0.100
_ROOT_HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class PatternFactors:
    """What a calibration multiplies the law of one pattern (PSC or PDC) by: M0, and B at 100 kPa."""

    moment: float = 1.0
    stiffness: float = 1.0


@dataclass(frozen=True, eq=False)
class RodLaw:
    """Intrinsic moment and stiffness over pressure, for PSC and PDC, on one uniform grid from 0 gauge.

    Args:
        pressure_gauge_pa: the grid, shape (n,), rising from 0.
        psc_moment_n_m, pdc_moment_n_m: M0 on the grid, shape (n,), 0 at the start.
        psc_stiffness_n_m2, pdc_stiffness_n_m2: B on the grid, shape (n,), positive, equal at the start.

    Raises:
        ValueError: the tables break one of these.
    """

    pressure_gauge_pa: NDArray[np.float64]
    psc_moment_n_m: NDArray[np.float64]
    pdc_moment_n_m: NDArray[np.float64]
    psc_stiffness_n_m2: NDArray[np.float64]
    pdc_stiffness_n_m2: NDArray[np.float64]

    def __post_init__(self) -> None:
        grid = self.pressure_gauge_pa
        if grid.ndim != 1 or grid[0] != 0.0 or np.any(np.diff(grid) <= 0.0):
            raise ValueError("pressure_gauge_pa must rise from 0")
        if self.psc_moment_n_m[0] != 0.0 or self.pdc_moment_n_m[0] != 0.0:
            raise ValueError("the intrinsic moments must be 0 without pressure")
        softest_beyond = np.minimum.accumulate(self.psc_stiffness_n_m2[::-1])[::-1]  # min B_S over all |u| >= q
        if (softest_beyond + self.pdc_stiffness_n_m2 - self.psc_stiffness_n_m2).min() <= 0.0:
            raise ValueError("the bending stiffness must be positive for all pressures")
        if not math.isclose(self.psc_stiffness_n_m2[0], self.pdc_stiffness_n_m2[0], rel_tol=1e-9):
            raise ValueError("without pressure PSC and PDC must have one stiffness")
        # What the blend adds for the second diagonal, tabulated once for the hot path.
        object.__setattr__(self, "_moment_both", self.pdc_moment_n_m * _ROOT_HALF - self.psc_moment_n_m)
        object.__setattr__(self, "_stiffness_both", self.pdc_stiffness_n_m2 - self.psc_stiffness_n_m2)

    def moment_and_stiffness(self, pressure_gauge_pa: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return M0 and B for the pressures of chambers 1 to 4.

        Args:
            pressure_gauge_pa: shape (..., 4).

        Returns:
            M0 [N m] in bend components (it points toward the bend it makes), shape (..., 2), and B [N m2], shape
            (...). NaN where a pressure is NaN.

        Raises:
            ValueError: the last axis does not hold four pressures.
        """
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        if pressure.shape[-1:] != (CHAMBERS_PER_FINGER,):
            raise ValueError(f"expected pressures of four chambers in the last axis, found shape {pressure.shape}")
        grid = self.pressure_gauge_pa
        along = pressure[..., :2] - pressure[..., 2:]
        size = np.abs(along)
        both, most = size.min(axis=-1), size.max(axis=-1)
        moment_both = np.interp(both, grid, self._moment_both)
        toward = -np.sign(along) * (np.interp(size, grid, self.psc_moment_n_m) + moment_both[..., None])
        moment = np.empty_like(along)  # from the diagonals (azimuth 45, 135 deg) to x, y
        moment[..., 0] = _ROOT_HALF * (toward[..., 0] - toward[..., 1])
        moment[..., 1] = _ROOT_HALF * (toward[..., 0] + toward[..., 1])
        stiffness = np.interp(most, grid, self.psc_stiffness_n_m2) + np.interp(both, grid, self._stiffness_both)
        return moment, stiffness

    def at_nominal_pressure(self, pattern: str) -> tuple[float, float]:
        """Return M0 [N m] and B [N m2] at 100 kPa of the pattern ``psc`` or ``pdc``.

        Raises:
            ValueError: another pattern.
        """
        tables = {
            "psc": (self.psc_moment_n_m, self.psc_stiffness_n_m2),
            "pdc": (self.pdc_moment_n_m, self.pdc_stiffness_n_m2),
        }
        if pattern not in tables:
            raise ValueError(f"unknown pattern {pattern!r}; known: {', '.join(tables)}")
        moment, stiffness = (
            float(np.interp(NOMINAL_PRESSURE_GAUGE_PA, self.pressure_gauge_pa, table)) for table in tables[pattern]
        )
        return moment, stiffness

    def scaled(self, psc: PatternFactors, pdc: PatternFactors) -> RodLaw:
        """Return the law with M0 multiplied, and B multiplied at 100 kPa, per pattern.

        PDC's stiffness keeps its shape. PSC's keeps its shape between the common stiffness without pressure, which
        PDC sets, and its own at 100 kPa.
        """
        pdc_stiffness = pdc.stiffness * self.pdc_stiffness_n_m2
        psc_nominal = psc.stiffness * self.at_nominal_pressure("psc")[1]
        return RodLaw(
            pressure_gauge_pa=self.pressure_gauge_pa,
            psc_moment_n_m=psc.moment * self.psc_moment_n_m,
            pdc_moment_n_m=pdc.moment * self.pdc_moment_n_m,
            psc_stiffness_n_m2=_start_at(
                pdc_stiffness[0], psc_nominal, self.psc_stiffness_n_m2, self.at_nominal_pressure("psc")[1]
            ),
            pdc_stiffness_n_m2=pdc_stiffness,
        )


@functools.lru_cache(maxsize=1)
def finite_element_rod_law() -> RodLaw:
    """Return the law of the finite element unit cell at a = 2.5, b = 2.0 mm, as in ``config/data``.

    B(p) is B at 100 kPa times the tabulated shape. M0(p) = B(p) kappa0(p) with kappa0 the curvature of the free unit
    cell, both interpolated monotonically (PCHIP) and continued above 100 kPa with their end slopes.

    Raises:
        ConfigError: a table is missing or unreadable.
    """
    grid = np.arange(0.0, LARGEST_PRESSURE_GAUGE_PA + _GRID_STEP_PA, _GRID_STEP_PA)
    cell_kpa, pdc_deg, psc_deg = read_table("fe_unit_cell.csv", "p_kpa", "pdc_theta_deg", "psc_theta_deg")
    shape_kpa, shape = read_table("fe_rod_law_shape.csv", "p_kpa", "b_over_b_100")
    stiffness_shape = _continued(1e3 * shape_kpa, shape, grid)
    pdc_stiffness = _PDC_STIFFNESS_N_M2 * stiffness_shape
    psc_stiffness = _start_at(pdc_stiffness[0], _PSC_STIFFNESS_N_M2, stiffness_shape, 1.0)
    pdc_curvature, psc_curvature = (
        _continued(1e3 * cell_kpa, np.radians(bend_deg) / _FE_ACTIVE_LENGTH_M, grid) for bend_deg in (pdc_deg, psc_deg)
    )
    return RodLaw(grid, psc_stiffness * psc_curvature, pdc_stiffness * pdc_curvature, psc_stiffness, pdc_stiffness)


def _start_at(start: float, nominal: float, table: NDArray[np.float64], table_nominal: float) -> NDArray[np.float64]:
    """Map ``table`` linearly so that its first value becomes ``start`` and ``table_nominal`` becomes ``nominal``."""
    return start + (nominal - start) * (table - table[0]) / (table_nominal - table[0])


def _continued(x: NDArray[np.float64], y: NDArray[np.float64], grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """PCHIP through (x, y) on ``grid``, a straight line with the end slope beyond the last x."""
    curve = PchipInterpolator(x, y)
    beyond = np.maximum(grid - x[-1], 0.0)
    return curve(np.minimum(grid, x[-1])) + float(curve.derivative()(x[-1])) * beyond
