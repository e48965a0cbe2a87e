"""Measurements of an instrument: joint positions with the positions of targets."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, count, pairwise
from pathlib import Path
from typing import Any, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import IncompleteColumnError, LabError, be, counted
from lab.core.se3 import Array
from lab.core.values import Value, arrow_stream, data_frame

__all__ = [
    "BEFORE",
    "FIXTURE",
    "LAST_MOVE",
    "PLACE",
    "SESSION",
    "STATION",
    "Measurements",
    "Rows",
    "condition_column",
    "copied_rows",
    "describe_copies",
    "evenly",
    "joined",
    "last_moves",
    "measured",
    "rows_called",
    "seen_mask",
    "setups",
    "thinned",
    "without_copies",
]

FIXTURE = "fixture"  # condition: number of a row's fixture (anchor, socket, plane)
SESSION = "session "  # prefix of a session's name: condition 1 in its rows, else 0
STATION = "station "  # prefix of a station's name: condition 1 in its rows, else 0
LAST_MOVE = "last move of "  # prefix of a joint's name: condition of its last direction of motion
BEFORE = "before "  # prefix of a place in the file: condition 1 in the rows before it, else 0
PLACE = "place in the file"  # condition: progress of the campaign, from 0 to 1
_ROWS_PRINTED = 7

Rows: TypeAlias = "int | slice | list[int] | list[bool] | NDArray[np.int_] | NDArray[np.bool_] | np.bool_"
"""Some rows of a table: a mask, a slice, or their numbers."""
_STILL = 1e-4  # rad or m: smaller changes from row to row are no motion


@dataclass(frozen=True, eq=False)
class _Visits(Value):
    """Order of the poses.

    Attributes:
        place: ``(n,)``, from 0 for the first row of the campaign to 1 for the last.
        last_move: ``(n, joints)``: each joint's last direction of motion, 1 or -1; 0 if unknown.
    """

    place: Array
    last_move: Array

    def __getitem__(self, rows: NDArray[np.int_]) -> "_Visits":
        return _Visits(self.place[rows], self.last_move[rows])


def last_moves(joints: Array, sessions: Sequence[str] = ()) -> Array:
    """Return each joint's last direction of motion ``(n, joints)``: 1, -1, or 0 if unknown.

    Args:
        joints: ``(n, joints)`` positions (rad, m of a slide) in the order of the visits.
        sessions: of the rows; directions are unknown before the first row of each.
    """
    moved = np.diff(joints, axis=0, prepend=joints[:1])
    sign = np.where(np.abs(moved) > _STILL, np.sign(moved), 0.0)
    begins = np.zeros(len(joints), dtype=bool)
    begins[:1] = True
    if sessions:
        begins[1:] = [a != b for a, b in pairwise(sessions)]
    sign[begins] = 0.0
    latest = np.where((sign != 0) | begins[:, None], np.arange(len(joints))[:, None], 0)
    return np.asarray(np.take_along_axis(sign, np.maximum.accumulate(latest, axis=0), axis=0))


@dataclass(frozen=True, eq=False, repr=False)
class Measurements(Value):
    """Table of joint positions and the points observed there, in the instrument's frame: one row a pose.

    ``m[rows]`` has some rows, in their order: a mask, a slice, row numbers (negative ones count from the end) or one
    number, as numpy's arrays are indexed. ``m["q1"]`` and ``m["p1.x"]`` are columns, by the names of ``columns()``.
    ``a + b`` has the rows of both. Iteration yields tables of one row.

    Attributes:
        joint_names: of the columns of ``joints``.
        joints: ``(n, joints)``, rad for a revolute joint, m for a slide.
        targets: names of the measured points.
        points: ``(n, k, 3)`` m; NaN if not measured. ``(n, k, d)`` for another kind of observation.
        ids: the row's ``id``, else its 0-based data row.
        use: ``calibrate``, ``reference``, ``test`` or ``skip``, one per row.
        sessions: the row's session, "" where the file has none.
        sigma_m: ``(n,)`` standard deviation of a coordinate, NaN if not given.
        other: further columns as texts.
        marked: True if the file has a column ``use``.
        warnings: messages for the user.
        lines: line in the file of each row, from 1; empty without a file.
        conditions: further columns ``(n,)``, NaN if not given: ``payload_kg``, ``temp_C``, ``time_s``, ``cable_mm``,
            ``approach_<joint>``.
        visits: order of the rows in their campaign; None for a whole campaign.
        robot: name or path of the robot, "" if unknown.
    """

    joint_names: tuple[str, ...]
    joints: Array
    targets: tuple[str, ...]
    points: Array
    ids: tuple[str, ...]
    use: tuple[str, ...]
    sessions: tuple[str, ...]
    sigma_m: Array
    other: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    marked: bool = False
    warnings: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    conditions: Mapping[str, Array] = field(default_factory=dict)
    visits: _Visits | None = None
    robot: str = ""

    def __post_init__(self) -> None:
        n, k = len(self.joints), len(self.targets)
        wanted = {"joints": (n, len(self.joint_names)), "points": (n, k, *self.points.shape[2:]), "sigma_m": (n,)}
        columns = {name: getattr(self, name) for name in wanted} | dict(self.conditions)
        for name, column in columns.items():
            if column.shape != (shape := wanted.get(name, (n,))):
                raise LabError(f"measurements: {name} has shape {column.shape}; give {shape}: one row a pose")
            if column.dtype.kind == "c":
                raise LabError(f"measurements: {name} are complex numbers; give real ones")
        if self.points.ndim != 3:
            raise LabError(f"measurements: points have shape {self.points.shape}; give ({n}, {k}, 3)")
        texts = {"ids": self.ids, "use": self.use, "sessions": self.sessions, **self.other}
        for name, cells in (texts | ({"lines": self.lines} if self.lines else {})).items():
            if len(cells) != n:
                raise LabError(f"measurements: {name} has {len(cells)} entries; give {n}: one for each pose")
        if not np.isfinite(self.joints).all():
            row, j = np.argwhere(~np.isfinite(self.joints))[0].tolist()
            raise LabError(
                f"measurements: joints[{row}, {j}] ({self.joint_names[j]}) is {self.joints[row, j]}; give a finite "
                "number, or leave the row out"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_visited"}

    def __len__(self) -> int:
        return len(self.joints)

    def _about(self) -> str:
        robot = f" of {self.robot}" if self.robot else ""
        return f"{counted(len(self), 'pose')}{robot}, targets {', '.join(self.targets)}"

    def __str__(self) -> str:
        """Return a table of the first rows: joint positions in rad or m, points in m."""
        columns = [
            [name, *(each if isinstance(each, str) else f"{each:.6g}" for each in values[:_ROWS_PRINTED])]
            for name, values in self.columns().items()
        ]
        widths = [max(map(len, column)) for column in columns]
        lines = ["  ".join(map(str.rjust, row, widths)) for row in zip(*columns, strict=True)]
        more = [f"and {counted(len(self) - _ROWS_PRINTED, 'further pose')}"] if len(self) > _ROWS_PRINTED else []
        return "\n".join([self._about(), *lines, *more])

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns ``(n,)`` by name: texts, or numbers in SI units.

        They are ``id``, the joints (rad or m), the coordinates (m) of each target (``p1.x``), conditions, and ``use``,
        ``session``, ``sigma_m`` and further texts where they are given.
        """
        axes = "xyz" if self.points.shape[2] == 3 else [str(i) for i in range(self.points.shape[2])]
        columns: dict[str, NDArray[Any]] = {"id": np.array(self.ids, dtype=np.str_)}
        columns |= dict(zip(self.joint_names, self.joints.T, strict=True))
        for k, target in enumerate(self.targets):
            columns |= {f"{target}.{axis}": self.points[:, k, i] for i, axis in enumerate(axes)}
        columns |= self.conditions
        if np.isfinite(self.sigma_m).any():
            columns["sigma_m"] = self.sigma_m
        texts = dict(self.other)
        if self.marked:
            texts["use"] = self.use
        if any(self.sessions):
            texts["session"] = self.sessions
        return columns | {name: np.array(cells, dtype=np.str_) for name, cells in texts.items()}

    def to_frame(self) -> Any:
        """Return ``columns`` as a ``pandas.DataFrame``; raise a LabError if pandas is not installed."""
        return data_frame(self.columns())

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return ``columns`` as a stream of the Arrow C interface, which polars, pyarrow and DuckDB read."""
        return arrow_stream(self.columns(), requested_schema)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Mask ``(n, k)`` of the targets seen at each pose."""
        return seen_mask(self.points)

    @property
    def used(self) -> NDArray[np.bool_]:
        """Mask ``(n,)`` of the rows that are not to be skipped."""
        return np.array([use != "skip" for use in self.use], dtype=np.bool_)

    @property
    def places(self) -> Array:
        """Progress of the campaign ``(n,)`` at each row, from 0 to 1."""
        return self._visited.place

    @property
    def stations(self) -> tuple[str, ...]:
        """Station of the instrument of each row, "" if not given."""
        return self.other.get("station", ("",) * len(self))

    @overload
    def __getitem__(self, rows: str) -> NDArray[Any]: ...

    @overload
    def __getitem__(self, rows: Rows) -> "Measurements": ...

    def __getitem__(self, rows: "str | Rows") -> "NDArray[Any] | Measurements":
        """Return some rows, as numpy's arrays are indexed, or the column of a name.

        Raises:
            LabError: there is no such row or column, or it is no index of rows.
        """
        if isinstance(rows, str):
            columns = self.columns()
            if rows not in columns:
                raise LabError(f"measurements have no column '{rows}'; there are {', '.join(columns)}")
            return columns[rows]
        index = self._row_numbers(rows)
        if len(index) == len(self) and (index == np.arange(len(self))).all():
            return self
        numbers = index.tolist()

        def of_rows(cells: Sequence[Any]) -> tuple[Any, ...]:
            return tuple(map(cells.__getitem__, numbers))

        return replace(
            self,
            joints=self.joints[index],
            points=self.points[index],
            ids=of_rows(self.ids),
            use=of_rows(self.use),
            sessions=of_rows(self.sessions),
            sigma_m=self.sigma_m[index],
            conditions={name: column[index] for name, column in self.conditions.items()},
            other={name: of_rows(column) for name, column in self.other.items()},
            lines=of_rows(self.lines) if self.lines else (),
            visits=self._visited[index],
        )

    def _row_numbers(self, rows: Rows) -> NDArray[np.int_]:
        """Return the numbers of rows ``(m,)`` from 0; numpy decides what an index is."""
        try:
            index = np.arange(len(self))[rows]
        except (IndexError, TypeError, ValueError) as error:
            raise LabError(f"measurements of {counted(len(self), 'row')}: {' '.join(str(error).split())}") from None
        if index.ndim > 1:
            raise LabError(
                f"measurements: an index of {index.ndim} dimensions; give a mask, a slice, or numbers of rows"
            )
        return np.atleast_1d(index)

    def __iter__(self) -> Iterator["Measurements"]:
        return (self[row] for row in range(len(self)))

    def __add__(self, other: "Measurements") -> "Measurements":
        """Return the rows of both, as ``joined`` does."""
        return joined([self, other]) if isinstance(other, Measurements) else NotImplemented

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise LabError("measurements are a table and no array; take .joints, .points, a column, or to_frame()")

    @cached_property
    def _visited(self) -> _Visits:
        if self.visits is not None:
            return self.visits
        return _Visits(np.linspace(0.0, 1.0, len(self)), last_moves(self.joints, self.sessions))

    def where(self, row: int) -> str:
        """Return a row's location for an error message: its line in the file, else its id."""
        return f"line {self.lines[row]}" if self.lines else f"row {self.ids[row]}"

    def inputs(self, conditions: Sequence[str]) -> Array:
        """Return a model's inputs ``(n, joints + conditions)``: joint readings and conditions.

        A payload that is not given is zero. ``SESSION``, ``STATION``, ``PLACE``, ``BEFORE`` and ``LAST_MOVE`` are
        derived.

        Raises:
            LabError: another condition is missing, or empty in a row.
        """
        columns = [self._condition(name)[:, None] for name in conditions]
        return np.concatenate([self.joints, *columns], axis=1) if columns else self.joints

    def _condition(self, name: str) -> Array:
        conditions: Mapping[str, Array] = self.conditions
        if name not in conditions:
            if (derived := self._derived(name)) is not None:
                return derived
            if name in self.other:  # of an effect of one's own: the reader kept its texts
                conditions = {name: self._numbers(name)}
        return condition_column(conditions, name, len(self), self.where)

    def _derived(self, name: str) -> Array | None:
        """Return a condition that follows from sessions, stations or the order of the rows; None for another."""
        for prefix, column in ((SESSION, self.sessions), (STATION, self.stations)):
            if name.startswith(prefix):
                return np.array([cell == name.removeprefix(prefix) for cell in column], dtype=np.float64)
        if name == PLACE:
            return self._visited.place
        if name.startswith(BEFORE):
            return np.array(self._visited.place < float(name.removeprefix(BEFORE)), dtype=np.float64)
        if name.startswith(LAST_MOVE):
            return self._visited.last_move[:, self.joint_names.index(name.removeprefix(LAST_MOVE))]
        return None

    def _numbers(self, column: str) -> Array:
        numbers = np.full(len(self), np.nan)
        for i, text in enumerate(self.other[column]):
            try:
                numbers[i] = float(text) if text else np.nan
            except ValueError:
                numbers[i] = np.inf
            if np.isinf(numbers[i]) or (text and np.isnan(numbers[i])):
                raise LabError(f"{self.where(i)}, column {column}: '{text}' is no finite number; give one in every row")
        return numbers

    def with_points(self) -> "Measurements":
        """Return the rows in which a target was measured."""
        return self[self.seen.any(axis=1)]

    def without(self, ids: Collection[str]) -> "Measurements":
        """Return the rows with other ids than these."""
        return self[[name not in ids for name in self.ids]]

    def only(self, *uses: str) -> "Measurements":
        """Return the rows of these uses: ``calibrate``, ``reference``, ``test`` or ``skip``."""
        return self[[use in uses for use in self.use]]


