"""Command ``sample_design``: where to run finite elements (or build muscles) so that few samples tell most.

    sample_design --csv FILE                                 21 designs over (a, b), as many as the paper's
    sample_design --variables a,b,c,n --count 40 --csv FILE  over all four design variables

An optimal Latin hypercube: SciPy's, its centred discrepancy lowered by exchanges. How it fills the space is printed
beside the paper's 21 points.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.metamodel import TRAINING_TABLE
from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.announcement import announce
from mbpam_ros.study.design.latin_hypercube import (
    RANGES,
    SamplingError,
    SpaceFilling,
    from_unit,
    optimal_latin_hypercube,
    space_filling,
    to_unit,
)
from mbpam_ros.study.design.pictures import PictureError, draw_sampling
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.study.result_file import ResultFileError, write_json, write_text

VARIABLES = {"a,b": ("a_mm", "b_mm"), "a,b,c,n": ("a_mm", "b_mm", "c_mm", "n")}
"""What can be sampled, with the columns of the result."""

_S_PER_DESIGN = 0.5

_PLANE = VARIABLES["a,b"]


def csv_text(points: NDArray[np.float64], names: tuple[str, ...]) -> str:
    """Return the points as CSV with a running number, as the paper's tables have."""
    rows = [",".join(["no", *names])]
    rows += [",".join([str(number), *(f"{value:g}" for value in row)]) for number, row in enumerate(points, 1)]
    return "\n".join(rows) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _parser().parse_args(arguments)
    names = VARIABLES[options.variables]
    try:
        announce(f"{options.restarts} designs of {options.count} points", _S_PER_DESIGN * max(options.restarts, 0))
        points = from_unit(optimal_latin_hypercube(options.count, len(names), options.seed, options.restarts), names)
        paper = Samples.of_the_paper(TRAINING_TABLE).design_mm
        figures = {
            "design": space_filling(to_unit(points, names)),
            "design_over_a_b": space_filling(to_unit(points[:, :2], _PLANE)),
            "paper_over_a_b": space_filling(to_unit(paper, _PLANE)),
        }
        text = csv_text(points, names)
        print(text)
        print(f"{'points':<26}{'centred discrepancy':>20}{'smallest distance':>19}   (ranges scaled to 0 ... 1)")
        print(_figures_text(f"these {len(points)}, ({options.variables})", figures["design"]))
        if names != _PLANE:
            print(_figures_text(f"these {len(points)}, (a,b) alone", figures["design_over_a_b"]))
        print(_figures_text(f"the paper's {len(paper)}, (a,b)", figures["paper_over_a_b"]))
        if options.csv is not None:
            write_text(options.csv, text)
        if options.json is not None:
            write_json(
                options.json,
                {
                    "variables": list(names),
                    "ranges": {name: RANGES[name] for name in names},
                    "seed": options.seed,
                    "points": points.tolist(),
                    "space_filling": {name: asdict(filling) for name, filling in figures.items()},
                },
            )
        if options.picture is not None:
            draw_sampling(points, names, paper, options.picture)
    except (ConfigError, SamplingError, PictureError, ResultFileError) as error:
        print(f"sample_design: {error}", file=sys.stderr)
        return 1
    return 0


def _figures_text(name: str, filling: SpaceFilling) -> str:
    return f"{name:<26}{filling.discrepancy:>20.6f}{filling.smallest_distance:>19.4f}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "sample_design", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--variables", choices=VARIABLES, default="a,b")
    parser.add_argument("--count", type=int, default=21, metavar="N", help="number of designs (default: 21)")
    parser.add_argument("--seed", type=_seed, default=0, help="equal seeds give equal designs (default: 0)")
    parser.add_argument("--restarts", type=int, default=8, metavar="N", help="designs to choose from (default: 8)")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="where the designs go")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where designs and figures go")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="where the picture goes (png, pdf or svg)")
    return parser


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError("a seed is not negative")
    return seed


if __name__ == "__main__":
    raise SystemExit(main())
