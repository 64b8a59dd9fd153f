"""The finite element unit cell's law as stored in ``config/data/fe_bending_law.json``: read, and as lines.

Per pattern (PDC, PSC) the file holds samples of the moment M(p, kappa) and the axis's stretch s(p, kappa) of the active
length, kappa being the bend over the unstretched length (its gas volumes: :mod:`~mbpam_ros.actuator.gas_volume`), and
of what it resists a pull and a twist with: EA = dN / d epsilon at held curvature, GJ = dT / d tau with the other loads
free, strains per unstretched length.
The rods that run need a straight line at each pressure,

    M = B kappa - M0,

here the secant through the two states a user meets: held straight (M = -M0) and free (M = 0 at kappa = M0 / B), so
that blocked moment and free bend both come back at every pressure. Without pressure the two coincide and B is the
tangent. Against all samples (-60 to 180 deg) the secant is off by at most 2.1 N mm rms (3.5 % of M0 = 60.5 N mm at
120 kPa; 1.4 of 41.8 N mm at 100 kPa, PDC); the best straight line of all would be off by 1.7 and 1.3 N mm, and by 1 to
6 deg of free bend. The stretch is a line through the same two states. EA and GJ are those of the free state; from the
straight to the free one they rise by 11 and 6 % at 100 kPa (PDC), by 12 and 8 % at most.

What the line leaves over is almost all a term that is 0 in both states,

    M = B kappa - M0 + Q kappa (kappa - kappa_free),

with Q the least squares' over all samples: 0.08 N mm rms remain at 100 kPa and 0.04 at 120 kPa (PDC; PSC 0.24 and
0.23). Below 80 kPa (PSC 90 kPa) Q comes out slightly negative, from bends far beyond the free one; there the line
stays, Q = 0. Bending across the plane of the bend has a stiffness of its own, at the free bend B + S.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.configuration import ConfigError, config_path

_Part = TypeVar("_Part")

PATTERNS = ("pdc", "psc")
"""Two adjacent chambers under pressure, and one."""

_STIFFNESSES = {
    "axial_stiffness_n": ("axial_stiffness_n", 1.0),
    "torsion_stiffness_n_m2": ("torsion_stiffness_n_mm2", 1e-6),
    "side_stiffness_n_m2": ("side_bend_stiffness_n_mm2", 1e-6),
}
"""Names in the file, and SI units in its."""


@dataclass(frozen=True, eq=False)
class CellLaw:
    """Samples of one pattern's law on a grid of n pressures and m curvatures. SI units.

    Args:
        pressure_gauge_pa: shape (n,), rising from 0.
        curvature_per_m: shape (m,), rising, with 0 among them.
        moment_n_m: outer moment that holds the muscle so, shape (n, m), rising with the curvature.
        axis_stretch: length of the axis over its length at rest, shape (n, m).
        axial_stiffness_n: EA, shape (n, m), positive; None where a file has none.
        torsion_stiffness_n_m2: GJ, likewise.
        side_stiffness_n_m2: slope of the moment across the plane of the bend over the curvature there, likewise.

    Raises:
        ValueError: the samples break one of these, or no free bend lies within them.
    """

    pressure_gauge_pa: NDArray[np.float64]
    curvature_per_m: NDArray[np.float64]
    moment_n_m: NDArray[np.float64]
    axis_stretch: NDArray[np.float64]
    axial_stiffness_n: NDArray[np.float64] | None = None
    torsion_stiffness_n_m2: NDArray[np.float64] | None = None
    side_stiffness_n_m2: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        pressure, curvature = self.pressure_gauge_pa, self.curvature_per_m
        if pressure[0] != 0.0 or np.any(np.diff(pressure) <= 0.0):
            raise ValueError("the pressures must rise from 0")
        if np.any(np.diff(curvature) <= 0.0) or np.count_nonzero(curvature == 0.0) != 1:
            raise ValueError("the curvatures must rise and 0 must be one of them")
        for name in ("moment_n_m", "axis_stretch"):
            if getattr(self, name).shape != (pressure.size, curvature.size):
                raise ValueError(f"{name} must have one value per pressure and curvature")
        if np.any(np.diff(self.moment_n_m, axis=1) <= 0.0):
            raise ValueError("the moment must rise with the curvature")
        if np.any(self.moment_n_m[:, -1] <= 0.0) or np.any(self.moment_n_m[1:, self._straight] >= 0.0):
            raise ValueError("each free bend must lie within the samples, on the positive side")
        for name in _STIFFNESSES:
            samples = getattr(self, name)
            if samples is not None and not (samples.shape == (pressure.size, curvature.size) and (samples > 0.0).all()):
                raise ValueError(f"{name} must have one positive value per pressure and curvature")

    @property
    def straight_moment_n_m(self) -> NDArray[np.float64]:
        """M0: what holding the muscle straight takes, shape (n,); 0 without pressure."""
        return np.where(self.pressure_gauge_pa > 0.0, -self.moment_n_m[:, self._straight], 0.0)

    @functools.cached_property
    def free_curvature_per_m(self) -> NDArray[np.float64]:
        """Curvature without outer moment, shape (n,); monotone interpolation (PCHIP) between the samples."""
        free = [float(PchipInterpolator(row, self.curvature_per_m)(0.0)) for row in self.moment_n_m]
        return np.where(self.pressure_gauge_pa > 0.0, free, 0.0)

    @property
    def stiffness_n_m2(self) -> NDArray[np.float64]:
        """B: secant between the straight and the free state, shape (n,); the tangent without pressure."""
        tangent = PchipInterpolator(self.curvature_per_m, self.moment_n_m[0]).derivative()(0.0)
        secant = self.straight_moment_n_m[1:] / self.free_curvature_per_m[1:]
        return np.concatenate([[float(tangent)], secant])

    @property
    def line_residual_n_m(self) -> NDArray[np.float64]:
        """B kappa - M0 minus the samples, shape (n, m)."""
        line = self.stiffness_n_m2[:, None] * self.curvature_per_m - self.straight_moment_n_m[:, None]
        return line - self.moment_n_m

    @property
    def straight_stretch(self) -> NDArray[np.float64]:
        """Stretch of the axis when held straight, shape (n,)."""
        return self.axis_stretch[:, self._straight]

    @property
    def stretch_slope_m(self) -> NDArray[np.float64]:
        """Slope of the stretch over the curvature between the straight and the free state, shape (n,)."""
        slope = np.zeros_like(self.straight_stretch)
        slope[1:] = (self._at_free_bend(self.axis_stretch) - self.straight_stretch)[1:] / self.free_curvature_per_m[1:]
        return slope

    @property
    def stiffening_n_m3(self) -> NDArray[np.float64]:
        """Q, shape (n,); 0 without pressure."""
        curvature, free = self.curvature_per_m, self.free_curvature_per_m[:, None]
        term = curvature * (curvature - free)
        fitted = np.sum(-self.line_residual_n_m * term, axis=1) / np.sum(term * term, axis=1)
        return np.where(self.pressure_gauge_pa > 0.0, np.maximum(fitted, 0.0), 0.0)

    def free_stiffness(self, name: str) -> NDArray[np.float64] | None:
        """Return one of the stiffnesses, by the name of its samples, at the free bend, shape (n,); None as they are.

        Raises:
            ValueError: another name.
        """
        if name not in _STIFFNESSES:
            raise ValueError(f"unknown stiffness {name!r}; known: {', '.join(_STIFFNESSES)}")
        samples = getattr(self, name)
        return None if samples is None else self._at_free_bend(samples)

    @property
    def straight_side_stiffness_n_m2(self) -> NDArray[np.float64] | None:
        """Stiffness against bending across the plane of the bend when held straight, shape (n,); None: not known."""
        return None if self.side_stiffness_n_m2 is None else self.side_stiffness_n_m2[:, self._straight]

    def _at_free_bend(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        every: NDArray[np.float64] = PchipInterpolator(self.curvature_per_m, samples, axis=1)(self.free_curvature_per_m)
        return every.diagonal().copy()

    @functools.cached_property
    def _straight(self) -> int:
        return int(np.flatnonzero(self.curvature_per_m == 0.0)[0])


@functools.lru_cache(maxsize=4)
def stored_cell_laws(name: str | Path = LAW_FILE) -> dict[str, CellLaw]:
    """Return the laws of ``pdc`` and ``psc`` in the file ``name``, by default those at the initial design.

    Raises:
        ConfigError: the file is missing, or no law of ``mbpam fe law``.
    """
    return _read(name, _laws)


def stored_shear_modulus_pa(name: str | Path = LAW_FILE) -> float:
    """Return the shear modulus of the unstrained silicone that the laws were computed with, 2 C10 of Yeoh's energy.

    Raises:
        ConfigError: the file is missing, or no law of ``mbpam fe law``.
    """
    return _read(name, lambda content: 2e6 * float(content["settings"]["silicone"]["c10_mpa"]))


def _read(name: str | Path, part: Callable[[dict[str, Any]], _Part]) -> _Part:
    """Return ``part`` of a law file's content."""
    path = config_path(name)
    try:
        return part(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise ConfigError(f"{path}: no bending law of mbpam fe law: {error}") from error


def _laws(content: dict[str, Any]) -> dict[str, CellLaw]:
    length_m = 1e-3 * content["settings"]["geometry"]["active_length_mm"]
    return {pattern: _from_tables(content["tables"], pattern, length_m) for pattern in PATTERNS}


def _from_tables(tables: list[dict[str, Any]], pattern: str, length_m: float) -> CellLaw:
    rows = sorted((row for row in tables if row["pattern"] == pattern), key=lambda row: row["p_kpa"])
    bend_deg = rows[0]["bend_deg"]
    if any(row["bend_deg"] != bend_deg for row in rows):
        raise ValueError(f"the pressures of {pattern} are sampled at different bends")
    samples = {name: np.array([row[name] for row in rows], dtype=float) for name in ("moment_n_mm", "axis_stretch")}
    stiffnesses = {}
    for name, (in_file, unit) in _STIFFNESSES.items():
        if any(in_file in row for row in rows):
            stiffnesses[name] = unit * np.array([row[in_file] for row in rows], dtype=float)
    return CellLaw(
        pressure_gauge_pa=1e3 * np.array([row["p_kpa"] for row in rows], dtype=float),
        curvature_per_m=np.radians(bend_deg) / length_m,
        moment_n_m=1e-3 * samples["moment_n_mm"],
        axis_stretch=samples["axis_stretch"],
        **stiffnesses,
    )