def joined(tables: Sequence[Measurements]) -> Measurements:
    """Return the rows of several tables, one below the other.

    An id that an earlier row has gets a number (``7_2``). Rows of equal sessions and stations stay in one base and
    instrument frame. A condition that a table does not have is NaN there; a payload is zero.

    Raises:
        LabError: there is no table, or they have other joints, targets, numbers a target, or robots.
    """
    if not tables:
        raise LabError("measurements: none to join; give at least one table")
    for other in tables[1:]:
        _refuse_another_kind(tables[0], other)
    whole = replace(
        tables[0],
        joints=np.concatenate([table.joints for table in tables]),
        points=np.concatenate([table.points for table in tables]),
        ids=_numbered(_strung(tables, "ids")),
        use=_strung(tables, "use"),
        sessions=_strung(tables, "sessions"),
        sigma_m=np.concatenate([table.sigma_m for table in tables]),
        conditions=_joined_conditions(tables),
        other=_joined_texts(tables),
        marked=any(table.marked for table in tables),
        warnings=tuple(dict.fromkeys(_strung(tables, "warnings"))),
        lines=tables[0].lines if len(tables) == 1 else (),
        visits=None,
        robot=next(filter(None, (table.robot for table in tables)), ""),
    )
    visits = _Visits(_places(tables), np.concatenate([table._visited.last_move for table in tables]))
    return whole if visits == whole._visited else replace(whole, visits=visits)


