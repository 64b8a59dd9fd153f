"""Read the columns of a data table: one of ``config/data``, or a user's CSV as spreadsheets and machines save it.

The column names stand in the first line that holds all that are asked for; what is above it (comments, a description
of the test) and other columns are passed over. A number that could be meant in two ways is refused, never guessed.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import ConfigError, config_path

_SEPARATORS = {",": "comma", ";": "semicolon", "\t": "tab"}
_COMMENT = ("#", '"#')  # spreadsheets put a comment line that has commas in quotes
_SAVE_AS = "save it as CSV UTF-8"
_FOREIGN = {
    b"PK\x03\x04": "a workbook (.xlsx, .ods) or another zip file",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook (.xls)",
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
}
"""What a file that is no UTF-8 text begins with."""

_NUMBER = re.compile(r"[-+\u2212]?(?:[0-9]+(?:([.,])[0-9]*)?|([.,])[0-9]+)(?:[eE][-+\u2212]?[0-9]+)?")
_AS_PYTHON_WRITES = str.maketrans(",\u2212", ".-")  # a spreadsheet's minus is U+2212 in some languages
_MAYBE_THOUSANDS = re.compile(r"[-+\u2212]?[1-9][0-9]{0,2}[.,][0-9]{3}")
_NAMED_UNIT = re.compile(r"[(\[](.*)[)\]]$|_([^_]+)$")
_SPELLINGS = {
    "": ("mm/mm", "m/m"),
    "deg": ("\N{DEGREE SIGN}", "degree", "degrees"),
    "n": ("N",),
    "mn": ("mN",),
    "pa": ("Pa",),
    "kpa": ("kPa",),
    "mpa": ("MPa",),
    "pct": ("%",),
    "hz": ("Hz",),
}
"""How a units row may write the unit at the end of a column's name, besides as it stands there."""


class TableError(ConfigError):
    """A table is missing, is no table, or holds something that cannot be read without guessing."""


class _Refused(Exception):
    """What is wrong and where, without the file's name."""


class _Record(NamedTuple):
    """Cells of one row, without spaces around them, and the line it begins in."""

    line: int
    cells: list[str]


def read_table(name: str, *columns: str) -> NDArray[np.float64]:
    """Return the named columns of ``config/data/<name>``, shape (columns, rows), in the file's own units.

    Raises:
        ConfigError: there is no such file; TableError as :func:`read_columns`.
    """
    return read_columns(config_path(f"data/{name}"), *columns)


def read_columns(path: Path, *columns: str) -> NDArray[np.float64]:
    """Return the named columns of a CSV, shape (columns, rows), in the units of their names.

    The file is UTF-8, with comma, semicolon or tab between the cells. Names match whatever their case, but for a unit
    in brackets: (MPa) is not (mPa). Numbers have a decimal point, or a comma throughout. Lines that begin with #, rows
    without content and a row of units beneath the names are passed over.

    Raises:
        TableError: the file is missing, lacks or repeats a column, or holds something there that is not a finite
            number, could be meant in two ways, or has another unit than the name says; the message says in which
            line and column, and what to do.
    """
    return read_labelled_columns(path, (), *columns)[1]


