"""Corners of boards that a program found in pictures: a row each, with the time of the picture.

Columns are recognized by name: ``u`` and ``v`` (pixels), ``corner``, ``camera`` and ``board``; the time is that of the
picture, as a column ``time`` or the stamp of its ROS message.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.formats.loose_table import LooseTable, PointColumns, column_named
from lab.formats.tracker_export import TrackerPoints, column_times, stamp_times

__all__ = ["CornerRows", "holds_corners", "read_corners"]

_KNOWN = {
    "u": ("u px", "u", "pixel u", "corner u"),
    "v": ("v px", "v", "pixel v", "corner v"),
    "corner": ("corner", "corner id", "charuco id", "corner number", "id"),
    "camera": ("camera", "camera name"),
    "board": ("board", "board name"),
}
_TIMES = ("time", "timestamp", "time stamp", "image time", "image time stamp", "stamp")


@dataclass(frozen=True)
class CornerRows:
    """Corners in pictures.

    Attributes:
        picture: ``(m,)`` the picture that each corner is in.
        places: ``(m, 2)`` px.
        texts: further columns by name: ``corner``, and ``camera`` and ``board`` where the file has them.
    """

    picture: NDArray[np.int_]
    places: Array
    texts: dict[str, tuple[str, ...]]


def holds_corners(table: LooseTable, columns: PointColumns) -> bool:
    """Check whether a table has a column of places in pictures."""
    return any(getattr(columns, axis) or _column(table, axis) is not None for axis in "uv") and not any(
        getattr(columns, axis) or _heading(table, (axis,)) is not None for axis in "xyz"
    )


def read_corners(table: LooseTable, columns: PointColumns) -> tuple[TrackerPoints, CornerRows]:
    """Read the corners of a table, and return the pictures as points without a position.

    Args:
        columns: map of its columns.

    Raises:
        LabError: a column is missing, or places are not in pixels.
    """
    at = {what: column_named(table, given) if (given := getattr(columns, what)) else _column(table, what)
          for what in _KNOWN}  # fmt: skip
    known = ", ".join(each.text for each in table.headings or () if each.text)
    for what in ("u", "v", "corner"):
        if at[what] is None:
            raise LabError(f"{table.path}: no column is {what} ({known}); name it in the {option_name('columns')} file")
    used = {what: column for what, column in at.items() if column is not None}
    for axis in "uv":
        unit = table.headings[used[axis]].unit if table.headings is not None else ""
        if unit:
            raise LabError(
                f"{table.path}: column {table.name(used[axis])}: its unit is {unit}; export corners in pixels"
            )
    places = np.stack([table.numbers(used[axis], empty=False) for axis in "uv"], axis=1)
    if np.abs(places).max() <= 1.0:
        raise LabError(f"{table.path}: u and v are 1 at most, which are normalized coordinates; export pixels")
    time = column_named(table, columns.time) if columns.time else _heading(table, _TIMES)
    stamps = None if columns.time else stamp_times(table)
    if stamps is None and time is not None:
        stamps = column_times(table, time, None, columns.dates or ""), table.name(time)
    if stamps is None:
        raise LabError(
            f"{table.path}: no column is the picture's time ({known}); name it in the {option_name('columns')} file"
        )
    times, time_from = stamps
    texts: dict[str, tuple[str, ...]] = {
        what: table.texts(used[what]) for what in ("corner", "camera", "board") if what in used
    }
    keys = list(zip(times.seconds.tolist(), texts.get("camera", ("",) * len(places)), strict=True))
    numbers = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    picture = np.array([numbers[key] for key in keys], dtype=np.int_)
    first = np.unique(picture, return_index=True)[1].tolist()
    none, blank = np.full(len(first), np.nan), ("",) * len(first)
    called = tuple(f"picture {k + 1}" for k in range(len(first)))
    names = {table.name(column) for column in used.values()} | set(time_from.split(", "))
    unused = tuple(table.name(c) for c in range(table.width) if table.name(c) not in names and not table.is_blank(c))
    pictures = TrackerPoints(
        table.path, called, blank, tuple(table.lines[i] for i in first), np.full((len(first), 3), np.nan), none,
        times.seconds[first], times.clock, none, none, none,
        {what: table.name(column) for what, column in used.items()} | {"time": time_from}, unused, (), table.left_out,
    )  # fmt: skip
    return pictures, CornerRows(picture, places, texts)


def _column(table: LooseTable, what: str) -> int | None:
    return _heading(table, _KNOWN[what])


def _heading(table: LooseTable, known: tuple[str, ...]) -> int | None:
    headings = table.headings or ()
    return next((i for key in known for i, each in enumerate(headings) if each.key == key), None)