def _strung(tables: Sequence[Measurements], name: str) -> tuple[str, ...]:
    """Return a field of texts of all tables."""
    return tuple(chain.from_iterable(getattr(table, name) for table in tables))


def _joined_conditions(tables: Sequence[Measurements]) -> dict[str, Array]:
    names = dict.fromkeys(chain.from_iterable(table.conditions for table in tables))
    return {name: np.concatenate([_condition_of(table, name) for table in tables]) for name in names}


def _condition_of(table: Measurements, name: str) -> Array:
    return table.conditions.get(name, np.full(len(table), 0.0 if name == "payload_kg" else np.nan))


def _joined_texts(tables: Sequence[Measurements]) -> dict[str, tuple[str, ...]]:
    names = dict.fromkeys(chain.from_iterable(table.other for table in tables))
    cells = {name: [table.other.get(name, ("",) * len(table)) for table in tables] for name in names}
    return {name: tuple(chain.from_iterable(columns)) for name, columns in cells.items()}


def _refuse_another_kind(first: Measurements, other: Measurements) -> None:
    named = {
        "joints": (first.joint_names, other.joint_names),
        "targets": (first.targets, other.targets),
        "numbers for each target": ((str(first.points.shape[2]),), (str(other.points.shape[2]),)),
        "robot": ((first.robot,), (other.robot or first.robot,)) if first.robot else ((), ()),
    }
    for what, (ours, theirs) in named.items():
        if ours != theirs:
            raise LabError(
                f"measurements: {what} {', '.join(ours)} and {what} {', '.join(theirs)} are not joined; identify each "
                "by itself, or give both the same"
            )


