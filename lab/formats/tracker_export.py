"""Points exported by trackers' programs: SpatialAnalyzer, PolyWorks, Leica, or plain name, x, y, z.

SpatialAnalyzer writes a point's collection, group and target, coordinates, and optionally tolerances, uncertainties,
time stamps, offsets and comments, separated by spaces or commas, below comments that begin with ``//`` (SpatialAnalyzer
user manual, "Exporting ASCII Formatted Points"). PolyWorks and Leica programs write tables with chosen columns. Columns
are recognized by name, in any order; without names, the first three numbers of a row are x, y, z, after the point's
name.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import LeftOut, LooseTable, PointColumns
from lab.formats.time_columns import Clock, ColumnTimes, column_times

__all__ = ["TrackerPoints", "read_tracker_points"]

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
    return _PointReader(table, columns, unit, coverage).read()


class _PointReader:
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
        times = self._times()
        temperature, pressure, humidity = map(self._condition, ("temperature", "pressure", "humidity"))
        rows, empty = self._seen(positions)
        return TrackerPoints(
            table.path,
            _cells(table, name, rows),
            _cells(table, target, rows),
            tuple(table.lines[i] for i in rows),
            positions[rows],
            sigma[rows],
            times.seconds[rows],
            times.clock,
            temperature[rows],
            pressure[rows],
            humidity[rows],
            {what: table.name(column) for column, what in self.used.items()},
            tuple(table.name(c) for c in range(table.width) if c not in self.used and not table.is_blank(c)),
            tuple(self.notes),
            (*table.left_out, *self._without_coordinates(name, empty)),
        )

    def _seen(self, positions: Array) -> tuple[list[int], list[int]]:
        """Return the rows with coordinates, and those without.

        Raises:
            LabError: a row has some of the three, or none has any.
        """
        seen = np.isfinite(positions)
        rows = np.flatnonzero(seen.all(axis=1)).tolist()
        for i in np.flatnonzero(seen.any(axis=1) & ~seen.all(axis=1)):
            line = self.table.lines[i]
            raise LabError(f"{self.table.path}: line {line}: a coordinate is missing; give all three or none")
        if not rows:
            raise LabError(f"{self.table.path}: every point is empty; export the measured coordinates")
        return rows, np.flatnonzero(~seen.any(axis=1)).tolist()

    def _without_coordinates(self, name: int | None, rows: list[int]) -> list[LeftOut]:
        table, names = self.table, _cells(self.table, name, rows)
        return [LeftOut(str(table.path), table.lines[i], n, "no coordinates") for i, n in zip(rows, names, strict=True)]

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
        column = self.table.find(what, known, given)
        return None if column is None else self._take(column, what)

    def _coordinate(self, axis: str) -> int:
        wanted = getattr(self.given, axis)
        if not wanted and self.table.headings is None:
            return self._take(self._first_coordinate() + "xyz".index(axis), axis)
        column = self._named(axis, wanted, tuple(form.format(axis) for form in _MEASURED))
        if column is None:
            raise self.table.missing(axis)
        return column

    def _first_coordinate(self) -> int:
        """Return the column of x in a table without a header: the first of three columns of numbers."""
        table, width = self.table, self.table.width
        numeric = [c for c in range(width) if table.is_numeric(c)]
        if len(numeric) == width > 3 and _counts(table.numbers(0)):
            numeric = numeric[1:]  # points without other names are often numbered
        if len(numeric) == width > 3:
            raise LabError(
                f"{table.path}: {width} columns of numbers without a header: which are x, y and z is "
                f"unknown; name them in the {option_name('columns')} file by their numbers"
            )
        start = next((c for c in numeric if {c, c + 1, c + 2} <= set(numeric)), None)
        if start is None:
            raise LabError(
                f"{table.path}: no three columns of numbers side by side; name x, y, z by {option_name('columns')}"
            )
        return start

    def _length_unit(self, at: list[int]) -> str:
        """Return the unit of the coordinates: as the file states it, else as it is given."""
        path, stated, given = self.table.path, self._stated_unit(at), self.unit or self.given.unit
        if stated and given and stated != given:
            raise LabError(f"{path}: the file states lengths in {stated}; leave out {option_name('unit')} {given}")
        if not (stated or given):
            raise LabError(f"{path}: the unit of its lengths is not stated; give {option_name('unit')} mm (or m, in)")
        return stated or str(given)

    def _stated_unit(self, at: list[int]) -> str:
        """Return the unit that headings or titles state, "" for none."""
        units = {self.table.unit(column) for column in at} - {""}
        if len(units) > 1:
            raise LabError(f"{self.table.path}: x, y and z have different units ({', '.join(sorted(units))}); fix that")
        stated = units.pop() if units else self.table.stated_unit
        if stated and stated not in _LENGTHS:
            raise LabError(f"{self.table.path}: coordinates in {stated} are not lengths; export Cartesian coordinates")
        return stated

    def _name(self, at: list[int]) -> int | None:
        column = self._named("name", self.given.name, _NAMES)
        if column is not None or self.table.headings is not None:
            return column
        before = [c for c in range(min(at)) if c not in self.used and not self.table.is_blank(c)]
        return self._take(before[-1], "name") if before else None

    def _sigma(self, scale: float) -> Array:
        """Return the standard uncertainties ``(n,)`` m of a coordinate, NaN without a column."""
        wanted = self.given.sigma
        if len(wanted) == 1:
            return self._total(self.table.column(wanted[0]), scale)
        if wanted:
            pairs = zip(wanted, "xyz", strict=True)
            parts = [self._take(self.table.column(each), f"uncertainty of {axis}") for each, axis in pairs]
        else:
            parts = self._known_sigmas()
        if not parts:
            total = self._known_total()
            return np.full(len(self.table.rows), np.nan) if total is None else self._total(total, scale)
        squares = np.stack([self._uncertainty(column, scale) for column in parts], axis=1) ** 2
        return np.asarray(np.sqrt(squares.mean(axis=1)))

    def _known_sigmas(self) -> list[int]:
        """Return the columns of the uncertainties of x, y and z; none where the file has none."""
        known = [self._named(f"uncertainty of {a}", "", tuple(form.format(a) for form in _SIGMAS)) for a in "xyz"]
        columns = [column for column in known if column is not None]
        if 0 < len(columns) < 3:
            raise LabError(
                f"{self.table.path}: not all uncertainties of x, y and z are given; name them by "
                f"{option_name('columns')}"
            )
        return columns

    def _known_total(self) -> int | None:
        """Return the first column with numbers that heads an uncertainty of the whole position."""
        headings = enumerate(self.table.headings or ())
        places = {each.key: i for i, each in reversed([*headings]) if not self.table.is_blank(i)}
        return next((places[key] for key in _TOTALS if key in places), None)

    def _total(self, column: int, scale: float) -> Array:
        self._take(column, "uncertainty of the position")
        self.notes.append(
            f"{self.table.path}: column {self.table.name(column)} is taken as the uncertainty of the whole position; "
            "a coordinate's is 1/√3 of it"
        )
        return np.asarray(self._uncertainty(column, scale) / np.sqrt(3.0))

    def _uncertainty(self, column: int, scale: float) -> Array:
        unit = self.table.unit(column)
        if unit and unit not in _LENGTHS:
            raise LabError(
                f"{self.table.path}: column {self.table.name(column)}: {unit} is not a unit of length; fix it"
            )
        values = self.table.numbers(column) * _LENGTHS.get(unit, scale) / self.coverage
        for i in np.flatnonzero(values <= 0).tolist():
            advice = f"fix it, or name the right columns by {option_name('columns')}"
            raise self.table.wrong(i, column, f"an uncertainty must be above zero; {advice}")
        return np.asarray(values)

    def _times(self) -> ColumnTimes:
        day = self._named("date", self.given.date, _CONDITIONS["date"])
        time = self._named("time", self.given.time, _CONDITIONS["time"])
        return column_times(self.table, time, day, self.given.dates or "")

    def _condition(self, what: str) -> Array:
        column = self._named(what, getattr(self.given, what), _CONDITIONS[what])
        if column is None:
            return np.full(len(self.table.rows), np.nan)
        unit, values = self.table.unit(column), self.table.numbers(column)
        if what == "pressure":
            values = values * _PRESSURES.get(unit, 1.0)
        return np.asarray({"F": (values - 32) / 1.8, "K": values - 273.15}.get(unit, values))


def _cells(table: LooseTable, column: int | None, rows: list[int]) -> tuple[str, ...]:
    """Return some cells of a column, "" without one."""
    return tuple("" if column is None else table.rows[row][column] for row in rows)


def _counts(values: Array) -> bool:
    """Check whether numbers count rows: whole and rising."""
    return bool(np.isfinite(values).all() and (values == values.round()).all() and (np.diff(values) > 0).all())
