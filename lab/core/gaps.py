"""Go on without a part of a page or recording that cannot be made: a drawing never destroys a result."""

import warnings
from collections.abc import Callable
from typing import TypeVar

from lab.core.errors import LabError, LabWarning, was_interrupted
from lab.core.extras import how_to_install

__all__ = ["GapWarning", "attempted"]

_Made = TypeVar("_Made")
_PANIC = "PanicException"  # of rerun's own code; not an Exception


class GapWarning(LabWarning):
    """A figure, a section, a page or a recording could not be made, and is left out."""


def attempted(
    what: str, make: Callable[[], _Made], instead: Callable[[str], _Made], *, passed: tuple[type[Exception], ...] = ()
) -> _Made:
    """Return what a function makes; if it fails, warn, and return what stands in its place.

    Args:
        what: its name, as the warning begins.
        instead: makes the substitute from the text of the warning.
        passed: errors that the caller handles, which stay as they are.
    """
    try:
        return make()
    except BaseException as error:
        expected = isinstance(error, Exception) or type(error).__name__ == _PANIC
        if not expected or was_interrupted(error) or isinstance(error, (GapWarning, *passed)):
            raise
        message = f"{what} is left out: {_cause(error)}"
        warnings.warn(message, GapWarning, stacklevel=1)
        return instead(message)


def _cause(error: BaseException) -> str:
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"it needs {how_to_install(error.name)}"
    if isinstance(error, OSError):
        return f"it cannot be written ({error.strerror or error})"
    if isinstance(error, LabError):
        return str(error)
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
