"""A muscle as the rig measured it: factors on its drawing's law, kept beside the drawing (``target: measured``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mbpam_ros.actuator.drawing import muscle_folder
from mbpam_ros.actuator.rod_law import PatternFactors
from mbpam_ros.configuration import ConfigError, load_config, require_positive

FILE = "measured.json"


@dataclass(frozen=True)
class MeasuredMuscle:
    """What ``mbpam muscle calibrate`` found; the factors are means over the muscles that were measured.

    Args:
        base: target whose law is multiplied.
        psc, pdc: factors on M0, and on B at 100 kPa.
        stretch: factor on the free stretch.
        hysteresis_pa: half width of the hysteresis.
        bend_sigma: relative standard deviation of a free bend, scatter between muscles included where it was measured.
        sigma: of the factors by name, relative; of the hysteresis in Pa.
        scatter: of the factors between muscles by name, relative; empty for a single muscle.
        not_determined: what the data did not tell.
        provenance: where it comes from, by name.

    Raises:
        ValueError: a factor or a deviation that no muscle has.
    """

    base: Literal["fe", "test"]
    psc: PatternFactors
    pdc: PatternFactors
    stretch: float
    hysteresis_pa: float
    bend_sigma: float
    sigma: dict[str, float]
    scatter: dict[str, float]
    not_determined: tuple[str, ...]
    provenance: dict[str, str]

    def __post_init__(self) -> None:
        require_positive(self, "stretch")
        for name in ("psc", "pdc"):
            require_positive(getattr(self, name), "moment", "stiffness")
        if not (0.0 <= self.hysteresis_pa <= 20e3 and 0.0 <= self.bend_sigma <= 1.0):
            raise ValueError("hysteresis_pa must be within 0 .. 20 kPa, bend_sigma within 0 .. 1")


def load_measured(name: str) -> MeasuredMuscle:
    """Return the measured muscle ``name``.

    Raises:
        ConfigError: it was not measured, or its file holds something else.
    """
    path = muscle_folder(name) / FILE
    if not path.is_file():
        raise ConfigError(
            f"target measured: muscle {name!r} was not measured, there is no {path}; mbpam characterise and mbpam "
            f"muscle calibrate {name} --from FILE make it"
        )
    return load_config(MeasuredMuscle, path)
