"""Times as instruments and controllers write them: seconds, dates with a time of day, or times of day alone."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.loose_table import LooseTable

__all__ = ["Clock", "Times", "column_times"]

Clock = Literal["seconds", "date", "day"]
_SECONDS = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_DAY_TIME = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*([AaPp][Mm])?")
_DATE = re.compile(r"(\d{1,4})([./-])(\d{1,2})\2(\d{2,4})")
_DAY = 86400.0


@dataclass(frozen=True)
class Times:
    """When rows were written.

    Attributes:
        seconds: ``(n,)`` s; NaN where a row has no time.
        clock: from when they count: ``date`` from 1970 (in the file's own time zone), ``day`` from midnight, and
            ``seconds`` from whatever the file counts from.
    """

    seconds: Array
    clock: Clock


def column_times(table: LooseTable, time: int, day: int | None, dates: str) -> Times:
    """Read the times of a table's rows.

    Args:
        table: whose rows they are.
        time: the column of times, or of dates with times of day.
        day: the column of dates alone; None where there is none.
        dates: ``dmy`` or ``mdy``, where a day cannot be told from a month; "" to tell by the days above 12.

    Raises:
        LabError: a text is no time, rows are written differently, or days cannot be told from months.
    """
    cells = table.texts(time)
    if day is not None:
        cells = tuple(f"{d} {t}".strip() if t else "" for d, t in zip(table.texts(day), cells, strict=True))
    return _read_times(cells, lambda i: f"{table.path}: line {table.lines[i]}, column {table.name(time)}", dates)


def _read_times(cells: Sequence[str], where: Callable[[int], str], dates: str) -> Times:
    """The times of texts, one for each row; a row without one has no time."""
    given = [(i, cell.strip()) for i, cell in enumerate(cells) if cell.strip()]
    found = np.full(len(cells), np.nan)
    if not given:
        return Times(found, "seconds")
    if all(_SECONDS.fullmatch(cell) for _, cell in given):
        for i, cell in given:
            found[i] = float(cell.replace(",", "."))
        return Times(found, "date" if np.nanmin(found) > 1e9 else "seconds")
    order = dates or _order(given, where)
    clocks = set()
    for i, cell in given:
        match = _DAY_TIME.search(cell)
        date = _DATE.search(cell)
        if match is None or (date is None and match[0] != cell):
            raise LabError(f"{where(i)}: '{cell}' is no time; write seconds, 10:15:30.5 or 2026-05-01 10:15:30.5")
        seconds = _seconds_of_day(match, cell, where(i))
        if date is not None:
            seconds += _date_seconds(date, order, cell, where(i))
        clocks.add(date is not None)
        found[i] = seconds
    if len(clocks) > 1:
        raise LabError(f"{where(0)}: some times have a date and some have none; write all alike")
    if not clocks.pop():  # a day of measuring may pass midnight
        steps = np.nan_to_num(np.diff(found[[i for i, _ in given]], prepend=found[given[0][0]]))
        found[[i for i, _ in given]] += _DAY * np.cumsum(steps < -_DAY / 2)
        return Times(found, "day")
    return Times(found, "date")


def _order(given: Sequence[tuple[int, str]], where: Callable[[int], str]) -> str:
    """Whether dates that begin with no year begin with the day or the month."""
    parts = [(match, i) for i, cell in given if (match := _DATE.search(cell)) and len(match[1]) < 4]
    if not parts:
        return "ymd"
    if any(int(match[1]) > 12 for match, _ in parts) or parts[0][0][2] == ".":
        return "dmy"
    if any(int(match[3]) > 12 for match, _ in parts):
        return "mdy"
    i = parts[0][1]
    raise LabError(f'{where(i)}: day and month cannot be told apart; say dates = "dmy" or "mdy" in the --columns file')


def _seconds_of_day(match: "re.Match[str]", cell: str, where: str) -> float:
    hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3].replace(",", "."))
    if match[4]:
        hours = hours % 12 + (12 if match[4].lower() == "pm" else 0)
    if hours > 23 or minutes > 59 or seconds >= 61:
        raise LabError(f"{where}: '{cell}' is no time of day; fix it")
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
        raise LabError(f"{where}: '{cell}' is no date; fix it, or say dates in the --columns file") from error
