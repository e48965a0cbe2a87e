"""Times of the rows of instruments' and controllers' tables: seconds, times of day, dates, stamps of ROS messages."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import LooseTable

__all__ = ["Clock", "ColumnTimes", "column_times", "stamp_times"]

Clock = Literal["seconds", "date", "day"]
_SECONDS = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_DAY_TIME = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*([AaPp][Mm])?")
_DATE = re.compile(r"(\d{1,4})([./-])(\d{1,2})\2(\d{2,4})")
_DAY = 86400.0
_NANOSECONDS = 1e17  # larger numbers are nanoseconds since 1970
_SINCE_1970 = 1e9  # larger numbers are seconds since 1970
_STAMP = re.compile(r"(?:.* )?header stamp(?: (secs?|nsecs|nanosec))?")


@dataclass(frozen=True)
class ColumnTimes:
    """Times of rows.

    Attributes:
        seconds: ``(n,)`` s, or NaN.
        clock: origin: ``date`` is 1970 (in the file's own time zone), ``day`` midnight, ``seconds`` unknown.
        columns: names of the columns that they were read from, "" for none.
    """

    seconds: Array
    clock: Clock
    columns: str = ""


def column_times(table: LooseTable, time: int | None, day: int | None, dates: str) -> ColumnTimes:
    """Read the times of a table's rows; NaN without a column.

    Args:
        time: column of times, or of dates with times of day.
        day: column of dates, which may hold the time of day as well.
        dates: ``dmy`` or ``mdy`` for ambiguous dates; "" to recognize days above 12.
    """
    time, day = (day, None) if time is None else (time, day)
    if time is None:
        return ColumnTimes(np.full(len(table.rows), np.nan), "seconds")
    cells = table.texts(time)
    if day is not None:
        cells = tuple(f"{d} {t}".strip() if t else "" for d, t in zip(table.texts(day), cells, strict=True))
    seconds, clock = _read_times(cells, lambda i: table.where(i, time), dates)
    return ColumnTimes(seconds, clock, table.name(time))


def stamp_times(table: LooseTable, at: tuple[int, int] | None = None) -> ColumnTimes | None:
    """Read the stamps of ROS messages; None where not one topic has them.

    A stamp is seconds and nanoseconds in two columns, or one number: nanoseconds as ``rostopic echo -p`` writes it
    (``field.header.stamp``), or seconds.

    Args:
        at: columns of seconds and nanoseconds, of a table without a header.
    """
    parts = _stamp_columns(table) if at is None else {"s": at[0], "n": at[1]}
    if {"s", "n"} <= set(parts):
        seconds = table.numbers(parts["s"], empty=False) + 1e-9 * table.numbers(parts["n"], empty=False)
        return _since(seconds, f"{table.name(parts['s'])}, {table.name(parts['n'])}")
    if "f" in parts:
        cells = table.texts(parts["f"])
        for row, cell in enumerate(cells):
            if not _SECONDS.fullmatch(cell):
                raise table.wrong(row, parts["f"], f"'{cell}' is no number of nanoseconds; fix it")
        return _since(1e-9 * _as_numbers(cells), table.name(parts["f"]))
    return column_times(table, parts["whole"], None, "") if "whole" in parts else None


def _stamp_columns(table: LooseTable) -> dict[str, int]:
    """Return the columns of the stamps' seconds, nanoseconds or whole numbers; none where several topics have them."""
    parts = dict[str, int]()
    for column, heading in enumerate(table.headings or ()):
        words = " ".join(re.findall(r"[^\W_]+", heading.text.lower()))
        if match := _STAMP.fullmatch(words):
            part = (match[1] or "")[:1] or ("f" if words.startswith("field ") else "whole")
            if part in parts:
                return {}
            parts[part] = column
    return parts


def _as_numbers(cells: Sequence[str]) -> Array:
    return np.array([float(cell.replace(",", ".")) for cell in cells])


def _since(seconds: Array, columns: str) -> ColumnTimes:
    return ColumnTimes(seconds, _clock_of(seconds), columns)


def _clock_of(seconds: Array) -> Clock:
    """Return what seconds count from: a date, or the beginning of the table."""
    return "date" if np.nanmin(seconds) > _SINCE_1970 else "seconds"


def _read_times(cells: Sequence[str], where: Callable[[int], str], dates: str) -> tuple[Array, Clock]:
    """Return the times of cells in seconds, NaN of empty ones, and what they count from."""
    rows = [i for i, cell in enumerate(cells) if cell.strip()]
    filled = [(i, cells[i].strip()) for i in rows]
    seconds = np.full(len(cells), np.nan)
    if not filled:
        return seconds, "seconds"
    if all(_SECONDS.fullmatch(cell) for _, cell in filled):
        numbers = _as_numbers([cell for _, cell in filled])
        numbers = 1e-9 * numbers if numbers.min() > _NANOSECONDS else numbers
        seconds[rows] = numbers
        return seconds, _clock_of(numbers)
    seconds[rows], clock = _clock_times(filled, where, dates)
    return seconds, clock


def _clock_times(given: Sequence[tuple[int, str]], where: Callable[[int], str], dates: str) -> tuple[Array, Clock]:
    """Return times of day, with or without a date, in seconds.

    Args:
        given: row and text of each.
    """
    order = dates or _order(given, where)
    dated, seconds = set[bool](), list[float]()
    for i, cell in given:
        match, date = _DAY_TIME.search(cell), _DATE.search(cell)
        if match is None or (date is None and match[0] != cell):
            raise LabError(f"{where(i)}: '{cell}' is not a time; write seconds, 10:15:30.5 or 2026-05-01 10:15:30.5")
        day = 0.0 if date is None else _date_seconds(date, order, cell, where(i))
        seconds.append(day + _seconds_of_day(match, cell, where(i)))
        dated.add(date is not None)
    if len(dated) > 1:
        raise LabError(f"{where(0)}: some times have a date and some have none; write all alike")
    if dated.pop():
        return np.array(seconds), "date"
    steps = np.diff(seconds, prepend=seconds[0])
    return np.array(seconds) + _DAY * np.cumsum(steps < -_DAY / 2), "day"  # a day of measuring may pass midnight


def _order(given: Sequence[tuple[int, str]], where: Callable[[int], str]) -> str:
    """Return the order of day and month in dates that do not begin with the year."""
    parts = [(match, i) for i, cell in given if (match := _DATE.search(cell)) and len(match[1]) < 4]
    if not parts:
        return "ymd"
    if any(int(match[1]) > 12 for match, _ in parts) or parts[0][0][2] == ".":
        return "dmy"
    if any(int(match[3]) > 12 for match, _ in parts):
        return "mdy"
    i = parts[0][1]
    raise LabError(
        f'{where(i)}: the order of day and month is ambiguous; give dates = "dmy" or "mdy" in the '
        f"{option_name('columns')} file"
    )


def _seconds_of_day(match: "re.Match[str]", cell: str, where: str) -> float:
    hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3].replace(",", "."))
    if match[4]:
        hours = hours % 12 + (12 if match[4].lower() == "pm" else 0)
    if hours > 23 or minutes > 59 or seconds >= 61:
        raise LabError(f"{where}: '{cell}' is not a time of day; fix it")
    return 3600.0 * hours + 60.0 * minutes + seconds


def _date_seconds(match: "re.Match[str]", order: str, cell: str, where: str) -> float:
    first, second, third = int(match[1]), int(match[3]), int(match[4])
    if len(match[1]) == 4:
        year, month, day = first, second, third
    else:
        year = third if third > 99 else 2000 + third
        day, month = (first, second) if order == "dmy" else (second, first)
    try:
        return datetime(year, month, day, tzinfo=UTC).timestamp()
    except (ValueError, OverflowError) as error:
        raise LabError(
            f"{where}: '{cell}' is not a date; fix it, or give dates in the {option_name('columns')} file"
        ) from error
