"""Read a tensile test into engineering strain and stress, from whichever columns its file has.

Columns may hold engineering strain and stress, true strain and stress, or force and extension; the sizes of the
specimen are then taken from the block above the table, or given. What no reader can know is not guessed in silence:
every assumption becomes a note, and columns that contradict each other are refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.silicone.machine_table import (
    AREA_MM2,
    LENGTH_MM,
    MachineTable,
    TensileTestError,
    bracketed_unit,
    kind_of,
    number_in,
    read_table,
)
from mbpam_ros.study.silicone.tensile_test import FEWEST_ROWS, TensileTest, first_pull, plausible

Array = NDArray[np.float64]

_PAIRS = (
    ("engineering strain", "engineering stress"),
    ("stretch", "engineering stress"),
    ("true strain", "true stress"),
    ("extension", "force"),
    ("engineering strain", "true stress"),
    ("true strain", "engineering stress"),
    ("engineering strain", "force"),
)
"""Columns that tell a test, the most direct first."""


@dataclass(frozen=True)
class Specimen:
    """Sizes of the strip between the marks [mm]; None where not known.

    Args:
        width_mm, thickness_mm: of its section before the test.
        length_mm: gauge length.
    """

    width_mm: float | None = None
    thickness_mm: float | None = None
    length_mm: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not 0.01 <= value <= 1000.0:
                raise TensileTestError(f"{name} of the specimen must be 0.01 to 1000, found {value:g}")

    def filled(self, other: Specimen) -> Specimen:
        """Return this specimen with what is not known taken from the other."""
        return replace(other, **{name: value for name, value in vars(self).items() if value is not None})


def read_tensile_test(path: Path, specimen: Specimen | None = None, columns: str | None = None) -> TensileTest:
    """Read one test.

    Args:
        path: of the file.
        specimen: sizes that go before those in the file.
        columns: names of the columns, separated by commas, in place of those in the file; "-" for one to leave out.

    Raises:
        TensileTestError: the file cannot be read, has no table, no columns that tell a test, or figures that silicone
            cannot have.
    """
    table = read_table(path, columns)
    given = (specimen or Specimen()).filled(_specimen_above(table))
    strain, stress_mpa, notes = _strain_and_stress(table, given)
    test = first_pull(TensileTest(path.name, strain, stress_mpa, tuple(notes)))
    return plausible(test)


def _specimen_above(table: MachineTable) -> Specimen:
    """Return the sizes that the block over the table tells, and check its section against them."""
    found: dict[str, float] = {}
    for row in table.above:
        if len(row) < 2 or not re.search(r"specimen|sample|gauge|probe|width|thickness|section|length", row[0].lower()):
            continue
        try:
            value = number_in(row[1])
        except ValueError:
            continue
        unit = bracketed_unit(row[0]) or "mm"
        for name in ("thickness", "width", "length"):
            if name in row[0].lower() and unit in LENGTH_MM and np.isfinite(value):
                found[f"{name}_mm"] = value * LENGTH_MM[unit]
        if "section" in row[0].lower() and unit in AREA_MM2 and np.isfinite(value):
            found["section_mm2"] = value * AREA_MM2[unit]
    section = found.pop("section_mm2", None)
    specimen = Specimen(**found)
    if section and specimen.width_mm and specimen.thickness_mm:
        sides = specimen.width_mm * specimen.thickness_mm
        if not 0.9 < section / sides < 1.1:
            raise table.error(
                f"its section of {section:g} mm2 is not width x thickness, {sides:g} mm2; which of them is right?"
            )
    return specimen


def _strain_and_stress(table: MachineTable, specimen: Specimen) -> tuple[Array, Array, list[str]]:
    notes: list[str] = []
    found: dict[str, tuple[int, float | None]] = {}
    for index, name in enumerate(table.names):
        recognised = kind_of(name)
        if recognised is None:
            continue
        kind, factor = recognised
        if kind in found:
            raise table.error(
                f"columns {found[kind][0] + 1} and {index + 1} both look like {kind}; name them by --columns, with - "
                "for those to leave out"
            )
        found[kind] = (index, factor)
    pair = next((pair for pair in _PAIRS if set(pair) <= set(found)), None)
    if pair is None:
        seen = ", ".join(f"{name or '(no name)'}" for name in table.names)
        raise table.error(
            f"no columns that tell a tensile test among: {seen}; strain and stress (engineering or true) or extension "
            "and force are needed; name them by --columns"
        )
    complete = np.isfinite(table.numbers[:, [found[kind][0] for kind in pair]]).all(axis=1)
    if complete.sum() < FEWEST_ROWS:
        raise table.error(f"too short: {int(complete.sum())} rows have both {pair[0]} and {pair[1]}")
    if not complete.all():
        notes.append(f"{int((~complete).sum())} rows with empty cells are left out")
    values = {kind: table.numbers[complete, index] for kind, (index, _) in found.items()}
    for kind in pair:
        factor = found[kind][1]
        values[kind] = values[kind] * (_assumed_factor(kind, values[kind], notes) if factor is None else factor)
    strain = _engineering_strain(table, pair[0], values[pair[0]], specimen)
    stress = _engineering_stress(table, pair[1], values[pair[1]], strain, specimen)
    _agree(table, pair, found, values, strain, stress)
    notes.insert(0, f"{pair[0]} and {pair[1]}, {stress.size} points")
    return strain, stress, notes


def _assumed_factor(kind: str, values: Array, notes: list[str]) -> float:
    if kind in ("engineering strain", "true strain", "stretch"):
        if values.max() > (3.5 if kind == "true strain" else 20.0):
            notes.append(f"no unit of the {kind}: taken as %, since it goes to {values.max():.4g}")
            return 0.01
        notes.append(f"no unit of the {kind}: taken as a number, not %, since it goes to {values.max():.4g}")
        return 1.0
    unit = {"force": "N", "extension": "mm"}.get(kind, "MPa")
    notes.append(f"no unit of the {kind}: taken as {unit}")
    return 1.0


def _engineering_strain(table: MachineTable, kind: str, values: Array, specimen: Specimen) -> Array:
    if kind == "true strain":
        return np.expm1(np.clip(values, -50.0, 50.0))
    if kind == "stretch":
        return values - 1.0
    if kind == "extension":
        if specimen.length_mm is None:
            raise table.error("strain from an extension needs the gauge length; give --length-mm")
        return values / specimen.length_mm
    return values


def _engineering_stress(table: MachineTable, kind: str, values: Array, strain: Array, specimen: Specimen) -> Array:
    if kind == "true stress":
        return values / (1.0 + strain)
    if kind == "force":
        if specimen.width_mm is None or specimen.thickness_mm is None:
            raise table.error("stress from a force needs the section; give --width-mm and --thickness-mm")
        return values / (specimen.width_mm * specimen.thickness_mm)
    return values


def _agree(
    table: MachineTable,
    pair: tuple[str, str],
    found: dict[str, tuple[int, float | None]],
    values: dict[str, Array],
    strain: Array,
    stress: Array,
) -> None:
    """Refuse a file whose further columns tell another test than the pair that was taken."""
    expected = {
        "true strain": np.log1p(np.maximum(strain, -0.9)),
        "true stress": stress * (1.0 + strain),
        "engineering stress": stress,
    }
    for kind, (_, factor) in found.items():
        if kind in pair or kind not in expected:
            continue
        given = values[kind] * (1.0 if factor is None else factor)
        # where it is largest: small figures are rounded and have noise
        known = np.isfinite(given) & (np.abs(expected[kind]) > 0.3 * np.abs(expected[kind]).max())
        if not known.any():
            continue
        ratio = float(np.median(given[known] / expected[kind][known]))
        if not 0.9 < ratio < 1.1:
            raise table.error(
                f"its {kind} is {ratio:.3g} times what {pair[0]} and {pair[1]} make it; a unit or a column is wrong"
            )
