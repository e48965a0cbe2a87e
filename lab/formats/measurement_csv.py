"""Measurements as CSV: one row per pose, units in the column names.

Lengths are read as decimal numbers and scaled exactly, so that written files (joint positions in rad or mm, points in
mm) read back to the bit.
"""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.limits import PAYLOAD_KG, ROWS, SIGMA_MM, TARGETS, Limit, checked_target
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.formats.csv_table import ColumnsInMemory, CsvTable, name_cell, text_cell
from lab.formats.orientations import ENDS
from lab.kinematics.effects.effect import is_usual

__all__ = ["USES", "ObservedColumns", "PoseReader", "read_columns", "read_measurements", "write_measurements"]

USES = ("calibrate", "reference", "test", "skip")
_ANGLE_UNITS = ("rad", "deg")
_LENGTH_EXPONENT = {"m": 0, "mm": -3}
_TEXT_COLUMNS = ("id", "session", "use")
_NUMBER_COLUMNS = (
    *("temp_C", "time_s", "payload_kg"),
    *("cable_mm", "edge_mm", "sphere_x_mm", "sphere_y_mm", "sphere_z_mm", "radius_mm", "bar_mm", "dial_mm"),
)
_OTHER_RESERVED = (
    *("station", "location", "socket", "target", "face", "sphere"),
    *("stop", "checked", "pressure_hPa", "humidity_percent"),
)
_COORDINATES = tuple(f"{axis}_{unit}" for axis in "xyz" for unit in _LENGTH_EXPONENT)
_AXIS = r"([xyz]|q[wxyz]|r[xyz])(_.*)?|.+_[xyz]_[A-Za-z]+"  # a coordinate or an angle, in whichever unit
_JOINT = r"q\d+(_.*)?"
_POSE_COLUMN = re.compile(rf"id|sigma_mm|approach_.*|{_JOINT}|{_AXIS}|.+_({'|'.join(ENDS)})")
_BLOCK = 10_000  # rows at a time


@dataclass(frozen=True)
class ObservedColumns:
    """Columns with observations, beside those of every file.

    Attributes:
        positions: points are observed; otherwise ignored with a warning.
        required: a file without points is refused, if points are observed.
        orientations: orientations are observed; otherwise ignored with a warning.
        numbers: columns of numbers that become conditions, NaN if empty.
        texts: columns of texts that are kept unchanged.
        observed: kind of observation in warnings; "" for points.
    """

    positions: bool = True
    orientations: bool = False
    numbers: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    observed: str = ""
    required: bool = True

    def with_conditions(self, names: Iterable[str]) -> "ObservedColumns":
        """Return these columns with those of a model's conditions that the lab does not know, as numbers."""
        return replace(self, numbers=(*self.numbers, *(name for name in names if not is_usual(name))))


