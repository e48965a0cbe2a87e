"""The one error a user of the lab sees."""

from collections.abc import Iterator
from contextlib import contextmanager


class LabError(ValueError):
    """Input that cannot be used: one line that says what, where and how to mend it."""


@contextmanager
def error_context(context: object) -> Iterator[None]:
    """Say in what happens here which file or option it comes from."""
    try:
        yield
    except LabError as error:
        raise LabError(f"{context}: {error}") from error
