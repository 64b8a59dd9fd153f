"""Factors on a muscle's law from the curves of the rig, kept for `target: measured` in gripper.yaml.

    mbpam muscle calibrate paper --from FILE             FILE of mbpam characterise --json
    mbpam muscle calibrate paper --from A.json B.json    two muscles of one kind: their mean, and what they scatter by

Weighted least squares find, for one chamber (psc) and two (pdc), factors on moment and stiffness, and on stretch and
hysteresis, each with its deviation; what the curves do not tell is said. The result goes to
config/muscles/NAME/measured.json, from where plant and estimator read it.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Literal

import scipy

from mbpam_ros.actuator.drawing import PAPER, load_drawing, muscle_folder
from mbpam_ros.actuator.measured_muscle import FILE, MeasuredMuscle
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.study.provenance import file_digest
from mbpam_ros.study.result_file import require_makeable, write_json
from mbpam_ros.study.rig.calibrate import as_json, factor, measured_muscle
from mbpam_ros.study.rig.curves import read_curves
from mbpam_ros.study.rig.fit import FittedMuscle, fit_muscle
from mbpam_ros.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("name", metavar="NAME", help="of a drawing in config/muscles")
    parser.add_argument(
        "--from", dest="files", nargs="+", type=Path, required=True, metavar="FILE", help="of mbpam characterise"
    )
    parser.add_argument("--base", choices=("fe", "test"), help="target to multiply (default: test for paper, else fe)")
    parser.add_argument("--dry-run", action="store_true", help="print what would be kept, keep nothing")


def run(options: argparse.Namespace) -> int:
    """Fit each muscle, print the factors, and keep their mean."""
    base: Literal["fe", "test"] = options.base or ("test" if options.name == PAPER else "fe")
    gripper = drawn_gripper(options.name, base)
    law, geometry = gripper.rod_law(), gripper.rod_geometry
    fitted = [fit_muscle(law, geometry, read_curves(path)) for path in options.files]
    provenance = {
        "command": "mbpam muscle calibrate",
        "measured": ", ".join(f"{path.name} {file_digest(path)}" for path in options.files),
        "scipy": scipy.__version__,
    }
    measured = measured_muscle(fitted, base, provenance)
    print(measured_text(fitted, measured))
    if not options.dry_run:
        path = muscle_folder(options.name) / FILE
        require_makeable(path.parent)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, as_json(measured))
        print(f"kept in {path}; target: measured in gripper.yaml uses it")
    return 0


def drawn_gripper(name: str, target: Literal["fe", "test"]) -> Gripper:
    """Return the gripper of ``gripper.yaml`` with the muscle ``name`` in the place of its own.

    Raises:
        ConfigError: no such muscle, or it does not fit.
    """
    drawing = load_drawing(name)
    return dataclasses.replace(
        load_gripper(), muscle=name, design=drawing.design, geometry=drawing.geometry, target=target
    )


def measured_text(fitted: list[FittedMuscle], measured: MeasuredMuscle) -> str:
    """Return factors, deviations and what the curves do not tell."""
    names = ("psc_moment", "psc_stiffness", "pdc_moment", "pdc_stiffness", "stretch")
    values = {
        "psc_moment": measured.psc.moment,
        "psc_stiffness": measured.psc.stiffness,
        "pdc_moment": measured.pdc.moment,
        "pdc_stiffness": measured.pdc.stiffness,
        "stretch": measured.stretch,
    }
    rows = [
        (
            name.replace("_", " "),
            f"{values[name]:.4f}",
            f"{100.0 * measured.sigma[name]:.2f} %" if name in measured.sigma else "not measured",
            f"{100.0 * measured.scatter[name]:.2f} %" if name in measured.scatter else "",
            ", ".join(f"{factor(each, name):.4f}" for each in fitted),
        )
        for name in names
    ]
    lines = [table(("factor on", "mean", "1 sigma", "scatter", "each muscle"), rows)]
    lines.append(
        f"hysteresis: +-{1e-3 * measured.hysteresis_pa:.2f} kPa; bends known to {100 * measured.bend_sigma:.2f} %"
    )
    for each in fitted:
        force = "" if math.isnan(each.force_rmse_n) else f", {1e3 * each.force_rmse_n:.1f} mN"
        bend = "" if math.isnan(each.bend_rmse_deg) else f"{each.bend_rmse_deg:.2f} deg"
        lines.append(f"left over: {bend}{force} rms; chi2 per freedom {each.chi2_per_freedom:.2f}")
    lines += [f"not determined: {text}" for text in measured.not_determined]
    return "\n".join(lines)
