"""The muscle's rod law M(p, kappa) = B(p) kappa - M0(p): what four chamber pressures do to a rod.

One chamber under pressure (PSC) and two adjacent ones (PDC) have laws of their own, each an intrinsic moment M0 and a
bending stiffness B over pressure, from the finite element unit cell (:mod:`~mbpam_ros.actuator.bending_law`). Any other
four pressures are blended from these two. With n_i the direction away from chamber i, G(p) = M_D(p) / sqrt(2) - M_S(p)
what an equal neighbour adds to a chamber's push, G+ and G- its parts above and below 0, and r_ij = min(1, p_j / p_i),

    M0 = sum_i n_i [M_S(p_i) + sum_{j next to i} h_ij + G+(p_i) r_io^2 + G-(p_i) max_j r_ij],
    h_ij = G+(p_i - a (1 - r_ij) p_i) - (1 - r_ij) G+((1 - a) p_i),   a = 0.38 :

each chamber pushes as it does alone (subscript S for PSC), and more when others stretch the axis; how much more is what
PDC (D) has over two single chambers, at a pressure between the two, less what is left of that without a neighbour. The
opposite chamber o adds it in the square of the pressures' ratio. Where chambers take from each other (below 50 and
above 110 kPa) the largest of the three ratios stands for their sum: three times what two take would turn the push of
the stronger one around. a and the square were chosen on the unequal unit cells below. The stiffness is that of an
anisotropic section seen along M0; what chambers add to its logarithm is summed, so that it stays positive, and a
chamber stiffened by another's pressure adds to what that one has added. A chamber alone adds d_S = log(B_S / B0)
against bending toward it and d_P = log(B_P / B0) across it, B_P being PSC's stiffness against side bend when held
straight; two neighbours add what PDC (D), which bends at 45 deg to both, has besides. With alpha_i the angle between M0
and n_i

    log B / B0 = sum_i [d_S(p_i) cos^2 alpha_i + d_P(p_i) sin^2 alpha_i + g(p_i) sum_{j next to i} min(p_i, p_j)],
    g(p) = (log(B_D(p) / B0) - d_S(p) - d_P(p)) / (2 p).

PSC and PDC come back exactly, a quarter turn or a mirror of the pressures turns or mirrors the moment, opposite
chambers at equal pressure give none, and all is continuous: where M0 vanishes under pressures that cancel, cos^2 and
sin^2 pass to 1/2 each. B_S(0) = B_D(0) = B0, because an unpressurised cross-section of fourfold symmetry is isotropic.

Against unit cells under ten unequal sets at 60, 80 and 100 kPa (``config/data/fe_unequal_pressures.json``, in view of
which the form of M0 was chosen) M0 is off by 2.3 % rms (6.1 % at worst) and the free bend by 2.6 % (6.0 %), both as
vectors; (p, p/2, 0, 0) by 1.0 and 1.1 %, (p, 0, p/2, 0) by 0.7 and 2.1 % at worst; directions are within 1 deg. Of
opposite chambers at equal pressure, B is off by up to 8 % for one diagonal; for all four chambers it is right at 60
kPa, 14 % low at 80 and 8 % low at 100 kPa (2.88 against 3.12 mN m2).

**Curve instead of line.** At each pressure the unit cell's moment is B kappa - M0 + Q kappa (kappa - kappa_free) along
M0, kappa_free = M0 / B, and (B + S) kappa across it (:mod:`~mbpam_ros.actuator.bending_law`). The plant's rod leaves
out Q and S: at 100 kPa (PDC) they move a free tip by 1.5 % of the active length and change what a load on the tip moves
it by up to 9 %. Between patterns Q is blended as c below, and S as epsilon_0, times the share of the pressures that do
not cancel.

**Stretch and twist.** A rod may also stretch (epsilon) and twist (tau). With all strains the energy of the muscle per
unstretched length is

    W = W_bend(kappa; p) + EA / 2 (epsilon - epsilon_f)^2 + GJ / 2 tau^2,   epsilon_f = epsilon_0 + c . kappa,

W_bend being that of the law above, whose axial force is 0, so that the moment is B kappa - M0 - N c and the axial
force N = EA (epsilon - epsilon_f). epsilon_0 (free stretch when held straight), c (its slope over the curvature, a
vector along the bend), log EA and log GJ are sums over the chambers,

    f(p) = sum_i [f_S(p_i) + g(p_i) sum_{j next to i} min(p_i, p_j)],   g(p) = (f_D(p) / 2 - f_S(p)) / p,

for c with n_i before the bracket and sqrt(2) for the 2 of the gain g. Again PSC and PDC come back exactly, turns and
mirrors of the pressures turn and mirror c and change nothing of the others, and all is continuous. Sums of logarithms
keep EA and GJ positive for all pressures. Against the unequal sets, epsilon_0 is off by at most 4.8 % of it, but by
9 % for all four chambers at 100 kPa and -14 % at 80; what an opposite chamber would add as a
neighbour does makes these worse (6 to 9 % for the two of one diagonal). For EA and GJ there are no unequal sets.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.actuator.bending_law import CellLaw, stored_cell_laws
from mbpam_ros.actuator.chamber_blend import BlendTables, StrainTables, blend, blend_curve, blend_strains
from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER
from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.errors import MbpamError

NOMINAL_PRESSURE_GAUGE_PA = 100e3
"""The pressure at which the paper states its bends and forces."""

LARGEST_PRESSURE_GAUGE_PA = 200e3
"""End of the tables. Above 120 kPa the laws are straight lines (no data); above this, constant."""

_GRID_STEP_PA = 100.0
_ROOT_HALF = math.sqrt(0.5)


class StrainLawError(MbpamError, ValueError):
    """A law does not say how the muscle stretches and twists; the message says what would."""


class StrainLaw(NamedTuple):
    """How the muscle stretches and twists; strains and curvatures per unstretched length.

    Args:
        free_stretch: epsilon_0, stretch - 1 when held straight without axial force, shape (n,).
        stretch_per_curvature_m: c, the slopes of the free stretch over the curvature's bend components, shape (n, 2);
            of a pattern the one along its bend, shape (n,).
        axial_stiffness_n: EA, shape (n,).
        torsion_stiffness_n_m2: GJ, shape (n,).
    """

    free_stretch: NDArray[np.float64]
    stretch_per_curvature_m: NDArray[np.float64]
    axial_stiffness_n: NDArray[np.float64]
    torsion_stiffness_n_m2: NDArray[np.float64]


class BendCurve(NamedTuple):
    """How the bending moment departs from its line.

    Args:
        stiffening_n_m3: Q, with its direction in bend components, shape (n, 2); of a pattern its size, shape (n,).
        side_n_m2: S, shape (n,).
    """

    stiffening_n_m3: NDArray[np.float64]
    side_n_m2: NDArray[np.float64]


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
        psc_strains, pdc_strains: stretch and twist on the grid; stretch and slope 0 at the start, EA and GJ positive
            and equal there. None: not known.
        psc_curve, pdc_curve: departure from the line on the grid, 0 at the start. None: not known.
        psc_side_stiffness_n_m2: of PSC held straight, against bending across its plane, on the grid, shape (n,);
            positive, the other stiffnesses' at the start. None: as B of PSC.

    Raises:
        ValueError: the tables break one of these.
    """

    pressure_gauge_pa: NDArray[np.float64]
    psc_moment_n_m: NDArray[np.float64]
    pdc_moment_n_m: NDArray[np.float64]
    psc_stiffness_n_m2: NDArray[np.float64]
    pdc_stiffness_n_m2: NDArray[np.float64]
    psc_strains: StrainLaw | None = None
    pdc_strains: StrainLaw | None = None
    psc_curve: BendCurve | None = None
    pdc_curve: BendCurve | None = None
    psc_side_stiffness_n_m2: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        grid = self.pressure_gauge_pa
        if grid.ndim != 1 or grid.size < 2 or not np.allclose(grid, grid[1] * np.arange(grid.size)) or grid[1] <= 0.0:
            raise ValueError("pressure_gauge_pa must rise from 0 in equal steps")
        if self.psc_moment_n_m[0] != 0.0 or self.pdc_moment_n_m[0] != 0.0:
            raise ValueError("the intrinsic moments must be 0 without pressure")
        if not math.isclose(self.psc_stiffness_n_m2[0], self.pdc_stiffness_n_m2[0], rel_tol=1e-9):
            raise ValueError("without pressure PSC and PDC must have one stiffness")
        side = self._psc_side
        if not all((table > 0.0).all() for table in (self.psc_stiffness_n_m2, self.pdc_stiffness_n_m2, side)):
            raise ValueError("the bending stiffness must be positive for all pressures")
        if not math.isclose(side[0], self.psc_stiffness_n_m2[0], rel_tol=1e-9):
            raise ValueError("without pressure the stiffness must be the same in all directions")
        if self.psc_strains is not None and self.pdc_strains is not None:
            _check_strains(self.psc_strains, self.pdc_strains)
        if any(table[0] != 0.0 for curve in (self.psc_curve, self.pdc_curve) if curve is not None for table in curve):
            raise ValueError("the departure from the line must be 0 without pressure")

    @property
    def _psc_side(self) -> NDArray[np.float64]:
        return self.psc_stiffness_n_m2 if self.psc_side_stiffness_n_m2 is None else self.psc_side_stiffness_n_m2

    @cached_property
    def _blend_tables(self) -> BlendTables:
        grid, start = self.pressure_gauge_pa, self.psc_stiffness_n_m2[0]
        along, across, both = (
            np.log(table / start) for table in (self.psc_stiffness_n_m2, self._psc_side, self.pdc_stiffness_n_m2)
        )
        share = np.divide(1.0, grid, out=np.zeros_like(grid), where=grid > 0.0)
        gain = (self.pdc_moment_n_m * _ROOT_HALF - self.psc_moment_n_m) * share
        mean = 0.5 * (along + across)
        rows = np.column_stack([self.psc_moment_n_m, gain, mean, 0.5 * (along - across), (0.5 * both - mean) * share])
        return BlendTables(float(grid[1]), rows, float(start))

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
        pressure = _of_four_chambers(pressure_gauge_pa)
        moment, stiffness = blend(np.ascontiguousarray(pressure.reshape(-1, CHAMBERS_PER_FINGER)), self._blend_tables)
        return moment.reshape(*pressure.shape[:-1], 2), stiffness.reshape(pressure.shape[:-1])

    @cached_property
    def _strain_tables(self) -> StrainTables:
        psc, pdc = self.psc_strains, self.pdc_strains
        if psc is None or pdc is None:
            raise StrainLawError(
                "this rod law does not say how the muscle stretches and twists: it was made from a file without "
                "axial_stiffness_n and torsion_stiffness_n_mm2; mbpam fe law computes them"
            )
        grid = self.pressure_gauge_pa
        share = np.divide(1.0, grid, out=np.zeros_like(grid), where=grid > 0.0)
        of_neighbours = np.array([0.5, _ROOT_HALF, 0.5, 0.5])
        alone, both = (
            np.column_stack(
                [
                    of.free_stretch,
                    of.stretch_per_curvature_m,
                    np.log(of.axial_stiffness_n / of.axial_stiffness_n[0]),
                    np.log(of.torsion_stiffness_n_m2 / of.torsion_stiffness_n_m2[0]),
                ]
            )
            for of in (psc, pdc)
        )
        rows = np.hstack([alone, (both * of_neighbours - alone) * share[:, None]])
        return StrainTables(float(grid[1]), rows, float(psc.axial_stiffness_n[0]), float(psc.torsion_stiffness_n_m2[0]))

    def strain_law(self, pressure_gauge_pa: ArrayLike) -> StrainLaw:
        """Return how the muscle stretches and twists for the pressures of chambers 1 to 4.

        Args:
            pressure_gauge_pa: shape (..., 4).

        Returns:
            Its fields have the shape (...), the slopes (..., 2). NaN where a pressure is NaN.

        Raises:
            ValueError: the last axis does not hold four pressures.
            StrainLawError: the law says nothing of stretch and twist.
        """
        pressure = _of_four_chambers(pressure_gauge_pa)
        shape = pressure.shape[:-1]
        stretch, slope, axial, torsion = blend_strains(
            np.ascontiguousarray(pressure.reshape(-1, CHAMBERS_PER_FINGER)), self._strain_tables
        )
        return StrainLaw(stretch.reshape(shape), slope.reshape(*shape, 2), axial.reshape(shape), torsion.reshape(shape))

    def bend_curve(self, pressure_gauge_pa: ArrayLike) -> BendCurve:
        """Return how the moment departs from its line for the pressures of chambers 1 to 4.

        Args:
            pressure_gauge_pa: shape (..., 4).

        Returns:
            Q (..., 2) and S (...). NaN where a pressure is NaN.

        Raises:
            ValueError: the last axis does not hold four pressures.
            StrainLawError: the law does not say.
        """
        pressure = _of_four_chambers(pressure_gauge_pa)
        rows = np.ascontiguousarray(pressure.reshape(-1, CHAMBERS_PER_FINGER))
        stiffening, side = blend_curve(rows, float(self.pressure_gauge_pa[1]), self._curve_rows)
        return BendCurve(stiffening.reshape(*pressure.shape[:-1], 2), side.reshape(pressure.shape[:-1]))

    @cached_property
    def _curve_rows(self) -> NDArray[np.float64]:
        if self.psc_curve is None or self.pdc_curve is None:
            raise StrainLawError(
                "this rod law does not say how its moment departs from a line: it was made from a file without "
                "side_bend_stiffness_n_mm2; mbpam fe law computes it"
            )
        grid = self.pressure_gauge_pa
        share = np.divide(1.0, grid, out=np.zeros_like(grid), where=grid > 0.0)
        alone, both = np.column_stack(self.psc_curve), np.column_stack(self.pdc_curve)
        return np.hstack([alone, (both * [_ROOT_HALF, 0.5] - alone) * share[:, None]])

    def of_pattern(self, pattern: str, pressure_gauge_pa: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return M0 [N m] and B [N m2] of the pattern ``psc`` or ``pdc`` at pressures of any shape.

        Raises:
            ValueError: another pattern.
        """
        tables = {
            "psc": (self.psc_moment_n_m, self.psc_stiffness_n_m2),
            "pdc": (self.pdc_moment_n_m, self.pdc_stiffness_n_m2),
        }
        if pattern not in tables:
            raise ValueError(f"unknown pattern {pattern!r}; known: {', '.join(tables)}")
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        moment, stiffness = (np.interp(pressure, self.pressure_gauge_pa, table) for table in tables[pattern])
        return moment, stiffness

    def at_nominal_pressure(self, pattern: str) -> tuple[float, float]:
        """Return M0 [N m] and B [N m2] at 100 kPa of the pattern ``psc`` or ``pdc``.

        Raises:
            ValueError: another pattern.
        """
        moment, stiffness = self.of_pattern(pattern, NOMINAL_PRESSURE_GAUGE_PA)
        return float(moment), float(stiffness)

    def scaled(self, psc: PatternFactors, pdc: PatternFactors) -> RodLaw:
        """Return the law with M0 multiplied, and B multiplied at 100 kPa, per pattern (:meth:`scaled_stiffness`).

        EA and GJ are multiplied as B is at each pressure: a factor on B stands for a stiffer silicone or a thicker
        wall, and the wall that bends is the one that is pulled and twisted. The free stretch keeps its shape; a target
        for it does not exist. Q and S keep their shares of B over the bends up to the free one.
        """
        grid = self.pressure_gauge_pa
        psc_stiffness = self.scaled_stiffness("psc", grid, psc.stiffness, pdc.stiffness)
        pdc_stiffness = self.scaled_stiffness("pdc", grid, pdc.stiffness, pdc.stiffness)
        return RodLaw(
            pressure_gauge_pa=grid,
            psc_moment_n_m=psc.moment * self.psc_moment_n_m,
            pdc_moment_n_m=pdc.moment * self.pdc_moment_n_m,
            psc_stiffness_n_m2=psc_stiffness,
            pdc_stiffness_n_m2=pdc_stiffness,
            psc_strains=_stiffened(self.psc_strains, psc_stiffness / self.psc_stiffness_n_m2),
            pdc_strains=_stiffened(self.pdc_strains, pdc_stiffness / self.pdc_stiffness_n_m2),
            psc_curve=_stiffened_curve(self.psc_curve, psc_stiffness / self.psc_stiffness_n_m2, psc.moment),
            pdc_curve=_stiffened_curve(self.pdc_curve, pdc_stiffness / self.pdc_stiffness_n_m2, pdc.moment),
            psc_side_stiffness_n_m2=self._psc_side * (psc_stiffness / self.psc_stiffness_n_m2),
        )

    def stretched(self, factor: float) -> RodLaw:
        """Return the law with its free stretch, and that stretch's slope, multiplied; as it is where it knows none."""
        return replace(
            self, psc_strains=_stretched(self.psc_strains, factor), pdc_strains=_stretched(self.pdc_strains, factor)
        )

    def scaled_stiffness(
        self, pattern: str, pressure_gauge_pa: ArrayLike, nominal_factor: float, pdc_factor: float
    ) -> NDArray[np.float64]:
        """Return B [N m2] of a pattern, multiplied by ``nominal_factor`` at 100 kPa.

        PDC's keeps its shape. PSC's keeps that of its distance from PDC's, which is 0 without pressure, where both
        are one stiffness.

        Raises:
            ValueError: another pattern.
        """
        stiffness = self.of_pattern(pattern, pressure_gauge_pa)[1]
        if pattern == "pdc":
            return nominal_factor * stiffness
        pdc = self.of_pattern("pdc", pressure_gauge_pa)[1]
        psc_nominal, pdc_nominal = self.at_nominal_pressure("psc")[1], self.at_nominal_pressure("pdc")[1]
        distance = (pdc_factor * pdc_nominal - nominal_factor * psc_nominal) / (pdc_nominal - psc_nominal)
        return pdc_factor * pdc - distance * (pdc - stiffness)


def _of_four_chambers(pressure_gauge_pa: ArrayLike) -> NDArray[np.float64]:
    pressure = np.asarray(pressure_gauge_pa, dtype=float)
    if pressure.shape[-1:] != (CHAMBERS_PER_FINGER,):
        raise ValueError(f"expected pressures of four chambers in the last axis, found shape {pressure.shape}")
    return pressure


def _check_strains(psc: StrainLaw, pdc: StrainLaw) -> None:
    for of in (psc, pdc):
        if of.free_stretch[0] != 0.0 or of.stretch_per_curvature_m[0] != 0.0:
            raise ValueError("the free stretch and its slope must be 0 without pressure")
        if not ((of.axial_stiffness_n > 0.0).all() and (of.torsion_stiffness_n_m2 > 0.0).all()):
            raise ValueError("the axial and the torsional stiffness must be positive at all pressures")
    for one, other in ((psc.axial_stiffness_n, pdc.axial_stiffness_n), (psc[3], pdc[3])):
        if not math.isclose(one[0], other[0], rel_tol=1e-9):
            raise ValueError("without pressure PSC and PDC must have one axial and one torsional stiffness")


def _stiffened(strains: StrainLaw | None, factor: NDArray[np.float64]) -> StrainLaw | None:
    if strains is None:
        return None
    return strains._replace(
        axial_stiffness_n=factor * strains.axial_stiffness_n,
        torsion_stiffness_n_m2=factor * strains.torsion_stiffness_n_m2,
    )


def _stretched(strains: StrainLaw | None, factor: float) -> StrainLaw | None:
    if strains is None:
        return None
    return strains._replace(
        free_stretch=factor * strains.free_stretch, stretch_per_curvature_m=factor * strains.stretch_per_curvature_m
    )


def _stiffened_curve(curve: BendCurve | None, factor: NDArray[np.float64], moment_factor: float) -> BendCurve | None:
    if curve is None:
        return None
    return BendCurve(curve.stiffening_n_m3 * factor**2 / moment_factor, curve.side_n_m2 * factor)


@functools.lru_cache(maxsize=4)
def finite_element_rod_law(name: str | Path = LAW_FILE) -> RodLaw:
    """Return the law of the finite element unit cell, by default that at a = 2.5, b = 2.0 mm in ``config/data``.

    B(p) and the free curvature M0 / B are interpolated monotonically (PCHIP) over pressure and continued above 120 kPa
    with their end slopes, the free stretch and the logarithms of EA and GJ likewise. Without pressure the two patterns'
    meshes differ by 0.2 % in B; their mean stands for both, and so for EA and GJ.

    Raises:
        ConfigError: the law is missing or unreadable.
    """
    grid = np.arange(0.0, LARGEST_PRESSURE_GAUGE_PA + _GRID_STEP_PA, _GRID_STEP_PA)
    laws = stored_cell_laws(name)
    start = 0.5 * sum(float(law.stiffness_n_m2[0]) for law in laws.values())
    tables = {}
    for pattern, law in laws.items():
        stiffness = _continued(law.pressure_gauge_pa, np.append(start, law.stiffness_n_m2[1:]), grid)
        curvature = _continued(law.pressure_gauge_pa, law.free_curvature_per_m, grid)
        tables[f"{pattern}_moment_n_m"] = stiffness * curvature
        tables[f"{pattern}_stiffness_n_m2"] = stiffness
    strains = _pattern_strains(laws, grid)
    side = laws["psc"].straight_side_stiffness_n_m2
    curves = {pattern: _pattern_curve(law, tables[f"{pattern}_stiffness_n_m2"], grid) for pattern, law in laws.items()}
    return RodLaw(
        grid,
        **tables,
        psc_strains=strains.get("psc"),
        pdc_strains=strains.get("pdc"),
        psc_curve=curves["psc"],
        pdc_curve=curves["pdc"],
        psc_side_stiffness_n_m2=(
            None if side is None else _continued(laws["psc"].pressure_gauge_pa, np.append(start, side[1:]), grid)
        ),
    )


def _pattern_curve(law: CellLaw, stiffness_n_m2: NDArray[np.float64], grid: NDArray[np.float64]) -> BendCurve | None:
    """Departure of a pattern's moment from its line on ``grid``; none where the cell law does not say."""
    side = law.free_stiffness("side_stiffness_n_m2")
    if side is None:
        return None
    across = _continued(law.pressure_gauge_pa, np.append(stiffness_n_m2[0], side[1:]), grid)
    return BendCurve(_continued(law.pressure_gauge_pa, law.stiffening_n_m3, grid), across - stiffness_n_m2)


def _pattern_strains(laws: dict[str, CellLaw], grid: NDArray[np.float64]) -> dict[str, StrainLaw]:
    """Stretch and twist of the patterns on ``grid``; none where a cell law says nothing of them."""
    logs = {}
    for name in ("axial_stiffness_n", "torsion_stiffness_n_m2"):
        found = {pattern: law.free_stiffness(name) for pattern, law in laws.items()}
        known = {pattern: np.log(values) for pattern, values in found.items() if values is not None}
        if len(known) < len(laws):
            return {}
        start = sum(float(values[0]) for values in known.values()) / len(known)
        logs[name] = {pattern: np.append(start, values[1:]) for pattern, values in known.items()}
    return {
        pattern: StrainLaw(
            _continued(law.pressure_gauge_pa, np.append(0.0, law.straight_stretch[1:] - 1.0), grid),
            _continued(law.pressure_gauge_pa, law.stretch_slope_m, grid),
            *(np.exp(_continued(law.pressure_gauge_pa, of[pattern], grid)) for of in logs.values()),
        )
        for pattern, law in laws.items()
    }


def _continued(x: NDArray[np.float64], y: NDArray[np.float64], grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """PCHIP through (x, y) on ``grid``, a straight line with the end slope beyond the last x."""
    curve = PchipInterpolator(x, y)
    beyond = np.maximum(grid - x[-1], 0.0)
    continued: NDArray[np.float64] = curve(np.minimum(grid, x[-1])) + float(curve.derivative()(x[-1])) * beyond
    return continued
