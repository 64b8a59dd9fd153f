"""What ``mbpam muscle build`` keeps of a drawn muscle for whoever runs it: that it was built, and how sure that is."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from mbpam_ros.actuator.drawing import MuscleDrawing, load_drawing, muscle_folder
from mbpam_ros.configuration import ConfigError, load_config

FILE = "built.json"
LAW_FILE = "law.json"
"""The finite element law of the drawing, as ``mbpam fe law`` writes it, in the muscle's folder."""

ENDS_FILE = "ends.json"
"""What the drawing's ends do, as ``mbpam fe ends`` writes it; without the file they are similar to the paper's."""


@dataclass(frozen=True)
class BuiltMuscle:
    """A muscle's own finite elements in short.

    Args:
        theta_max_deg, f_max_n: two chambers (PDC) at 100 kPa, of the drawing.
        bend_sigma: relative standard deviation of a bend, from what is known of the mesh's error.
        drawing: what was built.
        provenance: where it comes from, by name.

    Raises:
        ValueError: values that no muscle has.
    """

    theta_max_deg: float
    f_max_n: float
    bend_sigma: float
    drawing: MuscleDrawing
    provenance: dict[str, str]

    def __post_init__(self) -> None:
        if not (self.theta_max_deg > 0.0 and self.f_max_n > 0.0 and 0.0 <= self.bend_sigma <= 1.0):
            raise ValueError("theta_max_deg and f_max_n must be above 0, bend_sigma within 0 .. 1")


def load_built(name: str) -> BuiltMuscle:
    """Return what was built of the muscle ``name``.

    Raises:
        ConfigError: it was not built, or its drawing has changed since, or its files hold something else.
    """
    path = muscle_folder(name) / FILE
    if not path.is_file():
        raise ConfigError(f"muscle {name!r} was not built, there is no {path}; mbpam muscle build {name} makes it")
    built = load_config(BuiltMuscle, path)
    changed = [key for key, value in asdict(load_drawing(name)).items() if value != getattr(built.drawing, key)]
    if changed:
        raise ConfigError(
            f"muscle {name!r} was built with other values of {', '.join(changed)} than its drawing has now; "
            f"mbpam muscle build {name} does it anew"
        )
    return built