def write_measurements(path: Path, data: Measurements, prismatic: Sequence[bool]) -> None:
    """Write the CSV that ``read_measurements`` reads back to the bit; reserved columns only if needed."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for first in range(0, max(len(data), 1), _BLOCK):
            part = data[first : first + _BLOCK]
            columns = _labels(data, part) | _numbers(data, part, prismatic)
            if not first:
                writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))


def _labels(data: Measurements, part: Measurements) -> dict[str, Sequence[str]]:
    """Return id, use and session of some rows, where they are not those of a file without such columns."""
    columns: dict[str, Sequence[str]] = {}
    if any(name != str(i) for i, name in enumerate(data.ids)):
        columns["id"] = [name_cell(name) for name in part.ids]
    if data.marked or set(data.use) != {"calibrate"}:
        columns["use"] = part.use
    if any(data.sessions):
        columns["session"] = [name_cell(name) for name in part.sessions]
    return columns


def _numbers(data: Measurements, part: Measurements, prismatic: Sequence[bool]) -> dict[str, Sequence[str]]:
    """Return the cells of some rows from the joints on, by column; ``data`` decides on the columns."""
    columns: dict[str, Sequence[str]] = {}
    for j, name in enumerate(data.joint_names):
        unit, exponent = ("mm", 3) if prismatic[j] else ("rad", 0)
        columns[f"{name}_{unit}"] = _decimals(part.joints[:, j], exponent)
    for k, target in enumerate(data.targets):
        for i, axis in enumerate("xyz"):
            columns[f"{target}_{axis}_mm"] = _decimals(part.points[:, k, i], 3)
    if np.isfinite(data.sigma_m).any():
        columns["sigma_mm"] = _decimals(part.sigma_m, 3)
    for name, numbers in part.conditions.items():
        columns[name] = _decimals(numbers, 0)
    return columns | {text_cell(name): [text_cell(text) for text in texts] for name, texts in part.other.items()}


def _decimals(values: Array, exponent: int) -> list[str]:
    return [_decimal(value, exponent) for value in values.tolist()]


def _decimal(value: float, exponent: int) -> str:
    """Return ``value * 10**exponent`` exactly, in plain digits; "" for NaN."""
    if value != value:
        return ""
    text = repr(value)
    if "e" in text:
        return format(Decimal(text).scaleb(exponent), "f")
    if not exponent:
        return text
    whole, _, part = text.partition(".")
    if len(part) <= exponent:
        return format(Decimal(text).scaleb(exponent), "f")
    sign, digits = ("-", whole[1:]) if whole[0] == "-" else ("", whole)
    return f"{sign}{(digits + part[:exponent]).lstrip('0') or '0'}.{part[exponent:]}"


def read_measurements(
    path: Path,
    joint_names: Sequence[str],
    prismatic: Sequence[bool],
    *,
    points: bool = True,
    columns: ObservedColumns | None = None,
    most: Limit = ROWS,
) -> Measurements:
    """Read a measurement file, or a plan (``points=False``: the points may be missing).

    Args:
        joint_names: the robot's; the file may use q1…qn instead.
        prismatic: flags of slides, whose columns are lengths.
        points: require a point, if points are observed.
        columns: observations; points by default. Orientations are kept as texts for ``orientations``.
        most: largest number of rows.
    """
    try:
        reader = PoseReader(path, list(joint_names), list(prismatic), columns or ObservedColumns(), most)
        return reader.read(points and reader.observed.positions and reader.observed.required)
    except LabError as error:
        if not points or _names_a_joint(path, joint_names):
            raise
        text = (
            f"{error}; if it is an instrument's or a controller's own file, lab import makes a measurement file of it"
        )
        raise LabError(text) from error


def read_columns(
    source: str,
    columns: Mapping[str, Any],
    joint_names: Sequence[str],
    prismatic: Sequence[bool],
    units: tuple[str, str] = ("m", "rad"),
) -> Measurements:
    """Read columns in memory as those of a file; names may be those of ``Measurements.columns``, too.

    Further columns stay with the rows: those of numbers as conditions.

    Args:
        source: name of the table in error messages.
        units: of lengths and of angles in columns whose names state none: ``q1`` and ``p1.x``.
    """
    named = _with_units(columns, joint_names, prismatic, units)
    further = (name for name in named if name not in _OTHER_RESERVED and not _POSE_COLUMN.fullmatch(name))
    numbers = tuple(name for name in further if np.asarray(named[name]).dtype.kind in "iuf")
    kept = ObservedColumns(orientations=True, numbers=numbers, texts=tuple(named))
    reader = PoseReader(ColumnsInMemory(source, named), list(joint_names), list(prismatic), kept)
    return reader.read(need_points=False)


def _with_units(
    columns: Mapping[str, Any], joint_names: Sequence[str], prismatic: Sequence[bool], units: tuple[str, str]
) -> dict[str, Any]:
    """Return columns by the names that they have in a file, with the unit of lengths or of angles."""
    length, angle = units
    stated = dict[str, str]()
    for j, name in enumerate(joint_names):
        stated |= {each: f"{each}_{length if prismatic[j] else angle}" for each in (f"q{j + 1}", name)}
    named = dict[str, Any]()
    for name, values in columns.items():
        point = re.fullmatch(r"(.+)\.([xyz])", str(name))
        named[f"{point[1]}_{point[2]}_{length}" if point else stated.get(str(name), str(name))] = values
    if "sigma_m" in named:
        named["sigma_mm"] = _decimals(np.asarray(named.pop("sigma_m"), dtype=np.float64), 3)
    return named


def _names_a_joint(path: Path, joint_names: Sequence[str]) -> bool:
    """Decide whether the first line of a file names a joint, as a measurement file does; True if it is unreadable."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            first = file.readline(_LONGEST_HEADER).strip().lstrip("\ufeff")
    except OSError:
        return True
    known = {*joint_names, *(f"q{j + 1}" for j in range(len(joint_names)))}
    cells = [cell.strip().strip('"') for cell in first.split(",")]
    return not first or any(cell == name or cell.startswith(f"{name}_") for cell in cells for name in known)


