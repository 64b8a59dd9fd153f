"""Gas volume of a muscle's chambers against pressure and bend, from the finite element unit cell.

The tables hold V(p, theta) of one chamber's active length when it alone is under pressure (PSC) or together with one
neighbour (PDC), theta being the bend away from the pressurised chambers. A chamber at azimuth alpha sees the component
beta = -bend . (cos alpha, sin alpha) of the muscle's bend; with w the greater pressure of its two neighbours over its
own, within 0 to 1,

    V = (1 - w) V_psc(p, beta) + w V_pdc(p, sqrt(2) beta),

which returns both patterns exactly (in PDC each chamber sees beta = theta / sqrt(2)). A chamber without pressure of its
own, w = 0, keeps its volume at rest.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from mbpam_ros.actuator.chambers import CHAMBER_AZIMUTH_RAD
from mbpam_ros.configuration import ConfigError, config_path

Array = NDArray[np.float64]

LAW_FILE = "data/fe_bending_law.json"
_PRESSURE_GRID_PA = np.linspace(-100e3, 300e3, 41)
_BEND_GRID_RAD = np.radians(np.linspace(-180.0, 360.0, 55))
_LEAST_SHARE = 0.05
"""Of the volume at rest: what the walls of an evacuated chamber leave, no data."""


class GasVolumeTables(NamedTuple):
    """Volumes [m3] of one chamber on uniform grids.

    Args:
        pressure_start_pa, pressure_step_pa: of the first axis, gauge.
        bend_start_rad, bend_step_rad: of the second axis.
        psc, pdc: shape (pressures, bends), rising with pressure.
    """

    pressure_start_pa: float
    pressure_step_pa: float
    bend_start_rad: float
    bend_step_rad: float
    psc: Array
    pdc: Array


@functools.lru_cache(maxsize=4)
def gas_volume_tables(law: Path | None = None) -> GasVolumeTables:
    """Return the tables of a finite element law, by default of ``config/data/fe_bending_law.json``.

    Monotone (PCHIP) in pressure and bend. Beyond the sampled pressures (0 to 120 kPa) straight lines, down to a
    twentieth of the volume at rest; constant beyond the sampled bends (-60 to 180 deg).

    Raises:
        ConfigError: the file is missing or is no bending law.
    """
    path = config_path(law or LAW_FILE)
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["tables"]
        sampled = {pattern: _on_grid(rows, pattern, count) for pattern, count in (("psc", 1), ("pdc", 2))}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no bending law with gas volumes ({error}); make one with mbpam fe law") from None
    return GasVolumeTables(
        _PRESSURE_GRID_PA[0],
        _PRESSURE_GRID_PA[1] - _PRESSURE_GRID_PA[0],
        _BEND_GRID_RAD[0],
        _BEND_GRID_RAD[1] - _BEND_GRID_RAD[0],
        sampled["psc"],
        sampled["pdc"],
    )


def _on_grid(rows: list[dict[str, Any]], pattern: str, chambers: int) -> Array:
    """Volumes of one chamber on the grids; ``chambers`` share the file's volume."""
    chosen = sorted((row for row in rows if row["pattern"] == pattern), key=lambda row: row["p_kpa"])
    bend = np.radians(chosen[0]["bend_deg"])
    if any(len(row["bend_deg"]) != bend.size for row in chosen):
        raise ValueError("every pressure must be sampled at the same bends")
    pressure = 1e3 * np.array([row["p_kpa"] for row in chosen])
    volume = 1e-9 / chambers * np.array([row["gas_volume_mm3"] for row in chosen])
    inside = np.clip(_BEND_GRID_RAD, bend[0], bend[-1])
    over_bend = PchipInterpolator(bend, volume, axis=1)(inside)
    curve = PchipInterpolator(pressure, over_bend)
    within = np.clip(_PRESSURE_GRID_PA, pressure[0], pressure[-1])
    beyond = (_PRESSURE_GRID_PA - within)[:, None]
    slope = curve.derivative()(within)
    volumes: Array = np.maximum(curve(within) + slope * beyond, _LEAST_SHARE * over_bend[0])
    return volumes


def chamber_bend_rad(bend_rad: Array) -> Array:
    """Return the bend away from each chamber, shape (..., 4), of muscles bent by ``bend_rad`` (..., 2)."""
    away: Array = -bend_rad @ np.stack([np.cos(CHAMBER_AZIMUTH_RAD), np.sin(CHAMBER_AZIMUTH_RAD)])
    return away
