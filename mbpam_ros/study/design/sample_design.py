"""Designs of an optimal Latin hypercube, and how they fill their space beside the paper's 21."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.metamodel import TRAINING_TABLE
from mbpam_ros.study.design.latin_hypercube import (
    RANGES,
    SpaceFilling,
    from_unit,
    optimal_latin_hypercube,
    space_filling,
    to_unit,
)
from mbpam_ros.study.design.samples import Samples
from mbpam_ros.terminal import Progress, table

VARIABLES = {"a,b": ("a_mm", "b_mm"), "a,b,c,n": ("a_mm", "b_mm", "c_mm", "n")}
"""What can be sampled, with the columns of the result."""

_PLANE = VARIABLES["a,b"]


@dataclass(frozen=True, eq=False)
class SampledDesign:
    """Designs beside the paper's.

    Args:
        names: of the variables.
        seed: equal seeds give equal bits.
        points: shape (n, variables), columns ``names``.
        paper: the paper's designs (a, b), shape (21, 2).
    """

    names: tuple[str, ...]
    seed: int
    points: NDArray[np.float64]
    paper: NDArray[np.float64]

    def space_filling(self) -> dict[str, SpaceFilling]:
        """Return how the points fill their space and its plane (a, b), and the paper's that plane."""
        return {
            "design": space_filling(to_unit(self.points, self.names)),
            "design_over_a_b": space_filling(to_unit(self.points[:, :2], _PLANE)),
            "paper_over_a_b": space_filling(to_unit(self.paper, _PLANE)),
        }

    def csv_text(self) -> str:
        """Return the points as CSV with a running number, as the paper's tables have."""
        rows = [",".join(["no", *self.names])]
        rows += [",".join([str(number), *(f"{value:g}" for value in row)]) for number, row in enumerate(self.points, 1)]
        return "\n".join(rows) + "\n"

    def figures_text(self) -> str:
        """Return how they fill their space, as a table."""
        figures = self.space_filling()
        said = {f"these {len(self.points)}, ({','.join(name.removesuffix('_mm') for name in self.names)})": "design"}
        if self.names != _PLANE:
            said[f"these {len(self.points)}, (a,b) alone"] = "design_over_a_b"
        said[f"the paper's {len(self.paper)}, (a,b)"] = "paper_over_a_b"
        return table(
            ("points, ranges scaled to 0 .. 1", "centred discrepancy", "smallest distance"),
            [
                (what, f"{figures[key].discrepancy:.6f}", f"{figures[key].smallest_distance:.4f}")
                for what, key in said.items()
            ],
        )

    def as_json(self) -> dict[str, object]:
        """Return points and figures as plain values."""
        return {
            "variables": list(self.names),
            "ranges": {name: RANGES[name] for name in self.names},
            "seed": self.seed,
            "points": self.points.tolist(),
            "space_filling": {name: asdict(filling) for name, filling in self.space_filling().items()},
        }


def sampled_design(
    variables: str,
    count: int,
    seed: int,
    restarts: int,
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept_in: Path | None = None,
) -> SampledDesign:
    """Return ``count`` designs over :data:`VARIABLES` of that name, the best of so many restarts.

    The last three arguments are those of :func:`~mbpam_ros.study.design.latin_hypercube.optimal_latin_hypercube`.

    Raises:
        ConfigError: the paper's table is missing or unreadable.
        SamplingError: too few points or restarts.
        ResultFileError: ``kept_in`` cannot be written, or is no such file.
    """
    names = VARIABLES[variables]
    levels = optimal_latin_hypercube(count, len(names), seed, restarts, executor, progress, kept_in)
    return SampledDesign(names, seed, from_unit(levels, names), Samples.of_the_paper(TRAINING_TABLE).design_mm)