_LONGEST_HEADER = 100_000  # characters of a first line that are read for the names of joints


class PoseReader(CsvTable):
    """Reader of a measurement file."""

    unknown_are = "copied unchanged"

    def __init__(
        self,
        source: Path | ColumnsInMemory,
        joint_names: list[str],
        prismatic: list[bool],
        observed: ObservedColumns,
        most: Limit = ROWS,
    ) -> None:
        super().__init__(source, most)
        self.joint_names, self.prismatic, self.observed = joint_names, prismatic, observed
        self.warnings: list[str] = []

    def read(self, need_points: bool) -> Measurements:
        """Return the whole file as measurements."""
        n = len(self)
        joints = np.stack([self._joint(j) for j in range(len(self.joint_names))], axis=1)
        self._refuse_further_joints()
        self._warn_of_degrees(joints)
        conditions = self._conditions()
        targets = self._targets()
        self._refuse_unknown_axes(targets)
        points = self._points(targets, need_points)
        texts = {name: self.texts(name) for name in _TEXT_COLUMNS}
        use = self._uses(texts["use"])
        ids = self._ids(texts["id"])
        sigma = self._sigma()
        other = self._rest(targets)
        return Measurements(
            tuple(self.joint_names),
            joints,
            tuple(targets),
            points,
            ids,
            use,
            texts["session"] or ("",) * n,
            sigma,
            other,
            texts["use"] is not None,
            tuple(self.warnings),
            tuple(self.lines),
            conditions,
        )

    def _sigma(self) -> Array:
        """Return the standard deviations ``(n,)`` m of a coordinate, NaN if not given."""
        column = "sigma_mm"
        if column not in self.header:
            return np.full(len(self), np.nan)
        numbers = self.numbers(column, -3, empty=True)
        sigma_mm = numbers * 1e3
        if (bad := np.flatnonzero(sigma_mm < SIGMA_MM.least)).size:
            raise self.fail(int(bad[0]), column, "not above zero; give the standard deviation")
        if (bad := np.flatnonzero(sigma_mm > SIGMA_MM.most)).size:
            raise self.fail(int(bad[0]), column, f"above {SIGMA_MM.most:g} mm; give the standard deviation in mm")
        return numbers

    # Joints

    def _joint(self, j: int, *, empty: bool = False) -> Array:
        names = tuple(dict.fromkeys((self.joint_names[j], f"q{j + 1}")))
        lengths = tuple(_LENGTH_EXPONENT)
        units, wrong = (lengths, _ANGLE_UNITS) if self.prismatic[j] else (_ANGLE_UNITS, lengths)
        columns = [column for name in names for unit in units if (column := f"{name}_{unit}") in self.header]
        if not columns:
            raise self._no_joint(names, units, wrong)
        if len(columns) > 1:
            raise self.wrong(f"{' and '.join(columns)} name the same joint; keep one")
        unit = columns[0].rsplit("_", 1)[1]
        values = self.numbers(columns[0], _LENGTH_EXPONENT.get(unit, 0), empty=empty)
        return np.deg2rad(values) if unit == "deg" else values

    def _no_joint(self, names: tuple[str, ...], units: tuple[str, ...], wrong: tuple[str, ...]) -> LabError:
        """Return the error for a joint without a column in one of its units: in another unit, or missing."""
        kind = "a revolute joint, in deg or rad" if units == _ANGLE_UNITS else "a slide, in mm or m"
        for name in names:
            if any(f"{name}_{unit}" in self.header for unit in wrong):
                return self.wrong(f"joint {name} is {kind}; rename its column to {name}_{units[0]}")
            if strays := [c for c in self.header if c == name or c.startswith(f"{name}_")]:
                valid = f"{name}_{units[0]} or {name}_{units[1]}"
                return self.wrong(f"column {strays[0]}: unknown unit; joint {name} is {kind}: {valid}")
        return self.wrong(
            f"joint {names[0]} is missing; the robot has {', '.join(self.joint_names)}: "
            f"give {names[0]}_{units[0]} or {names[0]}_{units[1]}"
        )

    def _refuse_further_joints(self) -> None:
        plain = [f"q{j + 1}" for j in range(len(self.joint_names))]
        known = "|".join(re.escape(name) for name in (*self.joint_names, *plain))
        for column in self.unread:
            if re.fullmatch(r"approach_.*", column):
                continue
            if re.match(rf"({known})(_|$)", column):
                raise self.wrong(f"column {column}: unknown unit; a joint is given once, in _deg, _rad, _mm or _m")
            if re.fullmatch(_JOINT, column):
                raise self.wrong(
                    f"column {column} is no joint of the robot, which has "
                    f"{', '.join(self.joint_names)}; choose the right {option_name('robot')} or remove the column"
                )

    def _warn_of_degrees(self, joints: Array) -> None:
        for j, name in enumerate(self.joint_names):
            in_radians = any(f"{n}_rad" in self.header for n in (name, f"q{j + 1}"))
            if in_radians and np.abs(joints[:, j]).max() > 4 * np.pi:
                largest = np.abs(joints[:, j]).max()
                self.warnings.append(
                    f"{self.path}: joint {name} reaches {largest:.4g} rad, probably degrees: "
                    "rename the column to _deg if so"
                )

    # Points

    def _points(self, targets: list[str], needed: bool) -> Array:
        """Return the points ``(n, k, 3)`` m, NaN where a target was not seen."""
        if needed and not targets:
            raise self.wrong("no measured point; give columns like p1_x_mm, p1_y_mm, p1_z_mm")
        points = np.full((len(self), len(targets), 3), np.nan)
        for k, target in enumerate(targets):
            points[:, k] = np.stack([self._coordinate(target, axis) for axis in "xyz"], axis=1)
            self._refuse_half_seen(target, points[:, k])
        if needed and not np.isfinite(points).all(axis=2).any():
            raise LabError(f"{self.path}: every point is empty; give at least one measured position")
        return points

    def _targets(self) -> list[str]:
        parts = [match for column in self.unread if (match := re.fullmatch(r"(?:(.+)_)?([xyz])_(mm|m)", column))]
        targets = list(dict.fromkeys(match[1] or "p1" for match in parts))
        TARGETS(self.header_place, targets)
        for name in targets:
            checked_target(self.header_place, name)
        plain = any(match[1] is None for match in parts)
        if plain and (len(targets) > 1 or any(column.startswith("p1_") for column in self.unread)):
            raise self.wrong("plain x, y, z beside named targets; name their columns p1_x_mm and so on")
        return targets

    def _coordinate_column(self, target: str, axis: str) -> str:
        stems = (f"{target}_{axis}", axis) if target == "p1" else (f"{target}_{axis}",)
        columns = [f"{s}_{unit}" for s in stems for unit in _LENGTH_EXPONENT if f"{s}_{unit}" in self.header]
        if len(columns) > 1:
            raise self.wrong(f"{' and '.join(columns)} name the same coordinate; keep one")
        if not columns:
            raise self.wrong(f"target {target} has no {axis}; give {target}_{axis}_mm")
        return columns[0]

    def _coordinate(self, target: str, axis: str) -> Array:
        column = self._coordinate_column(target, axis)
        return self.numbers(column, _LENGTH_EXPONENT[column.rsplit("_", 1)[1]], empty=True)

    def _refuse_half_seen(self, target: str, points: Array) -> None:
        empty = np.isnan(points)
        for row in np.flatnonzero(empty.any(axis=1) & ~empty.all(axis=1)):
            column = self._coordinate_column(target, "xyz"[int(np.argmax(empty[row]))])
            raise self.fail(int(row), column, "empty beside other coordinates; give all three or none")

    # Everything else

    def _uses(self, texts: tuple[str, ...] | None) -> tuple[str, ...]:
        for i, text in enumerate(texts or ()):
            if text not in USES:
                raise self.fail(i, "use", f"'{text}' is unknown; write one of {', '.join(USES)}")
        return texts or ("calibrate",) * len(self)

    def _ids(self, texts: tuple[str, ...] | None) -> tuple[str, ...]:
        if texts is None:
            return tuple(map(str, range(len(self))))
        ids = tuple(text or str(i) for i, text in enumerate(texts))
        first: dict[str, int] = {}
        for i, name in enumerate(ids):
            if name in first:
                raise self.fail(i, "id", f"'{name}' is also the id of {self.place(first[name])}; give each row its own")
            first[name] = i
        return ids

    def _rest(self, targets: list[str]) -> dict[str, tuple[str, ...]]:
        """Return other columns, with a warning for those that are not reserved."""
        orientation, unknown = [], []
        rest = list(self.unread)
        ends = {*ENDS, *(f"{target}_{end}" for target in targets for end in ENDS)}
        for column in rest:
            if column in ends:
                self.numbers(column, empty=True)
                orientation.append(column)
            elif column not in (*_OTHER_RESERVED, *self.observed.texts):
                unknown.append(column)
        self._warn_of_ignored(orientation, targets)
        if unknown:
            self.warnings.append(
                f"{self.path}: columns {', '.join(unknown)} have no meaning here and are {self.unknown_are}"
            )
        kept = {column: self.texts(column) for column in rest}
        return {column: texts for column, texts in kept.items() if texts is not None}

    def _warn_of_ignored(self, orientation: list[str], targets: list[str]) -> None:
        """Warn of columns that another sensor would observe."""
        sensor = self.observed.observed
        reason = f"{option_name('observe')} {sensor}" if sensor else "positions are fitted"
        if orientation and not self.observed.orientations:
            self.warnings.append(f"{self.path}: orientation columns {', '.join(orientation)} are ignored: {reason}")
        if targets and not self.observed.positions:
            self.warnings.append(f"{self.path}: points {', '.join(targets)} are ignored: {reason}")

    def _conditions(self) -> dict[str, Array]:
        """Return condition columns ``(n,)``; approach directions by the robot's joint names."""
        conditions = {}
        for column in list(self.unread):
            if column in (*_NUMBER_COLUMNS, *self.observed.numbers):
                conditions[column] = self.numbers(column, empty=True)
                if column == "payload_kg":
                    self._refuse_payloads(conditions[column])
            elif column.startswith("approach_"):
                name, values = self._approach(column, column.removeprefix("approach_"))
                if name in conditions:
                    raise self.wrong(f"columns {column} and {name} are the same; keep one")
                conditions[name] = values
        return conditions

    def _refuse_payloads(self, payloads: Array) -> None:
        if (bad := np.flatnonzero(PAYLOAD_KG.outside(payloads))).size:
            raise self.fail(int(bad[0]), "payload_kg", f"outside {PAYLOAD_KG.shown}; fix the value or its unit")

    def _approach(self, column: str, joint: str) -> tuple[str, Array]:
        plain = [f"q{j + 1}" for j in range(len(self.joint_names))]
        if joint not in (*self.joint_names, *plain):
            raise self.wrong(f"column {column}: no joint {joint}; the robot has {', '.join(self.joint_names)}")
        values = self.numbers(column, empty=True)
        if (bad := np.flatnonzero(~np.isin(values, (1, -1)) & np.isfinite(values))).size:
            raise self.fail(int(bad[0]), column, "neither 1 nor -1; give the direction of approach")
        return f"approach_{joint if joint in self.joint_names else self.joint_names[plain.index(joint)]}", values

    def _refuse_unknown_axes(self, targets: list[str]) -> None:
        ends = (*_COORDINATES, *ENDS)
        known = {*ends, *(f"{target}_{end}" for target in targets for end in ends)}
        for column in self.unread:
            if column in known:
                continue
            where = f"column {column}: unknown unit or axis"
            for target in targets:
                if column == target or column.startswith(f"{target}_"):
                    raise self.wrong(f"{where}; target {target} is given as {target}_x_mm, _y_mm, _z_mm (or _m)")
            if re.fullmatch(_AXIS, column):
                raise self.wrong(f"{where}; points are in _mm or _m, angles rx_deg, ry_deg, rz_deg")
