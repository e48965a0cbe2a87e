"""CSV files and columns in memory as texts, with line and column of every cell for error messages.

Numbers are read as decimals and scaled exactly. Unread columns are tracked.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import COLUMNS, LINE, NUMBER_SIZE, ROWS, TABLE_BYTES, Limit
from lab.core.se3 import Array
from lab.formats.structured import read_text

__all__ = ["ColumnsInMemory", "CsvTable", "name_cell", "text_cell", "write_columns"]

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_PLAIN = re.compile(r"[0-9eE+\-.\n]+", re.ASCII)
_BLOCK = 10_000  # rows at a time as lists of cells

_FORMULA = re.compile(r"'*[=+\-@\t\r]")  # beginnings of a formula in a spreadsheet, or of a marked text
_MARK = "'"
_NAMES = ("id", "item", "robot")  # columns of names, in which +1 is no number


def text_cell(text: str) -> str:
    """Return a text as a cell; one that looks like a formula begins with an apostrophe, which ``CsvTable`` removes."""
    return _MARK + text if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def name_cell(text: str) -> str:
    """Return a name as a cell, as ``text_cell``, +1 with an apostrophe, too."""
    return _MARK + text if _FORMULA.match(text) else text


def write_columns(path: Path, columns: Mapping[str, Sequence[Any] | Array]) -> None:
    """Write columns of texts and numbers, with every digit; arrays of numbers are fastest."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        count = len(next(iter(columns.values()), ()))
        assert all(len(values) == count for values in columns.values())
        for first in range(0, count, _BLOCK):
            cells = [_cells(name, values[first : first + _BLOCK]) for name, values in columns.items()]
            writer.writerows(zip(*cells, strict=True))


def _cells(column: str, values: Sequence[Any] | Array) -> list[str]:
    if isinstance(values, np.ndarray):
        return list(map(repr, values.astype(np.float64).tolist()))
    cell = name_cell if column in _NAMES else text_cell
    return [cell(value) if isinstance(value, str) else repr(float(value)) for value in values]


@dataclass(frozen=True)
class ColumnsInMemory:
    """Columns of texts and numbers, which ``CsvTable`` reads as those of a file.

    Attributes:
        source: the table's name in error messages.
        columns: by name, of one length; None and NaN are empty cells.
    """

    source: str
    columns: Mapping[str, Any]

    def __str__(self) -> str:
        return self.source

    def texts(self) -> dict[str, list[str]]:
        """Return the cells of each column as texts.

        Raises:
            LabError: a column has another length or is not a flat list.
        """
        texts = {str(name): self._cells(str(name), values) for name, values in self.columns.items()}
        if len(counts := {len(cells) for cells in texts.values()}) > 1:
            raise LabError(f"{self}: columns have {' and '.join(map(str, sorted(counts)))} rows; give all as many")
        return texts

    def _cells(self, name: str, values: Any) -> list[str]:
        cells = values if isinstance(values, np.ndarray) else np.array([*values], dtype=object)
        if cells.ndim != 1:
            raise LabError(f"{self}: column {name} has shape {cells.shape}; give one cell for each row")
        return ["" if cell is None or cell != cell else str(cell) for cell in cells.tolist()]


