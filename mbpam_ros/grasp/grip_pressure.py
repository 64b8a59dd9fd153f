"""The least pressure that holds an object, and the pressure it is gripped with.

The table (``data/grip_pressures.json``, made by ``mbpam grip-table``) has, for each mode, the least pressure at which
the simulated gripper lifted and kept objects of a few widths, depths below the palm, frictions and masses. What no
pressure up to :attr:`GripTable.highest_gauge_pa` held counts as one step above that. Over friction and mass it is
interpolated linearly; beyond, the nearest counts, and a heavier object than the heaviest is held by none. That gives a
least pressure at each of the four measured corners (width, depth) around an object. An object of at most the told mass
and at least the told friction is surely held where the gripper may have all of them. Then the grip is, with p_i the
corners' least pressures and w_i the weights of linear interpolation,

    p = (sum_i w_i p_i) (1 + margin_ratio) + margin_pa,

no more than the limit. Where it may have none of them even for the lightest that the object may be and the greatest
friction that was measured, it cannot hold it: it lies too deep or too near if the lightest of all would not be held
there, else it is too heavy. In between nothing is known for sure, and the mode's own pressure stands: of 200 random
grasps all 103 that were surely held were, those in between mostly, and more pressure lost some that the mode's held.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import ConfigError, config_path, require_positive
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import Gripper

Array = NDArray[np.float64]

TABLE = "data/grip_pressures.json"
"""What ``mbpam grip-table`` writes and an arbiter reads."""

WIDTH_SLACK_M = 0.003
"""What a camera errs by, and a width may be less than the least in the table."""

_LEAST_WEIGHT = 1e-9
_DEPTH_STEP_M = 0.001

AXES = ("width_m", "depth_m", "friction_coefficient", "mass_kg")
"""What a least pressure depends on, besides the mode."""


@dataclass(frozen=True)
class MassClasses:
    """The heaviest objects of the classes [kg]."""

    light: float = 0.06
    medium: float = 0.12
    heavy: float = 0.2

    def __post_init__(self) -> None:
        require_positive(self, "light")
        if not self.light < self.medium < self.heavy:
            raise ValueError(
                f"mass classes must rise, found light {self.light}, medium {self.medium}, heavy {self.heavy}"
            )

    def named(self, name: str) -> tuple[float | None, float]:
        """Return the masses between which a class lies by its name [kg]; None: as light as may be.

        Raises:
            ValueError: no such class.
        """
        classes: dict[str, float] = vars(self)
        if name not in classes:
            raise ValueError(f"no mass class {name!r}; known: {', '.join(classes)}")
        return max((kg for kg in classes.values() if kg < classes[name]), default=None), classes[name]


@dataclass(frozen=True)
class GripConfig:
    """How hard an object of known mass is gripped. One of unknown mass gets the pressure of its mode.

    Args:
        margin_ratio, margin_pa: above the least pressure that holds by the model.
        mass_classes_kg: what the names of mass classes stand for.
        table: file of least pressures, ``data/grip_pressures.json`` or one of your own gripper; none, or one that was
            made with other muscles: all objects get the pressures of their modes.
    """

    margin_ratio: float = 0.03
    margin_pa: float = 2000.0
    mass_classes_kg: MassClasses = field(default_factory=MassClasses)
    table: str | None = None

    def __post_init__(self) -> None:
        if self.margin_ratio < 0.0 or self.margin_pa < 0.0:
            raise ValueError(
                f"margins must not be negative, found margin_ratio {self.margin_ratio:g}, margin_pa {self.margin_pa:g}"
            )


@dataclass(frozen=True)
class Expected:
    """What is known of the object besides what is seen.

    Args:
        mass_kg: at most so heavy; none: not known.
        friction_coefficient: of fingers on it, at least so much; none: as the configuration says.
        lightest_kg: at least so heavy; none: as light as may be.

    Raises:
        ValueError: a value that is not positive.
    """

    mass_kg: float | None = None
    friction_coefficient: float | None = None
    lightest_kg: float | None = None

    def __post_init__(self) -> None:
        for name in ("mass_kg", "friction_coefficient", "lightest_kg"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be greater than 0, found {value}")


NOTHING_EXPECTED = Expected()


class _Grid(NamedTuple):
    """Least pressures of a mode [Pa gauge], by :data:`AXES`, and where along these they stand."""

    axes: tuple[Array, ...]
    least_gauge_pa: Array


class GripTable:
    """Least pressures that hold.

    Args:
        rows: a dict for each measured width, depth and friction of a mode: ``mode``, the first three of :data:`AXES`,
            and lists of equal length ``mass_kg`` and ``least_gauge_pa`` (none: no pressure held it).
        highest_gauge_pa: greatest pressure that was tried.
        step_pa: what counts above it.

    Raises:
        ValueError: a mode is missing, or its rows are no full grid.
    """

    def __init__(self, rows: list[dict[str, Any]], highest_gauge_pa: float, step_pa: float) -> None:
        self.highest_gauge_pa = highest_gauge_pa
        self._none_pa = highest_gauge_pa + step_pa
        self._grids = {mode: self._grid(mode, [row for row in rows if row["mode"] == mode]) for mode in MODE_NAMES}

    def corners(
        self, mode: str, width_m: float, depth_m: float, friction_coefficient: float, mass_kg: float
    ) -> tuple[Array, Array]:
        """Return the least pressures [Pa gauge] at the measured corners around an object, and their weights, each (4,).

        Above :attr:`highest_gauge_pa`: none that was tried holds it. Corners of no weight are left out.
        """
        grid = self._grids[mode]
        widths, depths, frictions, masses = grid.axes
        (low_w, share_w), (low_d, share_d) = _place(widths, width_m), _place(depths, depth_m)
        (low_f, share_f), (low_m, share_m) = _place(frictions, friction_coefficient), _place(masses, mass_kg)
        around = grid.least_gauge_pa[low_w : low_w + 2, low_d : low_d + 2, low_f : low_f + 2, low_m : low_m + 2]
        least = around @ [1.0 - share_m, share_m] @ [1.0 - share_f, share_f]
        if mass_kg > masses[-1]:
            least = np.full_like(least, self._none_pa)
        weight = np.outer([1.0 - share_w, share_w], [1.0 - share_d, share_d])
        counts = weight > _LEAST_WEIGHT
        return least[counts], weight[counts]

    def depths_m(self, mode: str) -> Array:
        """Return the measured depths of a mode, rising."""
        return self._grids[mode].axes[1]

    def thinnest_m(self, mode: str) -> float:
        """Return the least width that was measured [m]."""
        return float(self._grids[mode].axes[0][0])

    def roughest(self, mode: str) -> float:
        """Return the greatest friction that was measured."""
        return float(self._grids[mode].axes[2][-1])

    def lightest_kg(self, mode: str) -> float:
        """Return the least mass that was measured."""
        return float(self._grids[mode].axes[-1][0])

    def _grid(self, mode: str, rows: list[dict[str, Any]]) -> _Grid:
        if not rows:
            raise ValueError(f"no least pressures of the mode {mode}")
        outer = [np.unique([row[name] for row in rows]) for name in AXES[:-1]]
        masses = np.array(rows[0]["mass_kg"], dtype=float)
        axes = (*outer, masses)
        least = np.full([axis.size for axis in axes], np.nan)
        for row in rows:
            place = tuple(int(np.searchsorted(axis, row[name])) for axis, name in zip(outer, AXES[:-1], strict=True))
            if row["mass_kg"] != rows[0]["mass_kg"]:
                raise ValueError(f"{mode}: all rows must have the same mass_kg")
            least[place] = [self._none_pa if value is None else value for value in row["least_gauge_pa"]]
        if min(least.shape) < 2 or np.isnan(least).any():
            raise ValueError(f"{mode}: least pressures must be a full grid of at least two values along each axis")
        return _Grid(axes, least)


def load_grip_table(name: str | Path = TABLE) -> GripTable:
    """Read a table.

    Raises:
        ConfigError: no such file, or it is no such table.
    """
    path = config_path(name)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        settings = content["settings"]
        return GripTable(content["rows"], float(settings["highest_gauge_pa"]), float(settings["step_pa"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no table of grip pressures ({error}); make one with mbpam grip-table") from None


def made_with(gripper: Gripper) -> dict[str, Any]:
    """Return what a table tells of the gripper that it was made with."""
    return {"muscle": gripper.muscle, "finger_circle_radius_m": gripper.finger_circle_radius_m}


def table_for(name: str | Path | None, gripper: Gripper) -> str | Path | None:
    """Return a table's name if it was made with such muscles, so far apart, else None: it tells nothing of these.

    Raises:
        ConfigError: no such file, or it does not tell.
    """
    if name is None:
        return None
    path = config_path(name)
    try:
        told = json.loads(path.read_text(encoding="utf-8"))["settings"]["gripper"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no table that tells of its gripper ({error}); mbpam grip-table makes one") from None
    return name if told == made_with(gripper) else None


class GripPlanner:
    """Chooses how hard to grip.

    Args:
        config: margins.
        table: of least pressures.
        limit_gauge_pa: greatest pressure.
    """

    def __init__(self, config: GripConfig, table: GripTable, limit_gauge_pa: float) -> None:
        self._config, self._table, self._limit_pa = config, table, limit_gauge_pa

    def pressure_gauge_pa(
        self, mode: str, width_m: float, depth_m: float, friction_coefficient: float, expected: Expected
    ) -> float | str | None:
        """Return the grip pressure [Pa gauge], why none holds the object, or None: that of the mode.

        Args:
            mode: that suits it.
            width_m, depth_m: across the fingers, and of its centre below the palm.
            friction_coefficient: of fingers on it, at least.
            expected: between which masses it lies.
        """
        thinnest_m = self._table.thinnest_m(mode)
        if width_m < thinnest_m - WIDTH_SLACK_M:
            thin_mm = 1e3 * (thinnest_m - width_m)
            return (
                f"too thin by {thin_mm:.1f} mm: {1e3 * width_m:.1f} mm, {1e3 * thinnest_m:.0f} mm are known to be held"
            )
        roughest = max(friction_coefficient, self._table.roughest(mode))
        lightest = (mode, width_m, depth_m, roughest, self._table.lightest_kg(mode))
        if not self._holds(*lightest):
            return self._out_of_reach(*lightest)
        if expected.lightest_kg is not None:
            least, weight = self._table.corners(mode, width_m, depth_m, roughest, expected.lightest_kg)
            if least.min() > self._limit_pa:
                return self._too_heavy(expected.lightest_kg, float(least @ weight), roughest)
        if expected.mass_kg is None:
            return None
        least, weight = self._table.corners(mode, width_m, depth_m, friction_coefficient, expected.mass_kg)
        if least.max() > self._limit_pa:
            return None
        wanted_pa = float(least @ weight)
        return min(wanted_pa * (1.0 + self._config.margin_ratio) + self._config.margin_pa, self._limit_pa)

    def _too_heavy(self, mass_kg: float, needs_pa: float, friction_coefficient: float) -> str:
        highest_pa = self._table.highest_gauge_pa
        needs = f"more than {1e-3 * highest_pa:.0f}" if needs_pa > highest_pa else f"{1e-3 * needs_pa:.0f}"
        return (
            f"too heavy: {1e3 * mass_kg:.0f} g needs {needs} kPa even with a friction of {friction_coefficient:g}, "
            f"limit {1e-3 * self._limit_pa:.0f}"
        )

    def _holds(self, *place: Any) -> bool:
        return bool(self._table.corners(*place)[0].min() <= self._limit_pa)

    def _out_of_reach(
        self, mode: str, width_m: float, depth_m: float, friction_coefficient: float, mass_kg: float
    ) -> str:
        depths = self._table.depths_m(mode)
        holding = [
            depth
            for depth in np.arange(depths[0], depths[-1] + 0.5 * _DEPTH_STEP_M, _DEPTH_STEP_M)
            if self._holds(mode, width_m, float(depth), friction_coefficient, mass_kg)
        ]
        if not holding:
            return f"no depth at which {1e-3 * self._limit_pa:.0f} kPa hold {1e3 * width_m:.0f} mm in {mode}"
        nearest_m = min(holding, key=lambda depth: abs(depth - depth_m))
        off_mm, side = 1e3 * abs(depth_m - nearest_m), "deep" if depth_m > nearest_m else "near"
        return (
            f"too {side} by {off_mm:.0f} mm: {1e3 * depth_m:.0f} mm below the palm, the fingers hold it at "
            f"{1e3 * min(holding):.0f} to {1e3 * max(holding):.0f} mm"
        )


def _place(axis: Array, value: float) -> tuple[int, float]:
    """Return the place before a value on an axis, and its share of the way to the next; the ends beyond them."""
    low = min(max(int(np.searchsorted(axis, value)) - 1, 0), axis.size - 2)
    return low, min(max((value - axis[low]) / (axis[low + 1] - axis[low]), 0.0), 1.0)