def _numbered(ids: Sequence[str]) -> tuple[str, ...]:
    """Return ids that differ: a repeated one gets the first number that is free."""
    taken, numbered = set(ids), dict[str, None]()
    for name in ids:
        free = name
        if name in numbered:
            free = next(each for i in count(2) if (each := f"{name}_{i}") not in taken)
        taken.add(free)
        numbered[free] = None
    return tuple(numbered)


def _places(tables: Sequence[Measurements]) -> Array:
    """Return the progress of the campaign: kept in parts of one campaign, else by the tables' numbers of rows."""
    own = [table._visited.place for table in tables if len(table)]
    if all(before.max() < after.min() for before, after in pairwise(own)):
        return np.concatenate([np.zeros(0), *own])
    starts, rows = np.cumsum([0, *map(len, own)]), sum(map(len, own))
    return np.concatenate([(start + place * len(place)) / rows for start, place in zip(starts, own, strict=False)])


def condition_column(conditions: Mapping[str, Array], name: str, rows: int, where: Callable[[int], str]) -> Array:
    """Return the column of a condition that a model requires; a missing payload is zero.

    Args:
        where: location of a row for an error message.

    Raises:
        LabError: another condition is missing.
        IncompleteColumnError: it is empty in a row.
    """
    column = conditions.get(name)
    if column is None:
        if name != "payload_kg":
            raise LabError(f"column {name} is missing: the model needs it in every row")
        return np.zeros(rows)
    if (empty := np.isnan(column)).any():
        row = where(int(np.argmax(empty)))
        raise IncompleteColumnError(f"{row}, column {name}: empty, but the model needs it in every row; fill it in")
    return column


