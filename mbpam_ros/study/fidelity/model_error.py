"""How far the equations of the plant's rod are off the muscle: converged rods beside all of it in finite elements.

The plant's rod is the uniform one that stands for the muscle (:mod:`~mbpam_ros.actuator.yielding_ends`), its bending
moment a line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mbpam_ros.actuator.design import MuscleGeometry, uniform_geometry
from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.actuator.yielding_ends import finite_element_uniform_law
from mbpam_ros.configuration import ConfigError, config_path
from mbpam_ros.plant.fidelity import ModelError
from mbpam_ros.study.muscle_states import RodModel, compared, read_states

STATES_FILE = "data/fe_muscle_states.json"
"""The whole muscle's states in the configuration directory, from ``mbpam fe states``."""

STRAIN_SETS = (("bend",), ("bend", "stretch"), STRAINS)


def states_file() -> Path | None:
    """Return the file of the whole muscle's states; none where the configuration has none."""
    try:
        return config_path(STATES_FILE)
    except ConfigError:
        return None


def model_errors(states: Path, geometry: MuscleGeometry) -> tuple[ModelError, ...]:
    """Return how far rods on the finite elements' law are off in the states of a file, for each set of strains.

    Args:
        states: a file of ``mbpam fe states``.
        geometry: of the muscle; its mass is that of the file, where it says one.

    Raises:
        MuscleStateError: the file cannot be read.
        StrainLawError: the law says nothing of a strain.
        RodSolutionError: a rod has no equilibrium in a state.
    """
    answered = read_states(states)
    mass_kg_m = answered.mass_per_length_kg_m or geometry.mass_per_length_kg_m
    muscle = replace(geometry, mass_per_length_kg_m=mass_kg_m)
    return tuple(_model_error(answered.rows, strains, muscle) for strains in STRAIN_SETS)


def _model_error(rows: Sequence[dict], strains: tuple[str, ...], muscle: MuscleGeometry) -> ModelError:
    law, rod = finite_element_uniform_law(muscle), uniform_geometry(muscle)
    found = compared(rows, RodModel(law, rod, strains, measured_by_m=muscle.active_length_m))
    free = [each["tip_error_pct"] for each in found if each["kind"] == "free"]
    return ModelError(strains, max(free, default=0.0), max(each["tip_error_pct"] for each in found))
