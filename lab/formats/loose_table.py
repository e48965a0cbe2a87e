"""Tables of instruments and controllers: titles and comments above, any separator, units, blank columns.

The table is the block of rows with numbers in a text; the last line above it with as many cells is its header, as a
comment or not. Lines and columns outside the table are reported with the reason.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
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
    "heading_of",
    "read_column_map",
    "read_loose",
]

_SEPARATORS = ("\t", ";", ",", " ")
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
    """

    path: Path
    headings: tuple[_Heading, ...] | None
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    titles: tuple[tuple[int, str], ...]
    left_out: tuple[LeftOut, ...]

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

    def unit(self, column: int) -> str:
        """Return the unit that a column's heading states, "" for none."""
        return "" if self.headings is None else self.headings[column].unit

    @property
    def named(self) -> str:
        """Names of the columns, for error messages."""
        return ", ".join(each.text for each in self.headings or () if each.text)

    def column(self, wanted: str) -> int:
        """Return the column with this header or number from 1.

        Raises:
            LabError: none has it, or several have.
        """
        key = heading_of(wanted).key
        same = self._headed(lambda each: each.text == wanted) or self._headed(lambda each: each.key == key)
        if len(same) > 1:
            raise LabError(f"{self.path}: {len(same)} columns are called '{wanted}'; give the number of the right one")
        if same:
            return same[0]
        if wanted.isdecimal() and 1 <= int(wanted) <= self.width:
            return int(wanted) - 1
        named = self.named or "no column has a name"
        raise LabError(f"{self.path}: no column '{wanted}' ({named}); give a name, or a number from 1 to {self.width}")

    def _headed(self, by: Callable[[_Heading], bool]) -> list[int]:
        return [i for i, each in enumerate(self.headings or ()) if by(each)]

    def find(self, what: str, keys: Iterable[str], wanted: str = "") -> int | None:
        """Return the column that a map of columns wants, else the one of a key, in order of preference; else None.

        Args:
            what: its meaning, for error messages.
            keys: of headings.

        Raises:
            LabError: several columns have the key, or none is as wanted.
        """
        if wanted:
            return self.column(wanted)
        for key in keys:
            called = self._headed(lambda each, key=key: each.key == key)  # type: ignore[misc]
            same = [i for i in called if not self.is_blank(i)] or called
            if len(same) > 1:
                raise LabError(
                    f"{self.path}: {len(same)} columns may be {what} ({self.name(same[0])}); "
                    f"give its number in the {option_name('columns')} file"
                )
            if same:
                return same[0]
        return None

    def missing(self, what: str) -> LabError:
        """Return the error for a column that was not found."""
        return LabError(
            f"{self.path}: no column is {what} ({self.named}); name it in the {option_name('columns')} file"
        )

    def wrong(self, row: int, column: int, what: str) -> LabError:
        """Return an error about a cell."""
        return LabError(f"{self.where(row, column)}: {what}")

    def where(self, row: int, column: int) -> str:
        """Return the location of a cell in error messages."""
        return f"{self.path}: line {self.lines[row]}, column {self.name(column)}"

    def numbers(self, column: int, *, empty: bool = True) -> Array:
        """Return a column ``(n,)`` as numbers, NaN if empty."""
        cells = self.texts(column)
        values = np.full(len(cells), np.nan)
        marks: dict[str, int] = {}
        for i, cell in enumerate(cells):
            if not cell and empty:
                continue
            if not _NUMBER.fullmatch(cell):
                advice = f"fix it, or name the right column by {option_name('columns')}"
                raise self.wrong(i, column, f"'{cell}' is not a number; {advice}")
            for mark in {",", "."} & set(cell):
                marks.setdefault(mark, self.lines[i])
            if len(marks) > 1:
                text = f"written with '.' in line {marks['.']} and with ',' in line {marks[',']}"
                raise self.wrong(i, column, f"numbers are {text}; use one decimal mark and none for thousands")
            values[i] = float(cell.replace(",", "."))
            if abs(values[i]) not in NUMBER_SIZE:
                raise self.wrong(i, column, f"'{cell}' is too large; check the number and its unit")
        return values

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


@dataclass(frozen=True)
class _Line:
    """A line of a text.

    Attributes:
        number: from 1.
        is_row: whether it is a row of the table.
    """

    number: int
    text: str
    cells: list[str]
    is_row: bool

    @property
    def is_blank(self) -> bool:
        return not self.text.strip(" \t;,")


def read_loose(path: Path, least: int) -> LooseTable:
    """Find the block of rows with at least ``least`` numbers in a text."""
    texts = _lines(path)
    separator, width = _separator(path, texts, least)
    lines = [_line(number, text, separator, width, least) for number, text in enumerate(texts, start=1)]
    rows = [line for line in lines if line.is_row]
    above, below = lines[: rows[0].number - 1], lines[rows[0].number :]
    headings, used = _header(above, separator, width, least)
    titles = [line for line in above if line.number not in used and not line.is_blank]
    return LooseTable(
        path,
        headings,
        tuple(tuple(line.cells) for line in rows),
        tuple(line.number for line in rows),
        tuple((line.number, _COMMENT.sub("", line.text, count=1).strip()) for line in titles),
        _left_out(path, [*titles, *below], width, rows[0]),
    )


