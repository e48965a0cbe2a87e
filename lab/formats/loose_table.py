"""Tables as instruments and controllers write them: titles and comments above, any separator, units, blank columns.

What a measuring program exports is a block of rows with numbers, somewhere in a text. The block is found by its
numbers; the last line above it that has as many cells is its header, whether or not it is marked as a comment. Nothing
is dropped in silence: lines and columns that are no part of the table are listed with the reason.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.limits import COLUMNS, LINE, NUMBER_SIZE, ROWS, TABLE_BYTES
from lab.core.se3 import Array
from lab.formats.structured import read_bytes, read_toml, structured

__all__ = [
    "JointColumns",
    "LeftOut",
    "LooseTable",
    "PointColumns",
    "column_named",
    "heading_of",
    "read_column_map",
    "read_loose",
]

_SEPARATORS = ("\t", ";", ",", " ")
_NAMED = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
_COMMENT = re.compile(r"\s*(//+|#+|%+|!+|\*+)\s?")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_UNITS = {
    "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "in": "in", "inch": "in", "inches": "in", "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "s": "s", "sec": "s", "ms": "ms", "c": "C", "°c": "C", "degc": "C", "f": "F", "°f": "F", "degf": "F", "k": "K",
    "hpa": "hPa", "mbar": "hPa", "kpa": "kPa", "pa": "Pa", "mmhg": "mmHg", "%": "%", "%rh": "%",
}  # fmt: skip
_SAMPLE = 200  # rows by which a separator is told


@dataclass(frozen=True)
class LeftOut:
    """Something of a file that was not used.

    Attributes:
        file: whose it is.
        line: where it stands, as an editor counts; 0 for what is no single line.
        what: it is.
        why: it was left out.
    """

    file: str
    line: int
    what: str
    why: str


@dataclass(frozen=True)
class _Heading:
    """A column's name: as it is written, without its unit in plain words, and the unit ("" where it has none)."""

    text: str
    key: str
    unit: str


@dataclass(frozen=True)
class LooseTable:
    """A block of rows that was found in a text.

    Attributes:
        path: of the file.
        headings: of the columns; None where the block has no header.
        rows: texts of the cells, every row of the same number of them.
        lines: of the rows, as an editor counts them.
        titles: lines above the block that are no header, with their numbers.
        left_out: what is no part of the block.
        separator: of the cells, in a word.
    """

    path: Path
    headings: tuple[_Heading, ...] | None
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    titles: tuple[tuple[int, str], ...]
    left_out: tuple[LeftOut, ...]
    separator: str

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.rows[0])

    def texts(self, column: int) -> tuple[str, ...]:
        """A column's cells."""
        return tuple(row[column] for row in self.rows)

    def name(self, column: int) -> str:
        """Return the name of a column in error messages."""
        named = self.headings[column].text if self.headings is not None else ""
        return named or f"number {column + 1}"

    def is_blank(self, column: int) -> bool:
        """Decide whether a column is empty."""
        return not any(self.texts(column))

    def numbers(self, column: int, *, empty: bool = True) -> Array:
        """A column ``(n,)`` as numbers, NaN where empty."""
        cells = self.texts(column)
        found = np.full(len(cells), np.nan)
        marks: dict[str, int] = {}
        for i, cell in enumerate(cells):
            if not cell and empty:
                continue
            if not _NUMBER.fullmatch(cell):
                raise LabError(
                    f"{self._where(i, column)}: '{cell}' is not a number; fix it, or name the right column by "
                    f"{option_name('columns')}"
                )
            for mark in {",", "."} & set(cell):
                marks.setdefault(mark, self.lines[i])
            if len(marks) > 1:
                text = f"written with '.' in line {marks['.']} and with ',' in line {marks[',']}"
                raise LabError(
                    f"{self._where(i, column)}: numbers are {text}; use one decimal mark and none for thousands"
                )
            found[i] = float(cell.replace(",", "."))
            if abs(found[i]) not in NUMBER_SIZE:
                raise LabError(f"{self._where(i, column)}: '{cell}' is too large; check the number and its unit")
        return found

    def _where(self, row: int, column: int) -> str:
        return f"{self.path}: line {self.lines[row]}, column {self.name(column)}"

    def is_numeric(self, column: int) -> bool:
        """Decide whether a column holds only numbers, and at least one."""
        cells = [cell for cell in self.texts(column) if cell]
        return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)

    @property
    def stated_unit(self) -> str:
        """The unit of length that a title says, e.g. ``// Units: mm``; "" where none or several do."""
        units = set()
        for _, text in self.titles:
            if "unit" in text.lower():
                words = re.findall(r"[A-Za-zµμ]+", text.lower())
                units |= {_UNITS[word] for word in words if _UNITS.get(word) in ("mm", "m", "in")}
        return units.pop() if len(units) == 1 else ""


