"""Constants of a silicone from its tensile test, as the paper's Fig. 4a.

    mbpam silicone TEST.csv                                   all models side by side
    mbpam silicone PULL_1.csv PULL_2.csv --model yeoh         the mean of repeats, and their spread
    mbpam silicone TEST.csv --width-mm 6 --thickness-mm 3 --length-mm 33       force and extension
    mbpam silicone --known                                    constants of common silicones (config/silicones.yaml)
    mbpam silicone TEST.csv --columns "-,strain (%),stress (kPa)"              names for columns that have none

A test is text in columns: engineering or true strain and stress, or extension and force; separators, decimal commas,
particulars above the table and a row of units are recognised, and what had to be assumed is printed. Models are fitted
to the engineering stress within --strain, and their stability (Drucker) is told over --stretch-seen, which is what the
finite elements of the paper's muscle see at 100 kPa. Tests of one direction alone leave open how a model fares when
pulled in two; see stability, and prefer a model of few constants.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.result_file import write_json
from mbpam_ros.study.silicone.fit import GOOD_R2, Fit, fit_all
from mbpam_ros.study.silicone.hyperelastic import MODELS
from mbpam_ros.study.silicone.known import load_silicones
from mbpam_ros.study.silicone.reading import Specimen, read_tensile_test
from mbpam_ros.study.silicone.tensile_test import TensileTest, mean_of, youngs_modulus_mpa
from mbpam_ros.terminal import table

STRETCH_SEEN = (0.4, 2.5)
"""Least and greatest principal stretch in the unit cell of the paper's muscle, free, two chambers at 100 kPa (0.40,
2.46; one chamber 0.44, 2.37), default mesh. All but a hundredth of its points lie within 0.42 and 2.07."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("tests", nargs="*", type=Path, metavar="TEST.csv", help="one test, or repeats of it")
    parser.add_argument("--known", action="store_true", help="print the silicones that are known by name")
    parser.add_argument("--model", choices=MODELS, help="the model that is wanted (default: yeoh)", default="yeoh")
    parser.add_argument("--strain", type=_range, default=(0.0, 1.0), metavar="LOW:HIGH", help="to fit (default: 0:1)")
    parser.add_argument(
        "--stretch-seen",
        type=_range,
        default=STRETCH_SEEN,
        metavar="LOW:HIGH",
        help=f"that the silicone will see (default: {STRETCH_SEEN[0]}:{STRETCH_SEEN[1]})",
    )
    parser.add_argument("--columns", metavar="NAMES", help="of the columns, in place of those in the file")
    for size in ("width", "thickness", "length"):
        parser.add_argument(f"--{size}-mm", type=float, metavar="MM", help=f"{size} of the specimen")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the constants go")
    parser.add_argument("--picture", type=result_file, metavar="FILE", help="where the picture goes (png, pdf or svg)")


def run(options: argparse.Namespace) -> int:
    """Read, fit, and print the table; the exit status is 1 if the wanted model does not follow the test."""
    if options.known == bool(options.tests):
        raise ConfigError("give a test, or --known")
    if options.known:
        print(_known_text())
        return 0
    specimen = Specimen(options.width_mm, options.thickness_mm, options.length_mm)
    tests = [read_tensile_test(path, specimen, options.columns) for path in options.tests]
    mean = mean_of(tests)
    fits = fit_all(mean, options.strain)
    print(_text(tests, mean, fits))
    warnings = _warnings(mean, fits, options)
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if options.json is not None:
        write_json(options.json, _as_json(tests, mean, fits, options, warnings))
    if options.picture is not None:
        from mbpam_ros.study.silicone.picture import draw_fits

        draw_fits(tests, mean, fits, options.picture)
    return 0 if fits[options.model].r2 >= GOOD_R2 else 1


def _known_text() -> str:
    rows = [
        (name, f"{each.c10_mpa:.5g}", f"{each.c20_mpa:.4g}", f"{each.c30_mpa:.4g}", f"{each.strain_to:g}", each.source)
        for name, each in load_silicones().items()
    ]
    return table(("silicone", "C10 MPa", "C20 MPa", "C30 MPa", "to strain", "source"), rows)


