"""One muscle at rest as a rod: where its tip lies under pressures, loads on the tip and gravity in any direction.

    mbpam rod --pattern pdc --pressure-kpa 100 --tip-force 0,0.05,0 --gravity 0,0,9.81 --json FILE
    mbpam rod --states fe_muscle_states.json --json FILE     beside finite elements, state by state
    mbpam rod --strains bend                                 a rod that cannot stretch or twist
    mbpam rod --ends uniform --bending line                  the plant's rod

Frame: origin at the clamp, z toward the tip of the straight muscle, the cross's arms along x and y. The same arguments
and keys as "mbpam fe muscle". The law is by default that of finite elements in the configuration (config), --law FILE
another of "mbpam fe law". Ends of silicone also turn, lengthen and shift the axis where the waves begin, as "mbpam fe
ends" found; --ends uniform puts what they do into the law and length of one uniform rod. --law calibrated takes that
rod as plant and estimator run on it, scaled to the angle and force that the gripper file asks for.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from mbpam_ros.actuator.bending_law import stored_shear_modulus_pa
from mbpam_ros.actuator.design import MuscleGeometry, uniform_geometry
from mbpam_ros.actuator.elastic_rod import BENDINGS, solid_end
from mbpam_ros.actuator.end_law import finite_element_end_law
from mbpam_ros.actuator.gas_volume import LAW_FILE
from mbpam_ros.actuator.rod_law import finite_element_rod_law
from mbpam_ros.actuator.strains import STRAINS, check_strains
from mbpam_ros.actuator.yielding_ends import finite_element_uniform_law
from mbpam_ros.commands.muscle_state import add_muscle_state, muscle_state
from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.configuration import ConfigError
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.study.muscle_states import (
    RodModel,
    answer_text,
    compared,
    comparison_text,
    read_states,
    rod_answer,
    summary,
)
from mbpam_ros.study.result_file import write_json

ENDS = ("silicone", "rigid", "uniform")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_muscle_state(parser)
    parser.add_argument(
        "--states", type=Path, metavar="FILE", help="compare with each state of FILE, instead of the one described"
    )
    parser.add_argument(
        "--strains",
        type=_strains,
        default=STRAINS,
        metavar="NAMES",
        help=f"what the rod may do (default: {','.join(STRAINS)})",
    )
    parser.add_argument("--law", default="config", metavar="LAW", help="config, calibrated or a file (default: config)")
    parser.add_argument(
        "--bending",
        choices=BENDINGS,
        default="curve",
        help="how the moment follows the curvature: as the plant's line, or as the unit cell's curve (default: curve)",
    )
    parser.add_argument(
        "--ends",
        choices=ENDS,
        help="solid silicone, as the finite elements', rigid, or put into one uniform rod, as the plant's (default: "
        "silicone; with --law calibrated: uniform, and nothing else)",
    )
    parser.add_argument("--gripper", default="gripper.yaml", metavar="YAML", help="the muscle (default: gripper.yaml)")
    parser.add_argument(
        "--mass-per-length",
        type=_mass,
        metavar="KG/M",
        help="of active part and ends (default: as the states' file, or the gripper's)",
    )
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the answer goes")


def run(options: argparse.Namespace) -> int:
    """Solve, print, and write what is asked for."""
    gripper = load_gripper(options.gripper)
    answered = None if options.states is None else read_states(options.states)
    mass_kg_m = options.mass_per_length or (answered and answered.mass_per_length_kg_m)
    geometry = replace(gripper.geometry, mass_per_length_kg_m=mass_kg_m) if mass_kg_m else gripper.geometry
    ends = options.ends or ("uniform" if options.law == "calibrated" else "silicone")
    model = _model(options, ends, gripper, geometry)
    told: dict[str, Any] = {
        "strains": list(options.strains),
        "law": options.law,
        "ends": ends,
        "bending": options.bending,
        "active_length_mm": 1e3 * geometry.active_length_m,
        "end_length_mm": 1e3 * geometry.end_length_m,
        "mass_per_length_kg_m": geometry.mass_per_length_kg_m,
    }
    if answered is None:
        answer = rod_answer(muscle_state(options), model)
        print(answer_text([answer]))
        result = answer | told
    else:
        found = compared(answered.rows, model)
        print(comparison_text(found))
        result = told | {"reference": options.states.name, "summary": summary(found), "states": found}
    if options.json is not None:
        write_json(options.json, result)
    return 0


def _model(options: argparse.Namespace, ends: str, gripper: Gripper, muscle: MuscleGeometry) -> RodModel:
    file, is_calibrated = LAW_FILE if options.law == "config" else options.law, options.law == "calibrated"
    if ends == "uniform":
        law = gripper.rod_law() if is_calibrated else finite_element_uniform_law(muscle, file)
        rod, over_m = uniform_geometry(muscle), muscle.active_length_m
        return RodModel(law, rod, options.strains, bending=options.bending, measured_by_m=over_m)
    if is_calibrated:
        raise ConfigError(
            f"the calibrated law is that of the uniform rod: --law calibrated and --ends {ends} exclude each other"
        )
    law = finite_element_rod_law(file)
    if ends == "rigid":
        return RodModel(law, muscle, options.strains, bending=options.bending)
    silicone = solid_end(stored_shear_modulus_pa(file), muscle)
    return RodModel(law, muscle, options.strains, silicone, options.bending, finite_element_end_law())


def _strains(text: str) -> tuple[str, ...]:
    strains = tuple(text.split(","))
    try:
        check_strains(strains)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return strains


def _mass(text: str) -> float:
    if not (math.isfinite(mass := float(text)) and mass > 0.0):
        raise argparse.ArgumentTypeError(f"must be above 0, found {text}; without weight: --gravity 0,0,0")
    return mass
