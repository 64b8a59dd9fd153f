r"""What the two ends of the muscle add to its rod of unit cells, over the four chamber pressures.

A wave beside a solid end can neither widen nor warp as one between other waves does, and the gas pushes on the end's
face. Where the end meets the waves, the axis therefore has a turn with the bend, a length and a shift toward the inside
of the bend of its own, and yields more or less to a moment than the section of the end says
(:class:`~mbpam_ros.actuator.elastic_rod.EndJoint`). ``config/data/fe_ends.json`` has them for
one chamber under pressure (PSC) and two (PDC), as a short muscle in finite elements differs from its unit cell
(``mbpam fe ends``): at 100 kPa (PDC) each end takes 1 deg from the bend, at 50 kPa it adds half a degree.

The short muscle also tells how the waves are sheared, which the unit cell, bent by a moment alone, does not.

Any four pressures are blended from these as the free stretch and its slope are
(:mod:`~mbpam_ros.actuator.rod_law`): the turn and the shift with the directions away from the chambers, the length
and the change of the compliances without. Above 120 kPa the joint stays as it is there.
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.actuator.chamber_blend import blend_joint
from mbpam_ros.actuator.elastic_rod import EndJoint
from mbpam_ros.configuration import ConfigError, config_path

Array = NDArray[np.float64]

ENDS_FILE = "data/fe_ends.json"

_PATTERNS = ("pdc", "psc")
_GRID_PA = np.arange(0.0, 120.1e3, 100.0)
_ROOT_HALF = math.sqrt(0.5)


class PatternEnds(NamedTuple):
    """Joint of a pattern over pressure, each shape (n,); the first three are 0 at the start.

    Args:
        turn_rad, length_m, shift_m: of :class:`~mbpam_ros.actuator.elastic_rod.EndJoint`, in the direction of the bend.
        compliance_per_n_m: likewise; at the start that of an end without pressure.
        shear_compliance_per_n: 1 / GA of the waves.
    """

    turn_rad: Array
    length_m: Array
    shift_m: Array
    compliance_per_n_m: Array
    shear_compliance_per_n: Array


@dataclass(frozen=True, eq=False)
class EndLaw:
    """Joints of PSC and PDC on one uniform grid from 0 gauge.

    Args:
        pressure_gauge_pa: the grid, shape (n,).
        psc, pdc: on the grid.

    Raises:
        ValueError: the grid does not rise from 0 in equal steps, or a joint is not 0 there.
    """

    pressure_gauge_pa: Array
    psc: PatternEnds
    pdc: PatternEnds

    def __post_init__(self) -> None:
        grid = self.pressure_gauge_pa
        if grid.ndim != 1 or grid.size < 2 or not np.allclose(grid, grid[1] * np.arange(grid.size)) or grid[1] <= 0.0:
            raise ValueError("pressure_gauge_pa must rise from 0 in equal steps")
        if any(table.shape != grid.shape for of in (self.psc, self.pdc) for table in of):
            raise ValueError("a joint must have one value per pressure")
        if any(table[0] != 0.0 for of in (self.psc, self.pdc) for table in of[:3]):
            raise ValueError("turn, length and shift of a joint must be 0 without pressure")

    def scaled(self, size: float, modulus: float) -> EndLaw:
        """Return the ends of a similar muscle, ``size`` times as large and of a ``modulus`` times as stiff silicone.

        What is similar bends by the same angles at the same pressure over modulus; lengths go with the size,
        compliances of bending with 1 / (modulus size^3) and of shear with 1 / (modulus size^2).
        """
        bending, shear = 1.0 / (modulus * size**3), 1.0 / (modulus * size**2)
        psc, pdc = (
            PatternEnds(of.turn_rad, size * of.length_m, size * of.shift_m, bending * of[3], shear * of[4])
            for of in (self.psc, self.pdc)
        )
        return EndLaw(modulus * self.pressure_gauge_pa, psc, pdc)

    def joint(self, pressure_gauge_pa: ArrayLike) -> EndJoint:
        """Return the joint for the pressures (4,) of chambers 1 to 4; NaN where one is NaN.

        Raises:
            ValueError: not four pressures.
        """
        joint = EndJoint(*self._blended(pressure_gauge_pa)[:6])
        return joint._replace(compliance_per_n_m=self._at_rest[0] + joint.compliance_per_n_m)

    def shear_compliance_per_n(self, pressure_gauge_pa: ArrayLike) -> float:
        """Return 1 / GA of the waves for the pressures (4,) of chambers 1 to 4; NaN where one is NaN.

        Raises:
            ValueError: not four pressures.
        """
        return self._at_rest[1] + self._blended(pressure_gauge_pa)[6]

    def of_pattern(self, pattern: str, pressure_gauge_pa: ArrayLike) -> PatternEnds:
        """Return the joint of ``psc`` or ``pdc`` at pressures of any shape; they are alike without pressure.

        Raises:
            ValueError: another pattern.
        """
        if pattern not in _PATTERNS:
            raise ValueError(f"unknown pattern {pattern!r}; known: {', '.join(_PATTERNS)}")
        of = self.psc if pattern == "psc" else self.pdc
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        tables = (*of[:3], *(rest + table - table[0] for rest, table in zip(self._at_rest, of[3:], strict=True)))
        return PatternEnds(*(np.interp(pressure, self.pressure_gauge_pa, table) for table in tables))

    def _blended(self, pressure_gauge_pa: ArrayLike) -> list[float]:
        """All that is 0 without pressure, and the compliances' change."""
        pressure = np.asarray(pressure_gauge_pa, dtype=float)
        if pressure.shape != (4,):
            raise ValueError(f"expected the pressures of four chambers, found shape {pressure.shape}")
        pressure = np.minimum(pressure, self.pressure_gauge_pa[-1])
        blended: list[float] = blend_joint(pressure, float(self.pressure_gauge_pa[1]), self._rows).tolist()
        return blended

    @property
    def _at_rest(self) -> tuple[float, float]:
        """The compliances without pressure: the patterns' meshes differ by 2 %, their mean stands for both."""
        end, shear = (0.5 * float(one[0] + other[0]) for one, other in zip(self.psc[3:], self.pdc[3:], strict=True))
        return end, shear

    @cached_property
    def _rows(self) -> Array:
        grid = self.pressure_gauge_pa
        share = np.divide(1.0, grid, out=np.zeros_like(grid), where=grid > 0.0)
        alone, both = (
            np.column_stack([*of[:3], *(table - table[0] for table in of[3:])]) for of in (self.psc, self.pdc)
        )
        return np.hstack([alone, (both * [_ROOT_HALF, 0.5, _ROOT_HALF, 0.5, 0.5] - alone) * share[:, None]])


