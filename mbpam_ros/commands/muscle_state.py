"""The arguments that describe a state of one muscle, the same for the rod and for the finite elements."""

from __future__ import annotations

import argparse
import re

from mbpam_ros.actuator.elastic_rod import HANGING
from mbpam_ros.study.muscle_states import PATTERN_SHARES, MuscleState


def add_muscle_state(parser: argparse.ArgumentParser) -> None:
    """Add pressures, loads on the tip and gravity."""
    parser._negative_number_matcher = re.compile(r"^-[\d.]")  # else argparse takes -0.1,0,0 for an option
    parser.add_argument(
        "--pattern",
        choices=PATTERN_SHARES,
        default="pdc",
        help="chambers 1 and 4 (pdc, bends toward -x), 1 alone (psc), or p in 1 and p/2 in 2 (half); default: pdc",
    )
    parser.add_argument("--pressure-kpa", type=float, default=100.0, metavar="P", help="gauge (default: 100)")
    parser.add_argument(
        "--tip-force",
        type=_vector,
        default=(0.0, 0.0, 0.0),
        metavar="FX,FY,FZ",
        help="dead force on the tip [N] (default: none)",
    )
    parser.add_argument(
        "--tip-torque", type=float, default=0.0, metavar="T", help="about the tip's direction [N mm] (default: none)"
    )
    parser.add_argument(
        "--gravity", type=_vector, default=HANGING, metavar="GX,GY,GZ", help="[m/s2] (default: 0,0,9.81, hanging)"
    )


def muscle_state(options: argparse.Namespace) -> MuscleState:
    """Return the state that the arguments of :func:`add_muscle_state` describe.

    Raises:
        MuscleStateError: they describe none.
    """
    return MuscleState(options.pattern, options.pressure_kpa, options.tip_force, options.tip_torque, options.gravity)


def _vector(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"wants three numbers with commas between, found {text!r}") from error
    return x, y, z