def read_labelled_columns(
    path: Path, labels: Sequence[str], *columns: str
) -> tuple[list[tuple[str, ...]], NDArray[np.float64]]:
    """Return the text of the columns ``labels``, a tuple for each row, and the numbers as :func:`read_columns` does.

    Raises:
        TableError: as :func:`read_columns`, or a label is empty.
    """
    try:
        text = _text(path)
        separator, header = _header(text, (*labels, *columns))
        rows = _rows(text, separator, header)
        places = {column: _place(header, column) for column in (*labels, *columns)}
        rows = _without_units(rows, {column: places[column] for column in columns})
        if not rows:
            raise _Refused(f"line {header.line}: no rows beneath the column names, but for comments (#) and units")
        texts = [tuple(_label(row, label, places[label]) for label in labels) for row in rows]
        numbers = _numbers(rows, {column: places[column] for column in columns}, separator)
    except _Refused as refused:
        raise TableError(f"{path}: {refused}") from refused
    return texts, np.array([numbers[column] for column in columns]).reshape(len(columns), len(rows))


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise _Refused("no such file") from error
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise _Refused(f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    for start, kind in _FOREIGN.items():
        if content.startswith(start):
            raise _Refused(f"{kind}, not CSV: {_SAVE_AS}")
    if b"\0" in content:
        line = len(content[: content.index(b"\0") + 1].splitlines())
        raise _Refused(f"line {line}: a NUL byte, as UTF-16 text and binary files have: {_SAVE_AS}")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = len(error.object[: error.start + 1].splitlines())
        byte = error.object[error.start]
        raise _Refused(f"line {line}: byte 0x{byte:02x} is not UTF-8, but of an older encoding: {_SAVE_AS}") from error


def _records(text: str, separator: str) -> Iterator[_Record]:
    """Yield the rows that have content and are no comments."""
    row_begins = True

    def lines() -> Iterator[str]:
        nonlocal row_begins
        for line in io.StringIO(text, newline=None):
            comment = row_begins and line.lstrip().startswith(_COMMENT)
            row_begins = False  # until the reader says so: a cell in quotes may go on in the next line
            yield "\n" if comment else line

    reader = csv.reader(lines(), delimiter=separator, strict=True, skipinitialspace=True)
    line = 1
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells):
                yield _Record(line, cells)
            row_begins, line = True, reader.line_num + 1
    except csv.Error as error:
        longest = csv.field_size_limit()
        raise _Refused(f"line {line}: its quotes do not pair up, or a cell has over {longest} characters") from error


def _header(text: str, columns: Sequence[str]) -> tuple[str, _Record]:
    """Return the separator and the column names."""
    for find in (_named_row, _named_comment):
        found = {separator: record for separator in _SEPARATORS if (record := find(text, separator, columns))}
        if len(found) > 1 and any(len(record.cells) > 1 for record in found.values()):
            lines = ", ".join(f"{_SEPARATORS[key]} (line {record.line})" for key, record in found.items())
            raise _Refused(f"the column names can be read with more than one separator: {lines}; use one throughout")
        if found:
            return next(iter(found.items()))
    raise _why_no_header(text, columns)


def _named_row(text: str, separator: str, columns: Sequence[str]) -> _Record | None:
    try:
        rows = (row for row in _records(text, separator) if len(row.cells) >= len(columns))
        return next((row for row in rows if not _lacking(row, columns)), None)
    except _Refused:  # as quotes look with a wrong separator; with the right one _why_no_header says it
        return None


def _named_comment(text: str, separator: str, columns: Sequence[str]) -> _Record | None:
    """Return the column names of a comment line, where NumPy's ``savetxt`` puts them."""
    for line, content in enumerate(io.StringIO(text, newline=None), 1):
        if content.lstrip().startswith("#"):
            record = _Record(line, [cell.strip() for cell in content.lstrip("# ").split(separator)])
            if not _lacking(record, columns):
                return record
    return None


def _why_no_header(text: str, columns: Sequence[str]) -> _Refused:
    rows, fault = [], None
    for separator in _SEPARATORS:
        try:
            rows += [row for row in _records(text, separator) if any(cell.strip(",;") for cell in row.cells)]
        except _Refused as refused:
            fault = fault or refused
    nearest = min(rows, key=lambda row: (len(_lacking(row, columns)), row.line, -len(row.cells)), default=None)
    if nearest is None:
        return fault or _Refused("empty; expected a line of column names and rows of numbers")
    lacking = _lacking(nearest, columns)
    if fault and len(lacking) == len(columns):
        return fault
    if _all_numbers(nearest):
        return _Refused(
            f"line {nearest.line}: numbers, where column names are expected; put a line with {', '.join(columns)} above"
        )
    names = ", ".join(_short(cell) for cell in nearest.cells[:12]) + (", ..." if len(nearest.cells) > 12 else "")
    return _Refused(f"missing column {', '.join(lacking)}; line {nearest.line} has {names}; name it so there")


def _rows(text: str, separator: str, header: _Record) -> list[_Record]:
    """Return the rows beneath the header, each as long as it is."""
    rows = []
    for row in _records(text, separator):
        if row.line < header.line and _all_numbers(row):
            raise _Refused(f"line {row.line}: numbers above the column names in line {header.line}; move the names up")
        if row.line > header.line:
            _require_width(row, header, separator)
            rows.append(row)
    return rows