class CsvTable:
    """A CSV file: its header, its rows of texts, and their line numbers (the header is 1); or columns in memory.

    Cells are separated by commas, or by semicolons, and then numbers may have decimal commas.

    Attributes:
        path: of the file; the columns without one.
        most: largest number of rows.
        semicolons: True if they separate the cells.
        decimal: decimal mark of the first number, and its line and column; None before it is read.
        header: names of the columns.
        lines: of the rows; empty without a file.
        unread: columns that were not read yet.
    """

    def __init__(self, source: Path | ColumnsInMemory, most: Limit = ROWS) -> None:
        self.path, self.most = source, most
        self.semicolons = False
        self.decimal: tuple[str, str] | None = None
        self.lines: Sequence[int] = ()
        self._count = 0
        self._columns: list[list[_Cells]] = []
        self.header = self._read(source) if isinstance(source, Path) else self._take(source)
        self.unread = list(self.header)

    def __len__(self) -> int:
        return self._count

    def _take(self, given: ColumnsInMemory) -> list[str]:
        """Store columns in memory, and return their names."""
        texts = given.texts()
        rows = len(next(iter(texts.values()), ()))
        self.most(given, rows)
        self._count = rows
        self._columns = [[_packed(tuple(cells))] for cells in texts.values()]
        self._check_table([*texts], rows, None)
        return [*texts]

    def _read(self, path: Path) -> list[str]:
        """Store the columns of a file, and return their names."""
        rows = self._rows(self._text(path))
        line, cells = next(rows, (0, []))
        header, lines = [cell.strip() for cell in cells], [line]
        ragged: tuple[int, int] | None = None  # the first line of another number of cells, and that number
        block: list[list[str]] = []
        for line, cells in rows:
            if len(cells) != len(header):
                ragged = ragged or (line, len(cells))
                continue
            block.append(cells)
            lines.append(line)
            if len(block) == _BLOCK:
                self._keep(block)
                block = []
        if lines[0] != 1:
            raise self.wrong("is blank; begin the file with the header", sep=" ")
        self._keep(block)
        self._check_table(header, len(lines) - 1, ragged)
        whole, self._count = len(lines) == lines[-1], len(lines) - 1
        self.lines = range(2, len(lines) + 1) if whole else lines[1:]
        return [_unmarked(name) for name in header]

    def _text(self, path: Path) -> str:
        """Return the text of a file, whose first line decides on the separator."""
        text = read_text(path, TABLE_BYTES)
        if not text.strip():
            raise LabError(f"{path}: the file is empty; give a header line and rows below it")
        first = text.partition("\n")[0]
        if first.startswith("#"):
            raise self.wrong("is a comment; begin the file with the header", sep=" ")
        self.most(path, text.count("\n") - 1)
        LINE(f"{path}: line 1", first)
        if "\t" in first and "," not in first and ";" not in first:
            raise self.wrong("the columns are separated by tabs; separate them by commas")
        self.semicolons = ";" in first and "," not in first
        return text

    def _rows(self, text: str) -> Iterator[tuple[int, list[str]]]:
        """Yield the line and the cells of each row that is not blank."""
        line, reader = 1, csv.reader(_lines(text), delimiter=";" if self.semicolons else ",", strict=True)
        try:
            for row in reader:
                if any(map(str.strip, row)):
                    yield line, row
                line = reader.line_num + 1
        except csv.Error as error:
            raise LabError(f"{self.path}: line {line}: {error}; fix the quotes of the row that begins there") from error

    def _keep(self, block: list[list[str]]) -> None:
        """Store rows by columns, each as one text if possible, which takes least memory."""
        for column, cells in enumerate(zip(*block, strict=True)):
            if column == len(self._columns):
                self._columns.append([])
            self._columns[column].append(_packed(cells))

    def _check_table(self, header: list[str], rows: int, ragged: tuple[int, int] | None) -> None:
        COLUMNS(self.header_place, header)
        for i, name in enumerate(header):
            if not name:
                raise self.wrong(f"column {i + 1} has no name; name it or remove it")
            if name in header[:i]:
                raise self.wrong(f"column {name} appears twice; keep one")
        if not rows and ragged is None:
            raise LabError(f"{self.path}: no rows below the header; add some")
        if ragged is not None:
            raise LabError(
                f"{self.path}: line {ragged[0]}: {ragged[1]} cells, but the header has {len(header)}; give every column"
            )

    def texts(self, name: str) -> tuple[str, ...] | None:
        """Return the cells of a column, and mark it as read; None if it is missing."""
        if name not in self.header:
            return None
        if name in self.unread:
            self.unread.remove(name)
        return tuple(chain.from_iterable(_unpacked(each) for each in self._columns[self.header.index(name)]))

    @property
    def header_place(self) -> str:
        """Location of the header in error messages."""
        return f"{self.path}: line 1" if isinstance(self.path, Path) else str(self.path)

    def wrong(self, what: str, sep: str = ": ") -> LabError:
        """Return an error about the header."""
        return LabError(f"{self.header_place}{sep}{what}")

    def place(self, row: int) -> str:
        """Return the location of a row in error messages."""
        return f"line {self.lines[row]}" if self.lines else f"row {row}"

    def fail(self, row: int, column: str, what: str) -> LabError:
        """Return an error about a cell."""
        return LabError(f"{self.path}: {self.place(row)}, column {column}: {what}")

    def numbers(self, column: str, exponent: int = 0, *, empty: bool = False) -> Array:
        """Return a column ``(n,)`` times ten to an exponent, correctly rounded; NaN if empty.

        Args:
            empty: accept empty cells.
        """
        if column in self.unread:
            self.unread.remove(column)
        parts, first, held = [], 0, self._columns[self.header.index(column)]
        for i, packed in enumerate(held):
            quick = None if self.semicolons else _plain_numbers(packed, exponent)
            if quick is None:
                cells = _unpacked(packed)
                quick = np.full(len(cells), np.nan)
                for row, cell in enumerate(cells):
                    if cell or not empty:
                        quick[row] = self._number(first + row, column, cell, exponent)
                if self.semicolons:  # decimal points in stored cells
                    held[i] = tuple(cell.replace(",", ".") for cell in cells)
            parts.append(quick)
            first += len(quick)
        return np.concatenate(parts)

    def _number(self, row: int, column: str, cell: str, exponent: int) -> float:
        if not cell:
            raise self.fail(row, column, "the cell is empty; give a number")
        if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            raise self.fail(row, column, f"'{cell}' is not a finite number; leave a point's cells empty if not seen")
        plain = self._with_point(row, column, cell)
        if not _NUMBER.fullmatch(plain):
            hint = " with a decimal point" if "," in cell and not self.semicolons else ""
            raise self.fail(row, column, f"'{cell}' is not a number; give a number{hint}")
        try:
            value = float(Decimal(plain).scaleb(exponent))
        except ArithmeticError:  # beyond what even decimals hold
            value = np.inf
        if abs(value) not in NUMBER_SIZE:
            raise self.fail(row, column, f"'{cell}' is too large; check the number and its unit")
        return value

    def _with_point(self, row: int, column: str, cell: str) -> str:
        """Return a number with a decimal point; a decimal comma is valid if ``;`` separates the cells."""
        marks = [mark for mark in ",." if mark in cell]
        if not self.semicolons or len(marks) != 1:
            return cell
        first, where = self.decimal = self.decimal or (marks[0], f"{self.place(row)}, column {column}")
        if marks[0] != first:
            raise self.fail(
                row, column, f"'{cell}' is written with '{marks[0]}', but {where} with '{first}'; use one decimal mark"
            )
        return cell.replace(",", ".")


