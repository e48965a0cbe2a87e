"""Tables of instruments and controllers: titles and comments above, any separator, units, blank columns.

The table is the block of rows with numbers in a text; the last line above it with as many cells is its header, as a
comment or not. Lines and columns outside the table are reported with the reason.
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
_SAMPLE = 200  # rows for finding the separator


@dataclass(frozen=True)
class LeftOut:
    """An unused part of a file.

    Attributes:
        line: in the file; 0 for no single line.
        what: its content.
        why: the reason.
    """

    file: str
    line: int
    what: str
    why: str


@dataclass(frozen=True)
class _Heading:
    """Name of a column: as written, without its unit in lower case, and the unit or ""."""

    text: str
    key: str
    unit: str


@dataclass(frozen=True)
class LooseTable:
    """A block of rows in a text.

    Attributes:
        headings: of the columns, or None.
        rows: texts of the cells, as many in every row.
        lines: of the rows in the file.
        titles: other lines above the block, with their numbers.
        left_out: lines outside the block.
        separator: of the cells, in words.
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
        """Return a column's cells."""
        return tuple(row[column] for row in self.rows)

    def name(self, column: int) -> str:
        """Return the name of a column in error messages."""
        named = self.headings[column].text if self.headings is not None else ""
        return named or f"number {column + 1}"

    def is_blank(self, column: int) -> bool:
        """Check whether a column is empty."""
        return not any(self.texts(column))

    def numbers(self, column: int, *, empty: bool = True) -> Array:
        """Return a column ``(n,)`` as numbers, NaN if empty."""
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
        """Check whether a column has only numbers, and at least one."""
        cells = [cell for cell in self.texts(column) if cell]
        return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)

    @property
    def stated_unit(self) -> str:
        """Unit of length in a title, e.g. ``// Units: mm``; "" for none or several."""
        units = set()
        for _, text in self.titles:
            if "unit" in text.lower():
                words = re.findall(r"[A-Za-zµμ]+", text.lower())
                units |= {_UNITS[word] for word in words if _UNITS.get(word) in ("mm", "m", "in")}
        return units.pop() if len(units) == 1 else ""


def heading_of(text: str) -> _Heading:
    """Parse a column's name: ``X [mm]``, ``X (mm)``, ``X_mm``, ``X, mm`` and ``X mm`` are x in mm."""
    plain = text.strip().strip("\"'")
    for pattern in (r"^(.*?)\s*[\[({<]\s*([^\])}>]+?)\s*[\])}>]\s*$", r"^(.+?)[\s_,/.]+([^\s_,/.]+)$"):
        match = re.match(pattern, plain)
        if match and match[2].lower() in _UNITS and match[1].strip():
            return _Heading(plain, _key(match[1]), _UNITS[match[2].lower()])
    return _Heading(plain, _key(plain), "")


def _key(text: str) -> str:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    return " ".join(re.findall(r"[^\W_]+", spaced.lower()))


def read_loose(path: Path, least: int) -> LooseTable:
    """Find the block of rows with at least ``least`` numbers in a text."""
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
    """Return the separator of the cells and the number of cells, by most rows of numbers."""
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
    """Count the cells that are numbers; a decimal comma is valid unless commas separate cells."""
    return sum(bool(_NUMBER.fullmatch(cell)) and not (separator == "," and "," in cell) for cell in cells)


def _header(
    lines: Sequence[str], cells: Sequence[list[str]], separator: str, first: int, width: int, least: int
) -> tuple[tuple[_Heading, ...] | None, set[int]]:
    """Return the headings, and their lines: a header, and perhaps a line of units below it."""
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
    """Columns of the instrument's file, each by name or number; "" to recognize them.

    Attributes:
        name: of the point.
        target: point of the tool, if poses have several.
        x, y, z: coordinates.
        unit: of the coordinates and their uncertainties.
        sigma: uncertainties along x, y and z, or one of the whole position.
        time: of the measurement; a date may be in its own column.
        dates: order of day and month.
        u, v: place of a corner in a picture, pixels, instead of coordinates.
        corner, camera, board: of the corner.
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
    u: str = ""
    v: str = ""
    corner: str = ""
    camera: str = ""
    board: str = ""


@dataclass(frozen=True)
class JointColumns:
    """Columns of the controller's file.

    Attributes:
        name: of the pose.
        time: of the row; a date may be in its own column.
        joints: columns of the joints, in the robot's order.
        unit: of revolute joints.
    """

    name: str = ""
    time: str = ""
    date: str = ""
    dates: _Dates = None
    joints: tuple[str, ...] = ()
    unit: Literal["deg", "rad"] | None = None


@dataclass(frozen=True)
class _ColumnMap:
    """Map of the columns in both files."""

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
    """Return the column with this header or number from 1."""
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
