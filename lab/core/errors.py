"""Error messages to the user, and their grammar."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["IncompleteColumnError", "LabError", "be", "counted", "error_context", "option_name", "options_as_flags"]

_as_flags = False


class LabError(ValueError):
    """Input that cannot be used: one line that says what, where and how to mend it."""


class IncompleteColumnError(LabError):
    """A column of a file has gaps where every row is needed."""


@contextmanager
def error_context(context: object) -> Iterator[None]:
    """Put the file or option before the message of a LabError that is raised within."""
    try:
        yield
    except LabError as error:
        raise LabError(f"{context}: {error}") from error


def option_name(name: str) -> str:
    """Name an option as its reader gives it: ``noise_mm`` of a call, ``--noise-mm`` on the command line."""
    return "--" + name.replace("_", "-") if _as_flags else name


@contextmanager
def options_as_flags() -> Iterator[None]:
    """Name options as flags in messages, for a command instead of a Python call."""
    global _as_flags
    before, _as_flags = _as_flags, True
    try:
        yield
    finally:
        _as_flags = before


def counted(count: int, noun: str) -> str:
    """Write a count with its noun: ``1 pose``, ``12,000 poses``; the plural takes an s."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def be(count: int) -> str:
    """Return the verb for a count: ``is`` or ``are``."""
    return "is" if count == 1 else "are"
