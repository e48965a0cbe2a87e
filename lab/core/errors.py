"""Error messages to the user, their grammar, and what an interruption becomes."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = [
    "IncompleteColumnError",
    "LabError",
    "LabWarning",
    "be",
    "counted",
    "error_context",
    "option_name",
    "options_as_flags",
    "was_interrupted",
]

_as_flags = False


_FLAG = re.compile(r"\blab [a-z]+ [^,;()]*|(?<![\w/-])--([a-z][a-z0-9-]*)")  # command lines stay as they are


class LabError(ValueError):
    """Input that cannot be used: one line that says what, where and how to mend it.

    The library names options as arguments (``noise_mm``), the command line as flags (``--noise-mm``).
    """

    def __init__(self, message: object = "") -> None:
        text = str(message)
        super().__init__(text if _as_flags else _FLAG.sub(_as_argument, text))


class LabWarning(UserWarning):
    """A warning of a call that has no result yet to hold it; the command line prints it in one line."""


def _as_argument(found: re.Match[str]) -> str:
    return found[0] if found[1] is None else found[1].replace("-", "_")


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


def was_interrupted(error: BaseException | None) -> bool:
    """Decide whether an error is, or came of, an interruption: some libraries convert it to an error of their own."""
    seen = set[int]()  # an error may be its own cause
    while error is not None and id(error) not in seen:
        if isinstance(error, KeyboardInterrupt):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False
