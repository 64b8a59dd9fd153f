"""How a scene is computed, and what that was measured to cost and to be off by (``data/fidelity_trade.json``)."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

from mbpam_ros.actuator.chambers import FINGER_COUNT
from mbpam_ros.actuator.strains import STRAINS, check_strains
from mbpam_ros.configuration import ConfigError, config_path, parse_config, require_positive

TABLE = "data/fidelity_trade.json"
"""The table that the planner reads and ``mbpam trade`` writes."""

AUTO = "auto"
"""The tier of a scene file that leaves the choice to the planner."""

TWIST_MODES = STRETCH_MODES = 2
"""Modes of a strain that a scene asks for."""


ALL_FINGERS = tuple(range(1, FINGER_COUNT + 1))
"""Numbers of the fingers."""


@dataclass(frozen=True, order=True)
class Fidelity:
    """One way to compute a scene. The first four are what the table's rows are told apart by.

    Args:
        tier: static, arc or rod.
        modes: modes of curvature a plane; 1 for static and arc.
        sub_step_s: step of the computation. The tier ``static`` is exact at any.
        pneumatics: model of valves and chambers; none for that of ``pneumatics.yaml``.
        air_modes: modes while the object is out of reach (:mod:`~mbpam_ros.plant.tiers.adaptive`), no more than
            ``modes``; none for always ``modes``.
        moving_fingers: numbers of those that are computed; the others hang straight, must not be filled, and touch
            nothing.
        contact: whether anything touches; false leaves the object where it starts, to be seen only, and costs nothing.
        largest_jump_pct: what a tip may move by where the number of modes changes, of the active length.
        twist_modes, stretch_modes: modes of twist and of stretch, tier rod; without modes a muscle keeps its length, or
            does not twist, and nothing is spent on it.
    """

    tier: str
    modes: int
    sub_step_s: float
    pneumatics: str | None = None
    air_modes: int | None = None
    moving_fingers: tuple[int, ...] = ALL_FINGERS
    contact: bool = True
    largest_jump_pct: float = 5.0
    twist_modes: int = 0
    stretch_modes: int = 0

    @property
    def strains(self) -> tuple[str, ...]:
        """What the muscles do, some of :data:`~mbpam_ros.actuator.strains.STRAINS` in their order."""
        modes = {"bend": self.modes, "twist": self.twist_modes, "stretch": self.stretch_modes}
        return tuple(strain for strain in STRAINS if strain == "bend" or modes[strain])

    def __post_init__(self) -> None:
        require_positive(self, "sub_step_s", "largest_jump_pct")
        _require_no_more_in_the_air(self.modes, self.air_modes)
        if min(self.twist_modes, self.stretch_modes) < 0:
            raise ValueError(
                f"twist_modes and stretch_modes are 0 or more, found {self.twist_modes}, {self.stretch_modes}"
            )
        _require_fingers(self.moving_fingers)


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
class FidelityRequest:
    """How a scene file or a user wants a scene computed; :func:`~mbpam_ros.plant.planner.choose_fidelity` makes it one.

    Args:
        tier: how the muscles are computed: static, arc or rod. With auto, what is none of the others is chosen to be
            within the tolerance; with a tier and a step, none stands for what the others say here.
        sub_step_s: step of the computation.
        pneumatics: model of valves and chambers; none for that of ``pneumatics.yaml``.
        modes: modes of curvature a plane, for the tier ``rod``; none for 2 in the air, 3 where there may be contact.
        air_modes: those while the object is out of reach; none for always ``modes``.
        moving_fingers, contact: as in :class:`Fidelity`; none for all, and for contact with what there is.
        tolerance: what errors are allowed; none for the default.
        strains: which of bend, twist and stretch a muscle has in the tier ``rod``; bend always. None: bend alone where
            tier and step are given, else as planned.
    """

    tier: str = AUTO
    sub_step_s: float | None = None
    pneumatics: str | None = None
    modes: int | None = None
    air_modes: int | None = None
    moving_fingers: tuple[int, ...] | None = None
    contact: bool | None = None
    tolerance: Tolerance | None = None
    strains: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if self.sub_step_s is not None:
            require_positive(self, "sub_step_s")
        _require_no_more_in_the_air(self.modes, self.air_modes)
        if self.strains is not None:
            check_strains(self.strains)
            object.__setattr__(self, "strains", tuple(each for each in STRAINS if each in self.strains))
        if self.moving_fingers is not None:
            _require_fingers(self.moving_fingers)

    def in_tier(self, tier: str) -> FidelityRequest:
        """Return the request in another tier; numbers of modes are given up where that takes none."""
        if tier in ("rod", AUTO):
            return dataclasses.replace(self, tier=tier)
        return dataclasses.replace(self, tier=tier, modes=None, air_modes=None)


def _require_no_more_in_the_air(modes: int | None, air_modes: int | None) -> None:
    if modes is not None and air_modes is not None and air_modes > modes:
        raise ValueError(f"air_modes must not be above modes, found {air_modes} and {modes}")


def _require_fingers(moving: tuple[int, ...]) -> None:
    if not (moving and set(moving) <= set(ALL_FINGERS) and len(set(moving)) == len(moving)):
        raise ValueError(f"moving_fingers must be some of {ALL_FINGERS}, each once, found {moving}")


@dataclass(frozen=True)
class Measured:
    """One row of the table: errors against the converged reference of a muscle with the same strains, and CPU time.

    Args:
        scene: the case that was run (:mod:`~mbpam_ros.study.fidelity.cases`); of a promise, the kind of scene.
        tier, modes, step_s, pneumatics: as in :class:`Fidelity`; ``step_s`` is its ``sub_step_s``.
        static_error_pct: at rest, the largest distance of a tip (or of the object's centre) from the reference's, over
            the active length.
        transient_error_pct: the same while things move, the largest of all instants.
        pressure_error_pct: the largest difference of a chamber pressure while things move, over 100 kPa.
        cpu_ms_per_s: process time of the plant's steps at 100 Hz for one simulated second, without observing, by the
            cost model (:mod:`~mbpam_ros.study.fidelity.costs`).
        contact_force_error_pct: at rest, the largest difference of a finger's force, as a vector, over the larger of
            the reference's largest and the object's weight; none where nothing touches.
        twist_modes, stretch_modes: as in :class:`Fidelity`.
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
    twist_modes: int = 0
    stretch_modes: int = 0

    @cached_property
    def fidelity(self) -> Fidelity:
        """How the case was computed."""
        return Fidelity(
            self.tier,
            self.modes,
            self.step_s,
            self.pneumatics,
            twist_modes=self.twist_modes,
            stretch_modes=self.stretch_modes,
        )


@dataclass(frozen=True)
class ModelError:
    """How far a converged rod with some strains is off the whole muscle in finite elements.

    Args:
        strains: of the rod.
        free_pct: the largest distance of the tips over the active length, nothing but gravity acting on the muscle.
        loaded_pct: the same, forces and torques on the tip among what acts.
    """

    strains: tuple[str, ...]
    free_pct: float
    loaded_pct: float


@dataclass(frozen=True)
class FidelityTable:
    """The measured table.

    Args:
        rows: one a case and fidelity.
        reference: what the rows are measured against, and how far that can be trusted.
        machine: where the CPU times come from, when they were measured, and whether they can be believed.
        versions: of the libraries.
        model_errors: of the rods, a row for each set of strains; none: not known.
        promises: what scenes of a kind are off by at most, a row for each kind and fidelity, by
            :mod:`~mbpam_ros.study.fidelity.calibration`; none: the cases stand for their kinds.
        ranges: by kind of scene and feature (:func:`~mbpam_ros.plant.planner.features_of`) the least and the greatest
            value among the scenes that the promises are made from.
        calibration: how the promises were made: quantile, share of broken ones, scenes, seed.
    """

    rows: tuple[Measured, ...]
    reference: dict[str, dict[str, float]]
    machine: dict[str, str]
    versions: dict[str, str]
    model_errors: tuple[ModelError, ...] = ()
    promises: tuple[Measured, ...] = ()
    ranges: dict[str, dict[str, tuple[float, float]]] = dataclasses.field(default_factory=dict)
    calibration: dict[str, float] = dataclasses.field(default_factory=dict)

    @property
    def judging(self) -> tuple[Measured, ...]:
        """The rows that a plan is made from."""
        return self.promises or self.rows

    def model_error_pct(self, strains: tuple[str, ...], loaded: bool) -> float:
        """Return how far a rod with these strains is off the finite elements; 0 where that is not known."""
        for each in self.model_errors:
            if each.strains == strains:
                return each.loaded_pct if loaded else each.free_pct
        return 0.0


def load_fidelity_table(name: str | Path = TABLE) -> FidelityTable:
    """Read a table; one that was read and has not changed since is not read again.

    Raises:
        ConfigError: no such file, or wrong keys or values.
    """
    path = config_path(name)
    return _read_table(path, path.stat().st_mtime_ns, str(name))


@lru_cache(maxsize=2)
def _read_table(path: Path, _changed_ns: int, name: str) -> FidelityTable:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{name}: not valid JSON: {error}") from error
    return parse_config(FidelityTable, content, name)