def _range(text: str) -> tuple[float, float]:
    match = re.fullmatch(r"([0-9.]+):([0-9.]+)", text)
    try:
        low, high = map(float, match.groups() if match else ())
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected LOW:HIGH, such as 0:1, found {text!r}") from None
    if not low < high:
        raise argparse.ArgumentTypeError(f"expected LOW below HIGH, found {text!r}")
    return low, high


def _text(tests: list[TensileTest], mean: TensileTest, fits: Mapping[str, Fit]) -> str:
    lines = []
    for test in tests:
        lines.append(
            f"{test.source}: strain {test.strain[0]:.3g} to {test.strain[-1]:.4g}, stress to {test.stress_mpa[-1]:.4g} "
            f"MPa, Young's modulus {youngs_modulus_mpa(test):.3g} MPa at small strains"
        )
        lines += [f"  {note}" for note in test.notes]
    if mean.spread_mpa is not None:
        share = float((mean.spread_mpa / mean.stress_mpa.max()).max())
        lines.append(f"{mean.source}: they spread by up to {100 * share:.2g} % of the largest stress")
    best = next(iter(fits.values()))
    rows = [
        (
            name,
            ", ".join(f"{constant} {value:.5g}" for constant, value in fit.model.constants().items()),
            f"{1e3 * fit.rmse_mpa:.3g}",
            f"{fit.r2:.5f}",
            f"{fit.aicc - best.aicc:.0f}",
            ", ".join(
                "{:.2f}-{:.2f}".format(*fit.model.stable_stretches(kind)) for kind in ("uniaxial", "equibiaxial")
            ),
        )
        for name, fit in fits.items()
    ]
    lines += ["", f"{best.points} points, stretch {best.stretch_range[0]:.3f} to {best.stretch_range[1]:.3f}"]
    lines.append(
        table(("model", "constants [MPa]", "RMSE kPa", "R2", "AICc - best", "stable: one way, two ways"), rows)
    )
    return "\n".join(lines)


def _warnings(mean: TensileTest, fits: Mapping[str, Fit], options: argparse.Namespace) -> list[str]:
    found = []
    low, high = options.strain
    if mean.strain[-1] < 0.98 * high:
        found.append(f"the test ends at strain {mean.strain[-1]:.3g}, before the {high:g} asked for")
    chosen = fits[options.model]
    if chosen.r2 < GOOD_R2:
        better = [name for name, fit in fits.items() if fit.r2 >= GOOD_R2]
        advice = f"take {' or '.join(better)}" if better else "no model here does: fit a smaller range of --strain"
        found.append(f"{options.model} has R2 {chosen.r2:.4f}, below {GOOD_R2}; {advice}")
    seen = options.stretch_seen
    for deformation, (least, greatest) in chosen.unstable(*seen).items():
        stable = [name for name, fit in fits.items() if not fit.unstable(*seen)]
        found.append(
            f"{options.model} is stable in {deformation} stretch from {least:.2f} to {greatest:.2f} alone, and "
            f"{seen[0]:g} to {seen[1]:g} will be seen"
            + (f"; stable throughout: {', '.join(stable)}" if stable else "; fit a larger range of --strain")
        )
    if seen[1] > 1.02 * chosen.stretch_range[1]:
        found.append(
            f"beyond stretch {chosen.stretch_range[1]:.2f} the model guesses; fit it with --strain 0:{seen[1] - 1.0:g}"
        )
    return found


def _as_json(
    tests: list[TensileTest],
    mean: TensileTest,
    fits: Mapping[str, Fit],
    options: argparse.Namespace,
    warnings: list[str],
) -> dict[str, object]:
    return {
        "tests": [
            {
                "file": test.source,
                "strain": [float(test.strain[0]), float(test.strain[-1])],
                "stress_max_mpa": float(test.stress_mpa.max()),
                "youngs_modulus_mpa": youngs_modulus_mpa(test),
                "notes": list(test.notes),
            }
            for test in tests
        ],
        "spread_max_mpa": None if mean.spread_mpa is None else float(mean.spread_mpa.max()),
        "model": options.model,
        "best": next(iter(fits)),
        "strain_range": list(options.strain),
        "stretch_seen": list(options.stretch_seen),
        **fits[options.model].as_json(),
        "models": {name: fit.as_json() for name, fit in fits.items()},
        "warnings": warnings,
    }
