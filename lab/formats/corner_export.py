"""Corners of boards that a program found in pictures: a row each, with the time of the picture.

Columns are recognized by name: ``u`` and ``v`` (pixels), ``corner``, ``camera`` and ``board``; the time is that of the
picture, as a column ``time`` or the stamp of its ROS message.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.loose_table import LooseTable, PointColumns
from lab.formats.time_columns import ColumnTimes, column_times, stamp_times
from lab.formats.tracker_export import TrackerPoints

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
    keys = {each.key for each in table.headings or ()}
    pixels = any(getattr(columns, axis) or keys.intersection(_KNOWN[axis]) for axis in "uv")
    return pixels and not any(getattr(columns, axis) or axis in keys for axis in "xyz")


def read_corners(table: LooseTable, columns: PointColumns) -> tuple[TrackerPoints, CornerRows]:
    """Read the corners of a table, and return the pictures as points without a position.

    Args:
        columns: map of its columns.

    Raises:
        LabError: a column is missing, or places are not in pixels.
    """
    used = _corner_columns(table, columns)
    places = _places(table, used)
    times = _picture_times(table, columns)
    texts = {what: table.texts(column) for what, column in used.items() if what not in "uv"}
    # a picture is what one camera took at one time
    keys = list(zip(times.seconds.tolist(), texts.get("camera", ("",) * len(places)), strict=True))
    numbers = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    picture = np.array([numbers[key] for key in keys], dtype=np.int_)
    first = np.unique(picture, return_index=True)[1].tolist()
    none, blank = np.full(len(first), np.nan), ("",) * len(first)
    called = tuple(f"picture {k + 1}" for k in range(len(first)))
    names = {what: table.name(column) for what, column in used.items()} | {"time": times.columns}
    read = {*names.values(), *times.columns.split(", ")}
    unused = tuple(table.name(c) for c in range(table.width) if table.name(c) not in read and not table.is_blank(c))
    pictures = TrackerPoints(
        table.path, called, blank, tuple(table.lines[i] for i in first), np.full((len(first), 3), np.nan), none,
        times.seconds[first], times.clock, none, none, none, names, unused, (), table.left_out,
    )  # fmt: skip
    return pictures, CornerRows(picture, places, texts)


def _corner_columns(table: LooseTable, columns: PointColumns) -> dict[str, int]:
    """Return the columns of a corner by meaning: those of its place and number, and others that the table has."""
    at = {what: table.find(what, keys, getattr(columns, what)) for what, keys in _KNOWN.items()}
    for what in ("u", "v", "corner"):
        if at[what] is None:
            raise table.missing(what)
    return {what: column for what, column in at.items() if column is not None}


def _places(table: LooseTable, used: dict[str, int]) -> Array:
    """Return the places ``(m, 2)`` px of the corners."""
    for axis in "uv":
        if unit := table.unit(used[axis]):
            raise LabError(
                f"{table.path}: column {table.name(used[axis])}: its unit is {unit}; export corners in pixels"
            )
    places = np.stack([table.numbers(used[axis], empty=False) for axis in "uv"], axis=1)
    if np.abs(places).max() <= 1.0:
        raise LabError(f"{table.path}: u and v are 1 at most, which are normalized coordinates; export pixels")
    return places


def _picture_times(table: LooseTable, columns: PointColumns) -> ColumnTimes:
    """Return the time of each row's picture: of the map of columns, of a known column, or its message's stamp."""
    stamps = None if columns.time else stamp_times(table)
    if stamps is not None:
        return stamps
    time = table.find("the picture's time", _TIMES, columns.time)
    if time is None:
        raise table.missing("the picture's time")
    return column_times(table, time, None, columns.dates or "")
