"""Points that a tracker's program exported as text: SpatialAnalyzer, PolyWorks, Leica, or plain name, x, y, z.

What is public of these formats: SpatialAnalyzer writes a point's collection, group and target, coordinates, and as
asked tolerances, uncertainties, time stamps, offsets and comments, separated by spaces or commas, below comments that
begin with ``//`` (SpatialAnalyzer user manual, "Exporting ASCII Formatted Points"). PolyWorks and Leica programs write
tables whose columns the user chooses. So columns are told by their names, in any order; without names, the first three
numbers of a row are x, y, z, and the text before them is the point's name. Nothing else is guessed.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.column_map import PointColumns, column_named
from lab.formats.loose_table import LeftOut, LooseTable, read_loose
from lab.formats.timestamps import Clock, column_times

__all__ = ["LENGTHS", "TrackerPoints", "read_tracker_points"]

LENGTHS = {"mm": 1e-3, "m": 1.0, "in": 25.4e-3, "um": 1e-6}
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
        path: of the file.
        names: of the points; "" where the file gives none.
        targets: which of the tool's points each is, where a column says it; else "".
        lines: of the points, as an editor counts them.
        positions: ``(n, 3)`` m, in the file's frame.
        sigma_m: ``(n,)`` standard uncertainty of a coordinate: the root of the mean square of the three; NaN where
            the file gives none.
        seconds: ``(n,)`` s when each was measured, NaN where not said.
        clock: from when these count.
        temperature_c, pressure_hpa, humidity_percent: ``(n,)``; NaN where not said.
        used: the columns by what they mean.
        unused: names of columns that have content and were not used.
        notes: what a reader should know of how the file was understood.
        left_out: what of the file is no point.
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


def read_tracker_points(path: Path, columns: PointColumns, unit: str | None, coverage: float) -> TrackerPoints:
    """Read the points of a tracker's export.

    Args:
        path: of the file.
        columns: what is said of its columns.
        unit: of lengths, where the file does not say it: mm, m or in.
        coverage: factor by which its uncertainties exceed one standard deviation.

    Raises:
        LabError: with the file, the line as an editor counts it, and the column.
    """
    return _Reader(read_loose(path, 3), columns, unit, coverage).read()


class _Reader:
    """An export being read: which of its columns is what."""

    def __init__(self, table: LooseTable, columns: PointColumns, unit: str | None, coverage: float) -> None:
        self.table, self.given, self.unit, self.coverage = table, columns, unit, coverage
        self.used: dict[int, str] = {}
        self.notes: list[str] = []

    def read(self) -> TrackerPoints:
        table = self.table
        at = [self._coordinate(axis) for axis in "xyz"]
        scale = LENGTHS[self._length_unit(at)]
        positions = np.stack([scale * table.numbers(column) for column in at], axis=1)
        name, target = self._name(at), self._named("target", self.given.target)
        sigma = self._sigma(scale)
        times, clock = self._times()
        temperature, pressure, humidity = self._condition("temperature"), self._condition("pressure"), self._humidity()
        seen = np.isfinite(positions)
        for i in np.flatnonzero(seen.any(axis=1) & ~seen.all(axis=1)):
            raise LabError(f"{table.path}: line {table.lines[i]}: a coordinate is missing; give all three or none")
        kept = np.flatnonzero(seen.all(axis=1)).tolist()
        if not kept:
            raise LabError(f"{table.path}: every point is empty; export the measured coordinates")
        left = [
            LeftOut(str(table.path), table.lines[i], _cell(table, name, i), "no coordinates")
            for i in np.flatnonzero(~seen.all(axis=1)).tolist()
        ]
        blank = [c for c in range(table.width) if table.is_blank(c)]
        rest = [c for c in range(table.width) if c not in self.used and c not in blank]
        return TrackerPoints(
            table.path,
            tuple(_cell(table, name, i) for i in kept),
            tuple(_cell(table, target, i) for i in kept),
            tuple(table.lines[i] for i in kept),
            positions[kept],
            sigma[kept],
            times[kept],
            clock,
            temperature[kept],
            pressure[kept],
            humidity[kept],
            {what: table.name(column) for column, what in self.used.items()},
            tuple(table.name(c) for c in rest),
            tuple(self.notes),
            (*table.left_out, *left),
        )

    def _take(self, column: int, what: str) -> int:
        if column in self.used:
            raise LabError(
                f"{self.table.path}: column {self.table.name(column)} is taken for {self.used[column]} and for {what}; "
                "name the right ones by --columns"
            )
        self.used[column] = what
        return column

    def _named(self, what: str, given: str, known: tuple[str, ...] = ()) -> int | None:
        """The column that a map names, else the one whose heading is known, in the order of preference."""
        if given:
            return self._take(column_named(self.table, given), what)
        headings = self.table.headings or ()
        for key in known:
            called = [i for i, each in enumerate(headings) if each.key == key]
            same = [i for i in called if not self.table.is_blank(i)] or called
            if len(same) > 1:
                raise LabError(
                    f"{self.table.path}: {len(same)} columns may be {what} ({self.table.name(same[0])}); "
                    "say which by its number in the --columns file"
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
            raise LabError(f"{self.table.path}: no column is {axis} ({known}); name it in the --columns file")
        numeric = [c for c in range(self.table.width) if self.table.is_numeric(c)]
        if len(numeric) == self.table.width and self.table.width > 3 and _counts(self.table.numbers(0)):
            numeric = numeric[1:]  # points without other names are often numbered
        if len(numeric) == self.table.width and self.table.width > 3:
            raise LabError(
                f"{self.table.path}: {self.table.width} columns of numbers without a header: which are x, y and z "
                "cannot be told; name them in the --columns file by their numbers"
            )
        start = next((c for c in numeric if {c, c + 1, c + 2} <= set(numeric)), None)
        if start is None:
            raise LabError(f"{self.table.path}: no three columns of numbers side by side; name x, y, z by --columns")
        return self._take(start + "xyz".index(axis), axis)

    def _length_unit(self, at: list[int]) -> str:
        headings = self.table.headings
        said = {headings[column].unit for column in at} - {""} if headings is not None else set[str]()
        if len(said) > 1:
            raise LabError(f"{self.table.path}: x, y and z have different units ({', '.join(sorted(said))}); fix that")
        stated = said.pop() if said else self.table.stated_unit
        if stated and stated not in LENGTHS:
            raise LabError(f"{self.table.path}: coordinates in {stated} are no lengths; export Cartesian coordinates")
        given = self.unit or self.given.unit
        if stated and given and stated != given:
            raise LabError(f"{self.table.path}: its lengths are in {stated}, as it says; leave out --unit {given}")
        if not (stated or given):
            raise LabError(f"{self.table.path}: the unit of its lengths is not said; give --unit mm (or m, in)")
        return stated or str(given)

    def _name(self, at: list[int]) -> int | None:
        found = self._named("name", self.given.name, _NAMES)
        if found is not None or self.table.headings is not None:
            return found
        before = [c for c in range(min(at)) if c not in self.used and not self.table.is_blank(c)]
        return self._take(before[-1], "name") if before else None

    def _sigma(self, scale: float) -> Array:
        """Standard uncertainty ``(n,)`` m of a coordinate."""
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
                raise LabError(f"{table.path}: uncertainties of x, y and z are not all there; name them by --columns")
        parts = np.stack([self._uncertainty(column, scale) for column in found], axis=1)
        return np.asarray(np.sqrt((parts**2).mean(axis=1)))

    def _keyed(self, key: str) -> list[int]:
        headings = self.table.headings or ()
        return [i for i, each in enumerate(headings) if each.key == key and not self.table.is_blank(i)]

    def _total(self, column: int, scale: float) -> Array:
        self._take(column, "uncertainty of the position")
        self.notes.append(
            f"{self.table.path}: column {self.table.name(column)} is taken for the uncertainty of the whole position; "
            "that of a coordinate is its 1/√3"
        )
        one: Array = self._uncertainty(column, scale) / np.sqrt(3.0)
        return one

    def _uncertainty(self, column: int, scale: float) -> Array:
        headings = self.table.headings
        unit = headings[column].unit if headings is not None else ""
        if unit and unit not in LENGTHS:
            raise LabError(f"{self.table.path}: column {self.table.name(column)}: {unit} is no unit of lengths; fix it")
        values = self.table.numbers(column) * LENGTHS.get(unit, scale) / self.coverage
        for i in np.flatnonzero(values <= 0):
            raise LabError(
                f"{self.table.path}: line {self.table.lines[i]}, column {self.table.name(column)}: an uncertainty is "
                "above zero; fix it, or name the right columns by --columns"
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

    def _humidity(self) -> Array:
        column = self._named("humidity", self.given.humidity, _CONDITIONS["humidity"])
        return np.full(len(self.table.rows), np.nan) if column is None else self.table.numbers(column)


def _cell(table: LooseTable, column: int | None, row: int) -> str:
    return "" if column is None else table.rows[row][column]


def _counts(values: Array) -> bool:
    """Whether numbers count rows: whole and rising."""
    return bool(np.isfinite(values).all() and (values == values.round()).all() and (np.diff(values) > 0).all())
