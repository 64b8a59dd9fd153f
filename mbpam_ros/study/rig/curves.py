"""Samples of a rig as files: every sample as CSV, and curves averaged over samples and repeats, as the paper's Fig. 5.

A repeat's value at a pressure is the mean of its window; the curve's is the mean of the repeats, of all directions of a
pattern and of all muscles that were measured, and its spread is what these means differ by.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mbpam_ros.configuration import ConfigError
from mbpam_ros.study.rig.procedure import BEND, QUANTITIES, Sample

COLUMNS = (
    "time_s", "pattern", "azimuth_deg", "quantity", "repeat", "branch", "set_kpa", "pressure_kpa", "bend_deg", "force_n"
)  # fmt: skip


@dataclass(frozen=True)
class CurvePoint:
    """A curve at one pressure, on the way up or down.

    Args:
        pattern, quantity, branch: of the curve.
        pressure_kpa: mean of what was measured.
        mean, spread: of the repeats' means, standard deviation, 0 for a single one; [deg] or [N].
        noise: standard deviation of single samples around their window's mean.
        repeats, samples: how many made it.
    """

    pattern: str
    quantity: str
    branch: str
    pressure_kpa: float
    mean: float
    spread: float
    noise: float
    repeats: int
    samples: int


def csv_text(samples: Sequence[Sample]) -> str:
    """Return all samples as CSV with the columns :data:`COLUMNS`; what was not measured stays empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for each in samples:
        value = f"{each.value:.6g}"
        of_quantity = (value, "") if each.mount.quantity == BEND else ("", value)
        writer.writerow(
            [
                f"{each.time_s:.4f}",
                each.mount.pattern,
                f"{each.mount.azimuth_deg:g}",
                each.mount.quantity,
                each.repeat,
                each.branch,
                f"{each.set_kpa:g}",
                f"{each.pressure_kpa:.4f}",
                *of_quantity,
            ]
        )
    return text.getvalue()


def averaged(samples: Sequence[Sample]) -> list[CurvePoint]:
    """Return the curves of samples, ordered by pattern, quantity, branch and pressure."""
    windows: dict[tuple[str, str, str, float], dict[tuple[float, int], list[Sample]]] = {}
    for each in samples:
        curve = (each.mount.pattern, each.mount.quantity, each.branch, each.set_kpa)
        windows.setdefault(curve, {}).setdefault((each.mount.azimuth_deg, each.repeat), []).append(each)
    points = []
    for (pattern, quantity, branch, _), repeats in sorted(windows.items()):
        values = [np.array([each.value for each in window]) for window in repeats.values()]
        means = np.array([value.mean() for value in values])
        pressures = [np.mean([each.pressure_kpa for each in window]) for window in repeats.values()]
        points.append(
            CurvePoint(
                pattern,
                quantity,
                branch,
                float(np.mean(pressures)),
                float(means.mean()),
                float(means.std(ddof=1)) if means.size > 1 else 0.0,
                float(np.sqrt(np.mean([value.var() for value in values]))),
                int(means.size),
                int(sum(value.size for value in values)),
            )
        )
    return points


def as_json(points: Sequence[CurvePoint], about: dict[str, object]) -> dict[str, object]:
    """Return curves, and what they are of, as plain values."""
    return {"measured": about, "curves": [asdict(point) for point in points]}


def read_curves(path: Path) -> list[CurvePoint]:
    """Return the curves of a file of ``mbpam characterise``.

    Raises:
        ConfigError: the file is missing, is none of those, or a value in it cannot be.
    """
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["curves"]
        points = [CurvePoint(**row) for row in rows]
        finite = all(
            np.isfinite([float(p.pressure_kpa), float(p.mean), float(p.spread), float(p.noise)]).all() for p in points
        )
        whole = all(p.quantity in QUANTITIES and int(p.repeats) > 0 and p.spread >= 0.0 for p in points)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no file of mbpam characterise --json: {error}") from error
    if not (points and finite and whole):
        raise ConfigError(f"{path}: its curves are empty, or hold values that no rig measures")
    return points
