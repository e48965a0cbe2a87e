"""Errors that a person reads, and the grammar of their sentences."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = [
    "IncompleteColumnError",
    "LabError",
    "be",
    "counted",
    "error_context",
    "option_name",
    "options_as_flags",
]

_as_flags = False


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


def option_name(name: str) -> str:
    """Name an option as its reader gives it: ``noise_mm`` of a call, ``--noise-mm`` on the command line."""
    return "--" + name.replace("_", "-") if _as_flags else name


@contextmanager
def options_as_flags() -> Iterator[None]:
    """Name options as flags in the messages that are made here: of a command, not of a call."""
    global _as_flags
    before, _as_flags = _as_flags, True
    try:
        yield
    finally:
        _as_flags = before


def counted(count: int, noun: str) -> str:
    """A count and what it counts: ``1 pose``, ``12,000 poses``; the plural takes an s."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def be(count: int) -> str:
    """The verb that fits a count: ``is`` or ``are``."""
    return "is" if count == 1 else "are"