def _left_out(path: Path, lines: Sequence[_Line], width: int, first: _Line) -> tuple[LeftOut, ...]:
    """Return the lines that are neither blank nor rows of the table that begins with ``first``."""
    return tuple(
        LeftOut(str(path), line.number, line.text.strip()[:60], _reason(line, width, first))
        for line in lines
        if not (line.is_row or line.is_blank)
    )


def _line(number: int, text: str, separator: str, width: int, least: int) -> _Line:
    cells = _cells(text, separator)
    return _Line(
        number, text, cells, len(cells) == width and _count(cells, separator) >= least and not _COMMENT.match(text)
    )


def _reason(line: _Line, width: int, first: _Line) -> str:
    """Return why a line is no row of the table that begins with a row."""
    if line.number < first.number:
        return "above the table"
    if _COMMENT.match(line.text):
        return "a comment"
    if len(line.cells) == width:
        return "fewer numbers than the columns"
    return f"{len(line.cells)} cells, where the table has {width}"


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
    shown = [text for text in lines if text.strip() and not _COMMENT.match(text)]
    sample = shown[:: max(1, len(shown) // _SAMPLE)]
    most, best, cells_in_a_row = 0, "", 0
    for separator in _SEPARATORS:
        width, count = _common_width(sample, separator, least)
        if count > most:
            most, best, cells_in_a_row = count, separator, width
    if not most:
        raise LabError(
            f"{path}: no line has {least} or more numbers, separated by tabs, semicolons, commas or spaces; export a "
            "table with a row for each"
        )
    COLUMNS(path, cells_in_a_row)
    return best, cells_in_a_row


def _common_width(lines: Sequence[str], separator: str, least: int) -> tuple[int, int]:
    """Return the commonest number of cells of lines with enough numbers, and how many lines have it."""
    split = (_cells(text, separator) for text in lines)
    widths = Counter(len(cells) for cells in split if _count(cells, separator) >= least)
    return (widths.most_common(1) or [(0, 0)])[0]


def _cells(text: str, separator: str) -> list[str]:
    text = text.strip(" \r") if separator != " " else " ".join(text.split())
    if '"' not in text:
        return [cell.strip() for cell in text.split(separator)]
    return [cell.strip() for cell in next(csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True))]


def _count(cells: Sequence[str], separator: str) -> int:
    """Count the cells that are numbers; a decimal comma is valid unless commas separate cells."""
    return sum(bool(_NUMBER.fullmatch(cell)) and not (separator == "," and "," in cell) for cell in cells)


def _header(
    above: Sequence[_Line], separator: str, width: int, least: int
) -> tuple[tuple[_Heading, ...] | None, set[int]]:
    """Return the headings, and the numbers of their lines: a header, and perhaps a line of units below it."""
    units: list[str] = []
    used: set[int] = set()
    for line in reversed(above):
        if line.is_blank:
            continue
        cells = _heading_cells(line, separator, width)
        if len(cells) != width or _count(cells, separator) >= least:
            break
        used.add(line.number)
        if not units and _are_units(cells):
            units = cells
            continue
        return _with_units([heading_of(cell) for cell in cells], units), used
    return None, set()


def _heading_cells(line: _Line, separator: str, width: int) -> list[str]:
    """Return the cells of a header, which may be a comment, and separated by commas above rows with spaces."""
    marked = _COMMENT.match(line.text)
    text = line.text[marked.end() :] if marked else line.text
    cells = _cells(text, separator)
    return _cells(text, ",") if len(cells) != width and separator == " " and "," in text else cells


def _unit_key(cell: str) -> str:
    return cell.strip("[](){}").lower()


def _are_units(cells: Sequence[str]) -> bool:
    keys = [_unit_key(cell) for cell in cells]
    return any(keys) and all(not key or key == "-" or key in _UNITS for key in keys)


def _with_units(headings: list[_Heading], units: Sequence[str]) -> tuple[_Heading, ...]:
    below = [_UNITS.get(_unit_key(unit), "") for unit in units] or [""] * len(headings)
    return tuple(replace(head, unit=head.unit or unit) for head, unit in zip(headings, below, strict=True))


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
    columns = structured(path, _ColumnMap, read_toml(path))
    if len(columns.points.sigma) not in (0, 1, 3):
        raise LabError(
            f"{path}: points.sigma has {len(columns.points.sigma)} columns; give those of x, y and z, or one"
        )
    coordinates = [each for each in (columns.points.x, columns.points.y, columns.points.z) if each]
    if len(coordinates) not in (0, 3):
        raise LabError(f"{path}: points has some of x, y and z; give all three or none")
    return columns