def heading_of(text: str) -> _Heading:
    """A column's name taken apart: ``X [mm]``, ``X (mm)``, ``X_mm``, ``X, mm`` and ``X mm`` are x in mm."""
    plain = text.strip().strip("\"'")
    for pattern in (r"^(.*?)\s*[\[({<]\s*([^\])}>]+?)\s*[\])}>]\s*$", r"^(.+?)[\s_,/.]+([^\s_,/.]+)$"):
        match = re.match(pattern, plain)
        if match and match[2].lower() in _UNITS and match[1].strip():
            return _Heading(plain, _key(match[1]), _UNITS[match[2].lower()])
    return _Heading(plain, _key(plain), "")


def _key(text: str) -> str:
    """A name in plain small words."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return " ".join(re.findall(r"[^\W_]+", spaced.lower()))


def read_loose(path: Path, least: int) -> LooseTable:
    """Find the block of rows in a text.

    Args:
        path: of the file.
        least: how many numbers a row has at least.
    """
    lines = _lines(path)
    separator, width = _separator(path, lines, least)
    cells = [_cells(text, separator) for text in lines]
    is_row = [
        len(each) == width and _count(each, separator) >= least and not _COMMENT.match(text)
        for each, text in zip(cells, lines, strict=True)
    ]
    first = is_row.index(True)
    headings, used = _header(lines, cells, separator, first, width, least)
    left, titles = [], []
    for i, text in enumerate(lines):
        if is_row[i] or i in used or not text.strip(" \t;,"):
            continue
        if i < first:
            titles.append((i + 1, _COMMENT.sub("", text, count=1).strip()))
        why = "above the table" if i < first else f"{len(cells[i])} cells, where the table has {width}"
        if i > first and _COMMENT.match(text):
            why = "a comment"
        elif i > first and len(cells[i]) == width:
            why = "fewer numbers than the columns"
        left.append(LeftOut(str(path), i + 1, text.strip()[:60], why))
    rows = tuple(tuple(cells[i]) for i in range(len(lines)) if is_row[i])
    numbers = tuple(i + 1 for i in range(len(lines)) if is_row[i])
    return LooseTable(path, headings, rows, numbers, tuple(titles), tuple(left), _NAMED[separator])


def _lines(path: Path) -> list[str]:
    """The lines of a text, in the encodings that measuring programs write."""
    content = read_bytes(path, TABLE_BYTES)
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", errors="replace")
    if "\0" in text:
        raise LabError(f"{path}: is not a text file; export the points as text")
    if not text.strip():
        raise LabError(f"{path}: the file is empty; export it again")
    ROWS(path, text.count("\n") - 1)
    lines = text.splitlines()
    LINE(path, max(lines, key=len))
    return lines


def _separator(path: Path, lines: Sequence[str], least: int) -> tuple[str, int]:
    """Return the separator of the cells and the number of cells per row, as in most rows of numbers."""
    best: tuple[int, str, int] | None = None
    shown = [text for text in lines if text.strip() and not _COMMENT.match(text)]
    step = max(1, len(shown) // _SAMPLE)
    for separator in _SEPARATORS:
        split = (_cells(text, separator) for text in shown[::step])
        widths = Counter(len(cells) for cells in split if _count(cells, separator) >= least)
        if widths:
            width, count = widths.most_common(1)[0]
            best = max(best or (0, "", 0), (count, separator, width), key=lambda each: each[0])
    if best is None:
        raise LabError(
            f"{path}: no line has {least} or more numbers, separated by tabs, semicolons, commas or spaces; export a "
            "table with a row for each"
        )
    COLUMNS(path, best[2])
    return best[1], best[2]


def _cells(text: str, separator: str) -> list[str]:
    text = text.strip(" \r") if separator != " " else " ".join(text.split())
    if '"' not in text:
        return [cell.strip() for cell in text.split(separator)]
    return [cell.strip() for cell in next(csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True))]


def _count(cells: Sequence[str], separator: str) -> int:
    """Count the cells that are numbers; a decimal comma counts only if commas do not separate."""
    return sum(bool(_NUMBER.fullmatch(cell)) and not (separator == "," and "," in cell) for cell in cells)


def _header(
    lines: Sequence[str], cells: Sequence[list[str]], separator: str, first: int, width: int, least: int
) -> tuple[tuple[_Heading, ...] | None, set[int]]:
    """The headings, and the lines that they stand in: a header, and perhaps a line of units below it."""
    used: set[int] = set()
    units: list[str] | None = None
    for i in range(first - 1, -1, -1):
        if not lines[i].strip(" \t;,"):
            continue
        marked = _COMMENT.match(lines[i])
        found = _cells(lines[i][marked.end() :], separator) if marked else cells[i]
        if len(found) != width and separator == " " and "," in lines[i]:
            found = _cells(lines[i][marked.end() if marked else 0 :], ",")
        if len(found) != width or _count(found, separator) >= least:
            if not used:
                return None, used
            break
        stripped = [cell.strip("[](){}").lower() for cell in found]
        if units is None and not used and any(stripped) and all(not c or c in (*_UNITS, "-") for c in stripped):
            units, used = found, {i}
            continue
        used.add(i)
        headings = [heading_of(cell) for cell in found]
        if units is not None:
            headings = [
                _Heading(h.text, h.key, h.unit or _UNITS.get(unit.strip("[](){}").lower(), ""))
                for h, unit in zip(headings, units, strict=True)
            ]
        return tuple(headings), used
    return None, set()


_Dates = Literal["dmy", "mdy"] | None


@dataclass(frozen=True)
class PointColumns:
    """Columns of the instrument's file, each by its name or by its number as a text; "" for those that are found.

    Attributes:
        name: of the point.
        target: which of the tool's points it is, where poses have several.
        x, y, z: its coordinates.
        unit: of the coordinates and their uncertainties.
        sigma: uncertainties along x, y and z, or one of the whole position.
        time: when it was measured; a date may stand in a column of its own.
        dates: whether dates begin with the day or the month.
    """

    name: str = ""
    target: str = ""
    x: str = ""
    y: str = ""
    z: str = ""
    unit: Literal["mm", "m", "in", "um"] | None = None
    sigma: tuple[str, ...] = ()
    time: str = ""
    date: str = ""
    dates: _Dates = None
    temperature: str = ""
    pressure: str = ""
    humidity: str = ""


@dataclass(frozen=True)
class JointColumns:
    """Columns of the controller's file.

    Attributes:
        name: of the pose.
        time: when the row was written; a date may stand in a column of its own.
        joints: the columns of the joints, in the robot's order.
        unit: of the joints that turn.
    """

    name: str = ""
    time: str = ""
    date: str = ""
    dates: _Dates = None
    joints: tuple[str, ...] = ()
    unit: Literal["deg", "rad"] | None = None


@dataclass(frozen=True)
class _ColumnMap:
    """Meaning of the columns, in both files."""

    points: PointColumns = field(default_factory=PointColumns)
    joints: JointColumns = field(default_factory=JointColumns)


def read_column_map(path: Path | None) -> _ColumnMap:
    """Read a map of columns; an empty one without a file."""
    if path is None:
        return _ColumnMap()
    found = structured(path, _ColumnMap, read_toml(path))
    if len(found.points.sigma) not in (0, 1, 3):
        raise LabError(f"{path}: points.sigma has {len(found.points.sigma)} columns; give those of x, y and z, or one")
    given = [each for each in (found.points.x, found.points.y, found.points.z) if each]
    if len(given) not in (0, 3):
        raise LabError(f"{path}: points has some of x, y and z; give all three or none")
    return found


def column_named(table: LooseTable, wanted: str) -> int:
    """The column that a map names, by its header or its number from 1."""
    headings = table.headings or ()
    same = [i for i, each in enumerate(headings) if each.text == wanted]
    same = same or [i for i, each in enumerate(headings) if each.key == heading_of(wanted).key]
    if len(same) == 1:
        return same[0]
    if same:
        raise LabError(f"{table.path}: {len(same)} columns are called '{wanted}'; give the number of the right one")
    if wanted.isdecimal() and 1 <= int(wanted) <= table.width:
        return int(wanted) - 1
    known = ", ".join(each.text for each in headings if each.text) or "no column has a name"
    raise LabError(f"{table.path}: no column '{wanted}' ({known}); give a name, or a number from 1 to {table.width}")
