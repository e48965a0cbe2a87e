"""Points exported by trackers' programs: SpatialAnalyzer, PolyWorks, Leica, or plain name, x, y, z.

SpatialAnalyzer writes a point's collection, group and target, coordinates, and optionally tolerances, uncertainties,
time stamps, offsets and comments, separated by spaces or commas, below comments that begin with ``//`` (SpatialAnalyzer
user manual, "Exporting ASCII Formatted Points"). PolyWorks and Leica programs write tables with chosen columns. Columns
are recognized by name, in any order; without names, the first three numbers of a row are x, y, z, after the point's
name.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import LeftOut, LooseTable, PointColumns, column_named

__all__ = ["Clock", "TrackerPoints", "column_times", "read_tracker_points", "stamp_times"]

Clock = Literal["seconds", "date", "day"]
_SECONDS = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_DAY_TIME = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*([AaPp][Mm])?")
_DATE = re.compile(r"(\d{1,4})([./-])(\d{1,2})\2(\d{2,4})")
_DAY = 86400.0
_NANOSECONDS = 1e17  # larger numbers are nanoseconds since 1970
_STAMP = re.compile(r"(?:.* )?header stamp(?: (secs?|nsecs|nanosec))?")


@dataclass(frozen=True)
class _Times:
    """Times of rows.

    Attributes:
        seconds: ``(n,)`` s, or NaN.
        clock: origin: ``date`` is 1970 (in the file's own time zone), ``day`` midnight, ``seconds`` unknown.
    """

    seconds: Array
    clock: Clock


def column_times(table: LooseTable, time: int, day: int | None, dates: str) -> _Times:
    """Read the times of a table's rows.

    Args:
        time: column of times, or of dates with times of day.
        day: column of dates, or None.
        dates: ``dmy`` or ``mdy`` for ambiguous dates; "" to recognize days above 12.
    """
    cells = table.texts(time)
    if day is not None:
        cells = tuple(f"{d} {t}".strip() if t else "" for d, t in zip(table.texts(day), cells, strict=True))
    return _read_times(cells, lambda i: f"{table.path}: line {table.lines[i]}, column {table.name(time)}", dates)


def stamp_times(table: LooseTable, at: tuple[int, int] | None = None) -> tuple[_Times, str] | None:
    """Read the stamps of ROS messages, and return them with their columns' names; None where not one topic has them.

    A stamp is seconds and nanoseconds in two columns, or one number: nanoseconds as ``rostopic echo -p`` writes it
    (``field.header.stamp``), or seconds.

    Args:
        at: columns of seconds and nanoseconds, of a table without a header.
    """
    found: dict[str, int] = {} if at is None else {"s": at[0], "n": at[1]}
    for column, heading in enumerate(table.headings or ()):
        words = " ".join(re.findall(r"[^\W_]+", heading.text.lower()))
        if match := _STAMP.fullmatch(words):
            part = (match[1] or "")[:1] or ("f" if words.startswith("field ") else "whole")
            if part in found:
                return None
            found[part] = column
    if {"s", "n"} <= set(found):
        seconds = table.numbers(found["s"], empty=False) + 1e-9 * table.numbers(found["n"], empty=False)
        columns = f"{table.name(found['s'])}, {table.name(found['n'])}"
        return _Times(seconds, "date" if seconds.min() > 1e9 else "seconds"), columns
    if "f" in found:
        cells, name = table.texts(found["f"]), table.name(found["f"])
        for cell, line in zip(cells, table.lines, strict=True):
            if not _SECONDS.fullmatch(cell):
                raise LabError(
                    f"{table.path}: line {line}, column {name}: '{cell}' is no number of nanoseconds; fix it"
                )
        seconds = 1e-9 * np.array([float(cell.replace(",", ".")) for cell in cells])
        return _Times(seconds, "date" if seconds.min() > 1e9 else "seconds"), name
    return (column_times(table, found["whole"], None, ""), table.name(found["whole"])) if "whole" in found else None


def _read_times(cells: Sequence[str], where: Callable[[int], str], dates: str) -> _Times:
    given = [(i, cell.strip()) for i, cell in enumerate(cells) if cell.strip()]
    found = np.full(len(cells), np.nan)
    if not given:
        return _Times(found, "seconds")
    if all(_SECONDS.fullmatch(cell) for _, cell in given):
        for i, cell in given:
            found[i] = float(cell.replace(",", "."))
        if np.nanmin(found) > _NANOSECONDS:
            found *= 1e-9
        return _Times(found, "date" if np.nanmin(found) > 1e9 else "seconds")
    order = dates or _order(given, where)
    clocks = set()
    for i, cell in given:
        match = _DAY_TIME.search(cell)
        date = _DATE.search(cell)
        if match is None or (date is None and match[0] != cell):
            raise LabError(f"{where(i)}: '{cell}' is not a time; write seconds, 10:15:30.5 or 2026-05-01 10:15:30.5")
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
        return _Times(found, "day")
    return _Times(found, "date")


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


_LENGTHS = {"mm": 1e-3, "m": 1.0, "in": 25.4e-3, "um": 1e-6}
_PRESSURES = {"hPa": 1.0, "kPa": 10.0, "Pa": 0.01, "mmHg": 1.33322387415, "": 1.0}  # hPa
_NAMES = (
    "name", "point", "point name", "pointname", "point id", "pointid", "target", "target name", "label", "id",
    "object", "object name", "feature", "feature name", "pose", "point label", "pt", "no", "nr", "number",
)  # fmt: skip
_MEASURED = ("{0}", "meas {0}", "{0} meas", "measured {0}", "{0} measured", "actual {0}", "{0} actual", "coord {0}",
             "{0} coord", "{0} coordinate", "coordinate {0}", "{0} value")  # fmt: skip
_SIGMAS = ("u{0}", "u {0}", "{0} u", "s{0}", "s {0}", "sigma {0}", "{0} sigma", "std {0}", "{0} std", "std dev {0}",
           "{0} std dev", "stddev {0}", "{0} stddev", "uncertainty {0}", "{0} uncertainty", "unc {0}", "{0} unc",
           "standard uncertainty {0}", "{0} standard uncertainty")  # fmt: skip
_TOTALS = ("uncertainty", "total uncertainty", "point uncertainty", "u mag", "umag", "uncertainty magnitude", "u3d")
_CONDITIONS = {
    "time": ("time", "timestamp", "time stamp", "date time", "datetime", "date and time", "measured at"),
    "date": ("date", "day"),
    "temperature": ("temperature", "temp", "air temperature", "ambient temperature"),
    "pressure": ("pressure", "air pressure", "press"),
    "humidity": ("humidity", "relative humidity", "rh"),
}


@dataclass(frozen=True)
class TrackerPoints:
    """Points of a tracker's export.

    Attributes:
        names: of the points, or "".
        targets: point of the tool of each, or "".
        lines: of the points in the file.
        positions: ``(n, 3)`` m, in the file's frame.
        sigma_m: ``(n,)`` standard uncertainty of a coordinate (root mean square of the three), or NaN.
        seconds: ``(n,)`` s, time of each measurement, or NaN.
        clock: origin of the times.
        temperature_c, pressure_hpa, humidity_percent: ``(n,)``, or NaN.
        used: columns by meaning.
        unused: names of other columns with content.
        notes: messages for the user about the file's interpretation.
        left_out: unused parts of the file.
    """

    path: Path
    names: tuple[str, ...]
    targets: tuple[str, ...]
    lines: tuple[int, ...]
    positions: Array
    sigma_m: Array
    seconds: Array
    clock: Clock
    temperature_c: Array
    pressure_hpa: Array
    humidity_percent: Array
    used: dict[str, str]
    unused: tuple[str, ...]
    notes: tuple[str, ...]
    left_out: tuple[LeftOut, ...]


def read_tracker_points(table: LooseTable, columns: PointColumns, unit: str | None, coverage: float) -> TrackerPoints:
    """Read the points of a tracker's export.

    Args:
        table: of the export.
        columns: map of its columns.
        unit: of lengths, mm, m or in, if the file does not state it.
        coverage: factor of its uncertainties over one standard deviation.
    """
    return _Reader(table, columns, unit, coverage).read()


class _Reader:
    """Reader of an export."""

    def __init__(self, table: LooseTable, columns: PointColumns, unit: str | None, coverage: float) -> None:
        self.table, self.given, self.unit, self.coverage = table, columns, unit, coverage
        self.used: dict[int, str] = {}
        self.notes: list[str] = []

    def read(self) -> TrackerPoints:
        table = self.table
        at = [self._coordinate(axis) for axis in "xyz"]
        scale = _LENGTHS[self._length_unit(at)]
        positions = np.stack([scale * table.numbers(column) for column in at], axis=1)
        name, target = self._name(at), self._named("target", self.given.target)
        sigma = self._sigma(scale)
        times, clock = self._times()
        temperature, pressure, humidity = map(self._condition, ("temperature", "pressure", "humidity"))
        seen = np.isfinite(positions)
        for i in np.flatnonzero(seen.any(axis=1) & ~seen.all(axis=1)):
            raise LabError(f"{table.path}: line {table.lines[i]}: a coordinate is missing; give all three or none")
        retained = np.flatnonzero(seen.all(axis=1)).tolist()
        if not retained:
            raise LabError(f"{table.path}: every point is empty; export the measured coordinates")
        left = [
            LeftOut(str(table.path), table.lines[i], _cell(table, name, i), "no coordinates")
            for i in np.flatnonzero(~seen.all(axis=1)).tolist()
        ]
        blank = [c for c in range(table.width) if table.is_blank(c)]
        rest = [c for c in range(table.width) if c not in self.used and c not in blank]
        return TrackerPoints(
            table.path,
            tuple(_cell(table, name, i) for i in retained),
            tuple(_cell(table, target, i) for i in retained),
            tuple(table.lines[i] for i in retained),
            positions[retained],
            sigma[retained],
            times[retained],
            clock,
            temperature[retained],
            pressure[retained],
            humidity[retained],
            {what: table.name(column) for column, what in self.used.items()},
            tuple(table.name(c) for c in rest),
            tuple(self.notes),
            (*table.left_out, *left),
        )

    def _take(self, column: int, what: str) -> int:
        if column in self.used:
            raise LabError(
                f"{self.table.path}: column {self.table.name(column)} is assigned to {self.used[column]} and to "
                f"{what}; name the right ones by {option_name('columns')}"
            )
        self.used[column] = what
        return column

    def _named(self, what: str, given: str, known: tuple[str, ...] = ()) -> int | None:
        """Return the column of a map, else the one with a known heading, in order of preference."""
        if given:
            return self._take(column_named(self.table, given), what)
        headings = self.table.headings or ()
        for key in known:
            called = [i for i, each in enumerate(headings) if each.key == key]
            same = [i for i in called if not self.table.is_blank(i)] or called
            if len(same) > 1:
                raise LabError(
                    f"{self.table.path}: {len(same)} columns may be {what} ({self.table.name(same[0])}); "
                    f"give its number in the {option_name('columns')} file"
                )
            if same:
                return self._take(same[0], what)
        return None

    def _coordinate(self, axis: str) -> int:
        given = getattr(self.given, axis)
        if given or self.table.headings is not None:
            found = self._named(axis, given, tuple(form.format(axis) for form in _MEASURED))
            if found is not None:
                return found
            known = ", ".join(each.text for each in self.table.headings or () if each.text)
            raise LabError(
                f"{self.table.path}: no column is {axis} ({known}); name it in the {option_name('columns')} file"
            )
        numeric = [c for c in range(self.table.width) if self.table.is_numeric(c)]
        if len(numeric) == self.table.width and self.table.width > 3 and _counts(self.table.numbers(0)):
            numeric = numeric[1:]  # points without other names are often numbered
        if len(numeric) == self.table.width and self.table.width > 3:
            raise LabError(
                f"{self.table.path}: {self.table.width} columns of numbers without a header: which are x, y and z is "
                f"unknown; name them in the {option_name('columns')} file by their numbers"
            )
        start = next((c for c in numeric if {c, c + 1, c + 2} <= set(numeric)), None)
        if start is None:
            raise LabError(
                f"{self.table.path}: no three columns of numbers side by side; name x, y, z by {option_name('columns')}"
            )
        return self._take(start + "xyz".index(axis), axis)

    def _length_unit(self, at: list[int]) -> str:
        headings = self.table.headings
        units = {headings[column].unit for column in at} - {""} if headings is not None else set[str]()
        if len(units) > 1:
            raise LabError(f"{self.table.path}: x, y and z have different units ({', '.join(sorted(units))}); fix that")
        stated = units.pop() if units else self.table.stated_unit
        if stated and stated not in _LENGTHS:
            raise LabError(f"{self.table.path}: coordinates in {stated} are not lengths; export Cartesian coordinates")
        given = self.unit or self.given.unit
        if stated and given and stated != given:
            raise LabError(
                f"{self.table.path}: the file states lengths in {stated}; leave out {option_name('unit')} {given}"
            )
        if not (stated or given):
            raise LabError(
                f"{self.table.path}: the unit of its lengths is not stated; give {option_name('unit')} mm (or m, in)"
            )
        return stated or str(given)

    def _name(self, at: list[int]) -> int | None:
        found = self._named("name", self.given.name, _NAMES)
        if found is not None or self.table.headings is not None:
            return found
        before = [c for c in range(min(at)) if c not in self.used and not self.table.is_blank(c)]
        return self._take(before[-1], "name") if before else None

    def _sigma(self, scale: float) -> Array:
        given, table = self.given.sigma, self.table
        if len(given) == 3:
            pairs = zip(given, "xyz", strict=True)
            found = [self._take(column_named(table, each), f"uncertainty of {axis}") for each, axis in pairs]
        elif len(given) == 1:
            return self._total(column_named(table, given[0]), scale)
        else:
            some = [self._named(f"uncertainty of {a}", "", tuple(form.format(a) for form in _SIGMAS)) for a in "xyz"]
            found = [column for column in some if column is not None]
            if not found:
                total = next((c for key in _TOTALS for c in self._keyed(key)), None)
                return np.full(len(table.rows), np.nan) if total is None else self._total(total, scale)
            if len(found) < 3:
                raise LabError(
                    f"{table.path}: not all uncertainties of x, y and z are given; name them by "
                    f"{option_name('columns')}"
                )
        parts = np.stack([self._uncertainty(column, scale) for column in found], axis=1)
        return np.asarray(np.sqrt((parts**2).mean(axis=1)))

    def _keyed(self, key: str) -> list[int]:
        headings = self.table.headings or ()
        return [i for i, each in enumerate(headings) if each.key == key and not self.table.is_blank(i)]

    def _total(self, column: int, scale: float) -> Array:
        self._take(column, "uncertainty of the position")
        self.notes.append(
            f"{self.table.path}: column {self.table.name(column)} is taken as the uncertainty of the whole position; "
            "a coordinate's is 1/√3 of it"
        )
        return np.asarray(self._uncertainty(column, scale) / np.sqrt(3.0))

    def _uncertainty(self, column: int, scale: float) -> Array:
        headings = self.table.headings
        unit = headings[column].unit if headings is not None else ""
        if unit and unit not in _LENGTHS:
            raise LabError(
                f"{self.table.path}: column {self.table.name(column)}: {unit} is not a unit of length; fix it"
            )
        values = self.table.numbers(column) * _LENGTHS.get(unit, scale) / self.coverage
        for i in np.flatnonzero(values <= 0):
            raise LabError(
                f"{self.table.path}: line {self.table.lines[i]}, column {self.table.name(column)}: an uncertainty "
                f"must be above zero; fix it, or name the right columns by {option_name('columns')}"
            )
        return np.asarray(values)

    def _times(self) -> tuple[Array, Clock]:
        day = self._named("date", self.given.date, _CONDITIONS["date"])
        time = self._named("time", self.given.time, _CONDITIONS["time"])
        if time is None:
            day, time = None, day  # a column of dates may hold the time of day as well
        if time is None:
            return np.full(len(self.table.rows), np.nan), "seconds"
        found = column_times(self.table, time, day, self.given.dates or "")
        return found.seconds, found.clock

    def _condition(self, what: str) -> Array:
        column = self._named(what, getattr(self.given, what), _CONDITIONS[what])
        if column is None:
            return np.full(len(self.table.rows), np.nan)
        unit = self.table.headings[column].unit if self.table.headings is not None else ""
        values = self.table.numbers(column)
        if what == "pressure":
            values = values * _PRESSURES.get(unit, 1.0)
        return np.asarray({"F": (values - 32) / 1.8, "K": values - 273.15}.get(unit, values))


def _cell(table: LooseTable, column: int | None, row: int) -> str:
    return "" if column is None else table.rows[row][column]


def _counts(values: Array) -> bool:
    """Check whether numbers count rows: whole and rising."""
    return bool(np.isfinite(values).all() and (values == values.round()).all() and (np.diff(values) > 0).all())
