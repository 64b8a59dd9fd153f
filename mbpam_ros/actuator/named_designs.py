"""Designs by name: the paper's initial one, and those that ``mbpam optimise --save-as`` has kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mbpam_ros.actuator.design import INITIAL_DESIGN, MuscleDesign
from mbpam_ros.configuration import ConfigError, config_directory, load_config

INITIAL = "initial"
"""Name of the paper's initial design, :data:`~mbpam_ros.actuator.design.INITIAL_DESIGN`."""


@dataclass(frozen=True)
class KeptDesign:
    """A design that was chosen by computation, and how.

    Args:
        a_mm, b_mm: the design.
        theta_max_deg, f_max_n: what the choosing metamodel says of it, two chambers (PDC) at 100 kPa.
        provenance: samples, metamodel, algorithm, seed, rule and versions, each by its name.

    Raises:
        DesignDomainError: the paper's data do not speak about it, so no gripper could run with it.
    """

    a_mm: float
    b_mm: float
    theta_max_deg: float
    f_max_n: float
    provenance: dict[str, str]

    def __post_init__(self) -> None:
        self.design  # noqa: B018 - refuses what lies outside the domain

    @property
    def design(self) -> MuscleDesign:
        """The design itself."""
        return MuscleDesign(self.a_mm, self.b_mm)


@dataclass(frozen=True)
class _DesignFile:
    designs: dict[str, KeptDesign]


def kept_designs_path() -> Path:
    """Return the file of the kept designs, in the configuration directory in use.

    Raises:
        ConfigError: there is no configuration directory.
    """
    return config_directory() / "data" / "designs.json"


def load_kept_designs() -> dict[str, KeptDesign]:
    """Return the kept designs by name; none where nothing was kept.

    Raises:
        ConfigError: the file holds something else, or a design outside the paper's domain.
    """
    path = kept_designs_path()
    return load_config(_DesignFile, path).designs if path.is_file() else {}


def load_design(name: str) -> MuscleDesign:
    """Return the design ``name``.

    Raises:
        ConfigError: no design has that name; the message lists those that there are.
    """
    designs = {INITIAL: INITIAL_DESIGN, **{key: kept.design for key, kept in load_kept_designs().items()}}
    if name not in designs:
        raise ConfigError(
            f"no design {name!r}; known: {', '.join(designs)}; give one of them, or a_mm and b_mm, or keep one with "
            f"mbpam optimise --save-as {name}"
        )
    return designs[name]