_Cells = str | tuple[str, ...]
"""Cells of one column: as lines of one text, or separate if one has several lines."""


def _packed(cells: tuple[str, ...]) -> _Cells:
    text = "\n".join(cells)
    if _PLAIN.fullmatch(text):
        return text
    stripped = tuple(cell.strip() for cell in cells)
    text = "\n".join(stripped)
    return text if text.count("\n") == len(cells) - 1 and text else stripped


def _unpacked(packed: _Cells) -> Sequence[str]:
    cells = packed.split("\n") if isinstance(packed, str) else packed
    texts = (packed,) if isinstance(packed, str) else packed
    return [_unmarked(cell) for cell in cells] if any(_MARK in each for each in texts) else cells


def _lines(text: str) -> Iterator[str]:
    """Yield the lines of a text; a carriage return may end one, too."""
    if text.count("\r") != text.count("\r\n"):
        yield from io.StringIO(text, newline="")
        return
    first = 0
    while first < len(text):
        last = text.find("\n", first) + 1 or len(text)
        yield text[first:last]
        first = last


def _plain_numbers(packed: _Cells, exponent: int) -> Array | None:
    """Return plain decimals times ten to an exponent, correctly rounded ``(n,)``; None for other cells.

    With the exponent appended, a decimal is read to the number nearest to the exact product.
    """
    if not isinstance(packed, str) or not _PLAIN.fullmatch(packed):
        return None
    if exponent and ("e" in packed or "E" in packed):
        return None
    cells = (packed.replace("\n", f"e{exponent}\n") + f"e{exponent}" if exponent else packed).split("\n")
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:  # empty, two points, or a sign inside: the table's own reader says where
        return None
    return values if np.abs(values).max() in NUMBER_SIZE else None


def _unmarked(cell: str) -> str:
    return cell[1:] if cell.startswith(_MARK) and _FORMULA.match(cell) else cell
