"""How a scene can be computed, and what that was measured to cost and to be off by (``data/fidelity_trade.json``)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from mbpam_ros.configuration import ConfigError, config_path, parse_config, require_positive

TABLE = "data/fidelity_trade.json"
"""The table that the planner reads and ``mbpam trade`` writes."""

AUTO = "auto"
"""The tier of a scene file that leaves the choice to the planner."""


@dataclass(frozen=True, order=True)
class Fidelity:
    """One way to compute a scene.

    Args:
        tier: static, arc or rod.
        modes: modes of curvature a plane; 1 for static and arc.
        step_s: sub-step. The tier ``static`` is exact at any.
        pneumatics: model of valves and chambers.
    """

    tier: str
    modes: int
    step_s: float
    pneumatics: str


@dataclass(frozen=True)
class Tolerance:
    """What errors are allowed, in the norms of :class:`Measured`.

    Args:
        static_pct, transient_pct: of the position of tips and object at rest, and in motion.
        contact_force_pct: of the fingers' forces.
    """

    static_pct: float = 5.0
    transient_pct: float = 5.0
    contact_force_pct: float = 10.0

    def __post_init__(self) -> None:
        require_positive(self, "static_pct", "transient_pct", "contact_force_pct")


@dataclass(frozen=True)
class Measured:
    """One row of the table: errors against the converged reference, and CPU time.

    Args:
        scene: the case that was run (:mod:`~mbpam_ros.study.fidelity.cases`).
        tier, modes, step_s, pneumatics: as in :class:`Fidelity`.
        static_error_pct: at rest, the largest distance of a tip (or of the object's centre) from the reference's, over
            the active length.
        transient_error_pct: the same while things move, the largest of all instants.
        pressure_error_pct: the largest difference of a chamber pressure while things move, over 100 kPa.
        cpu_ms_per_s: process time of the plant's steps at 100 Hz for one simulated second, without observing.
        contact_force_error_pct: at rest, the largest difference of a finger's force, as a vector, over the larger of
            the reference's largest and the object's weight; none where nothing touches.
    """

    scene: str
    tier: str
    modes: int
    step_s: float
    pneumatics: str
    static_error_pct: float
    transient_error_pct: float
    pressure_error_pct: float
    cpu_ms_per_s: float
    contact_force_error_pct: float | None = None

    @property
    def fidelity(self) -> Fidelity:
        """How the case was computed."""
        return Fidelity(self.tier, self.modes, self.step_s, self.pneumatics)


@dataclass(frozen=True)
class FidelityTable:
    """The measured table.

    Args:
        rows: one a case and fidelity.
        reference: what the rows are measured against, and how far that can be trusted.
        machine: where the CPU times come from.
        versions: of the libraries.
    """

    rows: tuple[Measured, ...]
    reference: dict[str, dict[str, float]]
    machine: dict[str, str]
    versions: dict[str, str]


def load_fidelity_table(name: str | Path = TABLE) -> FidelityTable:
    """Read a table.

    Raises:
        ConfigError: no such file, or wrong keys or values.
    """
    try:
        content = json.loads(config_path(name).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{name}: not valid JSON: {error}") from error
    return parse_config(FidelityTable, content, str(name))