def setups(data: Measurements) -> tuple[tuple[str, str], ...]:
    """Return session and station of each row: rows that differ have another base or instrument pose."""
    return tuple(zip(data.sessions, data.stations, strict=True))


def rows_called(data: Measurements, ids: Sequence[str]) -> list[int]:
    """Return the first row with each id; raise a KeyError without one."""
    first = {name: i for i, name in reversed([*enumerate(data.ids)])}
    return [first[name] for name in ids]


def evenly(rows: int, most: int) -> NDArray[np.int_] | None:
    """Return ``most`` evenly spaced row numbers; None if there are no more rows."""
    return None if rows <= most else np.linspace(0, rows - 1, most).round().astype(np.int_)


def thinned(data: Measurements, most: int) -> Measurements:
    """Return at most so many rows, evenly spaced."""
    some = evenly(len(data), most)
    return data if some is None else data[some]


def seen_mask(points: Array) -> NDArray[np.bool_]:
    """Return the mask ``(n, k)`` of seen points ``(n, k, d)``."""
    return np.asarray(np.isfinite(points).all(axis=2), dtype=np.bool_)


def measured(joint_names: tuple[str, ...], joints: Array, targets: tuple[str, ...], points: Array) -> Measurements:
    """Return measurements of plain arrays: every row for calibration, ids 0 to n - 1."""
    n = len(joints)
    ids, sigma = tuple(str(i) for i in range(n)), np.full(n, np.nan)
    return Measurements(joint_names, joints, targets, points, ids, ("calibrate",) * n, ("",) * n, sigma)


_LEAST_ROWS = 5


def copied_rows(numbers: Array) -> list[tuple[int, int]]:
    """Find copied rows of numbers ``(n, c)``, each with the first equal row."""
    first: dict[bytes, int] = {}
    earlier = [first.setdefault(row.tobytes(), i) for i, row in enumerate(numbers)]
    return [(row, same) for row, same in enumerate(earlier) if row != same]


def describe_copies(source: object, count: int, row: str, same: str) -> str:
    """Describe ``count`` copied rows: ``row``, the first, repeats the row ``same``."""
    copies = "1 row is a copy" if count == 1 else f"{count} rows are copies"
    first = f"(the first: {row}, of {same})"
    return f"{source}: {copies} of an earlier one to the last digit {first}, which measurements never are"


def without_copies(path: Path, data: Measurements) -> Measurements:
    """Leave out rows that repeat an earlier one to the last digit, with a warning.

    Copies would make intervals too narrow. Too few other rows raise a LabError.
    """
    conditions = [column for _, column in sorted(data.conditions.items())]
    names = {name: float(i) for i, name in enumerate(dict.fromkeys(data.sessions))}
    numbers = np.column_stack(
        [data.joints, data.points.reshape(len(data), -1), *conditions, [names[name] for name in data.sessions]]
    )
    seen = np.flatnonzero(data.seen.any(axis=1))
    copies = [(int(seen[row]), int(seen[same])) for row, same in copied_rows(numbers[seen])]
    if not copies:
        return data
    message, left = describe_copies(path, len(copies), *map(data.where, copies[0])), len(data) - len(copies)
    if left < _LEAST_ROWS:
        raise LabError(f"{message}: {counted(left, 'row')} {be(left)} left; measure more poses")
    kept = data[np.setdiff1d(np.arange(len(data)), [row for row, _ in copies])]
    return replace(kept, warnings=(*kept.warnings, f"{message}: left out"))
