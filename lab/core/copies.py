"""Rows that repeat an earlier one to the last digit, which measurements never do."""

import numpy as np

from lab.core.se3 import Array

__all__ = ["copied_rows", "said_of_copies"]


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
