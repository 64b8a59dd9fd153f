"""A muscle as it is drawn: ``config/muscles/<name>.yaml``, and the folder beside it for what is found out about it.

The paper's muscle is one of them.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import DrawnDesign, MuscleGeometry
from mbpam_ros.actuator.section import chamber_area, outer_radius
from mbpam_ros.configuration import ConfigError, config_directory, load_config, require_positive

PAPER = "paper"
"""Name of the paper's muscle, whose values come from its own tables as well."""

_WAVE_POINTS = 64


@dataclass(frozen=True)
class MuscleDrawing:
    """Lengths of a muscle in millimetres, and what it is cast of.

    Args:
        outer_radius_mm: at the crests.
        active_length_mm: of the waves.
        end_length_mm: of each end without waves.
        a_mm: amplitude of the wave, peak to valley.
        b_mm: thickness of the cross's arms.
        c_mm: thickness of the chambers' wall.
        wave_count: waves along the active length.
        chambers: their pattern; four in a cross are known.
        silicone: of ``config/silicones.yaml``, or a file of ``mbpam silicone --json``.
        density_kg_m3: of the cured silicone.

    Raises:
        ValueError: lengths that make no muscle; the message says which.
    """

    outer_radius_mm: float
    active_length_mm: float
    end_length_mm: float
    a_mm: float
    b_mm: float
    c_mm: float
    wave_count: float
    chambers: Literal["cross"]
    silicone: str
    density_kg_m3: float

    def __post_init__(self) -> None:
        lengths = ("outer_radius_mm", "active_length_mm", "end_length_mm", "a_mm", "b_mm", "c_mm")
        require_positive(self, *lengths, "wave_count", "density_kg_m3")
        valley = self.outer_radius_mm - self.a_mm - self.c_mm
        corner = math.sqrt(0.5) * self.b_mm
        if valley <= 1.05 * corner:
            raise ValueError(
                f"no chamber is left in the valleys: outer_radius_mm - a_mm - c_mm = {valley:g} mm, and the cross's "
                f"corner is at {corner:g} mm; make a_mm, b_mm or c_mm smaller"
            )
        if self.c_mm > self.active_length_mm / self.wave_count:
            raise ValueError(
                f"a wall c_mm = {self.c_mm:g} mm thicker than a wave of {self.active_length_mm / self.wave_count:g} mm "
                "is long fills the folds; take fewer waves or a thinner wall"
            )
        if not 100.0 <= self.density_kg_m3 <= 10e3:
            raise ValueError(f"density_kg_m3 = {self.density_kg_m3:g} is no silicone's, which is near 1100")

    @property
    def section_mm2(self) -> float:
        """Mean area of silicone in a section of the waves [mm2]."""
        wave_mm = self.active_length_mm / self.wave_count
        outer = self.outer_radius_at_mm(wave_mm * (np.arange(_WAVE_POINTS) + 0.5) / _WAVE_POINTS)
        return float(np.mean(math.pi * outer**2 - 4.0 * chamber_area(outer - self.c_mm, self.b_mm)))

    def outer_radius_at_mm(self, along_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the outer radius [mm] at distances along the waves from where they begin, at a crest."""
        return outer_radius(along_mm, self.outer_radius_mm, self.a_mm, self.active_length_mm / self.wave_count)

    @property
    def design(self) -> DrawnDesign:
        """The two variables that designs differ by."""
        return DrawnDesign(self.a_mm, self.b_mm)

    @property
    def geometry(self) -> MuscleGeometry:
        """What a rod needs to know of it; the ends weigh as the waves do."""
        return MuscleGeometry(
            outer_radius_m=1e-3 * self.outer_radius_mm,
            end_length_m=1e-3 * self.end_length_mm,
            active_length_m=1e-3 * self.active_length_mm,
            mass_per_length_kg_m=1e-6 * self.section_mm2 * self.density_kg_m3,
        )


def drawing_names() -> tuple[str, ...]:
    """Return the names of the drawn muscles, sorted.

    Raises:
        ConfigError: there is no configuration directory.
    """
    return tuple(sorted(path.stem for path in (config_directory() / "muscles").glob("*.yaml")))


def load_drawing(name: str) -> MuscleDrawing:
    """Return the drawing of the muscle ``name``.

    Raises:
        ConfigError: there is none, or it draws no muscle.
    """
    if not re.fullmatch(r"\w[\w-]*", name, re.ASCII):
        raise ConfigError(f"a muscle is named by letters, digits, _ and -, without path or suffix, found {name!r}")
    if name not in drawing_names():
        raise ConfigError(
            f"no muscle {name!r}; known: {', '.join(drawing_names()) or 'none'}; draw it in {muscle_folder(name)}.yaml"
        )
    return load_config(MuscleDrawing, Path("muscles") / f"{name}.yaml")


def muscle_folder(name: str) -> Path:
    """Return where what was computed and measured of the muscle ``name`` is kept, in the configuration in use.

    Raises:
        ConfigError: there is no configuration directory.
    """
    return config_directory() / "muscles" / name
