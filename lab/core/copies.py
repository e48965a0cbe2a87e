"""Rows that repeat an earlier one to the last digit, which measurements never do."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.core.wording import be, counted

__all__ = ["copied_rows", "said_of_copies", "without_copies"]

LEAST_ROWS = 5  # of fewer the fit says what they lack


def copied_rows(numbers: Array) -> list[tuple[int, int]]:
    """Which rows of numbers ``(n, c)`` are copies, each with the first row that is alike."""
    size = numbers.itemsize * numbers.shape[1]
    alike = np.ascontiguousarray(numbers).view(np.dtype((np.void, size))).ravel()
    _, first, group = np.unique(alike, return_index=True, return_inverse=True)
    earlier = first[group]
    return [(int(row), int(earlier[row])) for row in np.flatnonzero(earlier != np.arange(len(numbers)))]


def said_of_copies(source: object, count: int, row: str, same: str) -> str:
    """What copies are, for a warning or a refusal.

    Args:
        count: how many there are.
        row: the first of them, for a person, and ``same`` the row that it repeats.
    """
    copies = "1 row is a copy" if count == 1 else f"{count} rows are copies"
    first = f"(the first: {row}, of {same})"
    return f"{source}: {copies} of an earlier one to the last digit {first}, which measurements never are"


def without_copies(path: Path, data: Measurements) -> Measurements:
    """The rows that do not repeat an earlier one to the last digit, with a warning of the others.

    Nothing is measured twice alike: a copy would count as a measurement of its own, and make intervals too narrow.

    Raises:
        LabError: next to nothing but copies is left.
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
    said, left = said_of_copies(path, len(copies), *map(data.where, copies[0])), len(data) - len(copies)
    if left < LEAST_ROWS:
        raise LabError(f"{said}: {counted(left, 'row')} {be(left)} left; measure more poses")
    gone = {row for row, _ in copies}
    kept = data.take([row for row in range(len(data)) if row not in gone])
    return replace(kept, warnings=(*kept.warnings, f"{said}: left out"))