@functools.lru_cache(maxsize=2)
def finite_element_end_law(name: str | Path = ENDS_FILE) -> EndLaw:
    """Return the ends of ``mbpam fe ends``, by default those at a = 2.5, b = 2.0 mm in ``config/data``; PCHIP between.

    Raises:
        ConfigError: the file is missing, or none of that command.
    """
    path = config_path(name)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found = {row["pattern"]: _pattern(row) for row in content["ends"]}
        return EndLaw(_GRID_PA, **{pattern: found[pattern] for pattern in _PATTERNS})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no ends of mbpam fe ends: {error!r}") from error


def _pattern(row: dict[str, list[float]]) -> PatternEnds:
    pressure_pa = 1e3 * np.array(row["p_kpa"], dtype=float)

    def on_grid(name: str, unit: float) -> Array:
        curve = PchipInterpolator(pressure_pa, unit * np.array(row[name], dtype=float))
        table: Array = curve(np.minimum(_GRID_PA, pressure_pa[-1]))
        return table

    return PatternEnds(
        on_grid("turn_deg", math.radians(1.0)),
        on_grid("length_mm", 1e-3),
        on_grid("shift_mm", 1e-3),
        on_grid("compliance_rad_per_n_mm", 1e3),
        on_grid("shear_per_n", 1.0),
    )
