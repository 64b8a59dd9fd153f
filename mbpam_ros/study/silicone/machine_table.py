"""The table in a file of a testing machine: what stands above it, the names and units of its columns, its numbers.

Columns are separated by semicolons, tabs, commas, bars or blanks, decimals have a point or a comma, and over the table
stand particulars of the test, names, and often a row of units.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.errors import MbpamError

LARGEST_FILE_BYTES = 50_000_000

Array = NDArray[np.float64]

_PSI_MPA = 6.894757e-3
_STRESS_MPA = {"gpa": 1e3, "mpa": 1.0, "n/mm2": 1.0, "kpa": 1e-3, "pa": 1e-6, "n/m2": 1e-6, "psi": _PSI_MPA}
_STRESS_MPA |= {"ksi": 1e3 * _PSI_MPA, "bar": 0.1, "kgf/cm2": 0.0980665, "kg/cm2": 0.0980665}
_FORCE_N = {"n": 1.0, "kn": 1e3, "mn": 1e-3, "kgf": 9.80665, "gf": 9.80665e-3, "lbf": 4.448222}
LENGTH_MM = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "in": 25.4, "inch": 25.4}
AREA_MM2 = {"mm2": 1.0, "cm2": 100.0, "m2": 1e6}
_RATIO = {"1": 1.0, "-": 1.0, "mm/mm": 1.0, "m/m": 1.0, "in/in": 1.0, "%": 0.01, "percent": 0.01, "pct": 0.01}
_OTHERS = ("s", "sec", "min", "ms", "c", "°c")

_KINDS = {
    "stretch": (r"stretch|lambda|^λ", _RATIO),
    "true strain": (r"(true|log|hencky).*strain", _RATIO),
    "true stress": (r"(true|cauchy).*stress", _STRESS_MPA),
    "engineering strain": (r"strain|dehnung|elongation", _RATIO),
    "engineering stress": (r"stress|spannung", _STRESS_MPA),
    "force": (r"\bforce|\bload|kraft", _FORCE_N),
    "extension": (r"extension|displacement|elongation|crosshead|stroke|traverse", LENGTH_MM),
}
"""What a column may hold, by what its name looks like (first that fits), with its units."""


class TensileTestError(MbpamError, ValueError):
    """A file is no tensile test that can be used; the message says where, why, and what to do."""


@dataclass(frozen=True)
class MachineTable:
    """The numbers of a file with what stands above them.

    Args:
        source: name of the file.
        above: the cells of each row over the table.
        names: of the columns, with their units in brackets.
        numbers: shape (rows, columns), NaN where a cell is empty.
    """

    source: str
    above: list[list[str]]
    names: list[str]
    numbers: Array

    def error(self, message: str) -> TensileTestError:
        """Return an error that names the file."""
        return TensileTestError(f"{self.source}: {message}")


def read_table(path: Path, columns: str | None) -> MachineTable:
    """Read the longest table of a file.

    Args:
        path: of the file.
        columns: names of the columns, separated by commas, in place of those in the file; "-" for one to leave out.

    Raises:
        TensileTestError: the file cannot be read, or has no table, two of them, or one without names.
    """
    lines = _lines(path)
    rows = max((_split(lines, separator) for separator in (";", "\t", ",", "|", None)), key=_numeric_count)
    blocks = _blocks(rows)
    if not blocks:
        raise TensileTestError(
            f"{path.name}: no table: no row has two numbers or more (columns are separated by ; , | tab or blanks)"
        )
    start, end = max(blocks, key=lambda block: block[1] - block[0])
    for other_start, other_end in blocks:
        if (other_start, other_end) != (start, end) and other_end - other_start >= 3:
            raise TensileTestError(
                f"{path.name}: two tables, at lines {start + 1} and {other_start + 1}, or a row without numbers "
                "between them; put repeats into files of their own"
            )
    numbers = [[number_in(cell) for cell in row] for row in rows[start:end] if any(row)]
    width = max(map(len, numbers))
    filled = np.array([row + [np.nan] * (width - len(row)) for row in numbers])
    above = [row for row in rows[:start] if any(row)]
    names = [name.strip() for name in columns.split(",")] if columns else _names(path.name, above, width)
    if len(names) > width:
        raise TensileTestError(f"{path.name}: {len(names)} columns are named, the table has {width}")
    return MachineTable(path.name, above, names, filled)


def kind_of(name: str) -> tuple[str, float | None] | None:
    """Return what a column holds, by its name, and the factor to MPa, N, mm or a number (None: no unit is named).

    Returns:
        A kind such as "engineering strain", or None if it is nothing that tells a tensile test.
    """
    unit = bracketed_unit(name)
    plain = re.sub(r"[(\[].*", "", name.lower()) or name.lower()
    for kind, (pattern, units) in _KINDS.items():
        if not re.search(pattern, plain.replace("_", " ")):
            continue
        if unit is None:  # perhaps the last word, as in stress_mpa
            return kind, units.get(_plain_unit(re.split(r"[\s_,]", plain.strip())[-1]))
        if unit == "":
            return kind, None
        if unit in units:
            return kind, units[unit]
    return None


def bracketed_unit(name: str) -> str | None:
    """Return the unit in the brackets of a name, such as "mm2", None where there are none."""
    bracket = re.search(r"[(\[]([^)\]]*)[)\]]", name)
    return _plain_unit(bracket.group(1)) if bracket else None


def _lines(path: Path) -> list[str]:
    try:
        if path.stat().st_size > LARGEST_FILE_BYTES:
            raise TensileTestError(f"{path.name}: larger than {LARGEST_FILE_BYTES // 1_000_000} MB; is it a test?")
        raw = path.read_bytes()
    except OSError as error:
        raise TensileTestError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "latin-1")
    lines = text.replace("\x00", "").splitlines()
    if not any(line.strip() for line in lines):
        raise TensileTestError(f"{path.name}: empty")
    return lines


def _split(lines: list[str], separator: str | None) -> list[list[str]]:
    if separator is None:
        return [re.split(r"\s+", line.strip()) if line.strip() else [] for line in lines]
    rows = csv.reader(io.StringIO("\n".join(lines)), delimiter=separator)
    try:
        return [[cell.strip() for cell in row] for row in rows]
    except csv.Error:
        return []


def number_in(cell: str) -> float:
    """Return the number in a cell, NaN for an empty one.

    Raises:
        ValueError: the cell holds anything else.
    """
    if not cell:
        return np.nan
    if re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell):
        cell = cell.replace(",", ".")
    value = float(cell)
    if not np.isfinite(value):
        raise ValueError(cell)
    return value


def _is_numeric(row: list[str]) -> bool:
    """Whether a row has two numbers or more, and nothing else."""
    try:
        return sum(not np.isnan(number_in(cell)) for cell in row) >= 2
    except ValueError:
        return False


def _numeric_count(rows: list[list[str]]) -> tuple[int, int]:
    numeric = [row for row in rows if _is_numeric(row)]
    return len(numeric), sum(map(len, numeric))


def _blocks(rows: list[list[str]]) -> list[tuple[int, int]]:
    """Return [start, end) of each run of numeric rows; blank rows do not end one."""
    blocks = []
    kept = [index for index, row in enumerate(rows) if any(row)]
    for numeric, run in itertools.groupby(kept, key=lambda index: _is_numeric(rows[index])):
        members = list(run)
        if numeric:
            blocks.append((members[0], members[-1] + 1))
    return blocks


def _names(source: str, above: list[list[str]], width: int) -> list[str]:
    """Return the names of the columns, with their units in brackets, from the rows over the table."""
    head = [row for row in above[-2:] if sum(map(bool, row)) >= 2]
    units: list[str] = []
    if head and all(_unit_of(cell) is not None for cell in head[-1] if cell):
        units = head.pop()
    if not head or len(head[-1]) > max(width, len(units)) + 2:
        raise TensileTestError(
            f"{source}: no names over the columns; give them, such as --columns 'engineering strain (%),engineering "
            "stress (MPa)'"
        )
    names = head[-1]
    if not units:
        return names[:width]
    padded = units + [""] * (len(names) - len(units))
    return [f"{name} ({unit.strip('()[]')})" if unit else name for name, unit in zip(names, padded, strict=False)]


def _plain_unit(text: str) -> str:
    return text.strip().lower().replace("²", "2").replace("^2", "2").replace("µ", "u").replace(" ", "")


def _unit_of(cell: str) -> str | None:
    """Return the plain unit if a cell holds one and nothing else."""
    unit = _plain_unit(cell.strip().strip("()[]"))
    return unit if unit in _OTHERS or any(unit in units for _, units in _KINDS.values()) else None
