"""The one error a user of the lab sees, and what the lab itself distinguishes of it."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["IncompleteColumnError", "LabError", "error_context"]


class LabError(ValueError):
    """Input that cannot be used: one line that says what, where and how to mend it."""


class IncompleteColumnError(LabError):
    """A column of a file has gaps where every row is needed."""


@contextmanager
def error_context(context: object) -> Iterator[None]:
    """Say in what happens here which file or option it comes from.

    Raises:
        LabError: one that is raised within, with the context before its message.
    """
    try:
        yield
    except LabError as error:
        raise LabError(f"{context}: {error}") from error