def _require_width(row: _Record, header: _Record, separator: str) -> None:
    surplus = row.cells[len(header.cells) :]
    # Among commas an empty cell too many may come of a decimal comma: 1,5, is 1.5 and an empty cell, or 1 and 5.
    if len(row.cells) < len(header.cells) or any(surplus) or (surplus and separator == ","):
        raise _Refused(
            f"line {row.line}: {len(row.cells)} cells, but line {header.line} has {len(header.cells)}; "
            f"give each row as many, separated by {_SEPARATORS[separator]}, and write decimals with a point"
        )


def _place(header: _Record, column: str) -> int:
    places = [place for place, name in enumerate(header.cells) if _key(name) == _key(column)]
    if len(places) > 1:
        cells = " and ".join(str(place + 1) for place in places)
        raise _Refused(
            f"line {header.line}: column {column} stands {len(places)} times (cells {cells}); "
            f"remove or rename all but one"
        )
    return places[0]


def _without_units(rows: list[_Record], places: dict[str, int]) -> list[_Record]:
    """Return the rows without a first one that holds the units of the columns and no number."""
    if not rows:
        return rows
    units = {column: rows[0].cells[place].strip("()[]") for column, place in places.items()}
    told = {column: unit for column, unit in units.items() if unit not in ("", "-")}
    if not told or any(_NUMBER.fullmatch(unit) for unit in told.values()):
        return rows
    for column, unit in told.items():
        match = _NAMED_UNIT.search(column)
        named = (match[1] or match[2]) if match else ""
        if unit not in (named, *_SPELLINGS.get(named, ())):
            raise _Refused(
                f"line {rows[0].line}, column {column}: {_short(unit)} is neither a number nor the unit of that name "
                f"({named or 'none'}); convert the column, or remove the row"
            )
    return rows[1:]


def _label(row: _Record, column: str, place: int) -> str:
    if not row.cells[place]:
        raise _Refused(f"line {row.line}, column {column}: empty; expected a name")
    return row.cells[place]


def _numbers(rows: list[_Record], places: dict[str, int], separator: str) -> dict[str, list[float]]:
    """Return the numbers of each column, once it is plain what a comma or a point in them means."""
    numbers: dict[str, list[float]] = {column: [] for column in places}
    first: dict[str, tuple[str, str]] = {}  # where each decimal mark stands first, and in what
    plain = False
    for row in rows:
        for column, place in places.items():
            cell, where = row.cells[place], f"line {row.line}, column {column}"
            number, mark = _number(cell, where)
            numbers[column].append(number)
            if mark:
                first.setdefault(mark, (where, cell))
                plain = plain or not _MAYBE_THOUSANDS.fullmatch(cell)
    _require_one_mark(first)
    english = separator == "," and "." in first  # a comma that separates cells marks no decimals
    if first and not plain and not english:
        where, cell = next(iter(first.values()))
        raise _Refused(
            f"{where}: {_short(cell)} may have decimals or thousands, and no other number tells; "
            f"separate cells by comma and write decimals with a point, thousands without"
        )
    return numbers


def _number(cell: str, where: str) -> tuple[float, str]:
    """Return a number and its decimal mark, empty if it has none."""
    match = _NUMBER.fullmatch(cell)
    if match is None:
        found = f"{_short(cell)} is not a plain number" if cell else "empty"
        raise _Refused(f"{where}: {found}; expected one like 1234.5, without unit or thousands separator")
    number = float(cell.translate(_AS_PYTHON_WRITES))
    if not math.isfinite(number):
        raise _Refused(f"{where}: {_short(cell)} is too large; expected a finite number")
    return number, match[1] or match[2] or ""


def _require_one_mark(first: dict[str, tuple[str, str]]) -> None:
    if len(first) > 1:
        (before, one), (where, other) = first.values()
        raise _Refused(
            f"{where}: {_short(other)}, but {_short(one)} in {before}; write decimals with a point throughout, "
            f"and thousands without separator"
        )


def _lacking(record: _Record, columns: Iterable[str]) -> list[str]:
    names = {_key(cell) for cell in record.cells}
    return [column for column in columns if _key(column) not in names]


def _key(name: str) -> str:
    """Return a column's name with single spaces and in small letters, but for the unit in brackets."""
    name = " ".join(name.split())
    start = min((at for bracket in "([" if (at := name.find(bracket)) >= 0), default=len(name))
    return name[:start].casefold() + name[start:]


def _all_numbers(record: _Record) -> bool:
    return all(_NUMBER.fullmatch(cell) for cell in record.cells if cell)


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
